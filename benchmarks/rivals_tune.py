"""Searches time step, damping and the like of the rivals, so that they are compared at their best."""

from __future__ import annotations

import json
from collections.abc import Sequence
from itertools import product
from typing import Any

from evidence_rivals import JOINTS, SETTINGS, Job, Settling, run, settings
from problems import GRASPS
from tqdm import tqdm

#: Of those whose error is at most so many times the least, the one with the fewest steps.
GOOD = 1.3
#: How many settings of a mesh are tried on the next finer one.
KEEP = 4
#: kg m^2 at a bending stiffness of 0.01 N m^2.
MOST_ARMATURE = 0.1
GRIDS: dict[str, dict[str, tuple[float, ...]]] = {
    "MuJoCo cable": {"step": (0.01, 0.02, 0.04), "damping": (4.0, 8.0, 16.0), "armature": (1e-3, 1e-2, 1e-1)},
    "PyElastica": {"strain": (1e-2, 3e-3, 1e-3), "damping": (8.0, 16.0, 32.0), "carry": (0.1, 0.3)},
}


def candidates(simulator: str, before: list[Settling]) -> list[dict[str, float]]:
    """The whole grid on the coarsest mesh; then variations of the best before.

    Softness is what limits the error of both: PyElastica's axial stiffness is made two and four times as large, and
    the weld of MuJoCo's, which stiffens with armature over the square of the time step, ten times as stiff or not.
    """
    if not before:
        grid = GRIDS[simulator]
        return [dict(zip(grid, values, strict=True)) for values in product(*grid.values())]
    if simulator == "MuJoCo cable":
        return [
            {**settling.job.setting, "armature": settling.job.setting["armature"] * factor}
            for settling in before
            for factor in (1.0, 10.0)
            if settling.job.setting["armature"] * factor <= MOST_ARMATURE
        ]
    return [
        {**settling.job.setting, "strain": settling.job.setting["strain"] / factor}
        for settling in before[:KEEP]
        for factor in (2.0, 4.0)
    ]


def ranked(found: list[Settling | None]) -> list[Settling]:
    """Those near the least error, fewest steps first."""
    settled = [settling for settling in found if settling is not None]
    least = min(settling.error for settling in settled)
    return sorted((s for s in settled if s.error <= GOOD * least), key=lambda s: (s.steps, s.error))


def tune(simulators: Sequence[str] = tuple(JOINTS)) -> None:
    """Writes the settings file, those of other simulators as they were; prints what was found."""
    chosen: dict[str, Any] = settings() if SETTINGS.exists() else {}
    for simulator in simulators:
        meshes = JOINTS[simulator]
        chosen[simulator] = {}
        for problem in tqdm(GRASPS, desc=simulator, unit="problem", disable=None):
            chosen[simulator][problem] = {}
            before: list[Settling] = []
            for joints in meshes:
                finest = joints == meshes[-1]
                tried = candidates(simulator, before[: KEEP if finest else None])
                found = ranked(run(simulator, [Job(problem, joints, setting) for setting in tried], 0)[1])
                best = found[0]
                print(
                    f"{simulator} {problem}, {joints:3d} joints: {len(tried)} tried, {best.steps} steps, error "
                    f"{best.error:.1e} / L, {best.job.setting}", flush=True
                )  # fmt: skip
                chosen[simulator][problem][str(joints)] = best.job.setting
                before = found
    SETTINGS.write_text(json.dumps(chosen, indent=1) + "\n", encoding="utf-8")
