"""How a process of rclpy ends: :class:`Interrupts`, :func:`ends_when_told`, :func:`told_to_end`, :func:`shut_down`."""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import threading
from collections.abc import Iterator
from types import FrameType
from typing import ClassVar, final

from rclpy.utilities import ok, try_shutdown

from cable_shape.kernels._jit import between_kernels

#: [s], between looks, and given to the main thread to end by itself.
LOOK, GRACE = 0.1, 0.5


@final
class Interrupts:
    """When SIGINT and SIGTERM raise KeyboardInterrupt: at once, but for two cases.

    Within :func:`ends_when_told` it is raised between two kernels: in the midst of the compiler it would leave LLVM
    half done. Lost in one of its callbacks, it would interrupt nothing; elsewhere what is freed after it may crash the
    process. And once `ending` is set it is not raised any more: rclpy, too, hears of the signal, and what it raises
    then may be there first. Python looks for signals as functions begin, so set it, before anything is called, where
    the end begins.

    Raised while C++ makes Python's objects, of a message that is taken, it comes out as a RuntimeError of another
    meaning: ask :func:`told_to_end`.
    """

    came: ClassVar[bool] = False  # any signal, so far
    ending: ClassVar[bool] = False
    compiling: ClassVar[bool] = False
    told: ClassVar[bool] = False  # while it compiled

    @classmethod
    def begin(cls) -> None:
        """From now on. Call it before rclpy.init, which passes on what it hears."""
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, cls._take)

    @classmethod
    def _take(cls, number: int, frame: FrameType | None) -> None:
        cls.came = True
        if cls.compiling:
            cls.told = True
        elif not cls.ending:
            signal.default_int_handler(number, frame)

    @classmethod
    def check(cls) -> None:
        """Between two kernels."""
        if cls.told:
            raise KeyboardInterrupt


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
    Interrupts.compiling = True
    try:
        with between_kernels(Interrupts.check):
            yield
    finally:
        done.set()
        told, Interrupts.compiling, Interrupts.told = Interrupts.told, False, False
        if told:
            raise KeyboardInterrupt from None


def told_to_end() -> bool:
    """Whether this process was told to end, so that an error may be no defect.

    A signal is heard twice, here and by rclpy, which shuts itself down in a thread of its own, before or after.
    """
    return Interrupts.came or not ok()


def shut_down() -> None:
    """Shuts rclpy down, unless a signal has: its own thread may do so between rclpy's look and its call."""
    try:
        try_shutdown()
    except RuntimeError:  # rclpy's own
        if ok():
            raise
