"""Networks of rods: junctions, free arms, tapers and jumps of stiffness, against one cable and against collocation."""

from __future__ import annotations

import math
import sys

import collocation
import numpy as np
import pytest
import stars
from networks import HELD, REVERSED, STRAIGHT_ON, TURNS, Net, Piece, Point, Rod, even, frame_along
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation
from stars import FAR, LENGTHS, WEIGHTS

from cable_shape.kernels.network import system
from cable_shape.kernels.network.drive import I_ESTIMATE, I_OFF
from cable_shape.kernels.network.guess import CURVED, HANGING
from cable_shape.kernels.network.newton import CONVERGED, I_EXCESS

LENGTH = 1.2
K = (0.01, 0.015, 0.008)
REST = np.array((1.0, 0.5, 0.2))
START = Point((0.0, 0.0, 0.0), frame_along((1.0, 0.0, 0.3)))
END = Point((0.7, 0.3, -0.1), frame_along((1.0, 0.5, 0.5), 0.4))


def joined(net: Net, *rods: tuple[int, bool]) -> tuple[np.ndarray, ...]:
    """Positions, forces, moments of rods that follow each other as if they were one; True: the rod runs backwards."""
    columns: list[list[np.ndarray]] = [[], [], []]
    for i, (rod, backwards) in enumerate(rods):
        step, sign = (-1, -1.0) if backwards else (1, 1.0)
        found = net.positions(rod), sign * net.forces(rod), sign * net.moments(rod)
        for column, rows in zip(columns, found, strict=True):
            column.append(rows[::step][i > 0 :])
    return tuple(np.concatenate(column) for column in columns)


def assert_same(one: tuple[np.ndarray, ...], other: tuple[np.ndarray, ...], within: float = 1e-9) -> None:
    """Positions to `within` of the length, forces of EI / L^2, moments of EI / L."""
    for a, b, unit in zip(one, other, (LENGTH, K[0] / LENGTH**2, K[0] / LENGTH), strict=True):
        assert np.abs(a - b).max() <= within * unit


# -- two arms are one cable


@pytest.fixture(scope="module")
def one_cable():
    net = Net([START, END], [Rod((0, 1), [Piece(LENGTH, K, rest=REST)], even(LENGTH, 80))]).settle()
    return net, (net.positions(0), net.forces(0), net.moments(0))


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("reverse", [False, True])
def test_two_arms_in_a_junction_are_one_cable(one_cable, turned, reverse):
    """Whatever frame the junction has, and where the second arm ends in it and its data run backwards.

    What Newton's method finds is the same to rounding; corrections, which land to the right, are to their own order.
    """
    own = Rotation.from_rotvec((0.4, -1.1, 0.7) if turned else HELD)
    along = Rotation.from_quat(frame_along((1.0, 0.3, 0.0)))
    junction = Point((0.4, 0.2, -0.3), (along * own.inv()).as_quat(), TURNS, True)
    second = own * Rotation.from_quat(REVERSED) if reverse else own
    frames = ({(0, 1): own.as_quat()}, {(0, int(reverse)): second.as_quat()}) if turned or reverse else ({}, {})
    half = Piece(LENGTH / 2, K, rest=REST)
    if reverse:
        end = Point(END.place, (Rotation.from_quat(END.rotation) * Rotation.from_quat(REVERSED)).as_quat())
        back = Piece(LENGTH / 2, K, rest=REST * (-1.0, 1.0, 1.0))
        other = Rod((2, 1), [back], even(LENGTH / 2, 40), frames[1])
    else:
        end, other = END, Rod((1, 2), [half], even(LENGTH / 2, 40), frames[1])
    net = Net([START, junction, end], [Rod((0, 1), [half], even(LENGTH / 2, 40), frames[0]), other], samples=21)
    assert_same(joined(net.settle(), (0, False), (1, reverse)), one_cable[1])
    far = net.raw(1)
    if reverse:
        far = (Rotation.from_quat(far[::-1]) * Rotation.from_quat(REVERSED)).as_quat()
    turns = Rotation.from_quat(np.concatenate((net.raw(0), far[1:]))).inv() * Rotation.from_quat(one_cable[0].raw(0))
    assert turns.magnitude().max() < 1e-11


