"""A process beside the node's, started, watched, started again: :class:`WorkerProcess`.

That process is a ROS node, too (:mod:`cable_shape.ros.planning`, :mod:`cable_shape.ros.calibrating`), so that neither
the work nor the megabytes of an answer pass through the process that runs the cycles.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from typing import final

from cable_shape.ros.following import TOO_LONG
from cable_shape.viewer.children import ended, left
from cable_shape.viewer.mailbox import Mailbox

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
        Run as `python -m MODULE SETUP SERVES CLIENTS NEWS`: inherited descriptors, one with the text `setup`, one to be
        written to as soon as it serves, `clients()` if it has ended before, else 0, and the descriptor of a mailbox
        that brings what is told meanwhile.
    remedy : str
        What else to do if it ends again and again.
    clients : callable
        How many there are who may have asked the process, and are to know the next one before it serves.
    environment : mapping of str to str
        Beside and instead of what it inherits.
    arguments : sequence of str
        After the others.
    """

    def __init__(
        self,
        name: str,
        module: str,
        setup: str,
        remedy: str,
        clients: Callable[[], int],
        environment: Mapping[str, str] | None = None,
        arguments: Sequence[str] = (),
    ) -> None:
        self._arguments, self._clients = tuple(arguments), clients
        self._name, self._module, self._remedy = name, module, remedy
        self._environment = {**os.environ, **(environment or {})}
        self._papers = os.memfd_create(f"cable_shape_{name}_setup", os.MFD_CLOEXEC)
        with open(self._papers, "w", encoding="utf-8", closefd=False) as file:
            file.write(setup)
        self._news = Mailbox(Mailbox.memory())
        self.ends = 0  # how often the process has ended by itself
        self._wait = _FIRST_WAIT
        self._ended: float | None = None  # when it was seen that the process is gone; None: it runs
        self._text, self._told = "", 0.0
        self._ready = -1  # descriptor, as long as it may bring news
        self._start()

    @property
    def pid(self) -> int:
        """Of the process."""
        return self._process.pid

    @property
    def serves(self) -> bool:
        """Whether its services are there."""
        if self._process.poll() is not None:
            return False
        if self._ready >= 0:
            try:
                os.read(self._ready, 1)  # what was written, or the end, which poll will tell
            except BlockingIOError:
                return False
            self._hear_no_more()
        return self._process.poll() is None

    @property
    def excuse(self) -> str:
        """Why a request is answered with an error while the process does not serve."""
        return self._text or f"the {self._name}'s process does not serve: it loads, or was closed. Ask again later."

    def revived(self) -> str:
        """Starts the process again if it has ended; a text as long as it does not serve, and for a while after an end.

        To be called about once a second.
        """
        now = time.monotonic()
        if self._ended is None and self._process.poll() is not None:
            self._ended = now
            self._tell(now)
        elif self._ended is not None and now - self._ended >= self._wait:
            self.release()
            self._start()
        if self._text and (now - self._told < _TOLD or not self.serves):
            return self._text
        self._text = ""
        if self.serves:
            return ""
        return f"the {self._name}'s process loads: its services come when it serves, wait for them."

    def tell(self, text: str) -> None:
        """Has the process know a text in the place of the last one, this one or one that is started after it."""
        if not self._news.put(text.encode()):
            self._news.put(TOO_LONG)

    def close(self) -> None:
        """Ends the process."""
        self.release()
        ended(self._process, _GRACE)
        os.close(self._papers)
        self._news.close()

    def leave(self, timeout: float) -> bool:
        """For a caller that ends: after `timeout` [s] the process is left to take itself down. True if it has ended."""
        self.release()
        return left(self._process, timeout)

    def release(self) -> None:
        """Tells the process to end, by closing the pipe."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._hear_no_more()

    def _start(self) -> None:
        self._ready, serves = os.pipe()
        os.set_blocking(self._ready, False)
        given = (self._papers, serves, self._clients() if self.ends else 0, self._news.file)
        try:
            self._process = subprocess.Popen(
                [sys.executable, "-m", self._module, *map(str, given), *self._arguments],
                stdin=subprocess.PIPE,  # by ending, it ends the process
                pass_fds=(self._papers, serves, self._news.file),
                env=self._environment,
                process_group=0,  # Ctrl-C ends the caller, which closes the pipe
            )
        finally:
            os.close(serves)
        self._started, self._ended = time.monotonic(), None

    def _hear_no_more(self) -> None:
        if self._ready >= 0:
            os.close(self._ready)
            self._ready = -1

    def _tell(self, now: float) -> None:
        self.ends += 1
        soon = now - self._started < _SOON
        self._wait = min(2.0 * self._wait, _LONGEST_WAIT) if soon and self.ends > 1 else _FIRST_WAIT
        code = self._process.returncode
        how = f"by signal {-code}" if code < 0 else f"with exit code {code}"
        self._told = now
        self._text = (
            f"the {self._name}'s process has ended {how} ({self.ends} times so far): requests are answered with an "
            f"error until it serves again. It is started again after {self._wait:g} s; the cycles go on. If it ends "
            f"again, read the log, and {self._remedy}"
        )
