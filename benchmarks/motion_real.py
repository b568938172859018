"""Real cables that were thrown about: DEFORM's measure on recordings that a fit has not seen."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from figures import Figures, heading
from scipy.spatial.transform import Rotation
from tqdm import tqdm

import cable_shape as cs
from cable_shape.calibration.motion_fit import calibrate_motion
from cable_shape.calibration.motion_forward import MotionForward, recordings_of
from cable_shape.motion.common import enough
from cable_shape.motion.run import STEP

TRAIN = Path(__file__).resolve().parents[2] / "shared" / "data" / "motion"
DENSITY = 0.05  # kg/m, not measured: only EI / weight and what slows it shape these cables
BEGIN = 1e-3  # m^3, EI / weight where fits begin
RATE = 100.0  # Hz
EIGHT = (
    "bending_stiffness", "twisting_stiffness", "retardation_time", "drag", "length", "start_pitch", "end_pitch", "roll",
)  # fmt: skip
ALL = (*EIGHT[:5], "start_tilt", "end_tilt", "roll", "start_offset", "end_offset", "rest_curvature_along")
SUPPORTS = 3
PRIORS = {
    "length": 0.01, "start_pitch": 0.3, "end_pitch": 0.3, "start_tilt": 0.3, "end_tilt": 0.3, "start_offset": 0.01,
    "end_offset": 0.01,
}  # fmt: skip
#: Frames are lost where all markers of the grips go more than so many times as far as before and after it, and at most
#: by so much of that aside, if they move by this [m] a frame at least.
LOST, ASIDE, STILL = 1.5, 0.5, 3e-4
#: Mean over 5 s [mm] that is asked of cables 1 to 5 with eight numbers, and with all.
ASKED = {"eight": (11.0, 5.5, 6.0, 6.0, 6.5), "all": (10.5, 5.0, 5.0, 5.0, 6.0)}
FINER = 0.3  #: [mm], by how much these change on a mesh twice as fine, in steps half as long
#: Parts of the recordings, each held back once, where there are no others to judge.
PARTS = 2


class Seen(NamedTuple):
    """Recordings of one cable: markers (n, T, m, 3) [m], and their arc length (m,) [m]."""

    markers: np.ndarray
    arc: np.ndarray


class Frames(NamedTuple):
    """Directions about which grips turn as little as they can: of start and end, and across both, level."""

    start: np.ndarray
    end: np.ndarray
    level: np.ndarray


def load(folder: Path, number: int) -> Seen:
    """Of cableK_motion.npz."""
    with np.load(folder / f"cable{number}_motion.npz", allow_pickle=False) as d:
        return Seen(d["markers"].astype(np.float64), d["arc"].astype(np.float64))


def unit(v: np.ndarray) -> np.ndarray:
    """Of length 1."""
    return np.asarray(v / np.linalg.norm(v, axis=-1, keepdims=True))


def frames_of(seen: Seen) -> Frames:
    """From all recordings of a cable."""
    x = seen.markers
    ends = (unit(x[:, :, 1] - x[:, :, 0]), unit(x[:, :, -1] - x[:, :, -2]))
    chord = (x[:, :, -2] - x[:, :, 1]).mean(axis=(0, 1))
    return Frames(*(unit(t.mean(axis=(0, 1))) for t in ends), unit(np.cross((0.0, 0.0, 1.0), chord)))


def turned(tangents: np.ndarray, mean: np.ndarray, level: np.ndarray) -> np.ndarray:
    """(..., 4): frames with these third axes, turned the shortest way from that on the mean whose first is level.

    The roll of the grippers was not measured: so they would turn if they did not roll.
    """
    across = unit(level - (level @ mean) * mean)
    middle = Rotation.from_matrix(np.stack((across, np.cross(mean, across), mean), axis=1))
    t = unit(tangents).reshape(-1, 3)
    axes = np.cross(mean, t)
    sines = np.linalg.norm(axes, axis=1)
    turns = Rotation.from_rotvec(axes * (np.arctan2(sines, t @ mean) / np.maximum(sines, 1e-12))[:, None])
    return (turns * middle).as_quat().reshape(*tangents.shape[:-1], 4)


def times_of(grips: np.ndarray) -> np.ndarray:
    """(T,) [s] of frames with these markers (T, 4, 3) [m] in both grips.

    Frames are lost in some recordings: between two that follow each other all markers go as far as otherwise in two,
    three or twelve. Where the grips do that, as they move before and after it, they took as long.
    """
    ways = np.diff(grips, axis=0).reshape(len(grips) - 1, -1)
    lost = np.ones(len(ways))
    for i in range(1, len(ways) - 1):
        near = 0.5 * (ways[i - 1] + ways[i + 1])
        size = float(near @ near)
        if size < len(near) / 3.0 * STILL**2:
            continue
        times = float(ways[i] @ near) / size
        whole, fastest = np.linalg.norm(ways[i]), max(np.linalg.norm(ways[i - 1]), np.linalg.norm(ways[i + 1]))
        if whole > LOST * fastest and np.linalg.norm(ways[i] - times * near) < ASIDE * whole:
            lost[i] = max(1, round(times))
    return np.concatenate(((0.0,), np.cumsum(lost))) / RATE


def looks(seen: Seen, frames: Frames, which: np.ndarray) -> list[cs.Observation]:
    """Every frame of these recordings."""
    at, out = seen.arc[2:-2] - seen.arc[1], []
    for k in which.tolist():
        x = seen.markers[k]
        start = turned(x[:, 1] - x[:, 0], frames.start, frames.level)
        end = turned(x[:, -1] - x[:, -2], frames.end, frames.level)
        times = times_of(x[:, [0, 1, -2, -1]])
        out += [
            cs.Observation(cs.Pose(r[1], start[i]), cs.Pose(r[-2], end[i]), r[2:-2], at, group=k, time=times[i])
            for i, r in enumerate(x)
        ]
    return out


class Mesh(NamedTuple):
    """The longest step in time [s], and how many elements; None: as many as it takes."""

    longest: float = STEP
    elements: int | None = None


USUAL = Mesh()


def misses(found: cs.Calibration, seen: list[cs.Observation], markers: int, mesh: Mesh = USUAL) -> np.ndarray:
    """(recordings, T - 2) [mm]: mean |difference| over x, y, z and all markers, the four given ones with none."""
    assert found.parameters is not None
    assert found.values is not None
    recordings = recordings_of(seen, mesh.longest)
    each = np.abs(MotionForward(found.parameters, recordings, elements=mesh.elements).misses(found.values))
    assert np.isfinite(each).all(), "a recording does not begin"
    return 1e3 * each.reshape(len(recordings), -1, (markers - 4) * 3).sum(axis=2) / (3 * markers)


def judged(
    number: int, folder: Path, train: Path, names: tuple[str, ...], mesh: Mesh = USUAL
) -> tuple[np.ndarray, list[cs.Calibration]]:
    """Misses of all recordings in a folder by fits to recordings in `train` that are not the same, and these fits."""
    judge = load(folder, number)
    learn = load(train, number) if (train / f"cable{number}_motion.npz").is_file() else judge
    frames = frames_of(learn)
    length = float(learn.arc[-2] - learn.arc[1])
    cable = cs.Cable(
        length,
        DENSITY,
        BEGIN * DENSITY * 9.81,
        retardation_time=0.1,
        drag=0.01,
        twisting_stiffness=5e-4 * DENSITY * 9.81,
    )
    same = np.array([[np.array_equal(a[0], b[0]) for b in learn.markers] for a in judge.markers])
    count = len(judge.markers)
    parts = np.arange(count) % PARTS if same.any() else np.zeros(count, dtype=np.int64)
    out, fits = np.zeros((count, judge.markers.shape[1] - 2)), []
    for part in tqdm(np.unique(parts).tolist(), desc=f"cable {number}", leave=False, disable=None):
        held = np.flatnonzero(parts == part)
        others = np.flatnonzero(~same[held].any(axis=0))
        priors = {name: PRIORS[name] for name in names if name in PRIORS}
        known = looks(learn, frames, others)
        fits.append(calibrate_motion(known, cable, names, priors=priors, supports=SUPPORTS, **mesh._asdict()))
        out[held] = misses(fits[-1], looks(judge, frames, held), judge.markers.shape[2], mesh)
    return out, fits


def twice(number: int, train: Path, fitted: cs.Calibration) -> Mesh:
    """A mesh twice as fine as that of a fit, and steps half as long."""
    seen = load(train, number)
    first = looks(seen, frames_of(seen), np.arange(1))[0]
    shape = cs.predict(fitted.cable, first.start, first.end, model="cosserat")
    return Mesh(0.5 * STEP, 2 * enough(shape, fitted.cable))


def measure_real(
    figures: Figures, folder: Path, train: Path, numbers: list[int], every: bool, finer: bool = False
) -> None:
    """The table of docs/accuracy.md; finer: each again on a mesh twice as fine, fitted on its own."""
    what, names = ("all", ALL) if every else ("eight", EIGHT)
    heading(f"Real cables in fast motion, {what} numbers: held-back recordings, open loop over 5 s, DEFORM's measure")
    print(
        "| cable | recordings | mean [mm] | median | first second | EI / weight [m^3] | retardation [s] | free [mm] |"
    )
    print("| --- | --- | --- | --- | --- | --- | --- | --- |")
    for number in numbers:
        each, fits = judged(number, folder, train, names)
        means, first = each.mean(axis=1), each[:, : round(RATE)].mean()
        error = means.std(ddof=1) / np.sqrt(len(means))
        stiff = fits[0].cable.mean_bending_stiffness / (DENSITY * 9.81)
        print(
            f"| {number} | {len(means)} | {means.mean():.1f} ± {error:.1f} | {np.median(means):.1f} | {first:.1f} | "
            f"{stiff:.2g} | {fits[0].cable.retardation_time:.3f} | {1e3 * fits[0].cable.length:.1f} |",
            flush=True,
        )
        if finer:
            mesh = twice(number, train, fits[0])
            there = judged(number, folder, train, names, mesh)[0].mean()
            told = f"cable {number}, {what} numbers: {there:.2f} mm with {mesh.elements} elements, changed by"
            figures.at_most(told, abs(float(there - means.mean())), FINER, "{:.2f}", " mm")
        asked = ASKED[what][number - 1]
        figures.at_most(f"cable {number}, {what} numbers: mean over 5 s", float(means.mean()), asked, "{:.1f}", " mm")
