"""How much of each limit is used now, as bars with names: :class:`Bars`. Imports rerun: see recording."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, final

import numpy as np
import rerun as rr

from cable_shape.safety.report import Margin
from cable_shape.viewer import colour as colours
from cable_shape.viewer import text
from cable_shape.viewer.columns import Columns
from cable_shape.viewer.plots import MOST_USED

#: In the plane of the bars kinds are 1 apart, downwards; where each limit is, and what is seen of the plane.
AT_LIMIT = 6.5
SEEN = ((-8.6, MOST_USED * AT_LIMIT + 0.2), (-0.6, len(text.MARGIN_KINDS) - 0.4))
_HALF = 0.36  # of a bar's height
_NAMES, _ABOVE = -4.3, 0.45  # where names are, beside the bars: their middle, and how far below its point one is drawn
_LONGEST = 27  # characters of a name that are not cut off
_OWN = np.array([colours.KINDS[kind] for kind in text.MARGIN_KINDS], dtype=np.uint8)
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
        room = _bars(dict.fromkeys(range(len(text.MARGIN_KINDS)), 1.0), colours.ROOM)
        self._recording.log("/margins/room", rr.LineStrips2D(**room), static=True)
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
        self._columns.put("/margins/bars", rr.LineStrips2D, **_bars(used))
        places = np.array([(_NAMES, row - _ABOVE) for row in used]).reshape(-1, 2)
        white = np.array([colours.MARKER], dtype=np.uint8)
        self._columns.put(
            "/margins/names", rr.Points2D, positions=places, radii=np.zeros(1), colors=white,
            labels=[_fitting(worst[row][1]) for row in used], show_labels=[True],
        )  # fmt: skip


def _fitting(name: str) -> str:
    """A name and its number, without what there is no room for between them."""
    if len(name) <= _LONGEST:
        return name
    end = name[name.rindex(" ", 0, -2) :]
    return f"{name[: _LONGEST - len(end) - 1]}\u2026{end}"


def _bars(used: Mapping[int, float], colour: colours.Colour | None = None) -> dict[str, Any]:
    """Bars in these rows, in one colour or in those of the kinds: their ends are round, and within what is used."""
    rows, values = np.array(list(used), dtype=np.intp), np.array(list(used.values()), dtype=np.float64)
    half = np.minimum(_HALF, 0.5 * AT_LIMIT * values)
    ends = np.empty((len(rows), 2, 2))
    ends[:, 0, 0], ends[:, 1, 0], ends[:, :, 1] = half, AT_LIMIT * values - half, rows[:, None]
    own = _OWN[rows] if colour is None else np.tile(np.array(colour, dtype=np.uint8), (len(rows), 1))
    return {
        "strips": ends,
        "colors": own,
        "radii": half,
    }
