"""Networks of rods: junctions, free arms, tapers and jumps of stiffness, against one cable and against collocation."""

from __future__ import annotations

import collocation
import numpy as np
import pytest
from networks import HELD, REVERSED, TURNS, Net, Piece, Point, Rod, even, frame_along
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from cable_shape.kernels.network.drive import I_ESTIMATE
from cable_shape.kernels.network.newton import I_EXCESS

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


FORCE = np.array((0.05, 0.0, -0.4))
STIFFNESS = ((0.012, 0.012, 0.009), (0.03, 0.02, 0.02), (0.006, 0.006, 0.005))
LENGTHS, WEIGHTS = (0.5, 0.7, 0.6), (0.6, 1.2, 0.9)
WAYS = np.array(((1.0, 0.1, 0.2), (-0.7, 0.8, 0.1), (-0.6, -0.9, 0.3)))
FAR = ((0.42, 0.05, 0.1), (-0.35, 0.4, 0.05), (-0.3, -0.38, 0.15))
STRAIGHT = (0.0, 0.0, 0.0, 1.0)


def star(elements: int, free: tuple[int, ...] = (), samples: int = 41, tip: np.ndarray | None = None) -> Net:
    """Three arms of different stiffness, weight and length on a loaded junction; the second one ends in it.

    free: those arms whose far ends nothing holds, but a dead force.
    """
    points = [Point((0.02, 0.02, -0.12), STRAIGHT, TURNS, True, force=FORCE)]
    rods = []
    for i, way in enumerate(WAYS / np.linalg.norm(WAYS, axis=1)[:, None]):
        ends = i == 1
        rotation = frame_along(-way - (0.0, 0.0, 0.3), 0.2) if ends else frame_along(way + (0.0, 0.2, 0.3), -0.3)
        pull = (0.0, 0.0, 0.0) if tip is None or i not in free else tip
        points.append(Point(FAR[i], rotation, moves=i in free, force=pull))
        rest = (0.5, 0.0, 0.3) if i == 2 else HELD
        piece = Piece(LENGTHS[i], STIFFNESS[i], rest=rest, weight=WEIGHTS[i])
        frames = {(0, int(ends)): frame_along(-way if ends else way, 0.3)}
        untied = {(0, 0 if ends else 1): TURNS} if i in free else {}
        pair = (i + 1, 0) if ends else (0, i + 1)
        rods.append(Rod(pair, [piece], even(LENGTHS[i], elements), frames, untied=untied))
    return Net(points, rods, samples)


def states(net: Net, rod: int, low: float = 0.0, high: float = 1.0):
    """The shape of part of a rod as collocation's states at fractions of it."""
    q = net.quaternions(rod)
    moments = Rotation.from_quat(q).inv().apply(net.moments(rod))
    rows = np.concatenate((net.positions(rod), q, moments, net.forces(rod)), axis=1)
    spline = CubicSpline(np.linspace(0.0, 1.0, net.samples), rows, axis=0)
    return lambda x: spline(low + (high - low) * x).T


def reference(net: Net):
    """Collocation of the same star, from its shape."""
    arms = []
    for rod in net.rods:
        meets = rod.knots.index(0)
        piece, far = rod.pieces[0], net.points[rod.knots[1 - meets]]
        arms.append(
            collocation.Arm(
                piece.length,
                collocation.constant(piece.stiffness),
                collocation.constant(piece.rest),
                piece.weight,
                far.place,
                far.rotation,
                meets,
                rod.frames[0, meets],
                (far.force, HELD) if far.moves else None,
            )  # fmt: skip
        )
    return collocation.solve(arms, [states(net, i) for i in range(len(arms))], FORCE)


def of(found, rod: int, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions and rotations of collocation's rod at fractions of its length."""
    rows = found.sol(x)[13 * rod : 13 * rod + 7].T
    return rows[:, :3], rows[:, 3:]


def error(net: Net, found) -> float:
    """[m], the largest at nodes and samples of all rods."""
    worst = 0.0
    for i in range(len(net.rods)):
        nodes = of(found, i, np.linspace(0.0, 1.0, net.nodes[i].size))[0]
        samples = of(found, i, np.linspace(0.0, 1.0, net.samples))[0]
        apart = np.abs(net.at_nodes(i)[0] - nodes).max(), np.abs(net.positions(i) - samples).max()
        worst = max(worst, *apart)
    return worst


def order(counts, errors) -> float:
    """Slope of log error over log mesh width."""
    return float(-np.polyfit(np.log(counts), np.log(errors), 1)[0])


@pytest.fixture(scope="module")
def clamped():
    """Collocation of the star whose far ends are clamped."""
    return reference(star(40, samples=161).settle())


def test_a_star_is_what_collocation_finds(clamped):
    """As fine as its estimate asks for, it is right to a tenth of the tolerance; errors fall with the sixth power."""
    length, tolerance = sum(LENGTHS), 1e-5
    for elements in range(4, 40, 2):
        net = star(elements).settle()
        if net.info[I_ESTIMATE] <= tolerance * length:
            break
    assert elements < 12
    assert error(net, clamped) <= 0.1 * tolerance * length
    counts, errors = (8, 10, 14, 20, 28), []
    for n in counts:
        net = star(n).settle()
        errors.append(error(net, clamped))
        assert errors[-1] <= net.info[I_ESTIMATE]
    assert order(counts, errors) >= 5.5


def test_forces_balance_at_a_junction(clamped):
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


@pytest.mark.parametrize("free", [(2,), (1,), (1, 2)])
def test_free_arms_are_what_collocation_finds(free):
    """An arm that ends free, one that starts free, and a fork that hangs from one grip."""
    tip = np.array((0.05, 0.1, -0.2))
    found = reference(star(40, free, 161, tip).settle(kind=0))
    counts, errors = (8, 10, 14, 20, 28), []
    for n in counts:
        net = star(n, free, tip=tip).settle(kind=0)
        assert net.info[I_EXCESS] == 0.0
        errors.append(error(net, found))
        assert errors[-1] <= net.info[I_ESTIMATE]
        np.testing.assert_allclose(net.loads[0, 1:], 0.0, atol=1e-9)
    assert order(counts, errors) >= 5.5
