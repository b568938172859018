"""Where observations come from: a recording, a NumPy file or a table."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cable_shape.calibration.observation import Observation
from cable_shape.calibration.tables import load_arrays, number_in, rows_of
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError, BagError, FileError, UnknownKeyError
from cable_shape.files.files import path_of
from cable_shape.pose import Grip, Pose

#: Frames taken from one recording, evenly spread.
FRAMES = 50
_KEYS = ("start", "end", "points", "arc_length", "acceleration", "velocity", "group", "time")
_COLUMNS = ("observation", "what", "x", "y", "z", "qx", "qy", "qz", "qw", "arc_length")
_MAX_SKEW = 20_000_000  # ns
#: [s], of markers that a cubic goes through whose second derivative is their acceleration.
SMOOTHED = 0.11
#: [ns], frames in it are one group.
_TOGETHER = 1_000_000_000
#: Rows of the table of accelerations.
_ROWS = 21


def load_observations(
    path: str | Path, kinds: tuple[str, str] = ("clamped", "clamped"), **bag: Any
) -> list[Observation]:
    """Observations from a file, by its kind.

    - NPZ: `start`, `end` (n, 7) poses x y z qx qy qz qw; `points` (n, m, 3), NaN where there is none; optional
      `arc_length` (m,) or (n, m), `acceleration` (n, k, 3) and, beside it, `velocity` (n, k, 3), `group` (n,),
      `time` (n,) [s].
    - CSV with a header: `observation` (a number), `what` (start, end or point), `x`, `y`, `z`, for start and end `qx`,
      `qy`, `qz`, `qw`, for points `arc_length` where it is known.
    - a rosbag2 folder, .mcap or .db3: see :func:`from_bag`, which takes the keywords `bag`.

    kinds: how start and end are held, see :class:`cable_shape.Grip`.
    """
    file = path_of(path)
    if file.suffix == ".npz":
        return from_arrays(load_arrays(file), kinds, str(file))
    if file.suffix == ".csv":
        return _from_csv(file, kinds)
    if not file.exists():
        raise FileError(f"{file}: no such file. Check the path; it is taken from {Path.cwd()}.")
    return from_bag(file, kinds, **bag)


def from_arrays(arrays: Mapping[str, Array], kinds: tuple[str, str], where: str = "arrays") -> list[Observation]:
    """See NPZ in :func:`load_observations`."""
    for key in arrays:
        if key not in _KEYS:
            raise UnknownKeyError.among(where, key, _KEYS)
    for key in _KEYS[:3]:
        if key not in arrays:
            raise ArgumentError(f"{where}: {key} is missing. It needs start (n, 7), end (n, 7) and points (n, m, 3).")
    given = {key: np.asarray(array, dtype=np.float64) for key, array in arrays.items()}
    points = given["points"]
    if points.ndim != 3:
        raise ArgumentError.of(f"{where}: points", f"shape {points.shape}", "it must be (n, m, 3)", "Pad with NaN.")
    count, each = points.shape[:2]
    acceleration, group, arc = (given.get(key) for key in ("acceleration", "group", "arc_length"))
    if "velocity" in given and acceleration is None:
        raise ArgumentError(f"{where}: velocity is not allowed without acceleration. Give both.")
    if arc is not None and arc.shape == (each,):
        arc = np.broadcast_to(arc, (count, each))
    rows = 1 if acceleration is None or acceleration.ndim != 3 else acceleration.shape[1]
    wanted = {"start": (count, 7), "end": (count, 7), "points": (count, each, 3), "group": (count,)}
    wanted["time"] = (count,)
    wanted |= {"acceleration": (count, rows, 3), "velocity": (count, rows, 3), "arc_length": (count, each)}
    for key, array in {**given, **({} if arc is None else {"arc_length": arc})}.items():
        if array.shape != wanted[key]:
            raise ArgumentError.of(f"{where}: {key}", f"shape {array.shape}", f"it must be {wanted[key]}", "")
    if acceleration is not None and "velocity" in given:
        acceleration = np.concatenate((acceleration, given["velocity"]), axis=2)
    if group is not None and not (np.isfinite(group).all() and (group == np.round(group)).all()):
        raise ArgumentError.of(f"{where}: group", group.tolist(), "it must be whole numbers", "Number the recordings.")
    return [
        Observation(
            Grip(Pose(given["start"][i, :3], given["start"][i, 3:]), kinds[0]),
            Grip(Pose(given["end"][i, :3], given["end"][i, 3:]), kinds[1]),
            points[i],
            None if arc is None else arc[i],
            None if acceleration is None else acceleration[i],
            None if group is None else int(group[i]),
            time=float(given["time"][i]) if "time" in given else None,
        )
        for i in range(count)
    ]


def load_points(path: str | Path) -> Array:
    """(m, 3) [m] of a CSV with the columns x, y, z, in their order along the cable."""
    keys = ("x", "y", "z")
    rows = [[number_in(row, key, f"{path}, line {line}") for key in keys] for line, row in rows_of(path, keys)]
    return np.array(rows).reshape(-1, 3)


def _from_csv(file: Path, kinds: tuple[str, str]) -> list[Observation]:
    poses: dict[tuple[str, str], Pose] = {}
    points: dict[str, list[list[float]]] = {}
    for line, row in rows_of(file, _COLUMNS[:5], _COLUMNS):
        where = f"{file}, line {line}"
        which, what = row["observation"], row.get("what", "")
        place = [number_in(row, key, where) for key in ("x", "y", "z")]
        try:
            if what == "point":
                arc = number_in(row, "arc_length", where) if row.get("arc_length") else math.nan
                points.setdefault(which, []).append([*place, arc])
            elif what in ("start", "end"):
                poses[which, what] = Pose(place, [number_in(row, key, where) for key in ("qx", "qy", "qz", "qw")])
            else:
                raise ArgumentError.of("what", what, "it must be start, end or point", "")
        except FileError:
            raise
        except ArgumentError as error:
            raise ArgumentError(f"{where}: {error}") from None
    out = []
    for which, seen in points.items():
        for what in ("start", "end"):
            if (which, what) not in poses:
                raise ArgumentError(f"{file}: observation {which} has no line for its {what}. Add its pose.")
        a = np.array(seen)
        start, end = Grip(poses[which, "start"], kinds[0]), Grip(poses[which, "end"], kinds[1])
        out.append(Observation(start, end, a[:, :3], a[:, 3]))
    return out


def from_bag(
    path: str | Path,
    kinds: tuple[str, str] = ("clamped", "swivel"),
    *,
    left_topic: str = "/left_gripper/pose",
    right_topic: str = "/right_gripper/pose",
    markers_topic: str = "/cable/markers",
    frames: int = FRAMES,
    inertia: bool = False,
    group: int | None = None,
    motion: bool = False,
) -> list[Observation]:
    """Evenly spread frames of a recording of gripper poses (PoseStamped) and markers on the cable (PoseArray).

    Markers come in their order along the cable, the first and the last at the grips. Frames of one second are a group,
    unless `group` is given: so soon a cable does not hang much otherwise, and they share what the model does not know.
    motion: all frames, with their times; one group.
    inertia: accelerations and velocities of the markers, differences of what was recorded (smoothed over 0.11 s at
    100 Hz), load the cable.
    """
    left, right, markers = tracked(path, left_topic, right_topic, markers_topic)
    seen = [i for i in range(len(left)) if left[i] is not None and right[i] is not None]
    if not seen:
        raise BagError(f"{path}: no markers within {_MAX_SKEW * 1e-6:g} ms of both grippers' poses.")
    moving = motions(markers) if inertia else None
    if motion:
        frames, group = len(seen), group or 0
    chosen = [seen[i] for i in np.unique(np.linspace(0, len(seen) - 1, frames).round().astype(int))]
    return [
        Observation(
            Grip(Pose(left[i][:3], left[i][3:]), kinds[0]),
            Grip(Pose(right[i][:3], right[i][3:]), kinds[1]),
            markers[i][1][1:-1],
            acceleration=None if moving is None else moving[i],
            group=max(0, markers[i][0] // _TOGETHER) if group is None else group,
            time=1e-9 * (markers[i][0] - markers[0][0]) if motion else None,
        )
        for i in chosen
        if moving is None or np.isfinite(moving[i]).all()
    ]


def tracked(
    path: str | Path, left_topic: str, right_topic: str, markers_topic: str
) -> tuple[list[Array | None], list[Array | None], list[tuple[int, Array]]]:
    """Of each frame of markers in a recording the poses (7,) of both grippers, None where there is none near enough in
    time, and its stamp [ns] with the markers (m, 3) [m]."""
    from cable_shape.replay.bags import Bag
    from cable_shape.replay.inputs import positions_of, stamp_of

    tracks: dict[str, list[tuple[int, Array]]] = {left_topic: [], right_topic: [], markers_topic: []}
    with Bag(path) as bag:
        for topic, _, message in bag.messages(tuple(tracks)):
            if topic == markers_topic:
                tracks[topic].append((stamp_of(message), positions_of(message.poses)))
            else:
                p, q = message.pose.position, message.pose.orientation
                tracks[topic].append((stamp_of(message), np.array((p.x, p.y, p.z, q.x, q.y, q.z, q.w))))
    for topic, track in tracks.items():
        if not track:
            raise BagError(f"{path}: there is no message of {topic}. Name the topics, or record them.")
    markers = tracks[markers_topic]
    return _at(tracks[left_topic], markers), _at(tracks[right_topic], markers), markers


def _at(track: list[tuple[int, Array]], markers: list[tuple[int, Array]]) -> list[Any]:
    """Of a track, what is nearest in time to each frame of markers; None beyond the largest skew."""
    stamps = np.array([stamp for stamp, _ in track])
    out: list[Array | None] = []
    for stamp, _ in markers:
        nearest = int(np.abs(stamps - stamp).argmin())
        out.append(track[nearest][1] if abs(int(stamps[nearest]) - stamp) <= _MAX_SKEW else None)
    return out


def motions(markers: Sequence[tuple[int, Array]], along: Array | None = None) -> Array:
    """(n, rows, 6), accelerations [m/s^2] and velocities [m/s], world, uniform along the cable, from frames of markers:
    a stamp [ns] and (m, 3) [m] each.

    Derivatives of cubics through 0.11 s of what was recorded; between the markers accelerations are linear, velocities
    cubic (of less than four markers: linear). NaN where in that time a marker was lost (NaN), or a frame is missing.
    along: (m,), at which share of the length markers are, rising; default: as far apart as they are seen, the first and
    the last at the ends.

    Raises
    ------
    BagError
        For fewer frames than that, or numbers of markers that differ.
    """
    from scipy.interpolate import make_interp_spline
    from scipy.signal import savgol_filter

    stamps = np.array([stamp - markers[0][0] for stamp, _ in markers]) * 1e-9
    period = float(np.median(np.diff(stamps))) if len(stamps) > 1 else 0.0
    window = max(5, 2 * round(0.5 * SMOOTHED / period) + 1) if period > 0.0 else 0
    if window == 0 or len(markers) < window or len({track.shape for _, track in markers}) > 1:
        raise BagError("inertia needs frames of one number of markers, evenly recorded, for 0.11 s at least.")
    places = np.array([track for _, track in markers])
    if places.shape[1] < 2 and along is None:
        raise BagError("inertia needs markers along the cable, the first and the last at the grips.")
    lost = ~np.isfinite(places).all(axis=(1, 2))
    uneven = np.abs(np.diff(stamps) - period) > 0.5 * period
    if along is None:
        arc = np.nancumsum(np.nanmedian(np.linalg.norm(np.diff(places, axis=1), axis=2), axis=0))
        along = np.concatenate(((0.0,), arc)) / arc[-1]
    places[lost] = 0.0
    faster, fast = (savgol_filter(places, window, 3, deriv=order, delta=period, axis=0) for order in (2, 1))
    rows = np.linspace(0.0, 1.0, _ROWS)
    out = np.full((len(markers), _ROWS, 6), np.nan)
    degree = 3 if len(along) > 3 else 1
    for i in range(len(markers)):
        first = min(max(i - window // 2, 0), len(markers) - window)  # at both ends one cubic serves several frames
        if lost[first : first + window].any() or uneven[first : first + window - 1].any():
            continue
        for axis in range(3):
            out[i, :, axis] = np.interp(rows, along, faster[i, :, axis])
        out[i, :, 3:] = make_interp_spline(along, fast[i], k=degree)(np.clip(rows, along[0], along[-1]))
    return out
