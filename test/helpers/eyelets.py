"""Cables that run through eyelets and rest on bodies: seeded motions; and one that is led by its end."""

from __future__ import annotations

import numpy as np
from scene_contact import sway

import cable_shape as cs
from cable_shape.scene.scene import Solid

ALONG_X = (0.5, 0.5, 0.5, 0.5)
SIDEWAYS = cs.Pose((0, 0, 0), (np.sqrt(0.5), 0, 0, np.sqrt(0.5)))  # z along -y

Step = tuple[cs.Scene, cs.Pose, cs.Pose]

CABLE = cs.Cable(length=1.2, linear_density=0.05, bending_stiffness=0.01, diameter=0.008)
FROM, PLACE = cs.Pose((0.0, 0.0, 0.0), ALONG_X), (0.4, 0.02, 0.38)


def at(x: float, y: float = 0.0, z: float = 0.0) -> cs.Pose:
    """Where the end is."""
    return cs.Pose((0.8 + x, y, z), ALONG_X)


def eyelet(friction: float, place=PLACE, retraction: float = 0.0, **others) -> cs.Scene:
    """A scene with one eyelet, e."""
    clip = cs.Clip(0.6, cs.Pose(place), "slide", "e", friction=friction, retraction=retraction)
    return cs.Scene(clips=[clip], **others)


def led(scene: cs.Scene, ways, cable: cs.Cable = CABLE, **options) -> tuple[cs.Predictor, list[cs.CableShape]]:
    """The shapes as the end goes these ways, and what has predicted them."""
    predictor = cs.Predictor(cable, scene=scene, model="cosserat", points=121, **{"tolerance": 1e-8, **options})
    return predictor, [predictor.predict(FROM, at(x)) for x in ways]


def limit(mu: float, before: np.ndarray, force: np.ndarray, tangent: np.ndarray) -> float:
    """[N], what an eyelet holds that acts on the cable with a force; before: the cable's own force there."""
    after = before - force
    turn = np.arccos(np.clip(before @ after / (np.linalg.norm(before) * np.linalg.norm(after)), -1.0, 1.0))
    across = np.linalg.norm(force - (force @ tangent) * tangent)
    return float(across * np.sinh(0.5 * mu * turn) / np.sin(0.5 * turn))


def at_eyelet(shape: cs.CableShape, load, weight: float) -> tuple[np.ndarray, np.ndarray]:
    """The cable's force just before an eyelet, and its tangent there, from a shape's points."""
    k = int(np.searchsorted(shape.arc_length, load.arc_length)) - 1
    before = shape.force[k] + np.array((0.0, 0.0, weight)) * (load.arc_length - shape.arc_length[k])
    tangent = np.array([np.interp(load.arc_length, shape.arc_length, x) for x in shape.tangents.T])
    return before, tangent / np.linalg.norm(tangent)


def motions(steps: int, seed: int) -> dict[str, list[Step]]:
    """Scenes with clips that move, and ends that do, smooth and the same every time."""
    rng = np.random.default_rng(seed)
    t = np.linspace(0.0, 1.0, steps)

    def motion(solid: Solid, pose: cs.Pose, height: float, way: tuple, *clips: tuple) -> list[Step]:
        """clips: arc length, start, way, kind; the ends go from `height` by `way`."""
        body = cs.Obstacle("body", solid, pose)
        start = np.array((0, 0, height)) + t[:, None] * np.array(way) + sway(rng, steps, 0.01)
        end = np.array((0.8, 0, height)) + t[:, None] * np.array(way) + sway(rng, steps, 0.01)
        places = [np.array(at) + t[:, None] * np.array(go) + sway(rng, steps, 0.005) for _, at, go, _ in clips]
        out = []
        for k in range(steps):
            held = [
                cs.Clip(arc, cs.Pose(place[k], ALONG_X), kind)
                for (arc, _, _, kind), place in zip(clips, places, strict=True)
            ]
            scene = cs.Scene(obstacles=[body], clips=held, contact="solve")
            out.append((scene, cs.Pose(start[k], ALONG_X), cs.Pose(end[k], ALONG_X)))
        return out

    bar = cs.Pose((0.55, 0, 0.05)) * SIDEWAYS
    return {
        "lowered on a table": motion(
            cs.HalfSpace(), cs.Pose(), 0.3, (0, 0, -0.1), (0.5, (0.35, 0.05, 0.3), (0, 0, -0.2), "slide")
        ),
        "drawn along a table": motion(
            cs.HalfSpace(), cs.Pose(), 0.25, (0, 0, 0), (0.5, (0.35, 0.05, 0.1), (0.15, 0, 0), "slide")
        ),
        "two eyelets": motion(
            cs.HalfSpace(), cs.Pose(), 0.28, (0, 0, -0.08),
            (0.4, (0.3, 0.03, 0.25), (0, 0, -0.17), "slide"), (0.8, (0.55, -0.03, 0.25), (0, 0, -0.1), "slide"),
        ),
        "an eyelet and a clip": motion(
            cs.HalfSpace(), cs.Pose(), 0.28, (0, 0, -0.05),
            (0.4, (0.3, 0.03, 0.25), (0, 0, -0.15), "slide"), (0.8, (0.55, -0.03, 0.25), (0, 0, -0.1), "ball"),
        ),
        "over the edge of a box": motion(
            cs.Box((0.2, 0.6, 0.2)), cs.Pose((0.5, 0, 0)), 0.45, (0, 0, -0.12),
            (0.35, (0.2, 0.03, 0.3), (0.03, 0, -0.05), "slide"),
        ),
        "over a bar": motion(
            cs.Cylinder(0.06, 0.6), bar, 0.4, (0.05, 0, -0.15), (0.35, (0.25, 0.03, 0.3), (0, 0, -0.1), "slide")
        ),
    }  # fmt: skip
