"""What a calibration found of the grips is in the cable's file, and whoever reads that file holds the cable so."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from replays import MOUNTS, TRUE, bag_of, mounted
from scipy.spatial.transform import Rotation

import cable_shape as cs
from cable_shape.command.cli import main
from cable_shape.command.load_case import load_case
from cable_shape.errors import ArgumentError, UnknownKeyError

ROUGH = "length: 1.0\nlinear_density: 0.06\nbending_stiffness: 0.006\n"
FIT = "bending_stiffness,start_offset,start_tilt,end_offset,end_tilt"


@pytest.fixture(scope="module")
def calibrated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a recording, and of the cable.yaml that the command made of it."""
    folder = tmp_path_factory.mktemp("calibrated")
    (folder / "rough.yaml").write_text(ROUGH)
    bag = bag_of(folder / "bag", mounted(3, 8))
    written = ["-o", str(folder / "cable.yaml"), "--uncertainty", str(folder / "known.yaml")]
    assert main(["calibrate", str(bag), "--cable", str(folder / "rough.yaml"), "--fit", FIT, *written]) == 0
    return folder


def test_a_calibration_writes_how_grips_were_held_and_where_the_cable_lies_in_them(calibrated: Path) -> None:
    file = cs.CableFile.from_yaml(calibrated / "cable.yaml")
    assert [held.kind for held in file.held] == ["clamped", "swivel"]
    for held, mount in zip(file.held, MOUNTS, strict=True):
        assert held.correction is not None
        way, angle = held.correction.distance(mount)
        assert way < 3e-4
        assert angle < 5e-3
    assert cs.Cable.from_yaml(calibrated / "cable.yaml") == file.cable
    assert "corrected by 5." in file.describe()
    assert cs.CableFile.from_mapping(json.loads(json.dumps(file.as_dict()))) == file


def test_the_command_tells_the_grips(calibrated: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["calibrate", str(calibrated / "bag"), "--cable", str(calibrated / "rough.yaml"), "--fit", FIT]) == 0
    assert "grips                  start clamped, corrected by 5." in capsys.readouterr().out


def test_the_file_holds_the_cable_as_the_calibration_did(tmp_path: Path) -> None:
    seen = mounted(5, 4)
    found = cs.calibrate(seen, TRUE, FIT.split(","))
    file = cs.CableFile.from_yaml(found.save(tmp_path / "cable.yaml"))
    assert file == found.file
    for one, centreline in zip(seen, found.centrelines, strict=True):
        assert isinstance(one.end, cs.Grip)
        ends = file.start.grip(one.start.pose), file.end.grip(one.end.pose)
        shape = cs.predict(file.cable, *ends, model="cosserat", points=101)
        np.testing.assert_allclose(shape.positions, centreline, rtol=0.0, atol=5e-5)


def test_corrections_go_after_the_offset_of_the_grip_and_kinds_may_be_told() -> None:
    offset, correction = cs.Pose((0.0, 0.0, 0.1), (0.5, 0.5, 0.5, 0.5)), MOUNTS[0]
    pose = cs.Pose((1.0, 2.0, 3.0), Rotation.from_rotvec((0.1, 0.2, 0.3)).as_quat())
    held = cs.Held("swivel", correction=correction)
    grip = held.grip(cs.Grip(pose, "pinned", offset, (0.1, 0.0, 0.0)))
    assert grip.kind == "swivel"
    np.testing.assert_allclose(grip.cable_frame.matrix(), (pose * offset * correction).matrix(), atol=1e-12)
    assert grip.curvature.tolist() == [0.1, 0.0, 0.0]
    assert held.grip(pose).cable_frame.distance(pose * correction) == pytest.approx((0.0, 0.0), abs=1e-9)
    told = held.told("pinned", offset)
    assert told.grip(pose).kind == "pinned"
    assert told.grip(pose).cable_frame.distance(pose * offset * correction) == pytest.approx((0.0, 0.0), abs=1e-9)
    both = held.then(cs.Held("clamped", correction=MOUNTS[1]))
    assert both.kind == "clamped"
    assert both.correction is not None
    assert both.correction.distance(MOUNTS[0] * MOUNTS[1]) == pytest.approx((0.0, 0.0), abs=1e-9)
    same = cs.Grip(pose)
    assert cs.Held().grip(same) is same


