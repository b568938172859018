"""What was skipped: every shortcut on and off, in each demo scene: time, and answers equal within the bound."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from time import thread_time
from typing import NamedTuple

import numpy as np
from demo_cell import cable_ends, minimum_jerk
from evidence_pages import Pages, figures, table
from problems import ALONG_X, CABLE, START, motion, planar_motion
from tqdm import tqdm

import cable_shape as cs
from cable_shape.solve.problem import NAMED_TOLERANCE

CONFIG = Path(__file__).resolve().parents[1] / "config"
NAME = "cable"

Ends = tuple[cs.Pose, cs.Pose]


class Job(NamedTuple):
    """A motion in a scene; period [ns] from pose to pose."""

    name: str
    cable: cs.Cable
    scene: cs.Scene | None
    grips: list[Ends]
    period: int = 20_000_000


class Shortcut(NamedTuple):
    """One shortcut: how it is turned off, and what it may change, in tolerances (0: not a bit).

    before, after: called around each step of the cycle without it, within its time; False: the answer is another.
    """

    name: str
    before: Callable[[cs.Cycle], bool]
    after: Callable[[cs.Cycle], bool]
    bound: float


def nothing(cycle: cs.Cycle) -> bool:
    """Leaves a cycle as it is."""
    return True


def all_pairs(cycle: cs.Cycle) -> bool:
    """Every pair of segment and body is looked at."""
    cycle._cables[NAME]._checker.cull = False
    return True


def anew(cycle: cs.Cycle) -> bool:
    """Solves although nothing moved."""
    cycle._cables[NAME].predictor._last = None
    return True


def look_ahead(cycle: cs.Cycle) -> bool:
    """Follows the rod's copy to the horizon although stability does not run out."""
    cable = cycle._cables[NAME]
    if cable._watch.twists is None or cable.predictor.rod_state is None:
        return True
    return cable._snap_within(HORIZON) is None or cable.after_snap is not None


#: [s], of the look ahead: the cycle's own default.
HORIZON = 1.0
SNAP = "snap look-ahead on demand"
SHORTCUTS = (
    Shortcut("culling of bodies", all_pairs, nothing, 0.0),
    Shortcut("reuse of the last shape", anew, nothing, 1.0),
    Shortcut(SNAP, nothing, look_ahead, 0.0),
)


def demo_grips(count: int) -> list[Ends]:
    """The demo's motion, which begins and ends at rest."""
    return [cable_ends(minimum_jerk(t)) for t in np.linspace(0.0, 20.0, count)]


def to_and_fro(poses: list[cs.Pose], rounds: int) -> list[Ends]:
    """A motion of the end there and back, again and again."""
    return [(START, pose) for pose in (*poses, *poses[-2:0:-1])] * rounds


def jobs(quick: bool) -> list[Job]:
    """The scenes that are shipped, and motions without a scene in which other shortcuts matter."""
    count = 40 if quick else 1000
    demo = cs.Cable.from_yaml(CONFIG / "cables" / "demo.yaml")
    cell = cs.Scene.from_yaml(CONFIG / "scenes" / "demo.yaml")
    bodies = cs.Scene.from_yaml(CONFIG / "scenes" / "bench_cell.yaml")
    taut = cs.Cable(length=1.2, linear_density=0.1, bending_stiffness=1e-6)
    x = np.linspace(0.0, 1.0, 40 if quick else 200)
    spans = [cs.Pose((1.194 - 0.004 * v, 0.0, 0.05 * v), ALONG_X) for v in x]
    step, rounds = (5, 1) if quick else (1, 5)
    slow, still = (100_000_000, 500_000_000) if quick else (20_000_000, 20_000_000)  # fewer poses, the same speeds
    return [
        Job("demo.yaml, the demo's motion", demo, cell, demo_grips(count), still),
        Job("bench_cell.yaml, the demo's motion", demo, bodies, demo_grips(count), still),
        Job("no scene, motion M", CABLE, None, to_and_fro(motion()[::step], rounds), slow),
        Job("no scene, planar motion", CABLE, None, to_and_fro(planar_motion()[::step], rounds), slow),
        Job("no scene, taut thin span", taut, None, to_and_fro(spans, rounds), slow),
    ]  # fmt: skip


