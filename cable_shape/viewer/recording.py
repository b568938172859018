"""A complete .rrd of cycle reports: :class:`RecordingWriter`.

This module imports rerun, so it is imported by the viewer process and by whoever writes a recording, and only there.
"""

from __future__ import annotations

import atexit
import ctypes
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Self, final

import rerun as rr

from cable_shape.cable.cable import Cable
from cable_shape.cable.harness import Harness
from cable_shape.checks import Array
from cable_shape.prediction.layout import Layout
from cable_shape.safety.report import CycleReport
from cable_shape.scene.scene import Obstacle, Scene
from cable_shape.viewer.entities import ReportLogger

_FLUSH_PERIOD = 1.0  # s, between looks whether a file can still be written
_FLUSH_WITHIN = 10.0  # s


@final
class RecordingWriter:
    """A .rrd of every report that it is given; two runs over the same reports decode to the same columns.

    Parameters
    ----------
    path : path of the .rrd; an existing file is replaced
    cables, scene, links, colour, times, markers
        As for :class:`ReportLogger`. `times` are left out by default: they differ from run to run.
    """

    def __init__(
        self,
        path: str | Path,
        cables: Mapping[str, Cable | Harness],
        scene: Scene,
        links: Sequence[Obstacle] = (),
        *,
        colour: str = "curvature",
        times: bool = False,
        markers: bool = False,
    ) -> None:
        self.recording = new_recording(path)
        self._logger = ReportLogger(
            self.recording, cables, scene, links, colour=colour, times=times, markers=markers, later=True
        )
        self._flushed = time.monotonic()
        self._broken = False

    def log(self, report: CycleReport) -> None:
        """Writes one report at its stamp. RuntimeError once the file cannot be written any more, within a second."""
        self._logger.log(report)
        now = time.monotonic()
        if now - self._flushed > _FLUSH_PERIOD:
            self._flushed = now
            self._flush(_FLUSH_WITHIN)

    def edited(self, layout: Layout) -> None:
        """Cables, clips and bodies are these from the next report on."""
        self._logger.edited(layout)

    def log_markers(self, points: Array, stamp: int | None = None) -> None:
        """Writes measured markers (k, 3) [m], world, at `stamp` [ns], by default that of the last report."""
        self._logger.log_markers(points, stamp)

    def log_distances(self, distances: Array, radii: Array | None, stamp: int) -> None:
        """Plots how far measured markers are from the centreline, see :meth:`Plots.markers`, at `stamp` [ns]."""
        self._logger.log_distances(distances, radii, stamp)

    def close(self, timeout: float = 30.0) -> None:
        """Writes what is still buffered, within `timeout` [s], and closes the file; RuntimeError if it cannot."""
        if not self._broken:
            self._flush(timeout)
            self.recording.disconnect()

    def _flush(self, timeout: float) -> None:
        try:
            self._logger.flush()
            self.recording.flush(timeout_sec=timeout)
        except RuntimeError:
            self._broken = True
            # rerun would wait for ever for its file, when it is shut down and when the recording is freed
            atexit.unregister(rr.rerun_shutdown)
            ctypes.pythonapi.Py_IncRef(ctypes.py_object(self.recording))
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()


def new_recording(path: str | Path | None = None) -> rr.RecordingStream:
    """A recording whose identity is the same in every run, written to the .rrd `path` once a second if it is given."""
    recording = rr.RecordingStream(
        "cable_shape",
        recording_id="cable_shape",
        send_properties=False,
        batcher_config=None if path is None else rr.ChunkBatcherConfig(flush_tick=1.0),
    )
    if path is not None:
        recording.save(str(path))
    return recording
