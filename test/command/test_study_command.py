"""`cable-shape study` and its report."""

from __future__ import annotations

import csv
import re
from pathlib import Path

import pytest
import yaml

from cable_shape.command.cli import main
from cable_shape.scene.mesh_files import read_triangles

EXAMPLES = Path(__file__).resolve().parents[2] / "examples" / "studies"


def fewer(tmp_path: Path) -> str:
    """The study of a hose's length with fewer lengths and instants."""
    told = yaml.safe_load((EXAMPLES / "length.yaml").read_text(encoding="utf-8"))
    told["vary"]["cable.length"]["step"] = 0.015
    told["motion"]["instants"] = 25
    file = tmp_path / "hose.yaml"
    file.write_text(yaml.safe_dump(told))
    return str(file)


def test_a_study_makes_tables_a_report_and_recordings(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    file = fewer(tmp_path)
    assert main(["study", file, "-o", str(out), "--workers", "1"]) == 0
    told = capsys.readouterr().out
    assert "19 points, 475 shapes asked for" in told
    assert re.search(r"2 points are within all limits, cable.length 0\.69 to 0\.705", told)
    with (out / "results.csv").open() as table:
        rows = list(csv.DictReader(table))
    assert [float(row["cable.length"]) for row in rows] == pytest.approx([0.63 + 0.015 * i for i in range(19)])
    assert [row["within"] for row in rows].count("True") == 2
    page = (out / "report.html").read_text(encoding="utf-8")
    assert page.count("<svg") == 7 * 3
    assert not re.search(r"(?:src|href)=.https?:", page)
    for measure in ("stress", "bend_radius", "clearance:exhaust"):
        assert f">{measure}</h2>" in page
    named = set(re.findall(r"cable-shape view (point_\d+\.rrd)", page))
    assert named == {file.name for file in out.glob("*.rrd")}
    assert named


def test_it_goes_on_and_refuses_another_study(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out, file = tmp_path / "out", Path(fewer(tmp_path))
    fast = ["study", str(file), "-o", str(out), "--workers", "1", "--no-report"]
    assert main(fast) == 0
    first = (out / "results.csv").read_bytes()
    assert main([*fast, "--format", "parquet"]) == 0
    assert main(fast) == 0
    assert (out / "results.csv").read_bytes() == first
    assert not (out / "report.html").exists()
    file.write_text(file.read_text().replace("0.015", "0.03"))
    capsys.readouterr()
    assert main(fast) == 2
    assert "another study is in this folder" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("vary: {cable.length: [1]}\n", "a study needs a cable or a harness"),
        ("cable: {length: 1, linear_density: 0.1, bending_stiffness: 0.1}\nstart: {position: [0, 0, 0]}\nvarry: {}\n",
         "Did you mean 'vary'"),
        ("cable: nowhere.yaml\nstart: {position: [0, 0, 0]}\n", "no such file"),
        ("one: 1\ntwo: 2\n", "none of its keys is known"),
    ],
)  # fmt: skip
def test_a_file_that_is_wrong(tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, words: str) -> None:
    file = tmp_path / "study.yaml"
    file.write_text(text)
    assert main(["study", str(file), "-o", str(tmp_path / "out")]) == 2
    assert words in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_space_and_an_animation(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = fewer(tmp_path)
    assert main(["sweep", file, "-o", str(tmp_path / "out/space.stl"), "--looseness", "0.02"]) == 0
    told = capsys.readouterr().out
    assert re.search(r"space\.stl: Swept\(\d+ triangles, [\d.]+ l, loose by [\d.]+ mm\)", told)
    near = re.findall(r"^  (\w+) +(-?[\d.]+) mm at instant ([\d.]+),  ?at [\d.]+ m|^  (\w+) +out of reach", told, re.M)
    assert len(near) == 5
    assert read_triangles(tmp_path / "out/space.stl")[0].shape[1] == 3
    assert main(["export", file, "-o", str(tmp_path / "out/hose.glb")]) == 0
    assert (tmp_path / "out/hose.glb").read_bytes()[:4] == b"glTF"
    assert main(["export", file, "-o", str(tmp_path / "out/hose.xml"), "--instant", "3"]) == 0
    assert main(["export", file, "-o", str(tmp_path / "out/hose.step")]) == 2
    assert "it must end in" in capsys.readouterr().err


def test_tolerances_and_the_best_point(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "tolerances"
    assert main(["tolerances", str(EXAMPLES / "tolerances.yaml"), "--points", "16", "-o", str(out)]) == 0
    told = capsys.readouterr().out
    assert re.search(r"95 % of 1024 shapes are within [\d.]+ mm", told)
    assert len(re.findall(r"% alone,", told)) == 3 * 5
    page = (out / "report.html").read_text(encoding="utf-8")
    assert page.count("<svg") == 2 + 3
    assert page.count(">exact<") == 3 * 5
    out = tmp_path / "best"
    options = ["--grid", "3", "--starts", "1", "--precision", "0.05", "-o", str(out)]
    assert main(["optimise", str(EXAMPLES / "clips.yaml"), *options]) == 0
    told = capsys.readouterr().out
    assert re.search(r"[\d.]+ % of a limit is used at most, by ", told)
    assert "scene.clips.leg.arc_length" in told
    page = (out / "report.html").read_text(encoding="utf-8")
    assert page.count("<svg") >= 2 + 1
    assert not re.search(r"(?:src|href)=.https?:", page)
