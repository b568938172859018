"""A network that settles against drag: where it comes to rest, how fast, over snaps, and the matrix of its steps."""

from __future__ import annotations

import numpy as np
import pytest
from networks import TURNS, Net, Piece, Point, Rod, even, frame_along
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation
from test_network import EI, END, EULER, HEIGHT, LENGTH, REST, START, K, star

import cable_shape as cs
from cable_shape.kernels.network import drive, graph, moving, newton, settle, system, tables
from cable_shape.kernels.network.guess import CURVED, HANGING
from cable_shape.kernels.network.settle import I_DRAG, I_EXCESS, I_FORCE, LARGEST_TURN
from cable_shape.kernels.network.tables import NOW
from cable_shape.solve import cosserat
from cable_shape.solve.network import Network
from cable_shape.solve.problem import Problem
from cable_shape.solve.settle import Settling

ROUND = (1.0, 1.0, 0.0)  # free but for the roll
CLIPS = (
    Point((0.15, 0.05, 0.0), frame_along((1.0, 0.2, 0.0)), TURNS),
    Point((0.35, 0.15, -0.05), frame_along((1.0, 0.3, 0.1))),
    Point((0.5, 0.25, -0.05), frame_along((1.0, 0.3, 0.0)), (0.0, 0.0, 1.0)),
)


def cable(weight: float = 1.0) -> Net:
    return Net([START, END], [Rod((0, 1), [Piece(LENGTH, K, rest=REST, weight=weight)], even(LENGTH, 16))])


def clipped(weight: float = 1.0) -> Net:
    """A ball clip, a fixed one and a hinge."""
    piece = Piece(LENGTH, K, rest=REST, weight=weight)
    return Net([START, *CLIPS, END], [Rod((0, 1, 2, 3, 4), [piece], even(LENGTH, 8, 8, 8, 8))])


def hanging(weight: float = 1.0) -> Net:
    """A free end with a mass."""
    tip = Point(END.place, moves=True, force=(0.0, 0.0, -0.3))
    rod = Rod((0, 1), [Piece(LENGTH, K, rest=REST, weight=weight)], even(LENGTH, 16), untied={(0, 1): TURNS})
    return Net([START, tip], [rod])


def arms(free: tuple[int, ...]):
    """`star` whose junction and arms are pulled another way."""

    def made(weight: float = 1.0) -> Net:
        net = star(8, free)
        for rod in net.rods:
            rod.pieces[0].weight *= weight
        net.fill()
        return net

    return made


#: A network by its weight, the guess that leads to it, and the weight under which it starts: -0.6 turns it over.
SCENES = {
    "grips": (cable, CURVED, 3.0),
    "clips": (clipped, CURVED, 5.0),
    "free end": (hanging, HANGING, -0.6),
    "star": (arms(()), HANGING, -0.6),
    "free arm": (arms((1,)), HANGING, -0.6),
    "fork": (arms((1, 2)), HANGING, -0.6),
}


@pytest.mark.parametrize("scene", SCENES)
def test_it_settles_where_the_cable_is_at_rest(scene):
    """From the shape under another weight: on the discrete static shape itself, and no step adds energy.

    Each saves at least half of what drag takes, since it is a minimum of both together.
    """
    make, kind, weight = SCENES[scene]
    net, pulled, other = make().settle(kind), make(weight), make()
    start(pulled, net)
    assert pulled.solve() == newton.CONVERGED
    start(other, pulled)
    settling = Settling(other.ints, other.floats, other.sols)
    energy, places, saved = [], [settling.places.copy()], []

    def each():
        if energy:
            way = ((settling.places - places[-1]) ** 2).sum(axis=1)
            saved.append(energy[-1] - settling.energy - 0.5 * float(settling.motion.hold @ way))
        energy.append(settling.energy)
        places.append(settling.places.copy())

    way = np.abs(places[0] - Settling(net.ints, net.floats, net.sols, NOW).places).max()
    assert way > 0.01
    assert settling.settle(each=each)
    assert settling.step(settling.dt)
    assert settling.info[I_DRAG] < 1e-10 * settling.info[I_FORCE]
    assert energy[0] - energy[-1] > 1e-6
    assert max(np.diff(energy)) <= 1e-14
    assert min(saved) >= -1e-13
    found = settling.solution()
    assert (Rotation.from_quat(net.now.q).inv() * Rotation.from_quat(found.q)).magnitude().max() < 1e-9
    np.testing.assert_allclose(found.lam, net.now.lam, rtol=0.0, atol=1e-8 * np.abs(net.now.lam).max())
    # no step of the solver at rest is needed, and it says so
    settling.hand_over(other.sols)
    system.assemble(other.ints, other.floats, other.sols, other.work)
    graph.factor(other.ints, other.floats, other.work, 0.0)
    assert graph.solve(other.ints, other.floats, other.work) < 1e-9
    assert other.solve() == newton.CONVERGED
    assert other.info[newton.I_ITERATIONS] <= 2.0
    for rod in range(len(net.rods)):
        np.testing.assert_allclose(other.positions(rod), net.positions(rod), rtol=0.0, atol=1e-8)


