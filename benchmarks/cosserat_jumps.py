"""Jumps of the end of a cable, graded by the Cosserat predictor and by following the branch in very small steps.

SNAPPED is to mean that continuity along the straight path of the ends was lost. The judge is a path on a mesh three
times as fine, in steps that turn no frame by more than a few hundredths of a radian and shrink to 1e-8 of the path
before the branch counts as ended. It is walked twice, in finer and coarser steps; a jump on which the two differ is not
judged.
"""

from __future__ import annotations

import math
from collections import Counter

import numpy as np
from cosserat_random import random_grasp
from figures import Figures, heading
from scipy.spatial.transform import Rotation
from tqdm import tqdm

from cable_shape.cable.cable import Cable
from cable_shape.kernels.network import drive
from cable_shape.kernels.network.newton import CONVERGED
from cable_shape.pose import Pose
from cable_shape.shape import CableShape, Status
from cable_shape.solve import cosserat
from cable_shape.solve.network import Network
from cable_shape.solve.problem import Problem
from cable_shape.solve.search import between

POINTS = 50
#: (largest turn of a frame in a step [rad], smallest step as a fraction of the path)
FINER, COARSER = (0.03, 1e-8), (0.1, 1e-6)
Jump = tuple[Cable, Pose, Pose, Pose]


def compiled(state: Network, buffer: np.ndarray, history: int, most: int, far: float) -> int:
    """One compiled solve for the trial of a plain cable, see `drive.solve`."""
    return drive.solve(
        state.ints, state.floats, state.sols, state.work, buffer, state.info, np.empty((0, 7)), state.problem.points,
        history, False, False, True, most, far,
    )  # fmt: skip


def random_jump(rng: np.random.Generator) -> Jump:
    """A cable, its start, and its end before and after: up to 0.3 m and 150 degrees away."""
    while True:
        cable, start, end = random_grasp(rng)
        shift, turn = (rng.uniform(0, 1) * v / np.linalg.norm(v) for v in rng.normal(size=(2, 3)))
        there = end.position + 0.3 * shift
        if 0.02 < np.linalg.norm(there) / cable.length < 0.9999:
            q = Rotation.from_rotvec(math.radians(150) * turn) * Rotation.from_quat(end.quaternion)
            return cable, start, end, Pose(there, q.as_quat())


def follow(jump: Jump, turn: float, smallest: float) -> np.ndarray | None:
    """Positions at the end of the branch's path, or None if the branch ends on the way."""
    cable, start, end, there = jump
    state = Network(Problem(cable, points=POINTS).move(start, end))
    cosserat.solve(state.problem, state)
    # the same branch on a fine mesh, which then stays unless the error grows a hundredfold
    fine = cosserat.solve(Problem(cable, points=POINTS, tolerance=1e-7 * cable.length).move(start, end), state)
    if not fine.status:
        raise RuntimeError(f"no shape to start from: {fine}")
    problem = Problem(cable, points=POINTS, tolerance=1e-6 * cable.length).move(start, end)
    state.take(problem)
    state.aim(problem.start, problem.end)
    origin = state.poses.copy()
    goal = state.aim(problem.start, problem.move(start, there).end)
    buffer = CableShape.new_buffer(POINTS)

    def reached(history: int, iterations: int, far: float) -> bool:
        return compiled(state, buffer, history, iterations, far) == CONVERGED

    done, step, history = 0.0, 0.01, 1
    while done < 1.0:
        at = min(1.0, done + step)
        state.target[...] = between(origin, goal, at)
        if reached(history, 12, turn):
            done, step, history = at, 1.5 * step, 2
            if state.far_too_coarse(state.info.tolist()) and state.next_mesh():
                if not reached(0, 80, 0.1):
                    return None
                history = 1
        else:
            step, history = 0.4 * step, 1
            if step < smallest:
                return None
    return buffer[POINTS : 4 * POINTS].reshape(-1, 3).copy()


def print_jumps(count: int, figures: Figures) -> None:
    """How the predictor grades jumps, against the judge."""
    heading(f"{count} jumps of up to 0.3 m and 150 degrees, against the branch followed in very small steps")
    rng = np.random.default_rng(2025)
    seen: Counter[tuple[str, str]] = Counter()
    for _ in tqdm(range(count), desc="jumps", leave=False, disable=None):
        jump = random_jump(rng)
        cable, start, end, there = jump
        problem = Problem(cable, points=POINTS).move(start, end)
        state = Network(problem)
        cosserat.solve(problem, state)
        shape = cosserat.solve(problem.move(start, there), state)
        finer, coarser = follow(jump, *FINER), follow(jump, *COARSER)
        if (finer is None) != (coarser is None):
            path = "not judged"
        elif finer is None:
            path = "continuity lost"
        else:
            same = np.abs(finer - shape.positions).max() < 1e-3 * cable.length
            path = "continuous, same shape" if same else "continuous, another shape"
        seen[path, shape.status.name] += 1
    for (path, status), times in seen.most_common():
        print(f"{times:5}  path {path}: graded {status}")
    other = sum(seen["continuous, another shape", s.name] for s in Status if s is not Status.SNAPPED)
    alarms = sum(n for (path, status), n in seen.items() if path.startswith("continuous,") and status == "SNAPPED")
    missed = seen["continuity lost", "OK"]
    usable = 100.0 * sum(n for (_, status), n in seen.items() if Status[status]) / count
    figures.at_least("jumps with a usable shape", usable, 99.5, "{:.1f}", " %")
    figures.at_most("jumps on a continuous path to another shape, not graded SNAPPED", other, 0, "{:.0f}")
    figures.at_most("jumps on a continuous path graded SNAPPED", 100.0 * alarms / count, 0.0, "{:.2f}", " %")
    figures.at_most("jumps whose path breaks graded OK", 100.0 * missed / count, 0.5, "{:.2f}", " %")
