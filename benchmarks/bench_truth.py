"""Judges predictions on real cables: fitted on other trajectories than judged, static and with inertial load.

The recordings are read from ../shared/data, or any folder laid out like it, and are no part of this project; without
them only the synthetic part runs.
"""

from __future__ import annotations

import argparse
import csv
import math
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from branched_data import BRANCHED, objects
from figures import Figures, bench_options, bench_parser, finish, heading
from tqdm import tqdm
from truth_branched import branched
from truth_data import CABLES, DATA, Frames, load, recording
from truth_limits import least, line, mean_error, read_off
from truth_readings import readings
from truth_supports import NOISE, ROWS, SEEN, draw_rest, ends_of, recovered_along
from truth_supports import POINTS as MARKS
from truth_tubes import tubes

import cable_shape as cs
from cable_shape.calibration.parameters import held
from cable_shape.kernels.distance.misses import misses

STATIC, MOVING, ALL = "static, EI/w only", "inertial load, EI/w only", "inertial load, all that helps"
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
HELPS = ("bending_stiffness", "length", "start_tilt", "end_tilt", "start_offset", "end_offset", "rest_curvature_along")
PRIORS = {"length": 0.002, "start_tilt": 0.06, "end_tilt": 0.06, "start_offset": 0.002, "end_offset": 0.002}
#: Frames that "all that helps" is fitted on.
KINDS = ("quasi", "slow", "moderate")
PARTS = 3
#: Of the rest curvature along the cable.
SUPPORTS = 9
SYNTHETIC, ALONG = 200, 100
#: Every so many frames, whether the tube holds the markers.
TUBES = 3


def distances(shape: cs.CableShape, points: np.ndarray) -> np.ndarray:
    """(m,) [m], of points to the closest point of a centreline; NaN without a usable shape."""
    out = np.full(points.shape, np.nan)
    if shape.status:
        misses(shape.buffer, shape.points, points, np.full(len(points), math.nan), out)
    return np.linalg.norm(out, axis=1)


def predicted(found: cs.Calibration, seen: cs.Observation, model: str = "cosserat") -> cs.CableShape:
    """An observation, predicted by a calibration that has not seen it."""
    assert found.parameters is not None
    assert found.values is not None
    near, far = (found.parameters.offset(found.values, side) for side in ("start", "end"))
    start, end = held(seen.start, near), held(seen.end, far)
    return cs.predict(found.cable, start, end, model=model, points=101, acceleration=seen.acceleration)


def rolling(seen: cs.Observation) -> cs.Observation:
    """The same with swivels at both ends: what roll the grippers had was not measured."""
    assert isinstance(seen.end, cs.Grip)
    grips = cs.Grip(seen.start.pose, "swivel"), cs.Grip(seen.end.pose, "swivel")
    return cs.Observation(*grips, seen.points, acceleration=seen.acceleration, group=seen.group)


def radius_at(found: cs.Calibration, seen: cs.Observation) -> np.ndarray:
    """(m,) [m]: radius of the 95 % tube where it is nearest to each observed point."""
    tube = cs.predict_tube(found, seen.start, seen.end, acceleration=seen.acceleration)
    apart = np.linalg.norm(seen.points[:, None] - tube.shape.positions[None], axis=2)
    return tube.radius[apart.argmin(axis=1)]


def judge(number: int, frames: Frames, quick: bool, folder: Path) -> dict[str, Any]:
    """All rows for one cable: mean distance of held-back markers in % of the length, and what was fitted."""
    rows: dict[str, dict[int, np.ndarray]] = {}
    fits: dict[str, list[cs.Calibration]] = {STATIC: [], MOVING: [], ALL: []}
    inside: list[np.ndarray] = []
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
        by[ALL] = cs.calibrate(wide, by[MOVING].cable, HELPS, priors=PRIORS, supports=SUPPORTS)
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
                inside.append(off <= radius_at(by[ALL], moving))
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
        "coverage": float(np.concatenate(inside).mean()),
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


