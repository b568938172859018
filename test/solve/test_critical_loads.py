"""Critical loads: the stability flag of the trivial equilibrium flips within half a per cent of the exact value."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

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


def stable(cable: Cable, start: Pose, end: Pose | FreeEnd, frames: Callable, force: tuple = (0, 0, 0)) -> bool:
    """Whether the trivial equilibrium is stable."""
    problem = Problem(cable, points=21, tolerance=1e-2).move(Grip(start), end)
    shape = cosserat.solve_beside(problem, Network(problem), frames, force)
    assert shape.status, shape
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


#: name -> whether it is stable under a load, and the exact load, of EI = L = 1
LOADS: dict[str, tuple[Callable[[float], bool], float]] = {
    "Euler column, clamped-free": (column, math.pi**2 / 4),
    "Greenhill heavy column": (heavy_column, 7.837347438943483),
    "Euler column, clamped-clamped": (pressed, 4 * math.pi**2),
    "Michell-Prandtl lateral, end load": (lambda x: lateral(x, False), 4.012599343578901),
    "lateral, own weight": (lambda x: lateral(x, True), 12.853763321383319),
    "Greenhill twisted rod, T = -20": (lambda x: twisted(x, -20.0), 5.77113570332134),
    "Greenhill twisted rod, T = 0": (lambda x: twisted(x, 0.0), 8.986818915818128),
    "Greenhill twisted rod, T = 20": (lambda x: twisted(x, 20.0), 11.800329535425245),
    "Greenhill twisted rod, T = 100": (lambda x: twisted(x, 100.0), 20.983500828140517),
    "Greenhill twisted rod, T = 400": (lambda x: twisted(x, 400.0), 40.49623334024601),
    "Michell-Zajac ring, GJ = 1/2": (lambda x: ring(x, 0.5), 2 * math.pi * math.sqrt(3) / 0.5),
    "Michell-Zajac ring, GJ = 3/4": (lambda x: ring(x, 0.75), 2 * math.pi * math.sqrt(3) / 0.75),
    "Michell-Zajac ring, GJ = 1": (lambda x: ring(x, 1.0), 2 * math.pi * math.sqrt(3)),
}


@pytest.mark.parametrize("name", LOADS)
def test_stability_ends_at_the_exact_load(name: str) -> None:
    is_stable, exact = LOADS[name]
    assert is_stable(0.995 * exact)
    assert not is_stable(1.005 * exact)
