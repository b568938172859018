"""How the margins of a batch change with the grips, against differences of batches and of warm predictions."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import cable_shape as cs
from cable_shape.planning.row_judge import RowJudge
from cable_shape.safety.report import LOAD_MARGINS

CABLE = cs.Cable(
    length=1.0,
    linear_density=0.05,
    bending_stiffness=0.005,
    diameter=0.008,
    min_bend_radius=0.05,
    max_tension=5.0,
    max_twist_rate=6.0,
)
ALONG_X = Rotation.from_quat((0.5, 0.5, 0.5, 0.5))
POST = cs.Obstacle("post", cs.Capsule(0.03, 0.4), cs.Pose((0.45, 0.12, 0.35)))
TABLE = cs.Obstacle("table", cs.Box((2.0, 2.0, 0.1)), cs.Pose((0.4, 0.0, 0.3)))
CLIP = cs.Clip(0.5, cs.Pose((0.4, 0.0, 0.4)), "ball")
STABILITY = [kind.name for kind in LOAD_MARGINS].index("STABILITY")


def pose(x: float, y: float, z: float, *turn: float) -> np.ndarray:
    return np.array((x, y, z, *(Rotation.from_rotvec(turn) * ALONG_X).as_quat()))


START, END = pose(0.0, 0.0, 0.5, 0.1, 0.2, 0.3), pose(0.8, 0.05, 0.45, 0.2, -0.1, 0.1)


def moved(row: np.ndarray, part: int, by: float) -> np.ndarray:
    """Shifted along a world axis, or turned about it."""
    out, way = row.copy(), np.zeros(3)
    way[part % 3] = by
    if part < 3:
        out[:3] += way
    else:
        out[3:] = (Rotation.from_rotvec(way) * Rotation.from_quat(row[3:])).as_quat()
    return out


def beside(column: int, by: float) -> tuple[np.ndarray, np.ndarray]:
    return (moved(START, column, by), END) if column < 6 else (START, moved(END, column - 6, by))


@pytest.mark.parametrize("clips", [(), (CLIP,)])
@pytest.mark.parametrize("kind", ["clamped", "swivel"])
def test_free_and_in_clips_they_are_those_of_the_batch(clips: tuple[cs.Clip, ...], kind: str) -> None:
    scene, h = cs.Scene([POST], clips=clips, warn_distance=0.3), 1e-4
    options = {"model": "cosserat", "scene": scene, "tolerance": 1e-7, "end_kind": kind}
    batch = cs.predict_batch(CABLE, START[None], END[None], slopes=True, **options)
    sides = [[beside(column, sign * h) for column in range(12)] for sign in (1.0, -1.0)]
    used = [cs.predict_batch(CABLE, *map(np.array, zip(*ends, strict=True)), **options).used for ends in sides]
    expected = (used[0] - used[1]).T / (2.0 * h)
    told = ~np.isnan(batch.used[0])
    told[STABILITY] = False
    assert told.sum() == 5
    assert batch.slopes is not None
    assert batch.slopes[0, told] == pytest.approx(expected[told], abs=2e-5)
    assert np.abs(expected[told]).max() > 0.5
    assert np.isnan(batch.slopes[0, STABILITY]).all()


def test_on_a_table_they_are_those_of_the_cable_led_there() -> None:
    """In contact a shape is only as exact as its contacts: of differences over several steps the middle one counts."""
    scene = cs.Scene([POST, TABLE], contact="solve", warn_distance=0.3, allow=[cs.Allow("table")])
    options = {"model": "cosserat", "scene": scene, "tolerance": 1e-5}
    batch = cs.predict_batch(CABLE, START[None], END[None], slopes=True, **options)
    assert batch[0].contacts
    assert batch.slopes is not None
    judge, steps = RowJudge(CABLE, scene), (1e-4, 3e-4, 5e-4, 7e-4, 1e-3)
    found = np.empty((len(steps), *batch.slopes[0].shape))
    here = tuple(cs.Grip(cs.Pose(row[:3], row[3:])) for row in (START, END))
    for (k, h), column in product(enumerate(steps), range(12)):
        used = []
        for sign in (1.0, -1.0):
            predictor = cs.Predictor(CABLE, **options)
            predictor.begin(batch[0], here, None)
            predictor.look_again()
            predictor.predict(*here)
            shape = predictor.predict(*(cs.Pose(row[:3], row[3:]) for row in beside(column, sign * h)))
            used.append(judge.margins_of(shape, judge.checker.check(shape), held=True)[:, 0])
        found[k, :, column] = (used[0] - used[1]) / (2.0 * h)
    expected = np.median(found, axis=0)
    told = ~np.isnan(batch.used[0])
    told[STABILITY] = False
    assert told.sum() == 5
    assert np.abs(expected[told]).max() > 0.5
    scatter = np.median(np.abs(found - expected), axis=0)[told]  # of the reference
    large = np.maximum(np.abs(expected[told]).max(axis=1, keepdims=True), 0.5)
    assert (scatter < 0.03 * large).all()
    assert (np.abs(batch.slopes[0, told] - expected[told]) < 0.01 * large + 3.0 * scatter).all()
    assert np.isnan(batch.slopes[0, -1]).all()  # the table may be touched


def test_a_free_end_has_none_and_what_is_not_of_one_rod_is_refused() -> None:
    free = cs.predict_batch(CABLE, START[None], cs.FreeEnd(mass=0.1), slopes=True, model="cosserat")
    assert free.slopes is not None
    assert (free.slopes[0, 2, 6:] == 0.0).all()
    assert np.abs(free.slopes[0, 2, :6]).max() > 0.0
    assert cs.predict_batch(CABLE, START[None], END[None]).slopes is None
    for cable, starts, model in ((CABLE, START[None], "catenary"), ({"a": CABLE}, {"a": (START[None], None)}, "auto")):
        more = {"ends": END[None]} if cable is CABLE else {}
        with pytest.raises(cs.ArgumentError, match=r"slopes = True .* one cable, by the rod"):
            cs.predict_batch(cable, starts, slopes=True, model=model, **more)
