"""The cable that is laid into a clip by what a camera sees, and its recording."""

from __future__ import annotations

from pathlib import Path

import pytest
import servo_clip

from cable_shape.robots.robot import Robot

ROBOT = Path(__file__).resolve().parents[2] / "config" / "robots" / "dual_arm.yaml"


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_the_cable_lies_in_the_clip_and_has_touched_nothing(seed: int) -> None:
    laid = servo_clip.lay(Robot.from_yaml(ROBOT), None, seed=seed)
    assert laid.reached
    assert laid.off < 3e-3
    assert laid.clearance > 1e-3
    assert laid.seconds < servo_clip.LONGEST


def test_unseen_it_goes_beside_the_clip_and_the_recording_shows_it(
    tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    recording = tmp_path / "servo.rrd"
    assert servo_clip.main([str(recording), "--open"]) == 1
    assert "mm from its place in the clip" in capsys.readouterr().out
    assert recording.stat().st_size > 10_000
