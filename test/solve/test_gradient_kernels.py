"""The closed forms of the gradient cable in every mode: equation, conditions, loads, length and buckling."""

import itertools

import numpy as np
import pytest
from numpy.polynomial import Legendre
from scipy.linalg import eigh
from scipy.special import roots_legendre

from cable_shape.kernels import gradient_basis as basis
from cable_shape.kernels import gradient_length as length
from cable_shape.kernels.exponential import decay
from cable_shape.kernels.gradient_ends import CLAMPED, FREE, PINNED, WORK, assemble
from cable_shape.kernels.gradient_tension import critical
from cable_shape.solve.gradient import buckling_tension

#: (z, c) and the mode that is expected: around every border between modes, and far inside.
MODES = [
    (-39.0, 0.0, basis.LOW4),
    (0.0, 0.0, basis.LOW4),
    (15.9, 0.0, basis.LOW4),
    (16.1, 0.0, basis.HIGH4),
    (160_000.0, 0.0, basis.HIGH4),  # L / g = 400
    (16e6, 0.0, basis.HIGH4),  # 4000
    (-45.0, 1e-4, basis.SPLIT6),
    (0.0, 1e-4, basis.SPLIT6),
    (15.9, 1e-4, basis.SPLIT6),
    (17.0, 1e-4, basis.REAL6),
    (200.0, 1e-4, basis.REAL6),
    (2400.0, 1e-4, basis.PAIR6),  # real
    (2500.0, 1e-4, basis.PAIR6),  # double
    (2600.0, 1e-4, basis.PAIR6),  # complex
    (1e6, 1e-4, basis.PAIR6),
    (16e6, 1e-6, basis.PAIR6),
    (-50.0, 0.5, basis.SERIES6),
    (0.5, 0.5, basis.SERIES6),  # double
    (1e3, 0.5, basis.SERIES6),
    (-3e4, 10.0, basis.SERIES6),
]
EDGES = np.array((0.0, 0.3, 0.45, 1.0))
CLAMPS = np.array((CLAMPED, CLAMPED))


class Solved:
    """One dimensionless gradient cable with random ends, a linear and two concentrated loads."""

    def __init__(self, z: float, c: float, kinds: np.ndarray, tip_moment: tuple[float, float, float]) -> None:
        random = np.random.default_rng(5)
        self.z, self.c, self.kinds = z, c, kinds
        self.order = 4 if c == 0.0 else 6
        size = max(1.0, abs(z))
        self.given = random.normal(size=(2, 3, 3))
        self.given[:, 1:][np.asarray(kinds) != CLAMPED] = 0.0
        self.load = size * random.normal(size=(2, 3))
        self.point_load = size * random.normal(size=(2, 3))
        self.par, self.series = np.empty(basis.PARAMETERS), np.zeros((4, basis.SERIES_TERMS))
        self.rows, self.force = np.empty((3, 3, basis.ROW)), np.empty(3)
        work, table = np.empty((WORK, 10)), np.empty((2, 5, basis.ROW))
        self.tip_moment = np.array(tip_moment)
        self.mode = assemble(
            z, c, kinds, self.given, self.tip_moment, self.load, EDGES, self.point_load, work, table, self.par,
            self.series, self.rows, self.force,
        )  # fmt: skip

    def at(self, s: np.ndarray, piece: int, derivative: int) -> np.ndarray:
        """(3, n) a derivative of x at s, from the rows of a piece."""
        points = np.stack((s - 0.5, s - EDGES[piece], EDGES[piece + 1] - s))
        rows, out = self.rows[piece].copy(), np.empty((3, len(s)))
        for _ in range(derivative):
            before = rows.copy()
            length.derivatives(self.mode, self.par, before, rows)
        phi = np.zeros((4, len(s)))
        basis.functions(self.mode, self.par, self.series, points, 0, len(s), phi)
        length.field(rows, True, points, phi, 0, len(s), out)
        return out

    def n(self, s: np.ndarray, piece: int) -> np.ndarray:
        """z x' - x''' + c x^(5)."""
        return self.z * self.at(s, piece, 1) - self.at(s, piece, 3) + self.c * self.at(s, piece, 5)


