"""Contact in the equilibrium of the rod: closed forms, a finer mesh, motions, and what is refused."""

from __future__ import annotations

import math

import numpy as np
import pytest
from contact_reference import compared, finer
from scene_contact import motions

import cable_shape as cs
from cable_shape.kernels.contact import near as contact_near
from cable_shape.safety.clearance import ClearanceChecker
from cable_shape.solve.touching import mesh
from cable_shape.solve.touching.touching import DEEPEST

ALONG_X = (0.5, 0.5, 0.5, 0.5)
ALONG_Y = cs.Pose((0, 0, 0), (math.sqrt(0.5), 0, 0, math.sqrt(0.5)))
CABLE = cs.Cable(length=1.2, linear_density=0.1, bending_stiffness=0.01, twisting_stiffness=0.008, diameter=0.008)
WEIGHT = 0.1 * 9.81
TABLE = cs.Scene(obstacles=[cs.Obstacle("table", cs.HalfSpace())], contact="solve")


def over(solid, pose=None, name="body"):
    return cs.Scene(obstacles=[cs.Obstacle(name, solid, pose or cs.Pose())], contact="solve")


def ends(height, chord=0.8, side=0.0):
    return cs.Pose((0, 0, height), ALONG_X), cs.Pose((chord, side, height), ALONG_X)


def depth(shape, scene, radius=0.004):
    """[m], of the cable in the scene's obstacles, between the points, too."""
    found = ClearanceChecker(scene, radius=radius).check(shape)
    return max((-body.distance for body in found.bodies), default=0.0)


def lowered(scene, heights, predictor=None, **options):
    predictor = predictor or cs.Predictor(CABLE, scene=scene, model="cosserat", **options)
    for height in heights:
        shape = predictor.predict(*ends(height))
        assert shape.status is cs.Status.OK, (height, shape)
        assert depth(shape, scene) < 2.0 * DEEPEST
    return shape, predictor


@pytest.mark.parametrize(
    ("kind", "share", "reaction", "grip", "tolerance"),
    [("clamped", 72, 1 / 3, 2 / 3, 2e-3), ("pinned", 24, 1 / 2, 1 / 2, 5e-3)],
)
def test_a_cable_lifted_off_a_table(kind, share, reaction, grip, tolerance):
    length, lift, stiffness, radius = (
        0.8,
        0.3,
        0.05,
        0.002,
    )  # stiff: slopes stay small, as the closed form has it
    cable = cs.Cable(length, 0.1, stiffness, 0.8 * stiffness, diameter=2.0 * radius)
    height = radius + WEIGHT * lift**4 / (share * stiffness)
    shape = cs.predict(cable, cs.Grip(cs.Pose((0, 0, height), ALONG_X), kind=kind), None, scene=TABLE, model="cosserat")
    assert shape.status is cs.Status.OK
    assert depth(shape, TABLE, radius) < 2.0 * DEEPEST
    total = sum(contact.force for contact in shape.contacts)
    assert total == pytest.approx(WEIGHT * (length - lift + reaction * lift), rel=tolerance)
    assert -shape.force[0, 2] == pytest.approx(grip * WEIGHT * lift, rel=tolerance)
    moment = WEIGHT * lift**2 / 6 if kind == "clamped" else 0.0
    assert np.linalg.norm(shape.moment[0]) == pytest.approx(moment, rel=tolerance, abs=1e-6)
    assert shape.contacts[0].arc_length == pytest.approx(lift, abs=0.02)
    assert all(contact.body == "table" and contact.force > 0.0 for contact in shape.contacts)


