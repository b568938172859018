"""Figures of cables that touch: seeded motions of two crossing cables and of one looped on itself."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from figures import Figures, heading
from scipy.spatial.transform import Rotation
from tqdm import tqdm

import cable_shape as cs

ALONG_X = Rotation.from_quat((0.5, 0.5, 0.5, 0.5))
SCENE = cs.Scene(contact="solve")
CABLE = cs.Cable(0.6, 0.05, 0.01, 0.008, diameter=0.008)
LOOPED = cs.Cable(1.0, 0.005, 0.004, 0.003, diameter=0.008)
SAME_BRANCH = 2e-3  # of the length: shapes further apart are on two branches

Grips = dict[str, tuple[cs.Pose, cs.Pose]]


@dataclass
class Tally:
    """What one kind of motion of touching cables has shown."""

    steps: int = 0
    usable: int = 0
    snapped: int = 0
    pressed: int = 0  # cables on each other or themselves
    both: int = 0  # and one of them on a body or in a clip at once
    in_bodies: float = 0.0  # m, deepest
    in_cables: float = 0.0
    off: list[float] = field(default_factory=list)  # of forces, against a finer mesh on the same branch
    times: list[float] = field(default_factory=list)  # s

    def add(self, report: cs.CycleReport) -> bool:
        """One step's; whether it has shapes that press on each other."""
        shapes = report.shapes
        self.steps += 1
        self.snapped += any(shape.status is cs.Status.SNAPPED for shape in shapes.values())
        self.times.append(report.times["predict"])
        if not all(shape.status for shape in shapes.values()):
            return False
        self.usable += 1
        touched = {contact.body for shape in shapes.values() for contact in shape.contacts}
        bodies = touched - {*shapes, "itself"}
        pressed = touched != bodies
        self.pressed += pressed
        self.both += pressed and bool(bodies or any(shape.clips for shape in shapes.values()))
        for body in (body for clearance in report.clearance.values() for body in clearance.bodies):
            if body.body in shapes or body.body == "itself":
                self.in_cables = max(self.in_cables, -body.distance)
            else:
                self.in_bodies = max(self.in_bodies, -body.distance)
        return pressed

    def compare(self, report: cs.CycleReport, fine: cs.CycleReport) -> None:
        """The forces of contacts with those on a finer mesh."""
        if not all(shape.status for shape in (*report.shapes.values(), *fine.shapes.values())):
            return
        for name, shape in report.shapes.items():
            force, there = (sum(c.force for c in found.contacts) for found in (shape, fine.shapes[name]))
            same = np.abs(shape.positions - fine.shapes[name].positions).max() < SAME_BRANCH * shape.length
            if same and force > 1e-3:
                self.off.append(abs(there / force - 1.0))

    def tell(self, name: str, figures: Figures) -> None:
        """Prints a row and what every kind is asked."""
        median, late = np.percentile(1e3 * np.array(self.times), (50, 99))
        print(
            f"{name}: {self.steps} steps, in {self.pressed} cables are pressed together, in {self.both} of them on a "
            f"body or in a clip, too; {self.snapped} snapped, {len(self.off)} forces compared; "
            f"prediction median {median:.1f} ms, 99 % {late:.1f} ms"
        )
        figures.at_least(f"{name}: usable", 100.0 * self.usable / self.steps, 99.5, "{:.2f}", " %")
        figures.at_most(f"{name}: deepest in each other", 1e3 * self.in_cables, 0.2, "{:.3f}", " mm")


def posed(place: np.ndarray, turn: Rotation) -> cs.Pose:
    """A pose whose d3 is the turned x axis."""
    return cs.Pose(place, (turn * ALONG_X).as_quat())


def smooth(rng: np.random.Generator, steps: int, size: float) -> np.ndarray:
    """(steps, 6), a random motion that begins and ends at rest near zero."""
    t = np.linspace(0.0, 1.0, steps)[:, None]
    out = np.zeros((steps, 6))
    for k in (1, 2, 3):
        out += rng.normal(size=6) * np.sin(math.pi * k * t) / k
    return size * out


