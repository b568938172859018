"""Derivatives of shapes by what holds the cable and by its numbers: against central differences of shapes."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rods import CABLE, END, GENERAL, START, moved

import cable_shape as cs

NUMBERS = ("length", "linear_density", "bending_stiffness", "twisting_stiffness")
TABLE = [(1.0, 0.0, 0.5), (-2.0, 1.0, 0.0), (0.5, 0.5, -1.0)]
WAVY = CABLE.replace(rest_curvature=TABLE)
FREE = cs.FreeEnd(mass=0.02, force=(0.1, 0.0, 0.05), moment=(0.0, 0.01, 0.0))
MASSES = (cs.PointMass(0.31, 0.03), cs.PointMass(0.71, 0.02))
SWING = ((0.0, 0.0, 0.0), (3.0, 0.0, 1.0))
POINTS = 38


def clips_at(cable: cs.Cable, end, *held: tuple[float, str], **options) -> tuple[cs.Clip, ...]:
    """Clips a little beside the shape that the cable has without them."""
    shape = cs.predict(cable, START, end, points=241, **options)
    out = []
    for k, (share, kind) in enumerate(held):
        i = round(240 * share)
        pose = cs.Pose(shape.positions[i], shape.quaternions[i])
        turn = (0.1, -0.05, 0.2) if kind in ("fixed", "hinge") else (0.0, 0.0, 0.0)
        out.append(cs.Clip(float(shape.arc_length[i]), moved(pose, (0.01, 0.02 - 0.01 * k, 0.02), turn), kind))
    return tuple(out)


@cache
def case(name: str) -> tuple[cs.Cable, object, object, cs.Scene, dict[str, object]]:
    """Cable, ends, scene and accelerations."""
    start, end, cable, held, masses, motion = START, END, CABLE, (), (), {}
    match name:
        case "elastic":
            cable = GENERAL
        case "rest table":
            cable = WAVY
        case "pinned":
            start, end = cs.Grip(START, kind="swivel"), cs.Grip(END, kind="pinned")
        case "free":
            end = FREE
        case "masses that are moved":
            cable, masses, motion = GENERAL, MASSES, {"acceleration": SWING}
        case "ball":
            held = ((0.5, "ball"),)
        case "fixed and hinge":
            cable, held = GENERAL, ((0.3, "fixed"), (0.7, "hinge"))
        case "hinge, then free":
            end, held = FREE, ((0.6, "hinge"),)
        case "table in a ball, masses":
            cable, held, masses = WAVY, ((0.4, "ball"),), MASSES
        case "eyelet":
            held = ((0.5, "slide"),)
        case "eyelets and ball":
            cable, held = GENERAL, ((0.3, "slide"), (0.5, "ball"), (0.8, "slide"))
        case "plain":
            pass
        case _:
            raise KeyError(name)
    scene = cs.Scene(masses=masses)
    return cable, start, end, scene.replace(clips=clips_at(cable, end, *held, scene=scene)), motion


NAMES = (
    "plain", "elastic", "rest table", "pinned", "free", "masses that are moved", "ball", "fixed and hinge",
    "hinge, then free", "table in a ball, masses", "eyelet", "eyelets and ball",
)  # fmt: skip


def all_columns(scene: cs.Scene) -> tuple[str, ...]:
    return ("end", *(f"clip:clip{k}" for k in range(len(scene.clips))), "length", "start", *NUMBERS[1:])


def turned(end, twist: np.ndarray):
    """The end, moved by a twist about the cable's end."""
    if isinstance(end, cs.FreeEnd):
        return end
    return moved(end, twist[:3], twist[3:]) if isinstance(end, cs.Pose) else end.at(moved(end.pose, twist[:3], twist[3:]))


def differences(name: str, by: str) -> np.ndarray:
    """(n, 3, 6) or (n, 3, 1)."""
    cable, start, end, scene, motion = case(name)
    predictor = cs.Predictor(cable, points=POINTS, tolerance=1e-9 * cable.length, scene=scene)

    def at(x: np.ndarray) -> np.ndarray:
        near, far, rod = start, end, predictor
        if by == "start":
            near = turned(start, x)
        elif by == "end":
            far = turned(end, x)
        elif by.startswith("clip:clip"):
            k = int(by.removeprefix("clip:clip"))
            clips = list(scene.clips)
            clips[k] = replace(clips[k], pose=moved(clips[k].pose, x[:3], x[3:]))
            predictor.scene = scene.replace(clips=clips)
        else:
            value = getattr(cable, by)
            changed = [v * (1.0 + x[0]) for v in value] if by == "bending_stiffness" else value * (1.0 + x[0])
            rod = cs.Predictor(
                cable.replace(**{by: changed}), points=POINTS, tolerance=1e-9 * cable.length, scene=scene
            )
        shape = rod.predict(near, far, **motion)
        assert shape.status is cs.Status.OK, shape.detail
        return shape.positions

    at(np.zeros(6))
    if by in NUMBERS:
        step = 1e-4 if by == "length" else 1e-3
        value = cable.mean_bending_stiffness if by == "bending_stiffness" else getattr(cable, by)
        return ((at(np.array((step,))) - at(np.array((-step,)))) / (2.0 * step * value))[:, :, None]
    return np.stack([(at(x) - at(-x)) / 4e-4 for x in 2e-4 * np.eye(6)], axis=2)


@pytest.mark.parametrize("name", NAMES)
def test_columns_are_central_differences(name: str) -> None:
    cable, start, end, scene, motion = case(name)
    predictor = cs.Predictor(cable, points=POINTS, tolerance=1e-9 * cable.length, scene=scene)
    assert predictor.predict(start, end, **motion).status is cs.Status.OK
    by = all_columns(scene)
    found = predictor.sensitivity(by)
    assert found.shape == (POINTS, 3, 6 * (2 + len(scene.clips)) + 4)
    first = 0
    for what in by:
        wanted = differences(name, what)
        columns = found[:, :, first : first + wanted.shape[2]]
        first += wanted.shape[2]
        size = max(1.0, np.abs(wanted).max())
        print(name, what, np.abs(wanted).max(), np.abs(columns - wanted).max() / size)
        np.testing.assert_allclose(columns, wanted, rtol=0.0, atol=1e-3 * size, err_msg=what)
