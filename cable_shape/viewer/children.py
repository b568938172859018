"""How processes that we started end: :func:`ended` waits for it, :func:`left` does not wait for long.

And how they begin: :func:`be_ordinary`, which each of them calls first.
"""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
from pathlib import Path

_GRACE = 1.0  # s, between asking a process to end and ending it


def be_ordinary() -> None:
    """Gives up, in every thread, a real-time priority that came from the parent: it is meant for the cycles alone."""
    if sys.platform != "linux":
        return
    for thread in os.listdir("/proc/self/task"):
        if os.sched_getscheduler(int(thread)) & ~os.SCHED_RESET_ON_FORK in (os.SCHED_FIFO, os.SCHED_RR):
            os.sched_setscheduler(int(thread), os.SCHED_OTHER, os.sched_param(0))


def ended(process: subprocess.Popen[bytes], timeout: float) -> bool:
    """Waits `timeout` [s] for the end of a process that was told to end, then ends it. True if it ended well."""
    _wait(process, timeout)
    for end in (process.terminate, process.kill):
        if process.poll() is None:
            end()
            _wait(process, _GRACE)
    return process.returncode == 0


def left(process: subprocess.Popen[bytes], timeout: float) -> bool:
    """Waits `timeout` [s] for the end of a process that was told to end, then leaves it to end when it is done.

    One that is stopped would never end, and is killed. True if it has ended.
    """
    _wait(process, timeout)
    if process.poll() is None and _stopped(process.pid):
        process.kill()
        _wait(process, _GRACE)
    return process.poll() is not None


def _wait(process: subprocess.Popen[bytes], timeout: float) -> None:
    with contextlib.suppress(subprocess.TimeoutExpired):
        process.wait(timeout)


def _stopped(pid: int) -> bool:
    """Whether a signal or a debugger holds it; where there is no /proc it is taken to run."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] in ("T", "t")
    except OSError:
        return False