def replayed(folder: Path, out: Path, *more: str) -> dict[str, Any]:
    arguments = ["replay", str(folder / "fresh"), "-o", str(out), "--no-rrd", "--no-picture", *more]
    assert main(arguments) == 0
    report: dict[str, Any] = json.loads((out / "report.json").read_text())
    return report


def test_from_a_recording_to_a_replay_in_two_commands(
    calibrated: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The other recording, which was not fitted, is followed to the noise; without the grips of the file it is not."""
    bag_of(calibrated / "fresh", mounted(4, 6))
    known = ["--uncertainty", str(calibrated / "known.yaml")]
    report = replayed(calibrated, tmp_path / "out", "--cable", str(calibrated / "cable.yaml"), *known)
    said = capsys.readouterr()
    assert said.err == ""
    assert "start clamped, corrected by 5." in said.out
    assert "end swivel, corrected by 3." in said.out
    assert report["settings"]["end_kind"] == "swivel"
    assert report["settings"]["start_correction"]["position"] == pytest.approx([0.002, -0.004, 0.003], abs=3e-4)
    assert report["markers"]["frames_compared"] == 6
    assert report["markers"]["mean"] < 3e-4
    assert report["markers"]["distances_with_a_tube"] == 6 * 21
    assert 0.85 < report["markers"]["inside_the_tube"] <= 1.0
    plain = cs.Cable.from_yaml(calibrated / "cable.yaml")
    (tmp_path / "plain.yaml").write_text(yaml.safe_dump(plain.as_dict()))
    without = replayed(calibrated, tmp_path / "out", "--cable", str(tmp_path / "plain.yaml"))
    assert without["settings"]["end_kind"] == "clamped"
    assert without["markers"]["mean"] > 10.0 * report["markers"]["mean"]
    capsys.readouterr()
    file = str(calibrated / "cable.yaml")
    told = replayed(calibrated, tmp_path / "out", "--cable", file, "--end-kind", "pinned")
    assert told["settings"]["end_kind"] == "pinned"
    assert "note: --end-kind pinned: the cable's file was fitted with a swivel end" in capsys.readouterr().err


def test_grippers_that_hold_it_crosswise_are_calibrated_and_replayed_by_the_same_offsets(tmp_path: Path) -> None:
    tool = cs.Pose((0.0, 0.01, 0.1), (0.0, math.sqrt(0.5), 0.0, math.sqrt(0.5)))
    (tmp_path / "rough.yaml").write_text(ROUGH)
    offsets = [word for side in ("start", "end") for word in (f"--{side}-offset", *map(repr, tool.array.tolist()))]
    bag, file = bag_of(tmp_path / "bag", mounted(3, 8), tool), tmp_path / "cable.yaml"
    command = ["calibrate", str(bag), "--cable", str(tmp_path / "rough.yaml"), "--fit", FIT, "-o", str(file), *offsets]
    assert main(command) == 0
    for held, mount in zip(cs.CableFile.from_yaml(file).held, MOUNTS, strict=True):
        assert held.correction is not None
        assert held.correction.distance(mount)[0] < 3e-4
    bag_of(tmp_path / "fresh", mounted(4, 6), tool)
    assert replayed(tmp_path, tmp_path / "out", "--cable", str(file), *offsets)["markers"]["mean"] < 3e-4
    bad = ["--end-offset", *"0000000"]
    assert main([*command, *bad]) == 2


def test_a_case_is_held_as_the_file_of_its_cable_says(calibrated: Path, tmp_path: Path) -> None:
    ends = {
        "start": {"position": [0, 0, 1], "quaternion": [0.5, 0.5, 0.5, 0.5]},
        "end": {"position": [0.7, 0, 1], "quaternion": [0.5, 0.5, 0.5, 0.5], "kind": "clamped"},
    }
    path = tmp_path / "case.yaml"
    path.write_text(yaml.safe_dump({"cable": str(calibrated / "cable.yaml"), **ends}))
    file, case = cs.CableFile.from_yaml(calibrated / "cable.yaml"), load_case(path)
    assert case.cable == file.cable
    assert isinstance(case.end, cs.Grip)
    assert (case.start.kind, case.end.kind) == ("clamped", "clamped")  # the end as the case tells
    for end, held in zip((case.start, case.end), file.held, strict=True):
        assert held.correction is not None
        assert end.cable_frame.distance(end.pose * held.correction) == pytest.approx((0.0, 0.0), abs=1e-9)
    path.write_text(
        yaml.safe_dump({"cable": str(calibrated / "cable.yaml"), "start": ends["start"], "end": {"mass": 0.1}})
    )
    assert isinstance(load_case(path).end, cs.FreeEnd)


def test_what_holds_a_cable_in_a_photograph_or_for_its_sag_is_not_what_holds_it_in_a_cell(tmp_path: Path) -> None:
    (tmp_path / "clicks.csv").write_text(
        "what,u,v,x,y\nstart,100,100\nend,900,100\nknown,100,100,0,0\nknown,900,100,0.8,0\n"
        + "".join(f"point,{100 + 100 * k},{100 + 300 * math.sin(math.pi * k / 8.0):.1f}\n" for k in range(1, 8))
    )
    photo = cs.calibrate_photo(tmp_path / "clicks.csv", TRUE).found
    sag = cs.calibrate_sag(TRUE, 0.9, held="free")
    for found in (photo, sag):
        assert found.grips == (cs.Held(), cs.Held())
        assert "grips:" not in found.yaml()


def test_doctor_tells_the_grips(calibrated: Path, capsys: pytest.CaptureFixture[str]) -> None:
    main(["doctor", "--cable", str(calibrated / "cable.yaml")])
    assert "grips when it was calibrated: start clamped, corrected by 5." in capsys.readouterr().out


def test_another_fit_says_that_it_begins_without_the_corrections(
    calibrated: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["calibrate", str(calibrated / "bag"), "--cable", str(calibrated / "cable.yaml")]) == 0
    assert "corrects its grips: this fit begins without" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("grips", "text"),
    [
        ({"left": {}}, "cable.yaml: grips: unknown key 'left'"),
        ({"end": {"kinds": "swivel"}}, "grips.end: unknown key 'kinds'. Did you mean 'kind'"),
        ({"end": {"kind": "glued"}}, "grips.end: kind = 'glued' is not allowed: it must be one of clamped"),
        ({"start": {"correction": {"place": [0, 0, 0]}}}, "grips.start: correction: unknown key 'place'"),
        ({"start": {"correction": {"quaternion": [0, 0, 0, 2]}}}, "grips.start: quaternion = .* its length is 2"),
        ({"start": [1, 2]}, "grips.start = .* it must be a mapping"),
        ("swivel", "grips = 'swivel' is not allowed: it must be a mapping. Write {start: .., end: ..}"),
    ],
)
def test_a_mistake_in_the_grips_is_named_with_the_file(grips: object, text: str, tmp_path: Path) -> None:
    file = tmp_path / "cable.yaml"
    file.write_text(ROUGH + yaml.safe_dump({"grips": grips}))
    with pytest.raises(ArgumentError, match=text) as caught:
        cs.CableFile.from_yaml(file)
    assert str(file) in str(caught.value)


def test_a_file_without_grips_leaves_them_as_given(tmp_path: Path) -> None:
    for more in ("", "grips:\n", "grips: {start: , end: {}}\n"):
        (tmp_path / "cable.yaml").write_text(ROUGH + more)
        file = cs.CableFile.from_yaml(tmp_path / "cable.yaml")
        assert file.held == (cs.Held(), cs.Held())
        assert file.describe() == ""
    with pytest.raises(UnknownKeyError, match="grip"):
        cs.CableFile.from_mapping({**yaml.safe_load(ROUGH), "grip": {}})
