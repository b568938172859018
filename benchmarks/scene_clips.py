"""Clips in figures: random scenes from nothing, and the time of a warm step beside the plain cable's.

`print_clips()` prints tables; times are medians of steps taken in turn in one run.
"""

from __future__ import annotations

from clocks import Turns
from cosserat_random import Asked, grade, random_scene
from figures import Figures, heading
from problems import CABLE, END, START, motion

import cable_shape as cs

#: of a warm step's time, beside the plain cable's
ASKED = {"2 ball clips": 1.5, "2 fixed clips": 1.5, "1 eyelet": 2.0}  #: times the plain cable's warm step


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
    turns = Turns(*scenes)
    for _ in range(3):
        for predictor in predictors.values():
            predictor.predict(START, END)
        for pose in motion():
            end = cs.Pose(END.position + 0.2 * (pose.position - END.position), pose.quaternion)
            for name, predictor in predictors.items():
                shape = turns.of(name, lambda p=predictor, e=end: p.predict(START, e))
                assert shape.status is cs.Status.OK, (name, shape)
    times = {name: spent / turns.medians["no clip"] for name, spent in turns.medians.items()}
    for name, spent in turns.medians.items():
        late = turns.percentile(name, 99)
        print(
            f"warm step, {name:14} {1e6 * spent:6.1f} us (99 % {1e6 * late:.0f} us), {times[name]:.2f} times the plain"
        )
    for name, asked in ASKED.items():
        figures.at_most(f"warm step, {name}: times the plain cable's", times[name], asked, "{:.2f}")


def print_clips(figures: Figures, count: int) -> None:
    """All tables."""
    heading("Clips: random scenes from nothing, warm steps")
    for kinds in (("ball", "fixed", "hinge"), ("slide", "ball", "slide")):
        name = f"clips {', '.join(dict.fromkeys(kinds))}"
        grade(name, count, lambda rng, kinds=kinds: random_scene(rng, kinds), figures, Asked())
    print_speed(figures)
