"""MuJoCo's cable and PyElastica beside `cs.Motion`: a cable whose end is carried aside, and then swings.

The cable of grasp A begins at rest; its end goes 0.16 m in 0.3 s and is held from then on, nothing damps it, and all
are looked at for a second. Errors are mean distances of joints, or points, from the rod on a mesh and in steps so fine
that neither matters. Time is that of the steps alone.
"""

from __future__ import annotations

import math
from itertools import product
from time import thread_time
from typing import Any, NamedTuple

import numpy as np
from evidence_pages import table
from evidence_rivals import Job, python, run, settings
from figures import Figures, heading
from problems import GRASPS
from rivals_common import Swing
from scipy.interpolate import CubicSpline

import cable_shape as cs

GRASP = "A"
WAY, WHOLE, SECONDS, LOOKS = (0.0, 0.15, 0.05), 0.3, 1.0, 10
FINE, SHORT, POINTS = 160, 2.5e-4, 241
MESHES, STEPS = (8, 12, 20, 40), (0.02, 0.01, 0.005, 0.0025, 0.00125)  # elements, s
RIVAL_STEPS, ARMATURES, LINKS = (4e-3, 2e-3, 1e-3, 5e-4, 2e-4), (0.0, 1e-7, 1e-6, 1e-5), (10, 20, 40)
ASKED = 1.0  # a rival's time / the rod's


class Swung(NamedTuple):
    """How something did: with how many elements or links, in what steps [s], mean error / length, time [s]."""

    pieces: int
    step: float
    error: float
    seconds: float


def share(time: float) -> float:
    """Of the way of the end."""
    return Swing(np.zeros(3), WHOLE, (), ()).share(time)


def rod(elements: int, dt: float, points: int = 61) -> tuple[np.ndarray, list[np.ndarray], float]:
    """Arc lengths (n,), points (n, 3) at all looks, and time of the steps [s]."""
    cable, start, end = GRASPS[GRASP]
    motion = cs.Motion(cable, points=points, elements=elements)
    arcs = motion.begin(start, end).arc_length
    lines, spent = [], 0.0
    for k in range(1, round(SECONDS / dt) + 1):
        there = cs.Pose(end.position + share(k * dt) * np.array(WAY), end.quaternion)
        began = thread_time()
        shape = motion.step(start, there, dt)
        spent += thread_time() - began
        if k % round(SECONDS / dt / LOOKS) == 0:
            lines.append(shape.positions)
    return arcs, lines, spent


def print_swings(figures: Figures, quick: bool) -> None:
    """What is fastest at its error of all that was tried of each, and how long the rod takes to be as near."""
    heading("A swing of one second beside simulators: time of the steps, and mean error / L")
    length = GRASPS[GRASP][0].length
    at, exact, _ = rod(FINE, SHORT, POINTS)
    splines = [CubicSpline(at, line) for line in exact]
    own = []
    for elements, dt in product(MESHES[::2], STEPS[:3]) if quick else product(MESHES, STEPS):
        arcs, lines, _ = rod(elements, dt)
        spent = min(rod(elements, dt)[2] for _ in range(1 if quick else 3))
        off = [np.linalg.norm(line - spline(arcs), axis=1).mean() for line, spline in zip(lines, splines, strict=True)]
        own.append(Swung(elements, dt, float(np.mean(off)) / length, spent))
    rows = [["cs.Motion", *told(one), ""] for one in front(own)]
    if python() is None:
        print(table(("", "elements or links", "step [ms]", "mean error / L", "time [ms]", "time / rod"), rows))
        return
    swing = {
        "way": WAY, "whole": WHOLE, "times": [SECONDS * (k + 1) / LOOKS for k in range(LOOKS)],
        "exact_at": at.tolist(), "exact": [line.tolist() for line in exact],
    }  # fmt: skip
    for simulator in ("MuJoCo cable", "PyElastica"):
        version, found = run(simulator, jobs_of(simulator, quick), 1, swing)
        best = front(
            [Swung(one.job.joints, SECONDS / one.steps, one.error, one.seconds) for one in found if one is not None]
        )
        for one in best:
            near = [mine.seconds for mine in own if mine.error <= one.error]
            times = one.seconds / min(near) if near else math.nan
            rows.append([f"{simulator} {version}", *told(one), f"{times:.3g}" if near else "nearer than any"])
        times = [one.seconds / min(mine.seconds for mine in own if mine.error <= one.error) for one in best]
        figures.at_least(f"swing: {simulator} : the rod, at equal error, least", min(times), ASKED, "{:.3g}")
    print(table(("", "elements or links", "step [ms]", "mean error / L", "time [ms]", "time / rod"), rows))


def jobs_of(simulator: str, quick: bool) -> list[Job]:
    """All that is tried."""
    out = []
    for joints in LINKS[:1] if quick else LINKS:
        resting: dict[str, Any] = settings()[simulator][GRASP][str(joints)]
        if simulator == "PyElastica":
            out += [Job(GRASP, joints, {**resting, "strain": strain}) for strain in (0.03, 0.01, 3e-3, 1e-3)]
        else:
            out += [
                Job(GRASP, joints, {**resting, "swing_step": step, "swing_armature": armature})
                for step, armature in product(RIVAL_STEPS, ARMATURES)
            ]
    return out


def front(found: list[Swung]) -> list[Swung]:
    """Those of which no other is as fast and nearer, from the fastest on."""
    out: list[Swung] = []
    for one in sorted(found, key=lambda one: one.seconds):
        if not out or one.error < out[-1].error:
            out.append(one)
    return out


def told(one: Swung) -> list[str]:
    """Cells of the table."""
    return [str(one.pieces), f"{1e3 * one.step:.3g}", f"{one.error:.1e}", f"{1e3 * one.seconds:.3g}"]
