"""Goals of CalibrateCable and clouds of points as arguments of the calibration, and what it found as messages."""

from __future__ import annotations

import array
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from sensor_msgs.msg import PointCloud2, PointField

from cable_shape import checks
from cable_shape.cable.harness_file import ENDS, MARKERS
from cable_shape.calibration.harness_observation import HarnessObservation
from cable_shape.calibration.harness_result import HarnessCalibration
from cable_shape.calibration.observation import Observation
from cable_shape.calibration.result import STRAY, Calibration
from cable_shape.checks import Array
from cable_shape.cycle.harness_ends import HarnessFile
from cable_shape.errors import ArgumentError, InputError
from cable_shape.pose import GRIP_KINDS, Grip, Pose
from cable_shape.ros.messages import CableCalibration
from cable_shape.ros.workers import CalibratorSetup
from cable_shape.uncertainty.uncertainty import Uncertainty

#: Of one goal.
MOST_OBSERVATIONS, MOST_POINTS = 2000, 100_000
_NUMBERS = {PointField.FLOAT32: "f4", PointField.FLOAT64: "f8"}


class Asked(NamedTuple):
    """What CalibrateCable asks for."""

    observations: list[Any]
    fit: tuple[str, ...]
    priors: dict[str, float]
    time_limit: float  # s


def asked(goal: Any, setup: CalibratorSetup, harness: HarnessFile | None = None) -> Asked:
    """A goal of CalibrateCable, of a cable or a harness with the ends as they are held.

    Raises
    ------
    ArgumentError
        For arrays whose lengths do not fit together, too many points, and whatever observations refuse.
    """
    count = len(goal.counts)
    if not 0 < count <= MOST_OBSERVATIONS:
        bound = f"there must be 1 to {MOST_OBSERVATIONS} observations"
        raise ArgumentError.of("counts", f"{count} numbers", bound, "Give the number of points of each.")
    total = sum(goal.counts)
    if not 0 < total <= MOST_POINTS:
        raise ArgumentError.of("counts", f"{total} points", f"there must be 1 to {MOST_POINTS}", "Thin them out.")
    points = _rows("points", goal.points, total, 3)
    arc = _rows("arc_length", goal.arc_length, total, 1)[:, 0] if goal.arc_length else None
    groups = _rows("groups", goal.groups, count, 1)[:, 0].astype(int).tolist() if goal.groups else [None] * count
    make = _of_cable(goal, count) if harness is None else _of_harness(goal, count, harness)
    if len(goal.prior_names) != len(goal.prior_errors):
        bound = f"it must hold {len(goal.prior_names)} numbers, one for each of prior_names"
        raise ArgumentError.of("prior_errors", f"{len(goal.prior_errors)} numbers", bound, "Give both.")
    seen = []
    bounds = np.cumsum([0, *goal.counts])
    for i in range(count):
        here = slice(int(bounds[i]), int(bounds[i + 1]))
        try:
            seen.append(make(i, points[here], None if arc is None else arc[here], groups[i]))
        except ArgumentError as error:
            raise ArgumentError(f"observation {i}: {error}") from None
    time_limit = checks.number("time_limit", goal.time_limit, at_least=0.0, unit="s") or setup.time_limit
    priors = dict(zip(goal.prior_names, goal.prior_errors, strict=True))
    return Asked(seen, tuple(goal.fit) or setup.fit, priors, min(time_limit, setup.time_limit))


_SIDES = ("start", "end")
_Make = Callable[[int, Array, Array | None, int | None], Any]


def _of_cable(goal: Any, count: int) -> _Make:
    """What makes the observations of a cable, by their numbers."""
    starts, ends = _rows("starts", goal.starts, count, 7), _rows("ends", goal.ends, count, 7)
    kinds = [checks.one_of(f"{side}_kind", getattr(goal, f"{side}_kind") or "clamped", GRIP_KINDS) for side in _SIDES]

    def made(i: int, points: Array, arc_length: Array | None, group: int | None) -> Observation:
        start, end = (Grip(Pose(row[:3], row[3:]), kind) for row, kind in zip((starts[i], ends[i]), kinds, strict=True))
        return Observation(start, end, points, arc_length, group=group)

    return made


def _of_harness(goal: Any, count: int, harness: HarnessFile) -> _Make:
    """The same of a harness, whose file says how each end is held."""
    for name in ("ends", "start_kind", "end_kind"):
        if len(getattr(goal, name)):
            bound = f"starts holds the poses of all grips of a harness: {', '.join(harness.grips)}"
            raise ArgumentError.of(name, "given", bound, "Leave it empty; kinds are those of the harness's file.")
    grips = len(harness.grips)
    poses = _rows("starts", goal.starts, count * grips, 7).reshape(count, grips, 7)

    def made(i: int, points: Array, arc_length: Array | None, group: int | None) -> HarnessObservation:
        return look_at(harness, [Pose(row[:3], row[3:]) for row in poses[i]], points, arc_length, group)

    return made


