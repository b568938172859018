"""Where a cycle's time goes, and what starting costs: phases that sum to the whole, import time, memory."""

from __future__ import annotations

import subprocess
import sys
from time import perf_counter

import numpy as np
from evidence_pages import Pages, figures, table
from evidence_skip import NAME, Job, jobs
from tqdm import tqdm

import cable_shape as cs

PHASES = ("predict", "clearance", "margins", "warnings")

STARTUP = """
import resource, sys, time
def memory():
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * resource.getpagesize() / 2**20
began, bare = time.process_time(), memory()
import cable_shape as cs
imported, after_import = time.process_time(), memory()
cs.Cycle, cs.Cable, cs.Scene, cs.Pose
loaded, after_load = time.process_time(), memory()
cable, along_x = cs.Cable(1.2, 0.1, 0.01), (0.5, 0.5, 0.5, 0.5)
start, places = cs.Pose((0, 0, 0), along_x), [0.7 + 1e-3 * (k % 50) for k in range(int(sys.argv[1]))]
ends = [cs.Pose((x, 0.3, -0.1), along_x) for x in places]
cycle = cs.Cycle(cable, model="cosserat")
cycle.step({"cable": (start, ends[0])}, stamp=0)
first, after_first = time.process_time(), memory()
for k, end in enumerate(ends[1:10], 1):
    cycle.step({"cable": (start, end)}, stamp=k * 10**7)
after_ten = memory()
for k, end in enumerate(ends[10:], 10):
    cycle.step({"cable": (start, end)}, stamp=k * 10**7)
after_all, then = memory(), time.process_time()
cs.predict_batch, cs.check_trajectory, cs.calibrate
planning = time.process_time() - then
print(imported - began, loaded - imported, first - loaded, planning)
print(bare, after_import, after_load, after_first, after_ten, after_all, memory())
"""


def phases(job: Job) -> tuple[dict[str, float], float]:
    """Share of each phase in the mean cycle, and what is outside them, of the wall time around `step`; and that [s]."""
    cycle = cs.Cycle(job.cable, scene=job.scene)
    spent = dict.fromkeys((*PHASES, "bookkeeping"), 0.0)
    whole = 0.0
    for _ in range(2):  # the first round compiles what is not yet
        cycle.reset()
        spent = dict.fromkeys(spent, 0.0)
        whole = 0.0
        for k, grips in enumerate(job.grips):
            began = perf_counter()
            report = cycle.step({NAME: grips}, stamp=job.period * (k + 1))
            wall = perf_counter() - began
            whole += wall
            for phase in PHASES:
                spent[phase] += report.times[phase]
            spent["bookkeeping"] += wall - sum(report.times[phase] for phase in PHASES)
    return {phase: value / whole for phase, value in spent.items()}, whole / len(job.grips)


def startup(cycles: int, rounds: int) -> tuple[np.ndarray, np.ndarray]:
    """Medians: (4,) import, names of a cycle, first cycle, names of planners and calibration [s, of the processor].

    And (7,) memory [MiB] bare, then after import, names, first, ten and all cycles, and the other names.
    """
    runs = [
        subprocess.run(
            (sys.executable, "-c", STARTUP, str(cycles)), check=True, timeout=600, stdout=subprocess.PIPE, text=True
        ).stdout.splitlines()
        for _ in range(rounds)
    ]
    times, memory = (np.median([np.array(run[k].split(), dtype=np.float64) for run in runs], axis=0) for k in (0, 1))
    return times, memory


def evidence(pages: Pages) -> None:
    """Two tables."""
    rows = []
    for job in tqdm(jobs(pages.quick), desc="profile", unit="motion", leave=False, disable=None):
        shares, seconds = phases(job)
        parts = [f"{100.0 * shares[phase]:.0f} %" for phase in (*PHASES, "bookkeeping")]
        rows.append((job.name, *parts, f"{100.0 * sum(shares.values()):.0f} %", figures(1e3 * seconds)))
    pages.add(
        "performance",
        "## Where a cycle's time goes",
        "Mean shares of the wall time around `Cycle.step`; bookkeeping is what is in none of the phases.",
        table(("motion", *PHASES, "bookkeeping", "sum", "mean cycle [ms]"), rows),
    )
    cycles = 20 if pages.quick else 10_000
    times, memory = startup(cycles, 1 if pages.quick else 3)
    seconds = ("-", *(f"{t:.2f}" for t in times[:3]), "-", "-", f"{times[3]:.2f}")
    stages = (
        "Python alone",
        "import cable_shape, which loads a name's module when it is first used",
        "the names of a cycle (Cycle, Cable, Scene, Pose)",
        "first cycle, kernels cached",
        "after ten cycles",
        f"after {cycles:,} cycles",
        "predict_batch, check_trajectory, calibrate, only where they are used",
    )
    rows = [(stage, spent, f"{size:.0f}") for stage, spent, size in zip(stages, seconds, memory, strict=True)]
    pages.figures.at_most("first cycle of a process, kernels cached, processor time", times[2], 1.0, "{:.2f}", " s")
    pages.add("performance", "## Starting", table(("", "processor time [s]", "resident memory [MiB]"), rows))
