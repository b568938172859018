"""The rod in its plane, beside the rod in space: the same answers, and where each of them is taken."""

from __future__ import annotations

import math

import numpy as np
import pytest
from rods import ALONG_X, CABLE, LENGTH, moved
from scipy.spatial.transform import Rotation

import cable_shape as cs
from cable_shape.clearance import ClearanceChecker
from cable_shape.kernels import (
    planar_across,
    planar_element,
    planar_lanes,
    planar_response,
    planar_system,
    response,
    rod_element,
)
from cable_shape.margins import MarginWatch
from cable_shape.models import cosserat
from cable_shape.models.rod_state import RodState
from cable_shape.problem import Problem
from cable_shape.report import WarningKind

NUMBERS = ("positions", "quaternions", "curvature", "force", "moment")
START, ACROSS = cs.Pose((0, 0, 0), ALONG_X), cs.Pose((0.8, 0, 0), ALONG_X)


def pair(cable: cs.Cable, **options) -> list[RodState]:
    """Memories for the same cable: one may solve in a plane, one may not."""
    return [RodState(Problem(cable, **options), in_plane=allowed) for allowed in (True, False)]


def both(states: list[RodState], start, end) -> list[cs.CableShape]:
    """The shapes by the two."""
    shapes = [cosserat.solve(state.problem.move(start, end), state) for state in states]
    assert not states[1].planar
    return shapes


def furthest(a: cs.CableShape, b: cs.CableShape) -> float:
    """Of a length."""
    return float(np.abs(a.positions - b.positions).max()) / a.length


def same(a: cs.CableShape, b: cs.CableShape, tolerance: float) -> None:
    """All that two shapes say, within `tolerance` of its size."""
    for name in NUMBERS:
        x, y = getattr(a, name), getattr(b, name)
        assert np.abs(x - y).max() <= tolerance * max(1e-3, np.abs(y).max()), name
    assert a.energy == pytest.approx(b.energy, rel=tolerance, abs=tolerance * 1e-3)
    assert (a.status, a.turns) == (b.status, b.turns)
    assert a.twist == pytest.approx(b.twist, abs=tolerance)


def motion(steps: int = 40) -> list[cs.Pose]:
    """End poses in the plane y = 0, the end lifted and pitched."""
    x = np.arange(1, steps + 1) / steps
    return [moved(ACROSS, (-0.2 * a, 0, 0.1 * math.sin(math.pi * a) + 0.1 * a), (0, -0.7 * a, 0)) for a in x]


# -- the element


def random_element(seed: int) -> tuple[tuple, tuple]:
    """Arguments of a planar element, and of the same one in space: tangent z and normal y in both frames."""
    rng = np.random.default_rng(seed)
    C = (0.0, 0.0) if seed % 2 else tuple(rng.uniform(0.0, 0.05, 2).tolist())
    K = tuple((0.01 * rng.uniform(0.5, 2.0, 3)).tolist())
    angles = rng.uniform(-3.0, 3.0) + np.array((0.0, rng.uniform(-1.2, 1.2)))
    z = [(math.cos(a / 2), math.sin(a / 2)) for a in angles]
    if seed % 3 == 0:
        z[1] = (-z[1][0], -z[1][1])
    n = [tuple(row) for row in (2.0 * rng.normal(size=(3, 2))).tolist()]
    k0, k1 = (rng.normal(size=2) * (2.0, 5.0)).tolist()
    h = float(rng.uniform(0.02, 0.2))
    space = (
        h, *((0.0, b, 0.0, a) for a, b in z), *((b, 0.0, a) for a, b in n), (0.0, k0, 0.0), (0.0, k1, 0.0), K,
        (C[1], C[1], C[0]),
    )  # fmt: skip
    return (h, *z, *n, k0, k1, K, C), space


IN_PLANE = np.array(((0, 0, 1), (1, 0, 0)))  # from world axes to the plane's


