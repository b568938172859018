"""Clips at the rod's full order: no clip is the plain cable, errors fall with the sixth power, estimates are honest."""

from __future__ import annotations

import math

import numpy as np
import pytest
from rods import ALONG_X, CABLE, END, LENGTH, START, moved, on_mesh, solved

from cable_shape.kernels.network import drive, sliding
from cable_shape.kernels.network.newton import CONVERGED
from cable_shape.pose import Pose
from cable_shape.scene.scene import Clip, PointMass, Scene
from cable_shape.shape import CableShape, Status
from cable_shape.solve import cosserat
from cable_shape.solve.network import Network
from cable_shape.solve.problem import Problem

FREE = solved(CABLE, START, END, points=241, tolerance=1e-11 * LENGTH)
BENT = CABLE.replace(
    bending_stiffness=(0.01, 0.02), axial_stiffness=50.0, shear_stiffness=30.0, rest_curvature=(1.0, 0.5, 0.2)
)


def held_at(*places: tuple[int, str], shift=(0.0, 0.0, 0.0)) -> Scene:
    """Clips at these points of the 241 of the shape without clips, moved by `shift` [m]."""
    return Scene(
        clips=[
            Clip(FREE.arc_length[i], Pose(FREE.positions[i] + np.asarray(shift), FREE.quaternions[i]), kind)
            for i, kind in places
        ]
    )


@pytest.mark.parametrize("kinds", [("ball",), ("ball", "ball"), ("fixed",), ("hinge", "ball"), ("slide",)])
def test_clips_on_the_plain_shape_give_the_plain_shape(kinds):
    places = zip((60, 160), kinds, strict=False)
    shape = solved(CABLE, START, END, scene=held_at(*places), points=241, tolerance=1e-10 * LENGTH)
    assert shape.status is Status.OK
    assert shape.positions == pytest.approx(FREE.positions, abs=1e-9 * LENGTH)
    scale = np.abs(FREE.force).max()
    for load, (i, _) in zip(shape.clips, zip((60, 160), kinds, strict=False), strict=True):
        assert load.arc_length == pytest.approx(FREE.arc_length[i], abs=1e-8 * LENGTH)
        assert np.abs(load.force).max() < 1e-7 * scale


# -- order


@pytest.mark.parametrize("cable", [CABLE, BENT])
@pytest.mark.parametrize("kinds", [("ball", "ball"), ("fixed", "hinge"), ("slide", "ball"), ("slide", "slide")])
def test_the_error_falls_with_the_sixth_power_of_the_element(cable, kinds):
    scene = held_at((80, kinds[0]), (160, kinds[1]), shift=(0.0, 0.01, 0.02))
    state = Network(Problem(cable, points=241, tolerance=1e-11 * LENGTH, scene=scene).move(START, END))
    exact = cosserat.solve(state.problem, state)
    assert exact.status is Status.OK
    errors, slips = [], []
    for counts in ([6, 6, 6], [12, 12, 12], [24, 24, 24]):
        shape = on_mesh(state, counts, 0.1)
        error = np.linalg.norm(shape.positions - exact.positions, axis=1)
        errors.append(error.mean())
        slips.append(max(abs(a.arc_length - b.arc_length) for a, b in zip(shape.clips, exact.clips, strict=True)))
        assert error.max() <= shape.error_estimate
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert orders.mean() > 5.5, (errors, orders)
    if "slide" in kinds:  # so does that of what is in the eyelets
        assert np.log2(slips[0] / slips[2]) / 2.0 > 5.0, slips


# -- eyelets


def test_nodes_keep_their_shares_between_the_knots():
    scene = held_at((80, "slide"), (160, "slide")).replace(masses=[PointMass(0.6, 0.01)])
    state = Network(Problem(CABLE, scene=scene).move(START, END))
    assert cosserat.solve(state.problem, state).status is Status.OK
    before, run = state.nodes.copy(), sliding.new_slides(state.ints, True)
    ways = np.array((0.03, -0.02))
    sliding.slides_of.py_func(state.ints, run).way[:] = ways
    sliding.move_along(state.ints, state.floats, run, 0.5)
    bounds = state.bounds()
    assert np.interp(np.sort((*before[[a for a, _ in state.runs]][1:], 0.6)), before, before) == pytest.approx(
        np.sort((*(bounds[1:-1] - 0.5 * ways), 0.6))
    )
    old, new = np.sort((*(bounds[1:-1] - 0.5 * ways), 0.6)), np.sort((*bounds[1:-1], 0.6))
    expected = np.interp(before, (0.0, *old, LENGTH), (0.0, *new, LENGTH))
    assert state.nodes == pytest.approx(expected, abs=1e-12)
    assert state.model.h == pytest.approx(np.diff(state.nodes)[np.diff(state.nodes) > 0.0], abs=1e-15)


