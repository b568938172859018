"""Studies of recordings and of the user's own functions, as commands read them, and what is wrong in them."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest
import yaml
from recordings import ALONG_X, motion, write_bag

from cable_shape.command.cli import main

FILE = {
    "cable": {"length": 1.0, "linear_density": 0.05, "bending_stiffness": 0.02},
    "start": {"position": [0, 0, 0.5], "quaternion": list(ALONG_X)},
    "end": {"position": [0.8, 0, 0.5], "quaternion": list(ALONG_X)},
    "vary": {"cable.length": [1.0, 1.1]},
    "measure": ["lowest"],
    "points": 40,
}
MODULE = """def sag(shape):
    return shape.positions[0, 2] - shape.positions[:, 2].min()

def broken(shape):
    raise ZeroDivisionError("by the user")

NUMBER = 3
"""


def written(folder: Path, **changes: object) -> str:
    """A study's file."""
    file = folder / "study.yaml"
    file.write_text(yaml.safe_dump({**FILE, **changes}))
    return str(file)


def table(out: Path) -> list[dict[str, str]]:
    with (out / "results.csv").open() as file:
        return list(csv.DictReader(file))


def test_a_recording_is_a_motion(tmp_path: Path) -> None:
    write_bag(tmp_path / "bag", motion(12))
    file = written(tmp_path, motion={"bag": "bag", "instants": 6})
    assert main(["study", file, "-o", str(tmp_path / "out"), "--workers", "1", "--no-report"]) == 0
    assert [row["instants"] for row in table(tmp_path / "out")] == ["6", "6"]
    assert main(["export", file, "-o", str(tmp_path / "cable.csv")]) == 0


@pytest.mark.parametrize("workers", ["1", "2"])
def test_a_function_of_the_users(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, workers: str) -> None:
    (tmp_path / "my_measures.py").write_text(MODULE)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    file = written(tmp_path, measure=["lowest", {"measure": "sag", "limit": 0.3}], chunk=1)
    options = ["--function", "sag=my_measures:sag", "--workers", workers, "--no-report"]
    assert main(["study", file, "-o", str(tmp_path / "out"), *options]) == 0
    for row in table(tmp_path / "out"):
        assert float(row["sag"]) == pytest.approx(0.5 - float(row["lowest"]))


@pytest.mark.parametrize(
    ("told", "words"),
    [
        ("sag", "it must be NAME=MODULE:FUNCTION"),
        ("sag=my_measures", "it must be NAME=MODULE:FUNCTION"),
        ("sag=no_such_module:sag", "cannot be imported here (ModuleNotFoundError"),
        ("sag=my_measures:sags", "has no function sags; it has sag, broken"),
        ("sag=my_measures:NUMBER", "has no function NUMBER"),
    ],
)
def test_what_is_no_function(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, told: str, words: str
) -> None:
    (tmp_path / "my_measures.py").write_text(MODULE)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    file = written(tmp_path, measure=["sag"])
    assert main(["study", file, "-o", str(tmp_path / "out"), "--function", told]) == 2
    assert words in capsys.readouterr().err


def test_a_function_that_is_not_named_is_not_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["study", written(tmp_path, measure=["sag"]), "-o", str(tmp_path / "out")]) == 2
    assert "measure[0] = 'sag'" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"motion": {"bag": "nowhere"}}, "nowhere"),
        ({"motion": {"bag": "bag", "end": []}}, "a recording tells the whole motion, and end too"),
        ({"motion": {"bag": "bag", "topic": {}}}, "a recording tells the whole motion, and topic too"),
        ({"vary": {"cable.length": {"from": 2.0, "to": 1.0, "step": 0.1}}}, "the range is empty"),
        ({"vary": {"cable.length": []}}, "at least one number"),
        ({"vary": {"cable.lenght": [1.0]}}, "Did you mean 'length'"),
        ({"vary": {"cabel.length": [1.0]}}, "no part of a study"),
        ({"measures": ["tension"]}, "Did you mean 'measure'"),
        ({"sample": {"kind": "sobel"}}, "sobol"),
    ],
)
def test_what_is_wrong_is_told_with_its_remedy(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], changes: dict[str, object], words: str
) -> None:
    write_bag(tmp_path / "bag", motion(3))
    assert main(["study", written(tmp_path, **changes), "-o", str(tmp_path / "out"), "--workers", "1"]) == 2
    assert words in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_no_cluster_loses_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("distributed")
    file, out = written(tmp_path, chunk=1), tmp_path / "out"
    assert main(["study", file, "-o", str(out), "--workers", "1", "--no-report"]) == 0
    kept = {chunk: chunk.read_bytes() for chunk in (out / "chunks").iterdir()}
    next(iter(kept)).unlink()
    capsys.readouterr()
    assert main(["study", file, "-o", str(out), "--scheduler", "tcp://127.0.0.1:9", "--no-report"]) == 2
    assert "no cluster answers there" in capsys.readouterr().err
    assert len(list((out / "chunks").iterdir())) == len(kept) - 1