@pytest.mark.parametrize("seed", range(12))
def test_a_planar_element_is_that_of_space_without_what_leaves_the_plane(seed):
    (*arguments, K, C), space = random_element(seed)
    value, g1, g2, gl = rod_element.element_gradient(*space)
    got = planar_element.element_gradient(*arguments, K[1], C)
    near = {"rel": 1e-11, "abs": 1e-13}
    assert got[0] == pytest.approx(value, **near)
    assert got[1:3] == pytest.approx((g1[1], g2[1]), **near)
    assert got[3] == pytest.approx(IN_PLANE @ gl, **near)
    g1, g2, gl, H11, H12, H22, B1, B2, CC = (np.array(x) for x in rod_element.element_hessian(*space))
    H = [x.reshape(3, 3) for x in (H11, H12, H22)]
    B1, B2, CC = B1.reshape(3, 3), B2.reshape(3, 3), CC.reshape(3, 3)
    got = planar_element.element_hessian(*arguments, K[1], C)
    assert (*got[:2], *got[3:6]) == pytest.approx((g1[1], g2[1], *(x[1, 1] for x in H)), **near)
    assert got[2] == pytest.approx(IN_PLANE @ gl, **near)
    assert got[6] == pytest.approx(IN_PLANE @ B1[1], **near)
    assert got[7] == pytest.approx(IN_PLANE @ B2[1], **near)
    assert got[8] == pytest.approx((IN_PLANE @ CC @ IN_PLANE.T)[np.triu_indices(2)], **near)
    # rotations about nu = d1 and the tangent d3, and the force along the normal: nothing couples them to the plane
    got = planar_across.element_across(*arguments, K[1], K[0], K[2], C)
    out = (0, 2)
    for x, y in zip(got[:3], H, strict=True):
        assert x == pytest.approx(y[np.ix_(out, out)].ravel(), **near)
        assert np.abs(y[out, 1]).max() < 1e-15
    assert (*got[3], *got[4]) == pytest.approx((*B1[out, 1], *B2[out, 1]), **near)
    assert got[5] == pytest.approx(CC[1, 1], **near)


def test_the_series_of_a_turn_are_those_of_its_arcsine():
    x = np.linspace(1e-6, planar_lanes.NEAR, 500)
    v, w = np.sqrt(x), np.sqrt(1.0 - x)
    got = np.array([planar_lanes.near_series(y) for y in x.tolist()])
    assert got[:, 0] == pytest.approx(2.0 * np.arcsin(v) / v, rel=4e-16)
    long = x > 0.01  # nearer to 0 the difference cancels
    assert got[long, 1] == pytest.approx((1.0 / w - np.arcsin(v) / v)[long] / x[long], rel=1e-13)
    assert planar_lanes.near_series(0.0) == pytest.approx((2.0, 1.0 / 3.0), rel=1e-15)


def test_elements_side_by_side_are_those_one_by_one():
    cases = [random_element(2 * seed)[0] for seed in range(planar_lanes.LANES)]
    lanes = np.zeros((planar_across.ROWS, planar_lanes.LANES))
    turned = [1.0 - np.dot(a[1], a[2]) ** 2 for a in cases]
    assert min(turned) < planar_lanes.NEAR < max(turned)
    K, C = cases[0][-2:]
    given = np.array([np.hstack(a[:-2]) for a in cases]).T
    one_by_one = [planar_element.element_gradient(*a[:-2], K[1], C) for a in cases]
    lanes[:13] = given
    planar_lanes.gradients(lanes.ravel(), K[1], C)
    rows = [planar_lanes.VALUE, planar_lanes.G1, planar_lanes.G2, planar_lanes.GL, planar_lanes.GL + 1]
    near = {"rel": 1e-12, "abs": 1e-14}
    assert pytest.approx(np.array([np.hstack(x) for x in one_by_one]), **near) == lanes[rows].T
    one_by_one = [planar_element.element_hessian(*a[:-2], K[1], C) for a in cases]
    lanes[:13] = given
    planar_lanes.hessians(lanes.ravel(), K[1], C)
    assert (
        pytest.approx(np.array([np.hstack(x) for x in one_by_one]), **near)
        == lanes[planar_lanes.G1 : planar_lanes.ROWS].T
    )
    one_by_one = [planar_across.element_across(*a[:-2], K[1], K[0], K[2], C) for a in cases]
    lanes[:13] = given
    planar_across.blocks(lanes.ravel(), K[1], K[0], K[2], C)
    assert pytest.approx(np.array([np.hstack(x) for x in one_by_one]), **near) == lanes[planar_across.FIRST :].T


