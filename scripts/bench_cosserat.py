#!/usr/bin/env python
"""Figures of the Cosserat predictor: accuracy, order, critical loads, robustness, self-grading, speed.

    scripts/bench cosserat [--quick] [--cases FOLDER]

Prints tables. Times are medians on this machine, the others' measured in the same run; FOLDER holds reference cases
(default: ../shared/cases beside the repository), parts that need it are left out where it is missing.
"""

from __future__ import annotations

import argparse
import json
import math
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from time import perf_counter

import numpy as np
from cosserat_critical import critical_values
from cosserat_speed import print_speed
from scipy.spatial.transform import Rotation, Slerp

from cable_shape.cable import Cable
from cable_shape.cases.reference import reference_case
from cable_shape.models import cosserat
from cable_shape.models.rod_state import RodState
from cable_shape.pose import FreeEnd, Pose
from cable_shape.problem import Problem
from cable_shape.shape import CableShape, Status

CASES = Path(__file__).resolve().parents[2] / "shared" / "cases"
ALONG_X = Rotation.from_quat((0.0, math.sqrt(0.5), 0.0, math.sqrt(0.5)))  # d3 = x, d2 = y


def heading(text: str) -> None:
    """A line above a table."""
    print(f"\n## {text}", flush=True)


def along_approach(values: dict, steps: int = 20) -> CableShape:
    """The shape reached along a case's approach, or from nothing where it has none; loads on a free end are ramped."""
    case = reference_case(values)
    options = {"points": 41, "scene": case.scene, "gravity": values["gravity"]}
    if isinstance(case.end, FreeEnd):
        full = Problem(case.cable, **options)
        state = RodState(full)
        for t in np.linspace(0.0, 1.0, steps + 1)[1:]:
            problem = Problem(case.cable, **{**options, "gravity": t * np.array(values["gravity"])})
            end = FreeEnd(case.end.mass, t * case.end.force, t * case.end.moment)
            shape = cosserat.solve(problem.move(case.start, end), state)
        return shape
    if "approach" not in values:
        return cosserat.solve(Problem(case.cable, **options).move(case.start, case.end))
    path, length = values["approach"], case.cable.length
    origin, goal = np.array(values["start"]["position"]), np.array(values["end"]["position"])
    first = origin + np.array((0.97 * length, 0.0, 0.0))
    state = None
    for t in np.linspace(0.0, 1.0, steps + 1):
        start = Rotation.from_rotvec(t * np.array(path["start_rotvec"])) * ALONG_X
        twist = Rotation.from_rotvec((0.0, 0.0, t * path["end_twist"]))
        end = Rotation.from_rotvec(t * np.array(path["end_rotvec"])) * ALONG_X * twist
        cable = case.cable.replace(rest_curvature=t * np.array(case.cable.rest_curvature))
        problem = Problem(cable, **options)
        problem.move(Pose(origin, start.as_quat()), Pose((1 - t) * first + t * goal, end.as_quat()))
        state = state or RodState(problem)
        shape = cosserat.solve(problem, state)
    return shape


def beside(values: dict) -> CableShape:
    """The shape found from a start beside the answer: the frames of the solution, interpolated and disturbed."""
    case, solution = reference_case(values), values["solution"]
    problem = Problem(case.cable, points=41, gravity=values["gravity"]).move(case.start, case.end)

    def frames(s: np.ndarray) -> np.ndarray:
        between = Slerp(solution["s"], Rotation.from_quat(solution["q_xyzw"]))(np.clip(s, 0.0, solution["s"][-1]))
        bump = 0.02 * np.sin(math.pi * s / s[-1])[:, None] * np.array((1.0, 0.6, 0.3))
        q = (Rotation.from_rotvec(bump) * between).as_quat()
        q[1:] *= np.cumprod(np.sign((q[1:] * q[:-1]).sum(axis=1)))[:, None]
        return q

    return cosserat.solve_beside(problem, RodState(problem), frames, solution["n"][-1])


