"""A .rrd that another process writes: what is in it, and how it ends where that process or the caller does."""

from __future__ import annotations

import collections
import itertools
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from reports import CABLE, LINKS, SCENE, columns, last_stamp, near_a_snap, report, wait_until, write

from cable_shape.prediction.layout import Layout
from cable_shape.viewer.recording_process import RecordingProcess

REPORTS = [near_a_snap(k) for k in range(8)]


def begun(path: Path) -> RecordingProcess:
    process = RecordingProcess()
    process.begin(path, {"cable": CABLE}, SCENE, LINKS)
    return process


def test_it_holds_what_a_writer_in_this_process_writes(tmp_path: Path) -> None:
    process = begun(tmp_path / "beside.rrd")
    for one in REPORTS:
        process.log(one)
    process.close()
    process.close()
    write(tmp_path / "here.rrd", REPORTS)
    assert columns(tmp_path / "beside.rrd") == columns(tmp_path / "here.rrd")


def test_markers_and_edits_reach_it(tmp_path: Path) -> None:
    process = begun(tmp_path / "seen.rrd")
    process.log(report(0))
    process.log_markers(np.ones((3, 3)), report(1).stamp)
    process.log_distances(np.full(3, 0.002), None, report(1).stamp)
    process.edited(Layout.of(SCENE, {"cable": CABLE}, {}, {}))
    process.log(report(2))
    process.close()
    found = columns(tmp_path / "seen.rrd")
    assert found["/world/markers:Points3D:positions"][0][1] == [[1.0, 1.0, 1.0]] * 3
    assert found["/plots/markers/distance:Scalars:scalars"][0][1] == [2.0, 2.0]
    assert len(found["/plots/tension/cable:Scalars:scalars"]) == 2


def test_nothing_was_to_be_drawn(tmp_path: Path) -> None:
    RecordingProcess().close()
    assert not list(tmp_path.iterdir())


def test_that_it_was_killed_is_told(tmp_path: Path) -> None:
    process = begun(tmp_path / "seen.rrd")
    process._process.kill()
    many = itertools.repeat(report(0))  # until what is on the way to it is full
    with pytest.raises(RuntimeError, match="has ended with exit code -9"):
        collections.deque(map(process.log, many), maxlen=0)
    process.close()


def test_a_place_where_nothing_can_be_written_is_told(tmp_path: Path) -> None:
    process = begun(tmp_path / "no folder" / "seen.rrd")
    with pytest.raises(RuntimeError, match="no folder"):
        process.close()


CALLER = """
import os, sys
sys.path[:0] = {places!r}
from test_recording_process import REPORTS, begun
process = begun(__import__("pathlib").Path({path!r}))
for one in REPORTS:
    process.log(one)
process._pipe.flush()
print("given", flush=True)
os.kill(os.getpid(), 9)
"""


def test_what_it_was_given_is_written_when_the_caller_is_killed(tmp_path: Path) -> None:
    path = tmp_path / "seen.rrd"
    places = [str(Path(__file__).parent), str(Path(__file__).parents[1] / "helpers")]
    code = CALLER.format(places=places, path=str(path))
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
    assert done.returncode == -signal.SIGKILL, done.stderr
    assert done.stdout == "given\n"

    def written() -> bool:
        try:
            return last_stamp(path) == REPORTS[-1].stamp
        except (OSError, RuntimeError, ValueError, KeyError):  # it is still being written
            return False

    assert wait_until(written)
