"""Clips and contact in one equilibrium: against cables in parts, balances of force and moment, and what is refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from contact_reference import compared, deepest, finer
from eyelets import motions

import cable_shape as cs
from cable_shape.kernels.contact.check import SIDES
from cable_shape.kernels.contact.near import BARE, EXACT, NORMAL, SECOND, THIRD, TILT
from cable_shape.kernels.network.tables import NOW
from cable_shape.solve.touching.state import TouchState
from cable_shape.solve.touching.touching import DEEPEST

ALONG_X = (0.5, 0.5, 0.5, 0.5)
CABLE = cs.Cable(length=1.2, linear_density=0.1, bending_stiffness=0.01, twisting_stiffness=0.008, diameter=0.008)
WEIGHT = 0.1 * 9.81
START, END = cs.Pose((0, 0, 0.3), ALONG_X), cs.Pose((0.8, 0, 0.3), ALONG_X)


def clip(kind, height=0.1, arc_length=0.5):
    return cs.Clip(arc_length, cs.Pose((0.35, 0.05, height), ALONG_X), kind)


def table(*clips, height=0.0):
    plate = cs.Obstacle("table", cs.HalfSpace(), cs.Pose((0, 0, height)))
    return cs.Scene(obstacles=[plate], clips=clips, contact="solve")


def lowered(kind, **options):
    """The shape after a motion in which the clip goes down to 0.1 m above the table."""
    predictor = cs.Predictor(CABLE, model="cosserat", **options)
    for height in np.arange(0.3, 0.095, -0.01):
        predictor.scene = table(clip(kind, height))
        shape = predictor.predict(START, END)
        assert shape.status is cs.Status.OK, (height, shape)
        assert shape.positions[:, 2].min() > 0.004 - 2.0 * DEEPEST
    assert shape.contacts
    return shape, predictor


@pytest.mark.parametrize("kind", ["ball", "hinge", "fixed", "slide"])
def test_far_from_all_bodies_it_is_the_cable_in_clips(kind):
    scene = table(clip(kind), height=-1.0)
    solved = cs.Predictor(CABLE, model="cosserat", scene=scene)
    plain = cs.Predictor(CABLE, model="cosserat", scene=scene.replace(contact="warn"))
    for height in (0.3, 0.301, 0.302):
        start = cs.Pose((0, 0, height), ALONG_X)
        a, b = plain.predict(start, END), solved.predict(start, END)
        assert np.array_equal(a.buffer, b.buffer)
        assert np.array_equal(a.supports, b.supports)


def test_beyond_a_fixed_clip_is_a_cable_of_its_own():
    whole, _ = lowered("fixed")
    rest = cs.predict(CABLE.replace(length=0.7), clip("fixed").pose, END, scene=table(), model="cosserat")
    assert rest.status is cs.Status.OK
    beyond = np.stack([np.interp(rest.arc_length + 0.5, whole.arc_length, whole.positions[:, i]) for i in range(3)], 1)
    assert np.linalg.norm(beyond - rest.positions, axis=1).max() < 5e-4 * CABLE.length
    pressed = [contact.force for contact in whole.contacts if contact.arc_length > 0.5]
    assert sum(pressed) == pytest.approx(sum(contact.force for contact in rest.contacts), rel=0.01)


@pytest.mark.parametrize("kind", ["ball", "hinge", "fixed", "slide"])
def test_clips_bodies_grips_and_weight_balance(kind):
    shape, _ = lowered(kind, points=1201)
    held = shape.clips[0]
    force = shape.force[-1] - shape.force[0] - held.force - (0, 0, WEIGHT * CABLE.length)
    moment = shape.moment[-1] - shape.moment[0] - held.moment - np.cross(clip(kind).pose.position, held.force)
    moment += np.cross(shape.positions[-1], shape.force[-1]) - np.cross(shape.positions[0], shape.force[0])
    moment += np.cross(np.trapezoid(shape.positions, shape.arc_length, axis=0), (0, 0, -WEIGHT))
    for contact in shape.contacts:
        force += contact.force * contact.normal
        moment += np.cross(contact.point, contact.force * contact.normal)
    assert force == pytest.approx((0, 0, 0), abs=1e-6)
    assert moment == pytest.approx((0, 0, 0), abs=2e-5)
    free = {"hinge": np.array([(1.0, 0.0, 0.0)]), "fixed": np.zeros((0, 3))}.get(kind, np.eye(3))
    assert free @ held.moment == pytest.approx(np.zeros(len(free)), abs=1e-6)  # the hinge's axis is the world's x


def test_a_fixed_clip_in_the_frame_that_a_ball_clip_leaves_changes_nothing():
    ball, _ = lowered("ball", points=1201)
    frame = cs.Pose(clip("ball").pose.position, ball.quaternions[500])
    scene = table(cs.Clip(0.5, frame, "fixed"))
    fixed = cs.predict(CABLE, START, END, scene=scene, model="cosserat", points=1201)
    assert fixed.status is cs.Status.OK
    assert np.linalg.norm(fixed.positions - ball.positions, axis=1).max() < 5e-4 * CABLE.length
    assert fixed.clips[0].force == pytest.approx(ball.clips[0].force, abs=0.01 * WEIGHT)
    assert fixed.clips[0].moment == pytest.approx((0, 0, 0), abs=2e-4)


@pytest.mark.parametrize("kind", ["hinge", "fixed"])
def test_cold_and_by_a_motion_are_the_same_shape(kind):
    shape, _ = lowered(kind)
    cold = cs.predict(CABLE, START, END, scene=table(clip(kind)), model="cosserat")
    assert cold.status is cs.Status.OK
    assert np.linalg.norm(cold.positions - shape.positions, axis=1).max() < 5e-4 * CABLE.length


def test_two_clips_with_a_mass_and_a_free_end():
    clips = (clip("ball", 0.05, 0.5), cs.Clip(0.8, cs.Pose((0.6, 0.05, 0.05), ALONG_X), "hinge"))
    scene = table(*clips).replace(masses=[cs.PointMass(0.6, 0.02), cs.PointMass(0.8, 0.01)])
    shape = cs.predict(CABLE, START, None, scene=scene, model="cosserat")
    assert shape.status is cs.Status.OK
    assert {contact.arc_length > 0.8 for contact in shape.contacts} == {False, True}
    total = sum(contact.force * contact.normal for contact in shape.contacts) - sum(c.force for c in shape.clips)
    assert total - shape.force[0] == pytest.approx((0, 0, WEIGHT * 1.2 + 0.03 * 9.81), abs=1e-5)


def test_a_clip_that_jumps_is_followed():
    predictor = cs.Predictor(CABLE, model="cosserat", scene=table(clip("ball", 0.25)))
    assert predictor.predict(START, END).contacts == ()
    predictor.scene = table(clip("ball", 0.1))
    shape = predictor.predict(START, END)
    assert shape.status is cs.Status.OK
    slow, _ = lowered("ball")
    assert np.linalg.norm(shape.positions - slow.positions, axis=1).max() < 5e-4 * CABLE.length


def test_a_clip_that_closes_keeps_the_warm_start():
    ball, predictor = lowered("ball", points=1201)
    frame = cs.Pose(clip("ball").pose.position, ball.quaternions[500])
    predictor.scene = table(cs.Clip(0.5, frame, "fixed"))
    fixed = predictor.predict(START, END)
    assert fixed.status is cs.Status.OK
    assert fixed.iterations < 10
    assert np.linalg.norm(fixed.positions - ball.positions, axis=1).max() < 1e-5 * CABLE.length


@pytest.mark.parametrize("kind", ["ball", "slide"])
def test_sensitivity_in_clips_and_contact_is_that_of_finite_differences(kind):
    _, predictor = lowered(kind, tolerance=1e-6)
    columns = predictor.sensitivity()
    step = 1e-4
    for axis in (0, 1, 2):
        shapes = []
        for sign in (1.0, -1.0):
            moved = END.position.copy()
            moved[axis] += sign * step
            shapes.append(predictor.predict(START, cs.Pose(moved, END.quaternion)))
        assert shapes[0].contacts
        difference = (shapes[0].positions - shapes[1].positions) / (2.0 * step)
        assert columns[:, :, 6 + axis] == pytest.approx(difference, abs=5e-3)


@pytest.mark.parametrize("kind", ["ball", "slide"])
def test_the_energy_is_that_of_its_moments_and_its_weight(kind):
    _, predictor = lowered(kind, points=4801)
    for height in (0.1, 0.099, 0.0985):  # warm and cold
        for one in (predictor, cs.Predictor(CABLE, model="cosserat", points=4801)):
            one.scene = table(clip(kind, height))
            shape = one.predict(START, END)
            assert shape.contacts
            x, y, z, w = shape.quaternions.T
            d3 = np.stack((2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)), axis=1)
            twist = (shape.moment * d3).sum(axis=1)
            bend = (shape.moment**2).sum(axis=1) - twist**2
            density = 0.5 * bend / 0.01 + 0.5 * twist**2 / 0.008 + WEIGHT * shape.positions[:, 2]
            energy = np.trapezoid(density, shape.arc_length)
            assert shape.energy == pytest.approx(energy, abs=2e-4)


def up(pose, height):
    x, y, z = pose.position
    return cs.Pose((x, y, z + height - 0.1), pose.quaternion)


def tangent_at(shape, arc_length):
    """The third axis of the frame there, between two points."""
    q = np.array([np.interp(arc_length, shape.arc_length, shape.quaternions[:, i]) for i in range(4)])
    x, y, z, w = q / np.linalg.norm(q)
    return np.array((2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)))


def test_the_tension_is_the_same_on_both_sides_of_an_eyelet():
    shape, _ = lowered("slide", points=1201)
    held = shape.clips[0]
    pull = held.force @ tangent_at(shape, held.arc_length)
    assert pull == pytest.approx(0.0, abs=2e-4 * np.linalg.norm(held.force))
    assert abs(held.arc_length - 0.5) > 0.05  # it has run
    near = np.abs(shape.positions - clip("slide").pose.position).sum(axis=1).argmin()
    assert shape.arc_length[near] == pytest.approx(held.arc_length, abs=2e-3)
    ball = cs.predict(
        CABLE, START, END, scene=table(clip("ball", arc_length=held.arc_length)), model="cosserat", points=1201
    )
    assert ball.status is cs.Status.OK
    assert np.linalg.norm(ball.positions - shape.positions, axis=1).max() < 1e-4 * CABLE.length
    assert ball.energy == pytest.approx(shape.energy, abs=1e-4 * WEIGHT * CABLE.length)


@pytest.mark.parametrize("kinds", [("slide", "hinge"), ("hinge", "slide"), ("slide", "slide")])
def test_eyelets_with_masses_and_a_free_end_pull_nowhere_along_the_cable(kinds):
    clips = (clip(kinds[0], 0.05, 0.5), cs.Clip(0.8, cs.Pose((0.6, 0.05, 0.05), ALONG_X), kinds[1]))
    scene = table(*clips).replace(masses=[cs.PointMass(0.6, 0.02), cs.PointMass(0.9, 0.01)])
    shape = cs.predict(CABLE, START, None, scene=scene, model="cosserat", points=1201)
    assert shape.status is cs.Status.OK
    assert shape.contacts
    total = sum(contact.force * contact.normal for contact in shape.contacts) - sum(c.force for c in shape.clips)
    assert total - shape.force[0] == pytest.approx((0, 0, WEIGHT * 1.2 + 0.03 * 9.81), abs=1e-5)
    for held, kind in zip(shape.clips, kinds, strict=True):
        if kind == "slide":
            assert held.force @ tangent_at(shape, held.arc_length) == pytest.approx(0.0, abs=1e-3 * WEIGHT)


@pytest.mark.parametrize("name", ["two eyelets", "over a bar"])
def test_motions_through_eyelets_are_near_a_finer_mesh_and_the_estimate_says_so(name):
    judged = 0
    predictor = cs.Predictor(CABLE, model="cosserat")
    for k, (scene, start, end) in enumerate(motions(60, 5)[name]):
        predictor.scene = scene
        shape = predictor.predict(start, end)
        assert shape.status, (k, shape)
        assert deepest(shape, scene, 0.5 * CABLE.diameter) < 2.0 * DEEPEST
        if k % 10 or not shape.contacts:
            continue
        fine = finer(predictor._solver._touch, 2)
        if fine is not None and fine.error_estimate > 0.2 * shape.error_estimate:  # no reference as yet
            fine = finer(predictor._solver._touch, 4)
        if fine is None:
            continue
        distance = compared(shape, fine)[0]
        assert distance <= shape.error_estimate
        assert distance <= 5e-4 * CABLE.length
        assert shape.energy == pytest.approx(fine.energy, abs=1e-4)
        judged += 1
    assert judged >= 4


@pytest.mark.parametrize("name", ["an eyelet and a clip", "over the edge of a box"])
def test_eyelets_pull_nowhere_along_a_cable_whose_contacts_come_and_go(name):
    """What eyelets add to the network is laid out anew with every contact; what was there before is none of it."""
    cable = cs.Cable(length=1.3, linear_density=0.06, bending_stiffness=0.01, diameter=0.008)
    predictor, pulls = None, []
    for scene, start, end in motions(25, 3)[name]:
        if predictor is None:
            predictor = cs.Predictor(cable, scene=scene, model="cosserat", points=401)
        else:
            predictor.scene = scene
        shape = predictor.predict(start, end)
        assert shape.usable
        for clip, load in zip(scene.clips, shape.clips, strict=True):
            tangent = [np.interp(load.arc_length, shape.arc_length, x) for x in shape.tangents.T]
            if clip.kind == "slide":
                pulls.append(abs(load.force @ tangent) / np.linalg.norm(load.force))
    assert max(pulls) < 5e-4  # of the force; 4e-3 and 1.5e-2 with what was left of other networks


@pytest.mark.parametrize("beside", [1e-3, 2e-3, -1e-3, -2e-3])
def test_a_contact_that_has_no_room_to_run_along_the_cable_presses_it_square(beside):
    """Newton's method took 38 and 45 iterations, and more nodes, where it was pressed along the normal at the node."""
    cable = cs.Cable(length=1.3, linear_density=0.06, bending_stiffness=0.01, diameter=0.008)
    (scene, start, end), (_, _, later) = motions(25, 3)["over a bar"][:2]
    predictor = cs.Predictor(cable, scene=scene, model="cosserat", points=401)
    at = predictor.predict(start, end).contacts[0].arc_length
    assert predictor._solver._touch.insert(np.array([at + beside]))
    shape = predictor.predict(start, cs.Pose(end.position + 0.1 * (later.position - end.position), end.quaternion))
    assert shape.status is cs.Status.OK
    assert shape.iterations < 15
    (eyelet,) = (load for load, held in zip(shape.clips, scene.clips, strict=True) if held.kind == "slide")
    assert abs(eyelet.force @ tangent_at(shape, eyelet.arc_length)) < 1e-4 * np.linalg.norm(eyelet.force)


