"""Harnesses: how fast, and how often there is a shape: scripts/bench harness [--quick] [--save FILE] [--compare FILE].

Times through Python on one core, medians of moves that are none of them reused, 150 points a segment. The tree of 183
segments is drawn by a seed (`harness_random.hung_tree`): a trunk with branches, in 17 clips and a grip. Random
harnesses are trees of 2 to 20 segments, some with loops, ball junctions, masses, clips, rest curvature and segments
that stretch; at every junction forces and moments have to balance, and ends to meet.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from clocks import Turns, clocked
from figures import Figures, bench_options, bench_parser, finish, heading
from harness_random import balance, hung_tree, random_harness
from harness_touching import print_touching
from tqdm import tqdm

import cable_shape as cs

ALONG = (0.0, np.sqrt(0.5), 0.0, np.sqrt(0.5))
CABLE = cs.Cable(length=0.6, linear_density=0.1, bending_stiffness=0.01, twisting_stiffness=0.008)
SEGMENTS, RANDOM, QUICK = 183, 10_000, 600


def star(arms: int) -> tuple[cs.Harness, dict[str, cs.Pose]]:
    """Arms between a grip in the middle of the ceiling and grips around it, in one rigid junction."""
    segments = {"a0": CABLE} | {f"a{i}": CABLE for i in range(1, arms)}
    frames, ends = {}, {"a0.start": cs.Pose((0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))}
    for i in range(1, arms):
        turn = 2.0 * np.pi * i / (arms - 1)
        out = cs.Pose(quaternion=(0.0, 0.0, np.sin(0.5 * turn), np.cos(0.5 * turn))) * cs.Pose(quaternion=ALONG)
        frames[f"a{i}.start"] = cs.Pose(quaternion=(1.0, 0.0, 0.0, 0.0)).inverse() * out
        place = out * cs.Pose((0.0, 0.0, 0.45))
        ends[f"a{i}.end"] = cs.Pose(place.position - np.array((0.0, 0.0, 0.45)), out.quaternion)
    joint = cs.Junction("fork", ("a0.end", *frames), frames=frames)
    return cs.Harness(segments, [joint]), ends


def warm(predictor: cs.Predictor, ends: dict[str, cs.Pose], moved: str, steps: int) -> float:
    """[s], the median of predictions while one grip moves."""
    turns, usable = Turns("step"), 0
    for k in range(steps + 5):
        x, y = 0.01 * (1.0 + np.sin(0.11 * k)), 0.02 * np.cos(0.13 * k)
        pose = ends[moved]
        now = {**ends, moved: cs.Pose(pose.position + np.array((x, y, 0.5 * x)), pose.quaternion)}
        usable += turns.of("step" if k >= 5 else "first", lambda now=now: predictor.predict(now)).usable
    assert usable == steps + 5, f"{steps + 5 - usable} of {steps + 5} without a shape"
    return turns.medians["step"]


def times(figures: Figures, steps: int) -> None:
    """Stars, trees."""
    heading("Stars, warm through Python")
    at = {}
    for arms in (3, 4, 6, 8):
        harness, ends = star(arms)
        at[arms] = 1e6 * warm(cs.Predictor(harness), ends, "a1.end", steps)
        print(f"{arms} arms: {at[arms]:.1f} µs")
    figures.at_most("three arms, warm", at[3], 70.0, "{:.0f}", " µs")
    figures.at_most("an arm more", (at[8] - at[3]) / 5.0, 25.0, "{:.1f}", " µs")
    heading("Trees that hang at clips")
    counts = (12, 23, 46, 92, SEGMENTS)
    warm_times, cold_times = [], []
    for count in counts:
        harness, ends, scene = hung_tree(count)
        cold = []
        for k in range(5):
            away = np.array((0.001 * k, 0.0, 0.0))
            moved = {end: cs.Pose(pose.position + away, pose.quaternion) for end, pose in ends.items()}
            seconds, shape = clocked(lambda h=harness, m=moved, s=scene: cs.predict(h, m, scene=s))
            cold.append(seconds)
        force, moment, gap = balance(shape)
        cold_times.append(float(np.median(cold)))
        warm_times.append(warm(cs.Predictor(harness, scene=scene), ends, "s0.start", steps // 4))
        print(
            f"{count} segments, {len(scene.clips)} clips: {shape.status.name}, cold {1e3 * cold_times[-1]:.1f} ms, "
            f"warm {1e3 * warm_times[-1]:.2f} ms, balance {force:.1e} N, {moment:.1e} N m, {gap:.1e} m"
        )
        figures.check(f"a tree of {count} segments has a stable shape", shape.status is cs.Status.OK)
    figures.at_most(f"a tree of {SEGMENTS} segments, cold", cold_times[-1], 0.5, "{:.3f}", " s")
    figures.at_most(f"a tree of {SEGMENTS} segments, warm", 1e3 * warm_times[-1], 4.0, "{:.2f}", " ms")
    slope = float(np.polyfit(np.log(counts), np.log(warm_times), 1)[0])
    figures.at_most("slope of log warm time over log segments", slope, 1.05, "{:.2f}")


def certificates(figures: Figures, count: int) -> None:
    """Random harnesses: what has a shape is in balance."""
    heading(f"{count} random harnesses of 2 to 20 segments")
    told: dict[str, int] = {}
    out_of_balance, times = 0, []
    for seed in tqdm(range(count), leave=False, disable=None):
        harness, ends, scene = random_harness(np.random.default_rng(seed))
        seconds, shape = clocked(lambda h=harness, e=ends, s=scene: cs.predict(h, e, scene=s))
        times.append(seconds)
        told[shape.status.name] = told.get(shape.status.name, 0) + 1
        if shape.usable:
            force, moment, gap = balance(shape)
            strongest = max(float(np.abs(one.force).max()) for one in shape.segments.values())
            good = force <= 1e-7 + 1e-5 * strongest + shape.force_error
            out_of_balance += not (good and moment <= 1e-7 + shape.moment_error and gap <= 1e-9)
    print(", ".join(f"{name} {number}" for name, number in sorted(told.items())))
    print(f"from nothing: median {1e3 * np.median(times):.1f} ms, 99 % {1e3 * np.percentile(times, 99):.0f} ms")
    without = told.get("NOT_CONVERGED", 0)
    figures.at_most("random harnesses out of balance", out_of_balance, 0, "{:.0f}")
    figures.at_most("random harnesses without a shape", 100.0 * without / count, 0.5, "{:.2f}", " %")


def main() -> int:
    """The whole bench; 0 if all that was asked holds."""
    options = bench_options(bench_parser(__doc__, f"{QUICK} random harnesses in place of {RANDOM}"))
    figures = Figures()
    times(figures, 100 if options.quick else 400)
    certificates(figures, QUICK if options.quick else RANDOM)
    print_touching(figures, 4 if options.quick else 40)
    return finish(figures, options)


if __name__ == "__main__":
    raise SystemExit(main())
