"""The margins of a cable whose start hangs free: :class:`TurnedWatch`."""

from __future__ import annotations

import dataclasses
from typing import Any, final

from cable_shape.checks import Array
from cable_shape.prediction.turned import turned_cable, turned_end, turned_shape
from cable_shape.safety.margins import MarginWatch
from cable_shape.safety.report import Clearance, Margin, WarningKind
from cable_shape.shape import CableShape


@final
class TurnedWatch:
    """As a `MarginWatch`, of a cable that is solved for as told from its end, see `prediction.turned`.

    Twists are those of the ends in that order.
    """

    def __init__(self, cable: Any, *args: Any, **options: Any) -> None:
        self.watch = MarginWatch(turned_cable(cable), *args, **options)
        self._length = cable.length

    def reset(self) -> None:
        """See `MarginWatch.reset`."""
        self.watch.reset()

    @property
    def stability(self) -> Margin | None:
        """See `MarginWatch.stability`."""
        found = self.watch.stability
        return None if found is None else self._flipped(found)

    @property
    def twists(self) -> Array | None:
        """See `MarginWatch.twists`."""
        return self.watch.twists

    @property
    def period(self) -> float:
        """See `MarginWatch.period`."""
        return self.watch.period

    def margins(
        self,
        shape: CableShape,
        clearance: Clearance,
        stamp: int,
        *,
        state: Any = None,
        ends: Any = None,
        held: bool = False,
    ) -> tuple[Margin, ...]:
        """See `MarginWatch.margins`."""
        table = None if clearance.table is None else clearance.table.copy()
        if table is not None:
            table[:, 1] = self._length - table[:, 1]
        bodies = tuple(dataclasses.replace(b, arc_length=self._length - b.arc_length) for b in clearance.bodies)
        turned = dataclasses.replace(clearance, bodies=bodies, table=table)
        if ends is not None:
            ends = turned_end(ends[1]), ends[0]
        found = self.watch.margins(turned_shape(shape), turned, stamp, state=state, ends=ends, held=held)
        own = {body.body: body.arc_length for body in clearance.bodies}  # to the bit: warnings find the body by it
        return tuple(
            m._replace(arc_length=own[m.other]) if m.kind is WarningKind.CLEARANCE else self._flipped(m) for m in found
        )

    def _flipped(self, margin: Margin) -> Margin:
        """With its arc length from the start."""
        return margin._replace(arc_length=self._length - margin.arc_length)
