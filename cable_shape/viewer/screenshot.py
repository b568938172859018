"""A picture of a .rrd at some time, drawn without a screen: ``scripts/screenshot``. Imports rerun."""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rerun.experimental import ViewerClient

from cable_shape.errors import ArgumentError, CableShapeError, DependencyError
from cable_shape.viewer.process import start_viewer

_START_WITHIN = 60.0  # s
#: The viewer shows notices of itself for some seconds, and loads what it draws bit by bit.
SETTLE = 9.0  # s


def screenshot(
    recording: str | Path,
    at: float | None = None,
    size: tuple[int, int] = (1600, 1000),
    view: str | None = None,
    settle: float = SETTLE,
) -> bytes:
    """The viewer's window with a recording in it, as a PNG.

    Parameters
    ----------
    recording : path of a .rrd
    at : float, optional
        [s] after the beginning of the recording; None: in its middle.
    size : (int, int)
        Width and height of the window in pixels.
    view : str, optional
        Name of one view ("scene"), without the window around it.
    settle : float
        [s] to wait before the picture is taken.

    Raises
    ------
    ArgumentError
        If there is no such file, time or view.
    DependencyError
        If the viewer does not start or ends early.
    """
    file = Path(recording).expanduser().resolve()
    if not file.is_file():
        raise ArgumentError.of("recording", str(recording), "there is no such file", "Give the path of a .rrd.")
    window = f"{size[0]}x{size[1]}"
    viewer, url = start_viewer("--headless", "--window-size", window, "--memory-limit", "2GiB", timeout=_START_WITHIN)
    try:
        client = ViewerClient.connect(url)
        client.open(str(file))
        state = client.get_state()
        _go_to(client, state, at)
        time.sleep(settle)
        return client.take_screenshot(view_id=_view_id(state, view))
    except (ConnectionError, RuntimeError) as error:
        raise DependencyError(f"The rerun viewer could not draw {file}: {error}. Open it with: rerun {file}") from error
    finally:
        viewer.terminate()
        try:
            viewer.wait(5.0)
        except subprocess.TimeoutExpired:
            viewer.kill()
            viewer.wait()


def _go_to(client: ViewerClient, state: Any, at: float | None) -> None:
    """Stops the time `at` [s] after the first row."""
    timeline = next((line for shown in state.recordings for line in shown.timelines if line.name == "stamp"), None)
    if timeline is None or timeline.start is None:
        raise ArgumentError("The recording has no timeline 'stamp': it was not written by cable_shape, or is empty.")
    length = (timeline.end - timeline.start) * 1e-9
    seconds = 0.5 * length if at is None else at
    if not 0.0 <= seconds <= length:
        raise ArgumentError.of("at", seconds, f"the recording is {length:.3f} s long", "Choose a time within it.")
    stamp = timeline.start + round(seconds * 1e9)
    if timeline.time_type == "timestamp":
        client.set_time("stamp", timestamp=np.datetime64(stamp, "ns"), play_state="paused")
    else:
        client.set_time("stamp", duration=np.timedelta64(stamp, "ns"), play_state="paused")


def _view_id(state: Any, view: str | None) -> str | None:
    if view is None:
        return None
    named = {shown.name: shown.view_id for shown in state.views}
    if view not in named:
        raise ArgumentError.of("view", view, f"the views are {', '.join(sorted(named))}", "Choose one of these.")
    return str(named[view])


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line of ``scripts/screenshot``."""
    parser = argparse.ArgumentParser(prog="screenshot", description="Draws a .rrd to a PNG, without a screen.")
    parser.add_argument("recording", type=Path, metavar="FILE.rrd")
    parser.add_argument("picture", type=Path, metavar="OUT.png")
    parser.add_argument("--at", type=float, metavar="SECONDS", help="after the beginning; by default the middle")
    parser.add_argument("--size", default="1600x1000", metavar="WIDTHxHEIGHT", help="of the window (%(default)s)")
    parser.add_argument("--view", metavar="NAME", help='only this view, e.g. "scene"')
    given = parser.parse_args(arguments)
    width, _, height = given.size.partition("x")
    if not (width.isdecimal() and height.isdecimal()):
        parser.error(f"--size {given.size}: write WIDTHxHEIGHT in pixels, for example 1600x1000")
    try:
        given.picture.write_bytes(screenshot(given.recording, given.at, (int(width), int(height)), given.view))
    except (CableShapeError, OSError) as error:
        print(f"screenshot: {error}", file=sys.stderr)
        return 1
    print(given.picture)
    return 0


if __name__ == "__main__":
    sys.exit(main())