def error_of(shape: CableShape, values: dict) -> float:
    """Mean distance at equal arc length / length; where the plane is free, after the best turn about the chord."""
    expected = np.array(values["solution"]["r"])
    length = values["cable"]["length"]
    direct = np.linalg.norm(shape.positions - expected, axis=1).mean() / length
    chord = expected[-1] - expected[0]
    if not values["name"].startswith(("elastica", "postbuckled")) or not np.any(chord):
        return float(direct)
    axis = (0.0, 0.0, 1.0) if values["end"] is None else chord / np.linalg.norm(chord)
    if values["end"] is None:
        axis = Rotation.from_quat(values["start"]["quaternion_xyzw"]).apply((0.0, 0.0, 1.0))
    best = direct
    a, b = shape.positions - expected[0], expected - expected[0]
    flat_a, flat_b = a - np.outer(a @ axis, axis), b - np.outer(b @ axis, axis)
    angle = math.atan2((np.cross(flat_a, flat_b) @ axis).sum(), (flat_a * flat_b).sum())
    turned = Rotation.from_rotvec(angle * np.asarray(axis)).apply(a)
    return float(min(best, np.linalg.norm(turned - b, axis=1).mean() / length))


def print_references(folder: Path) -> None:
    """Every reference shape without clips: mean error / length at default settings, and the status."""
    heading("Reference shapes, default tolerance: mean error / L (bound 1e-5)")
    worst, count, other = 0.0, 0, []
    for path in sorted(folder.glob("public/*.json")) + sorted(folder.glob("published/*.json")):
        values = json.loads(path.read_text())
        if values.get("kind", "shape") != "shape" or values.get("clips") or "arch" in path.stem:
            continue
        public = path.parent.name == "public"
        neutral = path.stem.startswith(("elastica", "localised"))
        shape = along_approach(values) if public or not neutral else beside(values)
        error = error_of(shape, values)
        worst, count = max(worst, error), count + 1
        if error > 1e-5 or not shape.status:
            other.append(path.stem)
        if error > 1e-5 or not shape.status or not public:
            print(f"{path.stem:38} {error:9.1e}  {shape.status.name}", flush=True)
    print(f"{count} shapes, largest {worst:.1e}; above 1e-5 or not usable: {', '.join(other) or 'none'}")


def print_order(folder: Path) -> None:
    """Error against the reference and elements for three tolerances."""
    heading("Order: mean error / L for tolerances that fall by 16, and the elements they take")
    for name in (
        "grasp_02",
        "grasp_rotated_03",
        "extensible_04",
        "free_end_08",
        "rest_curvature_06",
        "grasp_twisted_05",
    ):
        case_path = folder / "public" / f"{name}.json"
        values = json.loads(case_path.read_text())
        case, row = reference_case(values), []
        for tolerance in (4e-6, 2.5e-7, 1.5625e-8):
            options = {"points": 41, "scene": case.scene, "gravity": values["gravity"]}
            problem = Problem(case.cable, tolerance=tolerance * case.cable.length, **options)
            state = RodState(problem.move(case.start, case.end))
            shape = cosserat.solve(problem, state)
            error = np.linalg.norm(shape.positions - values["solution"]["r"], axis=1).mean() / case.cable.length
            row.append((state.elements, float(error)))
        (a, ea), (b, eb) = row[0], row[-1]
        cells = "  ".join(f"N {n:3} {e:.1e}" for n, e in row)
        order = math.log(ea / eb) / math.log(b / a) if b > a else math.nan
        print(f"{name:20} {cells}  order {order:.1f}")


def random_grasp(rng: np.random.Generator) -> tuple[Cable, Pose, Pose]:
    """Chord 0.02 to 0.9999 L, any rotations, (EI/w)^(1/3) from 0.01 to 3 L."""
    length = 1.2
    bend = 0.981 * (length * math.exp(rng.uniform(math.log(0.01), math.log(3.0)))) ** 3
    cable = Cable(
        length=length, linear_density=0.1, bending_stiffness=bend, twisting_stiffness=bend * rng.uniform(0.5, 1.0)
    )
    direction = rng.normal(size=3)
    chord = rng.uniform(0.02, 0.9999) * length * direction / np.linalg.norm(direction)
    return cable, Pose((0, 0, 0), _random_quaternion(rng)), Pose(chord, _random_quaternion(rng))


def _random_quaternion(rng: np.random.Generator) -> np.ndarray:
    q = rng.normal(size=4)
    return q / np.linalg.norm(q)


