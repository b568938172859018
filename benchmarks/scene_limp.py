"""Limp cables that are laid on a table: from nothing and lowered, against meshes 4 times finer.

The legs of a limp cable are steep, and bend into the table within (EI / w)^(1/3); what lies there carries no pressure
along its axis and bows sideways.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from clocks import clocked
from contact_reference import HEAD, Tally
from figures import Figures, heading
from scipy.spatial.transform import Rotation

import cable_shape as cs

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
    seconds, shape = clocked(lambda: predictor.predict(given.start, given.end))
    tally.take(shape, TABLE, 0.5 * DIAMETER, seconds)
    if judge:
        tally.judge(shape, predictor, NEARBY)
    return shape


def lowered(given: Case, tally: Tally, *, every: int = 8) -> cs.CableShape:
    """From above, in steps."""
    predictor = cs.Predictor(given.cable, model="cosserat", scene=TABLE)
    for k in range(STEPS):
        ends = given.above((1.0 - k / (STEPS - 1)) * LOWERED * LENGTH)
        seconds, shape = clocked(lambda ends=ends: predictor.predict(*ends))
        tally.take(shape, TABLE, 0.5 * DIAMETER, seconds)
        if k % every == every - 1:
            tally.judge(shape, predictor, NEARBY)
    return shape


def print_limp(figures: Figures, cases: int) -> None:
    """One line for every limpness and slack, `cases` of each."""
    heading("Limp cables laid on a table: from nothing, and lowered in 80 steps")
    print(HEAD)
    ways = {"from nothing": laid, "lowered": lowered}
    totals = {how: Tally() for how in ways}
    laid(case(-4.0, (0.6, 0.9), 0), Tally())
    for limpness in LIMPNESS:
        for chords in CHORDS:
            for how, way in ways.items():
                tally = Tally()
                for seed in range(cases):
                    way(case(limpness, chords, seed), tally)
                tally.print_row(f"EI {10**limpness:.0e} w L^3, chord {chords[0]:.1f} to {chords[1]:.2f} L, {how}")
                if limpness >= SOFTEST:
                    totals[how].add(tally)
    for (how, total), usable in zip(totals.items(), (97.0, 99.0), strict=True):
        total.tell(figures, f"limp cables on a table, {how}", usable)
        lost = 100.0 * total.lost / max(total.compared + total.lost, 1)
        figures.at_most(f"limp cables on a table, {how}: no finer mesh on the same branch", lost, 5.0, "{:.1f}", " %")
