"""Contact in the equilibrium: seeded motions, finer meshes, and times."""

from __future__ import annotations

from time import thread_time

import numpy as np
from clocks import Turns, clocked
from contact_reference import HEAD, Tally
from figures import Figures, heading

import cable_shape as cs
from cable_shape.scene.scene import Solid

ALONG_X = (0.5, 0.5, 0.5, 0.5)
CABLE = cs.Cable(
    length=1.2, linear_density=0.1, bending_stiffness=0.01, twisting_stiffness=0.008, diameter=0.008
)  # fmt: skip
ACROSS_Y = cs.Pose((0, 0, 0), (np.sqrt(0.5), 0, 0, np.sqrt(0.5)))  # z of the obstacle along -y of the world

Ends = tuple[cs.Pose, cs.Pose]


def sway(rng: np.random.Generator, steps: int, amplitude: float) -> np.ndarray:
    """(steps, 3), a random smooth way that begins at 0: three waves along each axis."""
    t = np.linspace(0.0, 1.0, steps)
    waves = sum(
        rng.normal(size=(1, 3)) / f * np.sin(2.0 * np.pi * f * t + rng.uniform(0, 6.0))[:, None] for f in (1, 2, 3)
    )
    return amplitude * (waves - waves[0])


def turned(axis: tuple[float, float, float], angle: float) -> cs.Pose:
    """The frame along x, turned about an axis of the world."""
    half = 0.5 * angle
    size = float(np.linalg.norm(axis))
    q = np.array((*(np.sin(half) / size * np.array(axis)), np.cos(half)))
    return cs.Pose((0, 0, 0), q) * cs.Pose((0, 0, 0), ALONG_X)


def motions(steps: int = 300) -> dict[str, tuple[cs.Scene, list[Ends]]]:
    """Scenes and the ends along a motion through them, smooth and the same every time."""
    rng = np.random.default_rng(11)

    def scene(name: str, solid: Solid, pose: cs.Pose | None = None) -> cs.Scene:
        return cs.Scene(obstacles=[cs.Obstacle(name, solid, pose or cs.Pose())], contact="solve")

    def path(start: tuple, way: tuple, chord: float, wobble: float) -> list[Ends]:
        t = np.linspace(0.0, 1.0, steps)[:, None]
        a = np.array(start) + t * np.array(way) + sway(rng, steps, wobble)
        b = np.array(start) + (chord, 0.0, 0.0) + t * np.array(way) + sway(rng, steps, wobble)
        angles = sway(rng, steps, 4.0 * wobble)
        return [
            (
                cs.Pose(p, turned((0, 1, 0), v[1]).quaternion),
                cs.Pose(q, turned((0, 1, 0), v[2]).quaternion),
            )
            for p, q, v in zip(a, b, angles, strict=True)
        ]

    return {
        "lowered on a plane": (scene("table", cs.HalfSpace()), path((0, 0, 0.45), (0, 0.0, -0.3), 0.8, 0.01)),
        "dragged on a plane": (scene("table", cs.HalfSpace()), path((0, 0, 0.45), (0.3, 0.4, -0.3), 0.8, 0.03)),
        "box edge": (
            scene("box", cs.Box((0.2, 0.6, 0.2)), cs.Pose((0.4, 0, 0))),
            path((0, 0, 0.55), (0.1, 0.05, -0.3), 0.8, 0.01),
        ),
        "rod 4 mm thick": (
            scene("rod", cs.Capsule(0.002, 0.8), cs.Pose((0.4, 0, 0)) * ACROSS_Y),
            path((0, 0, 0.45), (0.05, 0.05, -0.15), 0.8, 0.01),
        ),
        "capsule": (
            scene("capsule", cs.Capsule(0.05, 0.6), cs.Pose((0.4, 0, 0)) * ACROSS_Y),
            path((0, 0, 0.5), (0.1, 0.05, -0.25), 0.8, 0.01),
        ),
        "cylinder": (
            scene("cylinder", cs.Cylinder(0.1, 0.6), cs.Pose((0.4, 0, 0)) * ACROSS_Y),
            path((0, 0, 0.55), (0.1, 0.05, -0.3), 0.8, 0.01),
        ),
        "sphere": (
            scene("sphere", cs.Sphere(0.15), cs.Pose((0.4, 0, 0))),
            path((0, 0, 0.6), (0.0, 0.0, -0.2), 0.8, 0.003),
        ),
        "laid on a plane": (scene("table", cs.HalfSpace()), path((0, 0, 0.45), (0.05, 0.0, -0.38), 1.0, 0.01)),
        "dragged over an edge": (
            scene("box", cs.Box((0.2, 0.6, 0.2)), cs.Pose((0.35, 0, 0))),
            path((0, 0, 0.48), (0.3, 0.1, -0.15), 0.8, 0.01),
        ),
        "dragged over a rod": (
            scene("rod", cs.Capsule(0.002, 0.8), cs.Pose((0.4, 0, 0)) * ACROSS_Y),
            path((0, 0, 0.38), (0.3, 0.1, 0.0), 0.8, 0.01),
        ),
        "dragged along a capsule": (
            scene("capsule", cs.Capsule(0.05, 0.8), cs.Pose((0.4, 0, 0)) * ACROSS_Y),
            path((0, -0.1, 0.42), (0.1, 0.25, -0.05), 0.8, 0.01),
        ),
        "pulled around a post": (
            scene("post", cs.Capsule(0.03, 2.0), cs.Pose((0.4, 0, 0))),
            path((0, 0.1, 0.2), (0.0, -0.4, 0.0), 0.8, 0.01),
        ),
    }