def test_pressure_on_a_cylinder_under_tension_is_tension_times_curvature(monkeypatch):
    monkeypatch.setattr(mesh, "ELEMENTS", 128)
    radius, drum, stiffness, tension = 0.002, 0.1, 0.001, 2.0
    cable = cs.Cable(0.8, 0.1, stiffness, stiffness, diameter=2.0 * radius)
    scene = over(cs.Cylinder(drum, 0.6), ALONG_Y)
    start = cs.Grip(cs.Pose((-0.3, 0.0, 0.09), ALONG_X), kind="pinned")
    predictor = cs.Predictor(cable, scene=scene, model="cosserat", gravity=(0, 0, 0))
    for angle in np.radians(np.arange(-20.0, 61.0, 2.0)):
        end = cs.FreeEnd(force=(tension * math.cos(angle), 0.0, -tension * math.sin(angle)))
        shape = predictor.predict(start, end)
        assert shape.status is cs.Status.OK, (angle, shape)
    curvature = 1.0 / (drum + radius)
    first, last = shape.contacts[2].arc_length, shape.contacts[-3].arc_length
    wrapped = (shape.arc_length > first) & (shape.arc_length < last)
    assert wrapped.sum() > 5
    bend = np.linalg.norm(shape.curvature[wrapped], axis=1)
    assert bend.mean() == pytest.approx(curvature, rel=5e-3)
    pressed = (shape.tension[wrapped] * bend).mean()
    assert pressed == pytest.approx((tension - 0.5 * stiffness * curvature**2) * curvature, rel=5e-3)


def test_contact_forces_weight_and_grips_balance():
    shape, _ = lowered(TABLE, np.arange(0.45, 0.2, -0.01))
    pushed = sum(contact.force * contact.normal for contact in shape.contacts)
    assert pushed + shape.force[-1] - shape.force[0] == pytest.approx((0, 0, WEIGHT * 1.2), abs=1e-6)


@pytest.mark.parametrize(
    "scene",
    [
        over(cs.Capsule(0.05, 0.6), cs.Pose((0.4, 0, 0)) * ALONG_Y),
        over(cs.Sphere(0.15), cs.Pose((0.4, 0.04, -0.04))),
        over(cs.Capsule(0.002, 0.8), cs.Pose((0.42, 0, 0)) * ALONG_Y),
        over(cs.Box((0.2, 0.6, 0.2)), cs.Pose((0.42, 0, -0.05), (0.03, 0, 0, math.sqrt(1.0 - 0.03**2)))),
    ],
    ids=["capsule", "sphere", "rod 4 mm thick", "box"],
)
def test_the_default_mesh_agrees_with_one_eight_times_finer(scene, monkeypatch):
    heights = np.arange(0.5, 0.37, -0.01)
    shape, _ = lowered(scene, heights)
    monkeypatch.setattr(mesh, "ELEMENTS", 8 * mesh.ELEMENTS)
    fine, _ = lowered(scene, heights)
    assert shape.contacts
    assert fine.contacts
    assert np.linalg.norm(shape.positions - fine.positions, axis=1).max() < 5e-4 * CABLE.length


@pytest.mark.parametrize("name", ["laid on a plane", "dragged over an edge", "capsule", "pulled around a post"])
def test_the_error_estimate_is_honest_along_a_motion(name):
    scene, along = motions(300)[name]
    predictor = cs.Predictor(CABLE, scene=scene, model="cosserat")
    judged = 0
    for k, (start, end) in enumerate(along):
        shape = predictor.predict(start, end)
        assert shape.status, (k, shape)
        if not shape.contacts or k % 21:
            continue
        coarse, fine = finer(predictor._solver._touch, 2), finer(predictor._solver._touch, 3)
        assert coarse is not None
        assert fine is not None
        distance, _ = compared(shape, fine)
        assert distance <= shape.error_estimate <= 5e-4 * CABLE.length, k
        assert compared(shape, coarse)[1] < 0.01, k
        judged += 1
    assert judged >= 8


def test_a_cable_that_slides_off_an_edge_comes_to_rest_beside_it():
    scene, along = motions(300)["box edge"]
    predictor = cs.Predictor(CABLE, scene=scene, model="cosserat")
    snapped, energy = [], math.inf
    for k, (start, end) in enumerate(along):
        shape = predictor.predict(start, end)
        assert shape.status, (k, shape)
        assert depth(shape, scene) < 2.0 * DEEPEST
        if shape.status is cs.Status.SNAPPED:
            snapped.append(k)
            assert shape.energy < energy
        energy = shape.energy
    assert len(snapped) == 1
    assert len(shape.contacts) == 1
    normal = shape.contacts[0].normal
    assert min(normal[0], normal[2]) > 0.3  # on the edge


