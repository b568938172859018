"""How fast and how right the gradient cables are: scripts/bench gradient [--quick] [--save FILE] [--compare FILE].

Ratios of times within one run are what counts; the machine's other work moves both. 150 points through
`Predictor.predict` between ends that move, so that nothing is reused, beside scipy's solve_bvp on the same equations
with the tension unknown and the length as one more state (tolerance 1e-3): from a parabola on ten nodes ("ratio"), and
from its own last answer and mesh ("reusing"). Then a warm step of every model along the motion M.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import json
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from cosserat_speed import END, START, motion
from figures import Figures, bench_options, bench_parser, finish
from gradient_bvp import GradientBvp
from scipy.spatial.transform import Rotation
from tqdm import tqdm

import cable_shape as cs
from cable_shape.command.load_case import load_case
from cable_shape.solve.problem import Problem

POINTS = 150
GOAL = 250.0
MODELS = ("cosserat", "gradient4", "gradient6", "catenary")
#: [us], asked of a warm step of gradient4.
STEP = 20.0
SHARED = Path(__file__).resolve().parents[2] / "shared" / "cases" / "public"
ALONG_X = (0.5, 0.5, 0.5, 0.5)
HALF = np.sqrt(0.5)
CABLE = cs.Cable(length=1.2, linear_density=0.1, bending_stiffness=0.01, twisting_stiffness=0.008)
ORIGIN = cs.Pose((0.0, 0.0, 0.0), ALONG_X)
TURNED = (
    Rotation.from_euler("z", 45, degrees=True)
    * Rotation.from_euler("y", 30, degrees=True)
    * Rotation.from_quat(ALONG_X)
    * Rotation.from_euler("z", 90, degrees=True)
).as_quat()
STIFF = CABLE.replace(bending_stiffness=[0.2, 0.2], twisting_stiffness=0.16)

#: name -> cable, start, end
PROBLEMS: dict[str, tuple[cs.Cable, cs.Pose, cs.Pose]] = {
    "A (chord 0.67 L)": (CABLE, ORIGIN, cs.Pose((0.8, 0.0, 0.0), ALONG_X)),
    "B (turned, in space)": (CABLE, ORIGIN, cs.Pose((0.7, 0.3, -0.1), TURNED)),
    "C (taut, 0.958 L)": (CABLE, ORIGIN, cs.Pose((1.15, 0.0, 0.0), ALONG_X)),
    "D (stiff arch)": (STIFF, cs.Pose((0, 0, 0), (0, 0, HALF, HALF)), cs.Pose((0.5, 0, 0), (HALF, HALF, 0, 0))),
    "slack (0.33 L)": (CABLE, ORIGIN, cs.Pose((0.4, 0.0, 0.0), ALONG_X)),
    "very taut (0.995 L)": (CABLE, ORIGIN, cs.Pose((1.194, 0.0, 0.0), ALONG_X)),
}


def nudged(pose: cs.Pose, k: int) -> cs.Pose:
    """The end a little further along a smooth motion of a millimetre, different at every step."""
    move = 1e-3 * np.array((np.sin(0.1 * k), np.cos(0.13 * k), np.sin(0.07 * k + 1.0)))
    return cs.Pose(pose.position - 1.2e-3 * np.array((1.0, 0.0, 0.0)) + 0.5 * move, pose.quaternion)


def measured(name: str, order: int, repeats: int) -> dict[str, Any]:
    """Times, their ratio and the distance from solve_bvp's answer, for one problem; the two are timed in turns."""
    cable, start, end = PROBLEMS[name]
    model = f"gradient{order}"
    ends = [nudged(end, k) for k in range(40 * repeats)]
    predictor = cs.Predictor(cable, model=model, points=POINTS)
    for target in ends[:20]:
        predictor.predict(start, target)
    warm, cold, bvp, again, converged = [], [], [], [], True
    last = None
    for turn in range(repeats):
        part = ends[40 * turn : 40 * turn + 40]
        for target in part:
            began = time.perf_counter()
            shape = predictor.predict(start, target)
            warm.append(time.perf_counter() - began)
            assert not shape.reused
            assert shape.status is cs.Status.OK, shape
        for target in part[:10]:
            fresh = cs.Predictor(cable, model=model, points=POINTS)
            began = time.perf_counter()
            fresh.predict(start, target)
            cold.append(time.perf_counter() - began)
        if not converged:
            continue
        reference = GradientBvp(Problem(cable).move(start, part[0]), order)
        began = time.perf_counter()
        answer = reference.solve(1e-3)
        answer.sol(np.linspace(0.0, 1.0, POINTS))
        bvp.append(time.perf_counter() - began)
        converged = converged and bool(answer.success)
        if last is not None and last.success:
            began = time.perf_counter()
            reference.solve(1e-3, last=last).sol(np.linspace(0.0, 1.0, POINTS))
            again.append(time.perf_counter() - began)
        last = answer
    shape = cs.predict(cable, start, end, model=model, points=POINTS)
    distance = float("nan")
    if converged:
        exact = GradientBvp(Problem(cable).move(start, end), order)
        answer = exact.solve(1e-5, last=exact.solve(1e-3))
        if answer.success:
            distance = float(np.abs(shape.positions - exact.positions(answer, POINTS)).max()) / cable.length
    rod = cs.predict(cable, start, end, model="cosserat", points=POINTS)
    apart = float(np.linalg.norm(shape.positions - rod.positions, axis=1).mean()) / cable.length
    return {
        "problem": name,
        "order": order,
        "warm_us": 1e6 * float(np.median(warm)),
        "cold_us": 1e6 * float(np.median(cold)),
        "solve_bvp_ms": 1e3 * float(np.median(bvp)),
        "ratio": float(np.median(bvp) / np.median(warm)) if converged else float("nan"),
        "warm_ratio": float(np.median(again) / np.median(warm)) if again and converged else float("nan"),
        "distance_to_solve_bvp": distance,
        "distance_to_rod": apart,
        "error_estimate": shape.error_estimate / cable.length,
    }


