"""Contact in the equilibrium: seeded motions, finer meshes, random places and times.

python benchmarks/scene_contact.py [--quick]
"""

from __future__ import annotations

import statistics
import sys
from dataclasses import dataclass
from time import perf_counter, thread_time

import numpy as np
from contact_reference import compared, finer
from figures import Figures, heading
from scene_eyelets import print_eyelets, sway

import cable_shape as cs
from cable_shape.safety.clearance import ClearanceChecker
from cable_shape.scene.scene import Solid

ALONG_X = (0.5, 0.5, 0.5, 0.5)
CABLE = cs.Cable(
    length=1.2, linear_density=0.1, bending_stiffness=0.01, twisting_stiffness=0.008, diameter=0.008
)  # fmt: skip
ACROSS_Y = cs.Pose((0, 0, 0), (np.sqrt(0.5), 0, 0, np.sqrt(0.5)))  # z of the obstacle along -y of the world

DEEPEST = 2e-4  # m

Ends = tuple[cs.Pose, cs.Pose]


@dataclass
class Totals:
    """The worst of all motions."""

    steps: int = 0
    usable: int = 0
    deepest: float = 0.0  # m
    late: float = 0.0
    apart: float = 0.0
    force: float = 0.0
    honest: int = 0
    compared: int = 0

    def add(
        self,
        steps: int,
        usable: int,
        deepest: float,
        late: float,
        apart: float,
        force: float,
        honest: int,
        compared: int,
    ) -> None:
        """One motion's."""
        self.steps, self.usable = self.steps + steps, self.usable + usable
        self.honest, self.compared = self.honest + honest, self.compared + compared
        self.deepest, self.late = max(self.deepest, deepest), max(self.late, late)
        self.apart, self.force = max(self.apart, apart), max(self.force, force)

    def tell(self, figures: Figures) -> None:
        """As figures."""
        figures.at_least("motions in contact: usable", 100.0 * self.usable / self.steps, 99.9, "{:.2f}", " %")
        figures.at_most("motions in contact: deepest", 1e3 * self.deepest, 1e3 * DEEPEST, "{:.3f}", " mm")
        figures.at_most("motions in contact: 99 % of the times / median, worst", self.late, 10.0, "{:.1f}")
        figures.at_most("motions in contact: distance / L to a mesh 8 times finer", self.apart, 5e-4)
        force, honest = 100.0 * self.force, 100.0 * self.honest / self.compared
        figures.at_most("motions in contact: force against a mesh 4 times finer", force, 1.0, "{:.2f}", " %")
        figures.at_least("motions in contact: true error at most the estimate", honest, 99.0, "{:.1f}", " %")


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


def deepest(shape: cs.CableShape, scene: cs.Scene, radius: float) -> float:
    """[m], how deep the densely sampled cable is in the scene's obstacles."""
    found = ClearanceChecker(scene, radius=radius).check(shape)
    return max((-body.distance for body in found.bodies), default=0.0)


def print_motions(figures: Figures, steps: int, every: int) -> None:
    """One line a motion; every so manyth shape is compared with meshes 4 and 8 times finer.

    Times are the thread's own: what else the machine does is no late step of the solver.
    """
    print("                                                                              position, of L: ")
    print(
        "motion                      usable snapped  changes   deepest    median p99/median  95 % of shapes, worst "
        "force    honest, lost"
    )
    total = Totals()
    for name, (scene, ends) in motions(steps).items():
        cs.Predictor(CABLE, scene=scene, model="cosserat").predict(*ends[-1])
        predictor = cs.Predictor(CABLE, scene=scene, model="cosserat")
        times, worst, usable, snapped, changes, last = [], 0.0, 0, 0, 0, -1
        apart, forces, honest, lost = [], [], 0, 0
        for k, (a, b) in enumerate(ends):
            began = thread_time()
            shape = predictor.predict(a, b)
            times.append(thread_time() - began)
            usable += bool(shape.status)
            snapped += shape.status is cs.Status.SNAPPED
            if shape.status:
                worst = max(worst, deepest(shape, scene, 0.5 * CABLE.diameter))
            count = len(shape.contacts)
            changes += count != last
            last = count
            if count == 0 or k % every:
                continue
            state = predictor._solver._touch
            coarse, fine = finer(state, 2), finer(state, 3)
            if coarse is None or fine is None:
                lost += 1
                continue
            distance, _ = compared(shape, fine)
            apart.append(distance / CABLE.length)
            forces.append(compared(shape, coarse)[1])
            honest += distance <= shape.error_estimate
        late = np.quantile(times, 0.99) / statistics.median(times)
        total.add(len(ends), usable, worst, late, max(apart), max(forces), honest, len(apart))
        print(
            f"{name:24s} {usable:4d}/{len(ends)} {snapped:7d} {changes:8d} {worst * 1e3:6.3f} mm "
            f"{statistics.median(times) * 1e6:6.0f} us {late:8.1f}   {np.quantile(apart, 0.95):.1e} {max(apart):.1e} "
            f"{max(forces) * 100:6.2f} % {honest:4d}/{len(apart)} {lost:4d}",
            flush=True,
        )
    total.tell(figures)


