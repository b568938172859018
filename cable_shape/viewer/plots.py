"""Numbers over time: :class:`Plots`. Imports rerun: see recording."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
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

MOST_USED = 2.0  # of a limit, that is plotted


@final
class Plots:
    """Writes the entities below /plots at the recording's present time."""

    def __init__(self, recording: rr.RecordingStream, cables: Mapping[str, Cable], scene: Scene, times: bool) -> None:
        self._recording = recording
        self._cables = cables
        self._scene = scene
        self._times = times

    def _write(self, entity: str, what: Any, static: bool = False) -> None:
        self._recording.log(entity, what, static=static)

    def begin(self, markers: bool = False) -> None:
        """Names and colours of the plotted lines; markers: those of the distances of markers, too."""
        several = len(self._cables) > 1
        palette = ((38, 198, 218), (186, 147, 255), (129, 212, 160), (255, 213, 79), (240, 98, 146))
        for k, name in enumerate(self._cables):
            colour = palette[k % len(palette)]
            for plot in ("clearance", "bend_radius", "tension"):
                label = f"{name}" if several else plot.replace("_", " ")
                style = rr.SeriesLines(colors=[colour], names=[label], widths=[2.0])
                self._write(f"/plots/{plot}/{path(name)}", style, static=True)
            for kind in text.MARGIN_KINDS:
                label = f"{name} {text.kind_name(kind)}" if several else text.kind_name(kind)
                style = rr.SeriesLines(colors=[colours.KINDS[kind]], names=[label], widths=[2.0])
                self._write(f"/plots/margins/{path(name)}/{kind.name.lower()}", style, static=True)
        line = rr.SeriesLines(colors=[colours.RED], names=["limit"], widths=[1.0])
        self._write("/plots/margins/limit", line, static=True)
        limits = rr.SeriesLines(colors=[colours.AMBER, colours.RED], names=["warn", "error"], widths=[1.0])
        self._write("/plots/clearance/limits", limits, static=True)
        if self._times:
            cycle = rr.SeriesLines(
                colors=[(38, 198, 218), (255, 213, 79)], names=["cycle", "of it prediction"], widths=[2.0]
            )
            self._write("/plots/time/cycle", cycle, static=True)
        if markers:
            far = rr.SeriesLines(colors=[palette[0], palette[3]], names=["mean", "largest"], widths=[2.0, 1.0])
            self._write("/plots/markers/distance", far, static=True)
            tube = rr.SeriesLines(colors=[palette[1]], names=["radius of the tube"], widths=[1.0])
            self._write("/plots/markers/tube", tube, static=True)

    def shape(self, name: str, shape: CableShape, clearance: Clearance | None) -> None:
        """Numbers over time. A bend radius above the cable's length is drawn as that length: as good as straight."""
        if clearance is not None:
            closest = clearance.closest
            distance = clearance.beyond if closest is None else closest.distance
            if np.isfinite(distance):
                self._write(f"/plots/clearance/{path(name)}", rr.Scalars(1e3 * distance))
                self._write(
                    "/plots/clearance/limits",
                    rr.Scalars((1e3 * self._scene.warn_distance, 1e3 * self._scene.error_distance)),
                )
        radius = min(float(shape.bend_radius.min()), shape.length)
        self._write(f"/plots/bend_radius/{path(name)}", rr.Scalars(1e3 * radius))
        self._write(f"/plots/tension/{path(name)}", rr.Scalars(float(shape.tension.max())))

    def margins(self, name: str, margins: Sequence[Margin]) -> None:
        """How much of each limit is used over time; of all bodies the nearest, and nothing beyond twice the limit."""
        worst = worst_used(margins)
        for kind, used in worst.items():
            entity = f"/plots/margins/{path(name)}/{kind.name.lower()}"
            self._write(entity, rr.Scalars(min(used, MOST_USED)))
        if worst:
            self._write("/plots/margins/limit", rr.Scalars(1.0))

    def markers(self, distances: Array, radii: Array | None) -> None:
        """Distances (m,) [m] of the markers of a frame from the centreline, and radii (m,) [m] of the tube there."""
        far = 1e3 * float(distances.mean()), 1e3 * float(distances.max())
        self._write("/plots/markers/distance", rr.Scalars(far))
        if radii is not None:
            self._write("/plots/markers/tube", rr.Scalars(1e3 * float(radii.mean())))

    def times(self, total: float, predict: float) -> None:
        """How long a cycle took [s], and the prediction in it."""
        self._write("/plots/time/cycle", rr.Scalars((1e3 * total, 1e3 * predict)))


def worst_used(margins: Sequence[Margin]) -> dict[WarningKind, float]:
    """How much is used of the margin of each kind that is used up most."""
    worst: dict[WarningKind, float] = {}
    for margin in margins:
        worst[margin.kind] = max(margin.used, worst.get(margin.kind, 0.0))
    return worst


def path(name: str) -> str:
    """A cable's name as an entity path: segments of a harness lie below it."""
    return "/".join(map(part, name.split("/")))


def part(name: str) -> str:
    """A name as one part of an entity path."""
    return rr.escape_entity_path_part(name)
