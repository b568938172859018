"""predict_batch where each row has a scene of its own, and where contact is meant."""

from __future__ import annotations

import numpy as np
import pytest
from rods import CABLE

import cable_shape as cs
from cable_shape.safety.report import LOAD_MARGINS

ALONG_X = (0.5, 0.5, 0.5, 0.5)
HELD = CABLE.replace(length=1.0, diameter=0.008)
POST = cs.Obstacle("post", cs.Capsule(0.03, 0.4), cs.Pose((0.4, 0.15, 0.4)))
FIELDS = ("buffer", "status", "tables", "margin_rows")


def held(rows: int, z: float = 0.5) -> tuple[np.ndarray, np.ndarray]:
    """As many grasps, a little apart."""
    starts = np.tile((0.0, 0.0, z, *ALONG_X), (rows, 1))
    ends = np.tile((0.8, 0.0, z, *ALONG_X), (rows, 1))
    ends[:, 1] = np.linspace(-0.05, 0.05, rows)
    return starts, ends


def clipped(y: float) -> cs.Scene:
    return cs.Scene([POST], clips=[cs.Clip(0.5, cs.Pose((0.4, y, 0.4)), "ball")])


def test_each_row_is_what_it_is_in_its_own_scene_alone() -> None:
    """Which of many places is good for a clip? To the bit, in whatever order scenes and rows come."""
    scenes = [clipped(y) for y in np.linspace(-0.1, 0.1, 7)]
    starts, ends = held(7)
    batch = cs.predict_batch(HELD, starts, ends, model="cosserat", scene=scenes)
    assert batch.usable.all()
    assert not batch.partial
    assert batch.loads.shape[1] == 3
    for row, scene in enumerate(scenes):
        alone = cs.predict_batch(HELD, starts[row : row + 1], ends[row : row + 1], model="cosserat", scene=scene)
        for name in FIELDS:
            assert np.array_equal(getattr(batch, name)[row], getattr(alone, name)[0], equal_nan=True), (row, name)
        there = [np.interp(0.5, batch.arc_length, x) for x in batch.positions[row].T]
        assert there == pytest.approx(scene.clips[0].pose.position, abs=2e-4)
    near = np.nan_to_num(batch.used[:, -1], nan=-1.0)  # beyond the horizon at first
    assert (np.diff(near) >= 0.0).all()
    assert near[-1] > 1.0 > near[0]
    assert batch.several.shape == (7,)
    back = cs.predict_batch(HELD, starts[::-1], ends[::-1], model="cosserat", scene=scenes[::-1], threads=1)
    assert np.array_equal(back.buffer, batch.buffer[::-1])


def test_rows_of_one_scene_are_solved_together() -> None:
    starts, ends = held(6)
    one, other = clipped(0.0), clipped(0.05)
    mixed = cs.predict_batch(HELD, starts, ends, model="cosserat", scene=[one, other, one, other, one, one])
    for rows, scene in (([0, 2, 4, 5], one), ([1, 3], other)):
        alone = cs.predict_batch(HELD, starts[rows], ends[rows], model="cosserat", scene=scene)
        assert np.array_equal(mixed.buffer[rows], alone.buffer)


def test_a_row_that_is_not_valid_fails_by_itself_in_its_scene() -> None:
    starts, ends = held(3)
    starts[1, 0] = np.nan
    batch = cs.predict_batch(HELD, starts, ends, model="cosserat", scene=[clipped(0.0), clipped(0.01), clipped(0.02)])
    assert list(batch.errors) == [1]
    assert batch.done.tolist() == [True, False, True]
    assert not batch.partial


def test_scenes_that_cannot_be_stacked_are_named() -> None:
    starts, ends = held(2)
    other = clipped(0.0).replace(obstacles=[])
    for scenes, said in (
        ([clipped(0.0)], r"1 scenes.*one a row, and there are 2"),
        ([clipped(0.0), other], r"scene\[1\].*bodies"),
        ([clipped(0.0), clipped(0.0).replace(clips=[])], r"scene\[1\].*number of clips"),
        ([clipped(0.0), 1], r"scene\[1\] = 1 .*Scene"),
    ):
        with pytest.raises(cs.ArgumentError, match=said):
            cs.predict_batch(HELD, starts, ends, model="cosserat", scene=scenes)
    with pytest.raises(cs.ArgumentError, match="one cable only"):
        cs.predict_batch({"a": HELD}, {"a": (starts, ends)}, scene=[other, other])


@pytest.mark.parametrize("contact", ["solve", "warn"])
def test_contact_that_is_meant_uses_no_clearance(contact: str) -> None:
    """The post is allowed where the cable is near it; on the rest of the cable it is as far as that is."""
    starts, ends = held(5)
    scene = cs.Scene([POST], contact=contact, warn_distance=0.3)
    meant = cs.predict_batch(HELD, starts, ends, model="cosserat", scene=scene.replace(allow=[cs.Allow("post")]))
    bare = cs.predict_batch(HELD, starts, ends, model="cosserat", scene=scene)
    assert (bare.used[:, -1] > 0.9).all()
    assert np.isnan(meant.used[:, -1]).all()
    assert np.array_equal(meant.distances, bare.distances)
    loads = slice(0, len(LOAD_MARGINS))
    assert np.array_equal(meant.used[:, loads], bare.used[:, loads], equal_nan=True)
    part = scene.replace(allow=[cs.Allow("post", 0.3, 0.7)])
    some = cs.predict_batch(HELD, starts, ends, model="cosserat", scene=part)
    assert (some.used[:, -1] < bare.used[:, -1]).all()
    assert (some.used[:, -1] > 0.0).all()


def test_the_force_of_a_body_uses_what_it_may() -> None:
    table = cs.Obstacle("table", cs.Box((2.0, 2.0, 0.1)), cs.Pose((0.4, 0.0, 0.3)))
    starts, ends = held(3, z=0.42)
    for most, too_much in ((2.0, False), (0.2, True)):
        scene = cs.Scene([table], contact="solve", allow=[cs.Allow("table", max_force=most)])
        batch = cs.predict_batch(HELD, starts, ends, model="cosserat", scene=scene)
        for row, shape in enumerate(batch):
            force = sum(contact.force for contact in shape.contacts)
            assert batch.used[row, -1] == pytest.approx(max(2.0, force / most) if too_much else force / most, rel=2e-3)
        assert ((batch.used[:, -1] >= 1.0) == too_much).all()