def look_at(
    file: HarnessFile,
    poses: Sequence[Pose],
    points: Array,
    arc_length: Array | None = None,
    group: int | None = None,
) -> HarnessObservation:
    """An observation of a harness whose grips are at these poses.

    Points are the file's markers, in their order, NaN where one was not seen; without markers in the file each is on
    the segment that is nearest.

    Raises
    ------
    ArgumentError
        For another number of points than the file has markers, and arc lengths, which the file says.
    """
    ends = file.at(poses)
    if arc_length is not None:
        bound, remedy = "the file of a harness says where markers are", "Leave it empty; see the file's key markers."
        raise ArgumentError.of("arc_length", f"{len(arc_length)} numbers", bound, remedy)
    if not file.markers:
        return HarnessObservation(ends, {"+".join(file.harness.segments): points}, group=group)
    counts = np.cumsum([len(at) for at in file.markers.values()])
    if len(points) != counts[-1]:
        bound = f"the harness's file has {counts[-1]} markers"
        raise ArgumentError.of("points", f"{len(points)} points", bound, "Give all in its order, NaN where not seen.")
    seen = dict(zip(file.markers, np.split(points, counts[:-1]), strict=True))
    return HarnessObservation(ends, seen, file.markers, group=group)


def _rows(name: str, numbers: Any, rows: int, width: int) -> Array:
    """(rows, width) of a flat array."""
    if len(numbers) != rows * width:
        bound = f"it must hold {rows} times {width} numbers"
        raise ArgumentError.of(name, f"{len(numbers)} numbers", bound, "Row after row; see CalibrateCable.action.")
    return np.array(numbers, dtype=np.float64).reshape(rows, width)


def points_of(cloud: PointCloud2) -> tuple[Array, Array | None]:
    """Points (m, 3) [m] of a cloud with fields x, y, z, and (m,) of arc_length if it has that.

    Raises
    ------
    InputError
        If it lacks one of x, y, z as floating-point numbers, or its data are shorter than it says.
    """
    byte_order = ">" if cloud.is_bigendian else "<"
    fields = {f.name: f for f in cloud.fields if f.datatype in _NUMBERS and f.count in (0, 1)}
    if not {"x", "y", "z"} <= fields.keys():
        raise InputError(f"fields {[f.name for f in cloud.fields]}: x, y, z must be there as FLOAT32 or FLOAT64.")
    rows, width, step = cloud.height, cloud.width, cloud.point_step
    ends = [f.offset + np.dtype(_NUMBERS[f.datatype]).itemsize for f in fields.values()]
    if max(ends) > step or width * step > cloud.row_step or rows * cloud.row_step > len(cloud.data):
        raise InputError(f"{len(cloud.data)} bytes for {rows} x {width} points of {step}: the cloud is cut short.")
    data = np.frombuffer(cloud.data, dtype=np.uint8, count=rows * cloud.row_step).reshape(rows, cloud.row_step)
    data = np.ascontiguousarray(data[:, : width * step]).reshape(rows * width, step)

    def column(name: str) -> Array:
        kind = np.dtype(byte_order + _NUMBERS[fields[name].datatype])
        begin = fields[name].offset
        return np.ascontiguousarray(data[:, begin : begin + kind.itemsize]).view(kind)[:, 0].astype(np.float64)

    points = np.stack([column(name) for name in "xyz"], axis=1)
    return points, column("arc_length") if "arc_length" in fields else None


def file_of(found: Calibration | HarnessCalibration, file: HarnessFile | None = None) -> str:
    """What was found, as the file of a cable, or of a harness whose ends and markers are those of `file`."""
    if isinstance(found, Calibration):
        return found.yaml()
    assert file is not None
    held: Mapping[str, Any] = found.held(file.ends)
    told = replace(file, harness=found.harness, ends=held).as_dict()
    return found.yaml({key: told[key] for key in (ENDS, MARKERS) if told[key]})


def calibration_message(
    cable_id: str, found: Calibration | HarnessCalibration, observations: int, file: HarnessFile | None = None
) -> CableCalibration:
    """A result, without a stamp; file: of a harness, with its ends."""
    message = CableCalibration(cable_id=cable_id, observations=observations, converged=bool(found.converged))
    estimates = found.estimates
    message.names, message.units = [e.name for e in estimates], [e.unit for e in estimates]
    for name, field in (("values", "value"), ("standard_errors", "standard_error"), ("lows", "low"), ("highs", "high")):
        setattr(message, name, array.array("d", [float(getattr(e, field)) for e in estimates]))
    message.correlation = array.array("d", np.ascontiguousarray(found.correlation).tobytes())
    seen = np.isfinite(found.distances)
    message.points = int(seen.sum())
    message.mean_miss = float(found.distances[seen].mean()) if seen.any() else float("nan")
    message.stray = int((found.weights[seen] <= STRAY).sum())
    message.remarks = list(found.remarks)
    message.cable = file_of(found, file)
    if found.covariance is not None and np.isfinite(found.covariance).all():
        message.uncertainty = Uncertainty.of(found).yaml()
    return message
