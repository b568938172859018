"""The pictures of a study's report, as SVG: curves over what varies and over time, shares, shapes from three sides."""

from __future__ import annotations

import io
import math
from collections.abc import Iterable, Mapping, Sequence
from textwrap import fill
from typing import Any

import numpy as np

from cable_shape.checks import Array
from cable_shape.planning.study_measure import Measure
from cable_shape.planning.study_result import StudyResult
from cable_shape.planning.study_spread import Shares
from cable_shape.planning.study_vary import Axis
from cable_shape.planning.study_walk import Rows
from cable_shape.scene.scene import Box, Cylinder, HalfSpace, HeightField, Mesh, Obstacle, Points, Scene, Sphere

BLUE, AMBER, RED, GREY = "#2563a8", "#d98e04", "#c0392b", "#666666"
#: Values from which a number is drawn in thousandths, or in millions.
_FACTORS = {"m": (1e3, "mm"), "Pa": (1e-6, "MPa")}
_RING: Array = np.array([(math.cos(a), math.sin(a)) for a in np.linspace(0.0, 2.0 * math.pi, 25)])


def scaled(measure: Measure) -> tuple[float, str]:
    """What values are multiplied with to be drawn, and their unit then."""
    return _FACTORS.get(measure.unit, (1.0, measure.unit))


def svg(figure: Any) -> str:
    """A figure as an element of a page, the same in every run."""
    from matplotlib import rc_context
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    out = io.StringIO()
    FigureCanvasSVG(figure)
    with rc_context({"svg.hashsalt": "cable_shape"}):
        figure.savefig(out, format="svg", metadata={"Date": None})
    text = out.getvalue()
    return text[text.index("<svg") :]


def _figure(width: float, height: float) -> Any:
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


def curves(found: StudyResult, k: int) -> str:
    """A measure's worst values over what varies, with its limit; points without a shape somewhere are marked."""
    axes = found.study.axes
    lists = [i for i, axis in enumerate(axes) if not axis.law and len(axis.values) > 1]
    if len(axes) == 2 and len(lists) == 2 and not any(axis.words for axis in axes):
        return _map(found, k)
    shown = [i for i, axis in enumerate(axes) if axis.law or len(axis.values) > 1][:4]
    figure = _figure(4.6 * max(len(shown), 1) + 1.4, 3.1)
    for axis, i in zip(figure.subplots(1, max(len(shown), 1), sharey=True, squeeze=False)[0], shown, strict=False):
        _over(axis, found, k, i, line=len(shown) == 1 and not (axes[i].law or axes[i].words))
    return svg(figure)


def _over(axis: Any, found: StudyResult, k: int, i: int, line: bool) -> None:
    """Over one thing that varies."""
    measure = found.study.measures[k]
    factor, unit = scaled(measure)
    x, y = found.points[:, i], factor * np.where(np.isfinite(found.value[:, k]), found.value[:, k], math.nan)
    axis.plot(x, y, "-" if line else ".", color=BLUE, lw=1.4, ms=3, label="worst of all instants")
    limits = factor * found.limit[:, k]
    if not np.isnan(limits).all():
        order = np.argsort(x)
        axis.plot(x[order], limits[order], "--", color=RED, lw=1.0, label="limit")
    good = x[found.within] if line else x[:0]
    if good.size:
        step = float(np.diff(np.unique(x)).min(initial=0.0)) / 2.0
        axis.axvspan(good.min() - step, good.max() + step, color="#2e9e5b", alpha=0.12, label="within all limits")
    bad = ~found.complete
    if bad.any():
        axis.plot(
            x[bad], np.zeros(bad.sum()), "|", color=AMBER, transform=axis.get_xaxis_transform(), ms=9, label="no shape"
        )
    axis.set(xlabel=found.study.axes[i].name, ylabel=f"{measure.name} [{unit}]" if unit else measure.name)
    words = found.study.axes[i].words
    if words:
        axis.set_xticks(range(len(words)), words)
    axis.grid(alpha=0.25)
    axis.legend(loc="best", fontsize=8)


