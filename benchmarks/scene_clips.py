"""Clips in figures: references, random scenes from nothing, and the time of a warm step beside the plain cable's.

`print_clips()` prints tables; times are medians of steps taken in turn in one run.
"""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path
from time import perf_counter

import numpy as np
from cosserat_speed import CABLE, END, START, motion
from figures import Figures, heading
from scipy.spatial.transform import Rotation

import cable_shape as cs
from cable_shape.command.reference_case import reference_case
from cable_shape.solve import cosserat
from cable_shape.solve.network import Network
from cable_shape.solve.problem import Problem

#: of a warm step's time, beside the plain cable's
ASKED = {"2 ball clips": 1.5, "2 fixed clips": 1.5, "1 eyelet": 2.0}  #: times the plain cable's warm step
CASES = Path(__file__).resolve().parents[2] / "shared" / "cases"
ALONG_X = Rotation.from_quat((0.5, 0.5, 0.5, 0.5))


def print_references(folder: Path, figures: Figures) -> None:
    """Every reference shape with clips, from nothing: mean error / length, largest error of a clip's force."""
    worst = worst_force = 0.0
    for path in sorted(folder.glob("public/*clip*.json")):
        values = json.loads(path.read_text())
        case, answer = reference_case(values), values["solution"]
        shape = cs.predict(case.cable, case.start, case.end, model="cosserat", points=41, scene=case.scene,
                           gravity=values["gravity"])  # fmt: skip
        error = np.linalg.norm(shape.positions - answer["r"], axis=1).mean() / shape.length
        jumps = [np.subtract(event["force_after"], event["force_before"]) for event in answer["events"]]
        forces = max(np.abs(load.force - jump).max() for load, jump in zip(shape.clips, jumps, strict=True))
        forces /= np.abs(answer["n"]).max()
        print(f"{path.stem:18} {error:.1e} L, force on the clip {forces:.1e}, {shape.status.name}")
        worst, worst_force = max(worst, error), max(worst_force, forces)
    figures.at_most("references with clips: mean error / L, worst", worst, 1e-5)
    figures.at_most("references with clips: force on a clip, worst", worst_force, 5e-3)


def random_scene(rng: np.random.Generator, kinds: tuple[str, ...]) -> tuple[cs.Cable, cs.Scene, cs.Pose, cs.Pose]:
    """One to four clips, chords of 0.3 to 0.995 of their spans, frames turned at random, soft to stiff."""
    length = 1.2
    bend = 0.981 * (length * np.exp(rng.uniform(np.log(0.01), np.log(3.0)))) ** 3
    cable = cs.Cable(length, 0.1, bend, bend * rng.uniform(0.5, 1.0))
    count = rng.integers(1, 5)
    arcs = np.zeros(0)
    while arcs.size == 0 or np.diff((0.0, *arcs, length)).min() < 0.05 * length:
        arcs = np.sort(rng.uniform(0.05, 0.95, count)) * length
    places = [np.zeros(3)]
    for span in np.diff((0.0, *arcs, length)):
        direction = np.array((1.0, 0.0, 0.0)) + 0.5 * rng.normal(size=3)
        places.append(places[-1] + span * rng.uniform(0.3, 0.995) * direction / np.linalg.norm(direction))
    poses = [cs.Pose(r, (Rotation.from_rotvec(0.5 * rng.normal(size=3)) * ALONG_X).as_quat()) for r in places]
    clips = [cs.Clip(s, pose, rng.choice(kinds)) for s, pose in zip(arcs, poses[1:-1], strict=True)]
    return cable, cs.Scene(clips=clips), poses[0], poses[-1]


