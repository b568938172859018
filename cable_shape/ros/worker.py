"""A process beside the node's, started, watched, started again: :class:`WorkerProcess`.

That process is a ROS node, too (:mod:`cable_shape.ros.planning`, :mod:`cable_shape.ros.calibrating`), so that neither
the work nor the megabytes of an answer pass through the process that runs the cycles.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Mapping
from typing import final

from cable_shape.children import ended, left

_GRACE = 1.0  # s, from telling the process to end until it is ended
_FIRST_WAIT, _LONGEST_WAIT = 1.0, 60.0  # s, before a start after an end; twice as long after each that was soon
_SOON = 30.0  # s, a process that ends sooner after its start has not got over it
_TOLD = 10.0  # s, an end stays in the diagnostics for so long


@final
class WorkerProcess:
    """Runs a module until it is closed; the process ends with its caller in whatever way.

    Parameters
    ----------
    name : str
        What it is, as in "the planner's process".
    module : str
        Run as `python -m MODULE SETUP`, where SETUP is an inherited descriptor with the text `setup`.
    remedy : str
        What else to do if it ends again and again.
    environment : mapping of str to str
        Beside and instead of what it inherits.
    """

    def __init__(
        self, name: str, module: str, setup: str, remedy: str, environment: Mapping[str, str] | None = None
    ) -> None:
        self._name, self._module, self._remedy = name, module, remedy
        self._environment = {**os.environ, **(environment or {})}
        self._papers = os.memfd_create(f"cable_shape_{name}_setup", os.MFD_CLOEXEC)
        with open(self._papers, "w", encoding="utf-8", closefd=False) as file:
            file.write(setup)
        self.ends = 0  # how often the process has ended by itself
        self._wait = _FIRST_WAIT
        self._ended: float | None = None  # when it was seen that the process is gone; None: it runs
        self._text, self._told = "", 0.0
        self._start()

    @property
    def pid(self) -> int:
        """Of the process."""
        return self._process.pid

    def revived(self) -> str:
        """Starts the process again if it has ended; a text about an end that was not long ago, else an empty one.

        To be called about once a second.
        """
        now = time.monotonic()
        if self._ended is None and self._process.poll() is not None:
            self._ended = now
            self._tell(now)
        elif self._ended is not None and now - self._ended >= self._wait:
            self.release()
            self._start()
        return self._text if self._ended is not None or now - self._told < _TOLD else ""

    def close(self) -> None:
        """Ends the process; calls under way get no answer."""
        self.release()
        ended(self._process, _GRACE)
        os.close(self._papers)

    def leave(self, timeout: float) -> bool:
        """For a caller that ends: after `timeout` [s] the process is left to take itself down. True if it has ended."""
        self.release()
        return left(self._process, timeout)

    def release(self) -> None:
        """Tells the process to end, by closing the pipe."""
        assert self._process.stdin is not None
        self._process.stdin.close()

    def _start(self) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-m", self._module, str(self._papers)],
            stdin=subprocess.PIPE,  # by ending, it ends the process
            pass_fds=(self._papers,),
            env=self._environment,
            process_group=0,  # Ctrl-C ends the caller, which closes the pipe
        )
        self._started, self._ended = time.monotonic(), None

    def _tell(self, now: float) -> None:
        self.ends += 1
        soon = now - self._started < _SOON
        self._wait = min(2.0 * self._wait, _LONGEST_WAIT) if soon and self.ends > 1 else _FIRST_WAIT
        code = self._process.returncode
        how = f"by signal {-code}" if code < 0 else f"with exit code {code}"
        self._told = now
        self._text = (
            f"the {self._name}'s process has ended {how} ({self.ends} times so far): requests under way get no answer. "
            f"It is started again after {self._wait:g} s; the cycles go on. If it ends again, read the log, and "
            f"{self._remedy}"
        )