def _map(found: StudyResult, k: int) -> str:
    """Over two things that vary, as colours, with the limit as a line."""
    measure = found.study.measures[k]
    factor, unit = scaled(measure)
    first, second = found.study.axes
    shape = len(first.values), len(second.values)
    values = factor * np.where(np.isfinite(found.value[:, k]), found.value[:, k], math.nan).reshape(shape)
    figure = _figure(6.6, 4.4)
    axis = figure.subplots()
    drawn = axis.pcolormesh(second.values, first.values, values, shading="nearest", cmap="viridis")
    figure.colorbar(drawn, label=f"{measure.name} [{unit}]" if unit else measure.name)
    limit = factor * found.limit[:, k].reshape(shape)
    if not np.isnan(limit).any() and np.nanmin(values - limit) < 0.0 < np.nanmax(values - limit):
        axis.contour(second.values, first.values, values - limit, levels=[0.0], colors=RED)
    axis.set(xlabel=second.name, ylabel=first.name)
    return svg(figure)


def over_time(measure: Measure, limit: float, series: Mapping[str, tuple[Any, Array]]) -> str:
    """Values at all instants of a few points, by what they are called; x and values of each."""
    factor, unit = scaled(measure)
    figure = _figure(6.0, 2.8)
    axis = figure.subplots()
    for (name, (x, values)), colour in zip(series.items(), (BLUE, AMBER, GREY), strict=False):
        axis.plot(
            x, factor * np.where(np.isfinite(values), values, math.nan), color=colour, lw=1.3, label=fill(name, 48)
        )
    if not math.isnan(limit):
        axis.axhline(factor * limit, color=RED, ls="--", lw=1.0, label="limit")
    axis.set(xlabel="instant", ylabel=f"{measure.name} [{unit}]" if unit else measure.name)
    axis.grid(alpha=0.25)
    axis.legend(loc="best", fontsize=8)
    return svg(figure)


def around(axis: Axis, values: Array, series: Mapping[str, Array], best: float, used: float) -> str:
    """What measures use of their limits [%] as one thing varies about the best point."""
    figure = _figure(5.6, 3.2)
    drawn = figure.subplots()
    for name, told in series.items():
        drawn.plot(values, told, "o-" if axis.words else "-", lw=1.3, label=name)
    drawn.axhline(100.0, color=RED, ls="--", lw=1.0, label="limit")
    drawn.plot([best], [used], "o", color="black", ms=5, label="best")
    drawn.set(xlabel=axis.name, ylabel="used of the limit [%]")
    drawn.set_ylim(0.0, min(max(110.0, 1.5 * used), 400.0))
    if axis.words:
        drawn.set_xticks(range(len(axis.words)), axis.words)
    drawn.grid(alpha=0.25)
    drawn.legend(loc="best", fontsize=8)
    return svg(figure)


def shares(found: Shares, k: int) -> str:
    """What share of a measure's variance each source makes, told in three ways."""
    figure = _figure(8.4, 0.9 + 0.45 * len(found.sources))
    drawn = figure.subplots()
    order = np.argsort(np.nan_to_num(found.total[k]))
    told = (("first order", found.linear, GREY), ("alone", found.first, BLUE), ("with others", found.total, AMBER))
    for offset, (name, values, colour) in zip((0.26, 0.0, -0.26), told, strict=True):
        drawn.barh(np.arange(len(order)) + offset, 100.0 * values[k, order], 0.24, color=colour, label=name)
    drawn.set_yticks(range(len(order)), [found.sources[i] for i in order])
    drawn.set(xlabel="share of the variance [%]")
    drawn.grid(alpha=0.25, axis="x")
    drawn.legend(loc="lower right", fontsize=8)
    return svg(figure)


def tube(middle: Mapping[str, Array], radius: Mapping[str, Array], scene: Scene) -> str:
    """Mean shapes and the tubes about them from three sides, with the bodies around."""
    figure = _figure(11.4, 4.0)
    line = np.concatenate(list(middle.values()))
    for axis, (i, j) in zip(figure.subplots(1, 3), ((0, 2), (1, 2), (0, 1)), strict=True):
        _bodies(axis, scene, i, j)
        for name, points in middle.items():
            seen = points[:, [i, j]]
            rings = [(x + r * _RING) for x, r in zip(seen, radius[name], strict=True)]
            for ring in rings:
                axis.fill(*ring.T, facecolor=AMBER, edgecolor=AMBER, lw=0.3)
            axis.plot(*seen.T, color=BLUE, lw=1.2)
        _frame(axis, line, i, j)
    return svg(figure)


