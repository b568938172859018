"""Limp cables that are laid on a table: from nothing and lowered, against meshes 4 times finer.

The legs of a limp cable are steep, and bend into the table within (EI / w)^(1/3); what lies there carries no pressure
along its axis and bows sideways.

python benchmarks/scene_limp.py [--quick]
"""

from __future__ import annotations

import statistics
import sys
from dataclasses import dataclass, field
from time import perf_counter

import numpy as np
from contact_reference import compared, finer
from figures import Figures, heading
from scipy.spatial.transform import Rotation

import cable_shape as cs
from cable_shape.safety.clearance import ClearanceChecker

LENGTH, DENSITY, DIAMETER = 1.0, 0.1, 0.004
TABLE = cs.Scene(obstacles=[cs.Obstacle("table", cs.HalfSpace())], contact="solve")
SOFTEST = -5.0  #: log10 of EI / (w L^3): cables down to here are asked for
LIMPNESS = (-6.0, -5.0, -4.5, -4.0, -3.5)
CHORDS = ((0.9, 0.98), (0.6, 0.9), (0.3, 0.6))  # of the length
LOWERED = 0.6  # of the length, in this many steps
STEPS = 80
NEARBY = 0.3  # rad: where a limp cable touches down its frames turn by as much within few elements
_ALONG_X = Rotation.from_quat((0.5, 0.5, 0.5, 0.5))


@dataclass
class Case:
    """A cable between two grips that are tilted by about 0.3 rad, 3 to 20 cm above a table."""

    cable: cs.Cable
    start: cs.Pose
    end: cs.Pose

    def above(self, height: float) -> tuple[cs.Pose, cs.Pose]:
        """Both grips, so much higher [m]."""
        up = np.array((0.0, 0.0, height))
        start, end = self.start, self.end
        return cs.Pose(start.position + up, start.quaternion), cs.Pose(end.position + up, end.quaternion)


@dataclass
class Tally:
    """What a group of shapes came to."""

    shapes: int = 0
    usable: int = 0
    snapped: int = 0
    deepest: float = 0.0  # m
    apart: float = 0.0  # of the length, from a mesh 4 times finer
    honest: int = 0
    compared: int = 0
    lost: int = 0
    times: list[float] = field(default_factory=list)  # s

    def take(self, shape: cs.CableShape, seconds: float) -> None:
        """One shape's."""
        self.shapes += 1
        self.usable += bool(shape.status)
        self.snapped += shape.status is cs.Status.SNAPPED
        self.times.append(seconds)
        if shape.status:
            found = ClearanceChecker(TABLE, radius=0.5 * DIAMETER).check(shape)
            self.deepest = max(self.deepest, *(-body.distance for body in found.bodies), 0.0)

    def judge(self, shape: cs.CableShape, predictor: cs.Predictor) -> None:
        """Compares a usable shape in contact with a finer mesh."""
        if not shape.status or not shape.contacts:
            return
        fine = finer(predictor._solver._touch, 2, NEARBY)
        if fine is None:
            self.lost += 1
            return
        distance, _ = compared(shape, fine)
        self.compared += 1
        self.honest += distance <= shape.error_estimate
        self.apart = max(self.apart, distance / LENGTH)

    def add(self, other: Tally) -> None:
        """Another group's."""
        for name in ("shapes", "usable", "snapped", "honest", "compared", "lost", "times"):
            setattr(self, name, getattr(self, name) + getattr(other, name))
        self.deepest, self.apart = max(self.deepest, other.deepest), max(self.apart, other.apart)

    def line(self) -> str:
        """As the columns of a table."""
        late = np.quantile(self.times, 0.99)
        return (
            f"{self.usable:5d}/{self.shapes:<5d} {self.snapped:4d} {self.deepest * 1e3:7.3f} mm "
            f"{statistics.median(self.times) * 1e3:7.1f} {late * 1e3:7.1f} ms   {self.apart:.1e} "
            f"{self.honest:4d}/{self.compared:<4d} {self.lost:3d}"
        )

    def tell(self, figures: Figures, how: str, usable: float) -> None:
        """As figures."""
        named = f"limp cables on a table, {how}"
        figures.at_least(f"{named}: usable", 100.0 * self.usable / self.shapes, usable, "{:.1f}", " %")
        figures.at_most(f"{named}: deepest", 1e3 * self.deepest, 0.2, "{:.3f}", " mm")
        figures.at_most(f"{named}: distance / L to a mesh 4 times finer", self.apart, 5e-4)
        honest = 100.0 * self.honest / max(self.compared, 1)
        figures.at_least(f"{named}: true error at most the estimate", honest, 99.0, "{:.1f}", " %")
        lost = 100.0 * self.lost / max(self.compared + self.lost, 1)
        figures.at_most(f"{named}: no finer mesh on the same branch", lost, 5.0, "{:.1f}", " %")