def real(
    figures: Figures, quick: bool, folder: Path, picture: Path | None, table: Path | None, rest: Path | None
) -> dict[str, Any]:
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
    if table is not None:
        write(done, table)
    return {f"cable{n}": {"rows": done[n]["rows"], "coverage": done[n]["coverage"]} for n in CABLES}


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
    if any(len(np.unique(found["frames"].traj[list(found["means"][STATIC])])) < 10 for found in done.values()):
        return
    print(
        "and the rod here on frames with the told mean of the catenary, which has nothing to fit: read off a straight"
    )
    print("line through the frames here.")
    for row in (STATIC, MOVING):
        off = []
        for n, at in zip(CABLES, TOLD["catenary"], strict=True):
            means = done[n]["means"]
            which = list(means[row])
            values, chain = (np.array([means[name][i] for i in which]) for name in (row, "catenary"))
            off.append(read_off(values, chain, at, done[n]["frames"].traj[which]))
        line(f"{row}: at that catenary", [x for x, _ in off], [error for _, error in off])


def write(done: dict[int, dict[str, Any]], table: Path) -> None:
    """One line a judged frame: mean distance [%] in each row."""
    rows = list(next(iter(done.values()))["rows"])
    with table.open("w", newline="") as file:
        out = csv.writer(file)
        out.writerow(("cable", "trajectory", "frame", "kind", *rows))
        for n, found in done.items():
            frames = found["frames"]
            for i in sorted({i for means in found["means"].values() for i in means}):
                told = (f"{found['means'][row][i]:.3f}" if i in found["means"][row] else "" for row in rows)
                out.writerow((n, frames.traj[i], frames.frame[i], frames.kind[i], *told))


