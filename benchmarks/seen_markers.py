"""Markers of real cables, a stretch of them hidden: how near the tracker has the hidden ones, and inside its tube."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from bench_truth import HELPS, PRIORS
from figures import Figures, heading
from seen_drift import Drift
from tqdm import tqdm
from truth_data import DATA, distances, load
from truth_options import held_as
from truth_tubes import as_fitted

import cable_shape as cs
from cable_shape.calibration.parameters import held
from cable_shape.replay.observations import from_bag

#: Share of the inner markers hidden in one stretch -> mean distance asked of them, % of the length.
ASKED = {0.3: 0.8, 0.5: 1.0, 0.7: 1.8}
INSIDE = (90.0, 99.0)  # %, in the 95 % tube
RATE = 100.0  # Hz
MISSES, NOISE = 0.012, 0.012  # of the length; m, chosen of 6, 10, 12 and 15 mm on parts of these very recordings
GONE, BACK = 1.0, 0.2  # s, for which all markers are hidden, and after which the cable has to be where it is again
NEAR = 2.0  # %, what counts as that, of the visible markers


class Followed(NamedTuple):
    """Of the hidden markers (frames, hidden): distance from the shape, and the tube's radius there, % of the length;
    distance of the same by coherent point drift."""

    off: np.ndarray
    radius: np.ndarray
    drift: np.ndarray


class Known(NamedTuple):
    """A cable that other trajectories than the recordings' were fitted to, and its grips' corrections."""

    cable: cs.Cable
    offsets: dict[str, cs.Pose | None]


def calibrated(number: int, folder: Path, every: int) -> Known:
    """From every so many frames of the trajectories that were not recorded."""
    frames = load(number, 3, folder)
    learn = np.flatnonzero(~np.isin(frames.traj, frames.recorded))[::every]
    seen = [held_as(frames.moving[i], "swivel") for i in learn]
    one = cs.calibrate(seen, frames.cable, progress=False).cable.replace(retardation_time=0.05, drag=0.01)
    found = cs.calibrate(seen, one, HELPS, priors=PRIORS, supports=9, progress=False)
    assert found.parameters is not None
    assert found.values is not None
    offsets = {side: found.parameters.offset(found.values, side) for side in ("start", "end")}
    return Known(found.cable, offsets)


def tracker_of(known: Known) -> cs.Tracker:
    """With what is left open of a calibrated cable, and of markers that stand off it."""
    length = known.cable.length
    spread = {"bending_stiffness": 0.3, "length": 0.003 * length}
    left = cs.Uncertainty(spread, (0.002, 0.05), (0.002, 0.05), misses=MISSES * length)
    return cs.Tracker(known.cable, uncertainty=left, noise=NOISE)


def recorded(number: int, which: int, folder: Path, known: Known) -> list[cs.Observation]:
    """The frames of a recording, their grips as the calibration found them."""
    seen = as_fitted(number, from_bag(folder / f"cable{number}_recording{which}", frames=500))
    out = []
    for one in (held_as(o, "swivel") for o in seen):
        start, end = held(one.start, known.offsets["start"]), held(one.end, known.offsets["end"])
        out.append(cs.Observation(start, end, one.points))
    return out


def followed(known: Known, seen: list[cs.Observation], share: float, seed: int, every: int) -> Followed:
    """Every so many frames of a recording, this share of the inner markers hidden, the same stretch all the time."""
    rng = np.random.default_rng(seed)
    count = len(seen[0].points)
    gone = round(share * count)
    first = rng.integers(0, count - gone + 1)
    hidden = (np.arange(count) >= first) & (np.arange(count) < first + gone)
    length = known.cable.length
    tracker, drift = tracker_of(known), Drift()
    off, radius, other = [], [], []
    for i in range(0, len(seen), every):
        look, points = seen[i], seen[i].points
        shape = tracker.update(points[~hidden], stamp=round(1e9 * i / RATE), start=look.start, end=look.end)
        line = drift.update(points[~hidden], shape.positions if i == 0 else None, look.start, look.end)
        nearest = np.linalg.norm(shape.positions[:, None] - points[hidden], axis=2).argmin(axis=0)
        off.append(distances(shape, points[hidden]))
        radius.append(tracker.tube.radius[nearest])
        other.append(np.linalg.norm(line[:, None] - points[hidden], axis=2).min(axis=0))
    return Followed(*(100.0 / length * np.array(one) for one in (off, radius, other)))


def back_after(known: Known, seen: list[cs.Observation]) -> float:
    """[s] until the shape is back at the markers, after GONE without any, in the worst of several places."""
    times = []
    for begin in range(50, len(seen) - 150, 100):
        tracker = tracker_of(known)
        stop = begin + round(RATE * GONE)
        waited = np.inf
        for i in range(begin - 50, stop + 50):
            look = seen[i]
            points = look.points if not begin <= i < stop else np.empty((0, 3))
            shape = tracker.update(points, stamp=round(1e9 * i / RATE), start=look.start, end=look.end)
            if i >= stop and 100.0 * distances(shape, look.points).mean() / known.cable.length < NEAR:
                waited = (i - stop) / RATE
                break
        times.append(waited)
    return max(times)


def print_markers(figures: Figures, numbers: list[int], folder: Path = DATA, quick: bool = False) -> None:
    """One row a cable, all recordings of it, and the means over the cables."""
    heading(
        "Real markers, a stretch of the inner ones hidden: mean distance of the hidden ones, % of the length; inside"
    )
    found: dict[float, list[Followed]] = {share: [] for share in ASKED}
    back = []
    for number in tqdm(numbers, desc="markers", unit="cable", leave=False, disable=None):
        known = calibrated(number, folder, 4 if quick else 2)
        here: dict[float, list[Followed]] = {share: [] for share in ASKED}
        for which in (0,) if quick else (0, 1):
            seen = recorded(number, which, folder, known)
            for share in ASKED:
                for seed in range(1 if quick else 3):
                    here[share].append(followed(known, seen, share, seed, 2 if quick else 1))
            back.append(back_after(known, seen))
        told = [
            f"{int(100 * share)} %: {_mean(some, 0):.2f} ({_inside(some):.1f} % in, drift {_mean(some, 2):.2f})"
            for share, some in here.items()
        ]
        print(f"cable{number}: {'; '.join(told)}; back after {max(back):.2f} s", flush=True)
        for share, some in here.items():
            found[share] += some
    for share, asked in ASKED.items():
        name = f"real markers, {int(100 * share)} % hidden"
        figures.at_most(f"{name}: mean distance", _mean(found[share], 0), asked, "{:.2f}", " %")
        figures.at_least(f"{name}: in the 95 % tube", _inside(found[share]), INSIDE[0], "{:.1f}", " %")
        figures.at_most(f"{name}: in the 95 % tube", _inside(found[share]), INSIDE[1], "{:.1f}", " %")
        figures.ratio(f"{name}: error of coherent point drift / this", _mean(found[share], 2) / _mean(found[share], 0))
    figures.at_most("real markers, all hidden for a second: back after", max(back), BACK, "{:.2f}", " s")


def _mean(some: list[Followed], which: int) -> float:
    """Over all hidden markers."""
    return float(np.concatenate([one[which].ravel() for one in some]).mean())


def _inside(some: list[Followed]) -> float:
    """% of the hidden markers in the tube."""
    return 100.0 * float(np.concatenate([(one.off <= one.radius).ravel() for one in some]).mean())
