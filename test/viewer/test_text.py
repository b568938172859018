"""What the viewer says in words."""

from __future__ import annotations

import dataclasses

from reports import (
    report,
    warning,
)

from cable_shape.safety.report import Clearance, Severity
from cable_shape.viewer.text import WarningLog, state


def test_warning_log_tells_changes_only() -> None:
    log = WarningLog()
    assert log.changes(()) == []
    assert log.changes((warning(0.02),)) == [(Severity.WARN, "20.0 mm to box")]
    assert log.changes((warning(0.019),)) == []
    assert log.changes((warning(0.005, Severity.ERROR), warning(0.02))) == [(Severity.ERROR, "5.0 mm to box")]
    assert log.changes(()) == [(None, "cable: clearance to box is over")]
    assert log.changes((warning(0.02),)) == [(Severity.WARN, "20.0 mm to box")]


def test_state_says_what_was_not_checked() -> None:
    unchecked = dataclasses.replace(report(0), clearance={"cable": Clearance(beyond=0.5)})
    assert "over 500.0 mm; robot not checked" in state(unchecked, "legend")
    assert "**35.0 mm** to box" in state(report(0), "legend")
