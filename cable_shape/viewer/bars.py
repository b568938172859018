"""How much of each limit is used now, as bars: :class:`Bars`. Imports rerun: see recording."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import final

import rerun as rr

from cable_shape.cable.cable import Cable
from cable_shape.safety.report import Margin, WarningKind
from cable_shape.viewer import colour as colours
from cable_shape.viewer import text
from cable_shape.viewer.plots import MOST_USED, path, worst_used

_WIDTH = 0.8  # of all bars of one kind; kinds are 1 apart
_SEEN = 0.01  # of the limit; a smaller change of a bar is not
_LEGEND = 4.0  # kinds that the legend is wide


@final
class Bars:
    """Writes the entities below /margins at the recording's present time: a bar for each cable and kind of margin."""

    def __init__(self, recording: rr.RecordingStream, cables: Mapping[str, Cable]) -> None:
        self._recording = recording
        self._places = {name: k for k, name in enumerate(cables)}
        self._shown: dict[tuple[str, WarningKind], float] = {}

    def begin(self) -> None:
        """The limit, a pale bar of height 1 behind those of each kind; the legend has the room to the left of them."""
        count = len(text.MARGIN_KINDS)
        heights, places = [0.0, *[1.0] * count], [-_LEGEND, *range(count)]
        limit = rr.BarChart(heights, abscissa=places, widths=[_WIDTH] * (count + 1), color=colours.LIMIT)
        self._recording.log("/margins/limit", limit, static=True)

    def margins(self, name: str, margins: Sequence[Margin]) -> None:
        """The worst margin of each kind, at most twice the limit; what is no margin any more loses its bar."""
        used = worst_used(margins)
        for place, kind in enumerate(text.MARGIN_KINDS):
            value, shown = min(used.get(kind, 0.0), MOST_USED), self._shown.get((name, kind))
            if abs(value - (shown or 0.0)) < _SEEN and (value > 0.0 or not shown):
                continue
            label = text.kind_name(kind).replace(" ", "_")
            entity = f"/margins/{label}" if len(self._places) == 1 else f"/margins/{path(name)}/{label}"
            self._shown[name, kind] = value
            # where a bar stands and its colour are said once: making them anew takes as long as most of a report
            bar = self._bar(name, place, value) if shown is None else rr.BarChart.from_fields(values=[value])
            self._recording.log(entity, bar)

    def _bar(self, name: str, place: int, value: float) -> rr.BarChart:
        width = _WIDTH / len(self._places)
        at = place + width * (self._places[name] + 0.5) - 0.5 * _WIDTH
        return rr.BarChart([value], abscissa=[at], widths=[width], color=colours.KINDS[text.MARGIN_KINDS[place]])
