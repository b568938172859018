"""Complaints in the log: new ones at once, those that stay now and then, and that all is well again."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, final

from cable_shape.ros.diagnostics import Complaint, Level

LOG_AGAIN = 10.0  # s, until a complaint that stays is logged again


@final
class ComplaintLog:
    """Writes to an rclpy logger."""

    def __init__(self, log: Any) -> None:
        self._log = log
        self._logged: dict[str, float] = {}  # code of a complaint -> when it was logged

    def tell(self, complaints: Sequence[Complaint], steady: float) -> None:
        """Takes all that hold at the time `steady` [s]."""
        for complaint in complaints:
            if steady - self._logged.get(complaint.code, -LOG_AGAIN) >= LOG_AGAIN:
                self._logged[complaint.code] = steady
                if complaint.level is Level.ERROR:  # rclpy wants one severity at each call
                    self._log.error(complaint.text)
                else:
                    self._log.warning(complaint.text)
        present = {complaint.code for complaint in complaints}
        gone = [code for code in self._logged if code not in present]
        for code in gone:
            del self._logged[code]
        if gone and not present:
            self._log.info("all is well again")
