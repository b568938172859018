"""The viewer process, started by :class:`~cable_shape.viewer.process.ViewerProcess`: takes reports, writes to rerun.

    python -m cable_shape.viewer.child SETUP MAILBOX NEWS

These are inherited descriptors, NEWS that of a mailbox of what edits have made of cables and bodies; standard input
wakes the process and, by ending, ends it.
"""

from __future__ import annotations

import json
import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from typing import Any

import rerun as rr

from cable_shape.cable.cable import Cable
from cable_shape.cable.harness import Harness
from cable_shape.prediction.layout import Layout
from cable_shape.scene.scene import Obstacle, Scene
from cable_shape.viewer.children import be_ordinary
from cable_shape.viewer.entities import ReportLogger
from cable_shape.viewer.letters import decode
from cable_shape.viewer.mailbox import Mailbox
from cable_shape.viewer.process import start_viewer
from cable_shape.viewer.recording import new_recording

_NICENESS = 5  # the loop that is watched goes first
_WINDOW_OPENS_WITHIN = 30.0  # s
_LOOK_UP = 0.5  # s, between looks whether the window is still there
_CHECK_PERIOD = 2.0  # s, between looks whether the file can still be written
_FLUSH_WITHIN = 30.0  # s; the parent ends the process sooner if it wants to


def main() -> int:
    """Shows reports until the parent closes the pipe or the window is closed."""
    papers, file, news = (int(argument) for argument in sys.argv[1:])
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))  # what was taken is still written
    be_ordinary()
    os.nice(_NICENESS)
    with open(papers, encoding="utf-8") as setup_file:
        setup_file.seek(0)
        setup = json.load(setup_file)
    recording = new_recording(setup["path"])
    window = None if setup["path"] else _open_window(recording, setup["memory_limit"])
    logger = ReportLogger(
        recording,
        {name: cable_from(values) for name, values in setup["cables"].items()},
        Scene.from_mapping(setup["scene"]),
        _links(setup["robot"]),
        colour=setup["colour"],
        times=setup["times"],
        live=window is not None,
    )
    written = None if window is not None else recording
    try:
        try:
            _show(logger, Mailbox(file), Mailbox(news), 1.0 / setup["max_rate"], window, written)
        finally:
            recording.flush(timeout_sec=_FLUSH_WITHIN)
            recording.disconnect()
    except RuntimeError as error:  # rerun's, once its file cannot be written
        print(f"viewer: the recording ends early ({error}); is the disk full?", file=sys.stderr)
        return 1
    return 0


def _show(
    logger: ReportLogger,
    mailbox: Mailbox,
    news: Mailbox,
    period: float,
    window: subprocess.Popen[bytes] | None,
    written: rr.RecordingStream | None,
) -> None:
    """Takes the newest report, at most one a period, until the pipe ends; the last one is always taken.

    Raises RuntimeError when `written`, a recording to a file, cannot be written any more.
    """
    number, edited, ended, checked = 0, 0, False, time.monotonic()
    while not ended and (window is None or window.poll() is None):
        ready, _, _ = select.select([0], [], [], _LOOK_UP)
        if not ready:
            continue
        ended = os.read(0, 1 << 16) == b""
        began = time.monotonic()
        letter = mailbox.take(number)
        if letter is not None:
            number = letter[0]
            told = news.take(edited)
            if told is not None:
                edited = told[0]
                logger.edited(Layout.read(told[1].decode(), logger.harnesses))
            logger.log(decode(letter[1]))
        if written is not None and began - checked > _CHECK_PERIOD:
            checked = began
            written.flush(timeout_sec=_FLUSH_WITHIN)
        if not ended:
            time.sleep(max(0.0, period - (time.monotonic() - began)))


def cable_from(values: dict[str, Any]) -> Cable | Harness:
    """What the `as_dict` of a cable or a harness says."""
    return Harness.from_mapping(values) if "segments" in values else Cable.from_mapping(values)


def _links(robot: str | dict[str, Any]) -> Sequence[Obstacle]:
    """What the robot's links look like, of a scene or, by the path of its YAML file, of a robot."""
    if not isinstance(robot, str):
        return Scene.from_mapping(robot).obstacles
    from cable_shape.robots.robot import Robot

    return Robot.from_yaml(robot).link_geometry


def _open_window(recording: rr.RecordingStream, memory_limit: str) -> subprocess.Popen[bytes]:
    """Opens rerun's window and connects the recording to it. It stays open when this process ends."""
    limits = ("--memory-limit", memory_limit, "--server-memory-limit", memory_limit)
    window, url = start_viewer("--expect-data-soon", *limits, timeout=_WINDOW_OPENS_WITHIN)
    recording.connect_grpc(url)
    return window


if __name__ == "__main__":
    sys.exit(main())
