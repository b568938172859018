"""The next second of cables and harnesses that touch each other, if all their ends go on as they do: :class:`Together`.

Cables that press on each other snap together. One look at all of them, moved all at once, tells each what it has to
expect; of each by itself there would be as many looks, and the others would stand still in it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, final

import numpy as np

from cable_shape.checks import Array
from cable_shape.prediction.together import rows_of
from cable_shape.safety.margins import LONGEST_GAP
from cable_shape.safety.snap import LONGER, LOOKS, Find, Found, first_snap, moved_frame, twist_between
from cable_shape.shape import CableShape
from cable_shape.solve.harness_shape import HarnessShape
from cable_shape.solve.touching.crossing import Crossing
from cable_shape.solve.touching.one_harness import OneHarness


@final
class Together:
    """Looks ahead for cables and harnesses that touch each other; links stay where they are.

    predictors: by name, of what the crossing solves for, in its order. horizon: [s], as of `SnapWatch`.
    """

    def __init__(self, crossing: Crossing, predictors: Mapping[str, Any], horizon: float) -> None:
        self.crossing, self._predictors, self._rows = crossing, dict(predictors), rows_of(predictors)
        self._horizon = LONGER * horizon
        self._stamp, self._frames = -math.inf, np.empty((0, 7))
        self._twists: Callable[[], Array] | None = None
        self._looked = -math.inf  # ns
        self._shapes_at: Callable[[float], dict[str, Any]] = _nothing

    def find(self, stamp: int) -> dict[str, Find]:
        """Once a cycle, after the crossing has solved: what looks for a snap of each that touches others.

        None of them does where it is not known how the ends move.
        """
        touching = self.crossing.touching
        before, now, seconds = self._frames, self.crossing.frames, (stamp - self._stamp) * 1e-9
        self._stamp, self._frames, self._twists = stamp, now, None
        if not (touching and self._horizon > 0.0 and 0.0 < seconds <= LONGEST_GAP and len(before) == len(now)):
            return {}
        self._twists = partial(_twists, before, now, seconds)
        return {
            name: partial(self._snap, name)
            for name, own in self._rows.items()
            if not (touching.isdisjoint(own) or touching <= set(own))
        }

    def _snap(self, name: str, horizon: float) -> Found | None:
        """See `predicted_snap`. One look serves all that look in the time until the next one is due."""
        age = (self._stamp - self._looked) * 1e-9
        if not 0.0 <= age < horizon / LOOKS:
            self._looked, age = self._stamp, 0.0
            self._shapes_at = self._from_here()
        found = first_snap(lambda time: self._shapes_at(time)[name], self._horizon)
        if found is None or found[0] - age >= horizon:
            return None
        return found[0] - age, found[1] - age, found[2]

    def _from_here(self) -> Callable[[float], dict[str, CableShape | HarnessShape]]:
        """What tells all shapes by the time [s] from now, which is asked for in its order; those of a loss stay."""
        assert self._twists is not None
        frames, twists, twin = self._frames, self._twists(), self.crossing.twin()
        twists[2 * len(twin.strands.names) :] = 0.0  # links
        twin.afresh = False  # of a snap to where nothing is known nobody could be warned in time
        known: dict[float, dict[str, CableShape | HarnessShape]] = {}

        def at(time: float) -> dict[str, CableShape | HarnessShape]:
            if time not in known:
                last = known[next(reversed(known))] if known else {}
                if all(shape.status for shape in last.values()):
                    twin.strands.hold(np.array([moved_frame(*end, time) for end in zip(frames, twists, strict=True)]))
                    last = self._told(twin)
                known[time] = last
            return known[time]

        return at

    def _told(self, twin: Crossing) -> dict[str, CableShape | HarnessShape]:
        """Each as its predictor tells it."""
        shapes = twin.solve()
        out: dict[str, CableShape | HarnessShape] = {}
        for (name, rows), part in zip(self._rows.items(), twin.strands.parts, strict=True):
            own = shapes[rows.start : rows.stop]
            out[name] = part.as_one(own) if isinstance(part, OneHarness) else self._predictors[name].told(own[0])
        return out


def _twists(before: Array, now: Array, seconds: float) -> Array:
    """(n, 6), of frames (n, 7), see `twist_between`."""
    return np.array([twist_between(a, b, seconds) for a, b in zip(before, now, strict=True)])


def _nothing(_: float) -> dict[str, Any]:
    return {}
