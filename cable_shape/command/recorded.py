"""One shape as a recording for the viewer: :func:`record`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from cable_shape.cable.cable import Cable
from cable_shape.cable.harness import Harness
from cable_shape.cycle.cycle import Cycle
from cable_shape.scene.scene import Scene


def record(path: Path, cables: Mapping[str, Cable | Harness], grips: Mapping[str, Any], scene: Scene | None) -> None:
    """Writes a .rrd with one cycle: the cables between these grips or ends, with clearance and margins."""
    from cable_shape.viewer.recording import RecordingWriter

    around = Scene() if scene is None else scene
    path.parent.mkdir(parents=True, exist_ok=True)
    report = Cycle(cables, scene=around).step(grips, stamp=0)
    with RecordingWriter(path, cables, around) as recording:
        recording.log(report)
