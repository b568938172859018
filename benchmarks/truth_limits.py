"""What a mean over few trajectories is worth, and what no EI/w could better."""

from __future__ import annotations

import math

import numpy as np

import cable_shape as cs
from cable_shape.calibration.forward import Forward
from cable_shape.calibration.parameters import Parameters

#: EI / weight [m^3] that are tried, every 20 %.
RATIOS = np.geomspace(1e-6, 0.1, 65)


def line(name: str, values: list[float], errors: list[float] | None = None, digits: int = 2) -> None:
    """Prints a row of the table of cables."""
    told = [f"{x:.{digits}f}" for x in values]
    if errors is not None:
        told = [f"{x} ± {error:.{digits}f}" for x, error in zip(told, errors, strict=True)]
    print(f"{name:52}" + "".join(f"{x:>14}" for x in told), flush=True)


def mean_error(values: np.ndarray, groups: np.ndarray) -> float:
    """Standard error of the mean of values (n,), frames of one trajectory being no independent evidence."""
    own = np.unique(groups)
    pulls = np.array([(values[groups == g] - values.mean()).sum() for g in own])
    return math.sqrt(len(own) / (len(own) - 1.0) * float(pulls @ pulls)) / len(values)


def least(observations: list[cs.Observation], cable: cs.Cable, ratios: np.ndarray = RATIOS) -> tuple[float, float]:
    """Least mean distance [m] that any EI/w reaches on these very observations, and that EI/w [m^3]."""
    forward = Forward(Parameters(cable, ("bending_stiffness",)), observations)
    weight = cable.linear_density * 9.81
    means = []
    for ratio in ratios[::-1]:
        off = forward.misses(np.array([math.log(ratio * weight)]))
        forward.keep()  # the next cable, a little limper, hangs on the same branch
        means.append(float(np.nanmean(np.linalg.norm(off, axis=1))))
    best = int(np.argmin(means))
    return means[best], float(ratios[::-1][best])
