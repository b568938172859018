"""Rest curvature at nine supports: put into synthetic cables and found again; drawn as the shape at rest."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

import cable_shape as cs
from cable_shape.calibration.parameters import WANDERS, along, smoothness

#: Supports, observations of a cable and points of each.
ROWS, SEEN, POINTS = 9, 8, 20
NOISE = 5e-4  # m


def ends_of(rng: np.random.Generator, length: float) -> tuple[cs.Pose, cs.Pose]:
    """Two ends with slack, their tangents up to some 30 degrees off the chord."""
    way = np.array((1.0, 0.0, 0.0)) + 0.3 * rng.normal(size=3)
    way *= length * rng.uniform(0.5, 0.9) / np.linalg.norm(way)
    along_x = Rotation.from_quat((0.5, 0.5, 0.5, 0.5))
    turns = [(Rotation.from_rotvec(0.3 * rng.normal(size=3)) * along_x).as_quat() for _ in range(2)]
    return cs.Pose((0, 0, 0), turns[0]), cs.Pose(way, turns[1])


def drawn(rng: np.random.Generator, rows: int, length: float) -> np.ndarray:
    """(rows, 3) [1/m]: a rest curvature that varies as the prior of calibrations says, its mean about 1 / length."""
    sizes, vectors = np.linalg.eigh(smoothness(rows, WANDERS / length))
    out = np.zeros((rows, 3))
    out[:, :2] = (vectors[:, 1:] / np.sqrt(sizes[1:])) @ rng.normal(size=(rows - 1, 2))
    out[:, :2] += rng.normal(size=2) / length
    return out


def recovered_along(seed: int) -> np.ndarray:
    """(19,) bool: whether stiffness and rest curvature of a random cable are in their 95 % intervals."""
    rng = np.random.default_rng(seed)
    length, density = rng.uniform(0.5, 1.5), rng.uniform(0.02, 0.2)
    stiffness = density * 9.81 * (length * math.exp(rng.uniform(math.log(0.05), math.log(0.3)))) ** 3
    table = drawn(rng, ROWS, length)
    true = cs.Cable(length=length, linear_density=density, bending_stiffness=stiffness, rest_curvature=table)
    seen: list[cs.Observation] = []
    while len(seen) < SEEN:
        start, end = ends_of(rng, length)
        shape = cs.predict(true, start, end, model="cosserat", points=301)
        if shape.status is cs.Status.OK:
            points = shape.positions[np.sort(rng.integers(10, 291, POINTS))] + NOISE * rng.normal(size=(POINTS, 3))
            stray = rng.random(POINTS) < 0.05
            points[stray] += 0.05 * rng.normal(size=(int(stray.sum()), 3))
            seen.append(cs.Observation(start, end, points))
    begin = true.replace(
        bending_stiffness=stiffness * math.exp(0.5 * rng.normal()), twisting_stiffness=None, rest_curvature=(0, 0, 0)
    )
    found = cs.calibrate(seen, begin, ("bending_stiffness", "rest_curvature_along"), supports=ROWS)
    truth = dict(zip(along(ROWS), table[:, :2].ravel().tolist(), strict=True)) | {"bending_stiffness": stiffness}
    return np.array([found[name].low <= x <= found[name].high for name, x in truth.items()])


def draw_rest(fits: Mapping[int, Sequence[cs.Calibration]], picture: Path) -> None:
    """The shapes without load that the fits of each cable found, from two sides, each against a straight line."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(13.0, 2.4 * len(fits)), dpi=90)
    FigureCanvasAgg(figure)
    axes = figure.subplots(len(fits), 2, squeeze=False)
    level = cs.Pose((0.0, 0.0, 0.0), (0.5, 0.5, 0.5, 0.5))  # d1 = y, d2 = z, d3 = x
    for row, (number, found) in zip(axes, fits.items(), strict=True):
        for part, fit in enumerate(found, 1):
            shape = cs.predict(fit.cable, level, None, model="cosserat", gravity=(0.0, 0.0, 0.0))
            for axis, across, name in zip(row, (1, 2), ("d1", "d2"), strict=True):
                axis.plot(shape.positions[:, 0], shape.positions[:, across], lw=1.5, label=f"without part {part}")
                axis.set_title(f"cable{number} at rest, held level at the start, along {name} [m]", fontsize=9)
        for axis in row:
            axis.axhline(0.0, color="#666666", lw=0.8, ls="--")
            axis.set_aspect("equal", adjustable="datalim")
            axis.tick_params(labelsize=8)
    axes[0, 0].legend(fontsize=8)
    figure.tight_layout()
    figure.savefig(picture, metadata={"Software": None})
