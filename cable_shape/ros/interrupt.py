"""How a process of rclpy ends: :func:`ends_when_told`, :func:`shut_down`."""

from __future__ import annotations

import contextlib
import os
import sys
import threading
from collections.abc import Iterator

from rclpy.utilities import ok, try_shutdown

#: [s], between looks, and given to the main thread to end by itself.
LOOK, GRACE = 0.1, 0.5


@contextlib.contextmanager
def ends_when_told() -> Iterator[None]:
    """While the body runs, a shutdown of rclpy (SIGINT, SIGTERM) ends the process within a second, with exit code 0.

    For bodies that hold nothing that must be closed, and stay in compiled code for long: the compiler. Where rclpy is
    not up, as in a program that uses parts of the node by themselves, nothing ends it.
    """
    if not ok():
        yield
        return
    done = threading.Event()

    def watch() -> None:
        while not done.wait(LOOK):
            if not ok():
                if not done.wait(GRACE):
                    sys.stdout.flush()
                    os._exit(0)
                return

    threading.Thread(target=watch, daemon=True).start()
    try:
        yield
    finally:
        done.set()


def shut_down() -> None:
    """Shuts rclpy down, unless a signal has: its own thread may do so between rclpy's look and its call."""
    try:
        try_shutdown()
    except RuntimeError:  # rclpy's own
        if ok():
            raise