def test_a_junction_in_a_cable_in_clips_changes_nothing(one_cable):
    """Ball clip, junction, hinge: the spans beside the junction are one span between the two clips."""
    free = one_cable[0]
    near = [(free.positions(0)[i] + (0.0, 0.0, 0.02), free.quaternions(0)[i]) for i in (10, 20, 30)]
    ball, hinge = Point(*near[0], TURNS), Point(*near[2], (0.0, 0.0, 1.0))
    middle = Point(*near[1], TURNS, True)
    nodes = [np.linspace(0.0, 0.3, 11), np.linspace(0.3, 0.9, 21), np.linspace(0.9, LENGTH, 11)]
    whole = Net([START, ball, hinge, END], [Rod((0, 1, 2, 3), [Piece(LENGTH, K, rest=REST)], nodes)]).settle()
    split = [nodes[0], nodes[1][:11], nodes[1][10:], nodes[2]]
    in_one = Net([START, ball, middle, hinge, END], [Rod((0, 1, 2, 3, 4), [Piece(LENGTH, K, rest=REST)], split)])
    assert_same(joined(in_one.settle(), (0, False)), joined(whole, (0, False)))
    first = Rod((0, 1, 2), [Piece(0.6, K, rest=REST)], [nodes[0], nodes[1][:11]])
    second = Rod((2, 3, 4), [Piece(0.6, K, rest=REST)], [nodes[1][10:] - 0.6, nodes[2] - 0.6])
    of_two = Net([START, ball, middle, hinge, END], [first, second], samples=21).settle()
    assert_same(joined(of_two, (0, False), (1, False)), joined(whole, (0, False)))
    np.testing.assert_allclose(of_two.loads[[1, 3], 1:], whole.loads[[1, 2], 1:], atol=1e-9)
    np.testing.assert_allclose(of_two.loads[2, 1:], 0.0, atol=1e-9)


# -- stars


FORCE = np.array((0.05, 0.0, -0.4))  # N, on the junction


def star(elements: int, free: tuple[int, ...] = (), couple: np.ndarray = stars.NO_COUPLE, force=FORCE) -> Net:
    """Three arms of different stiffness, weight and length on a loaded junction; the second one ends in it.

    free: those arms whose far ends nothing holds; on them pull TIP and a dead moment `couple`.
    """
    points = [Point((0.02, 0.02, -0.12), STRAIGHT_ON, TURNS, True, force=force)]
    rods = []
    for i in range(3):
        ends = stars.meets(i)
        frame, rotation = stars.frames(i)
        loads = (stars.TIP, couple) if i in free else (HELD, HELD)
        points.append(Point(stars.FAR[i], rotation, moves=i in free, force=loads[0], moment=loads[1]))
        piece = Piece(LENGTHS[i], stars.STIFFNESS[i], rest=stars.REST[i], weight=WEIGHTS[i])
        untied = {(0, 1 - ends): TURNS} if i in free else {}
        pair = (i + 1, 0) if ends else (0, i + 1)
        rods.append(Rod(pair, [piece], even(LENGTHS[i], elements), {(0, ends): frame}, untied=untied))
    return Net(points, rods)


