"""A picture of every cycle in a process of its own: :class:`ViewerProcess`. This module does not import rerun."""

from __future__ import annotations

import json
import os
import re
import socket
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Self, final

from cable_shape import checks
from cable_shape.cable.cable import Cable
from cable_shape.cable.harness import Harness
from cable_shape.cycle.parts import in_parts
from cable_shape.errors import ArgumentError, DependencyError, how_to_get
from cable_shape.prediction.layout import Layout
from cable_shape.safety.report import CycleReport
from cable_shape.scene.scene import Obstacle, Scene
from cable_shape.viewer.children import ended, left
from cable_shape.viewer.colour import check_colouring
from cable_shape.viewer.letters import encode
from cable_shape.viewer.mailbox import Mailbox

WINDOW = "window"
_MEMORY_LIMIT = re.compile(r"\d+(\.\d+)? ?([kKMGT]i?B|%)")


@final
class ViewerProcess:
    """Shows reports in a rerun window, or writes them to a .rrd, without holding up the caller.

    `send` copies the report into shared memory and returns; the process takes the newest one, at most `max_rate` times
    a second, and passes over the others. :class:`cable_shape.viewer.recording.RecordingWriter` keeps every report.
    When the caller ends in whatever way, the process writes what it has and ends, too; a window stays open.

    Parameters
    ----------
    mode : str or path
        "window", or the path of the .rrd to write.
    cables, scene
        As given to :class:`cable_shape.cycle.cycle.Cycle`.
    robot : path of a robot's YAML file, or sequence of Obstacle, optional
        What the robot's links look like (``Robot.link_geometry``).
    memory_limit : str
        Of the window ("512MB", "2GiB", "10%"): it drops the oldest data beyond. A .rrd goes to disk as it comes.
    colour : str
        What colours the cable: "curvature" or "clearance".
    times : bool
        Whether to plot how long the cycles took.
    max_rate : float
        [1/s], reports shown at most.

    Raises
    ------
    ArgumentError
        For a window without a screen, a .rrd in a folder that does not exist, a malformed memory limit.
    """

    def __init__(
        self,
        mode: str | Path,
        cables: Mapping[str, Cable | Harness],
        scene: Scene,
        robot: str | Path | Sequence[Obstacle] | None = None,
        memory_limit: str = "512MB",
        *,
        colour: str = "curvature",
        times: bool = True,
        max_rate: float = 30.0,
    ) -> None:
        if not _MEMORY_LIMIT.fullmatch(memory_limit):
            raise ArgumentError.of(
                "memory_limit", memory_limit, "it must be a size or a share of the memory", "Write 512MB, 2GiB or 10%."
            )
        setup: dict[str, Any] = {
            "path": _checked_path(mode),
            "cables": {name: cable.as_dict() for name, cable in cables.items()},
            "scene": scene.as_dict(),
            "robot": str(Path(robot).resolve()) if isinstance(robot, (str, Path)) else Scene(robot or ()).as_dict(),
            "memory_limit": memory_limit,
            "colour": check_colouring(colour),
            "times": times,
            "max_rate": checks.number("max_rate", max_rate, above=0.0, unit="1/s"),
        }
        self.sent = 0  # reports handed over
        self.dropped = 0  # reports that could not be handed over, because the process is gone or they are too long
        self._mailbox, self._news = Mailbox(Mailbox.memory()), Mailbox(Mailbox.memory())
        wake, self._wake = os.pipe()
        papers = os.memfd_create("cable_shape_viewer_setup", os.MFD_CLOEXEC)
        given = (papers, self._mailbox.file, self._news.file)
        try:
            with open(papers, "w", encoding="utf-8", closefd=False) as file:
                json.dump(setup, file)
            self._process = subprocess.Popen(
                [sys.executable, "-m", "cable_shape.viewer.child", *map(str, given)],
                stdin=wake,
                pass_fds=given,
                process_group=0,  # Ctrl-C ends the caller, which closes the pipe
            )
        except OSError:
            os.close(self._wake)
            self._mailbox.close()
            self._news.close()
            raise
        finally:
            os.close(papers)
            os.close(wake)
        os.set_blocking(self._wake, False)
        self._period = 1.0 / setup["max_rate"]
        self._offered = -self._period  # s, when
        self._waiting: CycleReport | None = None
        self._connected = True

    @property
    def shown(self) -> int:
        """Reports that the process has taken to show; the other ones sent were overtaken by newer ones."""
        return self._mailbox.taken if self._connected else self._last_shown

    @property
    def ended(self) -> bool:
        """Whether the process is gone: its window was closed, its disk is full, or it was killed."""
        return self._process.poll() is not None

    @property
    def pid(self) -> int:
        """Of the viewer process."""
        return self._process.pid

    def send(self, report: CycleReport) -> bool:
        """Hands over a report without waiting; False if the process is gone or the report is too long."""
        if not (self._connected and self._mailbox.put(encode(in_parts(report)))):
            self.dropped += 1
            return False
        try:
            os.write(self._wake, b"\0")
        except BlockingIOError:
            pass  # so many wake-ups are waiting that one more changes nothing
        except BrokenPipeError:
            self.release()
            self.dropped += 1
            return False
        self.sent += 1
        return True

    def edited(self, layout: Layout) -> bool:
        """Has it draw cables, clips and bodies as they are now, with the next report; False if it cannot be told."""
        return self._connected and self._news.put(layout.as_text().encode())

    def offer(self, report: CycleReport) -> None:
        """Like `send`, but hands over no more than the process would show, for a loop whose time is dear.

        What comes too soon after the last one waits for the next `offer` or `flush`, or for the end.
        """
        self._waiting = report
        if time.monotonic() - self._offered >= self._period:
            self.flush()

    def flush(self) -> None:
        """Hands over the report that waits, if one does."""
        report, self._waiting = self._waiting, None
        if report is not None:
            self._offered = time.monotonic()
            self.send(report)

    def close(self, timeout: float = 5.0) -> bool:
        """Lets the process show the last report and end; after `timeout` [s] it is ended. True if it ended well."""
        self.release()
        return ended(self._process, timeout)

    def leave(self, timeout: float) -> bool:
        """For a caller that ends: after `timeout` [s] the process is left to write on by itself. True if it ended."""
        self.release()
        return left(self._process, timeout)

    def release(self) -> None:
        """Tells the process, by closing the pipe, that no more reports come."""
        self.flush()
        if self._connected:
            self._last_shown = self._mailbox.taken
            self._connected = False
            os.close(self._wake)
            self._mailbox.close()
            self._news.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()


