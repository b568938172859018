"""Clouds of points as a depth camera sees a cable: noise, stray points, a hidden stretch, in no order."""

from __future__ import annotations

import numpy as np

import cable_shape as cs

ALONG_X = (0.5, 0.5, 0.5, 0.5)
CABLE = cs.Cable(length=1.0, linear_density=0.05, bending_stiffness=0.004)
START, END = cs.Pose((0.0, 0.0, 1.0), ALONG_X), cs.Pose((0.7, 0.1, 1.0), ALONG_X)


def places(shape: cs.CableShape, at: np.ndarray) -> np.ndarray:
    """(m, 3) [m], of the centreline at arc lengths (m,) [m]."""
    return np.stack([np.interp(at, shape.arc_length, column) for column in shape.positions.T], axis=1)


def cloud(
    shape: cs.CableShape, seed: int, *, count: int = 400, noise: float = 0.002, stray: float = 0.1,
    hidden: tuple[float, float] = (0.0, 0.0),
) -> np.ndarray:  # fmt: skip
    """(count, 3) [m]; hidden: from one share of the length to another; stray: share of points spread around."""
    rng = np.random.default_rng(seed)
    of_cable = round((1.0 - stray) * count)
    low, high = hidden
    at = (1.0 - high + low) * rng.uniform(size=of_cable)
    at[at > low] += high - low
    on = places(shape, at * shape.length) + noise * rng.normal(size=(of_cable, 3))
    box = shape.positions.min(axis=0) - 0.15, shape.positions.max(axis=0) + 0.15
    return rng.permutation(np.concatenate((on, rng.uniform(*box, size=(count - of_cable, 3)))))
