"""Real cables between two grippers, by motion capture: frames as observations, in parts by trajectory."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

import cable_shape as cs
from cable_shape.kernels.distance.misses import misses
from cable_shape.replay.observations import from_bag

DATA = Path(__file__).resolve().parents[2] / "shared" / "data"
CABLES = (1, 2, 3, 4, 5)
DENSITY = 0.05  # kg/m, not measured: only EI / weight shapes these cables
#: EI / weight [m^3] where the fits begin.
BEGIN = 1e-3
#: Rows of the tables of accelerations.
ROWS = 25


@dataclass(frozen=True)
class Frames:
    """Frames of one cable: `static` and `moving` observations (with accelerations and velocities), kind, trajectory and
    part of each.

    calm: largest rms acceleration [g] along a frame of kind "quasi"; recorded: trajectories of the two recordings.
    """

    cable: cs.Cable
    static: list[cs.Observation]
    moving: list[cs.Observation]
    kind: np.ndarray
    traj: np.ndarray
    part: np.ndarray
    calm: float
    recorded: tuple[int, ...]

    def where(self, kinds: tuple[str, ...], part: int, inside: bool) -> np.ndarray:
        """Indices of frames of these kinds, inside or outside of one part of the trajectories."""
        return np.flatnonzero(np.isin(self.kind, kinds) & ((self.part == part) == inside))


def load(number: int, parts: int, folder: Path = DATA) -> Frames:
    """Frames of cable 1 to 5; whole trajectories go into one of so many parts of about the same number of frames."""
    with np.load(folder / f"cable{number}_frames.npz", allow_pickle=False) as d:
        x, v, a, arc = (d[key].astype(np.float64) for key in ("frames", "vel", "acc", "arc"))
        kind, traj, length = d["kind"], d["traj"], float(d["free_length"])
        calm, recorded = float(d["q"][kind == "quasi"].max()), tuple(int(t) for t in d["replay_traj"])
    near, far = carried(x[:, 1] - x[:, 0]), carried(x[:, -1] - x[:, -2])
    at = np.clip(arc[1:-1] - arc[1], 0.0, length)
    rows = np.linspace(0.0, length, ROWS)
    static, moving = [], []
    for i in range(len(x)):
        start = cs.Grip(cs.Pose(x[i, 1], near[i]))
        end = cs.Grip(cs.Pose(x[i, -2], far[i]), kind="swivel")
        load = np.concatenate((CubicSpline(at, a[i, 1:-1])(rows), speeds(at, x[i], v[i])(rows)), axis=1)
        static.append(cs.Observation(start, end, x[i, 2:-2], group=int(traj[i])))
        moving.append(cs.Observation(start, end, x[i, 2:-2], acceleration=load, group=int(traj[i])))
    cable = cs.Cable(length=length, linear_density=DENSITY, bending_stiffness=BEGIN * DENSITY * 9.81)
    return Frames(cable, static, moving, kind, traj, shares(traj, parts), calm, recorded)


def speeds(at: np.ndarray, x: np.ndarray, v: np.ndarray) -> CubicSpline:
    """Velocity along the cable from those of all markers (m, 3), the inner ones at arc lengths `at` (m - 2,); its slope
    at the ends is how fast the directions of the grips change, from the two markers in each."""
    slopes = [(v[j] - v[i]) / np.linalg.norm(x[j] - x[i]) for i, j in ((0, 1), (-2, -1))]
    return CubicSpline(at, v[1:-1], bc_type=((1, slopes[0]), (1, slopes[1])))


def recording(
    number: int, which: int, calm: float, folder: Path = DATA
) -> tuple[list[cs.Observation], list[cs.Observation]]:
    """The frames of a recording that accelerate along the cable by no more than `calm` [g, rms]: static, moving."""
    seen = from_bag(folder / f"cable{number}_recording{which}", frames=500, inertia=True)
    moving = [o for o in seen if np.sqrt((o.acceleration[1:-1, :3] ** 2).sum(axis=1).mean()) <= calm * 9.81]  # type: ignore[index]
    return [cs.Observation(o.start, o.end, o.points) for o in moving], moving


def distances(shape: cs.CableShape, points: np.ndarray) -> np.ndarray:
    """(m,) [m], of points to the closest point of a centreline; NaN without a usable shape."""
    out = np.full(points.shape, np.nan)
    if shape.status:
        misses(shape.buffer, shape.points, points, np.full(len(points), math.nan), out)
    return np.linalg.norm(out, axis=1)


def carried(tangents: np.ndarray, about: np.ndarray | None = None) -> np.ndarray:
    """(n, 4): frames with these third axes (n, 3), turned the shortest way from one on the mean tangent, or of `about`.

    The roll of the grippers was not measured; gripping tools that turn about as little as they can have these frames.
    """
    t = tangents / np.linalg.norm(tangents, axis=1)[:, None]
    like = t if about is None else about / np.linalg.norm(about, axis=1)[:, None]
    mean = like.mean(axis=0) / np.linalg.norm(like.mean(axis=0))
    level = np.cross((0.0, 0.0, 1.0), mean)
    level /= np.linalg.norm(level)
    middle = Rotation.from_matrix(np.stack((level, np.cross(mean, level), mean), axis=1))
    axes = np.cross(mean, t)
    sines = np.linalg.norm(axes, axis=1)
    angles = np.arctan2(sines, t @ mean)
    turns = Rotation.from_rotvec(axes * (angles / np.maximum(sines, 1e-12))[:, None])
    return (turns * middle).as_quat()


def shares(traj: np.ndarray, parts: int) -> np.ndarray:
    """(n,) part of each frame: trajectories, the longest first, each to the smallest part."""
    numbers, counts = np.unique(traj, return_counts=True)
    sizes, part_of = np.zeros(parts), {}
    for k in np.argsort(-counts, kind="stable"):
        smallest = int(np.argmin(sizes))
        part_of[numbers[k]] = smallest
        sizes[smallest] += counts[k]
    return np.array([part_of[t] for t in traj])