@pytest.mark.parametrize("held", [True, False])
@pytest.mark.parametrize("seed", range(8))
def test_inertias_in_and_out_of_the_plane_are_those_of_dense_matrices(seed, held):
    rng = np.random.default_rng(seed)
    n, K, across, GJ, C = 9, 0.01, 0.006, 0.004, (0.0, 0.0)
    h = rng.uniform(0.05, 0.2, n)
    half = np.cumsum(rng.normal(size=n + 1)) * 0.2
    z = np.column_stack((np.cos(half), np.sin(half)))
    load, rest, shift = rng.normal(size=(n, 6)), rng.normal(size=(n, 2)), 0.02
    lam = (0.3, 4.0 * rng.normal())
    last = n - 1 if held else n
    mean = 0.5 * (np.append(h, 0.0) + np.append(0.0, h))[1 : last + 1]
    plane, out = np.zeros((n + 3, n + 3)), np.zeros((2 * n + 3, 2 * n + 3))
    for e in range(n):
        forces = planar_system.forces(load, e, lam)
        arguments = (h[e], tuple(z[e]), tuple(z[e + 1]), *forces, *rest[e])
        _, _, _, H11, H12, H22, B1, B2, CC = planar_element.element_hessian(*arguments, K, C)
        a, b, border = [e], [e + 1], [n + 1, n + 2]
        for i, j, block in (
            (a, a, H11), (a, b, H12), (b, a, H12), (b, b, H22), (a, border, [B1]), (b, border, [B2]),
            (border, a, np.transpose([B1])), (border, b, np.transpose([B2])),
            (border, border, [[CC[0], CC[1]], [CC[1], CC[2]]]),
        ):  # fmt: skip
            plane[np.ix_(i, j)] += block
        H11, H12, H22, B1, B2, CC = planar_across.element_across(*arguments, K, across, GJ, C)
        a, b, border = [2 * e, 2 * e + 1], [2 * e + 2, 2 * e + 3], [2 * n + 2]
        H12 = np.reshape(H12, (2, 2))
        for i, j, block in (
            (a, a, np.reshape(H11, (2, 2))), (a, b, H12), (b, a, H12.T), (b, b, np.reshape(H22, (2, 2))),
            (a, border, np.transpose([B1])), (b, border, np.transpose([B2])), (border, a, [B1]), (border, b, [B2]),
            (border, border, CC),
        ):  # fmt: skip
            out[np.ix_(i, j)] += block
    keep = list(range(1, last + 1)) + ([n + 1, n + 2] if held else [])
    plane[range(1, last + 1), range(1, last + 1)] += shift * mean
    rows, parts, sums = np.zeros((n + 1, 9)), np.zeros((n, 16)), np.zeros(12)
    planar_system.assemble(z, lam, h, load, rest, K, C, rows, parts, sums)
    negative = planar_system.factor(h, shift, last, rows, parts, sums)
    step, more = planar_system.border(held, sums)
    assert negative + more == (np.linalg.eigvalsh(plane[np.ix_(keep, keep)]) < 0.0).sum()
    sums[9:11] = (0.3, -0.2)
    rows[:, planar_system.G] = rng.normal(size=n + 1)
    planar_system.forward(last, rows, parts, sums)
    step, _ = planar_system.border(held, sums)
    planar_system.backward(last, step, rows, parts)
    side = np.append(rows[1 : last + 1, planar_system.G], sums[9:11] if held else [])
    solution = np.append(rows[1 : last + 1, planar_system.CHANGE], step if held else [])
    assert plane[np.ix_(keep, keep)] @ solution == pytest.approx(-side, abs=1e-9 * np.abs(solution).max())
    keep = list(range(2, 2 * last + 2)) + ([2 * n + 2] if held else [])
    diagonal = range(2, 2 * last + 2)
    out[diagonal, diagonal] += shift * np.repeat(mean, 2)
    expected = (np.linalg.eigvalsh(out[np.ix_(keep, keep)]) < 0.0).sum() - held
    kept = np.full((n + 1, planar_across.COLUMNS), np.nan)
    assert planar_across.excess_across(z, lam, h, load, rest, K, across, GJ, C, shift, held, kept) == expected
    sides, changes = [planar_across.G1, planar_across.G2], [planar_across.D1, planar_across.D2]
    side = rng.normal(size=(last, 2))
    kept[1 : last + 1, sides] = side
    step = planar_across.respond_across(last, held, -0.4, kept)
    solution = np.append(kept[1 : last + 1, changes], [step] if held else [])
    side = np.append(side, [-0.4] if held else [])
    assert out[np.ix_(keep, keep)] @ solution == pytest.approx(-side, abs=1e-9 * np.abs(solution).max())


