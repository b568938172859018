"""Clips at the rod's full order: no clip is the plain cable, errors fall with the sixth power, estimates are honest."""

from __future__ import annotations

import math

import numpy as np
import pytest
from rods import ALONG_X, CABLE, END, LENGTH, START, moved, solved

from cable_shape.kernels import rod_drive, rod_mesh, span_drive, span_slide
from cable_shape.kernels.rod_newton import CONVERGED
from cable_shape.models import clipped, cosserat
from cable_shape.models.rod_state import RodState
from cable_shape.models.span_state import SpanState
from cable_shape.pose import FreeEnd, Grip, Pose
from cable_shape.problem import Problem
from cable_shape.scene import Clip, PointMass, Scene
from cable_shape.shape import CableShape, Status

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


def layers(length: float) -> tuple[np.ndarray, np.ndarray]:
    """A density with half of the nodes near the two ends, and where it is given."""
    x, density = np.empty(129), np.empty(129)
    rod_mesh.layered(length, 0.1 * length, x, density)
    return x, density


def on_spans(state: SpanState, counts: list[int]) -> CableShape:
    """The equilibrium next to the last one on a mesh of `counts` elements a span, to rounding."""
    pieces = []
    for a, b in zip(state.arcs[:-1], state.arcs[1:], strict=True):
        x, density = layers(b - a)
        pieces.append((x + a, density))
    frames = state.frames.copy()
    state._lay_out(pieces, np.array(counts))
    state.history = 1
    points = state.problem.points
    buffer, loads = CableShape.new_buffer(points), np.empty((state.spans - 1, 7))
    for _ in range(4):
        state.target[:] = frames
        code = span_drive.solve(
            state.par, state.mesh, state.sol, state.work, buffer, state.info, state.where, state.mask, state.place,
            state.knots, state.rings, state.acts, state.points, state.table, state.elements, state.forces, state.roll,
            points, 1, False, True, False, 60, math.inf, loads,
        )  # fmt: skip
        assert code == CONVERGED
        state.ran()
    return CableShape(buffer, points, length=LENGTH, model="", status=Status.OK, supports=loads,
                      error_estimate=float(state.info[7]))  # fmt: skip


# -- no clip


@pytest.mark.parametrize("ends", [("clamped", "clamped"), ("swivel", "pinned"), ("clamped", "free")])
@pytest.mark.parametrize("cable", [CABLE, BENT])
def test_one_span_on_the_same_mesh_is_the_plain_cable_to_rounding(cable, ends):
    """Rotations, forces, what is taken off and what is left of the error: by other factors, the same."""
    end = FreeEnd(0.05) if ends[1] == "free" else Grip(END, kind=ends[1])
    masses = Scene(masses=[PointMass(0.5, 0.02)])
    problem = Problem(cable, points=241, scene=masses).move(Grip(START, kind=ends[0]), end)
    plain = RodState(problem)
    first = cosserat.solve(problem, plain)
    assert first.status is Status.OK
    x, density = layers(LENGTH)
    held = plain.ends.copy()
    plain._lay_out(x, density, 24)
    buffer = CableShape.new_buffer(241)
    for _ in range(4):
        plain.target[:] = held
        code = rod_drive.solve(
            plain.par, plain.mesh, plain.sol, plain.work, buffer, plain.info, plain.elements, plain.width, 241, 1,
            False, 60, math.inf,
        )  # fmt: skip
        assert code == CONVERGED
    spans = SpanState(problem, last=first)
    assert clipped.solve(problem, spans).status is Status.OK
    shape = on_spans(spans, [24])
    assert spans.nodes == pytest.approx(plain.mesh[:25], abs=1e-15)
    known = CableShape(buffer, 241, length=LENGTH, model="", status=Status.OK)
    assert shape.positions == pytest.approx(known.positions, abs=1e-10 * LENGTH)
    assert shape.quaternions * np.sign(shape.quaternions[0] @ known.quaternions[0]) == pytest.approx(
        known.quaternions, abs=1e-9
    )
    assert shape.force == pytest.approx(known.force, abs=1e-8 * np.abs(known.force).max())
    assert shape.moment == pytest.approx(known.moment, abs=1e-8 * np.abs(known.moment).max())
    assert spans.info[15:17] == pytest.approx(plain.info[15:17], rel=1e-5)
    assert spans.info[8] == pytest.approx(plain.info[8], abs=1e-10)


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
    state = SpanState(Problem(cable, points=241, tolerance=1e-11 * LENGTH, scene=scene).move(START, END))
    exact = clipped.solve(state.problem, state)
    assert exact.status is Status.OK
    errors, slips = [], []
    for counts in ([6, 6, 6], [12, 12, 12], [24, 24, 24]):
        shape = on_spans(state, counts)
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
    s = np.array((0.0, 0.1, 0.3, 0.4, 0.7, 0.8, 1.0))
    knots, where, rings = np.array((0, 2, 3, 4, 6)), np.array((0, 2, 4, 6)), np.array((1, 2))  # a mass at node 3
    span_slide.respace(s, knots, where, rings, np.array((0.06, -0.04)), 0.5)
    assert s == pytest.approx(np.array((0.0, 0.11, 0.33, 0.4, 0.68, 0.68 + 0.32 / 3.0, 1.0)))


