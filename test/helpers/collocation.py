"""Rods that meet in one junction as a boundary value problem for scipy's solve_bvp, which shares nothing with ours.

Of each arm 13 states on [0, 1]: place, rotation x y z w, moment in the cable frame and force in the world. The far ends
of arms are clamped, or free.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.integrate import solve_bvp

STATES = 13
Profile = Callable[[np.ndarray], np.ndarray]


@dataclass
class Arm:
    """A rod of one length; `stiffness` and `rest` (3, k) at arc lengths (k,)."""

    length: float
    stiffness: Profile
    rest: Profile
    weight: float  # N/m, downwards
    place: Sequence[float]  # of the far end
    rotation: Sequence[float]
    meets: int = 0  # 0: it starts at the junction, 1: it ends there
    frame: Sequence[float] = (0.0, 0.0, 0.0, 1.0)  # of that end, in the junction's
    tip: tuple[Sequence[float], Sequence[float]] | None = None  # dead force and moment on a far end that is free


def constant(values: Sequence[float]) -> Profile:
    return lambda s: np.outer(values, np.ones_like(s))


def product(p: np.ndarray, q: np.ndarray) -> np.ndarray:
    """The quaternion p q, x y z w first."""
    px, py, pz, pw = p
    qx, qy, qz, qw = q
    return np.array((
        pw * qx + px * qw + py * qz - pz * qy,
        pw * qy - px * qz + py * qw + pz * qx,
        pw * qz + px * qy - py * qx + pz * qw,
        pw * qw - px * qx - py * qy - pz * qz,
    ))  # fmt: skip


def conjugate(q: np.ndarray) -> np.ndarray:
    return np.array((-q[0], -q[1], -q[2], q[3]))


def turned(q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """R(q) v for a unit quaternion."""
    axis = q[:3]
    t = 2.0 * np.cross(axis, v, axis=0)
    return v + q[3] * t + np.cross(axis, t, axis=0)


def slopes(arm: Arm, s: np.ndarray, Y: np.ndarray) -> np.ndarray:
    """d/ds of the states (13, k) of one arm."""
    q, M, n = Y[3:7], Y[7:10], Y[10:13]
    u = M / arm.stiffness(s) + arm.rest(s)
    z = np.zeros((3, s.size))
    z[2] = 1.0
    out = np.zeros_like(Y)
    out[0:3] = turned(q, z)
    out[3:7] = 0.5 * product(q, np.concatenate((u, np.zeros((1, s.size)))))
    N = turned(conjugate(q), n)
    out[7:10] = np.cross(M, u, axis=0) - np.cross(z, N, axis=0)
    out[12] = arm.weight
    return out


def solve(arms: Sequence[Arm], start: Sequence[Callable[[np.ndarray], np.ndarray]], force: np.ndarray, nodes: int = 300,
          tol: float = 1e-9) -> Any:  # fmt: skip
    """solve_bvp's solution; `start` of each arm: states (13, k) at fractions of its length. force: dead, on the
    junction."""
    x = np.linspace(0.0, 1.0, nodes)
    Y = np.concatenate([states(x) for states in start])

    def fun(x: np.ndarray, Y: np.ndarray) -> np.ndarray:
        rows = [
            arm.length * slopes(arm, arm.length * x, Y[STATES * i : STATES * (i + 1)]) for i, arm in enumerate(arms)
        ]
        return np.concatenate(rows)

    def conditions(Ya: np.ndarray, Yb: np.ndarray) -> np.ndarray:
        out, total, couple = [], force.copy(), np.zeros(3)
        first = None
        for i, arm in enumerate(arms):
            ends = Ya[STATES * i : STATES * (i + 1)], Yb[STATES * i : STATES * (i + 1)]
            here, far = ends[arm.meets], ends[1 - arm.meets]
            sign = 1.0 if arm.meets == 0 else -1.0
            if arm.tip is None:
                out.append(far[0:3] - np.asarray(arm.place))
                out.append(product(conjugate(np.asarray(arm.rotation)), far[3:7])[:3])
            else:
                out.append(far[10:13] - sign * np.asarray(arm.tip[0]))
                out.append(turned(far[3:7], far[7:10]) - sign * np.asarray(arm.tip[1]))
            out.append([here[3:7] @ here[3:7] - 1.0])
            knot = product(here[3:7], conjugate(np.asarray(arm.frame)))
            if first is None:
                first = here[0:3], knot
            else:
                out.append(here[0:3] - first[0])
                out.append(product(conjugate(first[1]), knot)[:3])
            total = total + sign * here[10:13]
            couple = couple + sign * turned(here[3:7], here[7:10])
        return np.concatenate([*out, total, couple])

    found = solve_bvp(fun, conditions, x, Y, tol=tol, max_nodes=6000)
    assert found.success, found.message
    return found