# -- whole shapes


def test_a_planar_motion_is_solved_in_its_plane_and_to_rounding_as_in_space():
    states = pair(CABLE)
    for end in (ACROSS, *motion()):
        planar, spatial = both(states, START, end)
        assert states[0].planar
        assert states[0].elements == states[1].elements
        assert planar.iterations == spatial.iterations
        same(planar, spatial, 1e-12)
        assert planar.error_estimate == pytest.approx(spatial.error_estimate, rel=1e-5)
        assert planar.residual == pytest.approx(spatial.residual, rel=1e-5)


class RandomCase:
    """A cable, loads and ends in a random plane of the world; pose(position in the plane, angle) makes the ends."""

    def __init__(self, seed: int) -> None:
        rng = np.random.default_rng(seed)
        self.world = Rotation.random(rng=rng)
        length, ei = rng.uniform(0.5, 2.0), 10 ** rng.uniform(-3.0, -0.5)
        ribbon = rng.random() < 0.5
        self.roll = Rotation.from_euler("z", math.pi / 2 * rng.integers(4) if ribbon else rng.uniform(0, 2 * math.pi))
        normal = (Rotation.from_quat(ALONG_X) * self.roll).inv().apply((0.0, 1.0, 0.0))
        rest = ((0, 0, 0), 1.5 / length * rng.normal() * normal, np.outer(1.5 / length * rng.normal(size=5), normal))
        self.cable = cs.Cable(
            length=length,
            linear_density=10 ** rng.uniform(-2.0, 0.0),
            bending_stiffness=(ei, ei * rng.uniform(0.4, 3.0) if ribbon else ei),
            twisting_stiffness=ei * rng.uniform(0.4, 1.5),
            rest_curvature=rest[rng.choice(3, p=(0.6, 0.2, 0.2))],
            axial_stiffness=10 ** rng.uniform(1.5, 4.0) if rng.random() < 0.4 else None,
            shear_stiffness=10 ** rng.uniform(1.5, 4.0) if rng.random() < 0.2 else None,
        )
        masses = [cs.PointMass(length * rng.uniform(0.1, 0.9), 0.1 * rng.random()) for _ in range(rng.integers(3))]
        self.options = {
            "gravity": 9.81 * self.direction(rng.uniform(0, 2 * math.pi)),
            "scene": cs.Scene(masses=masses) if masses else None,
            "distributed_load": rng.normal(size=(2, 1)) * self.direction(rng.uniform(0, 7)) if seed % 3 == 0 else None,
        }
        self.free = cs.FreeEnd(0.05 * rng.random(), 0.2 * self.direction(rng.uniform(0, 7))) if seed % 5 == 0 else None
        chord, self.along = rng.uniform(0.5, 0.95) * length, rng.uniform(0, 2 * math.pi)
        self.tangents = self.along + 0.5 * rng.normal(size=2)
        self.end = chord * self.direction(self.along)
        self.speed = rng.normal(size=4) * (0.02, 0.02, 0.05, 0.05)

    def direction(self, angle: float) -> np.ndarray:
        """In the plane, world axes."""
        return np.asarray(self.world.apply((math.cos(angle), 0.0, math.sin(angle))))

    def ends(self, k: int) -> tuple:
        """Of the motion's step k."""
        a, b = (
            (self.world * Rotation.from_euler("y", -angle) * Rotation.from_quat(ALONG_X) * self.roll).as_quat()
            for angle in self.tangents + k * self.speed[2:]
        )
        shift = self.cable.length * k * self.speed[:2]
        place = self.end + shift[0] * self.direction(self.along) + shift[1] * self.direction(self.along + math.pi / 2)
        return cs.Pose((0, 0, 0), a), cs.Pose(place, b) if self.free is None else self.free


