"""Harnesses in contact with bodies: beside a single cable, balance, derivatives, cycles, what is refused."""

from __future__ import annotations

import math

import numpy as np
import pytest

import cable_shape as cs
from cable_shape.safety.clearance import ClearanceChecker
from cable_shape.solve.touching.step import DEEPEST

CABLE = cs.Cable(length=0.6, linear_density=0.1, bending_stiffness=0.01, twisting_stiffness=0.008, diameter=0.008)
ALONG_X = (0.5, 0.5, 0.5, 0.5)
LYING = (math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5))  # an axis along y
WEIGHT = 9.81 * 0.1
TABLE = cs.Scene(obstacles=[cs.Obstacle("table", cs.HalfSpace())], contact="solve")


def turned(angle: float, axis: int) -> cs.Pose:
    """A frame turned about d1, d2 or d3."""
    q = np.zeros(4)
    q[axis], q[3] = math.sin(0.5 * angle), math.cos(0.5 * angle)
    return cs.Pose(quaternion=q)


def over(solid: object, pose: cs.Pose | None = None) -> cs.Scene:
    return cs.Scene(obstacles=[cs.Obstacle("body", solid, pose or cs.Pose())], contact="solve")


def fork(kind: str = "rigid", *, backwards: bool = False, frames: dict[str, cs.Pose] | None = None) -> cs.Harness:
    """A trunk of two segments with an arm that leaves it, from its start or, backwards, from its end."""
    arm = "c.end" if backwards else "c.start"
    if frames is None and kind == "rigid":
        frames = {arm: turned(math.pi if backwards else 0.0, 0) * turned(0.8, 1)}
    arms = cs.Junction("fork", ("a.end", "b.start", arm), kind, frames or {}, mass=0.02)
    return cs.Harness({"a": CABLE, "b": CABLE.replace(length=0.5), "c": CABLE.replace(length=0.4)}, [arms])


def trunk(height: float, chord: float = 0.8) -> dict[str, cs.Pose]:
    """Its ends."""
    return {"a.start": cs.Pose((0.0, 0.0, height), ALONG_X), "b.end": cs.Pose((chord, 0.05, height), ALONG_X)}


def left_over(harness: cs.Harness, shape: cs.HarnessShape, gravity: tuple[float, ...] = (0.0, 0.0, -9.81)) -> float:
    """[N], what of all forces on the harness is not balanced; free ends carry none."""
    mass = sum(one.length * one.linear_density for one in harness.segments.values())
    total = np.array(gravity) * (mass + sum(junction.mass for junction in harness.junctions))
    for end in harness.open_ends:
        name, side = end.split(".")
        force = shape.segments[name].force
        total = total + (-force[0] if side == "start" else force[-1])
    for one in shape.segments.values():
        for contact in one.contacts:
            assert contact.force > 0.0
            total = total + contact.force * contact.normal
    for load in shape.clips:
        total = total - load.force
    return float(np.abs(total).max())


def depth(shape: cs.HarnessShape, scene: cs.Scene) -> float:
    """[m], of the harness in the bodies."""
    checker = ClearanceChecker(scene, radius=0.004)
    bodies = [body for one in shape.segments.values() for body in checker.check(one).bodies]
    return max((-body.distance for body in bodies), default=0.0)


