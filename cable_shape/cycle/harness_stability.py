"""How far a harness is from a snap, cycle by cycle: :class:`HarnessStability`."""

from __future__ import annotations

import math
from functools import partial
from typing import Any, final

import numpy as np

from cable_shape.checks import Array
from cable_shape.pose import Grip
from cable_shape.prediction.harness_predictor import HarnessPredictor
from cable_shape.safety.margins import LONGEST_GAP, MarginWatch
from cable_shape.safety.report import CableWarning, Clearance, Margin
from cable_shape.safety.snap import Find, SnapWatch, predicted_harness_snap, twist_between
from cable_shape.safety.warnings import snap_warning
from cable_shape.scene.scene import Scene
from cable_shape.solve.harness_network import HarnessNetwork
from cable_shape.solve.harness_shape import HarnessShape
from cable_shape.solve.touching.harness_state import HarnessTouchState


@final
class HarnessStability:
    """The smallest eigenvalue of a harness's second variation, in units of its smallest stiffness / longest segment^2.

    A part that turns freely, about the vertical for example, has one of 0: of it no stability is told. horizon: [s], a
    snap this near is predicted; 0: never.
    """

    def __init__(self, predictor: HarnessPredictor, horizon: float) -> None:
        self._predictor = predictor
        self._lead, cable = next(iter(predictor.harness.segments.items()))
        self._watch = MarginWatch(cable, Scene())
        self.snaps = SnapWatch(horizon)
        self.reset()

    def reset(self) -> None:
        """Forgets the last cycle."""
        self._watch.reset()
        self.snaps.reset()
        self._stamp, self._frames = -math.inf, dict[str, Array]()
        self.margin: Margin | None = None  # of the last shape
        self.segment = ""  # that turns most in its softest mode
        self._shape: HarnessShape | None = None

    def judge(
        self,
        shape: HarnessShape,
        stamp: int,
        rod: HarnessNetwork | HarnessTouchState | None = None,
        find: Find | None = None,
    ) -> None:
        """Takes over the shape just predicted, or that of another rod; looks ahead where a snap may be near.

        find: what looks for it, of what touches others.
        """
        state, self._shape = self._predictor.rod_state if rod is None else rod, shape
        if state is None or state.history == 0:
            self._watch.reset()
            self.margin = None
            return
        network = state if isinstance(state, HarnessNetwork) else state.cable
        if self._watch.soft != network.softest:
            self._watch.soft = network.softest
            self._watch.reset()
        told: Any = state
        self._watch.margins(shape.segments[self._lead], Clearance(), stamp, state=told)
        self.margin = self._watch.stability
        if self.margin is not None:
            self.segment = self._softest(state)
        twists = self._moved(stamp)
        own = None if twists is None else partial(self._snap, twists)
        self.snaps.look(self.margin, stamp, find or own)

    def _snap(self, twists: dict[str, Array], horizon: float) -> tuple[float, float, HarnessShape] | None:
        predictor = self._predictor
        return predicted_harness_snap(predictor.ahead(), dict(predictor.problem.ends), twists, horizon)

    def _softest(self, state: HarnessNetwork | HarnessTouchState) -> str:
        """The segment that turns most in the softest mode."""
        mode = self._watch.mode
        largest = state.largest_of_spans((mode * mode).sum(axis=1))
        layout = state.layout if isinstance(state, HarnessNetwork) else state.cable.layout
        most = {name: float(largest[spans.start : spans.stop].max()) for name, spans in layout.spans.items()}
        own = {name: most[called] for name, called in self._predictor.called.items() if called in most}
        return max(own or most, key=(own or most).__getitem__)

    def _moved(self, stamp: int) -> dict[str, Array] | None:
        """(6,) velocity [m/s] and angular velocity [rad/s] of each held end since the last cycle; None: not known."""
        ends = self._predictor.problem.ends
        now = {end: how.cable_frame.array.copy() for end, how in ends.items() if isinstance(how, Grip)}
        before, seconds = self._frames, (stamp - self._stamp) * 1e-9
        self._stamp, self._frames = stamp, now
        if not (0.0 < seconds <= LONGEST_GAP and before.keys() == now.keys()):
            return None
        return {end: twist_between(before[end], frame, seconds) for end, frame in now.items()}

    def warning(self, name: str) -> list[CableWarning]:
        """Of a snap that is about to come; name: of the harness."""
        after = self.snaps.after
        if after is None or self.margin is None or self._shape is None:
            return []
        assert isinstance(after, HarnessShape)
        now = self._shape.segments
        far = {one: np.abs(shape.positions - now[one].positions).max() for one, shape in after.segments.items()}
        one = max(far, key=far.__getitem__)
        return [snap_warning(f"{name}/{one}", self.margin, self.snaps.time, now[one], after.segments[one])]