def start(net: Net, other: Net) -> None:
    """Puts the solution of another net into the trial of this one."""
    for ours, theirs in zip(net.trial, other.now, strict=True):
        ours[...] = theirs


def test_a_shape_that_is_none_becomes_one():
    """Rotations turned at will between the ends, which then do not meet: the first step sees to it."""
    net = cable().settle()
    turned = Rotation.from_quat(net.now.q)
    bump = 0.5 * np.sin(np.pi * np.linspace(0.0, 1.0, len(turned)))[:, None] * (1.0, 0.6, 0.2)
    net.trial.q[...] = (turned * Rotation.from_rotvec(bump)).as_quat()
    settling = Settling(net.ints, net.floats, net.sols)
    assert settling.settle()
    assert (turned.inv() * Rotation.from_quat(settling.solution().q)).magnitude().max() < 1e-7


@pytest.mark.parametrize("free", [False, True])
@pytest.mark.parametrize("stiff", [1e-1, 1e-2, 1e-3])
def test_it_settles_from_anywhere(stiff, free):
    """Random grips, nearly straight to nearly closed, and rotations that no cable at rest would have."""
    rng = np.random.default_rng(7)
    x = np.linspace(0.0, 1.0, 25)[:, None]
    for _ in range(6):
        frames = [frame_along(rng.standard_normal(3), rng.uniform(-2.0, 2.0)) for _ in range(2)]
        way = rng.standard_normal(3)
        far = way * rng.uniform(0.2, 0.95) / np.linalg.norm(way)
        points = [Point((0.0, 0.0, 0.0), frames[0]), Point(far, frames[1], moves=free)]
        piece, untied = Piece(1.0, (stiff, stiff, 0.7 * stiff)), {(0, 1): TURNS} if free else {}
        net = Net(points, [Rod((0, 1), [piece], even(1.0, 24), untied=untied)])
        net.start(HANGING if free else CURVED)
        bump = sum(np.sin(k * np.pi * x) * rng.standard_normal(3) for k in (1, 2, 3))
        bump = bump + (x * rng.standard_normal(3) if free else 0.0)
        net.trial.q[...] = (Rotation.from_quat(net.trial.q) * Rotation.from_rotvec(0.3 * bump)).as_quat()
        settling, energy = Settling(net.ints, net.floats, net.sols), []
        assert settling.settle(each=lambda s=settling, energy=energy: energy.append(s.energy))
        assert max(np.diff(energy)) <= 1e-12
        settling.hand_over(net.sols)
        assert net.solve() == newton.CONVERGED
        assert net.info[newton.I_EXCESS] == 0.0
        turns = Rotation.from_quat(net.now.q).inv() * Rotation.from_quat(settling.solution().q)
        assert turns.magnitude().max() < 1e-5


# -- rates


ALONG = frame_along((1.0, 0.0, 0.0))
STIFF, TENSION = 0.02, 0.5


def string(elements: int) -> tuple[Net, float, np.ndarray]:
    """A pinned cable under tension; how fast its first mode goes [1/s] with drag 1, and that mode's slopes."""
    give = 1e-7
    ends = Point((0.0, 0.0, 0.0), ALONG), Point((1.0 + give * TENSION, 0.0, 0.0), ALONG)
    piece = Piece(1.0, (STIFF,) * 3, weight=0.0, compliance=(0.0, 0.0, give))
    net = Net(ends, [Rod((0, 1), [piece], even(1.0, elements), untied={(0, 0): ROUND, (0, 1): TURNS})])
    net.trial.lam[...] = (TENSION, 0.0, 0.0)
    return net, STIFF * np.pi**4 + TENSION * np.pi**2, np.cos(np.pi * np.linspace(0.0, 1.0, elements + 1))