def test_a_contact_is_told_with_the_whole_force_of_a_push_that_is_turned():
    _, predictor = lowered("ball")
    state = predictor._solver._touch
    k = int(np.flatnonzero(state.on[NOW, :, 0] != BARE)[0])
    row = state.near[NOW, k]
    row[TILT : TILT + 3] = (0.03, -0.04, 0.0)  # along the table
    told = state.touches()[0]
    assert told[8] * told[5:8] == pytest.approx(row[EXACT] * (row[NORMAL : NORMAL + 3] + row[TILT : TILT + 3]))
    assert np.linalg.norm(told[5:8]) == pytest.approx(1.0)


@pytest.mark.parametrize("pushes", [(1.0, -1e-3), (-1e-3, 1.0), (-1e-3, 0.5, 1.0), (1.0, -1e-3, -2e-3), (1.0, 0.5)])
def test_what_is_told_of_a_corner_is_all_that_its_bodies_push(pushes):
    """One may pull by what a contact is dropped for, and was not told then; nor were others, if it was the first."""
    _, predictor = lowered("ball")
    state = predictor._solver._touch
    k = int(np.flatnonzero(state.on[NOW, :, 0] != BARE)[0])
    row = state.near[NOW, k]
    state.on[NOW, k, [0, SECOND, THIRD][: len(pushes)]] = 0
    for push, (_, exact, normal), n in zip(pushes, SIDES, np.eye(3), strict=False):
        row[exact], row[normal : normal + 3] = push, n
    told = [touch for touch in state.touches() if touch[0] == state.nodes[k]]
    assert len(told) == np.sum(np.array(pushes) > 0.0)
    assert sum(touch[8] * touch[5:8] for touch in told) == pytest.approx([*pushes, 0.0][:3])
    for touch in told:
        assert touch[8] > 0.0
        assert np.linalg.norm(touch[5:8]) == pytest.approx(1.0)
        assert touch[5:8].max() > 0.999  # along the normal of its body


