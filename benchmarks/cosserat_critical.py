"""Critical loads: where the stability flag of the Cosserat rod flips, against the exact values."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from figures import Figures, heading
from tqdm import tqdm

from cable_shape.cable.cable import Cable
from cable_shape.pose import FreeEnd, Grip, Pose, multiply
from cable_shape.shape import Status
from cable_shape.solve import cosserat
from cable_shape.solve.network import Network
from cable_shape.solve.problem import Problem

UP = (0.0, 0.0, 0.0, 1.0)  # d3 = z
LEVEL = (0.0, math.sqrt(0.5), 0.0, math.sqrt(0.5))  # d3 = x, d1 = -z
EA = 1e5  # of a rod with EI = L = 1: axial forces are set through a stretch of no consequence
GJ = 0.8

#: name -> exact value, of EI = L = 1: closed forms as in the sources named there
EXACT = {
    "Euler column, clamped-free: P = pi^2/4": math.pi**2 / 4,
    "Greenhill heavy column: w": 7.837347438943483,
    "Euler column, clamped-clamped: P = 4 pi^2": 4 * math.pi**2,
    "Michell-Prandtl lateral, end load / sqrt(EI GJ)": 4.012599343578901,
    "lateral, own weight / sqrt(EI GJ)": 12.853763321383319,
    "Greenhill twisted rod, T = -20: M": 5.77113570332134,
    "Greenhill twisted rod, T = 0: M": 8.986818915818128,
    "Greenhill twisted rod, T = 20: M": 11.800329535425245,
    "Greenhill twisted rod, T = 100: M": 20.983500828140517,
    "Greenhill twisted rod, T = 400: M": 40.49623334024601,
    "Michell-Zajac ring, GJ = 1/2: twist": 2 * math.pi * math.sqrt(3) / 0.5,
    "Michell-Zajac ring, GJ = 3/4: twist": 2 * math.pi * math.sqrt(3) / 0.75,
    "Michell-Zajac ring, GJ = 1: twist": 2 * math.pi * math.sqrt(3),
}


class NotFoundError(RuntimeError):
    """The solver gave no equilibrium next to the trivial one."""


def stable(cable: Cable, start: Pose, end: Pose | FreeEnd, frames: Callable, force: tuple = (0, 0, 0)) -> bool:
    """Whether the trivial equilibrium is stable."""
    problem = Problem(cable, points=21, tolerance=1e-2).move(Grip(start), end)
    shape = cosserat.solve_beside(problem, Network(problem), frames, force)
    if not shape.status:
        raise NotFoundError(f"the trivial equilibrium was not found: {shape}")
    return shape.status is Status.OK


def constant(q: tuple) -> Callable[[np.ndarray], np.ndarray]:
    """The same frame everywhere."""
    return lambda s: np.tile(q, (len(s), 1))


def rolled(total: float) -> Callable[[np.ndarray], np.ndarray]:
    """Frames rolled about z by `total` along the cable of length 1."""
    return lambda s: np.stack((0 * s, 0 * s, np.sin(0.5 * total * s), np.cos(0.5 * total * s)), axis=1)


def column(load: float) -> bool:
    cable = Cable(length=1.0, linear_density=0.0, bending_stiffness=1.0, twisting_stiffness=GJ)
    return stable(cable, Pose(), FreeEnd(force=(0, 0, -load)), constant(UP))


def heavy_column(weight: float) -> bool:
    cable = Cable(length=1.0, linear_density=weight / 9.81, bending_stiffness=1.0, twisting_stiffness=GJ)
    return stable(cable, Pose(), FreeEnd(), constant(UP))


def pressed(load: float) -> bool:
    cable = Cable(1.0, 0.0, 1.0, GJ, axial_stiffness=EA)
    return stable(cable, Pose(), Pose((0, 0, 1 - load / EA)), constant(UP), (0, 0, -load))


def lateral(load: float, own_weight: bool) -> bool:
    unit = math.sqrt(1.0 * GJ)
    cable = Cable(1.0, load * unit / 9.81 if own_weight else 0.0, (1.0, 1e6), GJ)
    tip = (0, 0, 0) if own_weight else (0, 0, -load * unit)
    return stable(cable, Pose((0, 0, 0), LEVEL), FreeEnd(force=tip), constant(LEVEL))


def twisted(moment: float, tension: float) -> bool:
    cable = Cable(1.0, 0.0, 1.0, GJ, axial_stiffness=EA)
    frames = rolled(moment / GJ)
    end = Pose((0, 0, 1 + tension / EA), frames(np.ones(1))[0])
    return stable(cable, Pose(), end, frames, (0, 0, tension))


def ring(twist: float, stiffness: float) -> bool:
    cable = Cable(1.0, 0.0, 1.0, stiffness)

    def frames(s: np.ndarray) -> np.ndarray:
        angle = math.pi * s
        circle = np.stack((0 * s, np.sin(angle), 0 * s, np.cos(angle)), axis=1)
        return np.array([multiply(a, b) for a, b in zip(circle, rolled(twist)(s), strict=True)])

    # m' + r' x n = 0 with the twisting moment GJ twist along the tangent: n = GJ twist kappa along the ring's axis
    force = (0.0, stiffness * twist * 2 * math.pi, 0.0)
    return stable(cable, Pose(), Pose((0, 0, 0), frames(np.ones(1))[0]), frames, force)


def problem_of(name: str) -> Callable[[float], bool]:
    """The stability of one entry of EXACT as a function of its load."""
    number = name.split("=")[1].split(":")[0] if "=" in name else ""
    if "Greenhill twisted" in name:
        return lambda x: twisted(x, float(number))
    if "ring" in name:
        return lambda x: ring(x, {" 1/2": 0.5, " 3/4": 0.75, " 1": 1.0}[number])
    if "lateral" in name:
        return lambda x: lateral(x, "own" in name)
    return {"clamped-free": column, "heavy column": heavy_column, "clamped-clamped": pressed}[
        next(k for k in ("clamped-free", "heavy column", "clamped-clamped") if k in name)
    ]


def flip(is_stable: Callable[[float], bool], low: float, high: float) -> float:
    """The load at which the flag flips, by bisection to 1e-4; NaN if it does not between the bounds."""
    if not is_stable(low) or is_stable(high):
        return math.nan
    while high - low > 1e-4 * low:
        middle = 0.5 * (low + high)
        try:
            verdict = is_stable(middle)
        except NotFoundError:  # within 5e-5 of the load the matrix is all but singular; a little further off it is not
            middle = 0.55 * low + 0.45 * high
            verdict = is_stable(middle)
        low, high = (middle, high) if verdict else (low, middle)
    return 0.5 * (low + high)


def critical_values(figures: Figures) -> None:
    """Prints where the flag flips."""
    heading("Critical loads (EI = L = 1): where the stability flag flips")
    worst = 0.0
    for name, exact in tqdm(EXACT.items(), desc="critical loads", unit="load", leave=False, disable=None):
        found = flip(problem_of(name), 0.9 * exact, 1.1 * exact)
        off = 100.0 * (found / exact - 1.0)
        worst = max(worst, abs(off)) if math.isfinite(off) else math.inf
        print(f"{name:50} exact {exact:9.4f}  flips at {found:9.4f}  {off:+.3f} %", flush=True)
    figures.at_most(f"stability flag flips off the exact load, worst of {len(EXACT)}", worst, 1.0, "{:.2f}", " %")
