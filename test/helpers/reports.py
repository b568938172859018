"""What the tests of the viewer share: cycle reports, written to recordings and read from them."""

from __future__ import annotations

import dataclasses
import math
import os
import time
from pathlib import Path

import numpy as np

from cable_shape.cable.cable import Cable
from cable_shape.pose import Grip, Pose
from cable_shape.safety.report import BodyDistance, CableWarning, Clearance, CycleReport, Margin, Severity, WarningKind
from cable_shape.scene.plug import PlugError
from cable_shape.scene.scene import Box, Capsule, Clip, Cylinder, HalfSpace, Mesh, Obstacle, PointMass, Scene, Sphere
from cable_shape.shape import CableShape, Status

ROOT = Path(__file__).resolve().parents[2]
#: For a child that imports this module, too.
BESIDE = {**os.environ, "PYTHONPATH": os.pathsep.join((str(Path(__file__).parent), os.environ.get("PYTHONPATH", "")))}
RADIUS = 0.4  # m, of the arc that the test cable forms
POINTS = 60
T0 = 1_700_000_000_000_000_000  # ns
PERIOD = 20_000_000  # ns
CABLE = Cable(length=0.5 * math.pi * RADIUS, linear_density=0.1, bending_stiffness=0.01, min_bend_radius=0.2)
TRIANGLE = Mesh(np.eye(3) * 0.05, np.array([[0, 1, 2]]))
SCENE = Scene(
    obstacles=(
        Obstacle("box", Box(np.array((0.1, 0.1, 0.1))), Pose((0.0, 0.0, 0.1))),
        Obstacle("sphere", Sphere(0.05), Pose((0.3, 0.0, 0.1))),
        Obstacle("rod of steel", Cylinder(0.02, 0.2), Pose((0.3, 0.2, 0.1))),
        Obstacle("pipe", Capsule(0.02, 0.2), Pose((0.3, 0.3, 0.1))),
        Obstacle("part", TRIANGLE),
        Obstacle("table", HalfSpace()),
    ),
    clips=(Clip(0.2, Pose((0.1, 0.0, 0.4))),),
    masses=(PointMass(0.3, 0.05),),
    sockets={"port": Pose((1.0, 0.0, 0.5))},
)
LINKS = (Obstacle("hand", Box(np.array((0.05, 0.05, 0.05))), link="wrist"),)


def arc(height: float = 0.5, status: Status = Status.OK) -> CableShape:
    """A quarter circle in the x-z plane: curvature 1 / RADIUS about d2 everywhere, tension 1 N to 2 N."""
    angle = np.linspace(0.0, 0.5 * np.pi, POINTS)
    zero, half = np.zeros(POINTS), 0.5 * angle
    forward = np.stack((np.cos(angle), zero, -np.sin(angle)), axis=1)  # tangent, from +x down to -z
    positions = np.stack((RADIUS * np.sin(angle), zero, height + RADIUS * (np.cos(angle) - 1.0)), axis=1)
    # d3 = +x is a turn of 90 degrees about +y
    quaternions = np.stack((zero, np.sin(half + 0.25 * np.pi), zero, np.cos(half + 0.25 * np.pi)), axis=1)
    curvature = np.tile((0.0, 1.0 / RADIUS, 0.0), (POINTS, 1))
    force = forward * np.linspace(1.0, 2.0, POINTS)[:, None]
    parts = (angle * RADIUS, positions, quaternions, curvature, force, np.zeros((POINTS, 3)))
    return CableShape(
        np.concatenate([part.ravel() for part in parts]), POINTS, length=CABLE.length, model="test", status=status
    )


def warning(distance: float, severity: Severity = Severity.WARN) -> CableWarning:
    return CableWarning(
        cable_id="cable",
        kind=WarningKind.CLEARANCE,
        severity=severity,
        text=f"{distance * 1e3:.1f} mm to box",
        value=distance,
        limit=0.03,
        margin=distance / 0.03,
        arc_length=0.1,
        point_on_cable=np.array((0.1, 0.0, 0.2)),
        point_on_other=np.array((0.1, 0.0, 0.18)),
        other="box",
    )