@pytest.mark.parametrize(("z", "c", "mode"), MODES)
def test_every_mode_solves_its_equation(z: float, c: float, mode: int) -> None:
    cable = Solved(z, c, CLAMPS, (0.0, 0.0, 0.0))
    assert cable.mode == mode
    for piece in range(3):
        s = np.linspace(EDGES[piece], EDGES[piece + 1], 9)
        d = [cable.at(s, piece, k) for k in range(7)]
        q = cable.load[0][:, None] + cable.load[1][:, None] * (s - 0.5)
        scale = np.abs(z * d[2]).max() + np.abs(d[4]).max() + np.abs(c * d[6]).max() + np.abs(q).max()
        assert np.abs(z * d[2] - d[4] + c * d[6] + q).max() < 1e-13 * scale
        # the force in closed form is that of the derivatives, and falls by the loads
        u = s - 0.5
        expected = cable.force[:, None] - cable.load[0][:, None] * u - cable.load[1][:, None] * u**2 / 2
        expected -= cable.point_load[:piece].sum(axis=0)[:, None]
        assert np.abs(cable.n(s, piece) - expected).max() < 1e-12 * (np.abs(z * d[1]).max() + np.abs(d[3]).max())


@pytest.mark.parametrize(("z", "c", "mode"), MODES)
def test_rows_differentiate_into_rows(z: float, c: float, mode: int) -> None:
    """Derivatives against central differences, on a length that the thinnest layer resolves."""
    cable = Solved(z, c, CLAMPS, (0.0, 0.0, 0.0))
    h = 1e-4 / max(1.0, cable.par[basis.MU], cable.par[basis.MU2])
    s = 0.3 * h * 1e3 + np.array((-h, 0.0, h))
    for k in range(3):
        x, slope = cable.at(s, 0, k), cable.at(s, 0, k + 1)[:, 1]
        scale = np.abs(slope).max() + 1e-9
        assert np.abs((x[:, 2] - x[:, 0]) / (2 * h) - slope).max() < 1e-5 * scale + 1e-10 * np.abs(x).max() / h
    assert cable.mode == mode


@pytest.mark.parametrize(("z", "c", "mode"), MODES)
def test_pieces_join_and_clamps_hold(z: float, c: float, mode: int) -> None:
    cable = Solved(z, c, CLAMPS, (0.0, 0.0, 0.0))
    assert cable.mode == mode
    half = cable.order // 2
    for end, k in itertools.product(range(2), range(half)):
        x = cable.at(np.array((float(end),)), 2 * end, k)[:, 0]
        assert np.abs(x - cable.given[end, k]).max() < 1e-11 * np.abs(cable.given).max()
    for piece in range(2):
        for k in range(2 * half - 1):
            edge = EDGES[piece + 1 : piece + 2]
            before, after = cable.at(edge, piece, k), cable.at(edge, piece + 1, k)
            around = np.abs(cable.at(np.linspace(EDGES[piece], EDGES[piece + 1], 9), piece, k)).max()
            assert np.abs(before - after).max() < 1e-9 * around


@pytest.mark.parametrize(("z", "c", "mode"), MODES)
@pytest.mark.parametrize(("start", "end"), [(PINNED, CLAMPED), (CLAMPED, PINNED), (CLAMPED, FREE), (PINNED, FREE)])
def test_natural_conditions(z: float, c: float, mode: int, start: int, end: int) -> None:
    lowest = buckling_tension(c, start, end)
    z = max(z, 0.9 * lowest if lowest < 0.0 else 1.0)
    cable = Solved(z, c, np.array((start, end)), (0.7, -0.4, 0.9) if end == FREE else (0.0, 0.0, 0.0))
    assert cable.mode == mode
    for i, kind in enumerate((start, end)):
        s, piece = np.array((float(i),)), 2 * i
        moment = cable.at(s, piece, 2) - c * cable.at(s, piece, 4)
        around = np.abs(cable.at(np.linspace(0.0, 0.3, 9), 0, 2)).max() + c * np.abs(cable.at(s, piece, 4)).max()
        if kind == FREE:
            n = cable.n(s, piece)[:, 0]
            size = np.abs(z * cable.at(s, piece, 1)).max() + np.abs(cable.at(s, piece, 3)).max()
            assert np.abs(n - cable.given[1, 0]).max() < 1e-10 * (size + np.abs(cable.point_load).max())
            moment = moment[:, 0] - np.cross(cable.tip_moment, cable.at(s, piece, 1)[:, 0])
        if kind != CLAMPED:
            assert np.abs(moment).max() < 1e-10 * (1.0 + around)
            if cable.order == 6:
                third = np.abs(cable.at(np.linspace(0.0, 0.3, 9), 0, 3)).max()
                assert np.abs(cable.at(s, piece, 3)).max() < 1e-9 * (1.0 + third)