def test_random_planar_problems_have_the_same_shapes_and_stability_as_in_space():
    fired = buckled = on_same_mesh = 0
    for seed in range(150):
        case = RandomCase(seed)
        states = pair(case.cable, **case.options)
        for k in range(4):
            planar, spatial = both(states, *case.ends(k))
            assert planar.status is spatial.status, seed
            # where space shifts the iteration for what happens out of the plane, its last step is another one
            assert furthest(planar, spatial) <= 1e-6, seed
            across = np.abs(case.world.inv().apply(spatial.positions)[:, 1]).max() / case.cable.length
            assert not states[0].planar or across < 1e-6, seed
            fired += states[0].planar
            buckled += across > 1e-3
        for _ in range(3):  # at rest, nothing is left of the way there
            planar, spatial = both(states, *case.ends(3))
        nodes = [state.mesh[: state.elements + 1] for state in states]
        if states[0].planar and np.array_equal(*nodes):
            on_same_mesh += 1
            same(planar, spatial, 1e-9)
    assert fired > 400
    assert buckled > 100
    assert on_same_mesh > 45


@pytest.mark.parametrize("load", [0.99, 1.01])
def test_a_ribbon_leaves_its_plane_where_it_buckles_sideways(load):
    """Michell and Prandtl: a cantilever with a dead load P at its tip does at P L^2 = 4.0126 sqrt(EI GJ)."""
    ribbon = cs.Cable(1.0, 0.0, (1.0, 1e4), 0.8)  # under the load it bends about d2, hardly
    root = cs.Pose((0, 0, 0), (0, math.sqrt(0.5), 0, math.sqrt(0.5)))  # d1 = -z, d3 = x
    states = pair(ribbon, gravity=(0, 0, 0))
    planar, spatial = both(states, root, cs.FreeEnd(force=(0, 0, -load * 4.012599 * math.sqrt(0.8))))
    assert states[0].planar == (load < 1.0)
    assert planar.status is spatial.status
    assert (np.abs(planar.positions[:, 1]).max() > 1e-3) == (load > 1.0)
    same(planar, spatial, 1e-7)


def test_a_motion_leaves_its_plane_and_comes_back_without_a_jump():
    states = pair(CABLE)
    path = motion(20)
    fired, last = [], None
    for k, end in enumerate(path):
        tilt = {8: 1e-6, 9: 2e-6, 10: 1e-6}.get(k, 0.0)
        planar, spatial = both(states, START, moved(end, turn=(0.0, 0.0, tilt)))
        fired.append(states[0].planar)
        assert planar.iterations == spatial.iterations
        same(planar, spatial, 1e-10)
        if k == 8:
            flat = cosserat.solve(Problem(CABLE).move(START, end))
            assert 1e-8 < furthest(planar, flat) < 2e-6
        if last is not None:
            assert furthest(planar, last) < 0.05
        last = planar
    assert fired == [k not in (8, 9, 10) for k in range(20)]