def cantilever(elements: int) -> tuple[Net, float, np.ndarray]:
    """The same of a straight cable with a free end."""
    ends = Point((0.0, 0.0, 0.0), ALONG), Point((1.0, 0.0, 0.0), ALONG, moves=True)
    piece = Piece(1.0, (STIFF,) * 3, weight=0.0)
    net = Net(ends, [Rod((0, 1), [piece], even(1.0, elements), untied={(0, 1): ROUND})])
    b, x = 1.8751040687119611, np.linspace(0.0, 1.0, elements + 1)
    ratio = (np.cosh(b) + np.cos(b)) / (np.sinh(b) + np.sin(b))
    return net, STIFF * b**4, np.sinh(b * x) + np.sin(b * x) - ratio * (np.cosh(b * x) - np.cos(b * x))


def growth(net: Net, slopes: np.ndarray, dt: float, steps: int = 12) -> float:
    """[1/s], how fast a small bend of these slopes grows once its other modes are gone."""
    turn = np.zeros((slopes.size, 3))
    turn[:, 0] = 1e-5 * slopes
    net.trial.q[...] = (Rotation.from_quat(net.points[0].rotation) * Rotation.from_rotvec(turn)).as_quat()
    settling = Settling(net.ints, net.floats, net.sols)
    sizes = []
    for _ in range(steps):
        assert settling.step(dt)
        sizes.append(np.linalg.norm(settling.places - settling.places[0] - along(net, settling)))
    return (1.0 - sizes[-2] / sizes[-1]) / dt


def along(net: Net, settling: Settling) -> np.ndarray:
    """(n, 3), the part of the places along the first end's tangent."""
    t = Rotation.from_quat(net.points[0].rotation).apply((0.0, 0.0, 1.0))
    return ((settling.places - settling.places[0]) @ t)[:, None] * t


@pytest.mark.parametrize(("make", "worst"), [(string, 2e-4), (cantilever, 7e-3)])
def test_the_slowest_mode_goes_as_fast_as_it_should(make, worst):
    """c dy/dt = -EI y'''' + T y''; what is missing falls with the square of the mesh width or faster."""
    errors = []
    for elements in (6, 12, 24):
        net, rate, slopes = make(elements)
        errors.append(abs(growth(net, slopes, 1.0 / rate) / rate + 1.0))
    assert errors[1] < worst
    assert errors[0] / errors[1] > 3.8
    assert errors[1] / errors[2] > 3.8


# -- snaps


def column(load: float) -> Net:
    """An upright cable with a load on its free head."""
    up = frame_along((0.0, 0.0, 1.0))
    points = [Point((0.0, 0.0, 0.0), up), Point((0.0, 0.0, HEIGHT), up, moves=True, force=(0.0, 0.0, -load))]
    piece = Piece(HEIGHT, (EI, EI, EI), weight=0.0)
    net = Net(points, [Rod((0, 1), [piece], even(HEIGHT, 12), untied={(0, 1): ROUND})])
    drive.strip(net.ints, net.floats, net.sols)
    return net


def falling(load: float) -> float:
    """[1/s], how fast a column under a dead load P on its head falls at first: c dy/dt = -EI y"" - P y"."""

    def missed(rate: float) -> float:
        root = np.sqrt(complex(load**2 - 4.0 * EI * rate))
        a, b = np.sqrt((load - root) / (2.0 * EI)), np.sqrt((load + root) / (2.0 * EI))
        sin, cos = np.sin((a * HEIGHT, b * HEIGHT)), np.cos((a * HEIGHT, b * HEIGHT))
        # of cos ax - cos bx and of sin ax / a - sin bx / b: slope, second and third derivative at the head
        slope = b * sin[1] - a * sin[0], cos[0] - cos[1]
        bend = b * b * cos[1] - a * a * cos[0], b * sin[1] - a * sin[0]
        third = a**3 * sin[0] - b**3 * sin[1], b * b * cos[1] - a * a * cos[0]
        shear = [EI * third[i] + load * slope[i] for i in range(2)]
        return float(((bend[0] * shear[1] - bend[1] * shear[0]) / root**2).real)

    return float(brentq(missed, 1.0, 1.3))


