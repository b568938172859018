"""What `cable-shape doctor` says of cable, harness, scene and robot: slips of units, and files that cannot be used."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from cable_shape.cable.cable_file import CableFile
from cable_shape.command.doctor import Finding
from cable_shape.command.units import slips_in, slips_of
from cable_shape.cycle.harness_ends import HarnessFile
from cable_shape.errors import CableShapeError
from cable_shape.pose import Grip
from cable_shape.robots.robot import Robot
from cable_shape.scene.scene import Scene


def examine_files(
    cable: Path | None, scene: Path | None, robot: Path | None, harness: Path | None = None
) -> list[Finding]:
    """Findings for the files that are given."""
    checks: tuple[tuple[Path | None, Callable[[Path], list[Finding]]], ...] = (
        (cable, _cable),
        (harness, _harness),
        (scene, _scene),
        (robot, _robot),
    )
    findings = []
    for file, check in checks:
        if file is None:
            continue
        try:
            findings += check(file)
        except CableShapeError as error:
            findings.append(Finding(file.name, "cannot be used", " ".join(str(error).split())))
    return findings


def _cable(file: Path) -> list[Finding]:
    """In plain words, and whether some material could be like that."""
    read = CableFile.from_yaml(file)
    slips = [Finding(file.name, slip.found, slip.remedy) for slip in slips_of(read.cable)]
    grips = read.describe()
    told = [Finding(file.name, f"grips when it was calibrated: {grips}")] if grips else []
    return [Finding(file.name, read.cable.describe()), *told, *slips]


def _harness(file: Path) -> list[Finding]:
    """Its segments in plain words, and which ends grippers are to hold."""
    read = HarnessFile.from_yaml(file)
    held = [f"{end} {grip.kind}" for end, grip in read.ends.items() if isinstance(grip, Grip)]
    grips = ", ".join(held) if read.ends else "all open ends"
    findings = [Finding(file.name, f"{len(read.harness.segments)} segments, held: {grips or 'none'}")]
    for name, cable in read.harness.segments.items():
        findings.append(Finding(f"{file.name}: {name}", cable.describe()))
        findings += [Finding(f"{file.name}: {name}", slip.found, slip.remedy) for slip in slips_of(cable)]
    return findings


def _scene(file: Path) -> list[Finding]:
    scene = Scene.from_yaml(file)
    slips = [Finding(file.name, slip.found, slip.remedy) for slip in slips_in(scene)]
    return [Finding(file.name, f"{len(scene.obstacles)} obstacles, {len(scene.clips)} clips"), *slips]


def _robot(file: Path) -> list[Finding]:
    robot = Robot.from_yaml(file)
    names = sorted({link.link for link in robot.link_geometry if link.link})
    found = f"{len(robot.joint_names)} joints, {len(names)} links with collision geometry"
    if not names:
        return [Finding(file.name, found, "Add <collision> to its links: their clearance is not checked.")]
    return [Finding(file.name, found)]