def along(radius: Mapping[str, Array]) -> str:
    """How wide the tube is along each cable."""
    figure = _figure(8.4, 2.6)
    axis = figure.subplots()
    for name, told in radius.items():
        axis.plot(np.linspace(0.0, 1.0, len(told)), 1e3 * told, color=None if name else BLUE, lw=1.4, label=name)
    axis.set(xlabel="arc length / length", ylabel="radius of the tube [mm]")
    axis.grid(alpha=0.25)
    if len(radius) > 1:
        axis.legend(loc="best", fontsize=8)
    return svg(figure)


def _bodies(axis: Any, scene: Scene, i: int, j: int) -> None:
    for body in scene.obstacles:
        outline = _outline(body, i, j)
        if outline is not None:
            axis.fill(*outline.T, facecolor="#c9d3dd", edgecolor="#8a97a5", lw=0.8, alpha=0.8)


def _frame(axis: Any, line: Array, i: int, j: int) -> None:
    """As much as all points (k, 3) need, the same to all sides."""
    middle, half = 0.5 * (line.min(axis=0) + line.max(axis=0)), 0.6 * float(np.ptp(line, axis=0).max())
    axis.set(xlim=(middle[i] - half, middle[i] + half), ylim=(middle[j] - half, middle[j] + half))
    axis.set(xlabel=f"{'xyz'[i]} [m]", ylabel=f"{'xyz'[j]} [m]", aspect="equal")


def shapes(found: Mapping[str, Rows], instant: int, places: Iterable[Array], scene: Scene) -> str:
    """The cable at an instant from three sides, all other instants in grey, bodies behind it, the places marked."""
    figure = _figure(11.4, 4.0)
    marks = list(places)
    for axis, (i, j) in zip(figure.subplots(1, 3), ((0, 2), (1, 2), (0, 1)), strict=True):
        _bodies(axis, scene, i, j)
        seen = []
        for rows in found.values():
            positions = rows.part(1, 3)
            for other in np.flatnonzero(rows.usable)[:: max(1, len(rows) // 25)].tolist():
                axis.plot(positions[other, :, i], positions[other, :, j], color="#9aa3ad", lw=0.4)
            axis.plot(positions[instant, :, i], positions[instant, :, j], color=BLUE, lw=2.4, solid_capstyle="round")
            seen.append(positions[np.isfinite(positions).all(axis=(1, 2))].reshape(-1, 3))
        for place in marks:
            axis.plot(place[i], place[j], "o", ms=8, mfc="none", mec=RED, mew=1.6)
        _frame(axis, np.concatenate(seen), i, j)
    return svg(figure)


def _outline(body: Obstacle, i: int, j: int) -> Array | None:
    """(k, 2): the outline of a body seen along the third axis, of a mesh that of its hull; None of a half-space."""
    from scipy.spatial import ConvexHull, QhullError

    points = _points(body.solid)
    if points is None:
        return None
    seen = (body.pose.position + points @ body.pose.matrix()[:3, :3].T)[:, [i, j]]
    try:
        return np.asarray(seen[ConvexHull(seen).vertices])
    except QhullError:
        return None


def _points(solid: Any) -> Array | None:
    """(k, 3): points whose hull is the solid's, or nearly so."""
    if isinstance(solid, HalfSpace):
        return None
    if isinstance(solid, (Points, HeightField)):
        return solid.centres
    if isinstance(solid, Mesh):
        return np.asarray(solid.vertices)
    if isinstance(solid, Box):
        corners = np.stack(np.meshgrid(*[(-0.5, 0.5)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
        return np.asarray(corners * solid.size)
    half = 0.0 if isinstance(solid, Sphere) else 0.5 * solid.length
    rings: Sequence[float] = (0.0,) if isinstance(solid, Cylinder) else np.linspace(-1.0, 1.0, 9).tolist()
    out = []
    for side in (-1.0, 1.0):
        for x in rings:
            width = solid.radius * math.sqrt(max(1.0 - x * x, 0.0))
            height = np.full(len(_RING), side * half + (solid.radius * x if not isinstance(solid, Cylinder) else 0.0))
            out.append(np.column_stack((width * _RING, height)))
    return np.concatenate(out)
