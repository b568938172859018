"""Long random walks of the grips: drift and failures."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from time import process_time

import numpy as np
from evidence_pages import Pages, figures, table
from problems import CABLE, END, START
from scipy.spatial.transform import Rotation
from tqdm import tqdm

import cable_shape as cs
from cable_shape.shape import Status
from cable_shape.solve import cosserat
from cable_shape.solve.network import Network
from cable_shape.solve.problem import Problem

#: Cables of the walks: EI [N m^2] of a metre or so at 0.1 kg/m.
STIFFNESS = {"soft": 1e-4, "usual": 1e-2, "stiff": 1.0}
STEPS, STEPS_QUICK = 100_000, 200
#: Time for each walk; what is not reached by then is said.
SECONDS = 60.0
#: Of a walk: mean pull back to the middle, step [m] and turn [rad], standard deviation of a component.
PULL, STEP, TURN = 2e-4, 3e-3, 8e-3
JUDGED = 500


def walk(rng: np.random.Generator, steps: int) -> Iterator[cs.Pose]:
    """Poses of the end about grasp B's, by an Ornstein-Uhlenbeck process, the last on the way back to the first."""
    place, turn = np.zeros(3), np.zeros(3)
    base = Rotation.from_quat(END.quaternion)
    back = min(200, steps // 4)
    for k in range(steps):
        if k < steps - back:
            place = (1.0 - PULL) * place + STEP * rng.normal(size=3)
            turn = (1.0 - PULL) * turn + TURN * rng.normal(size=3)
            reach = np.linalg.norm(END.position + place)
            if reach > 0.98 * CABLE.length:
                place = (END.position + place) * (0.98 * CABLE.length / reach) - END.position
        else:
            left = (steps - 1 - k) / (steps - k)
            place, turn = left * place, left * turn
        yield cs.Pose(END.position + place, (Rotation.from_rotvec(turn) * base).as_quat())


def walked(name: str, quick: bool) -> tuple[str, ...]:
    """One row: steps, statuses, worst error over the tolerance and the estimate, drift, elements."""
    steps = STEPS_QUICK if quick else STEPS
    cable = CABLE.replace(bending_stiffness=STIFFNESS[name], twisting_stiffness=0.8 * STIFFNESS[name])
    problem, tight = Problem(cable, points=41), Problem(cable, points=41, tolerance=1e-9 * cable.length)
    state = Network(problem)
    first = cosserat.solve(problem.move(START, END), state).positions.copy()
    statuses: Counter[str] = Counter()
    worst = worst_ratio = 0.0
    judged = 0
    began = process_time()
    shape = None
    sizes = []
    bar = tqdm(walk(np.random.default_rng(8), steps), total=steps, desc=f"walk, {name}", leave=False, disable=None)
    for k, pose in enumerate(bar):
        shape = cosserat.solve(problem.move(START, pose), state)
        statuses[shape.status.name] += 1
        if k % (JUDGED // 10 if quick else JUDGED) == 0 and shape.status is Status.OK:
            fine = cosserat.solve(tight.move(START, pose), state.copied())
            if fine.status:
                judged += 1
                sizes.append(state.elements)
                error = float(np.linalg.norm(fine.positions - shape.positions, axis=1).max())
                worst = max(worst, error / problem.tolerance)
                worst_ratio = max(worst_ratio, error / shape.error_estimate)
        if process_time() - began > SECONDS:
            break
    bar.close()
    done = sum(statuses.values())
    assert shape is not None
    drift = "-"
    if done == steps:
        away = float(np.linalg.norm(shape.positions - first, axis=1).max()) / cable.length
        drift = figures(away) if shape.turns == 0 else f"{figures(away)} (another winding)"
    failed = done - sum(statuses[s.name] for s in Status if s)
    said = ", ".join(f"{status} {count}" for status, count in statuses.most_common())
    return (
        name, f"{done:,}", said, str(failed), str(judged), figures(worst), figures(worst_ratio), drift,
        f"{min(sizes)} to {max(sizes)}",
    )  # fmt: skip


def evidence(pages: Pages) -> None:
    """The table."""
    rows = [walked(name, pages.quick) for name in STIFFNESS]
    reach = (2.0 * PULL) ** -0.5
    head = (
        "cable", "steps", "status", "failures", "judged", "worst error / tolerance", "worst error / estimate",
        "back at the start: off / L", "elements",
    )  # fmt: skip
    pages.add(
        "stability",
        "## Random walks",
        f"The end of grasp B wanders, {1e3 * STEP:g} mm and {TURN:g} rad a step and axis, {1e3 * STEP * reach:.0f} mm "
        f"and {TURN * reach:.1f} rad from its middle (standard deviations of an axis), and comes back at last. Every "
        "few hundred steps the shape is compared with one of the same branch at a ten thousandth of its tolerance. "
        "Drift: how far the cable is at the end from where it was at the beginning; after snaps it may be another "
        f"stable shape. At most {SECONDS:g} s of processor time a walk.",
        table(head, rows),
    )