@pytest.mark.parametrize(
    ("scene", "gravity"),
    [
        (TABLE, (0.4, 1.0, -9.7)),
        (over(cs.Cylinder(0.08, 0.5), cs.Pose((0.35, 0.0, 0.0), LYING)), (0.0, 0.0, -9.81)),
    ],
)
def test_two_arms_in_contact_are_one_cable(scene: cs.Scene, gravity: tuple[float, ...]) -> None:
    """Within the error of contacts at nodes, which are not the same; what weighs aside tells where they fall to."""
    one = cs.Predictor(CABLE.replace(length=1.2), scene=scene, model="cosserat", points=301, gravity=gravity)
    harness = cs.Harness({"a": CABLE, "b": CABLE}, [cs.Junction("j", ("a.end", "b.start"))])
    two = cs.Predictor(harness, scene=scene, points=151, gravity=gravity)
    for height in (0.6, 0.5, 0.4, 0.35, 0.3, 0.27, 0.24):
        ends = trunk(height)
        whole, parts = one.predict(*ends.values()), two.predict(ends)
        assert whole.status is parts.status is cs.Status.OK
        both = np.concatenate([parts.segments["a"].positions, parts.segments["b"].positions[1:]])
        allowed = whole.error_estimate + parts.error_estimate
        assert float(np.linalg.norm(both - whole.positions, axis=1).max()) <= allowed
        assert parts.energy == pytest.approx(whole.energy, abs=2.0 * WEIGHT * allowed)
        assert left_over(harness, parts, gravity) < 1e-6 * WEIGHT
    assert whole.contacts
    assert sum(len(part.contacts) for part in parts.segments.values()) > 0


@pytest.mark.parametrize("backwards", [False, True])
@pytest.mark.parametrize("kind", ["rigid", "ball"])
def test_a_fork_is_lowered_onto_a_table(kind: str, backwards: bool) -> None:
    """Its arm, which nothing holds, comes to lie on it and carries but what the junction holds of it.

    An arm in a ball joint begins there: one that hangs plumb and just touches moves aside 30 times as far as its tip is
    raised, and errors do so with it.
    """
    harness = fork(kind, backwards=backwards)
    predictor = cs.Predictor(harness, scene=TABLE)
    for height in np.arange(0.9 if kind == "rigid" else 0.7, 0.2, -0.02):
        shape = predictor.predict(trunk(height))
        assert shape.usable, (height, shape.detail)
        assert depth(shape, TABLE) < 2.0 * DEEPEST
        assert left_over(harness, shape) < 1e-6 * WEIGHT
        assert {contact.body for one in shape.segments.values() for contact in one.contacts} <= {"table"}
    lying = sum(contact.force for contact in shape.segments["c"].contacts)
    assert lying > 0.3 * 0.4 * WEIGHT
    if kind == "ball":
        return
    for height in np.arange(0.2, 0.9, 0.02):  # and is taken up again
        shape = predictor.predict(trunk(height))
        assert shape.usable, (height, shape.detail)
    assert not any(one.contacts for one in shape.segments.values())
    assert shape.status is cs.Status.OK


@pytest.mark.parametrize(("solid", "balanced"), [(cs.Box((0.3, 0.4, 0.2)), 1e-4), (cs.Capsule(0.1, 0.4), 1e-6)])
def test_a_fork_hangs_over_a_body_with_clips_masses_and_an_offset(solid: object, balanced: float) -> None:
    """Of the box only as far as two contacts beside each other on an edge allow, see docs/contact.md, Limits."""
    scene = cs.Scene(
        obstacles=[cs.Obstacle("body", solid, cs.Pose((0.4, 0.0, 0.0), LYING))],
        clips=[cs.Clip(0.25, cs.Pose((0.7, 0.12, 0.25)), "ball", segment="c")],
        masses=[cs.PointMass(0.3, 0.03, segment="a")],
        contact="solve",
    )
    harness = fork(frames={"c.start": cs.Pose((0.01, 0.0, 0.0)) * turned(0.8, 1)})
    predictor = cs.Predictor(harness, scene=scene)
    for height in np.arange(0.6, 0.3, -0.01):
        shape = predictor.predict(trunk(height))
        assert shape.usable, (height, shape.detail)
        assert depth(shape, scene) < 2.0 * DEEPEST
        assert left_over(harness, shape) == pytest.approx(0.03 * 9.81, rel=balanced)
    assert any(one.contacts for one in shape.segments.values())


