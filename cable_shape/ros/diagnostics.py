"""How the node is doing: :class:`Health`, the one source of truth behind /diagnostics and the log. Knows no ROS.

All times are integers in nanoseconds of the node's clock.
"""

from __future__ import annotations

import enum
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import final

import numpy as np

from cable_shape.messages.pairing import SECOND
from cable_shape.ros.cycle_times import CycleTimes
from cable_shape.safety.report import CycleReport, Severity
from cable_shape.shape import CableShape

#: [s], over which cycle times are measured, and over which the rate is.
TIMES_WINDOW, RATE_WINDOW = 5.0, 2.0


@final
class Level(enum.IntEnum):
    """The values are those of diagnostic_msgs/DiagnosticStatus.level."""

    OK = 0
    WARN = 1
    ERROR = 2


@final
@dataclass(frozen=True, slots=True)
class Complaint:
    """One thing that is wrong; `code` stays the same while `text` may count seconds."""

    code: str
    level: Level
    text: str


@final
@dataclass(frozen=True, slots=True)
class Verdict:
    """One line of /diagnostics."""

    name: str
    level: Level
    message: str
    values: Mapping[str, str]
    complaints: tuple[Complaint, ...] = ()


@dataclass(slots=True)
class _Refusal:
    """The last message refused, or only remarked on, for one reason."""

    text: str
    when: int
    count: int = 1
    used: bool = False  # a remark: the message was used
    answered: bool = False  # whether a cycle ran since