def slender(ratio: float) -> dict[str, Any]:
    """Whether the boundary layer may be `ratio` times shorter than the cable."""
    # g = sqrt(B/T) with T about half the weight at this chord
    stiffness = 0.5 * 9.81 * 0.1 * 1.2 * (1.2 / ratio) ** 2
    cable = CABLE.replace(bending_stiffness=[stiffness, stiffness], twisting_stiffness=stiffness)
    out = {"L/g": ratio}
    for model in ("gradient4", "gradient6"):
        up = cs.Pose((0.8, 0.1, 0.0), (HALF, 0.0, 0.0, HALF))
        shape = cs.predict(cable, ORIGIN, up, model=model, points=2001)
        arc = float(np.linalg.norm(np.diff(shape.positions, axis=0), axis=1).sum())
        out[f"{model} status"] = shape.status.name
        out[f"{model} length defect"] = arc / 1.2 - 1.0
    return out


def against_rods() -> list[tuple[str, float, float]]:
    """Mean distance to trusted Cosserat shapes at equal arc length / L, where those references are on this machine."""
    rows = []
    for file in sorted(SHARED.glob("grasp_*.json")):
        case = load_case(file)
        if case.reference is None or case.scene is not None:
            continue
        truth = np.array(json.loads(file.read_text())["solution"]["r"])
        found = []
        for model in ("gradient4", "gradient6"):
            shape = cs.predict(case.cable, case.start, case.end, model=model, points=len(truth))
            found.append(float(np.linalg.norm(shape.positions - truth, axis=1).mean()) / case.cable.length)
        rows.append((file.stem, found[0], found[1]))
    return rows


