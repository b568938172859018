"""Dense clouds of a cable, half of it hidden: how near, how fast, and how often the start from nothing is right."""

from __future__ import annotations

from time import thread_time
from typing import NamedTuple

import numpy as np
from clocks import clocked
from figures import Figures, heading
from tqdm import tqdm

import cable_shape as cs

COUNT, NOISE, STRAY, HIDDEN = 2000, 3e-3, 0.2, 0.5
ALONG_X = (0.5, 0.5, 0.5, 0.5)
LOOKS, STEP = 10, 10_000_000  # ns
GIVEN = cs.Cable(length=1.0, linear_density=0.05, bending_stiffness=0.004)
NEAR = 3e-3  # m, mean over the cable
RIGHT = 0.02  # m, mean over the cable, from nothing
IN_SIGHT = 0.01  # of the length: an end of which less is seen nobody can find


class Scene(NamedTuple):
    """A cable that is not as it is said to be, between grips that move."""

    cable: cs.Cable
    start: cs.Pose
    ends: list[cs.Pose]


def scene(seed: int) -> Scene:
    """Stiffness by a factor of e^0.5, 3 mm of length, bends, another distance and direction of the grips."""
    rng = np.random.default_rng(seed)
    cable = GIVEN.replace(
        length=1.0 + 0.003 * rng.normal(),
        bending_stiffness=0.004 * np.exp(0.5 * rng.normal()),
        rest_curvature=(*(0.5 * rng.normal(size=2)), 0.0),
    )
    chord, turn, lift = rng.uniform(0.5, 0.85), rng.uniform(-0.6, 0.6), rng.uniform(-0.1, 0.1)
    way = rng.normal(0.0, 0.002, 3)
    place = np.array((chord * np.cos(turn), chord * np.sin(turn), 1.0 + lift))
    return Scene(cable, cs.Pose((0, 0, 1), ALONG_X), [cs.Pose(place + k * way, ALONG_X) for k in range(LOOKS)])


def cloud(shape: cs.CableShape, rng: np.random.Generator) -> tuple[np.ndarray, bool]:
    """(COUNT, 3) [m], in no order, one stretch hidden; whether both ends are in sight."""
    of_cable = round((1.0 - STRAY) * COUNT)
    first = rng.uniform(0.0, 1.0 - HIDDEN)
    at = (1.0 - HIDDEN) * rng.uniform(size=of_cable)
    at[at > first] += HIDDEN
    on = np.stack([np.interp(at * shape.length, shape.arc_length, x) for x in shape.positions.T], axis=1)
    on += NOISE * rng.normal(size=on.shape)
    box = shape.positions.min(axis=0) - 0.1, shape.positions.max(axis=0) + 0.1
    points = rng.permutation(np.concatenate((on, rng.uniform(*box, size=(COUNT - of_cable, 3)))))
    return points, IN_SIGHT < first < 1.0 - HIDDEN - IN_SIGHT


class Tracked(NamedTuple):
    """One scene: mean distance at equal share of the length after the first and last look [m], processor time [s]; and
    whether the first look shows both ends."""

    first: float
    last: float
    start: float
    updates: list[float]
    both: bool


def tracked(seed: int, known: bool) -> Tracked:
    """Grips known, or only seen."""
    there = scene(seed)
    rng = np.random.default_rng(1000 + seed)
    predictor, tracker = cs.Predictor(there.cable, points=101), cs.Tracker(GIVEN, noise=NOISE)
    off, times, both = [], [], []
    for k, end in enumerate(there.ends):
        true = predictor.predict(there.start, end)
        points, in_sight = cloud(true, rng)
        both.append(in_sight)
        told: dict[str, cs.Pose] = {"start": there.start, "end": end} if known else {}

        def look(points: np.ndarray = points, k: int = k, told: dict[str, cs.Pose] = told) -> cs.CableShape:
            return tracker.update(points, stamp=k * STEP, **told)

        seconds, shape = clocked(look, thread_time)
        times.append(seconds)
        ways = (true.positions,) if known else (true.positions, true.positions[::-1])
        off.append(min(float(np.linalg.norm(shape.positions - way, axis=1).mean()) for way in ways))
    return Tracked(off[0], off[-1], times[0], times[1:], both[0])


def print_clouds(figures: Figures, scenes: int) -> None:
    """Both ways."""
    heading(f"Dense clouds: {COUNT} points, {1e3 * NOISE:g} mm, {STRAY:.0%} stray, {HIDDEN:.0%} of the cable hidden")
    tracked(0, True)  # compiles
    for known, name in ((True, "grips known"), (False, "grips only seen")):
        rows = [tracked(seed, known) for seed in tqdm(range(scenes), desc=name, leave=False, disable=None)]
        last = np.array([row.last for row in rows])
        told = f"mean {1e3 * last.mean():.2f} mm, median {1e3 * np.median(last):.2f}, largest {1e3 * last.max():.1f}"
        print(f"{name}: {told}")
        if known:
            figures.at_most("dense clouds, grips known: mean distance", 1e3 * float(last.mean()), 3.0, "{:.2f}", " mm")
            spent = np.concatenate([row.updates for row in rows])
            figures.at_least(
                "dense clouds, grips known: looks a second", 1.0 / float(np.median(spent)), 100.0, "{:.0f}"
            )
        else:
            figures.at_most("dense clouds, grips only seen: median", 1e3 * float(np.median(last)), 3.0, "{:.2f}", " mm")
        start = np.array([row.start for row in rows])
        may = [row for row in rows if known or row.both]
        right = 100.0 * float(np.mean([row.first < RIGHT for row in may]))
        if not known:
            every = 100.0 * float(np.mean([row.first < RIGHT for row in rows]))
            told = f"{len(may)} of {len(rows)} scenes show {IN_SIGHT:.0%} of the cable at both ends"
            print(f"{told}; of all of them {every:.0f} % are right from nothing")
        figures.at_most(
            f"dense clouds, {name}: start from nothing, 95 %", float(np.quantile(start, 0.95)), 0.5, "{:.2f}", " s"
        )
        which = name if known else f"{name}, both ends in sight"
        figures.at_least(f"dense clouds, {which}: right from nothing", right, 99.0, "{:.0f}", " %")