@final
@dataclass
class Health:
    """What the node knows about its input, its predictions and itself.

    Parameters
    ----------
    stale_after : float
        [s], input is stale when none came for so long.
    hold : float
        [s], how long a refused message stays in the diagnostics after good ones followed.
    """

    stale_after: float
    hold: float = 2.0
    state: str = "unconfigured"
    failure: str = ""  # why the last transition failed
    turned_away: dict[str, tuple[str, int]] = field(default_factory=dict)  # what peers asked for -> text, when
    refusals: int = 0  # of what peers asked for
    edits_done: int = 0  # requests
    edits_refused: int = 0
    _edit_refused: tuple[str, int] | None = None  # the last one: why, and when
    troubles: dict[str, str] = field(default_factory=dict)  # of the node itself: code -> text
    hint: str = ""  # why there are no pairs, if that is known
    publishers: tuple[Complaint, ...] = ()  # about who publishes the input
    robot_expected: bool = False  # whether there is a robot whose links should be known
    waiting_for: tuple[str, ...] = ()
    arrivals: dict[str, int] = field(default_factory=dict)  # topic -> when its last message came
    refused: dict[str, _Refusal] = field(default_factory=dict)
    restarts: int = 0
    cycles: int = 0
    counts: dict[str, int] = field(default_factory=dict)
    report: CycleReport | None = None
    _activated: int = 0
    skipped: Counter[str] = field(default_factory=Counter)  # work that was not needed, as reports count it
    _times: CycleTimes = field(default_factory=CycleTimes)
    _lag: int = 0

    def activate(self, topics: Iterable[str], now: int) -> None:
        """Input counts from now on and is expected on `topics`."""
        self.state = "active"
        self.failure = ""
        self.hint = ""
        self.publishers = ()
        self.waiting_for = tuple(topics)
        self.arrivals.clear()
        self.refused.clear()
        self.report = None
        self._activated = now
        self._times = CycleTimes()

    def arrived(self, topic: str, now: int) -> None:
        """A message came on `topic`."""
        self.arrivals[topic] = now

    def refuse(self, reason: str, text: str, now: int) -> None:
        """A message was not used; `reason` is its topic and what is wrong, `text` names value, bound and remedy."""
        before = self.refused.get(reason)
        self.refused[reason] = _Refusal(text, now, 1 if before is None else before.count + 1)

    def turn_away(self, what: str, text: str, now: int) -> None:
        """A peer asked for something that is not allowed; the `text` says what and why."""
        self.refusals += 1
        self.turned_away[what] = (text, now)

    def refuse_edit(self, text: str, now: int) -> None:
        """An edit was asked for and cannot be, for the reason in `text`."""
        self.edits_refused += 1
        self._edit_refused = (f"an edit was refused: {text}", now)

    def remark(self, reason: str, text: str, now: int) -> None:
        """A message was used although something about it is odd."""
        self.refuse(reason, text, now)
        self.refused[reason].used = True

    def restarted(self, text: str, now: int) -> None:
        """The input's clock was set back."""
        self.restarts += 1
        self.remark("restart", text, now)

    def cycled(self, report: CycleReport, seconds: float, now: int) -> None:
        """A cycle ran and its shapes were published; it took `seconds`."""
        self.cycles += 1
        self.report = report
        self._times.add(seconds, now)
        self._lag = now - report.stamp
        self.skipped.update(report.skipped)
        for refusal in self.refused.values():
            refusal.answered = True

    def verdicts(self, now: int) -> list[Verdict]:
        """The lines of /diagnostics."""
        self._forget_future(now)
        return [self._lifecycle(now), self._input(now), self._prediction(now), self._cable(now)]

    def _forget_future(self, now: int) -> None:
        """After the node's clock was set back, ages count from now."""
        self._activated = min(self._activated, now)
        for topic, when in self.arrivals.items():
            self.arrivals[topic] = min(when, now)
        for refusal in self.refused.values():
            refusal.when = min(refusal.when, now)
        for what, (text, when) in self.turned_away.items():
            self.turned_away[what] = (text, min(when, now))
        if self._edit_refused is not None:
            text, when = self._edit_refused
            self._edit_refused = (text, min(when, now))

    def _lifecycle(self, now: int) -> Verdict:
        wrong = [Complaint("failure", Level.ERROR, self.failure)] if self.failure else []
        wrong += [Complaint(code, Level.WARN, text) for code, text in self.troubles.items()]
        wrong += [
            Complaint(f"turned away {what}", Level.WARN, text)
            for what, (text, when) in self.turned_away.items()
            if now - when < self.hold * SECOND
        ]
        values = {"state": self.state, "turned away": str(self.refusals)}
        return _verdict("lifecycle", wrong, self.state, values)

    def _input(self, now: int) -> Verdict:
        if self.state != "active":
            return _verdict("input", [], f"{self.state}: input is not used", {})
        wrong = [*self._refusals(now), *self.publishers, *self._silence(now), *self._clock(now)]
        rate = self._rate(now)
        values = {"rate [Hz]": f"{rate:.1f}", "cycles": str(self.cycles), "clock restarts": str(self.restarts)}
        values.update({key: str(value) for key, value in self.counts.items()})
        for topic, when in self.arrivals.items():
            values[f"age of {topic} [s]"] = f"{(now - when) / SECOND:.3f}"
        for reason, refusal in self.refused.items():
            values[f"{'remarked' if refusal.used else 'refused'}: {reason}"] = str(refusal.count)
        if self.report is not None:
            values["stamp to publication [s]"] = f"{self._lag / SECOND:.6f}"
        return _verdict("input", wrong, f"{rate:.1f} cycles a second", values)

    def _refusals(self, now: int) -> list[Complaint]:
        """Messages not used: an error until a good one follows, then, like those remarked on, a warning for a while."""
        wrong = []
        for reason, refusal in self.refused.items():
            if not refusal.answered and not refusal.used:
                wrong.append(Complaint(f"refused {reason}", Level.ERROR, refusal.text))
            elif now - refusal.when < self.hold * SECOND:
                wrong.append(Complaint(f"refused {reason}", Level.WARN, refusal.text))
        return wrong

    def _silence(self, now: int) -> list[Complaint]:
        """Topics never heard, topics gone silent, and messages that find no partner."""
        missing = [topic for topic in self.waiting_for if topic not in self.arrivals]
        if missing:
            seen = f" ({', '.join(self.arrivals)} came)" if self.arrivals else ""
            text = f"no message on {' and '.join(missing)} yet{seen}: nothing is published. Start its publisher, "
            text += "or remap the topic; its quality of service may be best-effort or reliable."
            return [Complaint("missing " + " ".join(missing), Level.WARN, text)]
        ages = {topic: (now - when) / SECOND for topic, when in self.arrivals.items()}
        silent = [topic for topic in self.waiting_for if ages[topic] > self.stale_after]
        if silent:
            age = max(ages[topic] for topic in silent)
            text = f"stale: no message on {' and '.join(silent)} for {age:.2f} s, "
            text += f"more than stale_after = {self.stale_after:g} s: nothing is "
            text += "published until one comes. Look at its publisher and the network."
            return [Complaint("stale " + " ".join(silent), Level.WARN, text)]
        since = max(self._activated, self._times.last_end)
        if self.hint and (now - since) / SECOND > self.stale_after:
            return [Complaint("unpaired", Level.WARN, self.hint)]
        return []

    def _clock(self, now: int) -> list[Complaint]:
        """A node clock that never ran, or that the stamps do not follow."""
        if now == 0:
            text = "use_sim_time is true, but nothing came on /clock. Publish it, or set use_sim_time to false."
            return [Complaint("clock", Level.WARN, text)]
        if self.report is None or abs(self._lag) <= self.stale_after * SECOND:
            return []
        lag = self._lag / SECOND
        text = f"input stamps are {abs(lag):.3f} s {'behind' if lag > 0 else 'ahead of'} the node's clock, more than "
        text += f"stale_after = {self.stale_after:g} s; shapes carry the input's stamps. "
        text += "Synchronise the clocks, or set use_sim_time for a bag or a simulator."
        return [Complaint("lag", Level.WARN, text)]

    def _rate(self, now: int) -> float:
        """[Hz], cycles in the last `RATE_WINDOW`."""
        window = min(RATE_WINDOW, max((now - self._activated) / SECOND, 1e-3))
        return len(self._times.within(RATE_WINDOW, now)) / window

    def _prediction(self, now: int) -> Verdict:
        if self.report is None:
            return _verdict("prediction", [], "no prediction yet", {})
        wrong = []
        values = {}
        for cable_id, shape in self.report.shapes.items():
            if shape.status.value:
                level = Level.WARN if shape.status else Level.ERROR
                text = f"{cable_id}: {shape.status.name}. {shape.detail or shape.status.remedy}"
                wrong.append(Complaint(f"{cable_id} {shape.status.name}", level, text))
            values.update(_numbers(cable_id, shape))
        recent = self._times.within(TIMES_WINDOW, now)
        if len(recent):
            for name, value in zip(("p50", "p99", "max"), np.percentile(recent, (50, 99, 100)), strict=True):
                values[f"cycle time {name} [ms]"] = f"{1e3 * value:.3f}"
        values.update({f"skipped {what}": str(count) for what, count in self.skipped.items()})
        return _verdict("prediction", wrong, "; ".join(f"{c}: OK" for c in self.report.shapes), values)

    def _cable(self, now: int) -> Verdict:
        values = {"edits done": str(self.edits_done), "edits refused": str(self.edits_refused)}
        wrong = []
        if self._edit_refused is not None and now - self._edit_refused[1] < self.hold * SECOND:
            wrong.append(Complaint("edit refused", Level.WARN, self._edit_refused[0]))
        if self.report is None:
            return _verdict("cable", wrong, "no prediction yet", values)
        wrong += [
            Complaint(
                f"{w.cable_id} {w.kind.name} {w.other}",
                Level.ERROR if w.severity is Severity.ERROR else Level.WARN,
                w.text,
            )
            for w in self.report.warnings
        ]
        if self.robot_expected and not self.report.robot_checked:
            text = "clearance to the robot is not checked: no usable joint_states within stale_after of the poses. "
            wrong.append(Complaint("robot", Level.WARN, text + "Start its publisher, or clear robot_file."))
        values["clearance to the robot checked"] = str(self.report.robot_checked).lower()
        return _verdict("cable", wrong, "no warnings", values)


def _numbers(cable_id: str, shape: CableShape) -> dict[str, str]:
    """What a prediction says about itself."""
    return {
        f"{cable_id} model": shape.model,
        f"{cable_id} status": shape.status.name,
        f"{cable_id} error estimate [m]": f"{shape.error_estimate:.3g}",
        f"{cable_id} residual": f"{shape.residual:.3g}",
        f"{cable_id} solve time [ms]": f"{shape.solve_time * 1e3:.3f}",
    }


def _verdict(name: str, wrong: list[Complaint], fine: str, values: Mapping[str, str]) -> Verdict:
    """The worst of the complaints, or `fine`."""
    level = max((complaint.level for complaint in wrong), default=Level.OK)
    message = "; ".join(complaint.text for complaint in wrong) or fine
    return Verdict(name, level, message, values, tuple(wrong))