@pytest.mark.parametrize("stiffness", [0.1, 1.0])
def test_a_push_stays_turned_where_the_next_solution_is_next_to_the_last_one(stiffness, monkeypatch):
    """Along the cable it pressed a taut one by 4e-3 of itself, every time but the first."""
    monkeypatch.setattr(TouchState, "tidy", lambda self: False)  # the contact keeps the node that leaves it no room
    cable = cs.Cable(length=1.001, linear_density=0.1, bending_stiffness=stiffness, diameter=0.008)
    bar = cs.Obstacle("bar", cs.Cylinder(0.02, 0.4), cs.Pose((0.4, 0, -0.014), (np.sqrt(0.5), 0, 0, np.sqrt(0.5))))
    predictor = cs.Predictor(cable, scene=cs.Scene(obstacles=[bar], contact="solve"), model="cosserat", points=401)
    at = predictor.predict(cs.Pose((0, 0, 0), ALONG_X), cs.Pose((1, 0, 0), ALONG_X)).contacts[0].arc_length
    state = predictor._solver._touch
    state.lay_out(np.sort(np.append(state.nodes, at - 5e-4)))
    for x in (1e-4, 1e-4 + 1e-10, 1e-4 + 2e-10):
        shape = predictor.predict(cs.Pose((x, 0, 0), ALONG_X), cs.Pose((1 + x, 0, 0), ALONG_X))
        assert shape.status is cs.Status.OK
        (contact,) = shape.contacts
        assert abs(contact.normal @ tangent_at(shape, contact.arc_length)) < 1e-4


