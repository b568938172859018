"""What a work-precision diagram is made of: :class:`Point`, and the :data:`Series` of one problem."""

from __future__ import annotations

from typing import NamedTuple


class Point(NamedTuple):
    """One setting of one model: time [s], mean error / length, what was set, and elements or links."""

    time: float
    error: float
    setting: str
    size: int = 0


#: By model.
Series = dict[str, list[Point]]
