"""Segments that come back to the junction which they leave: against exact rings and loops, and what cannot close."""

from __future__ import annotations

import math

import numpy as np
import pytest
from harness_random import balance, random_quaternion
from scipy.optimize import brentq
from scipy.special import ellipe, ellipk

import cable_shape as cs

ALONG = (0.0, math.sqrt(0.5), 0.0, math.sqrt(0.5))  # d3 along x
START = cs.Pose((0.0, 0.0, 0.0), ALONG)
STIFF, LENGTH = 0.01, 0.5
STEM = cs.Cable(length=0.3, linear_density=0.05, bending_stiffness=STIFF)


def looped(kind: str = "rigid", frames: dict[str, cs.Pose] | None = None, **more: float) -> cs.Harness:
    """A stem with a loop at its end."""
    loop = STEM.replace(length=more.get("length", LENGTH))
    joint = cs.Junction("j", ("a.end", "loop.start", "loop.end"), kind, frames or {})
    return cs.Harness({"a": STEM, "loop": loop}, [joint])


def test_a_loop_that_goes_on_as_it_comes_is_a_ring_without_twist() -> None:
    """Without weight: of radius L / 2 pi, under a moment of 2 pi EI / L and no force."""
    shape = cs.predict(looped(), {"a.start": START}, gravity=(0.0, 0.0, 0.0), tolerance=1e-9, points=201)
    assert shape.status is cs.Status.OK
    ring = shape.segments["loop"]
    middle = ring.positions[:-1].mean(axis=0)
    np.testing.assert_allclose(np.linalg.norm(ring.positions - middle, axis=1), LENGTH / (2.0 * math.pi), atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(ring.moment, axis=1), 2.0 * math.pi * STIFF / LENGTH, rtol=1e-7)
    assert np.abs(ring.force).max() < 1e-7
    assert np.abs(ring.curvature[:, 2]).max() < 1e-6


def test_a_loop_at_a_ball_is_the_elastica_whose_ends_meet() -> None:
    """Half a figure of eight: 2 E(m) = K(m), pulled together by 4 K^2 EI / L^2."""
    shape = cs.predict(looped("ball"), {"a.start": START}, gravity=(0.0, 0.0, -1e-6), tolerance=1e-9, points=201)
    assert shape.status is cs.Status.OK
    loop = shape.segments["loop"]
    m = brentq(lambda m: 2.0 * ellipe(m) - ellipk(m), 0.5, 0.99)
    np.testing.assert_allclose(np.linalg.norm(loop.force, axis=1), 4.0 * ellipk(m) ** 2 * STIFF / LENGTH**2, rtol=1e-5)
    turned = math.acos(float(loop.tangents[0] @ loop.tangents[-1]))
    assert turned == pytest.approx(2.0 * math.pi - 4.0 * math.asin(math.sqrt(m)), abs=1e-5)


@pytest.mark.parametrize("first", [0, 10, 20])
def test_random_loops_are_found_from_nothing_and_are_in_balance(first: int) -> None:
    for seed in range(first, first + 10):
        rng = np.random.default_rng(seed)
        frames = {end: cs.Pose(quaternion=random_quaternion(rng)) for end in ("loop.start", "loop.end")}
        harness = looped(frames=frames, length=float(rng.uniform(0.2, 0.8)))
        shape = cs.predict(harness, {"a.start": cs.Pose(quaternion=random_quaternion(rng))})
        assert shape.status is cs.Status.OK, f"seed {seed}: {shape.status}"
        force, moment, gap = balance(shape)
        assert force <= 1e-7 + shape.force_error
        assert moment <= 1e-7 + shape.moment_error
        assert gap <= 1e-9


def test_masses_and_clips_may_be_anywhere_on_a_loop() -> None:
    for share in (0.2, 0.33, 0.5):
        masses = cs.Scene(masses=[cs.PointMass(share * LENGTH, 0.01, segment="loop")])
        assert cs.predict(looped(), {"a.start": START}, scene=masses).status is cs.Status.OK
    hook = cs.Clip(0.5 * LENGTH, cs.Pose((0.35, 0.0, 0.16), ALONG), "ball", segment="loop")
    assert cs.predict(looped(), {"a.start": START}, scene=cs.Scene(clips=[hook])).status is cs.Status.OK


def test_a_loop_follows_its_stem_and_answers_it() -> None:
    predictor = cs.Predictor(looped(), tolerance=1e-7)
    for k in range(8):
        shape = predictor.predict({"a.start": cs.Pose((0.0, 0.01 * k, 0.0), ALONG)})
        assert shape.status is cs.Status.OK
    assert shape.iterations <= 6
    columns = predictor.sensitivity()["loop"]
    turned = cs.Pose((0.0, 0.07, 0.0), cs.Pose((0, 0, 0), (1e-4, 0.0, 0.0, 1.0 - 5e-9)).quaternion) * START
    moved = predictor.predict({"a.start": turned}).segments["loop"].positions - shape.segments["loop"].positions
    np.testing.assert_allclose(moved / 2e-4, columns[:, :, 3], atol=2e-3)


# -- what is too short


def beside(x: float, length: float) -> cs.Harness:
    """A loop whose ends are at both sides of a block, 2 x [m] apart."""
    frames = {"loop.start": cs.Pose((x, 0.0, 0.0)), "loop.end": cs.Pose((-x, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0))}
    return looped(frames=frames, length=length)


def test_a_loop_shorter_than_its_ends_are_apart_says_so() -> None:
    shape = cs.predict(beside(0.2, 0.1), {"a.start": START})
    assert shape.status is cs.Status.OVERSTRETCHED
    assert shape.missing_length == pytest.approx(0.3, rel=0.01)
    assert "'loop' most of all" in shape.detail
    assert cs.predict(beside(0.04, 0.5), {"a.start": START}).status is cs.Status.OK


def test_ends_far_beside_their_junction_hang_on_levers_that_hold() -> None:
    """The branch has a moment of its weight about the junction 1.5 m away, and stands still."""
    joint = cs.Junction("j", ("a.end", "b.start"), frames={"b.start": cs.Pose((1.5, 0.0, 0.0))})
    harness = cs.Harness({"a": STEM, "b": STEM}, [joint])
    shape = cs.predict(harness, {"a.start": cs.Pose(quaternion=(1.0, 0.0, 0.0, 0.0))})
    assert shape.status is cs.Status.OK
    assert shape.error_estimate < 1e-5 * STEM.length
    assert max(balance(shape)[:2]) < 1e-7


def test_an_end_absurdly_far_from_its_junction_is_refused() -> None:
    joint = cs.Junction("j", ("a.end", "b.start"), frames={"b.start": cs.Pose((1e6, 0.0, 0.0))})
    with pytest.raises(cs.ArgumentError, match=r"junction 'j': frames\['b.start'\].position .* within 6 m"):
        cs.Harness({"a": STEM, "b": STEM}, [joint])
