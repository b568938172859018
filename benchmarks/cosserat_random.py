"""Random problems for the rod: success from nothing, and honesty of the error estimate."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from figures import Figures
from scipy.spatial.transform import Rotation
from tqdm import tqdm

import cable_shape as cs
from cable_shape.solve import cosserat
from cable_shape.solve.network import Network
from cable_shape.solve.problem import Problem

LENGTH = 1.2
ALONG_X = Rotation.from_quat((0.5, 0.5, 0.5, 0.5))

Grasp = tuple[cs.Cable, cs.Pose, cs.Pose]


def random_quaternion(rng: np.random.Generator) -> np.ndarray:
    """(4,)."""
    q = rng.normal(size=4)
    return q / np.linalg.norm(q)


def cable_of(rng: np.random.Generator, least: float, most: float) -> cs.Cable:
    """(EI/w)^(1/3) from `least` to `most` L."""
    bend = 0.981 * (LENGTH * math.exp(rng.uniform(math.log(least), math.log(most)))) ** 3
    return cs.Cable(LENGTH, 0.1, bend, bend * rng.uniform(0.5, 1.0))


def random_grasp(rng: np.random.Generator) -> Grasp:
    """Chord 0.02 to 0.9999 L, any rotations, (EI/w)^(1/3) from 0.01 to 3 L."""
    cable, direction = cable_of(rng, 0.01, 3.0), rng.normal(size=3)
    chord = rng.uniform(0.02, 0.9999) * LENGTH * direction / np.linalg.norm(direction)
    return cable, cs.Pose((0, 0, 0), random_quaternion(rng)), cs.Pose(chord, random_quaternion(rng))


def taut_grasp(rng: np.random.Generator) -> Grasp:
    """Chord 0.97 to 0.9999 L, log-uniform in the slack, any rotations, (EI/w)^(1/3) from 0.005 to 0.3 L."""
    cable, direction = cable_of(rng, 0.005, 0.3), rng.normal(size=3)
    slack = math.exp(rng.uniform(math.log(1e-4), math.log(0.03)))
    chord = (1.0 - slack) * LENGTH * direction / np.linalg.norm(direction)
    return cable, cs.Pose((0, 0, 0), random_quaternion(rng)), cs.Pose(chord, random_quaternion(rng))


def random_scene(rng: np.random.Generator, kinds: tuple[str, ...]) -> tuple[cs.Cable, cs.Scene, cs.Pose, cs.Pose]:
    """One to four clips, chords of 0.3 to 0.995 of their spans, frames turned at random, soft to stiff."""
    cable, length = cable_of(rng, 0.01, 3.0), LENGTH
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


class Asked(NamedTuple):
    """Shares [%] of the shapes: true errors within the tolerance, and estimates at most ten times the true error."""

    within: float | None = None
    sharp: float | None = 80.0


def grade(
    name: str,
    count: int,
    make: Callable[[np.random.Generator], tuple[cs.Cable, cs.Scene | None, cs.Pose, cs.Pose]],
    figures: Figures,
    asked: Asked,
) -> None:
    """How many have a shape from nothing, and whether their error estimates are honest."""
    rng = np.random.default_rng(2024)
    statuses: Counter[str] = Counter()
    ratios, errors, times, elements = [], [], [], []
    for _ in tqdm(range(count), desc=name, leave=False, disable=None):
        cable, scene, start, end = make(rng)
        problem = Problem(cable, scene=scene).move(start, end)
        state = Network(problem)
        shape = cosserat.solve(problem, state)
        statuses[shape.status.name] += 1
        times.append(shape.solve_time)
        elements.append(state.elements)
        if shape.status is not cs.Status.OK:
            continue
        # what the most elements cannot bring to 1e-8 still serves where it is far better than the shape in question
        tight = Problem(cable, scene=scene, tolerance=1e-8 * cable.length)
        fine = cosserat.solve(tight.move(start, end), state)
        error = float(np.linalg.norm(shape.positions - fine.positions, axis=1).max())
        if fine.status and fine.error_estimate < 0.1 * max(error, shape.error_estimate):
            ratios.append(shape.error_estimate / error)
            errors.append(error / problem.tolerance)
    ratio = np.array(ratios)
    median, late = 1e3 * np.percentile(times, (50, 99))
    print(
        f"{name}: {dict(statuses)}; median {median:.2f} ms, 99 % {late:.2f} ms, {np.median(elements):.0f} elements; "
        f"{len(ratios)} judged, largest true error / estimate {1.0 / ratio.min():.2f}"
    )
    usable = 100.0 * sum(statuses[s.name] for s in cs.Status if s) / count
    figures.at_least(f"{name}: solved from nothing", usable, 99.5, "{:.1f}", " %")
    figures.at_least(f"{name}: true error at most the estimate", 100.0 * (ratio >= 1.0).mean(), 99.0, "{:.1f}", " %")
    if asked.within is not None:
        within = 100.0 * (np.array(errors) <= 1.0).mean()
        figures.at_least(f"{name}: true error at most the tolerance", within, asked.within, "{:.1f}", " %")
    if asked.sharp is not None:
        sharp = 100.0 * (ratio <= 10.0).mean()
        figures.at_least(f"{name}: estimate at most 10 times the true error", sharp, asked.sharp, "{:.1f}", " %")


def without_scene(make: Callable[[np.random.Generator], Grasp]) -> Callable:
    """A maker of grasps as one of problems."""

    def made(rng: np.random.Generator) -> tuple[cs.Cable, None, cs.Pose, cs.Pose]:
        cable, start, end = make(rng)
        return cable, None, start, end

    return made