def print_random(figures: Figures, count: int, seconds: float) -> None:
    """Cold shapes among random bodies, until so many or so much time: how many are usable, and how deep they are."""
    rng = np.random.default_rng(7)
    kinds = (
        cs.Sphere(0.08), cs.Capsule(0.03, 0.3), cs.Cylinder(0.06, 0.2), cs.Box((0.1, 0.2, 0.1)), cs.Capsule(0.002, 0.6),
    )  # fmt: skip
    start, end = cs.Pose((0, 0, 0), ALONG_X), cs.Pose((0.8, 0, 0), ALONG_X)
    usable = touched = wrong = done = 0
    worst = 0.0
    began = perf_counter()
    while done < count and perf_counter() - began < seconds:
        q = rng.normal(size=4)
        place = (rng.uniform(0.1, 0.7), rng.uniform(-0.1, 0.1), rng.uniform(-0.5, 0.0))
        pose = cs.Pose(place, q / np.linalg.norm(q))
        scene = cs.Scene(obstacles=[cs.Obstacle("body", kinds[done % len(kinds)], pose)], contact="solve")
        shape = cs.predict(CABLE, start, end, scene=scene, model="cosserat", points=600)
        done += 1
        wrong += not np.isfinite(shape.buffer).all()
        if shape.status:
            usable += 1
            touched += len(shape.contacts) > 0
            depth = deepest(shape, scene, 0.5 * CABLE.diameter)
            worst = max(worst, depth)
            wrong += depth > DEEPEST
    print(
        f"random places, cold: {done} of {count}, {usable} usable, {touched} in contact, deepest {worst * 1e3:.3f} mm"
    )
    figures.at_most("random places: not finite, or usable and deeper than 0.2 mm", wrong, 0, "{:d}")


def print_table(figures: Figures, speed: float, count: int = 300) -> None:
    """Warm steps of a soft cable lying on a table, its grips lifted and lowered, beside the plain cable's."""
    cable = cs.Cable(1.2, 0.1, 0.003, 0.003, diameter=0.004)
    scene = cs.Scene(obstacles=[cs.Obstacle("table", cs.HalfSpace())], contact="solve")
    resting = cs.Predictor(cable, scene=scene, model="cosserat")
    plain = cs.Predictor(cable, model="cosserat")
    times, plain_times, contacts = [], [], []
    for k in range(count):
        t = speed * k / 0.02
        start = cs.Pose((0, 0, 0.03 + 0.02 * np.sin(t)), ALONG_X)
        end = cs.Pose((1.13 + 0.01 * np.sin(1.4 * t), 0, start.position[2]), ALONG_X)
        began = perf_counter()
        shape = resting.predict(start, end)
        between = perf_counter()
        plain.predict(start, end)
        times.append(between - began)
        plain_times.append(perf_counter() - between)
        contacts.append(len(shape.contacts))
    median, beside = statistics.median(times), statistics.median(plain_times)
    named = f"on a table, {speed * 1e3:.1f} mm a step"
    print(
        f"{named}: {statistics.median(contacts):.0f} contacts, {median * 1e6:.0f} us; "
        f"the plain cable {beside * 1e6:.0f} us"
    )
    figures.at_most(f"{named}: times the plain cable", median / beside, 5.0, "{:.1f}")


def print_contact(figures: Figures, *, quick: bool = False) -> None:
    """Prints everything; `quick` with fewer steps, comparisons and random places."""
    heading("Contact: seeded motions, random places, and times beside the plain cable")
    print_motions(figures, 100 if quick else 300, 20 if quick else 5)
    print_eyelets(figures, deepest, DEEPEST, 50 if quick else 150, 10 if quick else 5)
    print_random(figures, 200 if quick else 10_000, 20.0 if quick else 300.0)
    for speed in (1e-4, 1e-3):
        print_table(figures, speed)


if __name__ == "__main__":
    print_contact(Figures(), quick="--quick" in sys.argv[1:])