def test_the_energy_falls_in_as_many_directions_as_eigenvalues_are_negative():
    rng = np.random.default_rng(11)
    for k in (1, 2, 4):
        for _ in range(10):
            A = rng.normal(size=(k, k))
            J, f, way = A + A.T, rng.normal(size=k), np.empty(k)
            assert span_slide.balance_eyelets(J, f, way) == (np.linalg.eigvalsh(-J) < 0.0).sum()
            assert J @ way == pytest.approx(-f, abs=1e-9)


def test_a_warm_step_through_an_eyelet_is_one_iteration_of_all_unknowns():
    """What is in the eyelet is an unknown like the others: as few iterations as of a cable in a ball clip."""
    counts = {}
    for kind in ("ball", "slide"):
        state = SpanState(Problem(CABLE, scene=held_at((80, kind), shift=(0.0, 0.0, 0.01))))
        shapes = [
            clipped.solve(
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
    state = SpanState(Problem(CABLE, scene=held_at((80, "slide"), shift=(0.0, 0.0, 0.01))).move(START, END))
    clipped.solve(state.problem, state)
    before = state.mesh.copy(), state.sol[: state.sol.size // 3].copy()
    frames = state.frames.copy()
    frames[-1] = moved(Pose(frames[-1, :3], frames[-1, 3:]), (-0.2, 0.2, 0.3), (2.0, 1.0, 0.0)).array
    state.target[:] = frames
    code = span_drive.solve(
        state.par, state.mesh, state.sol, state.work, CableShape.new_buffer(150), state.info, state.where, state.mask,
        state.place, state.knots, state.rings, state.acts, state.points, state.table, state.elements, state.forces,
        state.roll, 150, 1, False, True, True, 3, math.inf, np.empty((1, 7)),
    )  # fmt: skip
    assert code != CONVERGED
    assert state.mesh == pytest.approx(before[0], abs=0.0)
    assert state.sol[: state.sol.size // 3] == pytest.approx(before[1], abs=0.0)


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
        state = SpanState(problem)
        shape = clipped.solve(problem, state)
        assert shape.status is Status.OK
        finer = Problem(cable, scene=Scene(clips=clips), tolerance=1e-8 * LENGTH).move(START, Pose(places[2], ALONG_X))
        fine = clipped.solve(finer, state)
        assert fine.status is Status.OK
        ratios.append(shape.error_estimate / np.linalg.norm(shape.positions - fine.positions, axis=1).max())
    ratio = np.array(ratios)
    assert (ratio >= 1.0).mean() >= 0.96, np.sort(ratio)
    assert (ratio <= 10.0).mean() >= 0.8, np.sort(ratio)
