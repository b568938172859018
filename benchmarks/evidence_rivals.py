"""MuJoCo's cable and PyElastica on the grasps A to D: how long they take to the equilibrium, and how near they come.

Each runs in a process of the rivals' own environment (see `rivals_common.py`), from the frames that the rod solver
starts from itself, at settings that `scripts/bench rivals --tune` found and wrote to `rivals_settings.json`.
"""

from __future__ import annotations

import json
import os
import subprocess
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
from problems import GRASPS
from rod_bvp import same_guess

import cable_shape as cs

HERE = Path(__file__).resolve().parent
VENV = HERE.parent / ".venv-rivals"
SETTINGS = HERE / "rivals_settings.json"
WORKERS = {"MuJoCo cable": "rivals_mujoco.py", "PyElastica": "rivals_elastica.py"}
JOINTS = {"MuJoCo cable": (10, 20, 40, 80), "PyElastica": (10, 20, 40)}
MISSING = "not measured here: scripts/bench rivals --install makes the environment of MuJoCo 3.17 and PyElastica 1.0."
EXACT, POINTS = 1e-10, 601

#: On the page, beside the figures.
METHOD = (
    "Both simulators step a damped cable through time until it rests; their lines are 10, 20 and 40 links, MuJoCo's "
    "also 80. They start from the frames that the rod solver starts from and are told when they have settled, which "
    "costs them nothing (the error from then on within 10 % of its last); they are timed without set-up, and measured "
    "at their own joints, without interpolation. Time step, damping, MuJoCo's armature and PyElastica's axial "
    "stiffness are those with the fewest steps of a search (`scripts/bench rivals --tune`, kept in "
    "`benchmarks/rivals_settings.json`); half a link lies beyond each grip, so that both are of second order. What "
    "they do and the rod does not: inertia, vibration, friction and contact with everything; and they need not settle "
    "in each cycle of a simulation."
)

Settings = dict[str, dict[str, dict[str, dict[str, float]]]]


class Job(NamedTuple):
    """One simulation to run."""

    problem: str
    joints: int
    setting: dict[str, float]


class Settling(NamedTuple):
    """Mean error / length, time steps, and wall time [s] to the equilibrium."""

    job: Job
    error: float
    steps: int
    seconds: float


def python() -> Path | None:
    """The interpreter of the rivals' environment, if it has been installed."""
    path = VENV / "bin" / "python"
    return path if path.exists() else None


def settings() -> Settings:
    """Simulator, problem, joints -> setting."""
    found: Settings = json.loads(SETTINGS.read_text(encoding="utf-8"))
    return found


def problem_of(name: str) -> dict[str, Any]:
    """A grasp as JSON."""
    cable, start, end = GRASPS[name]
    exact = cs.predict(cable, start, end, model="cosserat", tolerance=EXACT * cable.length, points=POINTS)
    at, states = same_guess(cable, start, end, points=POINTS)
    return {
        "length": cable.length,
        "linear_density": cable.linear_density,
        "bending_stiffness": cable.bending_stiffness[0],
        "twisting_stiffness": cable.twisting_stiffness,
        "tension": float(np.linalg.norm(exact.force, axis=1).max()),
        "start": start.array.tolist(),
        "end": end.array.tolist(),
        "guess_at": at.tolist(),
        "guess": states[3:7].T.tolist(),
        "exact_at": exact.arc_length.tolist(),
        "exact": exact.positions.tolist(),
    }


def run(
    simulator: str, jobs: Sequence[Job], repeats: int = 3, swing: dict[str, Any] | None = None
) -> tuple[str, list[Settling | None]]:
    """The simulator's version, and what became of each job (None: it did not come to rest).

    swing: what `rivals_common.Swing` is read from, where the cables are not to settle, but to swing.
    """
    problems = {name: problem_of(name) for name in dict.fromkeys(job.problem for job in jobs)}
    request = {"problems": problems, "jobs": [job._asdict() for job in jobs], "repeats": repeats}
    if swing is not None:
        request["swing"] = swing
    answer = ask(WORKERS[simulator], request)
    found = [
        None if values is None else Settling(job, values["error"], values["steps"], values["seconds"])
        for job, values in zip(jobs, answer["answers"], strict=True)
    ]
    return answer["version"], found


def ask(worker: str, request: dict[str, Any]) -> dict[str, Any]:
    """What a script in the rivals' environment answers."""
    interpreter = python()
    if interpreter is None:
        raise FileNotFoundError(f"{VENV}: {MISSING}")
    threads = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"}
    outside = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "PYTHONHOME")}
    with TemporaryDirectory(prefix="rivals_") as folder:  # MuJoCo writes its warnings to a file where it runs
        done = subprocess.run(
            (interpreter, HERE / worker), input=json.dumps(request), capture_output=True, text=True,
            check=False, timeout=1800, env=outside | threads, cwd=folder,
        )  # fmt: skip
    if done.returncode:
        raise RuntimeError(f"{worker} failed:\n{done.stderr}")
    answer: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return answer


def measured(quick: bool) -> dict[str, dict[str, list[Settling]]]:
    """Problem, simulator with its version -> points, coarse to fine; empty without the rivals' environment."""
    if python() is None:
        return {}
    out: dict[str, dict[str, list[Settling]]] = {name: {} for name in GRASPS}
    for simulator, by_problem in settings().items():
        jobs = [
            Job(problem, int(joints), setting)
            for problem, by_joints in by_problem.items()
            for joints, setting in by_joints.items()
            if not quick or int(joints) == JOINTS[simulator][0]
        ]
        version, found = run(simulator, jobs, 1 if quick else 3)
        for settling in found:
            if settling is not None:
                out[settling.job.problem].setdefault(f"{simulator} {version}", []).append(settling)
    return out
