"""A picture of a harness from three sides: :func:`draw`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from cable_shape.solve.harness_shape import HarnessShape

#: Segments of at most so many are named.
_NAMED = 12


def draw(case: Any, shape: HarnessShape, path: Path) -> None:
    """The segments of a HarnessCase, as thick as they are beside each other, with junctions, clips and held ends."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(14.0, 8.0), dpi=120, layout="constrained")
    FigureCanvasAgg(figure)
    figure.suptitle(f"{case.name}: {len(shape.segments)} segments, {shape.status.name}")
    grid = figure.add_gridspec(2, 2, width_ratios=(1.3, 1.0))
    places = (grid[:, 0], grid[0, 1], grid[1, 1])
    for place, (i, j) in zip(places, ((0, 2), (1, 2), (0, 1)), strict=True):
        _side(figure.add_subplot(place), case, shape, i, j)
    figure.savefig(path, metadata={"Software": None})


def _side(axis: Any, case: Any, shape: HarnessShape, i: int, j: int) -> None:
    thickest = max(cable.diameter for cable in case.harness.segments.values())
    for name, one in shape.segments.items():
        width = 0.8 + 3.0 * case.harness.segments[name].diameter / thickest
        axis.plot(one.positions[:, i], one.positions[:, j], color="#2563a8", lw=width, solid_capstyle="round")
        if len(shape.segments) <= _NAMED:
            middle = one.positions[one.points // 2]
            axis.annotate(name, (middle[i], middle[j]), fontsize=7)
    joints = np.array([pose.position for pose in shape.junctions.values()]).reshape(-1, 3)
    axis.plot(joints[:, i], joints[:, j], "o", ms=2.5, color="#444444", label="junctions")
    clips = [] if case.scene is None else [clip.pose.position for clip in case.scene.clips]
    held = [held.cable_frame.position for held in case.ends.values() if hasattr(held, "cable_frame")]
    for points, mark, label in ((clips, "^", "clips"), (held, "s", "held ends")):
        if points:
            at = np.array(points)
            axis.plot(at[:, i], at[:, j], mark, ms=7, color="#d98e04", label=label, zorder=3)
    axis.set(xlabel=f"{'xyz'[i]} [m]", ylabel=f"{'xyz'[j]} [m]", aspect="equal", adjustable="datalim")
    axis.legend(loc="best", fontsize=8)
