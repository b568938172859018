"""A complete .rrd that another core writes: :class:`RecordingProcess`. This module does not import rerun."""

from __future__ import annotations

import contextlib
import fcntl
import json
import marshal
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import final

import numpy as np

from cable_shape.cable.cable import Cable
from cable_shape.cable.harness import Harness
from cable_shape.checks import Array
from cable_shape.prediction.layout import Layout
from cable_shape.safety.report import CycleReport
from cable_shape.scene.scene import Obstacle, Scene
from cable_shape.viewer.letters import encode
from cable_shape.viewer.process import viewer_executable

_ENDS_WITHIN = 60.0  # s
_UNDER_WAY = 1 << 20  # bytes on the way to it; some fifty reports: it writes to its file now and then


@final
class RecordingProcess:
    """A :class:`cable_shape.viewer.recording.RecordingWriter` in a process of its own, which takes every report.

    Drawing takes longer than most predictions. The caller waits only while the process is far behind. When the caller
    ends in whatever way, the process writes what it has been given, and ends, too.

    Raises
    ------
    DependencyError
        If rerun is not installed.
    """

    def __init__(self) -> None:
        viewer_executable()
        command = [sys.executable, "-m", "cable_shape.viewer.recorder"]
        pipe = subprocess.PIPE  # process_group: Ctrl-C ends the caller, which closes the pipe
        self._process = subprocess.Popen(command, bufsize=_UNDER_WAY // 4, stdin=pipe, stdout=pipe, process_group=0)
        assert self._process.stdin is not None
        self._pipe, self._process.stdin = self._process.stdin, None
        with contextlib.suppress(OSError, AttributeError):  # not allowed, not Linux
            fcntl.fcntl(self._pipe, fcntl.F_SETPIPE_SZ, _UNDER_WAY)

    def begin(
        self,
        path: Path,
        cables: Mapping[str, Cable | Harness],
        scene: Scene,
        links: Sequence[Obstacle] = (),
        *,
        markers: bool = False,
    ) -> None:
        """The file and what is drawn, once and before all else, as for :class:`RecordingWriter`."""
        drawn = {
            "path": str(path.resolve()),
            "cables": {name: cable.as_dict() for name, cable in cables.items()},
            "scene": scene.as_dict(),
            "links": Scene(links).as_dict(),
            "markers": markers,
        }
        self._tell("begin", json.dumps(drawn))

    def log(self, report: CycleReport) -> None:
        """Writes one report at its stamp. RuntimeError once the file cannot be written any more."""
        self._tell("log", encode(report))

    def edited(self, layout: Layout) -> None:
        """Cables, clips and bodies are these from the next report on."""
        self._tell("edited", layout.as_text())

    def log_markers(self, points: Array, stamp: int) -> None:
        """Writes measured markers (k, 3) [m], world, at `stamp` [ns]."""
        self._tell("markers", _bytes(points), stamp)

    def log_distances(self, distances: Array, radii: Array | None, stamp: int) -> None:
        """Plots how far measured markers are from the centreline at `stamp` [ns]."""
        self._tell("distances", _bytes(distances), None if radii is None else _bytes(radii), stamp)

    def close(self) -> None:
        """Waits until all is written and the process has ended; RuntimeError if it could not be written."""
        if not self._pipe.closed:
            self._tell("close")
            told = self._end()
            if told:
                raise RuntimeError(told)

    def _tell(self, what: str, *values: str | bytes | int | None) -> None:
        try:
            marshal.dump((what, values), self._pipe)
        except OSError:  # it is gone
            raise RuntimeError(self._end()) from None

    def _end(self) -> str:
        """Lets it end, and hears what went wrong; nothing if all is written."""
        with contextlib.suppress(OSError):
            self._pipe.close()
        assert self._process.stdout is not None
        try:
            told, _ = self._process.communicate(timeout=_ENDS_WITHIN)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.communicate()
            return f"what was left was not written within {_ENDS_WITHIN:g} s"
        if self._process.returncode:
            return told.decode() or f"the process that writes it has ended with exit code {self._process.returncode}"
        return ""


def _bytes(numbers: Array) -> bytes:
    return np.asarray(numbers, dtype=np.float64).tobytes()