def case(limpness: float, chords: tuple[float, float], seed: int) -> Case:
    """A cable of EI = 10^limpness w L^3 between two grips."""
    rng = np.random.default_rng(seed)
    stiffness = 10.0**limpness * DENSITY * 9.81 * LENGTH**3
    cable = cs.Cable(LENGTH, DENSITY, stiffness, 0.8 * stiffness, diameter=DIAMETER)
    chord, height = rng.uniform(*chords) * LENGTH, rng.uniform(0.03, 0.15) * LENGTH
    first, second = ((Rotation.from_rotvec(rng.normal(size=3) * 0.3) * _ALONG_X).as_quat() for _ in range(2))
    other = height + rng.uniform(0.0, 0.05)
    return Case(cable, cs.Pose((0, 0, height), first), cs.Pose((chord, 0, other), second))


def laid(given: Case, tally: Tally, *, judge: bool = True) -> cs.CableShape:
    """From nothing."""
    predictor = cs.Predictor(given.cable, model="cosserat", scene=TABLE)
    began = perf_counter()
    shape = predictor.predict(given.start, given.end)
    tally.take(shape, perf_counter() - began)
    if judge:
        tally.judge(shape, predictor)
    return shape


def lowered(given: Case, tally: Tally, *, every: int = 8) -> cs.CableShape:
    """From above, in steps."""
    predictor = cs.Predictor(given.cable, model="cosserat", scene=TABLE)
    for k in range(STEPS):
        ends = given.above((1.0 - k / (STEPS - 1)) * LOWERED * LENGTH)
        began = perf_counter()
        shape = predictor.predict(*ends)
        tally.take(shape, perf_counter() - began)
        if k % every == every - 1:
            tally.judge(shape, predictor)
    return shape


def print_limp(figures: Figures, cases: int) -> None:
    """One line for every limpness and slack, `cases` of each."""
    heading("Limp cables laid on a table: from nothing, and lowered in 80 steps")
    print("EI/(w L^3)  chord / L            usable  snapped  deepest     median    99 %   apart / L honest    lost")
    totals = {"from nothing": Tally(), "lowered": Tally()}
    laid(case(-4.0, (0.6, 0.9), 0), Tally())
    for limpness in LIMPNESS:
        for chords in CHORDS:
            for how, total in totals.items():
                tally = Tally()
                for seed in range(cases):
                    (laid if how == "from nothing" else lowered)(case(limpness, chords, seed), tally)
                print(f"{10**limpness:8.1e}  {chords[0]:.2f} to {chords[1]:.2f}  {how:12s} {tally.line()}", flush=True)
                if limpness >= SOFTEST:
                    total.add(tally)
    totals["from nothing"].tell(figures, "from nothing", 97.0)
    totals["lowered"].tell(figures, "lowered", 99.0)


if __name__ == "__main__":
    print_limp(Figures(), 3 if "--quick" in sys.argv[1:] else 15)
