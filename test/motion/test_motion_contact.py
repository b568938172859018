"""Cables that swing among bodies and through eyelets: rest, impacts, friction, energy, what may not be passed."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

import cable_shape as cs
from cable_shape.kernels.network.motion import N_PROPS
from cable_shape.kernels.network.props import DRY, GRIP, NORMAL, PUSH, STUCK, eliminate, place_of

ALONG = (0.5, 0.5, 0.5, 0.5)  # d3 along x
G = 9.81
CABLE = cs.Cable(length=1.0, linear_density=0.1, bending_stiffness=1e-3, retardation_time=0.05, drag=0.3, diameter=0.01)
TABLE = cs.Scene(obstacles=[cs.Obstacle("table", cs.HalfSpace())], contact="solve")


def at(x: float, y: float, z: float) -> cs.Pose:
    return cs.Pose((x, y, z), ALONG)


def energy_of(shape: cs.CableShape) -> float:
    return shape.energy + shape.kinetic_energy


def smooth(x: float) -> float:
    """From 0 to 1, with x; with three derivatives 0 at both."""
    return x**4 * (35.0 - 84.0 * x + 70.0 * x**2 - 20.0 * x**3)


def off_line(shape: cs.CableShape, x: float, y: float) -> float:
    """[m], from the vertical line there."""
    return float(np.hypot(shape.positions[:, 0] - x, shape.positions[:, 1] - y).min())


@pytest.mark.parametrize(("low", "still_enough"), [(0.12, 1e-6), (0.13, 1e-4)])
def test_laid_on_a_table_it_comes_to_rest_where_it_lies(low: float, still_enough: float):
    """Let down in half a second; no step is lost, and energy comes from the grips alone.

    At the second height it lifts off inside an element, where a point is pressed that comes and goes with it.
    """
    motion = cs.Motion(CABLE.replace(bending_stiffness=1e-4), TABLE, points=61)
    still = cs.Predictor(motion.cable, scene=TABLE, points=61)
    first = motion.begin(at(0.0, 0.0, 0.3), at(0.9, 0.0, 0.3))
    given = energy_of(first)
    for k in range(1, 251):
        z = max(0.3 - 0.005 * k, low)
        ends = at(0.0, 0.0, z), at(0.9, 0.0, z)
        shape, lying = motion.step(*ends, 0.01), still.predict(*ends)
        assert shape.status is cs.Status.OK, shape.detail
        given += shape.work
        assert energy_of(shape) < given + 1e-6
        assert shape.positions[:, 2].min() > 0.005 - 2e-4
    assert shape.velocity is not None
    assert np.abs(shape.velocity).max() < still_enough
    assert np.abs(shape.positions - lying.positions).max() < shape.error_estimate + lying.error_estimate
    assert len(shape.contacts) > 10
    carried = sum(contact.force for contact in shape.contacts)
    assert carried == pytest.approx(sum(contact.force for contact in lying.contacts), rel=2e-3)
    assert {contact.body for contact in shape.contacts} == {"table"}


def test_it_begins_as_it_lies():
    """On the table from the start, and it stays there."""
    motion = cs.Motion(CABLE.replace(bending_stiffness=1e-4), TABLE, points=61)
    ends = at(0.0, 0.0, 0.18), at(0.9, 0.0, 0.18)
    first = motion.begin(*ends)
    assert first.usable, first.detail
    assert first.contacts
    for _ in range(5):
        last = motion.step(*ends, 0.01)
        assert last.usable
    assert np.abs(last.positions - first.positions).max() < first.error_estimate < 5e-4


def test_of_few_points_it_begins_above_a_table_too():
    """Frames between them are far from where they belong."""
    cable = cs.Cable(length=1.0, linear_density=0.1, bending_stiffness=1e-4, twisting_stiffness=1e-4, diameter=0.01)
    ends = at(0.0, 0.0, 0.6), at(0.7, 0.0, 0.6)
    few, many = (cs.Motion(cable, TABLE, points=points).begin(*ends) for points in (12, 122))
    assert few.usable, few.detail
    assert many.usable
    assert np.abs(few.positions - many.positions[::11]).max() < few.error_estimate < 3e-4


def test_what_arrives_does_not_bounce():
    """A free end swings down on a table: from then on its height changes no more."""
    cable = CABLE.replace(length=0.3, bending_stiffness=0.02, drag=0.0, retardation_time=0.0)
    motion = cs.Motion(cable, TABLE, points=31)
    pin = cs.Grip(at(0.0, 0.0, 0.01), "pinned")
    assert motion.begin(pin, cs.FreeEnd(force=(0.2, 0.0, 0.3))).usable
    heights = []
    for _ in range(120):
        shape = motion.step(pin, cs.FreeEnd(), 0.005)
        assert shape.usable, shape.detail
        heights.append(shape.positions[-1, 2])
    down = int(np.argmax(np.array(heights) < 0.0051))
    assert 0 < down < 80
    assert max(heights) > 0.05
    assert max(heights[down:]) < 0.02
    assert sum(contact.force for contact in shape.contacts) > 0.3 * cable.linear_density * cable.length * G


@pytest.mark.parametrize("stiffness", [1e-3, 1e-4])
@pytest.mark.parametrize("free", [False, True])
def test_limp_and_undamped_it_is_thrown_on_a_table(stiffness: float, free: bool):
    """Shaken and let down in 0.4 s: elements buckle, steps go in short parts and long ones, and none is lost.

    After short parts it may be deep in the table between nodes: its error says how deep.
    """
    cable = cs.Cable(length=1.0, linear_density=0.1, bending_stiffness=stiffness, twisting_stiffness=stiffness / 1.3)
    motion = cs.Motion(cable.replace(diameter=0.01), TABLE, points=41)
    rng = np.random.default_rng(3)
    high = 1.15 if free else 0.55
    given = energy_of(motion.begin(at(0.0, 0.0, high), None if free else at(0.7, 0.0, high)))
    rates, phases = rng.uniform(2.0, 16.0, (2, 3)), rng.uniform(0.0, 6.28, (2, 3))
    touched = 0
    for k in range(1, 81):
        x, y = min(k / 40.0, 1.0), min(k / 30.0, 1.0)
        z = high - (0.9 * high - 0.05) * smooth(x)
        a, b = 0.06 * smooth(y) * np.sin(0.01 * k * rates + phases) * (1.0, 1.0, 0.3)
        shape = motion.step(at(a[0], a[1], z + a[2]), None if free else at(0.7 + b[0], b[1], z + b[2]), 0.01)
        assert shape.usable, (k, shape.detail)
        deep = 0.005 - shape.positions[:, 2].min()
        assert deep < min(shape.error_estimate, 2.5e-3)
        given += shape.work
        assert energy_of(shape) < given + 1e-6
        touched += len(shape.contacts)
    assert touched > 50


@pytest.mark.parametrize("radius", [0.004, 0.02])
@pytest.mark.parametrize("place", [0.35, 0.371])
def test_it_does_not_whip_through_a_post(radius: float, place: float):
    """Drawn against it at 4 m/s and back: posts thinner than an element and than a step, never passed."""
    cable = CABLE.replace(bending_stiffness=3e-3, drag=0.05, retardation_time=0.02, diameter=0.006)
    post = cs.Obstacle("post", cs.Cylinder(radius, 2.0), cs.Pose((place, 0.3, 0.0)))
    motion = cs.Motion(cable, cs.Scene(obstacles=[post], contact="solve"), points=101)
    given = energy_of(motion.begin(at(0.0, 0.0, 0.3), at(0.7, 0.0, 0.3)))
    pushed = 0
    for k in range(1, 121):
        y = min(0.04 * k, 0.5) if k < 60 else max(0.5 - 0.04 * (k - 60), 0.0)
        shape = motion.step(at(0.0, y, 0.3), at(0.7, y, 0.3), 0.01)
        assert shape.status is cs.Status.OK, shape.detail
        assert off_line(shape, place, 0.3) > radius + 0.003 - 4e-4
        given += shape.work
        assert energy_of(shape) < given + 1e-6
        pushed += bool(shape.contacts)
        if 20 < k < 60:  # hooked on the post
            assert shape.positions[:, 1].min() < 0.3
    assert pushed > 10
    assert shape.positions[50, 1] < 0.3


@pytest.mark.parametrize("motion_of", ["held", "up", "down", "let go"])
def test_on_an_incline_it_slides_as_a_block(motion_of: str):
    """Straight down a slope of 20 degrees with a coefficient of 0.2: what its upper end is held by."""
    slope, rough, dt = math.radians(20.0), 0.2, 0.01
    turn = Rotation.from_euler("y", slope)
    down, out = turn.apply((1.0, 0.0, 0.0)), turn.apply((0.0, 0.0, 1.0))
    cable = CABLE.replace(length=0.5, bending_stiffness=0.01, drag=0.0, retardation_time=0.0)
    incline = cs.Obstacle("incline", cs.HalfSpace(), cs.Pose((0, 0, 0), turn.as_quat()), friction=rough)
    motion = cs.Motion(cable, cs.Scene(obstacles=[incline], contact="solve"), points=31)
    frame = (turn * Rotation.from_quat(ALONG)).as_quat()

    def grip(x: float) -> cs.Pose:
        return cs.Pose(0.005 * out + x * down, frame)

    free = G * (math.sin(slope) - rough * math.cos(slope))
    given = energy_of(motion.begin(grip(0.0), None))
    x = 0.0
    for k in range(1, 61):
        if motion_of == "let go":
            x = 0.5 * free * (k * dt) ** 2
        else:
            x += {"held": 0.0, "up": -1.0, "down": 1.0}[motion_of] * 0.1 * min(k / 30.0, 1.0) * dt
        shape = motion.step(grip(x), None, dt)
        assert shape.usable, shape.detail
        given += shape.work
        assert energy_of(shape) < given + 1e-6
    h = cable.length / 20  # what is beside the grip presses on nothing
    weight, pressing = cable.linear_density * cable.length * G, cable.linear_density * (cable.length - 0.5 * h) * G
    along = {"held": math.sin(slope), "let go": 0.0}.get(motion_of, math.sin(slope)) * weight
    along += {"held": 0.0, "let go": 0.0, "up": 1.0, "down": -1.0}[motion_of] * rough * math.cos(slope) * pressing
    if motion_of == "let go":
        along = rough * math.cos(slope) * (weight - pressing)
    assert shape.force[0] @ down == pytest.approx(along, abs=3e-4)
    assert sum(contact.force for contact in shape.contacts) == pytest.approx(pressing * math.cos(slope), rel=1e-2)
    assert all(contact.slips for contact in shape.contacts) == (motion_of != "held")


def test_friction_holds_for_good():
    """What rests on a slope less steep than its friction does not creep: nor in a thousand steps."""
    turn = Rotation.from_euler("y", math.radians(10.0))
    rough = cs.Obstacle("slope", cs.HalfSpace(), cs.Pose((0, 0, 0), turn.as_quat()), friction=0.5)
    cable = CABLE.replace(length=0.5, bending_stiffness=0.01)
    motion = cs.Motion(cable, cs.Scene(obstacles=[rough], contact="solve"), points=12)
    down, out = turn.apply((1.0, 0.0, 0.0)), turn.apply((0.0, 0.0, 1.0))
    frame = (turn * Rotation.from_quat(ALONG)).as_quat()
    motion.begin(cs.Pose(0.005 * out, frame), None)
    for k in range(1, 41):  # pulled, and given way by more than the grip needs
        x = 0.002 * min(k, 20) if k < 21 else 0.04 - 2e-5 * (k - 20)
        shape = motion.step(cs.Pose(0.005 * out + x * down, frame), None, 0.01)
    for k in range(300):
        later = motion.step(cs.Pose(0.005 * out + x * down, frame), None, 0.01)
        assert later.usable
        if k == 20:
            shape = later
    assert np.abs(later.positions - shape.positions).max() < 1e-6


def test_a_body_on_a_link_takes_the_cable_along():
    """A rough table that moves sideways carries what lies on it; one that rises lifts it, and works for that."""
    table = cs.Obstacle("table", cs.Box((2.0, 1.0, 0.1)), cs.Pose((0.5, 0.0, -0.05)), link="lift", friction=0.6)
    motion = cs.Motion(CABLE.replace(bending_stiffness=1e-4), cs.Scene(obstacles=[table], contact="solve"), points=41)
    ends = at(0.0, 0.0, 0.1), at(0.95, 0.0, 0.1)
    begin = motion.begin(*ends, links={"lift": cs.Pose()})
    assert begin.contacts
    given, k = energy_of(begin), 0
    for k in range(1, 41):
        shape = motion.step(*ends, 0.01, links={"lift": cs.Pose((0.0, 0.001 * k, 0.0005 * k))})
        assert shape.usable, shape.detail
        given += shape.work
        assert energy_of(shape) < given + 1e-5
    assert 0.01 < shape.positions[20, 1] < 0.04
    assert shape.positions[:, 2].min() > 0.005 + 0.0005 * k - 2e-4
    stays = motion.step(*ends, 0.01)
    assert stays.positions[:, 2].min() > 0.005 + 0.0005 * k - 2e-4


def test_two_bodies_at_once_and_a_corner():
    """Let down into a corner of a table and a wall it lies in it."""
    wall = cs.Obstacle("wall", cs.Box((3.0, 0.1, 1.0)), cs.Pose((0.5, 0.05 + 0.005, 0.4)))
    scene = cs.Scene(obstacles=[cs.Obstacle("table", cs.HalfSpace()), wall], contact="solve")
    motion = cs.Motion(CABLE, scene, points=41)
    motion.begin(at(0.0, -0.03, 0.3), at(0.9, -0.03, 0.3))
    for k in range(1, 200):
        z, y = max(0.3 - 0.005 * k, 0.1), min(-0.03 + 0.001 * k, -0.0005)
        shape = motion.step(at(0.0, y, z), at(0.9, y, z), 0.01)
        assert shape.usable, shape.detail
        assert shape.positions[:, 2].min() > 0.005 - 2e-4
        assert shape.positions[:, 1].max() < 2e-4
    assert {contact.body for contact in shape.contacts} <= {"table", "wall"}
    assert "table" in {contact.body for contact in shape.contacts}


def test_what_is_tried_ahead_leaves_contacts_as_they_are():
    motions = [cs.Motion(CABLE, TABLE, points=21) for _ in range(2)]
    for k in range(1, 60):
        ends = at(0.0, 0.0, max(0.3 - 0.01 * k, 0.1)), at(0.9, 0.0, max(0.3 - 0.01 * k, 0.1))
        if k == 1:
            for motion in motions:
                motion.begin(*ends)
        one, other = (motion.step(*ends, 0.01) for motion in motions)
        if k % 7 == 0:
            assert len(motions[0].ahead(4, 0.01)) == 4
        np.testing.assert_array_equal(one.positions, other.positions)


EYELETS = [
    pytest.param([cs.Clip(0.5, cs.Pose((0.4, 0.0, 0.05), ALONG), "slide")], id="one"),
    pytest.param(
        [
            cs.Clip(0.3, cs.Pose((0.22, 0.05, 0.05), ALONG), "slide"),
            cs.Clip(0.5, cs.Pose((0.4, 0.0, 0.0), ALONG), "ball"),
            cs.Clip(0.75, cs.Pose((0.6, 0.02, 0.05), ALONG), "slide"),
        ],
        id="two and a clip",
    ),
]


@pytest.mark.parametrize("clips", EYELETS)
def test_it_runs_through_eyelets(clips: list[cs.Clip]):
    """Drawn through them and at rest again: where it is at rest, and what it pulls the eyelets by."""
    cable = CABLE.replace(bending_stiffness=3e-3)
    scene = cs.Scene(clips=clips)
    motion, still = cs.Motion(cable, scene, points=61), cs.Predictor(cable, scene=scene, points=61)
    ends = at(0.0, 0.0, 0.0), at(0.75, 0.0, 0.0)
    first, lying = motion.begin(*ends), still.predict(*ends)
    assert np.abs(first.positions - lying.positions).max() < 1e-3
    given = energy_of(first)
    for k in range(1, 401):
        x = 0.05 * min(k / 100.0, 1.0)
        ends = at(0.3 * x, 0.0, 0.0), at(0.75 + x, 0.3 * x, 0.0)
        shape, lying = motion.step(*ends, 0.01), still.predict(*ends)
        assert shape.usable, shape.detail
        given += shape.work
        assert energy_of(shape) < given + 1e-5
    assert np.abs(shape.positions - lying.positions).max() < 5e-4
    moved = [abs(a.arc_length - b.arc_length) for a, b in zip(shape.clips, first.clips, strict=True)]
    assert max(moved) > 0.01
    for one, other, clip in zip(shape.clips, lying.clips, clips, strict=True):
        assert one.arc_length == pytest.approx(other.arc_length, abs=3e-4)
        np.testing.assert_allclose(one.force, other.force, atol=5e-3)
        place = [np.interp(one.arc_length, shape.arc_length, column) for column in shape.positions.T]
        np.testing.assert_allclose(place, clip.pose.position, atol=1e-3)


def test_bodies_that_are_open_are_refused():
    corners = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (0.1, 0.1, 0.1)], dtype=float)
    faces: ArrayLike = [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 4), (2, 3, 4)]
    scene = cs.Scene(obstacles=[cs.Obstacle("star", cs.Mesh(corners, faces))], contact="solve")
    with pytest.raises(cs.ArgumentError, match="star"):
        cs.Motion(CABLE, scene)


def test_points_that_touch_near_each_other_stick_or_slip_as_coulomb_has_it():
    """On both sides of a node, where the cable, which hardly stretches, makes them hold each other."""
    cable = CABLE.replace(twisting_stiffness=8e-4, friction=0.3)
    motion = cs.Motion(cable, TABLE, points=31, elements=20)
    motion.begin(at(0.0, 0.0, 0.18), at(0.9, 0.0, 0.18))
    seen = set()
    for k in range(1, 13):
        assert motion.step(at(0.0, 0.004 * k, 0.18), at(0.9, -0.004 * k, 0.18), 0.01).usable
        swing = motion._swing
        assert swing is not None
        points = swing.motion.props[: int(swing.motion.par[N_PROPS])]
        for i, row in enumerate(points):
            if not row[PUSH] > 0.0:
                continue
            place = place_of.py_func(swing.plan, points, i, swing.memory.place, swing.memory.tangent)
            way = np.array(place) - row[STUCK : STUCK + 3]
            way -= row[NORMAL : NORMAL + 3] * (row[NORMAL : NORMAL + 3] @ way)
            rub, most = row[DRY : DRY + 3], row[GRIP] * row[PUSH]
            slips = bool(np.linalg.norm(rub) > 0.999 * most)
            seen.add(slips)
            assert np.linalg.norm(rub) < most * (1.0 + 1e-6)
            assert np.linalg.norm(way) < 1e-9 or slips
            assert not slips or rub @ way < 1e-6 * most * np.linalg.norm(way)
    assert seen == {False, True}


def test_points_that_cannot_be_told_apart_leave_no_nan():
    """Two of the same answers: nothing is found, and nothing changes."""
    out = np.array([5.0, 7.0])
    assert not eliminate(np.array([[1.0, 1.0, 2.0], [1.0, 1.0, 3.0]]), out, 2, 2)
    assert out.tolist() == [5.0, 7.0]
    assert eliminate(np.array([[0.0, 2.0, 2.0], [4.0, 1.0, 3.0]]), out, 2, 2)
    np.testing.assert_allclose(out, [0.5, 1.0])


def test_an_end_that_comes_down_upright_makes_no_energy():
    """Its elements turn far in the part of a step in which it does, for which shorter ones are taken."""
    cable = cs.Cable(1.0, linear_density=0.1, bending_stiffness=1e-3, twisting_stiffness=1e-3 / 1.3, diameter=0.01)
    motion = cs.Motion(cable, TABLE, points=41, elements=20)  # which stay as long as they are
    rates, phases, size = np.array((11.9, 11.3, 13.0)), np.array((3.7, 0.6, 2.6)), np.array((0.08, 0.08, 0.024))
    first = motion.begin(at(0.0, 0.0, 1.1), None)
    given, parts = energy_of(first), []
    for k in range(1, 41):
        t = 0.01 * k
        way = smooth(min(t / 0.3, 1.0)) * size * np.sin(rates * t + phases)
        down = 0.81 * smooth(min(t / 0.4, 1.0))
        shape = motion.step(at(way[0], way[1], 1.1 + way[2] - down), None, 0.01)
        assert shape.usable
        given += shape.work
        assert energy_of(shape) - given < 1e-6 * abs(given)
        swing = motion._swing
        assert swing is not None
        parts.append(swing.info[1])
    assert shape.contacts
    assert max(parts) > 1
