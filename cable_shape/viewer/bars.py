"""How much of each limit is used now, as bars with names: :class:`Bars`. Imports rerun: see recording."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import final

import numpy as np
import rerun as rr

from cable_shape.safety.report import Margin
from cable_shape.viewer import colour as colours
from cable_shape.viewer import text
from cable_shape.viewer.columns import Columns, rgba, strips
from cable_shape.viewer.plots import MOST_USED

#: In the plane of the bars kinds are 1 apart, downwards; where each limit is, and what is seen of the plane.
AT_LIMIT = 6.5
SEEN = ((-0.2, MOST_USED * AT_LIMIT + 0.2), (-0.6, len(text.MARGIN_KINDS) - 0.4))
_HALF = 0.36  # of a bar's height
_ABOVE = 0.45  # a name is drawn below its point
_STEP = 0.01  # of the limit; a smaller change of a bar is not seen


@final
class Bars:
    """Writes the entities below /margins at the columns' present time: of each kind the margin most used up."""

    def __init__(self, recording: rr.RecordingStream, columns: Columns) -> None:
        self._recording = recording
        self._columns = columns
        self._shown: list[tuple[int, str]] = []

    def begin(self) -> None:
        """The room up to each limit, pale, and a line at it."""
        rows = range(len(text.MARGIN_KINDS))
        self._recording.log("/margins/room", _strips(dict.fromkeys(rows, 1.0), [colours.ROOM] * len(rows)), static=True)
        line = rr.LineStrips2D([[(AT_LIMIT, end) for end in SEEN[1]]], colors=colours.RED, radii=0.03)
        self._recording.log("/margins/limit", line, static=True)

    def margins(self, of_all: Mapping[str, Sequence[Margin]]) -> None:
        """Of all cables the worst margin of each kind, at most twice the limit; what is no margin has no bar."""
        worst: dict[int, tuple[float, str]] = {}
        for name, margins in of_all.items():
            for margin in margins:
                row = text.MARGIN_KINDS.index(margin.kind)
                if row not in worst or margin.used > worst[row][0]:
                    worst[row] = margin.used, text.margin(margin, name if len(of_all) > 1 else "")
        used = {row: min(value, MOST_USED) for row, (value, _) in sorted(worst.items())}
        shown = [(round(value / _STEP), worst[row][1]) for row, value in used.items()]
        if shown == self._shown:
            return
        self._shown = shown
        self._columns.write("/margins/bars", _strips(used, [colours.KINDS[text.MARGIN_KINDS[row]] for row in used]))
        names = rr.Points2D(
            [(AT_LIMIT, row - _ABOVE) for row in used], radii=0.0, colors=colours.MARKER, show_labels=True,
            labels=[worst[row][1] for row in used],
        )  # fmt: skip
        self._columns.write("/margins/names", names)


def _strips(used: Mapping[int, float], colour: Sequence[colours.Colour]) -> rr.LineStrips2D:
    """Bars in these rows: their ends are round, and within what is used."""
    half = [min(_HALF, 0.5 * AT_LIMIT * value) for value in used.values()]
    ends = [((r, row), (AT_LIMIT * value - r, row)) for r, (row, value) in zip(half, used.items(), strict=True)]
    return rr.LineStrips2D(
        strips(np.reshape(ends, (-1, 2, 2))), colors=rgba(np.array(colour, dtype=np.uint8)), radii=half
    )