def print_robustness(count: int) -> None:
    """Random grasps from nothing, random jumps, and whether the error estimate is honest."""
    heading(f"{count} random grasps from nothing; the true error is against a tolerance 1000 times finer")
    rng = np.random.default_rng(2024)
    statuses: Counter[str] = Counter()
    ratios, residuals, times = [], [], []
    for _ in range(count):
        cable, start, end = random_grasp(rng)
        problem = Problem(cable).move(start, end)
        state = RodState(problem)
        shape = cosserat.solve(problem, state)
        statuses[shape.status.name] += 1
        times.append(shape.solve_time)
        if shape.status is Status.OK:
            fine = cosserat.solve(Problem(cable, tolerance=1e-8 * cable.length).move(start, end), state)
            if fine.status:
                ratios.append(shape.error_estimate / np.linalg.norm(shape.positions - fine.positions, axis=1).max())
            residuals.append(shape.residual)
    ratio = np.array(ratios)
    print(
        f"status {dict(statuses)}; median {np.median(times) * 1e3:.2f} ms, 99 % {np.percentile(times, 99) * 1e3:.2f} ms"
    )
    print(f"true error at most the estimate: {100 * (ratio >= 1).mean():.1f} % (asked 99)")
    print(f"estimate at most 10 times the true error: {100 * (ratio <= 10).mean():.1f} % (asked 80)")
    print(f"largest local residual of an OK: {max(residuals):.1e}")
    heading(f"{count} jumps of up to 0.3 m and 150 degrees, against the branch that 20 small steps reach")
    agree: Counter[str] = Counter()
    for _ in range(count):
        while True:
            cable, start, end = random_grasp(rng)
            shift, turn = (rng.uniform(0, 1) * v / np.linalg.norm(v) for v in rng.normal(size=(2, 3)))
            far = end.position + 0.3 * shift
            if 0.02 < np.linalg.norm(far) / cable.length < 0.9999:
                break
        problem = Problem(cable, points=50)
        state, small = RodState(problem.move(start, end)), RodState(problem)
        cosserat.solve(problem, state)
        cosserat.solve(problem, small)
        turn *= math.radians(150)
        target = Rotation.from_quat(end.quaternion)
        shape = cosserat.solve(problem.move(start, Pose(far, (Rotation.from_rotvec(turn) * target).as_quat())), state)
        for t in np.linspace(0.05, 1.0, 20):
            q = (Rotation.from_rotvec(t * turn) * target).as_quat()
            path = cosserat.solve(problem.move(start, Pose(end.position + t * 0.3 * shift, q)), small)
        same = np.abs(path.positions - shape.positions).max() < 1e-3 * cable.length
        agree[f"{shape.status.name}, {'same' if same else 'other'} branch"] += 1
    print("; ".join(f"{k}: {v}" for k, v in agree.most_common()))


def print_sweep() -> None:
    """Chord 0.05 to 1.05 L and back."""
    heading("Chord 0.05 to 1.05 L and back in 400 steps, EA infinite and 1 kN")
    for axial in (None, 1e3):
        cable = Cable(length=1.2, linear_density=0.1, bending_stiffness=0.01, axial_stiffness=axial)
        problem = Problem(cable)
        state, statuses, finite = None, Counter(), True
        for chord in np.concatenate((np.linspace(0.05, 1.05, 200), np.linspace(1.05, 0.05, 200))):
            q = ALONG_X.as_quat()
            problem.move(Pose((0, 0, 0), q), Pose((chord * 1.2, 0, 0), q))
            state = state or RodState(problem)
            shape = cosserat.solve(problem, state)
            statuses[shape.status.name] += 1
            finite &= bool(np.isfinite(shape.buffer).all())
        print(f"EA {axial}: {dict(statuses)}, every number finite: {finite}")


def main() -> None:
    """All tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="a tenth of the random problems")
    parser.add_argument("--cases", type=Path, default=CASES, help="folder of the reference cases")
    options = parser.parse_args()
    began = perf_counter()
    tables: list[Callable[[], None]] = []
    if options.cases.is_dir():
        tables += [lambda: print_references(options.cases), lambda: print_order(options.cases)]
    else:
        print(f"{options.cases} is not here: no reference shapes, no order. Give --cases FOLDER.")
    tables += [critical_values, lambda: print_robustness(100 if options.quick else 1000), print_sweep, print_speed]
    for table in tables:
        table()
    print(f"\n{perf_counter() - began:.0f} s")


if __name__ == "__main__":
    main()
