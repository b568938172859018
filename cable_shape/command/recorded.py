"""Shapes as a recording for the viewer: :func:`record` one, :func:`record_motion` those of a motion."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from cable_shape.cable.cable import Cable
from cable_shape.cable.harness import Harness
from cable_shape.checks import Array
from cable_shape.cycle.cycle import Cycle
from cable_shape.pose import Grip, Pose
from cable_shape.scene.scene import Scene


def record(path: Path, cables: Mapping[str, Cable | Harness], grips: Mapping[str, Any], scene: Scene | None) -> None:
    """Writes a .rrd with one cycle: the cables between these grips or ends, with clearance and margins."""
    from cable_shape.viewer.recording import RecordingWriter

    around = Scene() if scene is None else scene
    path.parent.mkdir(parents=True, exist_ok=True)
    report = Cycle(cables, scene=around).step(grips, stamp=0)
    with RecordingWriter(path, cables, around) as recording:
        recording.log(report)


#: So many instants of a motion are recorded at most, and in so many nanoseconds each.
MOST_INSTANTS, PERIOD = 500, 20_000_000


def record_motion(
    path: Path, cable: Cable | Harness, scene: Scene, held: Mapping[str, Any], frames: Mapping[str, Array],
    options: Mapping[str, Any],
) -> None:  # fmt: skip
    """Writes a .rrd with a cycle an instant: frames {end: (m, 7)} of the cable at the ends that are held."""
    from cable_shape.viewer.recording import RecordingWriter

    name, count = "cable", len(next(iter(frames.values())))
    load = options.get("distributed_load")
    given = {key: options[key] for key in ("model", "gravity", "points", "tolerance") if key in options}
    cycle = Cycle({name: cable}, scene=scene, distributed_load=None if load is None else {name: load}, **given)
    with RecordingWriter(path, {name: cable}, scene) as recording:
        for i in range(0, count, max(1, -(-count // MOST_INSTANTS))):
            ends: Any = {
                end: grip.at(Pose.trusted(frames[end][i])) if isinstance(grip, Grip) else grip
                for end, grip in held.items()
            }
            grips = ends if isinstance(cable, Harness) else (ends["start"], ends["end"])
            recording.log(cycle.step({name: grips}, stamp=i * PERIOD))