def test_a_cable_lifted_off_in_an_eyelet_is_that_without_contact():
    _, predictor = lowered("slide", tolerance=1e-5)
    for height in np.arange(0.11, 0.62, 0.02):
        predictor.scene = table(clip("slide", height))
        shape = predictor.predict(up(START, height), up(END, height))
        assert shape.status, (height, shape)
    assert shape.contacts == ()
    free = cs.predict(
        CABLE, up(START, height), up(END, height), model="cosserat", tolerance=1e-5,
        scene=predictor.scene.replace(contact="warn"),
    )  # fmt: skip
    assert shape.clips[0].arc_length == pytest.approx(free.clips[0].arc_length, abs=1e-4)
    assert np.linalg.norm(shape.positions - free.positions, axis=1).max() < 1e-4


def test_the_cable_runs_on_through_an_eyelet_that_is_drawn_along_the_table():
    predictor = cs.Predictor(CABLE, model="cosserat")
    ran, touched = [], 0
    for x in np.linspace(0.35, 0.55, 41):
        predictor.scene = table(cs.Clip(0.5, cs.Pose((x, 0.05, 0.1), ALONG_X), "slide"))
        shape = predictor.predict(START, END)
        assert shape.status, (x, shape)
        held = shape.clips[0]
        touched += len(shape.contacts) > 0
        assert held.force @ tangent_at(shape, held.arc_length) == pytest.approx(0.0, abs=5e-3 * WEIGHT)
        ran.append(held.arc_length)
    assert ran[-1] - ran[0] > 0.17
    assert max(np.diff(ran)) < 0.01, "it runs, and does not jump"
    assert touched > 20