def test_what_no_plane_holds_is_solved_in_space():
    bent, kinked, wavy, wound = (  # the plane's normal is d1
        cs.Cable(LENGTH, 0.1, 0.01, 0.008, rest_curvature=rest)
        for rest in ((0.5, 0, 0), (0.5, 0.5, 0), ((0.5, 0, 0), (0, 0, 0), (-1, 0, 0)), ((0.5, 0, 0), (0, 0.5, 0)))
    )
    weighed = cs.Scene(masses=[cs.PointMass(0.5, 0.1)])
    skew = cs.Cable(LENGTH, 0.1, (0.01, 0.02), 0.008)
    rolled = [moved(pose, turn=(0.3, 0, 0)) for pose in (START, ACROSS)]
    for cable, start, end, options, planar in (
        (CABLE, START, ACROSS, {}, True),
        (CABLE, *rolled, {}, True),  # round: any roll will do
        (skew, START, ACROSS, {}, True),
        (skew, *rolled, {}, False),
        (CABLE, START, moved(ACROSS, turn=(1e-6, 0, 0)), {}, False),  # twisted
        (CABLE, START, moved(ACROSS, (0, 1e-6, 0)), {}, False),
        (CABLE, START, motion()[9], {"gravity": (0, 1e-6, -9.81)}, False),
        (CABLE, START, ACROSS, {"distributed_load": ((0, 0.1, 0), (0, 0, 0))}, False),
        (CABLE, START, ACROSS, {"distributed_load": ((0.1, 0, 0), (0, 0, 0.1)), "scene": weighed}, True),
        (CABLE, START, ACROSS, {"distributed_load": ((0.1, 0, 0), (0, 0.1, 0.1)), "scene": weighed}, False),
        (bent, START, ACROSS, {}, True),
        (wavy, START, ACROSS, {}, True),
        (kinked, START, ACROSS, {}, False),
        (wound, START, ACROSS, {}, False),
        (CABLE, START, cs.Grip(ACROSS, kind="swivel"), {}, False),
        (CABLE, START, cs.Pose(ACROSS.position, ALONG_X, turns=1), {}, False),
        (CABLE, START, cs.FreeEnd(force=(0.1, 0, 0.1)), {}, True),
        (CABLE, START, cs.FreeEnd(moment=(0, 1e-3, 0)), {}, False),
    ):
        state = RodState(Problem(cable, **options))
        assert cosserat.solve(state.problem.move(start, end), state).status
        assert state.planar == planar, (cable, end, options)


def test_sensitivities_eigenvalue_and_energy_do_not_tell_how_the_shape_was_found():
    scene = cs.Scene(masses=[cs.PointMass(0.5, 0.02)])
    states = pair(CABLE, scene=scene)
    for end in motion(5):
        planar, spatial = both(states, START, end)
    assert states[0].planar
    assert planar.energy == pytest.approx(spatial.energy, abs=1e-13)
    for which in (0, 1):
        assert states[0].node_positions()[which] == pytest.approx(states[1].node_positions()[which], abs=1e-13)
    a, b = (cosserat.sensitivity(state) for state in states)
    assert a == pytest.approx(b, abs=1e-10)
    assert np.abs(b[:, 1]).max() > 0.1, "out of the plane, too"
    assert cosserat.smallest_eigenvalue(states[0]) == pytest.approx(cosserat.smallest_eigenvalue(states[1]), rel=1e-9)