def test_found_from_nothing_and_on_the_way_are_the_same() -> None:
    harness = fork()
    predictor = cs.Predictor(harness, scene=TABLE)
    for height in np.arange(0.5, 0.295, -0.02):
        warm = predictor.predict(trunk(height))
    cold = cs.predict(harness, trunk(height), scene=TABLE)
    assert warm.status is cold.status is cs.Status.OK
    for name, one in warm.segments.items():
        apart = np.linalg.norm(one.positions - cold.segments[name].positions, axis=1).max()
        assert apart < warm.error_estimate + cold.error_estimate


@pytest.mark.parametrize("backwards", [False, True])
def test_grips_open_and_close_and_segments_speed_up_in_contact(backwards: bool) -> None:
    harness = fork(backwards=backwards)
    predictor = cs.Predictor(harness, scene=TABLE)
    for height in np.arange(0.5, 0.28, -0.02):
        assert predictor.predict(trunk(height)).usable
    ends = trunk(height)
    swivel = cs.Grip(ends["a.start"], kind="swivel")
    for held in ({"a.start": ends["a.start"]}, {**ends, "a.start": swivel}, ends):
        shape = predictor.predict(held)
        assert shape.usable, shape.detail
        assert left_over(harness, shape) < 1e-6 * WEIGHT
    moved = predictor.predict(ends, acceleration={"a": (0.5, 0.0, 0.0)})
    assert moved.usable
    assert left_over(harness, moved) == pytest.approx(0.5 * (0.6 * 0.1 + 0.02), rel=1e-6)  # the junction with it
    assert left_over(harness, predictor.predict(ends)) < 1e-6 * WEIGHT


def test_sensitivity_in_contact_is_that_of_differences() -> None:
    harness = fork()
    predictor = cs.Predictor(harness, scene=over(cs.Sphere(0.12), cs.Pose((0.4, 0.0, 0.0))), tolerance=1e-6)
    ends = trunk(0.33)
    for height in np.arange(0.5, 0.335, -0.01):
        assert predictor.predict(trunk(height)).usable
    predictor.predict(ends)
    found = predictor.sensitivity()
    assert predictor.grips == ("a.start", "b.end")
    step = 2e-6
    for axis in range(6):
        sides = []
        for sign in (1.0, -1.0):
            way = np.zeros(3)
            way[axis % 3] = sign * step
            pose = ends["b.end"]
            if axis < 3:
                moved = cs.Pose(pose.position + way, pose.quaternion)
            else:
                x, y, z = 0.5 * way
                moved = cs.Pose(
                    pose.position, (cs.Pose(quaternion=(x, y, z, 1.0)) * cs.Pose(quaternion=pose.quaternion)).quaternion
                )
            shape = predictor.predict({**ends, "b.end": moved})
            assert any(one.contacts for one in shape.segments.values())
            sides.append(np.concatenate([one.positions for one in shape.segments.values()]))
        column = np.concatenate([found[name][:, :, 6 + axis] for name in harness.segments])
        difference = (sides[0] - sides[1]) / (2.0 * step)
        assert np.abs(column - difference).max() < 3e-3 * max(1.0, np.abs(difference).max())


def test_a_harness_in_contact_goes_through_cycle_batch_and_trajectory() -> None:
    harness = fork()
    cycle = cs.Cycle({"h": harness}, scene=TABLE)
    for i, height in enumerate(np.arange(0.5, 0.29, -0.02)):
        report = cycle.step({"h": trunk(height)}, i * 8_000_000)
    shape = report.shapes["h"]
    assert shape.status is cs.Status.OK
    assert all(body.distance > -2.0 * DEEPEST for one in report.clearance.values() for body in one.bodies)
    rows = {end: np.array([pose.array]) for end, pose in trunk(0.3).items()}
    batch = cs.predict_batch(harness, rows, scene=TABLE)
    assert batch[0].status is cs.Status.OK
    assert sum(len(one.contacts) for one in batch[0].segments.values()) > 0
    path = {end: np.array([trunk(0.34)[end].array, trunk(0.3)[end].array]) for end in trunk(0.3)}
    found = cs.check_trajectory(
        harness, cs.Scene(obstacles=TABLE.obstacles, contact="solve", error_distance=0.0), None, path
    )
    assert found.valid


