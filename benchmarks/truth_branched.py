"""Predictions of real branched cables, judged on trajectories that were not fitted: the table of `truth --branched`."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from branched_data import DENSITY, Branched, load, objects
from branched_recordings import recorded
from clocks import clocked
from figures import Figures, heading
from tqdm import tqdm
from truth_limits import mean_error

import cable_shape as cs

PARTS = 3
#: A fit ends after so many iterations, converged or not: what is left then are combinations that the data hardly see.
ITERATIONS = 15
CALM, FASTER = ("still", "calm"), ("moderate",)
STRAIGHT, ONE, ONE_MOVING = "straight lines", "EI/w, static", "EI/w, inertial load"
ALL, ALL_MOVING = "calibrated, static", "calibrated, inertial load"
FAST_STRAIGHT, FAST, FAST_MOVING = (
    "moderate: straight",
    "moderate: calibrated, static",
    "moderate: calibrated, inertial",
)
DAY_ONE, DAY_ALL, DAY_OWN = (
    f"other days: {what}" for what in ("the same EI/w", "the same calibration", "calibrated there")
)
ROLLED = "EI/w and the roll of each grip, static"
ALL_ROLLED, ALL_ROLLED_MOVING = (f"calibrated, and the roll of each grip, {how}" for how in ("static", "inertial load"))
WHOLE_STRAIGHT, WHOLE, WHOLE_MOVING = (
    f"calm frames of whole recordings: {what}" for what in ("straight", "EI/w, static", "EI/w, inertial")
)
#: Rolls [rad] from which fits of the grips' begin.
ROLLS = (0.0, 2.1, -2.1)
#: Figures that come with the data, of an independent rod tree on frames that do not: calibrated with inertial load on
#: calm frames, of bdlo2 on moderate ones, and by how much on average they are to be bettered.
TOLD = {"bdlo1": 1.7, "bdlo2": 2.9, "bdlo3": 2.0, "bdlo4": 1.9, "bdlo5": 1.4, "bdlo1_mid": 2.8, "bdlo3_mid": 5.2}
WITHIN, BETTER = 0.15, 0.2
#: Standard deviations about where a fit begins, of stiffness and weight as a fraction. They are narrower than is known
#: of a cable: what the model lacks is common to neighbouring points and to frames alike, 1300 points say no more than
#: some 30 that were independent.
PRIORS = {
    "bending_stiffness": 0.7,
    "twisting_stiffness": 0.5,
    "linear_density": 0.3,
    "rest_curvature": 1.0,
    "tilt": 0.04,
}
PARENT_BEND, BRANCH_TILT, ROLL = 0.4, 0.2, 0.5  # 1/m, rad, rad


def fit_of(frames: Branched) -> tuple[list[str], dict[str, float]]:
    """What is calibrated, and priors: EI, GJ and rest curvature of the parent, EI, weight and rest curvature of every
    child, how it leaves its junction, and the tilts of the grips."""
    children = frames.runs[1:]
    grips = [f"tilt:{end}" for end in frames.static[0].ends]
    branches = [f"tilt:{end}" for end in frames.branches]
    fit = [f"bending_stiffness:{frames.trunk}", f"twisting_stiffness:{frames.trunk}", f"rest_curvature:{frames.trunk}"]
    fit += [f"{kind}:{run}" for kind in ("bending_stiffness", "linear_density", "rest_curvature") for run in children]
    own = {f"rest_curvature:{frames.trunk}": PARENT_BEND, **dict.fromkeys(branches, BRANCH_TILT)}
    return [*fit, *branches, *grips], PRIORS | own


def calibrated(frames: Branched, learn: np.ndarray) -> tuple[cs.HarnessCalibration, cs.HarnessCalibration]:
    """EI/w alone, and all of `fit_of` from there, fitted to static frames."""
    seen = [frames.static[i] for i in learn]
    one = cs.calibrate(seen, frames.measured(learn))
    fit, priors = fit_of(frames)
    return one, cs.calibrate(seen, one.harness, fit, priors=priors, proceed=lambda i, _: i <= ITERATIONS)


def turned(seen: cs.HarnessObservation, roll: float) -> cs.HarnessObservation:
    """The same in grips that hold the roll: that of tools which turn as little as they can, and so much more [rad]."""
    about = cs.Pose(quaternion=(0.0, 0.0, np.sin(0.5 * roll), np.cos(0.5 * roll)))
    ends = {end: cs.Grip(grip.pose, "clamped", about) for end, grip in seen.ends.items() if isinstance(grip, cs.Grip)}
    return held_by(seen, ends)


def held_by(seen: cs.HarnessObservation, ends: dict[str, Any]) -> cs.HarnessObservation:
    """The same with other grips."""
    return cs.HarnessObservation(
        ends, seen.points, acceleration=seen.acceleration, lengths=seen.lengths, scene=seen.scene, group=seen.group
    )


def rolled(one: cs.HarnessCalibration, learn: list[cs.HarnessObservation]) -> tuple[cs.HarnessCalibration, float]:
    """EI/w and one roll of each grip, and the roll that the grips had where this fit began."""
    fit = ["bending_stiffness", *(f"roll:{end}" for end in learn[0].ends)]
    fits = [
        (cs.calibrate([turned(x, r) for x in learn], one.harness, fit, proceed=lambda i, _: i <= ITERATIONS), r)
        for r in ROLLS
    ]
    return min(fits, key=lambda fit: fit[0].scale)


def calibrated_rolled(
    frames: Branched, learn: np.ndarray, held: cs.HarnessCalibration, roll: float
) -> tuple[cs.HarnessCalibration, Callable[[cs.HarnessObservation], cs.HarnessObservation]]:
    """All of `fit_of` and the rolls, from where `rolled` ended, and what holds an observation as there."""

    def as_there(seen: cs.HarnessObservation) -> cs.HarnessObservation:
        there = turned(seen, roll)
        return held_by(there, held.held(there.ends))

    fit, priors = fit_of(frames)
    fit += [f"roll:{end}" for end in frames.static[0].ends]
    seen = [as_there(frames.static[i]) for i in learn]
    found = cs.calibrate(seen, held.harness, fit, priors={**priors, "roll": ROLL}, proceed=lambda i, _: i <= ITERATIONS)
    return found, as_there


def off(found: cs.HarnessCalibration, seen: list[cs.HarnessObservation]) -> np.ndarray:
    """(n, 3) [m]: mean distance of all vertices of each observation, of the parent's, and of the children's."""
    rows = []
    for one in seen:
        parent, *children = found.distances_to(one).values()
        rows.append((np.concatenate((parent, *children)).mean(), parent.mean(), np.concatenate(children).mean()))
    return np.array(rows).reshape(-1, 3)


def straight(frames: Branched, which: np.ndarray) -> np.ndarray:
    """The same of straight lines."""
    points = [len(x) for x in frames.static[0].points.values()]
    both = frames.straight[which]
    total = (points[0] * both[:, 0] + sum(points[1:]) * both[:, 1]) / sum(points)
    return np.column_stack((total, both))


def whole(name: str, frames: Branched, folder: Path) -> dict[str, np.ndarray]:
    """Calm frames of the object's recordings, EI/w fitted to frames of other trajectories; empty without recordings."""
    found = recorded(name, folder)
    if found is None:
        return {}
    seen, inside = found
    learn = np.flatnonzero(np.isin(frames.kind, CALM) & ~frames.other_day & ~np.isin(frames.traj, inside))
    rows = {WHOLE_STRAIGHT: straight(seen, np.arange(len(seen.static)))}
    for row, own, those in ((WHOLE, frames.static, seen.static), (WHOLE_MOVING, frames.moving, seen.moving)):
        rows[row] = off(cs.calibrate([own[i] for i in learn], frames.measured(learn)), those)
    return rows


