"""A shape that somebody has seen, which a cycle judges in place of the predicted one: :class:`AsSeen`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple, final

from cable_shape.shape import CableShape
from cable_shape.solve.harness_shape import HarnessShape
from cable_shape.uncertainty.uncertainty import Tube


@final
class AsSeen(NamedTuple):
    """What is seen of one cable or harness.

    tube: its tube, of a harness that of each segment by name, for clearance where tubes are asked for; None: it is not
    known. rod: the solver's memory of the shape, of which stability is told; None: it is not.
    """

    shape: CableShape | HarnessShape
    tube: Tube | Mapping[str, Tube] | None = None
    rod: Any = None
