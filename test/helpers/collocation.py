"""Rods as boundary value problems for scipy's solve_bvp, which shares nothing with ours: arms that meet in one
junction, and one cable in stretches from clip to clip.

Of each rod 13 states on [0, 1]: place, rotation x y z w, moment in the cable frame and force in the world. Far ends
are clamped, or free.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.integrate import solve_bvp

STATES = 13
Profile = Callable[[np.ndarray], np.ndarray]


@dataclass
class Rod:
    """A rod of one length; `stiffness` and `rest` (3, k) at arc lengths (k,)."""

    length: float
    stiffness: Profile
    rest: Profile
    weight: float  # N/m, downwards
    give: Sequence[float] = field(default=(0.0, 0.0, 0.0), kw_only=True)  # 1/N: strain by force, along d1, d2, d3


@dataclass
class Arm(Rod):
    """A rod that meets others in a junction."""

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


def strains(rod: Rod, s: np.ndarray, Y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Curvature u, r' and force (3, k) in the cable frame."""
    N = turned(conjugate(Y[3:7]), Y[10:13])
    V = np.asarray(rod.give)[:, None] * N
    V[2] += 1.0
    return Y[7:10] / rod.stiffness(s) + rod.rest(s), V, N


def slopes(rod: Rod, s: np.ndarray, Y: np.ndarray) -> np.ndarray:
    """d/ds of the states (13, k) of one rod."""
    q, M = Y[3:7], Y[7:10]
    u, V, N = strains(rod, s, Y)
    out = np.zeros_like(Y)
    out[0:3] = turned(q, V)
    out[3:7] = 0.5 * product(q, np.concatenate((u, np.zeros((1, s.size)))))
    out[7:10] = np.cross(M, u, axis=0) - np.cross(V, N, axis=0)
    out[12] = rod.weight
    return out


def parallel(rods: Sequence[Rod]) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    """The slopes of all rods' states side by side on [0, 1]."""

    def fun(x: np.ndarray, Y: np.ndarray) -> np.ndarray:
        rows = [
            rod.length * slopes(rod, rod.length * x, Y[STATES * i : STATES * (i + 1)]) for i, rod in enumerate(rods)
        ]
        return np.concatenate(rows)

    return fun


def solve(arms: Sequence[Arm], start: Sequence[Callable[[np.ndarray], np.ndarray]], force: np.ndarray, nodes: int = 300,
          tol: float = 1e-9) -> Any:  # fmt: skip
    """solve_bvp's solution; `start` of each arm: states (13, k) at fractions of its length. force: dead, on the
    junction."""
    x = np.linspace(0.0, 1.0, nodes)
    Y = np.concatenate([states(x) for states in start])

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

    found = solve_bvp(parallel(arms), conditions, x, Y, tol=tol, max_nodes=6000)
    assert found.success, found.message
    return found


@dataclass
class Stop:
    """Where one stretch of a cable goes over into the next, or where the cable ends: held at `place`, in the frame
    `rotation` or not, or running through it, drawn towards the start; else under a dead force and, at an end, a dead
    moment."""

    place: Sequence[float] | None = None
    rotation: Sequence[float] | None = None
    force: Sequence[float] = (0.0, 0.0, 0.0)
    moment: Sequence[float] = (0.0, 0.0, 0.0)
    slides: bool = False
    draw: float = 0.0  # of a cable that does not stretch

    def held(self, Y: np.ndarray) -> list[np.ndarray]:
        """What place and frame ask of the states (13,)."""
        out = [] if self.place is None else [Y[0:3] - np.asarray(self.place)]
        return out if self.rotation is None else [*out, product(conjugate(np.asarray(self.rotation)), Y[3:7])[:3]]

    def passed(self, left: np.ndarray, right: np.ndarray, rod: Rod) -> list[np.ndarray]:
        """13 conditions on the states (13,) before and after; 14 where the cable slides without friction, there with as
        much of n . r' - (energy of stretch) on both sides (moments and curvatures are the same)."""
        out = [*self.held(left), right[0:3] - left[0:3], right[3:7] - left[3:7]]
        if self.rotation is None:
            out.append(right[7:10] - left[7:10])
        if self.place is None:
            out.append(right[10:13] - left[10:13] + np.asarray(self.force))
        if self.slides:
            N = [turned(conjugate(Y[3:7]), Y[10:13]) for Y in (left, right)]
            before, after = (n[2] + 0.5 * np.asarray(rod.give) @ n**2 for n in N)
            out.append(np.array([after - before - self.draw]))
        return out

    def ended(self, Y: np.ndarray) -> list[np.ndarray]:
        """6 conditions on the states (13,) at the cable's end."""
        if self.place is not None:
            return self.held(Y)
        return [Y[10:13] - np.asarray(self.force), turned(Y[3:7], Y[7:10]) - np.asarray(self.moment)]


def chain(rods: Sequence[Rod], stops: Sequence[Stop], x: np.ndarray, Y: np.ndarray, tol: float) -> Any:
    """solve_bvp's solution of stretches in a row, from states Y (13 a stretch, k) at x (k,) on [0, 1].

    Stops are one more; at the first the cable is clamped. The solution's p: arc lengths of the stops that slide, on a
    cable that is the same everywhere.
    """
    at = np.cumsum([0.0, *(rod.length for rod in rods)])
    sliding = [i for i, stop in enumerate(stops) if stop.slides]

    def fun(x: np.ndarray, Y: np.ndarray, p: Sequence[float] = ()) -> np.ndarray:
        here = at.copy()
        here[sliding] = p
        return parallel([replace(rod, length=d) for rod, d in zip(rods, np.diff(here), strict=True)])(x, Y)

    def conditions(Ya: np.ndarray, Yb: np.ndarray, _: Sequence[float] = ()) -> np.ndarray:
        first, last = Ya.reshape(-1, STATES), Yb.reshape(-1, STATES)
        out = [first[0, 0:3] - np.asarray(stops[0].place), first[0, 3:7] - np.asarray(stops[0].rotation)]
        for stop, rod, left, right in zip(stops[1:-1], rods[:-1], last[:-1], first[1:], strict=True):
            out += stop.passed(left, right, rod)
        return np.concatenate([*out, *stops[-1].ended(last[-1])])

    found = solve_bvp(fun, conditions, x, Y, p=at[sliding] if sliding else None, tol=tol, max_nodes=60_000)
    assert found.success, found.message
    return found
