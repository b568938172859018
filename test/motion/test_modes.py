"""Small vibrations of the mesh of a motion: how often its matrix is singular, beside exact frequencies."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.polynomial import Legendre
from scipy.linalg import eigh
from scipy.special import jn_zeros

import cable_shape as cs
from cable_shape.kernels.network import moving, settle
from cable_shape.motion.swing import Swing

DOWN = (1.0, 0.0, 0.0, 0.0)  # d3 = -z
G = 9.81


def hanging(stiffness: float, elements: int, kind: str = "clamped", gravity: float = G) -> Swing:
    """1 m of cable that hangs from a grip."""
    cable = cs.Cable(length=1.0, linear_density=0.1, bending_stiffness=stiffness)
    motion = cs.Motion(cable, gravity=(0.0, 0.0, -gravity), points=12, elements=elements)
    assert motion.begin(cs.Grip(cs.Pose(quaternion=DOWN), kind), None).usable
    swing = motion._swing
    assert swing is not None
    return swing


def below(swing: Swing, rate: float) -> int:
    """How many modes swing slower than `rate` [rad/s]: negative eigenvalues with -rate^2 times the masses at the nodes.

    The median of some beside: elimination without pivoting may meet a singular one by chance.
    """
    memory, motion = swing.memory, swing.motion
    found = []
    for beside in 1.0 + 1e-9 * np.arange(-4, 5):
        motion.hold[...] = -((rate * beside) ** 2) * (memory.mass + memory.point)
        swing.sols[2 * (swing.sols.size // 3) :] = swing.sols[: swing.sols.size // 3]
        motion.lam[...] = memory.lam
        settle.assemble(swing.ints, swing.floats, swing.sols, swing.work, swing.moving)
        negative = moving.factor(swing.ints, swing.floats, swing.work, swing.moving, 0.0)
        inner = motion.hold.size - 1  # places that are gone by pivots of their own, all negative
        found.append(negative + 3 * inner - 3 * int(swing.ints[0]))
    return int(np.median(found))


def frequency(swing: Swing, near: float) -> float:
    """[rad/s], of the mode within a tenth of `near`; each is there twice, across the other."""
    low, high = 0.9 * near, 1.1 * near
    slower = below(swing, low)
    assert below(swing, high) == slower + 2
    while high - low > 1e-10 * near:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if below(swing, middle) == slower else (low, middle)
    return high


def exact(stiffness: float, kind: str, gravity: float, modes: int = 3) -> np.ndarray:
    """[rad/s]: Ritz's method with polynomials for EI y'''' - (T y')' = rho w^2 y, which hangs."""
    x, weights = np.polynomial.legendre.leggauss(80)
    s = 0.5 * (x + 1.0)
    held = Legendre((0.5, 0.5)) ** (2 if kind == "clamped" else 1)  # s^2 or s
    basis = [held * Legendre.basis(k) for k in range(30)]
    y, dy, ddy = (np.array([b.deriv(m)(x) * 2.0**m if m else b(x) for b in basis]) for m in range(3))
    tension = 0.1 * gravity * (1.0 - s)
    stiff = (stiffness * ddy * weights) @ ddy.T + (tension * dy * weights) @ dy.T
    return np.sqrt(eigh(stiff, (0.1 * y * weights) @ y.T, eigvals_only=True)[:modes])


def test_the_reference_is_that_of_books():
    """A cantilever's cos b cosh b = -1, and the hanging chain's zeros of J0."""
    np.testing.assert_allclose(exact(0.01, "clamped", 0.0, 2), np.array((1.8751040687, 4.6940911330)) ** 2 * 0.1**0.5)
    np.testing.assert_allclose(exact(0.0, "pinned", G), 0.5 * jn_zeros(0, 3) * G**0.5, rtol=1e-9)


@pytest.mark.parametrize(
    ("stiffness", "kind", "gravity"),
    [
        pytest.param(0.01, "clamped", 0.0, id="cantilever"),
        pytest.param(1e-5, "pinned", G, id="chain"),
        pytest.param(3e-3, "clamped", G, id="between"),
    ],
)
def test_frequencies_are_right_and_of_fourth_order(stiffness: float, kind: str, gravity: float):
    """Errors of the first and third mode: the former small, the latter large enough for its order to be told."""
    wanted = exact(stiffness, kind, gravity)[[0, 2]]
    off = []
    for elements in (10, 20, 40):
        swing = hanging(stiffness, elements, kind, gravity)
        off.append([frequency(swing, w) / w - 1.0 for w in wanted])
    first, third = np.abs(off).T
    assert first[-1] < 1e-5
    assert third[-1] < 1e-4
    assert third[0] / third[-1] > 0.75 * 4.0**4  # from 10 to 40 elements