def viewer_executable() -> str:
    """Path of rerun's viewer, which the wheel rerun-sdk brings."""
    from importlib.util import find_spec

    spec = find_spec("rerun_cli")
    file = Path(spec.origin).with_name("rerun") if spec is not None and spec.origin else None
    if file is None or not file.exists():
        raise DependencyError(f"The rerun viewer is not installed. Run: {how_to_get('rerun')}")
    return str(file)


def start_viewer(*options: str, timeout: float) -> tuple[subprocess.Popen[bytes], str]:
    """Starts rerun's viewer, reachable from this machine only; the process and the address to log to.

    Raises
    ------
    DependencyError
        If it is not there or does not listen within `timeout` [s].
    """
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    viewer = subprocess.Popen(
        [viewer_executable(), "--bind", "127.0.0.1", "--port", str(port), "--hide-welcome-screen", *options],
        stdin=subprocess.DEVNULL,
        env={"RUST_LOG": "error", **os.environ},
        start_new_session=True,
    )
    until = time.monotonic() + timeout
    while time.monotonic() < until and viewer.poll() is None:
        try:
            with socket.create_connection(("127.0.0.1", port), timeout=1.0):
                return viewer, f"rerun+http://127.0.0.1:{port}/proxy"
        except OSError:
            time.sleep(0.05)
    viewer.kill()
    viewer.wait()
    raise DependencyError(
        f"The rerun viewer did not start within {timeout:g} s. It needs a graphics driver; Mesa's software one serves: "
        "sudo apt-get install mesa-vulkan-drivers libvulkan1 libxkbcommon-x11-0"
    )


def _check_screen() -> None:
    if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise ArgumentError(
            "There is no screen for a window: neither DISPLAY nor WAYLAND_DISPLAY is set. "
            "Write a .rrd instead and open it on a machine with a screen: cable-shape view FILE.rrd"
        )


def _checked_path(mode: str | Path) -> str | None:
    """Absolute path of the .rrd to write, None for a window."""
    if mode == WINDOW:
        viewer_executable()
        _check_screen()
        return None
    file = Path(mode).expanduser().resolve()
    if file.suffix != ".rrd":
        raise ArgumentError.of(
            "mode", str(mode), "it must be 'window' or end in .rrd", "Give the path of the recording."
        )
    if not file.parent.is_dir():
        raise ArgumentError.of("mode", str(mode), f"there is no folder {file.parent}", "Make the folder first.")
    if not os.access(file.parent, os.W_OK):
        raise ArgumentError.of("mode", str(mode), f"{file.parent} cannot be written", "Choose another folder.")
    return str(file)
