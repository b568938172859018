#!/usr/bin/env python
"""What networks of rods cost: a warm solve of cables in clips and of trees, over the number of spans.

    scripts/bench network [--quick] [--save FILE] [--compare FILE] [--draw FILE]

Every span has 16 elements and 30 points; a solve is one compiled call, with prediction, Newton's method, the count of
negative eigenvalues that tells stability, correction, estimate of the error, and sampling. A grip moves by a millimetre
from one solve to the next. Sizes are measured in turns, so that other load on the machine moves all of them; times are
medians. --draw: a picture of them.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import sys
from collections.abc import Callable
from pathlib import Path
from time import perf_counter
from typing import NamedTuple

import numpy as np
from figures import Figures, bench_options, bench_parser, finish, heading, machine
from networks import TURNS, Net, Piece, Point, Rod, even, frame_along
from scipy.spatial.transform import Rotation
from tqdm import tqdm

from cable_shape.kernels.network.guess import HANGING
from cable_shape.kernels.network.newton import CONVERGED, I_EXCESS, I_ITERATIONS

SPANS = (3, 10, 20, 40, 100)
ELEMENTS, POINTS = 16, 30
SPAN = 0.3  # m
CHORD = 0.85 * SPAN
SECTION = Piece(SPAN, (0.01, 0.01, 0.008), weight=0.5)
ASKED = {3: 70.0, 20: 350.0}  # us
BURST, UNCOUNTED = 10, 2  # steps in a turn, and those of them that find the processor's caches full of other networks
STEP = 1e-3  # m, of the grip that moves, from one solve to the next


def plain(_: int) -> Net:
    """One cable between two grips."""
    along = frame_along((1.0, 0.0, 0.2))
    ends = Point((0.0, 0.0, 0.0), along), Point((CHORD, 0.02, 0.0), along)
    return Net(ends, [Rod((0, 1), [SECTION], even(SPAN, ELEMENTS))], POINTS)


def in_clips(spans: int) -> Net:
    """One cable in ball clips, in a wavy line."""
    x = np.arange(spans + 1) * CHORD
    places = np.stack((x, 0.03 * np.sin(2.0 * x), 0.02 * np.cos(3.0 * x)), axis=1)
    ways = np.gradient(places, axis=0)
    inside = range(1, spans)
    points = [Point(p, frame_along(w), TURNS if k in inside else (0.0, 0.0, 0.0))
              for k, (p, w) in enumerate(zip(places, ways, strict=True))]  # fmt: skip
    whole = Piece(spans * SPAN, SECTION.stiffness, weight=SECTION.weight)
    return Net(points, [Rod(tuple(range(spans + 1)), [whole], even(spans * SPAN, *[ELEMENTS] * spans))],
               POINTS * spans)  # fmt: skip


def tree(spans: int) -> Net:
    """Junctions of three arms, and of four where the number asks for it; grips at all tips."""
    points = [Point((0.0, 0.0, 0.0), frame_along((1.0, 0.0, 0.1)))]
    rods: list[Rod] = []

    def arm(start: int, way: np.ndarray) -> tuple[int, np.ndarray]:
        place = np.asarray(points[start].place) + CHORD * way
        points.append(Point(place, frame_along(way)))
        end = len(points) - 1
        frames = {}
        if start > 0:  # it leaves the junction in its own direction
            here = points[start]
            points[start] = Point(here.place, here.rotation, TURNS, True)
            frames[0, 0] = (rotation(here).inv() * rotation(points[end])).as_quat()
        rods.append(Rod((start, end), [SECTION], even(SPAN, ELEMENTS), frames))
        return end, way

    open_ends = [arm(0, np.array((1.0, 0.0, 0.0)))]
    while len(rods) < spans:
        end, way = open_ends.pop(0)
        side = np.cross(way, (0.0, 0.0, 1.0))
        side /= np.linalg.norm(side)
        left = spans - len(rods)
        tilts = (-0.9, 0.9) if left % 2 == 0 else (-1.0, 0.0, 1.0)
        for tilt in tilts[:left]:
            turned = np.cos(0.8 * tilt) * way + np.sin(0.8 * tilt) * side
            open_ends.append(arm(end, turned / np.linalg.norm(turned)))
    return Net(points, rods, POINTS)


def rotation(point: Point) -> Rotation:
    return Rotation.from_quat(point.rotation)


class Case(NamedTuple):
    """A network that moves, and the times of its solves [s]."""

    net: Net
    origin: np.ndarray
    times: list[float]
    iterations: list[float]


def begin(build: Callable[[int], Net], spans: int) -> Case:
    net = build(spans)
    net.settle(kind=HANGING)
    return Case(net, net.trial.pose[0].copy(), [], [])


def step(case: Case, k: int, kept: bool) -> None:
    """One warm solve at step k of a smooth motion of the first grip."""
    net = case.net
    way = 20.0 * STEP * np.array((np.sin(0.05 * k), np.cos(0.065 * k), np.sin(0.035 * k + 1.0)))
    pose = net.trial.pose[0]
    pose[:3] = case.origin[:3] + way
    start = perf_counter()
    code = net.solve(2)
    time = perf_counter() - start
    if code != CONVERGED or net.info[I_EXCESS] != 0.0:
        raise RuntimeError(f"step {k} of {len(net.nodes)} spans ended with {code}, {net.info[I_EXCESS]:g} modes")
    if kept:
        case.times.append(1e6 * time)
        case.iterations.append(net.info[I_ITERATIONS])


def measure(steps: int) -> dict[str, dict[int, Case]]:
    """Warm solves of all networks, in turns."""
    cases = {"plain": {1: begin(plain, 1)}}
    for name, build in (("clips", in_clips), ("tree", tree)):
        cases[name] = {n: begin(build, n) for n in SPANS}
    for begins in tqdm(range(0, steps + BURST, BURST), desc="steps", leave=False, disable=None):
        for sizes in cases.values():
            for case in sizes.values():
                for k in range(begins, begins + BURST):
                    step(case, k, begins > 0 and k >= begins + UNCOUNTED)
    return cases


def draw(medians: dict[str, dict[int, float]], file: Path) -> None:
    """Times over spans, both logarithmic, with what is asked."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(7.0, 4.6), constrained_layout=True)
    n = np.array(SPANS, dtype=float)
    for name, colour, mark in (("tree", "#0b6e4f", "o"), ("clips", "#c2571a", "s")):
        times = np.array([medians[name][k] for k in SPANS])
        label = {"tree": "trees, grips at all tips", "clips": "one cable in ball clips"}[name]
        axes.loglog(n, times, mark + "-", color=colour, label=label)
    one = medians["plain"][1]
    axes.loglog([1.0], [one], "D", color="#333333", label=f"plain cable, {one:.0f} µs")
    line = np.array((1.0, 120.0))
    axes.loglog(line, medians["tree"][20] / 20.0 * line, ":", color="#888888", label="slope 1")
    axes.loglog(list(ASKED), list(ASKED.values()), "v", color="#a01030", mfc="none", ms=9, label="at most, asked")
    axes.set_xlabel("spans, of 16 elements and 30 points each")
    axes.set_ylabel("warm solve [µs], median")
    axes.set_xticks([1, *SPANS], [str(k) for k in (1, *SPANS)])
    axes.set_xticks([], minor=True)
    axes.grid(which="both", alpha=0.25)
    axes.legend(frameon=False)
    axes.set_title("Cost of a warm solve, with estimate, stability and sampling", fontsize=11)
    file.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(file, dpi=130)