def test_newton_is_quadratic_at_an_edge_that_the_cable_crosses_at_an_angle():
    scene, along = motions(300)["box edge"]
    predictor = cs.Predictor(CABLE, scene=scene, model="cosserat")
    counts = [predictor.predict(start, end).iterations for start, end in along]
    assert max(counts[-20:]) <= 8


def test_the_curvature_at_a_contact_is_that_of_a_beam_over_a_support():
    a, b, stiffness, force, bend = 0.02, 0.03, 0.01, 0.4, 1.5
    flex = 1.0 / stiffness

    def turned(s):  # about y; the force along x makes its second derivative jump by force / stiffness
        return bend * s - 4.0 * s * s + (0.5 * force * flex * s * s if s > 0.0 else 0.0)

    q = np.array([(0.0, math.sin(0.5 * turned(s)), 0.0, math.cos(0.5 * turned(s))) for s in (-a, 0.0, b)])
    near = np.zeros((3, contact_near.NEAR))
    near[1, contact_near.PRESS] = force
    near[1, contact_near.NORMAL : contact_near.NORMAL + 3] = (1.0, 0.0, 0.0)
    found = contact_near.turning(q, np.array((a, b)), near, 1, np.full(3, flex))
    assert found == pytest.approx((0.0, bend, 0.0), abs=1e-3)


def test_a_free_shape_that_touches_nothing_is_that_of_the_plain_rod():
    scene = TABLE
    plain = cs.Predictor(CABLE, model="cosserat")
    solved = cs.Predictor(CABLE, model="cosserat", scene=scene)
    for height in (0.5, 0.49, 0.48):
        a, b = plain.predict(*ends(height)), solved.predict(*ends(height))
        assert np.array_equal(a.buffer, b.buffer)
        assert b.contacts == ()


def test_a_cable_that_is_lifted_again_leaves_the_table():
    _, predictor = lowered(TABLE, np.arange(0.45, 0.3, -0.01))
    shape, _ = lowered(TABLE, np.arange(0.3, 0.47, 0.01), predictor)
    assert shape.contacts == ()
    assert shape.positions == pytest.approx(cs.predict(CABLE, *ends(0.46), model="cosserat").positions, abs=2e-5)


@pytest.mark.parametrize("height", [0.3, 0.2])
def test_cold_onto_a_table(height):
    shape = cs.predict(CABLE, *ends(height), scene=TABLE, model="cosserat")
    assert shape.status is cs.Status.OK
    assert shape.contacts
    assert depth(shape, TABLE) < 2.0 * DEEPEST


def test_auto_takes_the_rod_where_contact_is_solved_for():
    shape = cs.predict(CABLE, *ends(0.3), scene=TABLE)
    assert shape.model == "cosserat"
    assert shape.contacts


def test_thin_rods_are_not_passed():
    scene = over(cs.Capsule(0.002, 0.8), cs.Pose((0.42, 0, 0)) * ALONG_Y)
    predictor = cs.Predictor(CABLE, scene=scene, model="cosserat")
    for height in np.arange(0.46, 0.38, -0.01):  # further at a time than the rod and the cable are thick
        shape = predictor.predict(*ends(height))
        assert shape.status is cs.Status.OK
    assert shape.contacts[0].normal[2] > 0.9
    lowest = shape.positions[np.abs(shape.positions[:, 0] - 0.42).argmin()]
    assert lowest[2] > 0.0


def test_sensitivity_in_contact_is_that_of_finite_differences():
    scene = over(cs.Sphere(0.15), cs.Pose((0.4, 0.04, -0.04)))
    _, predictor = lowered(scene, np.arange(0.5, 0.43, -0.01))
    start, end = ends(0.44)
    predictor.predict(start, end)
    columns = predictor.sensitivity()
    step = 1e-4
    for axis in (0, 2):
        shapes = []
        for sign in (1.0, -1.0):
            moved = end.position.copy()
            moved[axis] += sign * step
            shapes.append(predictor.predict(start, cs.Pose(moved, end.quaternion)))
        difference = (shapes[0].positions - shapes[1].positions) / (2.0 * step)
        assert columns[:, :, 6 + axis] == pytest.approx(difference, abs=5e-3)


