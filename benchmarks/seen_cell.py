"""A simulated cell for servoing: two arms that hold a cable which is not as the model says, and a camera that is late.

The cable there is this package's own rod with other numbers (stiffness, length and grips), at rest at every instant; or
MuJoCo's, of :mod:`seen_mujoco`, which swings and shares nothing with the model.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import cable_shape as cs
from cable_shape.robots.robot import Robot

ROBOT = Path(__file__).resolve().parents[1] / "config" / "robots" / "dual_arm.yaml"
#: What the servo takes the cable for.
CABLE = cs.Cable(length=1.0, linear_density=0.1, bending_stiffness=0.01, twisting_stiffness=0.008, diameter=0.008)
POINTS = 101
DT = 0.025  # s, of a cycle; the delay is a multiple of it
WIDE = 0.5  # rad, of the postures that targets come from, around home
PATH = 12  # steps on the way there
MOST_CHORD = 0.95  # of the length
SLOW, REST = 0.2, 3.0  # s, of each, and until it hangs still
CLOUD, STRAY = 200, 0.1  # points, and the share of them that are of something else
MOVED = 0.05  # m, in the mean: targets are no nearer


@dataclass(frozen=True)
class Wrong:
    """How the cable in the cell differs from the model, and what the camera sees of it."""

    stiffness: float = 3.0  # times, of bending and of twisting
    length: float = 1.01  # times
    grips: float = 3e-3  # m, each elsewhere, in whatever direction
    noise: float = 3e-3  # m, of each coordinate of a point seen
    delay: float = 0.05  # s
    seen: int = 60  # points, at known arc lengths


NOTHING_WRONG = Wrong(1.0, 1.0, 0.0, 0.0, 0.0)


class Cell:
    """The arms, the cable that they hold, and what a camera sees of it."""

    def __init__(self, robot: Robot, wrong: Wrong, seed: int, *, mujoco: bool = False) -> None:
        self.robot, self.wrong = robot, wrong
        random = self.random = np.random.default_rng(seed)
        stiffer = random.choice((wrong.stiffness, 1.0 / wrong.stiffness))
        longer = random.choice((wrong.length, 2.0 - wrong.length))
        self.cable = CABLE.replace(
            length=CABLE.length * longer,
            bending_stiffness=CABLE.mean_bending_stiffness * stiffer,
            twisting_stiffness=CABLE.twisting_stiffness * stiffer,
        )
        off = random.normal(size=(2, 3))
        self.slips = [cs.Pose(wrong.grips * row / np.linalg.norm(row)) for row in off]
        self._rod = cs.Predictor(self.cable, model="cosserat", points=POINTS)
        self._swinging = None
        if mujoco:
            from seen_mujoco import MujocoCable

            self._swinging = MujocoCable(self.cable)
        self.begin(robot.home)

    def ends(self, q: np.ndarray) -> list[cs.Pose]:
        """Where the cable's ends really are."""
        grips = self.robot.grips(q)
        return [grip.cable_frame * slip for grip, slip in zip(grips, self.slips, strict=True)]

    def begin(self, q: np.ndarray) -> None:
        """The arms stand there, the cable hangs as it does from nothing."""
        self._rod.reset()
        # (positions, joints) of the cycles in which what the camera saw is still on its way
        self._past: deque[tuple[np.ndarray, np.ndarray]] = deque(maxlen=1 + round(self.wrong.delay / DT))
        shape = self._rod.predict(*self.ends(q))
        if self._swinging is not None:
            self._swinging.begin(shape, self.ends(q))
        self.move(q)

    def move(self, q: np.ndarray, seconds: float = DT) -> cs.CableShape:
        """The arms move there, and the cable with them; what the model of the cell takes for its shape."""
        self.shape = self._rod.predict(*self.ends(q))
        self.positions = self.shape.positions.copy()
        if self._swinging is not None:
            self._swinging.move(self.ends(q), seconds)
            self.positions = self._swinging.at(self.shape.arc_length / self.shape.length)
        self._past.append((self.positions, q))
        return self.shape

    def seen(self) -> cs.CableShape:
        """Noisy points of the centreline as it was a while ago, as a shape that has nothing but positions."""
        points = self._points(np.linspace(0.0, 1.0, self.wrong.seen))
        return cs.CableShape.of_points(points, CABLE.length)

    def cloud(self) -> tuple[np.ndarray, tuple[cs.Grip, cs.Grip]]:
        """(n, 3) [m], such points in any order, a tenth of them of something else, and where the grips were then."""
        random = self.random
        points = self._points(random.uniform(0.0, 1.0, CLOUD))
        stray = random.random(CLOUD) < STRAY
        low, high = points.min(axis=0), points.max(axis=0)
        points[stray] = random.uniform(low - 0.1, high + 0.1, (int(stray.sum()), 3))
        return points, self.robot.grips(self._past[0][1])

    def _points(self, shares: np.ndarray) -> np.ndarray:
        """At these shares of the length, as the camera gives them now."""
        rows = np.linspace(0.0, 1.0, POINTS)
        points = np.stack([np.interp(shares, rows, column) for column in self._past[0][0].T], axis=1)
        return np.asarray(points + self.random.normal(0.0, self.wrong.noise, points.shape))

    def goal(self) -> np.ndarray:
        """(POINTS, 3) [m], the cable's own shape at a random other posture, to which it comes without a snap."""
        while (goal := self._tried()) is None:
            pass
        return goal

    def _tried(self) -> np.ndarray | None:
        """One posture; None: beyond the limits, or the cable comes there taut, by a snap or hardly moved."""
        robot = self.robot
        q = robot.home + self.random.normal(0.0, WIDE, len(robot.home)) * robot.carrying
        if (q > robot.upper).any() or (q < robot.lower).any():
            return None
        self.begin(robot.home)
        for part in np.linspace(0.0, 1.0, PATH + 1)[1:]:
            shape = self.move(robot.home + part * (q - robot.home), SLOW)
            chord = np.linalg.norm(shape.positions[-1] - shape.positions[0])
            if shape.status is not cs.Status.OK or chord > MOST_CHORD * min(CABLE.length, self.cable.length):
                return None
        if self._swinging is not None:
            self.move(q, REST)
            if self._swinging.lost:
                return None
        goal = self.positions
        self.begin(robot.home)
        return goal if np.linalg.norm(goal - self.positions, axis=1).mean() > MOVED else None