def judge(frames: Branched, quick: bool, folder: Path) -> dict[str, Any]:
    """All rows for one object: distances (n, 3) in % of the parent's length, of frames that were not fitted."""
    rows: dict[str, list[np.ndarray]] = {}
    order: list[np.ndarray] = []
    fits, times = [], []

    def put(row: str, values: np.ndarray) -> None:
        rows.setdefault(row, []).append(100.0 / frames.length * values)

    for part in range(1 if quick else PARTS):
        learn, held_back = frames.where(CALM, part, False), frames.where(CALM, part, True)
        seconds, (one, found) = clocked(lambda learn=learn: calibrated(frames, learn), time.process_time)
        moving = cs.calibrate([frames.moving[i] for i in learn], one.harness)
        fits.append((one, found))
        times.append(seconds)
        order.append(held_back)
        still, swung = ([seen[i] for i in held_back] for seen in (frames.static, frames.moving))
        put(STRAIGHT, straight(frames, held_back))
        for row, fit, seen in (
            (ONE, one, still),
            (ONE_MOVING, moving, swung),
            (ALL, found, still),
            (ALL_MOVING, found, swung),
        ):
            put(row, off(fit, seen))
        held, roll = rolled(one, [frames.static[i] for i in learn])
        put(ROLLED, off(held, [turned(x, roll) for x in still]))
        both, as_there = calibrated_rolled(frames, learn, held, roll)
        for row, seen in ((ALL_ROLLED, still), (ALL_ROLLED_MOVING, swung)):
            put(row, off(both, [as_there(x) for x in seen]))
        faster = frames.where(FASTER, part, True)
        put(FAST_STRAIGHT, straight(frames, faster))
        put(FAST, off(found, [frames.static[i] for i in faster]))
        put(FAST_MOVING, off(found, [frames.moving[i] for i in faster]))
    away = frames.elsewhere(CALM)
    if len(away):
        inside = away[frames.part[away] == 0]
        _, own = calibrated(frames, np.setdiff1d(away, inside))
        seen = [frames.static[i] for i in inside]
        for row, fit in ((DAY_ONE, fits[0][0]), (DAY_ALL, fits[0][1]), (DAY_OWN, own)):
            put(row, off(fit, seen))
    for row, values in whole(frames.name, frames, folder).items():
        put(row, values)
    which = np.concatenate(order)
    return {
        "rows": {row: np.concatenate(values) for row, values in rows.items()},
        "groups": frames.traj[which], "fits": fits, "times": times, "frames": frames,
    }  # fmt: skip


