"""A slow motion comes to the shapes of increments at rest: steps in time or not, one law of friction."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from rivals_laid import CABLE, SCENES, Scene, channelled, rod
from scipy.spatial.transform import Rotation, Slerp

import cable_shape as cs

DT = 0.02  # s


def between(a: cs.Pose, b: cs.Pose, share: float) -> cs.Pose:
    """On the straight way."""
    turn = Slerp((0.0, 1.0), Rotation.from_quat([a.quaternion, b.quaternion]))(share)
    return cs.Pose((1.0 - share) * a.position + share * b.position, turn.as_quat())


def moved(scene: Scene, parts: int, still: int) -> list[cs.CableShape]:
    """All steps of a cable that retardation and drag slow down, each way in so many, and then as many that stay."""
    cable = scene.cable.replace(retardation_time=0.2, drag=0.3)
    motion = cs.Motion(cable, cs.Scene(obstacles=scene.bodies, contact="solve"), points=601)
    assert motion.begin(scene.starts[0], scene.ends[0]).usable
    hands = list(zip(scene.starts, scene.ends, strict=True))
    out = []
    for here, there in pairwise(hands):
        for k in range(1, parts + 1):
            start, end = (between(a, b, k / parts) for a, b in zip(here, there, strict=True))
            out.append(motion.step(start, end, DT))
    return out + [motion.step(*hands[-1], DT) for _ in range(still)]


@pytest.mark.parametrize(("name", "near"), list(zip(SCENES, (5e-3, 1e-3, 1e-3), strict=True)))
def test_a_slow_motion_comes_to_the_shape_of_increments_at_rest(name: str, near: float) -> None:
    scene = SCENES[name]()
    _, rest, _, _ = rod(scene)
    steps = moved(scene, 4, 100)
    assert all(shape.usable for shape in steps)
    assert steps[-1].kinetic_energy < 1e-10
    assert np.linalg.norm(steps[-1].positions - rest.positions, axis=1).max() < near * scene.cable.length


def test_a_stiff_cable_that_is_crammed_into_a_channel_loses_no_step_as_it_moves() -> None:
    steps = moved(channelled()._replace(cable=CABLE), 1, 0)
    assert all(shape.usable for shape in steps)
    assert {contact.body for shape in steps for contact in shape.contacts} == {"floor", "near", "far"}
