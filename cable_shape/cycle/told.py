"""What a report tells beside the shapes, of cables and of segments of harnesses."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from cable_shape.cycle.cable_cycle import CableCycle
from cable_shape.cycle.harness_cycle import HarnessCycle


def beside(cables: Mapping[str, CableCycle], held: Mapping[str, HarnessCycle]) -> dict[str, Any]:
    """Tails, what comes after a snap, and what swings ahead, as arguments of a :class:`CycleReport`."""
    return {
        "tails": {
            **{(name, side): tail for name, cable in cables.items() for side, tail in cable.tails.items()},
            **{key: tail for harness in held.values() for key, tail in harness.tails.items()},
        },
        "after_snap": {
            **{name: cable.after_snap for name, cable in cables.items() if cable.after_snap is not None},
            **{one: shape for harness in held.values() for one, shape in harness.after_snap.items()},
        },
        "ahead": {
            **{name: cable.ahead for name, cable in cables.items() if cable.ahead is not None},
            **{one: ahead for harness in held.values() for one, ahead in harness.ahead.items()},
        },
        "tail_tubes": {
            **{(name, side): tube for name, cable in cables.items() for side, tube in cable.tail_tubes.items()},
            **{key: tube for harness in held.values() for key, tube in harness.tail_tubes.items()},
        },
    }
