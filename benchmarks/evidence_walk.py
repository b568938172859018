"""Long random walks of the grips, and the same problems in other units: drift, failures, invariance."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Iterator
from time import process_time

import numpy as np
from cosserat_speed import CABLE, END, START
from evidence_pages import Pages, figures, table
from scipy.spatial.transform import Rotation
from tqdm import tqdm

import cable_shape as cs
from cable_shape.safety.snap import copied
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
LENGTHS = (1e-3, 1e-2, 1e-1, 1.0, 10.0, 100.0)
DECADES = tuple(range(-6, 7))
#: Name: what a metre, a kilogram and a second are in the unit system.
UNITS = {"mm, kg, s": (1e3, 1.0, 1.0), "mm, g, ms": (1e3, 1e3, 1e3), "inch, lb, s": (39.37007874, 2.20462262, 1.0)}


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
            fine = cosserat.solve(tight.move(START, pose), copied(state))
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


def scaled(length: float, stiffness: float, unit_time: float = 1.0) -> tuple[cs.CableShape, float]:
    """Grasp B of a cable `length` long and so stiff, its weight and gravity such that it has the same shape."""
    a = length / CABLE.length
    weight = stiffness / CABLE.bending_stiffness[0] * 0.981 / a**3
    gravity = 9.81 * a / unit_time**2
    cable = cs.Cable(length, weight / gravity, stiffness, 0.8 * stiffness)
    start, end = (cs.Pose(a * pose.position, pose.quaternion) for pose in (START, END))
    problem = Problem(cable, points=41, gravity=(0.0, 0.0, -gravity)).move(start, end)
    return cosserat.solve(problem), a


def invariance(quick: bool) -> list[tuple[str, ...]]:
    """Rows: what was scaled, statuses, iterations, largest difference of positions / length and of forces."""
    own = CABLE.bending_stiffness[0]
    reference, _ = scaled(CABLE.length, own)
    force = np.linalg.norm(reference.force, axis=1).max()

    def apart(shape: cs.CableShape, a: float, stiffness: float) -> tuple[float, float]:
        unit = stiffness / own / a**2
        place = np.abs(shape.positions / a - reference.positions).max() / CABLE.length
        return float(place), float(np.abs(shape.force / unit - reference.force).max() / force)

    rows = []
    for length in LENGTHS[::5] if quick else LENGTHS:
        found = []
        statuses: Counter[str] = Counter()
        for decade in DECADES[::6] if quick else DECADES:
            shape, a = scaled(length, own * 10.0**decade)
            statuses[shape.status.name] += 1
            found.append((shape.iterations, *apart(shape, a, own * 10.0**decade)))
        counts = sorted({f[0] for f in found})
        said = ", ".join(f"{status} {count}" for status, count in statuses.items())
        name = f"length {length:g} m, EI over 12 decades"
        rows.append((name, said, ", ".join(map(str, counts)), *(figures(max(f[i] for f in found)) for i in (1, 2))))
    for name, (metre, kilogram, second) in UNITS.items():
        stiffness = own * kilogram * metre**3 / second**2
        shape, a = scaled(CABLE.length * metre, stiffness, second)
        rows.append((name, shape.status.name, str(shape.iterations), *map(figures, apart(shape, a, stiffness))))
    worst = [0.0, 0.0]
    same = True
    for k, e in itertools.product((-10, 7), (-20, 20)):
        shape, a = scaled(CABLE.length * 2.0**k, own * 2.0**e)
        worst = [max(w, n) for w, n in zip(worst, apart(shape, a, own * 2.0**e), strict=True)]
        same &= shape.iterations == reference.iterations
    counts = str(reference.iterations) if same else "differ"
    rows.append(("lengths and stiffness times powers of 2", "OK", counts, *map(figures, worst)))
    return rows


def evidence(pages: Pages) -> None:
    """Both tables."""
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
    head = ("grasp B", "status", "iterations", "largest difference of positions / L", "of forces / largest")
    pages.add(
        "stability",
        "## Float extremes",
        "The same shape in other sizes: length, stiffness and weight scaled so that only the numbers change, cold. "
        "Iterations of a row that are one number did not depend on the scale.",
        table(head, invariance(pages.quick)),
    )
