"""Judges predictions on real cables: fitted on other trajectories than judged, static and with inertial load.

The recordings are read from ../shared/data, or any folder laid out like it, and are no part of this project; without
them only the synthetic part runs.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from branched_data import BRANCHED, objects
from clocks import clocked
from figures import Figures, bench_options, bench_parser, finish, heading
from tqdm import tqdm
from truth_branched import branched
from truth_data import CABLES, DATA, Frames, distances, load, recording
from truth_limits import least, line, mean_error
from truth_options import held_as, options
from truth_pictures import draw, draw_rest
from truth_synthetic import SYNTHETIC, synthetic
from truth_tubes import inside, tubes

import cable_shape as cs
from cable_shape.calibration.parameters import held

STATIC, MOVING, ALL = "static, EI/w only", "inertial load, EI/w only", "loads of motion, all that helps"
FASTER = "moderate frames, all that helps"
ASKED = {
    STATIC: (2.2, 1.8, 2.3, 2.6, 2.8),
    MOVING: (2.0, 1.6, 2.0, 1.5, 1.15),
    ALL: (1.0, 0.95, 0.85, 0.75, 0.85),
    FASTER: (1.35, 2.14, 1.45, 1.07, 1.04),
}
#: Figures that come with the data, of an independent rod on frames that do not.
TOLD = {
    "straight line": (20.9, 22.8, 22.4, 21.3, 21.6),
    "catenary": (2.6, 3.3, 4.0, 2.7, 2.7),
    STATIC: (2.08, 1.67, 2.17, 2.48, 2.72),
    MOVING: (1.89, 1.50, 1.89, 1.44, 1.09),
    ALL: (1.46, 1.11, 1.48, 0.82, 0.86),
}
ONE = ("bending_stiffness",)
HELPS = (
    "bending_stiffness", "length", "start_tilt", "end_tilt", "start_offset", "end_offset", "rest_curvature_along",
    "retardation_time", "drag",
)  # fmt: skip
PRIORS = {
    "length": 0.002, "start_tilt": 0.06, "end_tilt": 0.06, "start_offset": 0.002, "end_offset": 0.002,
    "retardation_time": 1.0, "drag": 1.0,
}  # fmt: skip
#: Where the fits of what slows a cable begin, s and N s/m^2; their priors are a factor of e.
SLOWED = {"retardation_time": 0.05, "drag": 0.01}
#: Frames that "all that helps" is fitted on.
KINDS = ("quasi", "slow", "moderate")
PARTS = 3
#: Of the rest curvature along the cable.
SUPPORTS = 9
#: Frames of a fit whose time is told, and supports of its rest curvature.
LOOKS, FEW = 200, 4
#: Every so many frames, whether the tube holds the markers.
TUBES = 3


def predicted(found: cs.Calibration, seen: cs.Observation, model: str = "cosserat") -> cs.CableShape:
    """An observation, predicted by a calibration that has not seen it."""
    assert found.parameters is not None
    assert found.values is not None
    near, far = (found.parameters.offset(found.values, side) for side in ("start", "end"))
    start, end = held(seen.start, near), held(seen.end, far)
    return cs.predict(found.cable, start, end, model=model, points=101, acceleration=seen.acceleration)


def rolling(seen: cs.Observation) -> cs.Observation:
    """The same with swivels at both ends: what roll the grippers had was not measured."""
    return held_as(seen, "swivel")


def options_of(numbers: Sequence[int], folder: Path) -> dict[str, list[float]]:
    """What cross validation says of options, on the frames of all kinds that the first fit of each cable is made of."""
    data = {}
    for number in numbers:
        frames = load(number, PARTS, folder)
        data[number] = [frames.moving[i] for i in frames.where(KINDS, 0, False)], frames.cable.replace(**SLOWED)
    return options(data, HELPS, PRIORS, SUPPORTS)


def judge(number: int, frames: Frames, quick: bool, folder: Path) -> dict[str, Any]:
    """All rows for one cable: mean distance of held-back markers in % of the length, and what was fitted."""
    rows: dict[str, dict[int, np.ndarray]] = {}
    fits: dict[str, list[cs.Calibration]] = {STATIC: [], MOVING: [], ALL: []}
    held_in: list[np.ndarray] = []
    shapes: list[dict[str, Any]] = []

    def put(row: str, i: int, values: np.ndarray) -> None:
        rows.setdefault(row, {})[int(i)] = values

    for part in range(1 if quick else PARTS):
        learn, held_back = frames.where(("quasi",), part, False), frames.where(("quasi",), part, True)
        by = {
            STATIC: cs.calibrate([frames.static[i] for i in learn], frames.cable, ONE),
            MOVING: cs.calibrate([frames.moving[i] for i in learn], frames.cable, ONE),
        }
        wide = [rolling(frames.moving[i]) for i in frames.where(KINDS, part, False)]
        by[ALL] = cs.calibrate(wide, by[MOVING].cable.replace(**SLOWED), HELPS, priors=PRIORS, supports=SUPPORTS)
        for row, found in by.items():
            fits[row].append(found)
        for i in held_back:
            still, moving = frames.static[i], frames.moving[i]
            points = still.points
            chord = still.end.cable_frame.position - still.start.cable_frame.position  # type: ignore[union-attr]
            along = np.clip((points - still.start.pose.position) @ chord / (chord @ chord), 0.0, 1.0)
            straight = still.start.pose.position + along[:, None] * chord
            put("straight line", i, np.linalg.norm(points - straight, axis=1))
            for model in ("catenary", "gradient4", "gradient6"):
                put(model, i, distances(predicted(by[STATIC], still, model), points))
            put(STATIC, i, distances(predicted(by[STATIC], still), points))
            put(MOVING, i, distances(predicted(by[MOVING], moving), points))
            moving = rolling(moving)
            shape = predicted(by[ALL], moving)
            off = distances(shape, points)
            put(ALL, i, off)
            if i % TUBES == 0:
                tube = cs.predict_tube(by[ALL], moving.start, moving.end, acceleration=moving.acceleration)
                held_in.append(inside(tube, points))
            shapes.append({"i": int(i), "mean": float(off.mean()), "moving": shape.positions, "points": points,
                           "static": predicted(by[STATIC], still).positions})  # fmt: skip
        for i in frames.where(("moderate",), part, True):
            for row, told, seen in (("static", STATIC, frames.static[i]), ("inertial load", MOVING, frames.moving[i])):
                put(f"moderate frames, {row}", i, distances(predicted(by[told], seen), seen.points))
            put(FASTER, i, distances(predicted(by[ALL], rolling(frames.moving[i])), frames.moving[i].points))
    per_cent = 100.0 / frames.cable.length
    means = {row: {i: per_cent * float(x.mean()) for i, x in values.items()} for row, values in rows.items()}
    joined = {row: per_cent * np.concatenate(list(values.values())) for row, values in rows.items()}
    calm = np.flatnonzero(frames.kind == "quasi")
    return {
        "rows": {row: float(np.nanmean(values)) for row, values in joined.items()},
        "lost": {row: int(np.isnan(values).sum()) for row, values in joined.items()},
        "means": means,
        "least": {
            row: per_cent * least([seen[i] for i in calm], frames.cable)[0]
            for row, seen in ((STATIC, frames.static), (MOVING, frames.moving))
        },
        "recordings": recordings(number, frames, folder),
        "frames": frames,
        "coverage": float(np.concatenate(held_in).mean()),
        "fits": fits,
        "shapes": shapes,
        "length": frames.cable.length,
    }


def recordings(number: int, frames: Frames, folder: Path) -> dict[str, float]:
    """Means over the calm frames of both recordings, EI/w fitted to frames of other trajectories; count of frames."""
    off: dict[str, list[np.ndarray]] = {STATIC: [], MOVING: []}
    for which, traj in enumerate(frames.recorded):
        learn = np.flatnonzero((frames.kind == "quasi") & (frames.traj != traj))
        seen = dict(zip(off, recording(number, which, frames.calm, folder), strict=True))
        for row, known in ((STATIC, frames.static), (MOVING, frames.moving)):
            found = cs.calibrate([known[i] for i in learn], frames.cable, ONE)
            off[row] += [distances(predicted(found, one), one.points) for one in seen[row]]
    means = {row: 100.0 * float(np.concatenate(values).mean()) / frames.cable.length for row, values in off.items()}
    return means | {"frames": len(off[STATIC])}


def real(figures: Figures, quick: bool, folder: Path, picture: Path | None, rest: Path | None) -> dict[str, Any]:
    """The table of real cables."""
    heading("Real cables: mean distance of inner markers to the prediction, % of the free length, frames 'quasi'")
    print(f"fitted on other trajectories than judged, {PARTS} parts. Swivel at the end: roll was not measured.")
    print(f"All that helps: {', '.join(HELPS)} with {SUPPORTS} supports,")
    print(f"priors {PRIORS}, one set a cable, none a frame; swivels at both ends, fitted on {', '.join(KINDS)}.")
    print("Grips as the data say: tangents through the two markers in each grip, no marker that is judged.")
    print("±: standard error, from how much trajectories disagree.")
    done = {number: judge(number, load(number, PARTS, folder), quick, folder) for number in tqdm(CABLES, desc="cables")}
    print(f"{'':52}" + "".join(f"{f'cable{n}':>14}" for n in CABLES))
    for row in next(iter(done.values()))["rows"]:
        errors = []
        for n in CABLES:
            means = done[n]["means"][row]
            errors.append(mean_error(np.array(list(means.values())), done[n]["frames"].traj[list(means)]))
        line(row, [done[n]["rows"][row] for n in CABLES], errors)
        lost = [done[n]["lost"][row] for n in CABLES]
        if any(lost):
            print(f"{'  markers without a usable shape':52}" + "".join(f"{x:14d}" for x in lost))
    told = [
        100.0 * np.mean([np.nanmean(f.distances) for f in done[n]["fits"][ALL]]) / done[n]["length"] for n in CABLES
    ]
    line(f"{ALL}: told by the fits, of their frames", told)
    limits(done)
    for row in (STATIC, MOVING, ALL):
        print(f"EI/w [m^3] and its standard error, {row}, one part left out:")
        told = []
        for n in CABLES:
            found = done[n]["fits"][row][0]
            estimate = found["bending_stiffness"]
            told.append(
                f"cable{n} {estimate.value / found.cable.linear_density / 9.81:.2g} ({100 * estimate.relative:.0f} %)"
            )
        print("  " + ", ".join(told))
    for row, asked in ASKED.items():
        for n, bound in zip(CABLES, asked, strict=True):
            figures.at_most(f"cable{n}: {row}", done[n]["rows"][row], bound, "{:.2f}", " %")
    for n in CABLES:
        share = 100.0 * done[n]["coverage"]
        figures.at_least(f"cable{n}: 95 % tube holds held-back markers", share, 90.0, "{:.1f}", " %")
        figures.at_most(f"cable{n}: 95 % tube holds held-back markers", share, 99.0, "{:.1f}", " %")
    if picture is not None:
        draw(done, picture)
    if rest is not None:
        draw_rest({n: done[n]["fits"][ALL] for n in CABLES}, rest)
    return {f"cable{n}": {"rows": done[n]["rows"], "coverage": done[n]["coverage"]} for n in CABLES}


def fitting(figures: Figures, numbers: Sequence[int], folder: Path) -> None:
    """How long a fit of many numbers takes."""
    heading(f"{LOOKS} frames with accelerations, rest curvature at {FEW} supports: processor time of a fit")
    names = [name for name in HELPS if name not in SLOWED]
    priors = {name: x for name, x in PRIORS.items() if name in names}
    for number in tqdm(numbers, desc="times", unit="cable"):
        frames = load(number, PARTS, folder)
        seen = [frames.moving[i] for i in np.linspace(0, len(frames.moving) - 1, LOOKS).astype(int)]
        seconds, found = clocked(
            lambda o=seen, c=frames.cable: cs.calibrate(o, c, names, priors=priors, supports=FEW), time.process_time
        )
        told = f"{len(found.estimates)} numbers fitted to {LOOKS} frames in {found.iterations} iterations"
        figures.at_most(f"cable{number}: {told}", seconds, 8.0, "{:.1f}", " s")


def limits(done: dict[int, dict[str, Any]]) -> None:
    """What no EI/w could better, and what the frames have to do with it."""
    for row in (STATIC, MOVING):
        line(f"{row}: best EI/w for these very frames", [done[n]["least"][row] for n in CABLES], digits=3)
    for row in (STATIC, MOVING):
        line(f"{row}: calm frames of the recordings", [done[n]["recordings"][row] for n in CABLES])
    print(f"{'  frames of them':52}" + "".join(f"{done[n]['recordings']['frames']:14d}" for n in CABLES))
    print("Told with the data, of an independent rod on frames that are not here:")
    for row, told in TOLD.items():
        line(f"{row}: told", list(told))


def main() -> int:
    parser = bench_parser(__doc__, "one part of the frames, 40 synthetic cables")
    parser.add_argument("--picture", type=Path, metavar="FILE.png", help="draw predicted and measured cables")
    parser.add_argument(
        "--data", type=Path, metavar="FOLDER", help="recordings to judge (shared/data, or its branched)"
    )
    parser.add_argument("--branched", action="store_true", help="judge branched cables alone")
    parser.add_argument("--options", action="store_true", help="options of the fits by cross validation alone")
    parser.add_argument("--rest", type=Path, metavar="FILE.png", help="draw the rest shapes that were found")
    args = bench_options(parser)
    cs.warm_up()
    figures = Figures()
    if args.branched:
        return main_branched(parser, args, figures)
    args.data = args.data or DATA
    if args.options:
        if not args.data.is_dir():
            parser.error(f"--data {args.data}: no such folder. Name one with cable1_frames.npz and the others.")
        return finish(figures, args, tables={"options": options_of(CABLES, args.data)})
    out: dict[str, Any] = {"synthetic": synthetic(figures, 40 if args.quick else SYNTHETIC)}
    if args.data.is_dir():
        out |= real(figures, args.quick, args.data, args.picture, args.rest)
        fitting(figures, CABLES[1:2] if args.quick else CABLES, args.data)
        if args.data == DATA:
            out["tubes"] = tubes(figures, args.quick)
    elif args.data != DATA:
        parser.error(f"--data {args.data}: no such folder. Name one with cable1_frames.npz and the others.")
    else:
        print(f"\nno recordings of real cables at {DATA.parent.name}/{DATA.name}: not judged")
    return finish(figures, args, tables=out)


def main_branched(parser: argparse.ArgumentParser, args: argparse.Namespace, figures: Figures) -> int:
    """Judges the branched cables in a folder."""
    folder = args.data or BRANCHED
    folder = folder / BRANCHED.name if (folder / BRANCHED.name).is_dir() else folder
    if folder.is_dir() and objects(folder):
        return finish(figures, args, tables=branched(figures, args.quick, folder))
    if args.data is not None:
        parser.error(f"--data {folder}: no branched cables there. Name a folder with bdlo1_frames.npz and others.")
    print(f"no recordings of branched cables at {'/'.join(BRANCHED.parts[-3:])}: not judged")
    return 0


if __name__ == "__main__":
    sys.exit(main())
