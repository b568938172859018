"""Harnesses as they swing: one cable in two, junctions, clips, masses, free ends, energy, what is refused."""

from __future__ import annotations

import numpy as np
import pytest

import cable_shape as cs

ALONG = (0.5, 0.5, 0.5, 0.5)  # d3 along x
ARM = cs.Cable(length=0.5, linear_density=0.1, bending_stiffness=0.01, retardation_time=0.02, drag=0.02)
Y = cs.Harness({"a": ARM, "b": ARM, "c": ARM}, [cs.Junction("j", ("a.end", "b.start", "c.start"))])


def at(x: float, y: float, z: float = 0.0) -> cs.Pose:
    return cs.Pose((x, y, z), ALONG)


def held(y: float, third: bool = True) -> dict[str, cs.Pose]:
    ends = {"a.start": at(0.0, y), "b.end": at(0.8, y, 0.1)}
    return ends | ({"c.end": cs.Pose((0.5, y + 0.4, 0.1))} if third else {})


def energy_of(shape: cs.HarnessShape | cs.CableShape) -> float:
    return shape.energy + shape.kinetic_energy


def test_two_arms_with_a_straight_junction_are_one_cable():
    harness = cs.Harness({"a": ARM, "b": ARM}, [cs.Junction("j", ("a.end", "b.start"))])
    motion, one = cs.Motion(harness, points=31, elements=20), cs.Motion(ARM.replace(length=1.0), points=61, elements=40)
    shape, other = motion.begin({"a.start": at(0.0, 0.0), "b.end": at(0.7, 0.0)}), one.begin(at(0.0, 0.0), at(0.7, 0.0))
    for k in range(1, 101):
        y = 0.1 * np.sin(0.1 * k)
        ends = at(0.0, y), at(0.7, 0.5 * y, 0.3 * y)
        shape, other = motion.step({"a.start": ends[0], "b.end": ends[1]}, 0.01), one.step(*ends, 0.01)
        assert shape.usable, shape.detail
        both = np.concatenate((shape.segments["a"].positions, shape.segments["b"].positions[1:]))
        assert np.abs(both - other.positions).max() < 2e-5
    assert other.velocity is not None
    assert np.abs(other.velocity).max() > 0.3
    assert shape.velocity is not None
    np.testing.assert_allclose(shape.velocity[:31], other.velocity[:31], atol=2e-3)
    assert shape.kinetic_energy == pytest.approx(other.kinetic_energy, rel=1e-3)
    assert shape.work == pytest.approx(other.work, rel=1e-2, abs=1e-5)
    assert shape.dissipated == pytest.approx(other.dissipated, rel=1e-2, abs=1e-5)


@pytest.mark.parametrize("third", [True, False], ids=["held", "free"])
def test_forces_at_a_junction_are_in_balance_and_energy_is_not_made(third: bool):
    motion = cs.Motion(Y, points=31)
    given = energy_of(motion.begin(held(0.0, third)))
    for k in range(1, 151):
        shape = motion.step(held(0.05 * (1.0 - np.cos(0.1 * k)), third), 0.01)
        assert shape.usable, shape.detail
        given += shape.work
        assert energy_of(shape) < given + 1e-6
        a, b, c = (shape.segments[name] for name in "abc")
        assert np.abs(a.force[-1] - b.force[0] - c.force[0]).max() < 1e-9
        assert np.abs(a.moment[-1] - b.moment[0] - c.moment[0]).max() < 1e-3 * np.abs(a.moment[-1]).max() + 1e-6
        assert np.abs(a.positions[-1] - c.positions[0]).max() < 1e-9
        assert shape.lost == pytest.approx(0.0, abs=1e-3)
    assert shape.velocity is not None
    assert np.abs(shape.velocity).max() > 0.1


def test_it_comes_to_rest_where_it_hangs():
    arm = ARM.replace(retardation_time=0.2, drag=0.5)
    harness = cs.Harness(dict.fromkeys("abc", arm), Y.junctions)
    scene = cs.Scene(
        clips=[cs.Clip(0.25, cs.Pose((0.2, 0.0, -0.05), ALONG), "ball", segment="a")],
        masses=[cs.PointMass(0.3, 0.02, segment="b")],
    )
    motion = cs.Motion(harness, scene, points=31)
    motion.begin(held(0.0))
    for k in range(1, 301):
        shape = motion.step(held(0.05 * min(k / 50.0, 1.0)), 0.02)
        assert shape.usable, shape.detail
        assert np.abs(shape.segments["a"].positions[15] - (0.2, 0.0, -0.05)).max() < 1e-9
    still = cs.Predictor(harness, scene=scene, points=31).predict(held(0.05))
    for name in "abc":
        assert np.abs(shape.segments[name].positions - still.segments[name].positions).max() < 1e-4
    np.testing.assert_allclose(shape.clips[0].force, still.clips[0].force, rtol=3e-3, atol=3e-3)
    assert shape.kinetic_energy < 1e-9


def test_out_of_reach_the_state_is_kept():
    one, other = cs.Motion(Y, points=12), cs.Motion(Y, points=12)
    for motion in (one, other):
        motion.begin(held(0.0))
        motion.step(held(0.01), 0.01)
    far = one.step(held(0.0) | {"b.end": at(3.0, 0.0)}, 0.01)
    assert far.status is cs.Status.OVERSTRETCHED
    assert "kept" in far.detail
    back = [motion.step(held(0.02), 0.01) for motion in (one, other)]
    assert back[0].usable
    np.testing.assert_array_equal(back[0].buffer, back[1].buffer)


def test_what_it_refuses():
    with pytest.raises(cs.ArgumentError, match="Call begin first"):
        cs.Motion(Y).step(held(0.0), 0.01)
    motion = cs.Motion(Y, points=12)
    motion.begin(held(0.0))
    with pytest.raises(cs.ArgumentError, match="begin again"):
        motion.step(held(0.0, third=False), 0.01)
    with pytest.raises(cs.ArgumentError, match=r"segment 'a'.*linear_density"):
        cs.Motion(cs.Harness({"a": ARM.replace(linear_density=0.0)}))
    with pytest.raises(cs.ArgumentError, match="contact"):
        cs.Motion(Y, cs.Scene(contact="solve", obstacles=[cs.Obstacle("ball", cs.Sphere(0.1))]))
    with pytest.raises(cs.ArgumentError, match="slide"):
        cs.Motion(Y, cs.Scene(clips=[cs.Clip(0.2, at(0.2, 0.0), "slide", segment="a")]))
