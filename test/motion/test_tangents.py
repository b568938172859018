"""Derivatives of motions by what holds the cable and what it is made of, each against central differences."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import cable_shape as cs

ALONG = (0.5, 0.5, 0.5, 0.5)  # d3 along x
CABLE = cs.Cable(
    length=1.0, linear_density=0.1, bending_stiffness=0.01, twisting_stiffness=0.008, retardation_time=0.05, drag=0.05
)
NUMBERS = ("length", "linear_density", "bending_stiffness", "twisting_stiffness", "retardation_time", "drag")
DT, STEPS = 0.01, 25
NONE = np.zeros(12)
ARM = cs.Cable(length=0.5, linear_density=0.1, bending_stiffness=0.01, retardation_time=0.02, drag=0.02)
Y = cs.Harness(
    {"a": ARM, "b": ARM, "c": ARM.replace(bending_stiffness=0.005)},
    [cs.Junction("j", ("a.end", "b.start", "c.start"))],
)


def turned(way: np.ndarray) -> np.ndarray:
    """A quaternion along x, turned by a rotation vector."""
    return np.asarray((Rotation.from_rotvec(way) * Rotation.from_quat(ALONG)).as_quat())


def swung(
    cable: cs.Cable, end: Callable[[cs.Pose], Any] = lambda pose: pose, scene: cs.Scene | None = None,
    offset: np.ndarray = NONE, rate: np.ndarray = NONE, by: tuple[str, ...] = (), steps: int = STEPS,
    start: Callable[[cs.Pose], Any] = lambda pose: pose, at: str = "cable",
    elements: int | None = None,
) -> tuple[cs.Motion, cs.CableShape]:  # fmt: skip
    """Both ends move sideways, one further than the other; their poses are by `offset`, and `rate` times time, off."""
    motion = cs.Motion(cable, scene, points=17, elements=elements)

    def ends(k: int) -> tuple[Any, Any]:
        y = 0.1 * np.sin(0.1 * k)
        more = offset + DT * k * rate
        first = cs.Pose((more[0], more[1] + y, more[2]), turned(more[3:6]))
        last = cs.Pose((more[6] + 0.7, more[7] + 0.5 * y, more[8] + 0.2 * y), turned(more[9:]))
        return start(first), end(last)

    shape = motion.begin(*ends(0), by=by, at=at)
    for k in range(1, steps + 1):
        shape = motion.step(*ends(k), DT)
        assert shape.status, shape.detail
    return motion, shape


def check(columns: np.ndarray, rates: np.ndarray, above: cs.CableShape, below: cs.CableShape, step: float) -> None:
    """One column of positions, and of velocities, is that of differences."""
    for own, ways in (
        (columns, above.positions - below.positions),
        (rates, above.velocity - below.velocity),  # type: ignore[operator]
    ):
        found = ways / (2.0 * step)
        # where a motion begins no better at rest than to 1e-7 of its force, differences have that for noise
        assert np.abs(own - found).max() < 1e-3 * np.abs(found).max() + 1e-5


@pytest.mark.parametrize("name", NUMBERS)
def test_by_a_number_of_the_cable(name: str):
    motion, _ = swung(CABLE, by=NUMBERS)
    column = NUMBERS.index(name)
    value = CABLE.mean_bending_stiffness if name == "bending_stiffness" else getattr(CABLE, name)
    step = 1e-3 * value
    above, below = (swung(CABLE.replace(**{name: value + x}))[1] for x in (step, -step))
    check(
        motion.sensitivity()[:, :, column], motion.sensitivity("velocity")[:, :, column], above, below, step
    )  # fmt: skip


@pytest.mark.parametrize("names", [("start", "end"), ("velocity:start", "velocity:end")], ids=["poses", "velocities"])
@pytest.mark.parametrize("kind", ["clamped", "swivel", "pinned"])
def test_by_the_grips(names: tuple[str, str], kind: str):
    def end(pose: cs.Pose) -> cs.Grip:
        return cs.Grip(pose, kind)

    motion, _ = swung(CABLE, end, by=names)
    moves, rates = motion.sensitivity(), motion.sensitivity("velocity")
    which = "rate" if names[0].startswith("velocity") else "offset"
    for column in (0, 1, 4, 5, 8, 9, 10, 11) if kind == "clamped" else (6, 9, 10, 11):
        way = np.zeros(12)
        way[column] = 1e-3  # with less, rounding counts: 4e-9 m/s in what a twist of a swivel does not change
        above, below = (swung(CABLE, end, **{which: sign * way})[1] for sign in (1.0, -1.0))  # type: ignore[arg-type]
        check(moves[:, :, column], rates[:, :, column], above, below, 1e-3)


def test_by_what_holds_a_limp_cable_without_damping_that_carries_a_plug_in_a_clip():
    """And rotations that an end leaves free, and free ends, have none."""
    cable = cs.Cable(length=1.0, linear_density=0.05, bending_stiffness=0.001)
    clip = cs.Clip(0.4, cs.Pose((0.35, 0.0, -0.05), ALONG), "fixed", "c")
    scene = cs.Scene(clips=[clip], masses=[cs.PointMass(0.7, 0.01)])

    def end(_: cs.Pose) -> cs.FreeEnd:
        return cs.FreeEnd(mass=0.02)

    names = ("bending_stiffness", "length", "drag", "start", "end", "clip:c")
    motion, _ = swung(cable, end, scene, by=names, steps=15, elements=60)
    moves, rates = motion.sensitivity(), motion.sensitivity("velocity")
    assert moves.shape == (17, 3, 21)
    assert not moves[:, :, 9:15].any()
    for column, changed in enumerate(
        (lambda x: cable.replace(bending_stiffness=0.001 + x), lambda x: cable.replace(length=1.0 + x))
    ):
        step = 1e-6 if column == 0 else 1e-4
        above, below = (swung(changed(x), end, scene, steps=15, elements=60)[1] for x in (step, -step))
        check(moves[:, :, column], rates[:, :, column], above, below, step)
    above = swung(cable.replace(drag=1e-4), end, scene, steps=15, elements=60)[1]
    assert np.abs((above.positions - motion.last.positions) / 1e-4 - moves[:, :, 2]).max() < 0.02 * np.abs(
        moves[:, :, 2]
    ).max()  # fmt: skip
    for i in (1, 4):
        way = np.zeros(6)
        way[i] = 1e-5
        beside = [
            cs.Scene(
                clips=[
                    cs.Clip(0.4, cs.Pose(sign * way[:3] + clip.pose.position, turned(sign * way[3:])), "fixed", "c")
                ],
                masses=scene.masses,
            )
            for sign in (1.0, -1.0)
        ]
        above, below = (swung(cable, end, one, steps=15, elements=60)[1] for one in beside)
        check(moves[:, :, 15 + i], rates[:, :, 15 + i], above, below, 1e-5)


def test_about_the_gripper_turning_it_moves_the_cable_s_end():
    def held(pose: cs.Pose) -> cs.Grip:
        return cs.Grip(pose, offset=cs.Pose((0.0, 0.02, 0.05)))

    motion, _ = swung(CABLE, by=("start",), start=held, at="gripper")
    way = np.zeros(12)
    way[5] = 1e-4
    above, below = (swung(CABLE, start=held, offset=sign * way)[1] for sign in (1.0, -1.0))
    check(motion.sensitivity()[:, :, 5], motion.sensitivity("velocity")[:, :, 5], above, below, 1e-4)
    assert np.abs(motion.sensitivity()[0, :, 5]).max() > 0.01


def test_shapes_are_the_same_with_derivatives_to_the_bit_and_a_look_ahead_leaves_them():
    (plain, shape), (motion, other) = swung(CABLE), swung(CABLE, by=("drag", "start"))
    np.testing.assert_array_equal(shape.positions, other.positions)
    before = motion.sensitivity()
    ahead = plain.ahead(5, DT)
    np.testing.assert_array_equal(ahead[-1].positions, motion.ahead(5, DT)[-1].positions)
    np.testing.assert_array_equal(motion.sensitivity(), before)


def test_steps_that_go_in_parts_take_them_along():
    """A limp cable that is jerked."""
    cable = cs.Cable(length=1.0, linear_density=0.1, bending_stiffness=1e-3)

    def jerked(offset: float, by: tuple[str, ...] = ()) -> tuple[cs.Motion, cs.CableShape, int]:
        motion, parts = cs.Motion(cable, points=21, elements=20), 0
        shape = motion.begin(cs.Pose((0, offset, 0), ALONG), cs.Pose((0.7, 0, 0), ALONG), by=by)
        for k in range(1, 4):
            y = 0.25 * (1.0 - np.cos(3.0 * k))
            shape = motion.step(cs.Pose((0, y + offset, 0.5 * y), ALONG), cs.Pose((0.7, -0.3 * y, 0), ALONG), DT)
            assert shape.status, shape.detail
            assert motion._swing is not None
            parts = max(parts, int(motion._swing.info[1]))
        return motion, shape, parts

    motion, _, parts = jerked(0.0, ("start",))
    assert parts > 1
    above, below = jerked(1e-6)[1], jerked(-1e-6)[1]
    check(motion.sensitivity()[:, :, 1], motion.sensitivity("velocity")[:, :, 1], above, below, 1e-6)


def test_many_steps_at_once_by_numbers_and_by_any_way_of_the_grips():
    steps = np.full(STEPS, DT)
    y = 0.1 * np.sin(0.1 * np.arange(1, STEPS + 1))
    still, zeros = np.tile(ALONG, (STEPS, 1)), np.zeros(STEPS)
    ways = np.stack((np.sin(np.arange(1, STEPS + 1)), np.arange(STEPS) >= 10.0)).T  # (T, 2)

    def run(cable: cs.Cable, off: np.ndarray, by: tuple[str, ...] = (), twists: np.ndarray | None = None) -> Any:
        motion = cs.Motion(cable, points=21)
        motion.begin(cs.Pose((0, 0, 0), ALONG), cs.Pose((0.7, 0, 0), ALONG), by=by)
        first = np.column_stack((zeros, y + ways @ off, zeros, still))
        last = np.column_stack((zeros + 0.7, 0.5 * y, 0.2 * y, still))
        return motion.run(first, last, steps, twists)

    twists = np.zeros((STEPS, 2, 6, 2))
    twists[:, 0, 1] = ways
    none, at = np.zeros(2), np.array((0.0, 0.13, 0.5, 0.91))
    found = run(CABLE, none, ("length", "drag"), twists)
    columns = found.derivative.at(at)
    assert columns.shape == (STEPS, 4, 3, 4)
    for column, step in ((0, 1e-4), (1, 1e-4)):
        name = ("length", "drag")[column]
        value = getattr(CABLE, name)
        above, below = (run(CABLE.replace(**{name: value + x}), none).at(at) for x in (step, -step))
        differ = (above - below) / (2.0 * step)
        assert np.abs(columns[..., column] - differ).max() < 1e-3 * np.abs(differ).max()
    for column in range(2):
        above, below = (run(CABLE, x * np.eye(2)[column]) for x in (1e-5, -1e-5))
        differ = (above.at(at) - below.at(at)) / 2e-5
        assert np.abs(columns[..., 2 + column] - differ).max() < 1e-4 * np.abs(differ).max()
        differ = (above.velocities - below.velocities) / 2e-5
        assert np.abs(found.derivative.velocities[..., 2 + column] - differ).max() < 1e-3 * np.abs(differ).max()


@pytest.mark.parametrize("third", ["held", "free"])
def test_of_a_harness(third: str):
    names = ("bending_stiffness:c", "length:b", "drag:a", "a.start", "velocity:b.end")

    def go(
        harness: cs.Harness, offset: np.ndarray = NONE[:6], rate: np.ndarray = NONE[:6], by: tuple[str, ...] = ()
    ) -> tuple[Any, cs.HarnessShape]:
        motion = cs.Motion(harness, points=11)

        def ends(k: int) -> dict[str, cs.Pose]:
            y, more = 0.05 * (1.0 - np.cos(0.2 * k)), DT * k * rate
            held = {
                "a.start": cs.Pose((offset[0], offset[1] + y, offset[2]), turned(offset[3:])),
                "b.end": cs.Pose((more[0] + 0.8, more[1] + y, more[2] + 0.1), turned(more[3:])),
            }
            return held | ({"c.end": cs.Pose((0.5, y + 0.4, 0.1))} if third == "held" else {})

        shape = motion.begin(ends(0), by=by)
        for k in range(1, 13):
            shape = motion.step(ends(k), DT)
            assert shape.status, shape.detail
        return motion, shape

    motion, _ = go(Y, by=names)
    moves, rates = motion.sensitivity(), motion.sensitivity("velocity")
    for column, (segment, name) in enumerate((("c", "bending_stiffness"), ("b", "length"), ("a", "drag"))):
        cable = Y.segments[segment]
        value = cable.mean_bending_stiffness if column == 0 else getattr(cable, name)
        step = 1e-3 * value
        beside = [
            Y.replace(segments={**Y.segments, segment: cable.replace(**{name: value + x})}) for x in (step, -step)
        ]
        above, below = (go(one)[1] for one in beside)
        for one in "abc":
            a, b = above.segments[one], below.segments[one]
            check(moves[one][:, :, column], rates[one][:, :, column], a, b, step)
    for column, which in ((1, "offset"), (5, "offset"), (2, "rate"), (3, "rate")):
        way = np.zeros(6)
        way[column] = 1e-4
        above, below = (go(Y, **{which: sign * way})[1] for sign in (1.0, -1.0))  # type: ignore[arg-type]
        i = 3 + column + (6 if which == "rate" else 0)
        for one in "abc":
            check(moves[one][:, :, i], rates[one][:, :, i], above.segments[one], below.segments[one], 1e-4)


def test_what_is_refused():
    start, end = cs.Pose((0, 0, 0), ALONG), cs.Pose((0.7, 0, 0), ALONG)
    motion = cs.Motion(CABLE, points=21)
    with pytest.raises(cs.ArgumentError, match="the shape knows no derivative by it"):
        motion.begin(start, end, by=("mass",))
    with pytest.raises(cs.ArgumentError, match="must be named once"):
        motion.begin(start, end, by=("drag", "drag"))
    motion.begin(start, end)
    with pytest.raises(cs.ArgumentError, match=r"needs names.*Begin with by="):
        motion.sensitivity()
    seen = np.linspace((0.1, 0, -0.1), (0.6, 0, -0.1), 5)
    with pytest.raises(cs.ArgumentError, match="begins as it is seen"):
        motion.begin(start, end, points=seen, by=("drag",))
    with pytest.raises(cs.ArgumentError, match=r"unknown key 'drag'"):
        cs.Motion(Y).begin({"a.start": start, "b.end": end}, by=("drag",))
