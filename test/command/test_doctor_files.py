"""What the doctor says of a cable, a scene and a robot."""

from __future__ import annotations

from pathlib import Path

import pytest

from cable_shape.command.doctor_files import examine_files

CONFIG = Path(__file__).resolve().parents[2] / "config"
CABLE = {"length": 1.0, "linear_density": 0.1, "bending_stiffness": 0.01, "diameter": 0.008}


def remedies(tmp_path: Path, **changes: float) -> list[str]:
    file = tmp_path / "cable.yaml"
    file.write_text("".join(f"{key}: {value}\n" for key, value in {**CABLE, **changes}.items()))
    return [f"{finding.found} {finding.remedy}" for finding in examine_files(file, None, None) if finding.remedy]


def test_all_files_that_come_along_are_well() -> None:
    robot = CONFIG / "robots" / "dual_arm.yaml"
    for cable in (CONFIG / "cables").glob("*.yaml"):
        if cable.name != "three.yaml":  # several cables, for the node
            assert [f for f in examine_files(cable, None, None) if f.remedy] == []
    for scene in (CONFIG / "scenes").glob("*.yaml"):
        assert [f for f in examine_files(None, scene, robot) if f.remedy] == []


def test_a_harness_is_told_segment_by_segment(tmp_path: Path) -> None:
    held, *segments = examine_files(None, None, None, CONFIG / "harnesses" / "demo.yaml")
    assert held.found == "3 segments, held: trunk.start clamped, branch.end clamped"
    assert [finding.subject for finding in segments] == [f"demo.yaml: {n}" for n in ("trunk", "branch", "connector")]
    assert not any(finding.remedy for finding in segments)
    file = tmp_path / "h.yaml"
    file.write_text("segments: {a: {length: 600.0, linear_density: 0.1, bending_stiffness: 0.01}}\nends: {b.end: {}}\n")
    (finding,) = examine_files(None, None, None, file)
    assert "unknown key 'b.end'" in finding.remedy
    file.write_text("segments: {a: {length: 600.0, linear_density: 0.1, bending_stiffness: 0.01}}\n")
    assert ["in mm?" in finding.remedy for finding in examine_files(None, None, None, file)] == [False, False, True]


def test_a_cable_is_told_in_plain_words(tmp_path: Path) -> None:
    (tmp_path / "cable.yaml").write_text("length: 1.0\nlinear_density: 0.1\nbending_stiffness: 3.6\ndiameter: 0.02\n")
    (finding,) = examine_files(tmp_path / "cable.yaml", None, None)
    sag = 0.1 * 9.80665 / (8 * 3.6)
    assert f"a metre of it held level at one end would sag {sag * 1e3:.3g} mm" in finding.found


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"length": 1000.0}, "length = 1000 m is no length between two grippers"),
        ({"linear_density": 100.0}, "make 1.99e+06 kg/m^3, water has 1000"),
        ({"diameter": 8.0}, "make 0.00199 kg/m^3"),
        ({"bending_stiffness": 1e4}, "make a modulus of 4.97e+13 Pa, steel has 2.1e11: is it a pipe?"),
    ],
)
def test_slips_of_units_are_named_with_the_remedy(tmp_path: Path, changes: dict[str, float], text: str) -> None:
    (found,) = remedies(tmp_path, **changes)
    assert text in found
    assert "Everything is in SI units" in found


def test_a_scene_in_millimetres_and_files_that_cannot_be_used(tmp_path: Path) -> None:
    (tmp_path / "scene.yaml").write_text("obstacles: [{name: post, sphere: 0.1, position: [500, 0, 0]}]\n")
    (tmp_path / "robot.yaml").write_text("urdf: nowhere.urdf\ngrippers: {}\n")
    scene, robot = (
        [f for f in examine_files(None, s, r) if f.remedy]
        for s, r in ((tmp_path / "scene.yaml", None), (None, tmp_path / "robot.yaml"))
    )
    assert "obstacle 'post' lies 500 m away" in scene[0].found
    assert robot[0].found == "cannot be used"
    assert "nowhere.urdf" in robot[0].remedy or "grippers" in robot[0].remedy
