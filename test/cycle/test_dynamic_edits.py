"""Edits of cycles of cables and harnesses that swing: they go on from where they are, with their velocity."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import cable_shape as cs

ALONG = (0.5, 0.5, 0.5, 0.5)
MS = 1_000_000  # ns
CABLE = cs.Cable(
    length=1.0, linear_density=0.1, bending_stiffness=0.01, retardation_time=0.05, drag=0.1, diameter=0.01,
    tails={"end": 0.1},
)  # fmt: skip
ARM = cs.Cable(length=0.5, linear_density=0.08, bending_stiffness=0.01, retardation_time=0.05, drag=0.1)
FORK = cs.Harness({"a": ARM, "b": ARM, "c": ARM}, [cs.Junction("fork", ("a.end", "b.start", "c.start"))])
BOX = cs.Obstacle("box", cs.Box((0.1, 0.1, 0.1)), cs.Pose((3.0, 3.0, 3.0)))


def grips(k: int) -> tuple[cs.Pose, cs.Pose]:
    """Both go 0.3 m sideways in 0.3 s, and stop."""
    x = min(max(k / 30.0, 0.0), 1.0)
    y = 0.3 * x * x * (3.0 - 2.0 * x)
    return cs.Pose((0.0, y, 1.0), ALONG), cs.Pose((0.7, y, 1.0), ALONG)


class Going:
    """A cycle that is fed every 10 ms."""

    def __init__(self, harness: bool = False, scene: cs.Scene | None = None, cable: cs.Cable = CABLE) -> None:
        self.cycle = cs.Cycle({"h": FORK} if harness else cable, scene=scene, motion="dynamic", points=41)
        self.harness, self.k, self.open = harness, 0, False

    def held(self) -> Any:
        start, end = grips(self.k)
        if self.harness:
            return {"h": {"a.start": start, "b.end": end, "c.end": cs.FreeEnd(mass=0.01)}}
        return {"cable": (start, None if self.open else end)}

    def step(self, count: int = 1) -> Any:
        """The last shape of so many steps."""
        for _ in range(count):
            (shape,) = self.cycle.step(self.held(), 10 * MS * self.k).shapes.values()
            assert shape.usable, shape.detail
            self.k += 1
        return shape

    def edit(self, *edits: cs.Edit) -> None:
        result = self.cycle.edit(*edits)
        assert result, result.reason


def lines(shape: Any) -> np.ndarray:
    """(n, 3) [m], of all segments."""
    parts = shape.segments.values() if isinstance(shape, cs.HarnessShape) else (shape,)
    return np.concatenate([part.positions for part in parts])


def energy(shape: Any) -> float:
    """[J], all of it."""
    return float(shape.energy + shape.kinetic_energy)


@pytest.mark.parametrize("harness", [False, True])
@pytest.mark.parametrize("contact", ["warn", "solve"])
def test_bodies_come_and_go_and_what_swings_goes_on_to_the_bit(harness, contact):
    scene = cs.Scene(obstacles=[BOX], contact=contact)
    edited, plain = Going(harness, scene), Going(harness, scene)
    edited.edit(cs.Move("box", cs.Pose((2.5, 3.0, 3.0))))  # before anything has moved
    for k in range(60):
        one, other = edited.step(), plain.step()
        np.testing.assert_array_equal(lines(one), lines(other))
        np.testing.assert_array_equal(one.velocity, other.velocity)
        if k in (10, 20, 40):
            edited.edit({10: cs.Move("box", cs.Pose((2.0, 3.0, 3.0))), 20: cs.Remove("box"), 40: cs.Add(BOX)}[k])
    assert np.abs(one.velocity).max() > 0.1


def test_a_body_that_is_put_beneath_is_lain_on():
    going = Going(scene=cs.Scene(contact="solve"))
    shape = going.step(25)
    low = shape.positions[:, 2].min()
    going.edit(cs.Add(cs.Obstacle("table", cs.Box((4.0, 4.0, 0.1)), cs.Pose((0.0, 0.0, low - 0.01 - 0.05)))))
    shape = going.step(200)
    assert shape.contacts
    assert shape.positions[:, 2].min() > low - 0.01 + 0.5 * CABLE.diameter - 1e-3
    still = cs.predict(CABLE.replace(tails={}), *grips(99), scene=going.cycle.scene, points=41)
    assert np.abs(shape.positions - still.positions).max() < 3e-3  # friction holds it where it came to rest


def test_a_clip_takes_the_cable_and_lets_it_go():
    going = Going()
    shape = going.step(45)
    place = cs.Pose(shape.positions[20] + np.array((0.0, 0.0, 0.005)), shape.quaternions[20])
    going.edit(cs.Insert(cs.Clip(0.5, place, "ball", name="clip")))
    taken = going.step()
    np.testing.assert_allclose(taken.positions[20], place.position, atol=1e-6)
    apart = np.abs(taken.positions - shape.positions).max()
    assert apart < 0.03  # the rest of it has only swung on
    held = going.step(80)
    np.testing.assert_allclose(held.positions[20], place.position, atol=1e-6)
    before = energy(held)
    going.edit(cs.Release("clip"))
    for _ in range(20):
        held = going.step()
        assert energy(held) < before + 1e-6
        before = energy(held)
    assert np.abs(held.velocity).max() > 0.1
    still = cs.predict(CABLE.replace(tails={}), *grips(99), points=41)
    assert np.abs(going.step(400).positions - still.positions).max() < 1e-4


@pytest.mark.parametrize("tail", [0.0, 0.1])
def test_an_opened_gripper_lets_the_cable_swing_down(tail):
    going = Going(cable=CABLE.replace(tails={"end": tail} if tail else {}))
    shape = going.step(60)
    going.edit(cs.Open("end"))
    going.open, before, fastest = True, energy(shape), 0.0
    for k in range(60):
        shape = going.step()
        if k:  # the tail is of what swings from here on
            assert energy(shape) < before + 1e-6
        before, fastest = energy(shape), max(fastest, float(np.abs(shape.velocity).max()))
    assert fastest > 2.0
    still = cs.predict(CABLE.replace(tails={}, length=1.0 + tail), grips(99)[0], None, points=41)
    assert np.abs(going.step(1500).positions - still.positions).max() < 2e-3


def test_numbers_and_lengths_change():
    going = Going()
    going.step(15)
    going.edit(cs.SetCable(CABLE.replace(bending_stiffness=0.03)))
    stiff = cs.predict(CABLE.replace(tails={}, bending_stiffness=0.03), *grips(99), points=41)
    assert np.abs(going.step(400).positions - stiff.positions).max() < 1e-4
    going.edit(cs.Regrip("end", 0.95))
    assert going.step().length == pytest.approx(0.95)
    short = cs.predict(CABLE.replace(tails={}, bending_stiffness=0.03, length=0.95), *grips(99), points=41)
    assert np.abs(going.step(400).positions - short.positions).max() < 1e-4


def test_a_harness_is_clipped_and_its_arm_is_changed():
    going = Going(harness=True)
    shape = going.step(20)
    arm = shape.segments["c"]
    place = cs.Pose(arm.positions[20], arm.quaternions[20])
    going.edit(cs.Insert(cs.Clip(0.25, place, "ball", name="clip", segment="c")))
    held = going.step(30)
    np.testing.assert_allclose(held.segments["c"].positions[20], place.position, atol=1e-6)
    going.edit(cs.Release("clip"))
    assert going.cycle.edit(cs.SetCable(ARM.replace(bending_stiffness=0.02)), cable="h/c")
    still = cs.predict(FORK.replace(segments={"a": ARM, "b": ARM, "c": ARM.replace(bending_stiffness=0.02)}),
                       {**going.held()["h"]}, points=41)  # fmt: skip
    assert np.abs(lines(going.step(1500)) - lines(still)).max() < 5e-4


def test_edits_that_cannot_be_change_nothing():
    known = cs.Uncertainty({"length": 0.002})
    with pytest.raises(cs.ArgumentError, match="Leave the uncertainty out"):
        cs.Cycle(CABLE.replace(tails={}), motion="dynamic", uncertainty=known).edit(cs.Add(BOX))
    edited, plain = Going(), Going()
    edited.step(10), plain.step(10)
    assert "held at its start" in edited.cycle.edit(cs.Open("start")).reason
    assert not edited.cycle.edit(cs.Release("none"))
    np.testing.assert_array_equal(edited.step(5).buffer, plain.step(5).buffer)
