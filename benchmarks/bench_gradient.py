"""How fast and how right the gradient cables are: scripts/bench gradient [--quick] [--save FILE] [--compare FILE].

Ratios of times within one run are what counts; the machine's other work moves both. 150 points through
`Predictor.predict` between ends that move, so that nothing is reused, beside scipy's solve_bvp on the same equations
with the tension unknown and the length as one more state (tolerance 1e-3), from a parabola on ten nodes. Then a warm
step of every model along the motion M.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import sys
from typing import Any

import numpy as np
from clocks import Turns
from figures import Figures, bench_options, bench_parser, finish
from gradient_bvp import GradientBvp
from problems import ALONG_X, CABLE, END, GRASPS, START, motion
from tqdm import tqdm

import cable_shape as cs
from cable_shape.solve.problem import Problem

POINTS = 150
GOAL = 250.0
MODELS = ("cosserat", "gradient4", "gradient6", "catenary")
#: [us], asked of a warm step of gradient4.
STEP = 20.0

#: name -> cable, start, end
PROBLEMS = GRASPS | {
    "slack (0.33 L)": (CABLE, START, cs.Pose((0.4, 0.0, 0.0), ALONG_X)),
    "very taut (0.995 L)": (CABLE, START, cs.Pose((1.194, 0.0, 0.0), ALONG_X)),
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
    turns, converged = Turns("warm", "cold", "solve_bvp"), True
    for turn in range(repeats):
        part = ends[40 * turn : 40 * turn + 40]
        for target in part:
            shape = turns.of("warm", lambda t=target: predictor.predict(start, t))
            assert not shape.reused
            assert shape.status is cs.Status.OK, shape
        for target in part[:10]:
            fresh = cs.Predictor(cable, model=model, points=POINTS)
            turns.of("cold", lambda f=fresh, t=target: f.predict(start, t))
        if converged:
            reference = GradientBvp(Problem(cable).move(start, part[0]), order)
            converged = bool(turns.of("solve_bvp", lambda r=reference: r.solve(1e-3)).success)
    shape = cs.predict(cable, start, end, model=model, points=POINTS)
    distance = float("nan")
    if converged:
        exact = GradientBvp(Problem(cable).move(start, end), order)
        answer = exact.solve(1e-5, last=exact.solve(1e-3))
        if answer.success:
            distance = float(np.abs(shape.positions - exact.positions(answer, POINTS)).max()) / cable.length
    rod = cs.predict(cable, start, end, model="cosserat", points=POINTS)
    medians = turns.medians
    return {
        "problem": name,
        "order": order,
        "warm_us": 1e6 * medians["warm"],
        "cold_us": 1e6 * medians["cold"],
        "solve_bvp_ms": 1e3 * medians["solve_bvp"],
        "ratio": medians["solve_bvp"] / medians["warm"] if converged else float("nan"),
        "distance_to_solve_bvp": distance,
        "distance_to_rod": float(np.linalg.norm(shape.positions - rod.positions, axis=1).mean()) / cable.length,
        "error_estimate": shape.error_estimate / cable.length,
    }


def warm_steps(count: int) -> dict[str, float]:
    """Median time [us] of a step along the motion M in so many poses, of each model, in three rounds of all."""
    poses, turns = motion(count), Turns(*MODELS)
    for _ in range(3):
        for model in MODELS:
            predictor = cs.Predictor(CABLE, model=model, points=POINTS)
            predictor.predict(START, END)
            for pose in poses:
                turns.of(model, lambda p=predictor, to=pose: p.predict(START, to))
    return {model: 1e6 * spent for model, spent in turns.medians.items()}


def main() -> int:
    """The tables."""
    args = bench_options(bench_parser(__doc__, "a fifth of the repeats"))
    cs.warm_up()
    jobs = [(name, order) for order in (4, 6) for name in PROBLEMS]
    rows = [measured(name, order, 3 if args.quick else 15) for name, order in tqdm(jobs, desc="speed", unit="problem")]
    print(f"{POINTS} points, one core; distances are / L, that to the rod a mean, its estimate the largest")
    print(
        f"{'problem':<22}{'order':>5}{'warm':>9}{'cold':>9}{'solve_bvp':>11}{'ratio':>7}"
        f"{'to solve_bvp':>14}{'to the rod':>12}{'estimate':>10}"
    )
    for r in rows:
        times = f"{r['warm_us']:>6.0f} µs{r['cold_us']:>6.0f} µs{r['solve_bvp_ms']:>8.1f} ms{r['ratio']:>7.0f}"
        distances = f"{r['distance_to_solve_bvp']:>14.1e}{r['distance_to_rod']:>12.1e}{r['error_estimate']:>10.1e}"
        print(f"{r['problem']:<22}{r['order']:>5}{times}{distances}")
    steps = warm_steps(200 if args.quick else 2000)
    told = (f"{model} {spent:.1f} us, {spent / steps['cosserat']:.2f} of the rod's" for model, spent in steps.items())
    print(f"\na warm step of the motion M: {'; '.join(told)}")
    collected = Figures()
    collected.at_most("gradient4, warm step of the motion M", steps["gradient4"], STEP, "{:.1f}", " us")
    ratios, apart = ([r[key] for r in rows] for key in ("ratio", "distance_to_solve_bvp"))
    collected.at_least("least ratio to solve_bvp, warm", float(np.nanmin(ratios)), GOAL, "{:.0f}")
    collected.at_most("largest distance to solve_bvp / L", float(np.nanmax(apart)), 1e-4)
    return finish(collected, args, tables={"speed": rows, "warm_steps": [steps]})


if __name__ == "__main__":
    sys.exit(main())
