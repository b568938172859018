#!/usr/bin/env python
"""Figures of studies: a hose's lengths, tolerances, its best length beside a fine scan, the space it sweeps, workers.

scripts/bench studies [--quick] [--save FILE] [--compare FILE] [--workers N]

The start of processes is timed by a study of as many points as there are workers, and is taken off where that is said.
Wall times are those of a machine that does nothing else.
"""

from __future__ import annotations

from pathlib import Path
from time import perf_counter

import numpy as np
from figures import Figures, bench_options, bench_parser, finish, heading
from scipy.spatial import cKDTree

import cable_shape as cs
from cable_shape.planning.study_walk import Rows

STUDIES = Path(__file__).resolve().parents[1] / "examples" / "studies"
LENGTH, CLIPS, TOLERANCES = (STUDIES / f"{name}.yaml" for name in ("length", "clips", "tolerances"))


def of_length(**changes: object) -> cs.Study:
    """The study of the hose's length with some keys changed; None takes one away."""
    values = {**cs.Study.from_yaml(LENGTH).values, **changes}
    return cs.Study(**{key: value for key, value in values.items() if value is not None})


def seconds(study: cs.Study, workers: int) -> float:
    """[s] of a run, the start of its processes included."""
    began = perf_counter()
    study.run(workers=workers)
    return perf_counter() - began


def start_of(workers: int) -> float:
    """[s], of processes with nothing to do."""
    points = [0.7 + 1e-3 * i for i in range(workers)]
    return seconds(of_length(vary={"cable.length": points}, chunk=1, motion=at_rest()), workers)


def at_rest() -> dict[str, object]:
    """The hose's motion, one instant of it."""
    return {**of_length().values["motion"], "instants": 1}


def print_length(figures: Figures, workers: int, quick: bool) -> None:
    """The whole study on one worker and on several."""
    heading("Every length from 630 to 900 mm at 500 instants")
    study = of_length(vary={"cable.length": {"from": 0.63, "to": 0.9, "step": 0.01}}) if quick else of_length()
    study.rows(0)
    alone, several = seconds(study, 1), seconds(study, workers)
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
    """A million rows by one process, by several and by Dask's local cluster, their start apart."""
    import distributed

    heading("A million rows")
    count = 40 if quick else 2000
    study = of_length(vary={"cable.length": {"from": 0.63, "to": 0.9, "count": count}})
    alone, begun = seconds(study, 1), start_of(workers)
    plain = seconds(study, workers) - begun
    with distributed.LocalCluster(n_workers=workers, threads_per_worker=1, dashboard_address=None) as cluster:
        of_length(vary={"cable.length": [0.63, 0.64]}, chunk=1).run(scheduler=cluster.scheduler_address)
        began = perf_counter()
        study.run(scheduler=cluster.scheduler_address)
        there = perf_counter() - began
    overhead = 1e3 * workers * max(there - plain, 0.0) / study.chunks
    by = f"{alone:.1f} s alone, {plain:.1f} s by {workers} processes, {there:.1f} s by Dask"
    print(f"{500 * count} rows, {study.chunks} chunks: {by}")
    figures.at_least(f"{workers} workers over one", alone / plain, 1.8, "{:.2f}")
    print(f"overhead {overhead:.1f} ms a chunk of {1e3 * workers * plain / study.chunks:.0f} ms")
    figures.at_most("Dask's local cluster over processes", there / plain, 1.3, "{:.2f}")


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