def main() -> int:
    """The table."""
    parser = bench_parser(__doc__, "a fifth of the steps")
    parser.add_argument("--draw", type=Path, metavar="FILE", help="a picture of the times over the spans")
    options = bench_options(parser)
    figures = Figures()
    print(machine())
    cases = measure(100 if options.quick else 500)
    medians = {name: {n: float(np.median(case.times)) for n, case in sizes.items()} for name, sizes in cases.items()}
    heading("A warm solve, microseconds, median; Newton's iterations")
    plain_one = medians["plain"][1]
    print(f"plain cable {plain_one:28.1f} {np.mean(cases['plain'][1].iterations):6.1f}")
    for name, sizes in cases.items():
        if name == "plain":
            continue
        for n, case in sizes.items():
            time = medians[name][n]
            print(f"{name:8} {n:4} spans {time:20.1f} {np.mean(case.iterations):6.1f}"
                  f"   {time / n:6.1f} a span, {time / n / plain_one:.2f} of a plain cable")  # fmt: skip
    for n, bound in ASKED.items():
        for name in ("tree", "clips"):
            figures.at_most(f"{name}, {n} spans, warm", medians[name][n], bound, "{:.0f}", " us")
    for name in ("tree", "clips"):
        slope = np.polyfit(np.log(SPANS), np.log([medians[name][n] for n in SPANS]), 1)[0]
        figures.at_most(f"{name}, slope of log time over log spans", slope, 1.05, "{:.2f}")
    if options.draw is not None:
        draw(medians, options.draw)
    return finish(figures, options)


if __name__ == "__main__":
    sys.exit(main())