def test_buried_clips_are_named():
    shape = cs.predict(CABLE, START, END, scene=table(clip("ball", -0.01)), model="cosserat")
    assert shape.status is cs.Status.NOT_CONVERGED
    assert "clips[0] is 14.0 mm inside obstacle 'table'" in shape.detail


def test_a_mass_that_a_body_has_pressed_on_the_way_stays_where_it_is_on_the_cable():
    along_x, at = cs.Pose(quaternion=(0.0, np.sqrt(0.5), 0.0, np.sqrt(0.5))), 0.473813
    cable = cs.Cable(length=1.0689056, linear_density=0.1, bending_stiffness=0.0175, diameter=0.008)
    ball = cs.Obstacle("ball", cs.Sphere(0.028875), cs.Pose((0.364248, -0.000615, 0.836624)))
    eyelet = cs.Clip(0.339034, cs.Pose((0.323950, -0.000567, 0.886467)) * along_x, "slide")
    scene = cs.Scene([ball], clips=[eyelet], masses=[cs.PointMass(at, 0.01)], contact="solve")
    ends = cs.Pose((0.02923, 0.0, 1.0)) * along_x, None
    predictor = cs.Predictor(cable, scene=scene)
    shape = predictor.predict(*ends)
    assert shape.status is cs.Status.OK
    assert len(shape.touches) == 1
    assert np.abs(predictor.memory.nodes - at).min() < 1e-12
    other = cs.Predictor(cable, scene=scene)
    other.begin(shape, ends, None)
    other.look_again()
    assert np.abs(other.solve().positions - shape.positions).max() < shape.error_estimate


