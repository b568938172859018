"""Harnesses in contact with bodies: beside a single cable, balance, derivatives, cycles, what is refused."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

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
    corner = cs.Mesh([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1, 2)])
    with pytest.raises(cs.ArgumentError, match="with closed meshes"):
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


def test_segments_run_through_eyelets_in_contact_as_one_cable_does() -> None:
    """Down onto the table and up again, with a junction beside the eyelet, which stays where it is on its segment."""
    whole = CABLE.replace(length=1.2)
    harness = cs.Harness(
        {"a": CABLE.replace(length=0.8), "b": CABLE.replace(length=0.4)}, [cs.Junction("j", ("a.end", "b.start"))]
    )
    table, place = [cs.Obstacle("table", cs.HalfSpace(), cs.Pose((0.0, 0.0, 0.05)))], cs.Pose((0.25, 0.03, 0.2))
    single, several = (
        cs.Predictor(cable, scene=cs.Scene(
            obstacles=table, clips=[cs.Clip(0.3, place, "slide", segment=segment)], contact="solve"
        ), tolerance=1e-6)
        for cable, segment in ((whole, None), (harness, "a"))
    )  # fmt: skip
    touched = False
    for k in (-8, -4, 0, 4, 8, 12, 8, 4, 0, -4, -8):
        start, end = (
            cs.Pose((0.0, 0.0, 0.3 - 0.005 * k), ALONG_X),
            cs.Pose((0.9 - 0.003 * k, 0.002 * k, 0.3 - 0.01 * k), ALONG_X),
        )
        ends = {"a.start": start, "b.end": end}
        one, two = single.predict(start, end), several.predict(ends)
        assert one.status is two.status is cs.Status.OK, (k, one.detail, two.detail)
        allowed = one.error_estimate + two.error_estimate
        assert two.clips[0].arc_length == pytest.approx(one.clips[0].arc_length, abs=2.0 * allowed)
        assert two.energy == pytest.approx(one.energy, abs=4.0 * WEIGHT * allowed)
        np.testing.assert_allclose(two.clips[0].force, one.clips[0].force, atol=4e-3 * WEIGHT)
        assert left_over(harness, two) < 1e-6 * WEIGHT
        for name, first in (("a", 0.0), ("b", 0.8)):
            part = two.segments[name]
            line = np.stack([np.interp(part.arc_length + first, one.arc_length, x) for x in one.positions.T], axis=1)
            assert np.abs(part.positions - line).max() < allowed + 1e-4  # between its points it is a chord
        touched = touched or any(part.contacts for part in two.segments.values())
    assert touched
    still = cs.predict(harness, ends, scene=several.scene, tolerance=1e-6)
    assert still.clips[0].arc_length == pytest.approx(two.clips[0].arc_length, abs=1e-4)


def test_sensitivity_of_a_fork_in_an_eyelet_and_in_contact_is_that_of_differences() -> None:
    clip = cs.Clip(0.25, cs.Pose((0.2, 0.02, 0.25)), "slide", segment="a")
    scene = cs.Scene(obstacles=TABLE.obstacles, clips=[clip], contact="solve")
    predictor = cs.Predictor(fork(), scene=scene, tolerance=1e-6)
    for height in (0.37, 0.36, 0.35, 0.34):
        shape = predictor.predict(trunk(height))
        assert shape.usable, (height, shape.detail)
    ends = trunk(0.34)
    assert any(one.contacts for one in predictor.predict(ends).segments.values())
    found, step = predictor.sensitivity(), 2e-6
    for axis in range(3):
        way = step * np.eye(3)[axis]
        sides = []
        for sign in (1.0, -1.0):
            pose = cs.Pose(ends["b.end"].position + sign * way, ALONG_X)
            sides.append(predictor.predict({**ends, "b.end": pose}).segments)
        for name, columns in found.items():
            difference = (sides[0][name].positions - sides[1][name].positions) / (2.0 * step)
            assert np.abs(columns[:, :, 6 + axis] - difference).max() < 5e-3 * max(1.0, np.abs(difference).max())


@pytest.mark.parametrize("of_harness", [False, True])
def test_sections_in_contact_are_segments_in_a_row(of_harness: bool) -> None:
    """Each as thick, stiff and heavy as it is: on a table the thick one lies its own radius high.

    Where sections of a segment meet nothing presses, as at junctions, but on the nodes beside it: what that misses, no
    estimate counts.
    """
    parts = (
        cs.Section(0.4, 0.7, bending_stiffness=0.03, linear_density=0.2, diameter=0.02),
        cs.Section(0.7, 0.8, bending_stiffness=0.005),
    )
    whole = CABLE.replace(length=1.2, sections=parts)
    thick = cs.Cable(0.3, 0.2, 0.03, 0.008, diameter=0.02)
    names = {"a": CABLE.replace(length=0.4), "b": thick, "c": CABLE.replace(length=0.1, bending_stiffness=0.005)}
    joints = [cs.Junction(x + y, (f"{x}.end", f"{y}.start")) for x, y in ("ab", "bc", "cd")]
    row = cs.Harness({**names, "d": CABLE.replace(length=0.4)}, joints)
    made: cs.Cable | cs.Harness = cs.Harness({"x": whole}) if of_harness else whole
    one, two = cs.Predictor(made, scene=TABLE, points=241), cs.Predictor(row, scene=TABLE, points=61)
    for height in (0.45, 0.4, 0.35, 0.3, 0.27, 0.22, 0.15, 0.3, 0.45):
        start, end = trunk(height).values()
        found = one.predict({"x.start": start, "x.end": end}) if of_harness else one.predict(start, end)
        shape: cs.CableShape = found.segments["x"] if of_harness else found
        other = two.predict({"a.start": start, "d.end": end})
        assert found.status is other.status is cs.Status.OK, (height, found.detail, other.detail)
        allowed = found.error_estimate + other.error_estimate
        assert found.energy == pytest.approx(other.energy, abs=4.0 * WEIGHT * allowed)
        for name, first in (("a", 0.0), ("b", 0.4), ("c", 0.7), ("d", 0.8)):
            part = other.segments[name]
            line = CubicSpline(shape.arc_length, shape.positions)(part.arc_length + first)
            assert np.abs(part.positions - line).max() < allowed + (3e-4 if of_harness else 2e-5)
        if height == 0.15:
            on_table = {contact.point[2] for contact in shape.contacts}
            assert max(map(abs, on_table)) < 2.0 * DEEPEST
            inside = (shape.arc_length > 0.45) & (shape.arc_length < 0.65)
            assert shape.positions[inside, 2].min() == pytest.approx(0.01, abs=2.0 * DEEPEST)
            assert shape.positions[:, 2].min() < 0.01 + 2.0 * DEEPEST
    assert not shape.contacts


def test_a_section_rubs_by_its_own_friction() -> None:
    """A cable drawn over a table is held by the collar alone, and by no more than the law allows."""
    collar = cs.Section(0.25, 0.35, friction=0.5, linear_density=0.4)
    predictor = cs.Predictor(CABLE.replace(sections=[collar]), scene=TABLE)
    for height in (0.2, 0.16, 0.12, 0.08, 0.06, 0.05):
        ends = (cs.Pose((0.0, 0.0, height), ALONG_X), cs.Pose((0.5, 0.0, height), ALONG_X))
        assert predictor.predict(*ends).usable
    for x in np.arange(0.0, 0.02, 0.002):
        shape = predictor.predict(*(cs.Pose(end.position + np.array((x, 0.0, 0.0)), ALONG_X) for end in ends))
        assert shape.usable, shape.detail
    inside = [contact for contact in shape.contacts if 0.249 < contact.arc_length < 0.351]
    outside = [contact for contact in shape.contacts if not 0.249 < contact.arc_length < 0.351]
    assert sum(np.linalg.norm(contact.tangential_force) for contact in inside) > 0.01 * WEIGHT
    assert all(np.linalg.norm(contact.tangential_force) <= 0.501 * contact.force + 1e-9 for contact in inside)
    assert all(np.linalg.norm(contact.tangential_force) == 0.0 for contact in outside)