@pytest.mark.parametrize("stiffness", [0.01, (0.01, 0.02), (0.012, 0.01)])
@pytest.mark.parametrize("held", [True, False])
def test_planar_factors_tell_stability_and_velocities_in_space(stiffness, held):
    """Against spatial factors made anew, and the sensitivity: out of the plane, too."""
    state = pair(CABLE.replace(bending_stiffness=stiffness), scene=cs.Scene(masses=[cs.PointMass(0.5, 0.01)]))[0]
    state.par[18] *= 1e-6  # the factors' shift, of which fresh ones have next to nothing
    tilted = moved(START, turn=(0.0, 0.3, 0.0))
    for end in motion(6)[:3]:
        for _ in range(4):  # at rest, so that the factors are those of the solution
            shape = cosserat.solve(state.problem.move(tilted, end if held else None), state)
        assert state.factor()
        rod, sizes = (state.par, state.mesh, state.sol), (state.elements, state.width)
        modes = [np.random.default_rng(1).normal(size=(state.elements + 1, 3)) for _ in range(2)]
        twists = np.random.default_rng(2).normal(size=12)
        told = planar_response.smallest_eigenvalue(state.par, state.mesh, state.work, *sizes, modes[0], 40)
        v = planar_response.velocities(*rod, state.work, *sizes, twists, shape.arc_length)
        exact = response.smallest_eigenvalue(*rod, state.work.copy(), *sizes, modes[1], 40, True)
        assert told[0] == pytest.approx(exact[0], rel=1e-7)
        assert told[1] == exact[1]
        assert modes[0] == pytest.approx(modes[1], abs=1e-4)
        expected = cosserat.sensitivity(state) @ twists
        assert v == pytest.approx(expected, abs=1e-8)
        assert np.abs(expected[:, 1]).max() > 0.1, "out of the plane"


def test_margins_after_a_planar_solve_are_those_after_a_spatial_one():
    """Those of bodies, too, which are not all in the plane."""
    low = cosserat.solve(Problem(CABLE).move(START, motion(12)[0]), RodState(Problem(CABLE))).positions
    balls = [cs.Obstacle(str(k), cs.Sphere(0.01), cs.Pose(low[k] + (0.0, 0.02, -0.03))) for k in (30, 75, 120)]
    cable, scene = CABLE.replace(max_tension=20.0), cs.Scene(obstacles=balls)
    watches = [MarginWatch(cable, scene) for _ in range(2)]
    states, checker = pair(cable), ClearanceChecker(scene, radius=0.004)
    for k, end in enumerate(motion(12)):
        found = []
        for state, watch, shape in zip(states, watches, both(states, START, end), strict=True):
            found.append(watch.margins(shape, checker.check(shape), 10_000_000 * k, state=state, ends=(START, end)))
        assert states[0].factor() == (k > 0), "spatial factors at first, when the softest mode is not known"
        assert [(a.kind, a.other) for a in found[0]] == [(b.kind, b.other) for b in found[1]]
        for a, b in zip(*found, strict=True):
            # what is left of the mode's noise, and of factors nearly those of the solution
            assert a[1:5] == pytest.approx(b[1:5], rel=1e-3), (k, a.kind)
            if k > 1:  # to stability it is a difference of what is left of the noise
                near = 0.2 if a.kind is WarningKind.STABILITY else 1e-3
                assert a.time_to_limit == pytest.approx(b.time_to_limit, rel=near), (k, a.kind)


def test_what_else_uses_the_rods_memory_does_not_change_its_stability():
    """A sensitivity between a planar solve and its margins writes where the planar solver has left its factors."""
    states = pair(CABLE)[:1]
    watches = [MarginWatch(CABLE, cs.Scene()) for _ in range(2)]
    ask = (lambda state: None, cosserat.sensitivity, cosserat.smallest_eigenvalue)
    for k, end in enumerate(motion(6)):
        shape = cosserat.solve(states[0].problem.move(START, end), states[0])
        watches[0].margins(shape, cs.Clearance(), 10_000_000 * k, state=states[0])
        ask[k % 3](states[0])
        watches[1].margins(shape, cs.Clearance(), 10_000_000 * k, state=states[0])
        assert states[0].factor() == (k % 3 == 0 and k > 0)
        assert watches[1].stability.value == pytest.approx(watches[0].stability.value, rel=1e-3), k


def test_a_report_counts_what_was_solved_in_a_plane():
    cycle = cs.Cycle(CABLE, model="cosserat")
    ends = (ACROSS, moved(ACROSS, (0, 0, 0.01)), moved(ACROSS, (0, 0, 0.01)), moved(ACROSS, (0, 0.01, 0.01)))
    counts = [cycle.step({"cable": (START, end)}, stamp=k).skipped["spatial_solves"] for k, end in enumerate(ends)]
    assert counts == [1, 1, 0, 0]  # the third is the second again
