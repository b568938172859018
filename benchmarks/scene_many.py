"""What bodies of many triangles or points cost: warm steps on them, clearance, and steps far from them."""

from __future__ import annotations

import numpy as np
from clocks import Turns
from figures import Figures, heading
from scene_clearance import ball_mesh

import cable_shape as cs
from cable_shape.safety.clearance import ClearanceChecker
from cable_shape.scene.scene import Solid

ALONG_X = (0.5, 0.5, 0.5, 0.5)
CABLE = cs.Cable(length=1.2, linear_density=0.1, bending_stiffness=0.01, twisting_stiffness=0.008, diameter=0.008)
FEW, MANY = 100, 100_000
RADIUS = 0.15  # m
PLACE = (0.55, 0.04, -0.04)
#: Of the few triangles' times those of the many: warm steps, and clearance, as their trees are deep, log(MANY / 4) to
#: log(FEW / 4). Of a step far from a sphere one that far from them.
STEP, CLEARANCE, FAR = 2.0, 3.2, 1.5


def solids() -> dict[str, Solid]:
    """A ball as what it is, of few and many triangles, and a cloud of spheres of 5 mm."""
    k = np.arange(MANY) + 0.5
    z, turn = 1.0 - 2.0 * k / MANY, np.pi * (1.0 + np.sqrt(5.0)) * k
    around = np.sqrt(1.0 - z**2)
    cloud = (RADIUS - 0.005) * np.stack((around * np.cos(turn), around * np.sin(turn), z), axis=1)
    return {
        "sphere": cs.Sphere(RADIUS),
        f"{FEW} triangles": ball_mesh(RADIUS, FEW),
        f"{MANY} triangles": ball_mesh(RADIUS, MANY),
        f"{MANY} points": cs.Points(cloud, 0.005),
    }


def ends(k: int) -> tuple[cs.Pose, cs.Pose]:
    """Step k of a smooth motion over the ball, from above it."""
    way = np.array((0.01 * np.sin(0.05 * k), 0.005 * np.sin(0.03 * k), 0.22 + 0.1 * np.exp(-0.1 * k)))
    return cs.Pose(way, ALONG_X), cs.Pose(way + np.array((1.1, 0.0, 0.0)), ALONG_X)


def stepped(scenes: dict[str, cs.Scene], steps: int) -> tuple[Turns, dict[str, cs.CableShape]]:
    """Times of warm steps among bodies, in turns, and the last shapes."""
    predictors = {name: cs.Predictor(CABLE, scene=scene, model="cosserat") for name, scene in scenes.items()}
    turns, last = Turns(), {}
    for k in range(steps):
        where = ends(k)
        for name, predictor in predictors.items():
            last[name] = turns.of(name if k > 50 else "on the way", lambda p=predictor, w=where: p.predict(*w))
            if not last[name].usable:
                print(f"{name}, step {k}: {last[name]}")
    return turns, last


def print_many(figures: Figures, steps: int = 600) -> None:
    """Medians, and how many times those of the few triangles they are."""
    heading(f"Bodies of many parts: a ball, of {FEW} and of {MANY} triangles or points")
    made = solids()
    scenes = {
        name: cs.Scene(obstacles=[cs.Obstacle("ball", solid, cs.Pose(PLACE))], contact="solve")
        for name, solid in made.items()
    }
    turns, last = stepped(scenes, steps)
    checkers = {name: ClearanceChecker(scene, cable=CABLE) for name, scene in scenes.items()}
    clear = Turns()
    for _ in range(50):
        for name, checker in checkers.items():
            clear.of(name, lambda c=checker, n=name: c.check(last[n]))
    print(f"{'':20s} {'step':>8s} {'clearance':>10s}  [us, medians]")
    for name in made:
        print(f"{name:20s} {1e6 * turns.medians[name]:8.1f} {1e6 * clear.medians[name]:10.1f}")
    few, many = f"{FEW} triangles", f"{MANY} triangles"
    _print_far(figures, made[many], steps)
    figures.at_most(f"warm step on {many}: times that on {FEW}", _times(turns, many, few), STEP, "{:.2f}")
    figures.at_most(f"clearance to {many}: times that to {FEW}", _times(clear, many, few), CLEARANCE, "{:.2f}")


def _print_far(figures: Figures, solid: Solid, steps: int) -> None:
    """The same of a body half a metre below the cable."""
    away = cs.Pose((0.55, 0.0, -1.0))
    scenes = {
        "far": cs.Scene(obstacles=[cs.Obstacle("ball", solid, away)], contact="solve"),
        "alone": cs.Scene(obstacles=[cs.Obstacle("ball", cs.Sphere(RADIUS), away)], contact="solve"),
    }
    turns, _ = stepped(scenes, steps)
    print(
        f"half a metre away {1e6 * turns.medians['far']:.1f} us, a sphere there {1e6 * turns.medians['alone']:.1f} us"
    )
    name = f"warm step far from {MANY} triangles: times that far from a sphere"
    figures.at_most(name, _times(turns, "far", "alone"), FAR, "{:.2f}")


def _times(turns: Turns, name: str, other: str) -> float:
    return turns.medians[name] / turns.medians[other]
