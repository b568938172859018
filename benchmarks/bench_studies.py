#!/usr/bin/env python
"""Figures of studies: a hose's lengths, tolerances, its best length beside a fine scan, the space it sweeps, workers.

scripts/bench studies [--quick] [--save FILE] [--compare FILE] [--workers N]

Wall times are the least of a few, the start of processes in them. Of the million rows it is the pace once the work is
under way, in turns, the best of each; beside it stands how much faster processes that only count are than one, at that
time: what the machine gave them.
"""

from __future__ import annotations

from multiprocessing import get_context
from pathlib import Path
from time import perf_counter

import numpy as np
from clocks import clocked
from figures import Figures, bench_options, bench_parser, finish, heading
from scipy.spatial import cKDTree

import cable_shape as cs
from cable_shape.planning.study_walk import Rows

STUDIES = Path(__file__).resolve().parents[1] / "examples" / "studies"
LENGTH, CLIPS, TOLERANCES = (STUDIES / f"{name}.yaml" for name in ("length", "clips", "tolerances"))
#: Numbers that are counted to see what the machine gives two processes.
COUNTED = 20_000_000
#: Points of a chunk, 500 instants each.
CHUNK = 8


def of_length(**changes: object) -> cs.Study:
    """The study of the hose's length with some keys changed; None takes one away."""
    values = {**cs.Study.from_yaml(LENGTH).values, **changes}
    return cs.Study(**{key: value for key, value in values.items() if value is not None})


def seconds(study: cs.Study, workers: int, times: int = 3) -> float:
    """[s] of a run, the start of its processes included, the least of several."""
    return min(clocked(lambda: study.run(workers=workers))[0] for _ in range(times))


def pace(study: cs.Study, **how: object) -> float:
    """Points a second, from when a tenth of them is done on."""
    seen: list[tuple[float, int]] = []
    study.run(progress=lambda done, _: seen.append((perf_counter(), done)), **how)
    began, before = next(one for one in seen if one[1] >= 0.1 * len(study.points))
    return (seen[-1][1] - before) / (seen[-1][0] - began)


def counted(until: int) -> float:
    """[s], of counting."""
    began, total = perf_counter(), 0
    for i in range(until):
        total += i
    return perf_counter() - began


def print_length(figures: Figures, workers: int, quick: bool) -> None:
    """The whole study on one worker and on several."""
    heading("Every length from 630 to 900 mm at 500 instants")
    study = of_length(vary={"cable.length": {"from": 0.63, "to": 0.9, "step": 0.01}}) if quick else of_length()
    study.rows(0)
    alone, several = seconds(study, 1, 1), seconds(study, workers)
    rows = 500 * len(study.points)
    print(f"{rows} shapes: {alone:.2f} s on one worker, {1e6 * alone / rows:.1f} us each; {several:.2f} s on {workers}")
    figures.at_most(f"the hose's lengths on {workers} workers", several, 10.0, "{:.1f}", " s")


def print_tolerances(figures: Figures, workers: int, quick: bool) -> None:
    """Many shapes drawn at random, and the envelope of the few of the example beside theirs."""
    heading("Tolerances")
    values, count = cs.Study.from_yaml(TOLERANCES).values, 10_000 if quick else 100_000
    few, many = (
        cs.Study(**{**values, "sample": sample})
        for sample in (values["sample"], {"kind": "random", "points": count, "seed": 1})
    )
    few.run(workers=1)
    assert many.points.size
    took = seconds(many, workers)
    print(f"{count} shapes: {took:.2f} s on {workers} workers, {1e6 * took / count:.1f} us each")
    figures.at_most(f"{count} Monte Carlo shapes on {workers} workers", took, 5.0, "{:.2f}", " s")
    told, drawn = few.envelope(), many.envelope()
    width = 2.0 * float(drawn.radius[""].max())
    off = np.linalg.norm(told.middle[""] - drawn.middle[""], axis=1) + np.abs(told.radius[""] - drawn.radius[""])
    tube = f"95 % of {drawn.shapes} shapes are in a tube {1e3 * width:.2f} mm wide"
    print(f"{tube}; that of {told.shapes} is off by {1e3 * off.max():.3f} mm, middle and radius")
    figures.at_most("envelope off that of Monte Carlo, of its width", 100.0 * off.max() / width, 2.0, "{:.2f}", " %")


