"""Colours of the picture: the cable by how close it is to a limit, bodies and signs by what they are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache, lru_cache

import numpy as np
from scipy.spatial import KDTree

from cable_shape.cable.cable import Cable
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.pose import Pose
from cable_shape.safety.report import WarningKind
from cable_shape.scene.scene import (
    Box,
    Capsule,
    Cylinder,
    HalfSpace,
    HeightField,
    Mesh,
    Obstacle,
    Points,
    Scene,
    Solid,
    Sphere,
)
from cable_shape.shape import CableShape

Colour = tuple[int, int, int, int]

COLOURINGS = ("curvature", "clearance")
#: A cable without a limit of its own is fully red when bent to this many diameters, a usual figure for flexible cable.
DEFAULT_BEND_DIAMETERS = 6.0

#: fraction of the limit used, and the colour there; told apart by people who do not tell red from green, too
SCALE = ((0.0, (38, 198, 218)), (0.5, (255, 213, 79)), (1.0, (244, 54, 76)))
_SHADES = 1024
UNUSABLE: Colour = (150, 150, 158, 255)  # the shape may not be acted on
OBSTACLE: Colour = (202, 138, 74, 255)
FLOOR: Colour = (62, 66, 74, 255)
ROBOT: Colour = (176, 182, 194, 255)
MARKER: Colour = (255, 255, 255, 255)
GOOD: Colour = (129, 212, 160, 255)
AMBER: Colour = (255, 179, 0, 255)
RED: Colour = (255, 64, 80, 255)
TAIL: Colour = (176, 190, 197, 255)
CLIP: Colour = (170, 90, 255, 255)
JUNCTION: Colour = (205, 220, 57, 255)
ROOM: Colour = (255, 255, 255, 28)
FORCE: Colour = (120, 200, 255, 255)
SPEED: Colour = (224, 247, 250, 255)
GHOST: Colour = (255, 120, 220, 110)
TUBE: Colour = (120, 200, 255, 60)
#: of the lines that tell how much of each limit is used
KINDS: dict[WarningKind, Colour] = {
    WarningKind.CLEARANCE: (129, 212, 160, 255),
    WarningKind.OVERSTRETCHED: (176, 182, 194, 255),
    WarningKind.TENSION: (255, 213, 79, 255),
    WarningKind.BEND_RADIUS: (38, 198, 218, 255),
    WarningKind.TWIST_RATE: (186, 147, 255, 255),
    WarningKind.STRESS: (202, 138, 74, 255),
    WarningKind.STABILITY: (240, 98, 146, 255),
    WarningKind.QUASISTATIC: (230, 238, 156, 255),
    WarningKind.CONTACT_FORCE: (255, 138, 101, 255),
    WarningKind.CAUGHT: (255, 82, 140, 255),
}
AXES: tuple[Colour, Colour, Colour] = ((240, 84, 84, 255), (104, 200, 90, 255), (84, 142, 255, 255))


def scale(fraction: Array) -> np.ndarray[tuple[int, int], np.dtype[np.uint8]]:
    """(n, 4) RGBA of fractions (n,) of a limit, clipped to 0..1."""
    return _shades()[np.rint(np.clip(fraction, 0.0, 1.0) * _SHADES).astype(np.intp)]


@cache
def _shades() -> np.ndarray[tuple[int, int], np.dtype[np.uint8]]:
    """More colours than can be told apart."""
    stops = [stop for stop, _ in SCALE]
    at = np.linspace(0.0, 1.0, _SHADES + 1)
    channels = [np.interp(at, stops, [colour[i] for _, colour in SCALE]) for i in range(3)]
    return np.stack((*channels, np.full(len(at), 255.0)), axis=1).round().astype(np.uint8)


def check_colouring(colour: str) -> str:
    """`colour` if it is a way of colouring that exists."""
    if colour not in COLOURINGS:
        raise ArgumentError.of("colour", colour, f"it must be one of {', '.join(COLOURINGS)}", "Choose one of these.")
    return colour


def bend_radius_limit(cable: Cable) -> float:
    """[m], the bend radius that is drawn fully red."""
    return cable.min_bend_radius or DEFAULT_BEND_DIAMETERS * cable.diameter


def by_curvature(cable: Cable, shape: CableShape) -> Array:
    """(n,) bending curvature as a fraction of what the smallest bend radius allows."""
    bending = np.hypot(shape.curvature[:, 0], shape.curvature[:, 1])
    return bending * bend_radius_limit(cable)


def by_clearance(
    cable: Cable, shape: CableShape, scene: Scene, links: Sequence[Obstacle], at: Mapping[str, Pose] | None
) -> Array:
    """(n,) 0 at three times the warning distance from all bodies but meshes, 1 at the error distance and below.

    Solids of the robot that near to an end of the cable belong to the gripper there, and count as absent; so does a
    link whose pose is not known.
    """
    far = 3.0 * scene.warn_distance
    nearest = np.full(shape.points, np.inf)
    for body in scene.obstacles:
        nearest = np.minimum(nearest, surface_distance(body.solid, body.pose, shape.positions))
    for body in links:
        pose = None if at is None or body.link is None else at.get(body.link)
        if pose is not None:
            away = surface_distance(body.solid, pose * body.pose, shape.positions)
            if min(away[0], away[-1]) > far:
                nearest = np.minimum(nearest, away)
    span = max(far - scene.error_distance, 1e-9)
    return np.clip((far - (nearest - 0.5 * cable.diameter)) / span, 0.0, 1.0)


def surface_distance(solid: Solid, pose: Pose, points: Array) -> Array:
    """(n,) [m] signed distance of points (n, 3), world, to the surface of a solid; infinite for a mesh."""
    matrix = pose.matrix()
    local = (points - matrix[:3, 3]) @ matrix[:3, :3]
    if isinstance(solid, Sphere):
        return np.asarray(np.linalg.norm(local, axis=1) - solid.radius)
    if isinstance(solid, HalfSpace):
        return np.asarray(local[:, 2])
    if isinstance(solid, Capsule):
        half = 0.5 * solid.length
        local[:, 2] -= np.clip(local[:, 2], -half, half)
        return np.asarray(np.linalg.norm(local, axis=1) - solid.radius)
    if isinstance(solid, (Points, HeightField)):
        return np.asarray(_centres(solid).query(local)[0] - solid.radius)
    if isinstance(solid, Mesh):
        return np.full(len(points), np.inf)
    if isinstance(solid, Box):
        beyond = np.abs(local) - 0.5 * solid.size
    else:
        beyond = _beyond_cylinder(solid, local)
    outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=1)
    return np.asarray(outside + np.minimum(beyond.max(axis=1), 0.0))


@lru_cache(maxsize=16)
def _centres(solid: Points | HeightField) -> KDTree:
    """The centres of its spheres."""
    return KDTree(solid.centres)


def _beyond_cylinder(solid: Cylinder, local: Array) -> Array:
    """(n, 2) how far points are beyond the mantle and beyond the flat ends."""
    radial = np.hypot(local[:, 0], local[:, 1]) - solid.radius
    return np.stack((radial, np.abs(local[:, 2]) - 0.5 * solid.length), axis=1)


def of_distance(distance: float, scene: Scene) -> Colour:
    """Red below the error distance, amber below the warning distance, else green."""
    if distance < scene.error_distance:
        return RED
    return AMBER if distance < scene.warn_distance else GOOD