def crossing(rng: np.random.Generator, steps: int) -> list[Grips]:
    """One cable across another at 35 to 145 degrees, pressed onto it and moved about."""
    angle = math.radians(rng.uniform(35.0, 145.0))
    chords, aside = rng.uniform(0.5, 0.56, 2), rng.uniform(-0.03, 0.03, 2)
    ends = [[posed(np.array((x, 0.0, 0.0)), Rotation.identity()) for x in (-0.5 * c, 0.5 * c)] for c in chords]
    sag = [cs.predict(CABLE, a, b, model="cosserat").positions[:, 2].min() for a, b in ends]
    down = np.concatenate((np.linspace(0.03, -0.04, steps // 2), np.full(steps - steps // 2, -0.04)))
    down += sag[0] - sag[1]
    wander = [smooth(rng, steps, 0.01) for _ in range(2)]
    path = []
    for k in range(steps):
        turn = Rotation.from_rotvec((0.0, 0.0, angle)) * Rotation.from_rotvec(4.0 * wander[0][k, 3:])
        half = turn.apply((0.5 * chords[1], 0.0, 0.0))
        middle = np.array((aside[0], aside[1], down[k])) + wander[0][k, :3]
        low = np.array((0.5 * chords[0], 0.0, 0.0))
        bent = Rotation.from_rotvec(4.0 * wander[1][k, 3:])
        path.append({
            "under": (posed(-low, Rotation.identity()), posed(low + wander[1][k, :3], bent)),
            "over": (posed(middle - half, turn), posed(middle + half, turn)),
        })  # fmt: skip
    return path


def looped(rng: np.random.Generator, steps: int) -> list[Grips]:
    """A slack cable whose end is turned until it loops on itself, then moved about."""
    chord, turns = rng.uniform(0.26, 0.36), rng.uniform(1.2, 1.4)
    wander = smooth(rng, steps, 0.01)
    path = []
    for k in range(steps):
        roll = Rotation.from_rotvec((2.0 * math.pi * (0.3 + (turns - 0.3) * min(1.0, 1.5 * k / steps)), 0.0, 0.0))
        end = np.array((chord, 0.0, 0.0)) + wander[k, :3]
        bent = Rotation.from_rotvec(3.0 * wander[k, 3:])
        path.append({"cable": (posed(np.zeros(3), Rotation.identity()), posed(end, bent * roll))})
    return path


def run(cables: dict[str, cs.Cable], path: list[Grips], tally: Tally) -> None:
    """One motion at default settings, beside it on a mesh four times finer."""
    tolerance = 1e-5 * min(cable.length for cable in cables.values()) / 4**4
    cycle = cs.Cycle(cables, scene=SCENE, model="cosserat")
    fine = cs.Cycle(cables, scene=SCENE, model="cosserat", tolerance=tolerance)
    for k, grips in enumerate(path):
        report, finer = (one.step(grips, stamp=10_000_000 * k) for one in (cycle, fine))
        tally.add(report)
        tally.compare(report, finer)


def print_crossing(figures: Figures, motions: int = 10, steps: int = 160) -> None:
    """The figures of cables that touch."""
    heading("Cables that touch: two crossing at 35 to 145 degrees, one looped on itself")
    for name, cables, motion in (
        ("two crossing cables", {"under": CABLE, "over": CABLE}, crossing),
        ("a cable looped on itself", {"cable": LOOPED}, looped),
    ):
        tally = Tally()
        for seed in tqdm(range(motions), desc=name, unit="motion", leave=False, disable=None):
            run(cables, motion(np.random.default_rng(seed), steps), tally)
        tally.tell(name, figures)
        off = 100.0 * max(tally.off, default=math.nan)
        figures.at_most(f"{name}: force against a mesh 4 times finer", off, 1.0, "{:.3f}", " %")