def print_best(figures: Figures) -> None:
    """The best length, and the best place of a clip, beside scans by 0.1 mm of 4 mm about them."""
    heading("The best length, and the best place of a clip")
    clips = cs.Study.from_yaml(CLIPS).values
    of_place = {key: value for key, value in clips.items() if key != "vary"}
    place = "scene.clips.leg.arc_length"
    for name, values, axis, low, high in (
        ("length", of_length().values, "cable.length", 0.63, 0.9),
        ("place of a clip", of_place, place, 0.5, 0.7),
    ):
        study = cs.Study(**{**values, "vary": {axis: {"from": low, "to": high, "count": 2}}})
        found = study.best()
        at = float(found.point[0])
        near = {axis: {"from": at - 0.002, "to": at + 0.002, "step": 1e-4}}
        scan = cs.Study(**{**values, "vary": near}).run(workers=1)
        used = np.where(scan.complete, np.fmax.reduce(scan.used, axis=1), np.inf)
        scanned = float(scan.points[used.argmin(), 0])
        told = f"{found.solves} solves and {found.shapes} single shapes"
        print(f"{name}: {1e3 * at:.3f} mm, {1e3 * scanned:.3f} mm by the scan; {told}; limited by {found.limiting}")
        figures.at_most(f"best {name} off that of a scan by 0.1 mm", 1e3 * abs(at - scanned), 0.1, "{:.3f}", " mm")
        whole = 1.0 + (high - low) / 1e-4
        figures.at_most("its solves of those of a scan of all by 0.1 mm", found.solves / whole, 0.05, "{:.3f}")


def print_swept(figures: Figures) -> None:
    """A space of 2000 instants, held against 20,000."""
    heading("The space of 2000 instants")
    rows, finer = (instants_of(n) for n in (2000, 20000))
    cs.swept(rows, 0.0118)
    began = perf_counter()
    mesh = cs.swept(rows, 0.0118)
    took = perf_counter() - began
    line = finer.part(1, 3).reshape(-1, 3)
    looked = np.concatenate((mesh.vertices, mesh.vertices[mesh.faces].mean(axis=1)))
    nearest = cKDTree(line[::7]).query(looked, distance_upper_bound=0.03)[0].min()
    print(f"{mesh}; nearest to 20,000 instants {1e3 * nearest:.3f} mm, margin {1e3 * mesh.margin:.3f} mm")
    figures.at_most("a swept mesh of 2000 instants, 5 mm loose", took, 5.0, "{:.2f}", " s")
    figures.at_most("its looseness", 1e3 * mesh.looseness, 5.0, "{:.2f}", " mm")
    figures.check("it holds a motion ten times finer", bool(nearest > mesh.margin - 1e-6))


def instants_of(count: int) -> Rows:
    """The hose's motion in so many instants."""
    study = of_length(vary=None, measure=["tension"], motion={**of_length().values["motion"], "instants": count})
    return study.rows([])[""]


def print_cluster(figures: Figures, workers: int, quick: bool) -> None:
    """A million rows by one process, by several and by Dask's local cluster, in four parts and in turns."""
    import distributed

    heading("A million rows")
    points = 160 if quick else 500
    parts = [
        of_length(vary={"cable.length": {"from": low, "to": low + 0.06, "count": points}}, chunk=CHUNK)
        for low in (0.63, 0.69, 0.75, 0.81)
    ]
    found: dict[str, list[float]] = {name: [] for name in ("one process", f"{workers} processes", "Dask", "counting")}
    cluster = distributed.LocalCluster(n_workers=workers, threads_per_worker=1, dashboard_address=None)
    with get_context("spawn").Pool(workers) as pool, cluster:
        of_length(vary={"cable.length": [0.63, 0.64]}, chunk=1).run(scheduler=cluster.scheduler_address)
        for study in parts:
            found["one process"].append(pace(study, workers=1))
            found[f"{workers} processes"].append(pace(study, workers=workers))
            found["Dask"].append(pace(study, scheduler=cluster.scheduler_address))
            pool.map(counted, [1000] * workers)
            alone = pool.map(counted, [COUNTED])[0]
            took, _ = clocked(lambda: pool.map(counted, [COUNTED] * workers, chunksize=1))
            found["counting"].append(workers * alone / took)
        shapes = {"cable.length": {"from": 0.63, "to": 0.9, "count": 400}}
        single = of_length(vary=shapes, chunk=1, motion={**of_length().values["motion"], "instants": 1})
        costs = 1.0 / pace(single, scheduler=cluster.scheduler_address)
    for name, told in found.items():
        unit = "times one process" if name == "counting" else "points a second"
        print(f"{name}: {', '.join(f'{one:.3g}' for one in told)} {unit}")
    one, several, there = (max(told) for told in list(found.values())[:3])
    plain, dask = (1e3 * CHUNK * workers / best for best in (several, there))
    print(f"{2000 * points} rows; a chunk takes a process {plain:.0f} ms, a worker of Dask {dask:.0f} ms")
    print(f"chunks of one shape: Dask hands out one each {1e3 * costs:.1f} ms")
    figures.at_least(f"{workers} workers over one", several / one, 1.8, "{:.2f}")
    figures.at_most("Dask's local cluster over processes", several / there, 1.3, "{:.2f}")


def main() -> int:
    """All tables."""
    parser = bench_parser(__doc__, "fewer lengths and rows")
    parser.add_argument("--workers", type=int, default=2, metavar="N", help="processes (2)")
    options = bench_options(parser)
    figures = Figures()
    print_length(figures, options.workers, options.quick)
    print_tolerances(figures, options.workers, options.quick)
    print_best(figures)
    print_swept(figures)
    print_cluster(figures, options.workers, options.quick)
    return finish(figures, options)


if __name__ == "__main__":
    raise SystemExit(main())
