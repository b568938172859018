#!/usr/bin/env python
"""Instructions of a warm step, per model: a figure without noise, to compare commits by, also on a loaded machine.

    scripts/bench instructions [--quick] [--save FILE] [--compare FILE]

A fixed workload runs under valgrind's callgrind, which counts every instruction of Python and of the compiled kernels
between two marks. valgrind knows no recent processor, so the kernels are compiled once more, for a plain x86-64 (some
minutes the first time, cached then); the counts are those of that code. Without valgrind it says so and ends well.
"""

from __future__ import annotations

import argparse
import itertools
import os
import platform
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

from figures import Figures, bench_options, bench_parser, finish, heading

STEPS, STEPS_QUICK = 50, 10
#: The first counted step of a motion, and so many before it.
FIRST, APPROACH = 60, 10
#: A plain processor: what valgrind can run.
PLAIN = {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": "", "PYTHONHASHSEED": "0", "OPENBLAS_NUM_THREADS": "1"}
REMEDY = "no valgrind here, so no instructions are counted: sudo apt-get install valgrind"
NAMES = ("catenary", "gradient4", "gradient6", "rod", "rod, planar motion", "cycle, no scene")


def workloads() -> list[Callable[[int], object]]:
    """What a step is, by name: its number -> a shape or a report; ends move in each."""
    from cosserat_speed import CABLE, START, motion, planar_motion

    import cable_shape as cs

    spatial, planar = motion(), planar_motion()

    def following(model: str, poses: list[cs.Pose]) -> Callable[[int], object]:
        predictor = cs.Predictor(CABLE, model=model)
        return lambda k: predictor.predict(START, poses[k % len(poses)])

    cycle, stamps = cs.Cycle(CABLE), itertools.count(10_000_000, 10_000_000)
    steps = [following(model, spatial) for model in ("catenary", "gradient4", "gradient6", "cosserat")]
    steps.append(following("cosserat", planar))
    return [*steps, lambda k: cycle.step({"cable": (START, spatial[k % len(spatial)])}, stamp=next(stamps))]


def work(steps: int) -> None:
    """Every workload: a mark before and after the counted steps, which have been taken once before, so that nothing is
    loaded in them, and are reached by the steps that lead there."""
    import gc

    gc.disable()
    for step in workloads():
        for k in range(FIRST, FIRST + steps):
            step(k)
        for k in range(FIRST - APPROACH, FIRST):
            step(k)
        os.getsid(0)
        for k in range(FIRST, FIRST + steps):
            step(k)
        os.getsid(0)


def counted(steps: int) -> dict[str, float]:
    """Instructions of a mean step, by name."""
    worker = (sys.executable, __file__, "--steps", str(steps))
    environment = os.environ | PLAIN
    subprocess.run(worker, check=True, env=environment)  # compiles what is not yet
    with tempfile.TemporaryDirectory(prefix="bench_instructions_") as folder:
        out = Path(folder) / "out"
        command = ("valgrind", "-q", "--tool=callgrind", "--dump-before=getsid", f"--callgrind-out-file={out}")
        done = subprocess.run((*command, *worker), env=environment, stderr=subprocess.PIPE, text=True, check=False)
        if done.returncode:
            raise RuntimeError(f"valgrind failed:\n{done.stderr}")
        # dump 1 ends before the first counted steps, 2 after them, and so on
        parts = [Path(f"{out}.{number}") for number in range(2, 2 * len(NAMES) + 1, 2)]
        return {name: total(part) / steps for name, part in zip(NAMES, parts, strict=True)}


def total(part: Path) -> int:
    """Instructions in one dump of callgrind's."""
    lines = part.read_text(encoding="utf-8", errors="replace").splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith(("summary:", "totals:")))


def main(arguments: list[str] | None = None) -> int:
    """One line a model."""
    parser = bench_parser(__doc__, f"{STEPS_QUICK} steps of each instead of {STEPS}")
    parser.add_argument("--steps", type=int, help=argparse.SUPPRESS)
    options = bench_options(parser, arguments)
    if options.steps is not None:
        work(options.steps)
        return 0
    figures = Figures()
    if shutil.which("valgrind") is None or platform.machine() != "x86_64":
        print(REMEDY)
        return finish(figures, options)
    heading("Instructions of a warm step, 150 points, kernels compiled for a plain x86-64")
    for name, count in counted(STEPS_QUICK if options.quick else STEPS).items():
        print(f"{name:28} {count:12,.0f}", flush=True)
        figures.count(f"instructions of a warm step, {name}", count)
    return finish(figures, options)


if __name__ == "__main__":
    raise SystemExit(main())