def test_a_shape_taken_up_is_turned_in_its_clip_as_the_clip_is():
    shape, predictor = lowered("fixed")
    other = cs.Predictor(CABLE, model="cosserat", scene=predictor.scene)
    other.begin(shape, (START, END), None)
    state = other.memory
    turned = state.q[0, state.held[1]]
    assert abs(float(turned @ clip("fixed").pose.quaternion)) == pytest.approx(1.0, abs=1e-14)


def test_a_harness_taken_up_is_turned_in_its_clip_as_the_clip_is():
    halves = {name: CABLE.replace(length=0.5 * CABLE.length) for name in ("a", "b")}
    harness = cs.Harness(halves, [cs.Junction("j", ("a.end", "b.start"))])
    ends = {"a.start": START, "b.end": END}
    predictor = cs.Predictor(harness)
    for height in np.arange(0.3, 0.095, -0.01):
        held = replace(clip("fixed", height), arc_length=0.4 * CABLE.length, segment="a")
        predictor.scene = table(held)
        shape = predictor.predict(ends)
        assert shape.status is cs.Status.OK
    assert any(part.contacts for part in shape.segments.values())
    other = cs.Predictor(harness, scene=predictor.scene)
    other.begin(shape, ends, None)
    state = other.rod_memory
    turned = state.q[0, state.held[1]]
    assert abs(float(turned @ held.pose.quaternion)) == pytest.approx(1.0, abs=1e-14)
    other.look_again()
    again = other.solve()
    for name, part in again.segments.items():
        assert np.abs(part.positions - shape.segments[name].positions).max() < 2.0 * shape.error_estimate


def test_a_shape_found_from_nothing_is_none_of_its_mesh_alone():
    """On the first mesh there is an equilibrium 26 mm from any that the cable has; it told an error of 0.4 mm."""
    along_x = cs.Pose(quaternion=(0.0, np.sqrt(0.5), 0.0, np.sqrt(0.5)))
    cable = cs.Cable(
        length=1.0254129402227727, linear_density=0.1, bending_stiffness=0.024397259080461663,
        twisting_stiffness=0.018767122369585894, diameter=0.008,
    )  # fmt: skip
    ball = cs.Sphere(0.024741739185727522), cs.Pose((0.09885186275469329, -0.0015249074595386452, 0.9387414670742777))
    at, places = (
        (0.23192330069029962, 0.7144692372135851),
        ((0.18816023703755017, -0.007807861928593536, 0.9315255584185914),
         (0.663539542759484, -0.007273051851660466, 0.8812358069868147)),
    )  # fmt: skip
    clips = [cs.Clip(arc, cs.Pose(place) * along_x, "fixed") for arc, place in zip(at, places, strict=True)]
    masses = [cs.PointMass(0.5292362721472125, 0.01)]
    scene = cs.Scene([cs.Obstacle("ball", *ball)], clips=clips, masses=masses, contact="solve")
    ends = cs.Pose((-0.02286989689896844, 0.0, 1.0)) * along_x, cs.Pose((0.9410182669104379, 0.0, 1.0)) * along_x
    shape = cs.Predictor(cable, scene=scene).predict(*ends)
    assert shape.status is cs.Status.OK
    finer = cs.Predictor(cable, scene=scene, tolerance=1e-6)
    finer.begin(shape, ends, None)
    finer.look_again()
    assert np.abs(finer.solve().positions - shape.positions).max() < 5e-4 * cable.length
