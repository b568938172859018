"""What `cable-shape doctor` says of a cable, a scene and a robot: slips of units, and files that cannot be used."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

from cable_shape.cable import Cable
from cable_shape.doctor import Finding
from cable_shape.errors import CableShapeError
from cable_shape.robot import Robot
from cable_shape.scene import Scene

#: kg/m^3, from foam to lead, of the whole section
DENSITIES = (50.0, 12000.0)

#: Pa, steel has 2.1e11: a homogeneous round section of this modulus is stiffer than any cable
STIFFEST = 3e11

#: m, of cables and of the places of obstacles in a cell
LENGTHS = (0.01, 100.0)

CHECK_UNITS = "Everything is in SI units: m, kg/m, N m^2."


def examine_files(cable: Path | None, scene: Path | None, robot: Path | None) -> list[Finding]:
    """Findings for the files that are given."""
    checks: tuple[tuple[Path | None, Callable[[Path], list[Finding]]], ...] = (
        (cable, _cable),
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
    cable = Cable.from_yaml(file)
    findings = [Finding(file.name, cable.describe())]
    low, high = LENGTHS
    if not low <= cable.length <= high:
        findings.append(_slip(file, f"length = {cable.length:g} m is no length between two grippers", "in mm?"))
    outer, inner = cable.diameter, cable.inner_diameter
    area = 0.25 * math.pi * (outer**2 - inner**2)
    if area > 0.0 and cable.linear_density > 0.0:
        density = cable.linear_density / area
        if not DENSITIES[0] <= density <= DENSITIES[1]:
            text = f"linear_density and diameter make {density:.3g} kg/m^3, water has 1000"
            findings.append(_slip(file, text, "linear_density in g/m, or diameter in mm or as a radius?"))
    second_moment = math.pi / 64.0 * (outer**4 - inner**4)
    if second_moment > 0.0:
        modulus = cable.mean_bending_stiffness / second_moment
        if modulus > STIFFEST:
            text = f"bending_stiffness and diameter make a modulus of {modulus:.3g} Pa, steel has 2.1e11: is it a pipe?"
            findings.append(_slip(file, text, "bending_stiffness in N mm^2 (1e-6 N m^2), or diameter in another unit?"))
    return findings


def _scene(file: Path) -> list[Finding]:
    scene = Scene.from_yaml(file)
    findings = [Finding(file.name, f"{len(scene.obstacles)} obstacles, {len(scene.clips)} clips")]
    for obstacle in scene.obstacles:
        far = float(abs(obstacle.pose.position).max())
        if far > LENGTHS[1]:
            findings.append(_slip(file, f"obstacle {obstacle.name!r} lies {far:g} m away", "its position in mm?"))
    return findings


def _robot(file: Path) -> list[Finding]:
    robot = Robot.from_yaml(file)
    names = sorted({link.link for link in robot.link_geometry if link.link})
    found = f"{len(robot.joint_names)} joints, {len(names)} links with collision geometry"
    if not names:
        return [Finding(file.name, found, "Add <collision> to its links: their clearance is not checked.")]
    return [Finding(file.name, found)]


def _slip(file: Path, found: str, guess: str) -> Finding:
    return Finding(file.name, found, f"{CHECK_UNITS} Was it given {guess}")
