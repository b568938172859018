"""Kernels of the Cosserat rod against finite differences, dense linear algebra and an integrator."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from cable_shape.kernels import rod_algebra, rod_lanes, rod_mesh
from cable_shape.kernels._jit import kernel
from cable_shape.kernels.rod_algebra import qnormal, scale, subtract
from cable_shape.kernels.rod_between import at_node, landing, middle3, middle4, missed
from cable_shape.kernels.rod_element import angle_series, element_gradient, element_hessian

NONE = (0.0, 0.0, 0.0)
LINEAR = (0.0, 0.0, 0.0), (0.02, 0.02, 0.01)
#: [N], of an element at rest, and along one that swings: taut, slack, where it buckles one way, the other, and beyond.
ALONG = None, 40.0, -3.0, -34.0, -75.0, -150.0


def numbers(*values) -> tuple[float, ...]:
    """A tuple of floats, which kernels take for a vector."""
    return tuple(float(v) for v in values)


def turned(q, delta) -> tuple[float, ...]:
    """q exp(delta)."""
    return numbers(*(Rotation.from_quat(q) * Rotation.from_rotvec(delta)).as_quat())


class Element:
    """A random element, as a function of (delta_1, delta_2, lambda)."""

    def __init__(
        self, seed: int, bend: float, compliance: tuple[float, ...], taper: float = 0.0, along: float | None = None
    ) -> None:
        """along: the force in its middle [N], of an element that swings."""
        rng = np.random.default_rng(seed)
        self.h = 0.4
        self.q1 = Rotation.random(rng=rng).as_quat()
        self.q2 = np.array(turned(self.q1, bend * rng.normal(size=3)))
        self.n = 3.0 * rng.normal(size=(3, 3))
        self.rest = rng.normal(size=(2, 3))
        self.swings = None if along is None else True
        if along is not None:
            half = Rotation.from_quat(
                turned(self.q1, 0.5 * (Rotation.from_quat(self.q1).inv() * Rotation.from_quat(self.q2)).as_rotvec())
            )
            self.n[1] = half.apply((*self.n[1, :2], along))
        self.K, self.C, self.taper = (1.3, 0.7, 0.9), compliance, numbers(*taper * np.array((0.8, -0.6, 0.5)))

    def arguments(self, x) -> tuple:
        forces = (numbers(*(n + x[6:])) for n in self.n)
        rest = (numbers(*k) for k in self.rest)
        q = turned(self.q1, x[:3]), turned(self.q2, x[3:6])
        return (self.h, *q, *forces, *rest, self.K, self.C, self.taper, (0.3, -0.2), self.swings)

    def value(self, x) -> float:
        return element_gradient(*self.arguments(x))[0]


@pytest.mark.parametrize("taper", [0.0, 1.0])
@pytest.mark.parametrize("compliance", LINEAR)
@pytest.mark.parametrize("bend", [1e-9, 0.02, 0.5, 1.3])
@pytest.mark.parametrize("along", ALONG)
def test_gradient_of_an_element_against_finite_differences(along, bend, compliance, taper):
    element = Element(1, bend, compliance, taper, along)
    gradient = np.concatenate(element_gradient(*element.arguments(np.zeros(9)))[1:])
    step = 5e-5
    near, far = ([element.value(x * step * e) - element.value(-x * step * e) for e in np.eye(9)] for x in (1, 2))
    differences = (8.0 * np.array(near) - far) / (12.0 * step)
    assert gradient == pytest.approx(differences, abs=2e-9)


@pytest.mark.parametrize("taper", [0.0, 1.0])
@pytest.mark.parametrize("compliance", LINEAR)
@pytest.mark.parametrize("bend", [1e-9, 0.02, 0.5, 1.3])
@pytest.mark.parametrize("along", ALONG)
def test_hessian_of_an_element_against_finite_differences(along, bend, compliance, taper):
    element = Element(2, bend, compliance, taper, along)
    g1, g2, gl, *blocks = (np.array(a) for a in element_hessian(*element.arguments(np.zeros(9))))
    H11, H12, H22, B1, B2, CC = (b.reshape(3, 3) for b in blocks)
    H = np.block([[H11, H12, B1], [H12.T, H22, B2], [B1.T, B2.T, CC]])
    assert np.concatenate((g1, g2, gl)) == pytest.approx(
        np.concatenate(element_gradient(*element.arguments(np.zeros(9)))[1:]), abs=1e-13
    )
    unit = np.eye(9)
    step = 1.5e-4 if along in (-34.0, -75.0) else 3e-4  # it changes fast where it buckles

    def difference(i: int, j: int, step: float) -> float:
        a, b = step * (unit[i] + unit[j]), step * (unit[i] - unit[j])
        return (element.value(a) - element.value(b) - element.value(-b) + element.value(-a)) / (4 * step**2)

    for i in range(9):
        for j in range(9):
            exact = (4.0 * difference(i, j, step) - difference(i, j, 2.0 * step)) / 3.0
            assert H[i, j] == pytest.approx(exact, abs=5e-7)


def test_a_straight_element_that_swings_buckles_bit_by_bit():
    """Pressed along itself by more and more, to twice where it buckles: no jump, and no shorter at none."""
    h, K, straight = 0.4, 1.3, (0.0, 0.0, 0.0, 1.0)
    forces = np.linspace(0.0, -2.0 * K / (0.1 * h * h), 201)

    def length(force: float) -> float:
        n = (0.0, 0.0, float(force))
        element = h, straight, straight, n, n, n, NONE, NONE, (K, K, 0.9), NONE, NONE, (0.0, 0.0), True
        return -element_gradient(*element)[3][2]

    lengths = np.array([length(force) for force in forces])
    assert lengths[0] == pytest.approx(h, rel=1e-7)
    assert np.all(np.diff(lengths) <= 0.0)
    assert lengths[-1] == pytest.approx(0.8 * h, rel=0.02)  # by a tenth either way
    assert -np.diff(lengths).min() < 0.3 * (lengths[0] - lengths[-1])


@pytest.mark.parametrize("swings", [None, True], ids=["rests", "swings"])
@pytest.mark.parametrize("compliance", LINEAR)
def test_elements_side_by_side_are_those_taken_one_by_one(compliance, swings):
    rng = np.random.default_rng(8)
    elements = rod_lanes.LANES + 3
    section = np.tile((1.3, 0.7, 0.9, *compliance, 0.0, 0.0, 0.0), (elements, 1)) * rng.uniform(0.5, 1.5, (elements, 9))
    section[:, 6:] = rng.normal(size=(elements, 3))
    axes = rng.normal(size=(elements, 3))
    axes /= np.linalg.norm(axes, axis=1)[:, None]
    q = [Rotation.random(rng=rng)]
    for turn in np.geomspace(1e-9, 1.3, elements)[:, None] * axes:
        q.append(q[-1] * Rotation.from_rotvec(turn))
    q = np.array([x.as_quat() for x in q]) * rng.choice((-1.0, 1.0), size=(elements + 1, 1))
    h, load, rest = rng.uniform(0.2, 0.6, elements), rng.normal(size=(elements, 9)), rng.normal(size=(elements, 6))
    force, left = rng.normal(size=3), np.arange(elements)
    lanes = np.empty(rod_lanes.ROWS * rod_lanes.LANES)
    table = lanes.reshape(rod_lanes.ROWS, rod_lanes.LANES)
    seen = 0
    for begin in range(0, elements, rod_lanes.LANES):
        count = rod_lanes.gather(begin, left, q, h, load + np.tile(force, 3), rest, section, lanes)
        rod_lanes.gather_firmer(begin, np.tile((0.3, -0.2), (elements, 1)), lanes)
        rod_lanes.gradients(lanes, swings)
        gradients = table[rod_lanes.G1 : rod_lanes.VALUE + 1].copy()
        rod_lanes.hessians(lanes, compliance[0] != 0.0, swings)
        for k in range(count):
            e = begin + k
            forces = (numbers(*(n + force)) for n in load[e].reshape(3, 3))
            kinks = (numbers(*x) for x in rest[e].reshape(2, 3))
            element = (
                float(h[e]),
                numbers(*q[e]),
                numbers(*q[e + 1]),
                *forces,
                *kinks,
                *(numbers(*x) for x in section[e].reshape(3, 3)),
                (0.3, -0.2),
                swings,
            )
            value, *gradient = element_gradient(*element)
            assert gradients[:, k] == pytest.approx(np.array((*np.concatenate(gradient), value)), rel=1e-12, abs=1e-12)
            blocks = np.concatenate(element_hessian(*element))
            assert table[rod_lanes.G1 : rod_lanes.FIRMER, k] == pytest.approx(blocks, rel=1e-12, abs=1e-12)
        seen += count
    assert seen == elements


@pytest.mark.parametrize("x", [0.0, 1e-12, 1e-3, 0.029999, 0.030001, 0.5, 0.99])
def test_the_angle_series_and_its_derivatives(x):
    """Against complex-step-free high precision: 2 asin(sqrt x)/sqrt x by its power series in rationals."""
    terms = [1.0]
    for j in range(1, 4000):
        terms.append(terms[-1] * (2 * j - 1) / (2 * j))
    c = 2.0 * np.array([t / (2 * j + 1) for j, t in enumerate(terms)])
    j = np.arange(len(c))
    f, f1, f2 = angle_series(x, np.sqrt(1.0 - x))
    assert f == pytest.approx((c * x**j).sum(), rel=1e-12)
    assert f1 == pytest.approx((j[1:] * c[1:] * x ** j[:-1]).sum(), rel=1e-11)
    assert f2 == pytest.approx((j[2:] * (j[2:] - 1) * c[2:] * x ** j[:-2]).sum(), rel=1e-9)


def test_the_rule_that_corrects_is_of_sixth_order_and_knows_what_it_misses():
    q = numbers(*Rotation.from_rotvec((0.3, -0.2, 0.5)).as_quat())
    M, K, C = (0.5, -0.8, 0.3), np.array((1.3, 0.7, 0.9)), (0.02, 0.02, 0.01)
    n0, n1, u0, u1 = (np.array(v) for v in ((1.0, 2.0, -1.0), (0.5, -1.0, 2.0), (0.2, 0.1, -0.3), (1.0, 0.5, -0.5)))

    def slopes(s, y):
        R, m = y[:9].reshape(3, 3), y[9:12]
        u, N = u0 + u1 * s + m / K, R.T @ (n0 + n1 * s)
        V = np.array((0.0, 0.0, 1.0)) + np.array(C) * N
        spin = np.array(((0.0, -u[2], u[1]), (u[2], 0.0, -u[0]), (-u[1], u[0], 0.0)))
        return np.concatenate(((R @ spin).ravel(), np.cross(m, u) - np.cross(V, N), R @ V))

    @kernel
    def across(h, q0, q1, M0, M1, n0, nM, n1, u0, uM, u1, du, flex, C):
        dn = scale(1.0 / h, subtract(n1, n0))
        a, b = at_node(q0, M0, n0, dn, u0, du, flex, NONE, C), at_node(q1, M1, n1, dn, u1, du, flex, NONE, C)
        M = middle3(h, a[1], a[4], a[5], b[1], b[4], b[5])
        m = at_node(qnormal(middle4(h, a, b)), M, nM, dn, uM, du, flex, NONE, C)
        return landing(h, a, m, b), missed(h, a, m, b, nM, flex, C)

    errors, estimates = [], []
    for h in (0.4, 0.2):
        start = np.concatenate((Rotation.from_quat(q).as_matrix().ravel(), M, np.zeros(3)))
        exact = solve_ivp(slopes, (0.0, h), start, method="DOP853", rtol=1e-13, atol=1e-14).y[:, -1]
        end = Rotation.from_matrix(exact[:9].reshape(3, 3)).as_quat()
        end *= np.sign(end @ q)
        forces = (numbers(*(n0 + n1 * x)) for x in (0.0, 0.5 * h, h))
        rest = (numbers(*(u0 + u1 * x)) for x in (0.0, 0.5 * h, h))
        moments = numbers(*M), numbers(*exact[9:12])
        (p, m, r), left = across(h, q, numbers(*end), *moments, *forces, *rest, numbers(*u1), numbers(*(1.0 / K)), C)
        turn = 2.0 * (Rotation.from_quat(end).inv() * Rotation.from_quat(p)).as_quat()[:3]
        errors.append(np.abs((*turn, *(np.array(m) - exact[9:12]), *(np.array(r) - exact[12:]))).max())
        estimates.append(max(np.abs(v).max() for v in left))
    assert np.log2(errors[0] / errors[1]) > 6.5  # the error of one element: order 6 + 1
    assert np.log2(estimates[0] / estimates[1]) > 6.5
    assert 0.2 < estimates[1] / errors[1] < 5.0


def test_meshes_have_nodes_at_loads_and_equal_shares_of_their_density():
    x, density = np.empty(129), np.empty(129)
    rod_mesh.layered(2.0, 0.02, x, density)
    assert (np.diff(x) > 0).all()
    stops = np.array((0.7, 1.31))
    s = np.empty(41)
    rod_mesh.equidistribute(x, density, stops, 40, s)
    assert s[0] == 0.0
    assert s[-1] == 2.0
    assert (np.diff(s) > 0).all()
    assert all(np.abs(s - stop).min() == 0.0 for stop in stops)
    share = np.concatenate(([0.0], np.cumsum(0.5 * (density[1:] + density[:-1]) * np.diff(x))))
    shares = np.diff(np.interp(s, x, share))
    assert shares.max() < 2.0 * shares.min()


@pytest.mark.parametrize("seed", range(5))
def test_negative_eigenvalues_by_the_rule_of_signs(seed):
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(3, 3))
    A = A + A.T
    count = rod_algebra.negative_eigenvalues(numbers(*A.ravel()), float(np.linalg.det(A)))
    assert count == (np.linalg.eigvalsh(A) < 0).sum()