def test_pivots_tell_up_to_which_step_a_mode_that_grows_is_followed():
    """Beyond Euler's load: the two modes that grow as exp(mu t) count as negative once the step is longer than 1/mu."""
    net = column(1.5 * EULER)
    rate = growth(net, np.sin(0.5 * np.pi * np.linspace(0.0, 1.0, 13)), 1e-2, 40)
    assert rate == pytest.approx(falling(1.5 * EULER), rel=0.02)
    net.trial.q[...] = net.points[0].rotation
    settling = Settling(net.ints, net.floats, net.sols)
    wanted = 3 * 12
    for dt, growing in ((0.98 / rate, 0), (1.02 / rate, 2), (1e6 / rate, 2)):
        settling.motion.hold[:] = settling.motion.drag / dt
        settle.assemble(settling.ints, settling.floats, settling.sols, settling.work, settling.moving)
        negative = moving.factor(settling.ints, settling.floats, settling.work, settling.moving, 0.0)
        assert negative == wanted + growing


def test_a_column_beyond_its_load_falls_to_where_it_is_stable():
    """It leaves the upright, unstable equilibrium that it starts next to, in steps that turn no frame far."""
    net = column(1.5 * EULER)
    turn = np.zeros((13, 3))
    turn[:, 0] = 1e-5 * np.linspace(0.0, 1.0, 13) ** 2
    net.trial.q[...] = (Rotation.from_quat(net.points[0].rotation) * Rotation.from_rotvec(turn)).as_quat()
    settling = Settling(net.ints, net.floats, net.sols)
    energy, turned = [], []

    def each():
        energy.append(settling.energy)
        turned.append(settling.info[settle.I_TURNED])

    assert settling.settle(each=each)
    assert max(np.diff(energy)) <= 1e-14
    assert max(turned) <= LARGEST_TURN
    assert settling.info[I_EXCESS] == 0.0
    assert settling.places[-1, 2] < 0.5 * HEIGHT
    settling.hand_over(net.sols)
    assert net.solve() == newton.CONVERGED
    assert net.info[newton.I_EXCESS] == 0.0
    np.testing.assert_allclose(net.at_nodes(0)[0][-1], settling.places[-1], rtol=0.0, atol=1e-3 * HEIGHT)


def test_a_clamp_that_turns_further_takes_the_arch_through_a_snap():
    """A strip in an arch whose one clamp turns: beyond the fold it swings through, and every step of it is small."""
    strip = (0.05, 0.01, 0.02)

    def clamp(angle: float) -> np.ndarray:
        return (Rotation.from_rotvec((0.0, -angle, 0.0)) * Rotation.from_quat(ALONG)).as_quat()

    ends = Point((0.0, 0.0, 0.0), clamp(0.6)), Point((0.85, 0.0, 0.0), ALONG)
    net = Net(ends, [Rod((0, 1), [Piece(1.0, strip, weight=0.0)], even(1.0, 12))])
    net.settle(CURVED, -0.5)
    settling = Settling(net.ints, net.floats, net.sols, NOW)
    jumps, steps = [], []
    for angle in np.arange(0.6, 1.1, 0.1):
        before = settling.places.copy()
        path = [before]
        settling.poses[0, 3:] = clamp(angle)
        settling.restart()
        assert settling.settle(each=lambda path=path: path.append(settling.places.copy()))
        jumps.append(np.linalg.norm(settling.places - before, axis=1).max())
        steps.append(np.linalg.norm(np.diff(path, axis=0), axis=2).max())
    assert max(jumps) > 0.3
    assert max(steps) < 0.1
    assert settling.jumps == 0
    assert sorted(jumps)[-2] < 0.05
    settling.hand_over(net.sols)
    assert net.solve() == newton.CONVERGED
    assert net.info[newton.I_EXCESS] == 0.0
    assert (net.at_nodes(0)[0][1:-1, 2] > 0.0).all()