def warm_steps(count: int) -> dict[str, float]:
    """Median time [us] of a step along the motion M in so many poses, of each model, in three rounds of all."""
    poses = [cs.Pose(pose.position, pose.quaternion) for pose in motion(count)]
    spent: dict[str, list[float]] = {model: [] for model in MODELS}
    for _ in range(3):
        for model, times in spent.items():
            predictor = cs.Predictor(CABLE, model=model, points=POINTS)
            predictor.predict(START, END)
            for pose in poses:
                began = time.perf_counter()
                predictor.predict(START, pose)
                times.append(time.perf_counter() - began)
    return {model: 1e6 * float(np.median(times)) for model, times in spent.items()}


def main() -> int:
    args = bench_options(bench_parser(__doc__, "a fifth of the repeats"))
    cs.warm_up()
    jobs = [(name, order) for order in (4, 6) for name in PROBLEMS]
    rows = [measured(name, order, 3 if args.quick else 15) for name, order in tqdm(jobs, desc="speed", unit="problem")]
    print(
        f"{POINTS} points, one core; ratio = solve_bvp / warm (goal {GOAL:.0f}); reusing: from solve_bvp's last answer"
    )
    print(
        f"{'problem':<22}{'order':>5}{'warm':>9}{'cold':>9}{'solve_bvp':>11}{'ratio':>7}{'reusing':>9}"
        f"{'to solve_bvp':>14}{'to the rod':>12}{'estimate':>10}"
    )
    for r in rows:
        times = f"{r['warm_us']:>6.0f} µs{r['cold_us']:>6.0f} µs{r['solve_bvp_ms']:>8.1f} ms{r['ratio']:>7.0f}"
        times += f"{r['warm_ratio']:>9.0f}"
        distances = f"{r['distance_to_solve_bvp']:>14.1e}{r['distance_to_rod']:>12.1e}{r['error_estimate']:>10.1e}"
        print(f"{r['problem']:<22}{r['order']:>5}{times}{distances}")
    ratios = [r["ratio"] for r in rows if r["ratio"] > 0.0]
    print(
        f"least ratio {min(ratios):.0f}, median {np.median(ratios):.0f}; distances are / L, that to the rod a mean, "
        "its estimate the largest; nan: solve_bvp failed"
    )
    steps = warm_steps(200 if args.quick else 2000)
    told = (f"{model} {spent:.1f} us, {spent / steps['cosserat']:.2f} of the rod's" for model, spent in steps.items())
    print(f"\na warm step of the motion M: {'; '.join(told)}")
    slim = [slender(ratio) for ratio in (40.0, 400.0, 4000.0)]
    print("\nslender cables, polygon of 2001 points:")
    for s in slim:
        print(
            "  "
            + ", ".join(f"{k} {v:.1e}" if isinstance(v, float) and k != "L/g" else f"{k} {v}" for k, v in s.items())
        )
    rods = against_rods()
    if rods:
        print(
            f"\nmean distance to {len(rods)} reference rods / L, 4th and 6th order: "
            f"median {np.median([r[1] for r in rods]):.1e} {np.median([r[2] for r in rods]):.1e}, "
            f"worst {max(r[1] for r in rods):.1e} {max(r[2] for r in rods):.1e}"
        )
    else:
        print(f"\nno reference rods at {SHARED.name}: not compared")
    collected = Figures()
    collected.at_most("gradient4, warm step of the motion M", steps["gradient4"], STEP, "{:.1f}", " us")
    collected.at_least("least ratio to solve_bvp, warm", min(ratios), GOAL, "{:.0f}")
    apart = np.nanmax([r["distance_to_solve_bvp"] for r in rows])
    collected.at_most("largest distance to solve_bvp / L", float(apart), 1e-4)
    return finish(collected, args, tables={"speed": rows, "warm_steps": [steps], "slender": slim, "rods": rods})


if __name__ == "__main__":
    sys.exit(main())
