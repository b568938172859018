"""model="auto": which model it takes how often, whether its error estimate is honest, and what each choice costs."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Iterator
from time import perf_counter

import numpy as np
from cosserat_figures import Figures, heading
from cosserat_random import random_grasp
from scipy.spatial.transform import Rotation

import cable_shape as cs
from cable_shape.problem import AUTO_TOLERANCE

Grasp = tuple[cs.Cable, cs.Pose, cs.Pose]
MODELS = ("catenary", "gradient4", "cosserat")
#: Boundary layers / length between which costs are put together.
LAYERS = (0.0, 3e-4, 1e-3, 3e-3, 1e-2, 3e-2, 1.0)
STEPS, REPEATS = 40, 7


def taut_grasp(rng: np.random.Generator) -> Grasp:
    """Where closed forms are in use: slack 3e-5 to 0.2 L, ends near the chord, (EI/w)^(1/3) from 0.003 to 0.3 L."""
    length = 1.2
    bend = 0.981 * (length * math.exp(rng.uniform(math.log(0.003), math.log(0.3)))) ** 3
    cable = cs.Cable(length, 0.1, bend, twisting_stiffness=bend * rng.uniform(0.5, 1.0))
    chord = rng.normal(size=3)
    chord /= np.linalg.norm(chord)
    ends = []
    for place in (np.zeros(3), (1.0 - 10.0 ** rng.uniform(-4.5, -0.7)) * length * chord):
        tangent = chord + rng.choice((0.02, 0.1, 0.3)) * rng.normal(size=3)
        frame, _ = Rotation.align_vectors([tangent / np.linalg.norm(tangent)], [(0.0, 0.0, 1.0)])
        ends.append(cs.Pose(place, (frame * Rotation.from_rotvec((0.0, 0.0, rng.uniform(-3.0, 3.0)))).as_quat()))
    return cable, ends[0], ends[1]


def drifting(rng: np.random.Generator, cable: cs.Cable, end: cs.Pose) -> Iterator[cs.Pose]:
    """Ends of a small motion around a grasp that keeps its slack."""
    slack = 1.0 - float(np.linalg.norm(end.position)) / cable.length
    shift, turn = rng.normal(size=(2, 3))
    for k in range(STEPS):
        x = 1e-3 * math.sin(0.3 * k)
        position = end.position + x * min(1.0, 5.0 * slack) * cable.length * shift
        position *= min(1.0, (1.0 - 0.3 * slack) * cable.length / float(np.linalg.norm(position)))
        yield cs.Pose(position, (Rotation.from_rotvec(1.5 * x * turn) * Rotation.from_quat(end.quaternion)).as_quat())


def seconds(run: Callable[[], cs.CableShape]) -> tuple[float, cs.CableShape]:
    """How long it took, and what came."""
    began = perf_counter()
    shape = run()
    return perf_counter() - began, shape


def print_honesty(name: str, grasp: Callable[[np.random.Generator], Grasp], count: int, figures: Figures) -> None:
    """Choice and error estimate against the rod at a tolerance of 1e-8 of the length, or the finest it reaches."""
    rng, chosen = np.random.default_rng(2024), defaultdict(list)
    unknown = 0
    for _ in range(count):
        cable, start, end = grasp(rng)
        shape = cs.predict(cable, start, end)
        fine = cs.predict(cable, start, end, model="cosserat", tolerance=1e-8 * cable.length)
        error = float(np.linalg.norm(shape.positions - fine.positions, axis=1).max())
        if shape.status is not cs.Status.OK or not fine.error_estimate <= 1e-2 * max(error, 1e-12):
            unknown += 1  # no stable shape, or no better one to compare with
        else:
            chosen[shape.model].append((shape.error_estimate / error, error / cable.length))
    print(f"{name}: {count} grasps, {unknown} not compared")
    for model in (*MODELS, "all"):
        rows = [row for key, values in chosen.items() if model in (key, "all") for row in values]
        if rows:
            ratio, error = np.array(rows).T
            print(
                f"  {model:10} {len(rows):5}  true error at most the estimate {100 * (ratio >= 1).mean():5.1f} % "
                f"(asked 99), estimate at most 10 times the true error {100 * (ratio <= 10).mean():5.1f} % (asked 80), "
                f"largest error {error.max():.1e} L (asked {AUTO_TOLERANCE:g})"
            )
    figures.at_least(f"auto, {name}: true error at most the estimate", 100 * (ratio >= 1).mean(), 99.0, unit=" %")
    figures.at_least(f"auto, {name}: estimate at most 10 times it", 100 * (ratio <= 10).mean(), 80.0, unit=" %")


def print_cost(grasp: Callable[[np.random.Generator], Grasp], count: int) -> None:
    """Time of "auto" / time of the rod for the same tolerance, alternating in one run, by model and boundary layer."""
    rng, table = np.random.default_rng(7), defaultdict(list)
    for _ in range(count):
        cable, start, end = grasp(rng)
        tolerance = AUTO_TOLERANCE * cable.length
        kinds = {"auto": {"model": "auto"}, "rod": {"model": "cosserat", "tolerance": tolerance}}
        spent = {key: [] for key in kinds}
        for _ in range(REPEATS):
            for key, keywords in kinds.items():
                spent[key].append(seconds(lambda k=keywords, c=cable, a=start, b=end: cs.predict(c, a, b, **k))[0])
        cold = np.median(spent["auto"]) / np.median(spent["rod"])
        first = cs.predict(cable, start, end)
        pull = float(np.linalg.norm(first.force[[0, -1]], axis=1).max())
        layer = math.sqrt(cable.mean_bending_stiffness / pull) / cable.length if pull > 0.0 else 1.0
        predictors = {key: cs.Predictor(cable, **keywords) for key, keywords in kinds.items()}
        spent, models = {key: [] for key in kinds}, []
        for i, pose in enumerate(drifting(rng, cable, end)):
            for key in sorted(predictors, reverse=i % 2 == 1):  # neither always has the warmer cache
                time, shape = seconds(lambda p=predictors[key], a=start, b=pose: p.predict(a, b))
                spent[key].append(time)
                if key == "auto":
                    models.append(shape.model)
        warm = np.median(spent["auto"]) / np.median(spent["rod"])
        bin_of = int(np.searchsorted(LAYERS, layer)) - 1
        table[first.model, min(bin_of, len(LAYERS) - 2)].append((cold, warm, models.count(first.model) / len(models)))
    print('cost of "auto" / cost of the rod at the same tolerance: median (90 %)')
    for model in MODELS:
        for i in range(len(LAYERS) - 1):
            if rows := table[model, i]:
                cold, warm, kept = np.array(rows).T
                print(
                    f"  {model:10} layer {LAYERS[i]:.0e} to {LAYERS[i + 1]:.0e} L {len(rows):4}  cold "
                    f"{np.median(cold):.2f} ({np.percentile(cold, 90):.2f})  warm {np.median(warm):.2f} "
                    f"({np.percentile(warm, 90):.2f}), this model in {100 * kept.mean():.0f} % of the steps"
                )


def print_sixth_order(count: int) -> None:
    """How often the gradient cable of 6th order is within tolerance where neither catenary nor 4th order is."""
    rng, within, alone = np.random.default_rng(5), 0, 0
    for _ in range(count):
        cable, start, end = taut_grasp(rng)
        rod = cs.predict(cable, start, end, model="cosserat")
        if rod.status is cs.Status.OK:
            errors = {}
            for model in ("catenary", "gradient4", "gradient6"):
                shape = cs.predict(cable, start, end, model=model)
                apart = float(np.linalg.norm(shape.positions - rod.positions, axis=1).max())
                errors[model] = apart / cable.length if shape.status else math.inf
            good = {model for model, error in errors.items() if error <= AUTO_TOLERANCE}
            within += bool(good)
            alone += good == {"gradient6"}
    print(f"a closed form is within tolerance in {within} of {count} taut grasps, the 6th order alone in {alone}")


def print_auto(count: int, figures: Figures) -> None:
    """All of it."""
    heading(f'model="auto" at its tolerance of {AUTO_TOLERANCE:g} L')
    print_honesty("any grasps", random_grasp, count, figures)
    print_honesty("taut grasps", taut_grasp, count, figures)
    print_sixth_order(count)
    print("any grasps, ", end="")
    print_cost(random_grasp, count // 10)
    print("taut grasps, ", end="")
    print_cost(taut_grasp, count // 4)
