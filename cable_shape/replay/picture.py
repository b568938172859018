"""report.png of a replay: what happened over time, and how long the cycles took."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cable_shape.checks import Array

if TYPE_CHECKING:
    from cable_shape.replay.outcome import Outcome

_BLUE, _AMBER, _RED, _GREY = "#2563a8", "#d98e04", "#c0392b", "#666666"


def draw(outcome: Outcome, path: Path) -> None:
    """Writes the picture; without a screen."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10.0, 7.2), dpi=120)
    FigureCanvasAgg(figure)
    axes = figure.subplots(2, 2)
    figure.suptitle(f"{outcome.bag.name}: {outcome.tally.cycles} cycles", fontsize=12)
    _clearance(axes[0, 0], outcome)
    _markers(axes[0, 1], outcome)
    _loads(axes[1, 0], outcome)
    _times(axes[1, 1], outcome)
    figure.subplots_adjust(left=0.08, right=0.96, bottom=0.08, top=0.89, wspace=0.4, hspace=0.34)
    figure.savefig(path, metadata={"Software": None})


def _clearance(axis: Any, outcome: Outcome) -> None:
    tally, scene = outcome.tally, outcome.settings.scene
    axis.set(title="clearance", xlabel="time [s]", ylabel="[mm]")
    clearance = drawable(tally.clearance)
    if np.isfinite(clearance).any():
        time = tally.seconds(tally.stamps)
        axis.plot(time, 1e3 * clearance, ".-", color=_BLUE, lw=1.2, ms=2.0)  # single cycles, too
        axis.set_xlim(time.min() - 0.05 * np.ptp(time), time.max() + 0.05 * np.ptp(time) + 1e-9)
        if scene is not None:
            axis.axhline(1e3 * scene.warn_distance, color=_AMBER, lw=0.8, ls="--", label="warn")
            axis.axhline(1e3 * scene.error_distance, color=_RED, lw=0.8, ls="--", label="error")
            axis.legend(loc="best", fontsize=8)
    else:
        checked = scene is not None or outcome.settings.robot is not None
        _say(axis, "nothing came near" if checked else "not checked: no scene, no robot")


def _markers(axis: Any, outcome: Outcome) -> None:
    axis.set(title="markers to centreline", xlabel="time [s]", ylabel="[% of length]")
    markers = outcome.markers
    figures = None if markers is None else markers.figures()
    if markers is None or figures is None:
        _say(axis, "no markers to compare with")
        return
    stamps = np.array([stamp for stamp, _ in markers.series])
    means = np.array([mean for _, mean in markers.series])
    axis.plot(
        outcome.tally.seconds(stamps), 100.0 * means / markers.length, color=_BLUE, lw=1.2, label="mean of a frame"
    )
    radii = np.array(markers.radii)
    if figures.inside is not None:
        label = f"radius of the tube, which holds {100.0 * figures.inside:.1f} %"
        axis.plot(outcome.tally.seconds(stamps), 100.0 * radii / markers.length, color=_AMBER, lw=0.8, label=label)
    axis.axhline(100.0 * figures.mean, color=_GREY, lw=0.8, ls="--", label=f"mean {100.0 * figures.mean:.2f} %")
    axis.set_ylim(bottom=0.0)
    axis.legend(loc="best", fontsize=8)


def _loads(axis: Any, outcome: Outcome) -> None:
    tally, cable = outcome.tally, outcome.settings.cable
    time = tally.seconds(tally.stamps)
    axis.set(title="smallest bend radius and largest tension", xlabel="time [s]", ylabel="bend radius [mm]")
    axis.plot(time, 1e3 * drawable(tally.bend_radius), color=_BLUE, lw=1.2)
    axis.yaxis.label.set_color(_BLUE)
    if cable is not None and cable.min_bend_radius is not None:
        axis.axhline(1e3 * cable.min_bend_radius, color=_RED, lw=0.8, ls="--")
    other = axis.twinx()
    other.plot(time, drawable(tally.tension), color=_AMBER, lw=1.2)
    other.set_ylabel("tension [N]", color=_AMBER)


def _times(axis: Any, outcome: Outcome) -> None:
    from matplotlib.ticker import LogLocator, NullFormatter

    times = 1e6 * np.array(outcome.tally.cycle_time)
    axis.set(title="cycle time", xlabel="[µs]", ylabel="cycles")
    shortest, longest = 0.9 * times.min(), 1.1 * times.max()
    if longest < 10.0 * shortest:
        axis.hist(times, bins=60, color=_BLUE)
    else:
        axis.hist(times, bins=np.geomspace(shortest, longest, 60), color=_BLUE)
        axis.set_xscale("log")
        axis.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.xaxis.set_major_formatter("{x:g}")
        axis.xaxis.set_minor_formatter(NullFormatter())
    for share, colour in ((50.0, _GREY), (99.0, _RED)):
        value = float(np.percentile(times, share))
        axis.axvline(value, color=colour, lw=0.8, ls="--", label=f"p{share:.0f} {value:.0f} µs")
    axis.legend(loc="best", fontsize=8)


def _say(axis: Any, words: str) -> None:
    axis.text(0.5, 0.5, words, ha="center", va="center", color=_GREY, transform=axis.transAxes)
    axis.set(xticks=[], yticks=[])


def drawable(values: Any) -> Array:
    """`values` with everything that is not finite as NaN, which is left out of a line."""
    a = np.array(values, dtype=np.float64)
    a[~np.isfinite(a)] = np.nan
    return a