def draw(done: dict[int, dict[str, Any]], picture: Path) -> None:
    """The best, a middling and the worst frame of each cable, seen from the side."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    from cable_shape.calibration.picture import side_view

    figure = Figure(figsize=(13.0, 15.0), dpi=90)
    FigureCanvasAgg(figure)
    axes = figure.subplots(len(done), 3)
    for row, (number, found) in zip(axes, done.items(), strict=True):
        order = sorted(found["shapes"], key=lambda shape: shape["mean"])
        for axis, which in zip(row, (0, len(order) // 2, len(order) - 1), strict=True):
            one = order[which]
            side_view(axis, one["moving"], one["points"])
            still, line = one["static"], one["moving"]
            across = line[-1, :2] - line[0, :2]
            x = (still[:, :2] - line[0, :2]) @ across / np.linalg.norm(across)
            axis.plot(x, still[:, 2], color="#d98e04", lw=1.0, ls="--", label="static, EI/w only")
            name = ("best", "middle", "worst")[(0, len(order) // 2, len(order) - 1).index(which)]
            axis.set_title(f"cable{number}, {name} frame: {100.0 * one['mean'] / found['length']:.2f} %", fontsize=9)
    axes[0, 0].legend(fontsize=8)
    figure.tight_layout()
    figure.savefig(picture, metadata={"Software": None})


def recovered(seed: int) -> dict[str, bool]:
    """Whether the true stiffness and length of one random cable are in their 95 % intervals."""
    rng = np.random.default_rng(seed)
    length, density = rng.uniform(0.5, 1.5), rng.uniform(0.02, 0.2)
    stiffness = density * 9.81 * (length * math.exp(rng.uniform(math.log(0.05), math.log(0.3)))) ** 3
    true = cs.Cable(length=length, linear_density=density, bending_stiffness=stiffness)
    seen: list[cs.Observation] = []
    while len(seen) < 5:
        start, end = ends_of(rng, length)
        shape = cs.predict(true, start, end, model="cosserat", points=301)
        if shape.status is cs.Status.OK:
            points = shape.positions[np.sort(rng.integers(15, 286, 15))] + 5e-4 * rng.normal(size=(15, 3))
            stray = rng.random(15) < 0.05
            points[stray] += 0.05 * rng.normal(size=(int(stray.sum()), 3))
            seen.append(cs.Observation(start, end, points))
    begin = true.replace(
        bending_stiffness=stiffness * math.exp(0.7 * rng.normal()), twisting_stiffness=None,
        length=length * (1.0 + 0.003 * rng.normal()),
    )  # fmt: skip
    found = cs.calibrate(seen, begin, ("bending_stiffness", "length"))
    truth = {"bending_stiffness": stiffness, "length": length}
    return {name: found.converged and found[name].low <= x <= found[name].high for name, x in truth.items()}


def synthetic(figures: Figures, count: int) -> dict[str, float]:
    """Coverage of the intervals, and the time of a fit."""
    heading(f"Synthetic recovery: {count} cables, 5 observations of 15 points, noise 0.5 mm, 5 % stray by 5 cm")
    results = [recovered(seed) for seed in tqdm(range(count), desc="synthetic", unit="cable")]
    out = {}
    for name in results[0]:
        out[name] = 100.0 * sum(r[name] for r in results) / count
        figures.at_least(f"true {name} in its 95 % interval", out[name], 90.0, "{:.1f}", " %")
        figures.at_most(f"true {name} in its 95 % interval", out[name], 99.0, "{:.1f}", " %")
    many = max(8, count * ALONG // SYNTHETIC)
    heading(
        f"Rest curvature at {ROWS} supports and stiffness: {many} cables, {SEEN} observations of {MARKS} points, noise "
        f"{1e3 * NOISE:g} mm, 5 % stray by 5 cm"
    )
    inside = np.concatenate([recovered_along(seed) for seed in tqdm(range(many), desc="supports", unit="cable")])
    out["along"] = 100.0 * float(inside.mean())
    figures.at_least("true numbers with nine supports in their 95 % intervals", out["along"], 93.0, "{:.1f}", " %")
    figures.at_most("true numbers with nine supports in their 95 % intervals", out["along"], 97.0, "{:.1f}", " %")
    rng = np.random.default_rng(0)
    true = cs.Cable(length=1.0, linear_density=0.05, bending_stiffness=0.004)
    for loaded in (False, True):
        seen = []
        for _ in range(50):
            start, end = ends_of(rng, 1.0)
            table = 2.0 * rng.normal(size=(11, 3)) if loaded else None
            shape = cs.predict(true, start, end, model="cosserat", points=301, acceleration=table)
            seen.append(cs.Observation(start, end, shape.positions[20:-20:26] + 5e-4 * rng.normal(size=(11, 3)),
                                       acceleration=table))  # fmt: skip
        times = []
        for _ in range(5):
            began = time.process_time()
            cs.calibrate(seen, true.replace(bending_stiffness=0.008, twisting_stiffness=None))
            times.append(time.process_time() - began)
        told = "with accelerations" if loaded else "at rest"
        figures.at_most(
            f"one parameter on 50 frames {told}, time of one core", float(np.median(times)), 0.5, "{:.2f}", " s"
        )
    return out


def main() -> int:
    parser = bench_parser(__doc__, "one part of the frames, 40 synthetic cables")
    parser.add_argument("--picture", type=Path, metavar="FILE.png", help="draw predicted and measured cables")
    parser.add_argument(
        "--data", type=Path, metavar="FOLDER", help="recordings to judge (shared/data, or its branched)"
    )
    parser.add_argument("--branched", action="store_true", help="judge branched cables alone")
    parser.add_argument("--rest", type=Path, metavar="FILE.png", help="draw the rest shapes that were found")
    parser.add_argument("--frames", type=Path, metavar="FILE.csv", help="write the error of every judged frame")
    parser.add_argument("--readings", action="store_true", help="also read the frames in other ways")
    args = bench_options(parser)
    cs.warm_up()
    figures = Figures()
    if args.branched:
        return main_branched(parser, args, figures)
    args.data = args.data or DATA
    out: dict[str, Any] = {"synthetic": synthetic(figures, 40 if args.quick else SYNTHETIC)}
    if args.data.is_dir():
        out |= real(figures, args.quick, args.data, args.picture, args.frames, args.rest)
        if args.data == DATA:
            out["tubes"] = tubes(figures, args.quick)
        if args.readings:
            readings({number: load(number, PARTS, args.data) for number in CABLES})
    elif args.data != DATA:
        parser.error(f"--data {args.data}: no such folder. Name one with cable1_frames.npz and the others.")
    else:
        print(f"\nno recordings of real cables at {DATA.parent.name}/{DATA.name}: not judged")
    return finish(figures, args, tables=out)


def main_branched(parser: argparse.ArgumentParser, args: argparse.Namespace, figures: Figures) -> int:
    """Judges the branched cables in a folder."""
    folder = args.data or BRANCHED
    if folder.is_dir() and objects(folder):
        return finish(figures, args, tables=branched(figures, args.quick, folder))
    if args.data is not None:
        parser.error(f"--data {folder}: no branched cables there. Name a folder with bdlo1_frames.npz and others.")
    print(f"no recordings of branched cables at {'/'.join(BRANCHED.parts[-3:])}: not judged")
    return 0


if __name__ == "__main__":
    sys.exit(main())
