"""Friction of cables that cross: statics by hand, loops, differences, rolling, what is known of no past."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scene_random import motion, run_motion
from scipy.spatial.transform import Rotation

import cable_shape as cs
from cable_shape.prediction.cables_predictor import CablesPredictor

ALONG_X = Rotation.from_quat((0.5, 0.5, 0.5, 0.5))
SOLVE = cs.Scene(contact="solve")
CABLE = cs.Cable(0.6, 0.05, 0.01, 0.008, diameter=0.008, axial_stiffness=200.0)
MU, CHORD, RADIUS = 0.3, 0.604, 0.004
WEIGHT = np.array((0.0, 0.0, -9.81 * CABLE.linear_density))


def across(angle, height, aside=(0.0, 0.0), whole=None):
    """Grips CHORD apart at `angle` [degrees] to the x axis; whole: where everything has been taken, a pose."""
    turn = Rotation.from_euler("z", angle, degrees=True)
    half = turn.apply((0.5 * CHORD, 0.0, 0.0))
    poses = [cs.Pose(np.array((*aside, height)) + sign * half, (turn * ALONG_X).as_quat()) for sign in (-1.0, 1.0)]
    return tuple(poses if whole is None else [whole * pose for pose in poses])


class Taut:
    """Two taut cables, `over` let down onto `under`; `drag` takes the grips of `over` so far from there."""

    def __init__(self, friction=MU, angle=90.0, scene=SOLVE, twisting=0.008, **options):
        cables = {"under": CABLE, "over": CABLE.replace(friction=friction, twisting_stiffness=twisting)}
        self.predictor, self.angle = CablesPredictor(cables, scene=scene, model="cosserat", **options), angle
        for self.height in np.linspace(0.01, -0.03, 21):
            self.drag()

    def grips(self, x=0.0, y=0.0, whole=None):
        return {
            "under": across(0.0, 0.0, whole=whole),
            "over": across(self.angle, self.height, (0.02 + x, 0.01 + y), whole),
        }

    def drag(self, x=0.0, y=0.0, whole=None, grips=None):
        self.shapes = self.predictor.predict(grips or self.grips(x, y, whole))
        assert all(shape.status is cs.Status.OK for shape in self.shapes.values()), (x, y, self.shapes)
        return self.shapes["over"].contacts[0] if self.shapes["over"].contacts else None


@pytest.mark.parametrize("way", [(0.0, 1.0), (1.0, 0.0), (-0.8, 0.6)])
def test_a_cable_dragged_across_another_is_held_by_mu_times_their_push(way):
    taut, held = Taut(), []
    for far in np.linspace(0.0, 0.02, 21)[1:]:
        on_over = taut.drag(far * way[0], far * way[1])
        (on_under,) = taut.shapes["under"].contacts
        assert on_under.force == on_over.force > 0.4
        assert np.array_equal(on_under.tangential_force, -on_over.tangential_force)
        assert on_over.slips == on_under.slips
        assert taut.shapes["over"].iterations <= 10  # not in parts, stuck or not
        held.append(float(np.linalg.norm(on_over.tangential_force)) / on_over.force)
        assert abs(on_over.tangential_force @ on_over.normal) < 1e-6 * on_over.force
    assert held[0] < 0.25 * MU  # it sticks, and what it carries grows with how far the other one is taken along
    assert np.all(np.diff(held[:5]) > 0.0)
    assert on_over.slips
    assert held[-1] == pytest.approx(MU, rel=1e-4)
    assert on_over.tangential_force @ (*way, 0.0) < -0.99 * MU * on_over.force
    for shape in taut.shapes.values():  # by hand: of each all forces, and all moments about the origin, balance
        (contact,), places = shape.contacts, shape.positions
        push = contact.force * contact.normal + contact.tangential_force
        left = shape.force[-1] - shape.force[0] + WEIGHT * shape.length + push
        assert np.abs(left).max() < 1e-6
        ends = [shape.moment[k] + np.cross(places[k], shape.force[k]) for k in (0, -1)]
        weighs = np.cross(np.trapezoid(places, shape.arc_length, axis=0), WEIGHT)
        left = ends[1] - ends[0] + weighs + np.cross(contact.point, push)
        assert np.abs(left).max() < 1e-6
        assert RADIUS * np.linalg.norm(contact.tangential_force) > 3e-4  # what would be left on the centreline


@pytest.mark.parametrize("way", [(0.0, 1.0), (1.0, 0.0)])
@pytest.mark.parametrize("steps", [30, 60])
def test_loops_to_and_fro_coincide(way, steps):
    taut, rows = Taut(angle=60.0), []
    for _ in range(3):
        rows.append([])
        for at in np.arange(steps) / steps:
            far = 0.02 * math.sin(2.0 * math.pi * at)
            rows[-1].append(taut.drag(far * way[0], far * way[1]).tangential_force @ (*way, 0.0))
    first, second, third = np.array(rows)
    size = np.abs(second).max()
    assert np.abs(third - second).max() < 1e-3 * size
    assert np.abs(second - first).max() > 0.5 * size  # which began without any
    assert second.max() > 0.13
    assert second.min() < -0.13


def test_two_cables_that_are_moved_as_one_body_carry_their_friction_along():
    """Of what they turn by nothing is a way that one surface has gone over the other. Without weight."""
    taut = Taut(gravity=(0.0, 0.0, 0.0))
    for far in (0.002, 0.004):
        before = taut.drag(0.3 * far, far)
    assert not before.slips
    for at in np.linspace(0.0, 1.0, 9)[1:]:
        turn = Rotation.from_rotvec(at * np.array((0.5, -0.4, 0.6)))
        whole = cs.Pose(at * np.array((0.1, 0.2, -0.1)), turn.as_quat())
        after = taut.drag(0.0012, 0.004, whole)
    assert after.tangential_force == pytest.approx(turn.apply(before.tangential_force), abs=2e-3 * MU * before.force)
    assert after.force == pytest.approx(before.force, rel=1e-4)


@pytest.mark.parametrize("twisting", [0.008, 1e-7])
def test_a_cable_that_hardly_resists_twist_rolls(twisting):
    """Nothing but friction turns it: it goes by its radius times its turn; another one is held."""
    still, taut = Taut(twisting=twisting), Taut(twisting=twisting)
    for far in np.linspace(0.0, 0.006, 13):
        contact = taut.drag(x=far)
    assert not contact.slips
    held = float(np.linalg.norm(contact.tangential_force)) / (MU * contact.force)
    if twisting > 1e-3:
        assert held > 0.8
        return
    assert held < 0.02
    k = int(np.searchsorted(taut.shapes["over"].arc_length, contact.arc_length))
    turns = [Rotation.from_quat(one.shapes["over"].quaternions[k]) for one in (still, taut)]
    rolled = float(np.linalg.norm((turns[1] * turns[0].inv()).as_rotvec()))
    places = [one.shapes["under"].contacts[0].arc_length for one in (still, taut)]
    assert places[1] - places[0] > 0.005
    assert RADIUS * rolled == pytest.approx(places[1] - places[0], rel=0.02)


def test_where_they_stick_derivatives_are_those_of_the_next_step():
    def held():
        taut = Taut(angle=70.0, tolerance=1e-7)
        for far in (0.001, 0.002):
            contact = taut.drag(0.3 * far, far)
        assert not contact.slips
        assert np.linalg.norm(contact.tangential_force) > 0.03
        return taut

    told, size = held().predictor.sensitivity(), 2e-6
    for name in ("under", "over"):
        off, largest = np.zeros(6), np.zeros(6)
        for axis in range(6):
            found = []
            for sign in (1.0, -1.0):
                taut = held()
                grips = taut.grips(0.0006, 0.002)
                step = sign * size * np.eye(6)[axis]
                pose = grips[name][1]
                turned = Rotation.from_rotvec(step[3:]) * Rotation.from_quat(pose.quaternion)
                grips[name] = (grips[name][0], cs.Pose(np.array(pose.position) + step[:3], turned.as_quat()))
                taut.drag(grips=grips)
                found.append({one: shape.positions for one, shape in taut.shapes.items()})
            column = (12 if name == "over" else 0) + 6 + axis
            for one, J in told.items():
                slope = (found[0][one] - found[1][one]) / (2.0 * size)
                off[axis] = max(off[axis], np.abs(slope - J[:, :, column]).max())
                largest[axis] = max(largest[axis], np.abs(slope).max())
        assert off[:3].max() < 1e-3 * largest[:3].max()
        assert off[3:].max() < 2e-3 * largest[3:].max()


@pytest.mark.parametrize("number", [0, 1, 2, 5])
def test_random_motions_keep_to_what_can_be_held(number):
    """Judged in numpy from shapes and contacts alone: cones of all pairs, balance, nothing passes."""
    given = motion("cables", number)
    rough = given._replace(cables={name: cable.replace(friction=0.4) for name, cable in given.cables.items()})
    found = run_motion(rough, f"rough cables {number}")
    assert not found.wrong, found.first
    assert found.statuses.total() == sum(found.statuses[name] for name in ("OK", "SNAPPED", "UNSTABLE"))


def test_without_friction_coefficients_change_no_bit():
    smooth, rough = Taut(friction=0.0), Taut(friction=0.4)
    other = Taut(friction=0.4)
    other.predictor = CablesPredictor(
        {"under": CABLE, "over": CABLE.replace(friction=0.4)}, scene=SOLVE, model="cosserat", friction=False
    )
    for taut in (smooth, other):
        for taut.height in np.linspace(0.01, -0.03, 21):
            taut.drag()
    smooth = Taut(friction=0.0)
    for y in np.linspace(0.0, 0.01, 6):
        for taut in (smooth, other, rough):
            contact = taut.drag(y=y)
            if taut is not rough:
                assert not contact.tangential_force.any()
        for name in ("under", "over"):
            assert np.array_equal(smooth.shapes[name].buffer, other.shapes[name].buffer)
            assert not smooth.shapes[name].frictionless
            assert not rough.shapes[name].frictionless
            assert other.shapes[name].frictionless
    assert rough.shapes["over"].contacts[0].slips


def test_what_has_no_past_is_without_friction_and_says_so():
    grips = {"under": across(0.0, 0.0), "over": across(70.0, 0.003, (0.02, 0.01))}
    cables = {"under": CABLE, "over": CABLE.replace(friction=MU)}
    fresh = CablesPredictor(cables, scene=SOLVE, model="cosserat")
    for k, far in enumerate((0.0, 0.001)):
        grips["over"] = across(70.0, 0.003, (0.02, 0.01 + far))
        for shape in fresh.predict(grips).values():
            (contact,) = shape.contacts
            assert shape.frictionless == (k == 0)
            assert contact.tangential_force.any() == (k == 1)
    ends = {name: tuple(np.array([pose.array] * 2) for pose in pair) for name, pair in grips.items()}
    batch = cs.predict_batch(cables, ends, scene=SOLVE)
    for name in cables:
        shape = batch[1][name]
        assert shape.frictionless
        assert not any(contact.tangential_force.any() for contact in shape.contacts)


def test_what_lies_on_a_table_below_another_cable_is_held_by_both():
    """Dragged to and fro, the upper one and what it takes along; the table holds both where they lie on it, too."""
    table = cs.Obstacle("table", cs.HalfSpace(), cs.Pose((0.0, 0.0, -0.05)), friction=0.4)
    slack = CABLE.replace(bending_stiffness=0.004, twisting_stiffness=0.003, axial_stiffness=None)
    cables = {"under": slack, "over": slack.replace(friction=0.4)}
    scene = cs.Scene(obstacles=[table], contact="solve")
    predictor, rows = CablesPredictor(cables, scene=scene, model="cosserat"), []

    def held(y, height):
        turn = Rotation.from_euler("z", 70.0, degrees=True)
        ends = {"under": (Rotation.identity(), (0.0, 0.0, 0.0)), "over": (turn, (0.02, 0.01 + y, height))}
        return predictor.predict({
            name: tuple(cs.Pose(at + way.apply((x, 0.0, 0.0)), (way * ALONG_X).as_quat()) for x in (-0.25, 0.25))
            for name, (way, at) in ends.items()
        })  # fmt: skip

    for height in np.linspace(0.03, 0.0, 16):
        held(0.0, height)
    for at in np.arange(120) / 40.0:
        shapes = held(0.02 * math.sin(2.0 * math.pi * at), 0.0)
        assert all(shape.status is cs.Status.OK and not shape.frictionless for shape in shapes.values())
        on = {(name, c.body): c for name, shape in shapes.items() for c in shape.contacts}
        keys = (("over", "table"), ("over", "under"), ("under", "table"))
        rows.append([on[key].tangential_force[1] if key in on else 0.0 for key in keys])
        for (name, _), c in on.items():
            assert np.linalg.norm(c.tangential_force) <= 0.4 * c.force * 1.001 + 1e-6, name
    second, third = np.array(rows).reshape(3, 40, 3)[1:]
    assert np.abs(third - second).max() < 2e-3 * np.abs(third).max()
    assert np.abs(third).max(axis=0).min() > 0.03


def test_trajectories_and_twins_go_on_from_what_was_held():
    """A twin, which differences, tubes and looks ahead are made of, carries the same as what it is of."""
    taut = Taut()
    for far in (0.001, 0.002, 0.003):
        before = taut.drag(y=far)
    crossing = taut.predictor._crossing
    twin = crossing.twin()
    twin.strands.hold(crossing.strands.frames())
    again = {name: shape.contacts[0] for name, shape in zip(("under", "over"), twin.solve(), strict=True)}
    assert again["over"].tangential_force == pytest.approx(before.tangential_force, abs=1e-4 * before.force)
    steps = [Taut.grips(taut, y=y) for y in np.linspace(0.0, 0.02, 11)]
    rows = {name: tuple(np.array([step[name][i].array for step in steps]) for i in (0, 1)) for name in steps[0]}
    cables = {"under": CABLE, "over": CABLE.replace(friction=MU)}
    assert cs.check_trajectory(cables, SOLVE, None, rows).done.all()