def error(net: Net, found: list[stars.Solved]) -> float:
    """[m], the largest at nodes, where collocation tells of them, and samples of all rods."""
    worst = 0.0
    for i, arm in enumerate(found):
        nodes = net.at_nodes(i)[0]
        common = math.gcd(len(nodes) - 1, stars.POINTS - 1)
        at = nodes[:: (len(nodes) - 1) // common], arm.positions[:: (stars.POINTS - 1) // common]
        worst = max(worst, np.abs(at[0] - at[1]).max(), np.abs(net.positions(i) - arm.positions).max())
    return worst


def order(counts, errors) -> float:
    """Slope of log error over log mesh width."""
    return float(-np.polyfit(np.log(counts), np.log(errors), 1)[0])


def test_a_star_is_what_collocation_finds():
    """As fine as its estimate asks for, it is right to a tenth of the tolerance; errors fall with the sixth power."""
    length, tolerance, clamped = sum(LENGTHS), 1e-5, stars.solved(*stars.CASES[0])
    for elements in range(4, 40, 2):
        net = star(elements, force=stars.FORCE).settle()
        if net.info[I_ESTIMATE] <= tolerance * length:
            break
    assert elements < 12
    assert error(net, clamped) <= 0.1 * tolerance * length
    counts, errors = (8, 10, 14, 20, 28), []
    for n in counts:
        net = star(n, force=stars.FORCE).settle()
        errors.append(error(net, clamped))
        assert errors[-1] <= net.info[I_ESTIMATE]
    assert order(counts, errors) >= 5.5


def test_forces_balance_at_a_junction():
    """Of starts less those of ends, with what it is loaded with, nothing is left; nor of moments."""
    net = star(20).settle()
    starts = net.forces(0)[0], -net.forces(1)[-1], net.forces(2)[0]
    np.testing.assert_allclose(sum(starts) + FORCE, 0.0, atol=1e-9)
    couples = net.moments(0)[0] - net.moments(1)[-1] + net.moments(2)[0]
    np.testing.assert_allclose(couples, 0.0, atol=1e-9)
    np.testing.assert_allclose(net.loads[0, 1:], 0.0, atol=1e-9)
    weight = sum(length * w for length, w in zip(LENGTHS, WEIGHTS, strict=True))
    carried = net.loads[1:, 1:4].sum(axis=0)
    np.testing.assert_allclose(carried, FORCE - (0.0, 0.0, weight), atol=1e-9)


@pytest.mark.parametrize(("free", "couple"), stars.CASES[1:5])
def test_free_arms_are_what_collocation_finds(free, couple):
    """An arm that ends free, one that starts free, and a fork that hangs from one grip."""
    found = stars.solved(free, couple)
    counts, errors = (8, 10, 14, 20, 28), []
    for n in counts:
        net = star(n, free, couple, stars.FORCE).settle(kind=HANGING)
        assert net.info[I_EXCESS] == 0.0
        errors.append(error(net, found))
        assert errors[-1] <= net.info[I_ESTIMATE]
        np.testing.assert_allclose(net.loads[0, 1:], 0.0, atol=1e-9)
    assert order(counts, errors) >= 5.5


@pytest.mark.parametrize("free", [(), (2,), (1,), (1, 2)])
def test_what_is_told_to_be_taken_off_is_the_way_of_the_positions(free):
    """Whatever knots move with it: junctions, and those that nothing holds."""
    net = star(12, free).settle(kind=HANGING)
    told, corrected = net.info[I_OFF], [net.at_nodes(i)[0].copy() for i in range(3)]
    net.trial.q[...], net.trial.lam[...], net.trial.pose[...] = net.now.q, net.now.lam, net.now.pose
    system.gradient(net.ints, net.floats, net.sols, net.work)
    held = next(i for i in range(3) if i not in free)
    junction = net.now.pose[0, :3]
    if len(free) == 2:  # a fork: its junction is where the arm that is held leads
        steps = net.steps(held)
        junction = FAR[held] - steps[-1]
    way = 0.0
    for i in range(3):
        steps = net.steps(i)
        places = junction + (steps if net.rods[i].knots[0] == 0 else steps - steps[-1])
        way = max(way, np.linalg.norm(places - corrected[i], axis=1).max())
    assert told == pytest.approx(way, rel=1e-6)


@pytest.mark.parametrize("weights", [WEIGHTS, (0.0, 0.0, 0.0)])
@pytest.mark.parametrize("kind", [HANGING, CURVED])
def test_a_star_is_found_from_any_number_of_elements(monkeypatch, weights, kind):
    """Also where, in a guess, the force in the middle of an element would vanish."""
    monkeypatch.setattr(sys.modules[__name__], "WEIGHTS", weights)
    for n in range(5, 14):
        net = star(n)
        net.start(kind)
        assert net.solve() == CONVERGED, n


@pytest.mark.parametrize(("free", "couple"), stars.CASES[:5])
def test_sensitivities_of_a_star_are_differences(free, couple):
    """By every number of a grip's pose, of all arms, of those too that nothing else holds."""
    net = star(60, free, couple=couple).settle(kind=HANGING)
    grip = 1
    found = net.sensitivities(grip)
    point, step = net.points[grip], 1e-5
    place, rotation = np.asarray(point.place), Rotation.from_quat(point.rotation)
    for axis in range(6):
        twist = np.zeros(6)
        shapes = []
        for sign in (1.0, -1.0):
            twist[axis] = sign * step
            point.place, point.rotation = place + twist[:3], (Rotation.from_rotvec(twist[3:]) * rotation).as_quat()
            net.again()
            shapes.append([net.positions(i).copy() for i in range(3)])
        difference = (np.array(shapes[0]) - np.array(shapes[1])) / (2.0 * step)
        scale = 1.0 if axis < 3 else np.abs(found[..., 3:]).max()
        np.testing.assert_allclose(found[..., axis], difference, rtol=0.0, atol=1e-6 * scale)


# -- stability


EI, HEIGHT = 0.01, 0.5
EULER = np.pi**2 * EI / (4.0 * HEIGHT**2)


def column(load: float) -> Net:
    """An upright arm clamped at its foot; a load on the junction at its head, and two slack arms that are soft."""
    up = frame_along((0.0, 0.0, 1.0))
    points = [Point((0.0, 0.0, HEIGHT), up, TURNS, True, force=(0.0, 0.0, -load)), Point((0.0, 0.0, 0.0), up)]
    rods = [Rod((1, 0), [Piece(HEIGHT, (EI, EI, EI), weight=1e-6, compliance=(0.0, 0.0, 1e-6))], even(HEIGHT, 16))]
    for k, side in enumerate((1.0, -1.0)):
        points.append(Point((0.3 * side, 0.0, HEIGHT), frame_along((side, 0.0, -1.0))))
        frame = Rotation.from_quat(up).inv() * Rotation.from_quat(frame_along((side, 0.0, 1.0)))
        soft = Piece(0.4, (1e-6 * EI, 1e-6 * EI, 1e-6 * EI), weight=1e-6)
        rods.append(Rod((0, k + 2), [soft], even(0.4, 16), {(0, 0): frame.as_quat()}))
    return Net(points, rods)


def test_a_star_with_an_arm_beyond_buckling_is_unstable():
    """Two modes of the strut, from Euler's load on; kept to minima it bends to where there is none."""
    assert column(0.99 * EULER).settle(guard=False).info[I_EXCESS] == 0.0
    upright = column(1.01 * EULER).settle(guard=False)
    assert upright.info[I_EXCESS] == 2.0
    assert upright.softest() < 0.0
    np.testing.assert_allclose(upright.now.pose[0, :3], (0.0, 0.0, HEIGHT), atol=1e-5)
    bent = column(1.5 * EULER).settle()
    assert bent.info[I_EXCESS] == 0.0
    assert bent.now.pose[0, 2] < 0.95 * HEIGHT


# -- tapers and jumps of stiffness


JUMP = 0.5  # m, where both stiffness and its slope jump
TAPERS = (((0.01, 0.014, 0.008), (0.03, 0.02, 0.02)), ((0.006, 0.005, 0.004), (0.012, 0.02, 0.01)))
BENDS = ((1.0, 0.5, 0.2), (0.2, -0.6, 0.5), (-0.5, 0.3, -0.4))
PARTS = (JUMP, LENGTH - JUMP)


def tapered(elements: int) -> Net:
    """One cable whose stiffness changes linearly on both sides of a jump, and its rest curvature with a kink there."""
    half = elements // 2
    nodes = np.concatenate((np.linspace(0.0, JUMP, half + 1)[:-1], np.linspace(JUMP, LENGTH, elements - half + 1)))
    pieces = [Piece(PARTS[i], *TAPERS[i], BENDS[i], BENDS[i + 1], 0.981) for i in range(2)]
    return Net([START, END], [Rod((0, 1), pieces, [nodes])], samples=241)


def states(net: Net, low: float, high: float):
    """The shape of part of the cable as collocation's states at fractions of it."""
    q = net.quaternions(0)
    moments = Rotation.from_quat(q).inv().apply(net.moments(0))
    rows = np.concatenate((net.positions(0), q, moments, net.forces(0)), axis=1)
    spline = CubicSpline(np.linspace(0.0, 1.0, net.samples), rows, axis=0)
    return lambda x: spline(low + (high - low) * x).T


def of(found, rod: int, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions and rotations of collocation's rod at fractions of its length."""
    rows = found.sol(x)[13 * rod : 13 * rod + 7].T
    return rows[:, :3], rows[:, 3:]


def line(a, b, length: float):
    first, slope = np.array(a)[:, None], (np.array(b) - a)[:, None] / length
    return lambda s: first + slope * s


def test_tapers_and_jumps_keep_the_order():
    """The fourth of rotations as Newton's method finds them, the sixth of the shape; both parts by collocation."""
    fine = tapered(120).settle()
    arms = []
    for i, point in enumerate((START, END)):
        stiffness, rest = line(*TAPERS[i], PARTS[i]), line(BENDS[i], BENDS[i + 1], PARTS[i])
        arms.append(collocation.Arm(PARTS[i], stiffness, rest, 0.981, point.place, point.rotation, 1 - i))
    share = JUMP / LENGTH
    found = collocation.solve(arms, [states(fine, 0.0, share), states(fine, share, 1.0)], np.zeros(3))
    counts, rotations, errors = (16, 20, 24, 32, 40, 48, 64), [], []
    for n in counts:
        net = tapered(n).settle()
        both = [of(found, i, np.linspace(0.0, 1.0, k + 1)) for i, k in enumerate((n // 2, n - n // 2))]
        places, turns = (np.concatenate((a, b[1:])) for a, b in zip(*both, strict=True))
        rotations.append((Rotation.from_quat(net.raw(0)).inv() * Rotation.from_quat(turns)).magnitude().max())
        errors.append(np.abs(net.at_nodes(0)[0] - places).max())
        assert errors[-1] <= net.info[I_ESTIMATE]
    assert order(counts, rotations) >= 3.5
    assert order(counts, errors) >= 5.5
    s = np.linspace(0.0, LENGTH, fine.samples)
    left, right = s[s <= JUMP] / JUMP, (s[s > JUMP] - JUMP) / PARTS[1]
    shape = np.concatenate((of(found, 0, left)[0], of(found, 1, right)[0]))
    np.testing.assert_allclose(fine.positions(0), shape, rtol=0.0, atol=1e-7 * LENGTH)