def test_the_energy_falls_in_as_many_directions_as_eigenvalues_are_negative():
    rng = np.random.default_rng(11)
    for k in (1, 2, 4):
        for _ in range(10):
            A = rng.normal(size=(k, k))
            J, f, way = A + A.T, rng.normal(size=k), np.empty(k)
            assert sliding.balanced(J, f, way, np.empty((k, k))) == (np.linalg.eigvalsh(-J) < 0.0).sum()
            assert J @ way == pytest.approx(-f, abs=1e-9)


def test_a_warm_step_through_an_eyelet_is_one_iteration_of_all_unknowns():
    """What is in the eyelet is an unknown like the others: as few iterations as of a cable in a ball clip."""
    counts = {}
    for kind in ("ball", "slide"):
        state = Network(Problem(CABLE, scene=held_at((80, kind), shift=(0.0, 0.0, 0.01))))
        shapes = [
            cosserat.solve(
                state.problem.move(START, moved(END, (-1e-3 * k, 0.0, 2e-4 * k), (0.0, 1e-3 * k, 0.0))), state
            )
            for k in range(12)
        ]
        assert all(shape.status is Status.OK for shape in shapes)
        counts[kind] = [shape.iterations for shape in shapes[4:]]
        if kind == "slide":
            arcs = [shape.clips[0].arc_length for shape in shapes]
            assert abs(arcs[-1] - arcs[0]) > 1e-4  # it runs
    assert max(counts["slide"]) <= max(counts["ball"]) + 1


def test_an_eyelet_of_a_failed_step_stays_where_it_was():
    """A step through which the compiled iteration cannot go leaves mesh and solution as they were."""
    state = Network(Problem(CABLE, scene=held_at((80, "slide"), shift=(0.0, 0.0, 0.01))).move(START, END))
    cosserat.solve(state.problem, state)
    before = state.floats.copy(), state.sols[: state.sols.size // 3].copy()
    poses = state.poses.copy()
    poses[-1] = moved(Pose(poses[-1, :3], poses[-1, 3:]), (-0.2, 0.2, 0.3), (2.0, 1.0, 0.0)).array
    state.target[...] = poses
    code = drive.solve(
        state.ints, state.floats, state.sols, state.work, CableShape.new_buffer(150), state.info, np.empty((3, 7)), 150,
        1, False, True, True, 3, math.inf,
    )  # fmt: skip
    assert code != CONVERGED
    assert state.floats == pytest.approx(before[0], abs=0.0)
    assert state.sols[: state.sols.size // 3] == pytest.approx(before[1], abs=0.0)


# -- estimate


def test_estimates_of_random_scenes_are_honest():
    """Thirty scenes, four kinds of clips, soft to stiff; `scripts/bench scene` prints three hundred."""
    rng = np.random.default_rng(3)
    ratios = []
    for _ in range(30):
        cable = CABLE.replace(bending_stiffness=0.01 * np.exp(rng.uniform(-3.0, 3.0)))
        arcs = LENGTH * np.cumsum(rng.dirichlet((4.0, 4.0, 4.0)))[:2]
        spans = np.diff((0.0, *arcs, LENGTH))
        along = np.array((1.0, 0.0, 0.0)) + 0.4 * rng.normal(size=(3, 3))
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        places = np.cumsum((rng.uniform(0.5, 0.98, 3) * spans)[:, None] * along, axis=0)
        kinds = rng.choice(("ball", "fixed", "hinge", "slide"), 2)
        clips = [Clip(s, Pose(r, ALONG_X), kind) for s, r, kind in zip(arcs, places, kinds, strict=False)]
        problem = Problem(cable, scene=Scene(clips=clips)).move(START, Pose(places[2], ALONG_X))
        state = Network(problem)
        shape = cosserat.solve(problem, state)
        assert shape.status is Status.OK
        finer = Problem(cable, scene=Scene(clips=clips), tolerance=1e-8 * LENGTH).move(START, Pose(places[2], ALONG_X))
        fine = cosserat.solve(finer, state)
        assert fine.status is Status.OK
        ratios.append(shape.error_estimate / np.linalg.norm(shape.positions - fine.positions, axis=1).max())
    ratio = np.array(ratios)
    assert (ratio >= 1.0).mean() >= 0.96, np.sort(ratio)
    assert (ratio <= 10.0).mean() >= 0.8, np.sort(ratio)
