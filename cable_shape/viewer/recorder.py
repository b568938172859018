"""The process of :class:`~cable_shape.viewer.recording_process.RecordingProcess`: takes reports, writes a .rrd.

    python -m cable_shape.viewer.recorder

What it is given comes by standard input, whose end ends it; what went wrong is told on standard output.
"""

from __future__ import annotations

import gc
import json
import marshal
import sys
from typing import Any

import numpy as np

from cable_shape.cable.harness import Harness
from cable_shape.checks import Array
from cable_shape.prediction.layout import Layout
from cable_shape.scene.scene import Scene
from cable_shape.viewer.child import cable_from
from cable_shape.viewer.children import be_ordinary
from cable_shape.viewer.letters import decode
from cable_shape.viewer.recording import RecordingWriter


def main() -> int:
    """Writes what it is given."""
    be_ordinary()
    gc.freeze()
    gc.set_threshold(50_000, 20, 50)  # what waits to be written is seldom garbage
    try:
        what, values = _taken()
        if what == "begin":
            _write(**json.loads(values[0]))
    except RuntimeError as error:  # rerun's, once its file cannot be written
        print(error, end="")
        return 1
    return 0


def _write(path: str, cables: dict[str, Any], scene: dict[str, Any], links: dict[str, Any], markers: bool) -> None:
    known = {name: cable_from(values) for name, values in cables.items()}
    harnesses = {name: one for name, one in known.items() if isinstance(one, Harness)}
    robot = Scene.from_mapping(links).obstacles
    with RecordingWriter(path, known, Scene.from_mapping(scene), robot, markers=markers) as recording:
        while True:
            what, values = _taken()
            if what == "log":
                recording.log(decode(values[0]))
            elif what == "edited":
                recording.edited(Layout.read(values[0], harnesses))
            elif what == "markers":
                recording.log_markers(_numbers(values[0]).reshape(-1, 3), values[1])
            elif what == "distances":
                recording.log_distances(
                    _numbers(values[0]), None if values[1] is None else _numbers(values[1]), values[2]
                )
            else:
                return


def _numbers(data: bytes) -> Array:
    return np.frombuffer(data, dtype=np.float64)


def _taken() -> tuple[str, tuple[Any, ...]]:
    try:
        what, values = marshal.load(sys.stdin.buffer)  # noqa: S302, of the parent process
    except (EOFError, ValueError, TypeError):  # the caller has ended, perhaps in the middle of a report
        return "close", ()
    return what, values


if __name__ == "__main__":
    sys.exit(main())
