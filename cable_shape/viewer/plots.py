"""Numbers over time: :class:`Plots`. Imports rerun: see recording."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from functools import cache
from typing import Any, final

import numpy as np
import rerun as rr

from cable_shape.cable.cable import Cable
from cable_shape.checks import Array
from cable_shape.safety.report import Clearance, Margin, WarningKind
from cable_shape.scene.scene import Scene
from cable_shape.shape import CableShape
from cable_shape.viewer import colour as colours
from cable_shape.viewer import text
from cable_shape.viewer.columns import Time, times_of

MOST_USED = 2.0  # of a limit, that is plotted


@final
class Plots:
    """Writes the entities below /plots: each number at once, or, `later`, column by column when it is flushed."""

    def __init__(
        self, recording: rr.RecordingStream, cables: Mapping[str, Cable], scene: Scene, times: bool, later: bool = False
    ) -> None:
        self._recording = recording
        self._cables = cables
        self._scene = scene
        self._times = times
        self._later = later
        self._now: Time = np.timedelta64(0, "ns")
        self._waiting: dict[str, list[tuple[Time, tuple[float, ...]]]] = {}

    def at(self, time: Time) -> None:
        """Of what is plotted from now on."""
        self._now = time

    def flush(self) -> None:
        """Writes what waits: a column takes as long as a few numbers by themselves."""
        for entity, rows in self._waiting.items():
            numbers = rr.Scalars.columns(scalars=np.array([values for _, values in rows]))
            self._recording.send_columns(entity, [times_of([time for time, _ in rows])], numbers)
        self._waiting.clear()

    def _plot(self, entity: str, *values: float) -> None:
        if self._later:
            self._waiting.setdefault(entity, []).append((self._now, values))
        else:
            self._recording.log(entity, rr.Scalars(values))

    def _write(self, entity: str, what: Any) -> None:
        self._recording.log(entity, what, static=True)

    def begin(self, markers: bool = False) -> None:
        """Names and colours of the plotted lines; markers: those of the distances of markers, too."""
        several = len(self._cables) > 1
        palette = ((38, 198, 218), (186, 147, 255), (129, 212, 160), (255, 213, 79), (240, 98, 146))
        for k, name in enumerate(self._cables):
            colour = palette[k % len(palette)]
            for plot in ("clearance", "bend_radius", "tension"):
                label = f"{name}" if several else plot.replace("_", " ")
                style = rr.SeriesLines(colors=[colour], names=[label], widths=[2.0])
                self._write(f"/plots/{plot}/{path(name)}", style)
            for kind in text.MARGIN_KINDS:
                label = f"{name} {text.kind_name(kind)}" if several else text.kind_name(kind)
                style = rr.SeriesLines(colors=[colours.KINDS[kind]], names=[label], widths=[2.0])
                self._write(f"/plots/margins/{path(name)}/{kind.name.lower()}", style)
        line = rr.SeriesLines(colors=[colours.RED], names=["limit"], widths=[1.0])
        self._write("/plots/margins/limit", line)
        limits = rr.SeriesLines(colors=[colours.AMBER, colours.RED], names=["warn", "error"], widths=[1.0])
        self._write("/plots/clearance/limits", limits)
        if self._times:
            cycle = rr.SeriesLines(
                colors=[(38, 198, 218), (255, 213, 79)], names=["cycle", "of it prediction"], widths=[2.0]
            )
            self._write("/plots/time/cycle", cycle)
        if markers:
            far = rr.SeriesLines(colors=[palette[0], palette[3]], names=["mean", "largest"], widths=[2.0, 1.0])
            self._write("/plots/markers/distance", far)
            tube = rr.SeriesLines(colors=[palette[1]], names=["radius of the tube"], widths=[1.0])
            self._write("/plots/markers/tube", tube)
            inside = rr.SeriesLines(colors=[palette[2]], names=["inside the tube [%]"], widths=[1.0])
            self._write("/plots/markers/inside", inside)

    def shape(self, name: str, shape: CableShape, clearance: Clearance | None, meant: Collection[str] = ()) -> None:
        """Numbers over time. A bend radius above the cable's length is drawn as that length: as good as straight.

        meant: bodies that the cable may touch anywhere, and whose clearance is not plotted.
        """
        if clearance is not None:
            apart = (body.distance for body in clearance.bodies if body.body not in meant)
            distance = min(apart, default=clearance.beyond)
            if np.isfinite(distance):
                self._plot(f"/plots/clearance/{path(name)}", 1e3 * distance)
                limits = 1e3 * self._scene.warn_distance, 1e3 * self._scene.error_distance
                self._plot("/plots/clearance/limits", *limits)
        radius = min(float(shape.bend_radius.min()), shape.length)
        self._plot(f"/plots/bend_radius/{path(name)}", 1e3 * radius)
        self._plot(f"/plots/tension/{path(name)}", float(shape.tension.max()))

    def margins(self, name: str, margins: Sequence[Margin]) -> None:
        """How much of each limit is used over time; of all bodies the nearest, and nothing beyond twice the limit."""
        worst = worst_used(margins)
        for kind, used in worst.items():
            entity = f"/plots/margins/{path(name)}/{kind.name.lower()}"
            self._plot(entity, min(used, MOST_USED))
        if worst:
            self._plot("/plots/margins/limit", 1.0)

    def markers(self, distances: Array, radii: Array | None) -> None:
        """Distances (m,) [m] of the markers of a frame from the centreline, and radii (m,) [m] of the tube there."""
        far = 1e3 * float(distances.mean()), 1e3 * float(distances.max())
        self._plot("/plots/markers/distance", *far)
        if radii is not None:
            self._plot("/plots/markers/tube", 1e3 * float(radii.mean()))
            self._plot("/plots/markers/inside", 100.0 * float((distances <= radii).mean()))

    def times(self, total: float, predict: float) -> None:
        """How long a cycle took [s], and the prediction in it."""
        self._plot("/plots/time/cycle", 1e3 * total, 1e3 * predict)


def worst_used(margins: Sequence[Margin]) -> dict[WarningKind, float]:
    """How much is used of the margin of each kind that is used up most."""
    worst: dict[WarningKind, float] = {}
    for margin in margins:
        worst[margin.kind] = max(margin.used, worst.get(margin.kind, 0.0))
    return worst


@cache
def path(name: str) -> str:
    """A cable's name as an entity path: segments of a harness lie below it."""
    return "/".join(map(part, name.split("/")))


@cache
def part(name: str) -> str:
    """A name as one part of an entity path."""
    return rr.escape_entity_path_part(name)