def print_random(count: int, kinds: tuple[str, ...], figures: Figures) -> None:
    """How many random scenes are solved from nothing, how fast, and whether the error estimate is honest.

    The true error is against the solution for a tolerance 4^6 times smaller, whose elements are a quarter as long.
    """
    rng = np.random.default_rng(2024)
    statuses: Counter[str] = Counter()
    times, ratios, elements = [], [], []
    for _ in range(count):
        cable, scene, start, end = random_scene(rng, kinds)
        problem = Problem(cable, scene=scene).move(start, end)
        state = Network(problem)
        shape = cosserat.solve(problem, state)
        statuses[shape.status.name] += 1
        times.append(shape.solve_time)
        if shape.status is cs.Status.OK:
            coarse = state.elements
            fine = cosserat.solve(
                Problem(cable, scene=scene, tolerance=problem.tolerance / 4**6).move(start, end), state
            )
            if fine.status:
                ratios.append(shape.error_estimate / np.linalg.norm(shape.positions - fine.positions, axis=1).max())
                elements.append((coarse, state.elements / coarse))
    ratio = np.array(ratios)
    mean, finer = np.mean(elements, axis=0)
    named = ", ".join(dict.fromkeys(kinds))
    print(
        f"{count} random scenes from nothing, clips {named}: {dict(statuses)}, median {1e3 * np.median(times):.2f} ms, "
        f"{mean:.0f} elements; {ratio.size} compared with meshes {finer:.1f} times finer, "
        f"estimate / error {np.median(ratio):.1f}"
    )
    figures.at_least(f"{named}: solved from nothing", 100.0 * statuses["OK"] / count, 99.5, "{:.1f}", " %")
    figures.at_least(f"{named}: true error at most the estimate", 100.0 * (ratio >= 1).mean(), 99.0, "{:.1f}", " %")
    figures.at_least(f"{named}: estimate at most 10 times it", 100.0 * (ratio <= 10).mean(), 80.0, "{:.1f}", " %")


def print_speed(figures: Figures) -> None:
    """Warm steps along a motion with no, one, two and ten clips, taken in turn."""
    free = cs.predict(CABLE, START, END, model="cosserat", points=241)
    scenes: dict[str, cs.Scene | None] = {"no clip": None}
    for name, nodes, kind in (
        ("1 ball clip", (80,), "ball"),
        ("2 ball clips", (80, 160), "ball"),
        ("2 fixed clips", (80, 160), "fixed"),
        ("10 ball clips", tuple(range(20, 201, 20)), "ball"),
        ("1 eyelet", (80,), "slide"),
        ("2 eyelets", (80, 160), "slide"),
    ):
        poses = [cs.Pose(free.positions[i] + (0.0, 0.0, 0.01), free.quaternions[i]) for i in nodes]
        clips = [cs.Clip(free.arc_length[i], pose, kind) for i, pose in zip(nodes, poses, strict=True)]
        scenes[name] = cs.Scene(clips=clips)
    predictors = {name: cs.Predictor(CABLE, model="cosserat", scene=scene) for name, scene in scenes.items()}
    times: dict[str, list[float]] = {name: [] for name in scenes}
    iterations: dict[str, list[int]] = {name: [] for name in scenes}
    for _ in range(3):
        for predictor in predictors.values():
            predictor.predict(START, END)
        for pose in motion():
            end = cs.Pose(END.position + 0.2 * (pose.position - END.position), pose.quaternion)
            for name, predictor in predictors.items():
                began = perf_counter()
                shape = predictor.predict(START, end)
                times[name].append(perf_counter() - began)
                iterations[name].append(shape.iterations)
                assert shape.status is cs.Status.OK, (name, shape)
    plain = np.median(times["no clip"])
    for name, spent in times.items():
        print(
            f"warm step, {name:14} {1e6 * np.median(spent):6.1f} us (99 % {1e6 * np.percentile(spent, 99):.0f} us), "
            f"{np.median(spent) / plain:.2f} times the plain cable's, {np.mean(iterations[name]):.1f} iterations"
        )
    for name, asked in ASKED.items():
        figures.at_most(f"warm step, {name}: times the plain cable's", np.median(times[name]) / plain, asked, "{:.2f}")


def print_clips(figures: Figures, folder: Path = CASES, count: int = 300) -> None:
    """All tables."""
    heading("Clips: references from nothing, random scenes, warm steps")
    if folder.is_dir():
        print_references(folder, figures)
    print_random(count, ("ball", "fixed", "hinge"), figures)
    print_random(count, ("slide", "ball", "slide"), figures)
    print_speed(figures)
