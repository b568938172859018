"""Where the reports of a replay go: :class:`Sinks`."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, final

from cable_shape.checks import Array
from cable_shape.cycle.cycle import Cycle
from cable_shape.errors import BagError
from cable_shape.replay.bag_writer import BagWriter
from cable_shape.replay.carried import Carried
from cable_shape.replay.settings import Settings
from cable_shape.safety.report import CycleReport
from cable_shape.scene.scene import Scene
from cable_shape.viewer.recording_process import RecordingProcess


@final
class Sinks:
    """The recording of the node's messages and the .rrd, which another core writes; files are there once it `begin`s.

    All methods raise BagError where nothing can be written any more.
    """

    def __init__(self, out: Path, settings: Settings) -> None:
        self.out = out
        self._scene = settings.scene or Scene()
        self._recording = RecordingProcess() if settings.rrd else None
        self._bag: BagWriter | None = None
        self._writing = _Writing(self._unwritable)

    def begin(self, what: Carried, links: Any, markers: bool) -> None:
        """Makes the files; links: what the robot's look like."""
        with self._writing:
            self._bag = BagWriter(self.out / "replay")
            if self._recording is not None:
                carried = {what.name: what.what}
                self._recording.begin(self.out / "replay.rrd", carried, self._scene, links, markers=markers)

    def write(self, report: CycleReport, frame_id: str) -> None:
        """One report, without what differs from run to run."""
        assert self._bag is not None
        with self._writing:
            self._bag.write(report, frame_id)
            if self._recording is not None:
                self._recording.log(report)

    def edited(self, message: Any, cycle: Cycle, stamp: int, frame_id: str) -> None:
        """What was edited before the cycle of `stamp` [ns]."""
        if self._bag is None:
            return
        with self._writing:
            self._bag.write_edits(message, cycle.layout, stamp, frame_id)
            if self._recording is not None:
                self._recording.edited(cycle.layout)

    def log_markers(self, points: Array, stamp: int) -> None:
        """Markers (k, 3) [m], world, that were measured at `stamp` [ns]."""
        if self._bag is not None and self._recording is not None:
            with self._writing:
                self._recording.log_markers(points, stamp)

    def log_distances(self, distances: Array, radii: Array | None, stamp: int) -> None:
        """How far they are from the centreline, and how wide the tube is there [m]."""
        if self._bag is not None and self._recording is not None:
            with self._writing:
                self._recording.log_distances(distances, radii, stamp)

    def __enter__(self) -> Sinks:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """Closes all, whatever fails."""
        failures: list[Exception] = []
        for sink in (self._bag, self._recording):
            try:
                if sink is not None:
                    sink.close()
            except (OSError, RuntimeError) as error:
                failures.append(error)
        if failures and kind is None:
            raise self._unwritable(failures[0]) from failures[0]

    def _unwritable(self, error: Exception) -> BagError:
        return BagError(
            f"{self.out}: cannot be written any further ({error}); is the disk full? Make room, or choose another one."
            f" What was replayed until then is in {self.out / 'replay'} and can be read like any damaged recording."
        )


@final
class _Writing:
    """Tells of what cannot be written; entered again and again."""

    def __init__(self, told: Callable[[Exception], BagError]) -> None:
        self._told = told

    def __enter__(self) -> None:
        pass

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, *_: object) -> None:
        if isinstance(error, OSError | RuntimeError):  # the latter is rerun's
            raise self._told(error) from error
