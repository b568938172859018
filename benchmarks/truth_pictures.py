"""Pictures of real cables: frames beside their predictions, and the rest shapes that fits found."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

import cable_shape as cs
from cable_shape.calibration.picture import side_view


def draw(done: dict[int, dict[str, Any]], picture: Path) -> None:
    """The best, a middling and the worst frame of each cable, seen from the side."""
    figure = Figure(figsize=(13.0, 15.0), dpi=90)
    FigureCanvasAgg(figure)
    axes = figure.subplots(len(done), 3)
    for row, (number, found) in zip(axes, done.items(), strict=True):
        order = sorted(found["shapes"], key=lambda shape: shape["mean"])
        for axis, which in zip(row, (0, len(order) // 2, len(order) - 1), strict=True):
            one = order[which]
            side_view(axis, one["moving"], one["points"])
            still, line = one["static"], one["moving"]
            across = line[-1, :2] - line[0, :2]
            x = (still[:, :2] - line[0, :2]) @ across / np.linalg.norm(across)
            axis.plot(x, still[:, 2], color="#d98e04", lw=1.0, ls="--", label="static, EI/w only")
            name = ("best", "middle", "worst")[(0, len(order) // 2, len(order) - 1).index(which)]
            axis.set_title(f"cable{number}, {name} frame: {100.0 * one['mean'] / found['length']:.2f} %", fontsize=9)
    axes[0, 0].legend(fontsize=8)
    figure.tight_layout()
    figure.savefig(picture, metadata={"Software": None})


def draw_rest(fits: Mapping[int, Sequence[cs.Calibration]], picture: Path) -> None:
    """The shapes without load that the fits of each cable found, from two sides, each against a straight line."""
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
