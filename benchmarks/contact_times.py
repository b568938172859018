"""Warm steps with some twenty contacts, on a table, with friction, in a channel; and steps that need the road.

Of the steps the compiled calls are timed, iterations, error estimates, looks and points in them, and whole predictions
beside.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from time import thread_time
from typing import Any
from unittest.mock import patch

import numpy as np
from clocks import Turns
from figures import Figures, heading

import cable_shape as cs
from cable_shape.solve.touching import step
from cable_shape.solve.touching.road import Road

ALONG_X = (0.5, 0.5, 0.5, 0.5)
CABLE = cs.Cable(1.2, 0.1, 0.003, 0.003, diameter=0.004)
HALF = math.sqrt(0.5)
OUT, BACK = (0.0, HALF, 0.0, HALF), (0.0, -HALF, 0.0, HALF)
STEPS, SPEED = 200, 1e-4  # of the grips, and by how much they move in each [m]
#: [m], from grip to grip in the middle of the motion: nearer to each other, they would cram the cable in the channel.
CHORD, CHORD_IN_CHANNEL = 1.13, 1.15
ASKED = {"without friction": 80.0, "friction 0.4": 160.0, "in a channel": 160.0}  # us
ASKED_OF_ROAD = 1000.0  # us


def scenes() -> dict[str, cs.Scene]:
    """What the cable lies on, by name."""
    wall = cs.Box((1.0, 0.02, 0.03))
    table, rough = (cs.Obstacle("table", cs.HalfSpace(), friction=rubs) for rubs in (0.0, 0.4))
    walls = [cs.Obstacle(f"wall{y}", wall, cs.Pose((0.565, y, 0.015))) for y in (-0.013, 0.016)]
    bodies = {"without friction": [table], "friction 0.4": [rough], "in a channel": [table, *walls]}
    return {name: cs.Scene(obstacles=found, contact="solve") for name, found in bodies.items()}


def ends(t: float, chord: float) -> tuple[cs.Pose, cs.Pose]:
    """The grips at a time, in the middle of the motion so far [m] apart."""
    start = cs.Pose((0, 0.002 * np.sin(t), 0.03 + 0.02 * np.sin(t)), ALONG_X)
    return start, cs.Pose((chord + 0.01 * np.sin(1.4 * t), start.position[1], start.position[2]), ALONG_X)


@contextmanager
def compiled_calls() -> Iterator[list[float]]:
    """The times [s] of the compiled calls of cables in contact within it."""
    spent: list[float] = []
    solve = step._SOLVE

    def timed(*args: Any) -> Any:
        began = thread_time()
        found = solve(*args)
        spent.append(thread_time() - began)
        return found

    with patch.object(step, "_SOLVE", timed):
        yield spent


def print_times(figures: Figures) -> None:
    """Medians of warm predictions in turns, compiled calls and whole, and ratios to the plain cable's."""
    heading("Warm steps of a cable with many contacts")
    predictors = {name: cs.Predictor(CABLE, scene=scene, model="cosserat") for name, scene in scenes().items()}
    plain = cs.Predictor(CABLE, model="cosserat")
    turns = Turns(*predictors, "plain", clock=thread_time)
    contacts: dict[str, list[int]] = {name: [] for name in predictors}
    compiled: dict[str, list[float]] = {name: [] for name in predictors}
    lost = dict.fromkeys(predictors, 0)
    for k in range(STEPS):
        t = SPEED * k / 0.02
        at = ends(t, CHORD)
        turns.of("plain", lambda at=at: plain.predict(*at))
        for name, predictor in predictors.items():
            at = ends(t, CHORD_IN_CHANNEL if name == "in a channel" else CHORD)
            with compiled_calls() as spent:
                shape = turns.of(name, lambda p=predictor, at=at: p.predict(*at))
            contacts[name].append(len(shape.contacts))
            lost[name] += not shape.usable
            compiled[name].append(sum(spent))
    for name, asked in ASKED.items():
        whole, spent = 1e6 * turns.medians[name], 1e6 * float(np.median(compiled[name]))
        times = turns.medians[name] / turns.medians["plain"]
        print(
            f"{name}: {np.median(contacts[name]):.0f} contacts, whole {whole:.0f} us, {times:.1f} times the plain one; "
            f"{lost[name]} of {STEPS} have no shape"
        )
        figures.at_most(f"compiled calls of a warm step, {name}", spent, asked, "{:.0f}", " us")


def print_road(figures: Figures) -> None:
    """Steps of hairpins drawn against posts, those whose shape the road has led to."""
    heading("Steps that need the road: hairpins drawn against posts")
    spent: list[float] = []
    roads: list[bool] = []
    went = Road.go

    def go(road: Road, *way: Any) -> bool:
        roads.append(went(road, *way))
        return roads[-1]

    with patch.object(Road, "go", go):
        draw(spent, roads)
    print(f"{len(spent)} steps")
    figures.at_most("step that needs the road, median", 1e6 * float(np.median(spent)), ASKED_OF_ROAD, "{:.0f}", " us")


def draw(spent: list[float], roads: list[bool]) -> None:
    """Adds the times of the steps in which a road was gone."""
    for stiffness in (0.0005, 0.002):
        for rubs in (0.0, 0.2):
            post = cs.Obstacle("post", cs.Cylinder(0.04, 2.0), friction=rubs)
            scene = cs.Scene(obstacles=[post], contact="solve")
            predictor = cs.Predictor(cs.Cable(0.8, 0.05, stiffness), model="cosserat", scene=scene)
            for back in np.arange(0.0, 0.31, 0.005):
                ends = cs.Pose((-back, -0.12, 0.0), OUT), cs.Pose((-back, 0.12, 0.0), BACK)
                roads.clear()
                began = thread_time()
                shape = predictor.predict(*ends)
                if shape.usable and roads:
                    spent.append(thread_time() - began)