def galerkin(c: float, kinds: tuple[int, int]) -> float:
    """Buckling tension by polynomials that meet the given conditions: least (|x''|^2 + c |x'''|^2) / |x'|^2."""
    nodes, weights = roots_legendre(100)
    given = {CLAMPED: 2 if c == 0.0 else 3, PINNED: 1, FREE: 0}
    ends = Legendre((1.0, 1.0)) ** given[kinds[0]] * Legendre((1.0, -1.0)) ** given[kinds[1]]
    family = [ends * Legendre.basis(k) for k in range(40)]
    d = [np.array([(2.0**k * f.deriv(k))(nodes) for f in family]) for k in (1, 2, 3)]
    scale = 1.0 / np.sqrt((d[0] ** 2 * weights).sum(axis=1))
    gram = [(scale[:, None] * v * weights) @ (scale[:, None] * v).T for v in d]
    return -float(eigh(gram[1] + c * gram[2], gram[0], eigvals_only=True)[0])


@pytest.mark.parametrize("kinds", [(CLAMPED, CLAMPED), (CLAMPED, PINNED), (PINNED, PINNED), (CLAMPED, FREE)])
@pytest.mark.parametrize("c", [0.0, 1e-4, 1e-2, 1.0, 100.0])
def test_buckling_tension_against_galerkin(c: float, kinds: tuple[int, int]) -> None:
    assert buckling_tension(c, *kinds) == pytest.approx(galerkin(c, kinds), rel=1e-5)


def test_buckling_of_a_pendulum_is_at_no_tension() -> None:
    assert buckling_tension(1e-3, PINNED, FREE) == 0.0


def test_critical_finds_the_4th_order_values_too() -> None:
    """The search itself, not the table of exact values."""
    found = critical(0.0, np.array((CLAMPED, PINNED)), -15.0)
    assert found == pytest.approx(-20.190728556426629, rel=1e-9)


def test_decay_is_the_exponential() -> None:
    x = np.concatenate((np.linspace(0.0, 1.0, 37), np.geomspace(1.0, 699.0, 101)))
    out = np.empty_like(x)
    decay(1.0, x, out)
    np.testing.assert_allclose(out, np.exp(-x), rtol=5e-16)
    decay(1e30, np.array((0.0, 1.0)), out[:2])
    assert out[0] == 1.0
    assert 0.0 <= out[1] < 1e-300


@pytest.mark.parametrize(("z", "c", "mode"), MODES)
def test_panels_cover_each_piece_and_resolve_its_layers(z: float, c: float, mode: int) -> None:
    """Quadrature on the panels against exact integrals of an exponential layer, and of the length of the piece."""
    par, series, panels = (
        np.empty(basis.PARAMETERS),
        np.empty((4, basis.SERIES_TERMS)),
        np.empty((4, length.MAX_PANELS)),
    )
    assert basis.choose(z, c, par, series) == mode
    count = length.lay_out(mode, par, EDGES, panels)
    nodes = np.empty((3, length.NODES * count))
    length.put_nodes(panels, count, EDGES, nodes)
    np.testing.assert_allclose([panels[2, :count][panels[3, :count] == p].sum() for p in range(3)], np.diff(EDGES))
    rate = max(par[basis.MU], par[basis.MU2], 1.0)
    for side in (1, 2):
        value = length.integral(np.exp(-rate * nodes[side]), panels, count)
        exact = sum(-np.expm1(-rate * h) / rate for h in np.diff(EDGES))
        assert value == pytest.approx(exact, rel=1e-6)


def test_arc_length_is_inverted() -> None:
    """Points at equal steps of the length of a speed that varies by a factor of 100."""
    panels, count = np.empty((4, length.MAX_PANELS)), 6
    edges = np.array((0.0, 1.0))
    for i in range(count):
        panels[:, i] = i / count, (count - 1 - i) / count, 1.0 / count, 0.0
    nodes = np.empty((3, length.NODES * count))
    length.put_nodes(panels, count, edges, nodes)
    speed = 0.01 + nodes[1] ** 2
    power, begin = np.empty((count, length.NODES + 3)), np.empty(count + 1)
    total = length.measured(speed, panels, count, power, begin)
    assert total == pytest.approx(0.01 + 1.0 / 3.0, rel=1e-14)
    n = 40
    step, (moved, t), s, first = total / (n - 1), np.empty((2, n + length.AHEAD)), np.empty((3, n)), 0
    for i in range(count):
        last = n if i == count - 1 else int(np.ceil(begin[i + 1] / step))
        length.invert(power, i, step, begin[i], first, last, begin[i + 1] - begin[i], moved, t)
        length.put(panels, i, edges, t, first, last, s)
        first = last
    x = s[0] + 0.5
    np.testing.assert_allclose(0.01 * x + x**3 / 3.0, step * np.arange(n), atol=1e-9)
