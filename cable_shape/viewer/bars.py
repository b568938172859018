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
        width = _WIDTH / len(self._places)
        for place, kind in enumerate(text.MARGIN_KINDS):
            value = min(used.get(kind, 0.0), MOST_USED)
            if self._shown.get((name, kind), 0.0) == value:
                continue
            self._shown[name, kind] = value
            at = place + width * (self._places[name] + 0.5) - 0.5 * _WIDTH
            bar = rr.BarChart([value], abscissa=[at], widths=[width], color=colours.KINDS[kind])
            label = text.kind_name(kind).replace(" ", "_")
            entity = label if len(self._places) == 1 else f"{path(name)}/{label}"
            self._recording.log(f"/margins/{entity}", bar)