def test_a_cable_that_the_search_tells_to_have_snapped_falls_to_the_same_shape():
    """A round strip whose clamps turn: at the fold it leaves its plane, of which it knows nothing by itself."""

    def ends(tilt: float) -> tuple[cs.Pose, cs.Pose]:
        out = []
        for x, sign in ((0.0, 1.0), (0.9, -1.0)):
            turn = Rotation.from_rotvec((0.0, sign * (tilt * (1.02 if sign > 0.0 else 1.0) - 0.6), 0.0))
            out.append(cs.Pose((x, 0.0, 0.0), (turn * Rotation.from_quat((0.5, 0.5, 0.5, 0.5))).as_quat()))
        return out[0], out[1]

    cable = cs.Cable(length=1.0, linear_density=0.0, bending_stiffness=0.02, twisting_stiffness=0.015)
    problem = Problem(cable).move(*ends(0.56))
    network = Network(problem)
    assert cosserat.solve(problem, network).status is cs.Status.OK
    settling = Settling(network.ints, network.floats, network.sols, NOW)
    path, energy, shape = [settling.places.copy()], [], None

    def each():
        path.append(settling.places.copy())
        energy.append(settling.energy)

    for tilt in (0.57, 0.58, 0.59, 0.6):
        problem.move(*ends(tilt))
        shape = cosserat.solve(problem, network)
    assert shape is not None
    assert shape.status is cs.Status.SNAPPED
    settling.poses[...] = network.poses
    assert settling.settle(each=each)
    assert settling.jumps == 0
    assert max(np.diff(energy)) <= 1e-12
    assert np.linalg.norm(path[-1] - path[0], axis=1).max() > 0.3
    assert np.linalg.norm(np.diff(path, axis=0), axis=2).max() < 0.12
    there = np.stack([np.interp(settling.model.s, shape.arc_length, x) for x in shape.positions.T], axis=1)
    np.testing.assert_allclose(settling.places, there, rtol=0.0, atol=1e-3)


# -- the matrix


def rows_of(settling: Settling, G: np.ndarray, slack: np.ndarray) -> np.ndarray:
    """All rows of the system as unknowns have them: free rotations, forces, rotations and places of knots."""
    plan, model, motion = settling.plan, settling.model, settling.motion
    G, turns, pulls = G.copy(), np.zeros((len(plan.vertices), 3)), -model.force.copy()
    for j, ends in enumerate(plan.ends):
        lam = motion.lam[plan.first[j : j + 2] - (0, 1)]
        for end, knot in enumerate(ends):
            node = plan.first[j + end] + j
            pulls[knot] += motion.hold[node] * (motion.place[node] - motion.origin[node])
            pulls[knot] += lam[1] if end == 1 else -lam[0] - motion.weight[j]
            if plan.tied[j, end]:
                T = np.array(graph.to_knot.py_func(plan, model, j, end)).reshape(3, 3)
                turns[knot] += T @ G[node]
                G[node] = 0.0
    pulls[plan.vertices[:, 1] < 0] = 0.0
    return np.concatenate([part.ravel() for part in (G, slack, turns, pulls)])


@pytest.mark.parametrize("scene", SCENES)
def test_a_step_is_what_differences_ask_for(scene):
    """To any right-hand side the factors answer with the step along which the residual changes by minus that."""
    make, kind, _ = SCENES[scene]
    net, rng = make().settle(kind), np.random.default_rng(1)
    one = Settling(net.ints, net.floats, net.sols, NOW)
    arrays = one.ints, one.floats, one.sols, one.work, one.moving
    space = tables.work_of.py_func(one.ints, one.work)
    one.motion.hold[:] = one.motion.drag / 0.05
    settle.assemble(*arrays)
    assert moving.factor(one.ints, one.floats, one.work, one.moving, 0.0) == 3 * one.motion.lam.shape[0]
    at_rest = rows_of(one, space.G, one.motion.slack)
    space.G[...] = rng.standard_normal(space.G.shape)
    system.release.py_func(one.plan, one.model, space.G)
    one.motion.slack[...] = rng.standard_normal(one.motion.slack.shape)
    asked = rows_of(one, space.G, one.motion.slack)
    moving.solve(one.ints, one.floats, one.work, one.moving)
    sols, lam, step, work = one.sols.copy(), one.motion.lam.copy(), one.motion.step.copy(), one.work.copy()
    found = []
    for eps in (1e-7, -1e-7):
        one.sols[:], one.work[:] = sols, work
        newton.advance(one.ints, one.sols, one.work, eps)
        one.motion.lam[...] = lam + eps * step
        settle.assemble(*arrays)
        found.append(rows_of(one, space.G, one.motion.slack))
    slope = (found[0] - found[1]) / 2e-7
    wanted = asked.copy()
    wanted[-3 * len(net.points) :] = at_rest[-3 * len(net.points) :]
    scale = max(1.0, np.abs(step).max(), np.abs(work).max() * 1e-3)
    np.testing.assert_allclose(slope, -wanted, rtol=0.0, atol=1e-6 * scale)