def branched(figures: Figures, quick: bool, folder: Path) -> dict[str, Any]:
    """The table of all objects in a folder."""
    heading("Real branched cables: mean distance of free vertices to their arm as predicted, % of the parent's length")
    print(
        f"total (parent, children); fitted on still and calm frames of other trajectories than judged, {PARTS} parts."
    )
    print("Swivels at both grips: roll was not measured. Calibrated: static, and judged with both loads.")
    done = {}
    for name in tqdm(objects(folder), desc="objects"):
        done[name] = judge(load(name, PARTS, folder), quick, folder)
        told = {row: np.nanmean(values, axis=0) for row, values in done[name]["rows"].items()}
        tqdm.write(f"{name}: " + "; ".join(f"{row} {_cell(mean)}" for row, mean in told.items()))
    table(done)
    for name, found in done.items():
        print(f"\n{name}, one part left out:\n{found['fits'][0][1].report()}")
    asked = {name: FAST_MOVING if name == "bdlo2" else ALL_MOVING for name in done}
    gains = []
    for name in (name for name in done if name in TOLD):
        mean = float(np.nanmean(done[name]["rows"][asked[name]][:, 0]))
        gains.append(TOLD[name] - mean)
        figures.at_most(f"{name}: {asked[name]}", mean, TOLD[name] + WITHIN, "{:.2f}", " %")
    if gains:
        figures.at_least("calibrated: better than was told, on average", float(np.mean(gains)), BETTER, "{:.2f}", " %")
    return {
        name: {row: np.nanmean(values, axis=0).tolist() for row, values in found["rows"].items()}
        for name, found in done.items()
    }


def table(done: dict[str, dict[str, Any]]) -> None:
    """Prints it as Markdown."""

    def line(name: str, cells: list[str]) -> None:
        print(f"| {name} | {' | '.join(cells)} |")

    line("", list(done))
    line("---", ["---"] * len(done))
    for row in dict.fromkeys(row for found in done.values() for row in found["rows"]):
        means = [np.nanmean(found["rows"][row], axis=0) if row in found["rows"] else None for found in done.values()]
        line(row, ["-" if mean is None else _cell(mean) for mean in means])
        if row in (ONE, ALL):
            both = [(found["rows"][row][:, 0], found["groups"]) for found in done.values()]
            kept = [(x[np.isfinite(x)], groups[np.isfinite(x)]) for x, groups in both]
            line("± of the total", [f"{mean_error(x, groups):.2f}" for x, groups in kept])
        if row == ALL_MOVING:
            spread = [np.nanpercentile(found["rows"][row][:, 0], (50.0, 90.0)) for found in done.values()]
            line("the same, median and 90th percentile of frames", [f"{a:.2f}, {b:.2f}" for a, b in spread])
    lost = {row for found in done.values() for row, x in found["rows"].items() if np.isnan(x).any()}
    for row in sorted(lost):
        line(
            f"frames without a usable shape: {row}",
            [str(int(np.isnan(f["rows"].get(row, np.zeros((1, 3)))[:, 0]).sum())) for f in done.values()],
        )
    weight = DENSITY * 9.80665
    stiff = []
    for found in done.values():
        one, all_ = found["fits"][0]
        estimates = [fit.harness.segments[found["frames"].trunk.partition("+")[0]] for fit in (one, all_)]
        stiff.append(" / ".join(f"{cable.mean_bending_stiffness / weight:.1e}" for cable in estimates))
    line("processor time of both fits [s], longest part", [f"{max(found['times']):.1f}" for found in done.values()])
    line("EI/w of the parent [m³], alone / calibrated", stiff)
    line("length of the parent [m]", [f"{found['frames'].length:.3f}" for found in done.values()])


def _cell(mean: np.ndarray) -> str:
    return f"{mean[0]:.2f} ({mean[1]:.2f}, {mean[2]:.2f})"