def test_what_is_refused_names_the_part() -> None:
    buried = {**trunk(0.3), "a.start": cs.Pose((0.0, 0.0, -0.05), ALONG_X)}
    shape = cs.predict(fork(), buried, scene=TABLE)
    assert not shape.usable
    assert "the cable at the grip 'a.start' is 54.0 mm inside obstacle 'table'" in shape.detail
    thick = cs.Section(0.1, 0.2, diameter=0.02)
    harness = cs.Harness({"a": CABLE.replace(sections=[thick])})
    with pytest.raises(cs.ArgumentError, match="segment 'a'"):
        cs.Predictor(harness, scene=TABLE)
    corner = cs.Mesh([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1, 2)])
    with pytest.raises(cs.ArgumentError, match="closed convex meshes only"):
        cs.Predictor(fork(), scene=over(corner))


def test_stability_in_contact_and_looks_ahead_are_those_of_one_cable() -> None:
    """In its units: the softest stiffness over the longest segment, or the cable, squared."""
    whole = CABLE.replace(length=1.2)
    harness = cs.Harness({"a": CABLE, "b": CABLE}, [cs.Junction("j", ("a.end", "b.start"))])
    single, several = cs.Cycle(whole, scene=TABLE), cs.Cycle({"h": harness}, scene=TABLE)
    for i, height in enumerate((0.4, 0.34, 0.3, 0.27)):
        ends = trunk(height)
        one = single.step({"cable": tuple(ends.values())}, i * 10**9)
        two = several.step({"h": ends}, i * 10**9)
    assert any(part.contacts for part in two.shapes["h"].segments.values())
    (told,) = (m for m in one.margins["cable"] if m.kind is cs.WarningKind.STABILITY)
    (own,) = (m for name in ("h/a", "h/b") for m in two.margins[name] if m.kind is cs.WarningKind.STABILITY)
    assert own.value / 0.6**2 == pytest.approx(told.value / 1.2**2, rel=0.02)
    predictor = several._harnesses["h"].predictor
    later = {end: cs.Grip(pose) for end, pose in trunk(0.26).items()}
    ahead = predictor.ahead()(later)
    assert ahead.status is cs.Status.OK
    assert any(part.contacts for part in ahead.segments.values())
    shape = several.step({"h": ends}, 5 * 10**9).shapes["h"]
    for name, part in two.shapes["h"].segments.items():  # the look has moved nothing
        np.testing.assert_array_equal(shape.segments[name].positions, part.positions)
    then = several.step({"h": later}, 6 * 10**9).shapes["h"]
    for name, part in then.segments.items():
        assert np.abs(part.positions - ahead.segments[name].positions).max() < 1e-4


def test_a_harness_in_contact_has_a_tube() -> None:
    harness = fork()
    known = cs.Uncertainty({"bending_stiffness": 0.1})
    cycle = cs.Cycle({"h": harness}, scene=TABLE, uncertainty=known)
    for i, height in enumerate((0.36, 0.33, 0.3)):
        report = cycle.step({"h": trunk(height)}, i * 8_000_000)
    shape = report.shapes["h"]
    assert any(one.contacts for one in shape.segments.values())
    tubes = [report.tubes[f"h/{name}"] for name in harness.segments]
    assert max(float(tube.radius.max()) for tube in tubes) > 1e-5
    clip = cs.Clip(0.2, cs.Pose((0.3, 0.0, 0.3)), "slide", segment="a")
    scene = cs.Scene(obstacles=TABLE.obstacles, clips=[clip], contact="solve")
    with pytest.raises(cs.ArgumentError, match="knows no eyelets of harnesses"):
        cs.Predictor(harness, scene=scene)