def report(k: int, stamp0: int = T0) -> CycleReport:
    """Report k of a cable that goes down by 1 mm a cycle past a box; warnings from cycle 3 to cycle 5."""
    shape = arc(0.5 - 0.001 * k)
    start = Pose(shape.positions[0], shape.quaternions[0])
    end = Grip(Pose(shape.positions[-1], shape.quaternions[-1]), kind="swivel")
    distance = 0.035 - 0.002 * k
    body = BodyDistance("box", distance, 0.1, np.array((0.1, 0.0, 0.2)), np.array((0.1, 0.0, 0.2 - distance)))
    return CycleReport(
        stamp=stamp0 + k * PERIOD,
        grips={"cable": (start, end)},
        links={"wrist": start},
        shapes={"cable": shape},
        clearance={"cable": Clearance((body,), robot_checked=True)},
        warnings=(warning(distance),) if 3 <= k <= 5 else (),
        times={"predict": 1e-5, "total": 2e-4},
        skipped={"reused": 0},
    )


MARGIN = Margin(WarningKind.CLEARANCE, 0.8, 0.03, 0.036, -0.1, "box", 1.25)
PLUG = PlugError("port", Pose((1, 2, 3)), 0.05, 0.1, -0.04, 0.03)


def near_a_snap(k: int) -> CycleReport:
    """Report k with tails, margins and, from cycle 2 to cycle 3, a snap that is about to come."""
    margins = (
        MARGIN._replace(used=0.1 * k, other="sphere"),
        MARGIN._replace(used=0.2 * k),
        Margin(WarningKind.OVERSTRETCHED, 3.0, 1.0, 3.0, 0.6),
    )
    return dataclasses.replace(
        report(k),
        margins={"cable": margins},
        tails={("cable", "start"): arc(0.2)},
        after_snap={"cable": arc(0.3, Status.SNAPPED)} if k in (2, 3) else {},
        plugs={"cable": PLUG},
    )


def write(path: Path, reports: list[CycleReport], **keywords: object) -> None:
    from cable_shape.viewer.recording import RecordingWriter

    with RecordingWriter(path, {"cable": CABLE}, SCENE, LINKS, **keywords) as writer:
        for r in reports:
            writer.log(r)


def columns(path: Path) -> dict[str, list[tuple[object, object]]]:
    """Everything in a recording: column -> (time or None if static, value) in the order of time."""
    from rerun.chunk import RrdReader

    out: dict[str, list[tuple[object, object]]] = {}
    for chunk in RrdReader(str(path)).stream().to_chunks():
        batch = chunk.to_record_batch()
        names = batch.schema.names
        times = [None] * batch.num_rows if chunk.is_static else batch.column("stamp").cast("int64").to_pylist()
        for name in names:
            if name not in {"stamp", "rerun.controls.RowId"}:
                values = batch.column(name).to_pylist()
                rows = [(t, v) for t, v in zip(times, values, strict=True) if v is not None]
                out.setdefault(f"{chunk.entity_path}:{name}", []).extend(rows)
    return {name: sorted(rows, key=lambda row: row[0] or 0) for name, rows in out.items()}


def last_stamp(path: Path) -> object:
    return columns(path)["/plots/tension/cable:Scalars:scalars"][-1][0]


def gone(pid: int) -> bool:
    """Whether a process has ended, be it a zombie still."""
    try:
        return "\nState:\tZ" in Path(f"/proc/{pid}/status").read_text()
    except OSError:
        return True


def wait_until(true: object, within: float = 120.0) -> bool:
    until = time.monotonic() + within
    while not true():  # type: ignore[operator]
        if time.monotonic() > until:
            return False
        time.sleep(0.01)
    return True