def test_random_scenes_give_no_shape_inside_an_obstacle():
    rng = np.random.default_rng(7)
    solids = (cs.Sphere(0.08), cs.Capsule(0.03, 0.3), cs.Cylinder(0.06, 0.2), cs.Box((0.1, 0.2, 0.1)), cs.HalfSpace())
    usable = 0
    for k in range(30):
        q = rng.normal(size=4)
        place = (rng.uniform(0.1, 0.7), rng.uniform(-0.1, 0.1), rng.uniform(-0.5, 0.0))
        flat = isinstance(solids[k % 5], cs.HalfSpace)
        scene = over(
            solids[k % 5], cs.Pose((0, 0, -0.3)) if flat else cs.Pose(place, q / np.linalg.norm(q)), name=f"body {k}"
        )
        shape = cs.predict(CABLE, *ends(0.0), scene=scene, model="cosserat")
        assert np.isfinite(shape.positions).all()
        if shape.status:
            usable += 1
            assert depth(shape, scene) < 2.0 * DEEPEST
    assert usable >= 24


def test_a_grip_inside_an_obstacle_is_named():
    scene = over(cs.Box((0.1, 0.1, 0.1)), name="fixture")
    shape = cs.predict(CABLE, *ends(0.0), scene=scene, model="cosserat")
    assert shape.status is cs.Status.NOT_CONVERGED
    assert "start grip" in shape.detail
    assert "'fixture'" in shape.detail


def test_what_contact_does_not_know_is_refused():
    with pytest.raises(cs.ArgumentError, match="contact"):
        cs.Scene(contact="bounce")
    with pytest.raises(cs.ArgumentError, match="catenary"):
        cs.Predictor(CABLE, model="catenary", scene=TABLE)


def test_contact_is_kept_in_files_and_off_tells_no_clearance():
    assert cs.Scene.from_mapping(TABLE.as_dict()).contact == "solve"
    assert cs.Scene().contact == "warn"
    off = cs.Cycle(CABLE, scene=TABLE.replace(contact="off"), model="cosserat")
    report = off.step({"cable": ends(0.3)}, stamp=0)
    assert report.clearance["cable"].bodies == ()
    assert report.shapes["cable"].contacts == ()
    assert report.shapes["cable"].positions[:, 2].min() < 0.0


def test_obstacles_may_move_and_change_between_shapes():
    _, predictor = lowered(TABLE, np.arange(0.45, 0.35, -0.01))
    raised = over(cs.HalfSpace(), cs.Pose((0, 0, 0.005)), name="table")
    predictor.scene = raised
    shape = predictor.predict(*ends(0.36))
    assert shape.status is cs.Status.OK
    assert depth(shape, raised) < 2.0 * DEEPEST
    predictor.scene = over(cs.Sphere(0.1), cs.Pose((0.4, 0.05, 0.0)))
    shape = predictor.predict(*ends(0.46))
    assert shape.status
    assert depth(shape, predictor.scene) < 2.0 * DEEPEST


def test_factors_of_earlier_steps_serve_while_the_cable_hardly_moves():
    cable = cs.Cable(1.2, 0.1, 0.003, 0.003, diameter=0.004)
    warm, anew = (cs.Predictor(cable, scene=TABLE, model="cosserat") for _ in range(2))
    served = 0
    for k in range(60):
        height = 0.03 + 1e-4 * k
        shapes = []
        for predictor in (warm, anew):
            if predictor is anew and k:
                predictor._solver._touch.unfactored()
            start, end = cs.Pose((0, 0, height), ALONG_X), cs.Pose((1.12, 0, height), ALONG_X)
            shapes.append(predictor.predict(start, end))
            assert shapes[-1].status is cs.Status.OK
        assert len(shapes[0].contacts) == len(shapes[1].contacts) >= 20
        assert shapes[0].positions == pytest.approx(shapes[1].positions, abs=5e-6)
        assert shapes[0].force == pytest.approx(shapes[1].force, abs=1e-5 * WEIGHT)
        served += warm._solver._touch.info[4] == 0.0
        assert anew._solver._touch.info[4] > 0.0
    assert served > 40