class Outcome(NamedTuple):
    """Of one job and shortcut: mean times [s] a cycle, largest difference / tolerance, and how often it fired."""

    on: float
    off: float
    apart: float
    fired: int
    cycles: int
    same: bool


def compare(job: Job, shortcut: Shortcut) -> Outcome:
    """Both cycles in turns along the motion."""
    tolerance = NAMED_TOLERANCE * job.cable.length
    with_it, without = (cs.Cycle(job.cable, scene=job.scene) for _ in range(2))
    spent: tuple[list[float], list[float]] = ([], [])
    apart, fired, same = 0.0, 0, True
    for k, grips in enumerate(job.grips):
        reports = {}
        for which in (k % 2, 1 - k % 2):
            cycle = (with_it, without)[which]
            began = thread_time()
            if which == 1:
                same &= shortcut.before(cycle)
            reports[which] = cycle.step({NAME: grips}, stamp=job.period * (k + 1))
            if which == 1:
                same &= shortcut.after(cycle)
            spent[which].append(thread_time() - began)
        on, off = (reports[which].shapes[NAME] for which in (0, 1))
        apart = max(apart, float(np.linalg.norm(on.positions - off.positions, axis=1).max()) / tolerance)
        near = [{b.body: b.distance for b in reports[which].clearance[NAME].bodies} for which in (0, 1)]
        same &= bool((on.buffer == off.buffer).all()) and near[0] == near[1]
        same &= bool(on.status is off.status)
        fired += fires(shortcut, reports[0])
    # the mean, since most fire in some cycles only, without the few in which the machine did something else
    times = [float(np.mean(np.sort(s)[: -max(1, len(s) // 50)])) for s in spent]
    return Outcome(times[0], times[1], apart, fired, len(job.grips), same)


def fires(shortcut: Shortcut, report: cs.CycleReport) -> bool:
    """Whether a shortcut saved something in this cycle."""
    key = {"culling": "pairs_culled", "reuse": "reused", "snap": "snap_checks"}[shortcut.name.split()[0]]
    return report.skipped[key] > 0


def applies(job: Job, shortcut: Shortcut) -> bool:
    """Whether a shortcut can say anything about a job."""
    if shortcut.name == SNAP:
        return job.scene is None or not (job.scene.clips or job.scene.contact == "solve")
    return job.scene is not None or not shortcut.name.startswith("culling")


def holds(shortcut: Shortcut, outcome: Outcome) -> bool:
    """Whether the answers agree as they have to."""
    return outcome.same if shortcut.bound == 0.0 else outcome.apart <= shortcut.bound


def evidence(pages: Pages) -> None:
    """A table, and the ratios of the shipped scenes."""
    rows = []
    cases = [(job, shortcut) for job in jobs(pages.quick) for shortcut in SHORTCUTS]
    for job, shortcut in tqdm(cases, desc="shortcuts", unit="pair", leave=False, disable=None):
        if not applies(job, shortcut):
            continue
        compare(job._replace(grips=job.grips[:: len(job.grips) // 20]), shortcut)  # compiles what is not yet
        found = compare(job, shortcut)
        equal = "to the bit" if found.same else f"{figures(found.apart)} tolerances"
        bound = "to the bit" if shortcut.bound == 0.0 else f"{shortcut.bound:g} tolerances"
        saved = f"{100.0 * (1.0 - found.on / found.off):.0f} %" if found.fired else "-"
        right = "yes" if holds(shortcut, found) else "NO"
        pages.figures.check(f"same answer without {shortcut.name}, {job.name}", right == "yes")
        fired = f"{100.0 * found.fired / found.cycles:.0f} %"
        rows.append((job.name, shortcut.name, fired, saved, equal, bound, right))
        if found.fired:
            pages.ratio(f"cycle with : without {shortcut.name}, {job.name}", found.off / found.on)
    pages.add(
        "performance",
        "## What was skipped",
        "Two cycles side by side along one motion, with a shortcut and without, in turns. Saved: of the mean processor "
        "time of a cycle, clearance and margins included, where it fired. Fired: of the cycles, those in which it "
        "applied. Without the snap look-ahead on demand, every cycle looks ahead, and may find no snap that was not "
        "told. Differences in tolerances are the largest of any point; the tolerance is "
        f"{NAMED_TOLERANCE:g} of the length.",
        table(("motion", "shortcut", "fired", "saved", "difference", "allowed", "holds"), rows),
    )
