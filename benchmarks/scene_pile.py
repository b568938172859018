"""Cables laid across each other on a table: found from nothing, then followed while their grips move."""

from __future__ import annotations

import numpy as np
from clocks import clocked
from figures import Figures, heading
from scipy.spatial.transform import Rotation
from tqdm import tqdm

import cable_shape as cs

LENGTH, DENSITY, DIAMETER, SPACING = 0.62, 0.1, 0.008, 0.1  # m, kg/m
TABLE = cs.Scene(obstacles=[cs.Obstacle("table", cs.HalfSpace())], contact="solve")
STIFFNESS = (0.002, 0.02)  # N m^2
CHORDS, HEIGHTS, OVER = (0.57, 0.595), (0.025, 0.04), (0.008, 0.03)  # m: the upper half of the cables is held higher
ASKEW, ASIDE, SWAY = 4.0, 0.01, 0.004  # degrees, m
STEPS = 40
_ALONG_X = Rotation.from_quat((0.5, 0.5, 0.5, 0.5))


class Pile:
    """So many cables along x and as many across them, each held at both ends above the table."""

    def __init__(self, count: int, seed: int) -> None:
        rng = np.random.default_rng(seed)
        self.cables = {
            f"cable {i}": cs.Cable(LENGTH, DENSITY, float(np.exp(rng.uniform(*np.log(STIFFNESS)))), diameter=DIAMETER)
            for i in range(count)
        }
        half, over = count // 2, rng.uniform(*OVER)
        self._turns, self._places = [], []
        for i in range(count):
            row = SPACING * (i % half - (half - 1) / 2) + rng.uniform(-ASIDE, ASIDE)
            height = rng.uniform(*HEIGHTS) + (over if i >= half else 0.0)
            side = 0.5 * rng.uniform(*CHORDS)
            yaw = np.deg2rad(90.0 * (i >= half) + rng.uniform(-ASKEW, ASKEW))
            self._turns.append(Rotation.from_rotvec((0.0, 0.0, yaw)))
            self._places.append(np.array(((-side, row, height), (side, row, height))))
        self._phases = rng.uniform(0.0, 2.0 * np.pi, (count, 2, 3))

    def ends(self, k: int) -> dict[str, tuple[cs.Pose, cs.Pose]]:
        """Of each cable, in step k."""
        out = {}
        for name, turn, places, phases in zip(self.cables, self._turns, self._places, self._phases, strict=True):
            q = (turn * _ALONG_X).as_quat()
            now = turn.apply(places) + SWAY * (np.sin(0.1 * k + phases) - np.sin(phases))
            out[name] = cs.Pose(now[0], q), cs.Pose(now[1], q)
        return out


def print_pile(figures: Figures, piles: int) -> None:
    """Two, four and eight cables."""
    heading(f"Cables across each other on a table, random, {piles} piles of {STEPS} steps each")
    print("| cables | first, median [ms] | cycle, median [ms] | mean [ms] | steps without a shape [%] |")
    print("| --- | --- | --- | --- | --- |")
    for count in (2, 4, 8):
        first, later, lost = [], [], 0
        for seed in tqdm(range(piles), desc=f"{count} cables", leave=False, disable=None):
            pile = Pile(count, seed)
            cycle = cs.Cycle(pile.cables, scene=TABLE, model="cosserat")
            for k in range(STEPS):
                ends = pile.ends(k)
                seconds, report = clocked(lambda k=k, ends=ends, cycle=cycle: cycle.step(ends, 10_000_000 * k))
                (later if k else first).append(1e3 * seconds)
                lost += not all(shape.usable for shape in report.shapes.values())
        percent = 100.0 * lost / (piles * STEPS)
        print(
            f"| {count} | {np.median(first):.0f} | {np.median(later):.1f} | {np.mean(later):.1f} | {percent:.2f} |",
            flush=True,
        )
        figures.at_most(f"{count} cables across each other on a table: without a shape", percent, 1.0, "{:.2f}", " %")