def print_motions(figures: Figures, steps: int, every: int) -> None:
    """One line a motion; every so manyth shape is compared with a finer mesh.

    Times are the thread's own: what else the machine does is no late step of the solver.
    """
    print(HEAD)
    total = Tally()
    for name, (scene, ends) in motions(steps).items():
        cs.Predictor(CABLE, scene=scene, model="cosserat").predict(*ends[-1])
        predictor, tally = cs.Predictor(CABLE, scene=scene, model="cosserat"), Tally()
        for k, grips in enumerate(ends):
            seconds, shape = clocked(lambda p=predictor, g=grips: p.predict(*g), thread_time)
            tally.take(shape, scene, 0.5 * CABLE.diameter, seconds)
            if k % every == 0:
                tally.judge(shape, predictor)
        tally.print_row(name)
        total.add(tally)
    total.tell(figures, "motions in contact", 99.9)
    figures.at_most("motions in contact: 99 % of the times / median, worst", total.late, 10.0, "{:.1f}")
    figures.at_most("motions in contact: force against a mesh 4 times finer", 100.0 * total.force, 1.0, "{:.2f}", " %")


def print_table(figures: Figures, speed: float, count: int = 300) -> None:
    """Warm steps of a soft cable lying on a table, its grips lifted and lowered, beside the plain cable's."""
    cable = cs.Cable(1.2, 0.1, 0.003, 0.003, diameter=0.004)
    scene = cs.Scene(obstacles=[cs.Obstacle("table", cs.HalfSpace())], contact="solve")
    resting = cs.Predictor(cable, scene=scene, model="cosserat")
    plain = cs.Predictor(cable, model="cosserat")
    turns, contacts = Turns("resting", "plain"), []
    for k in range(count):
        t = speed * k / 0.02
        start = cs.Pose((0, 0, 0.03 + 0.02 * np.sin(t)), ALONG_X)
        end = cs.Pose((1.13 + 0.01 * np.sin(1.4 * t), 0, start.position[2]), ALONG_X)
        contacts.append(len(turns.of("resting", lambda a=start, b=end: resting.predict(a, b)).contacts))
        turns.of("plain", lambda a=start, b=end: plain.predict(a, b))
    here, beside = turns.medians["resting"], turns.medians["plain"]
    named = f"on a table, {speed * 1e3:.1f} mm a step"
    print(f"{named}: {np.median(contacts):.0f} contacts, {1e6 * here:.0f} us; the plain cable {1e6 * beside:.0f} us")
    figures.at_most(f"{named}: times the plain cable", here / beside, 5.0, "{:.1f}")


def print_contact(figures: Figures, *, quick: bool = False) -> None:
    """Prints everything; `quick` with fewer steps and comparisons."""
    heading("Contact: seeded motions, and times beside the plain cable")
    print_motions(figures, 100 if quick else 300, 20 if quick else 5)
    for speed in (1e-4, 1e-3):
        print_table(figures, speed)
