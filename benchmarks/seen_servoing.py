"""How near the servo brings a cable that is not as its model says to shapes within its reach, seen and unseen.

Each target is the whole centreline which that very cable takes at a random other posture of the arms, so that it is
within reach. The cable is three times as stiff as the model, or a third, 1 % longer or shorter, gripped 3 mm elsewhere,
and what is seen of it is 3 mm noisy and 50 ms late. It is judged by where it really is after TIME.
"""

from __future__ import annotations

from collections.abc import Callable
from time import perf_counter
from typing import NamedTuple

import numpy as np
from figures import Figures, heading
from seen_cell import CABLE, DT, POINTS, ROBOT, STRAY, Cell, Wrong
from tqdm import tqdm

import cable_shape as cs
from cable_shape.robots.robot import Robot
from cable_shape.robots.steering import HeldCable

TIME = 10.0  # s, given to each target
PART = 5  # of the tries, of what takes long
LOOK = 2  # the tracker is given points in every so manieth cycle, 20 Hz
NEAR = 5e-3  # m, in the mean over the centreline, ...
NEARER = 5.0  # times, closed loop than open loop
SHARE = 95.0  # % ... in so many of the tries


class Try(NamedTuple):
    """How one target was approached."""

    off: float  # m, mean distance of the real cable from its target in the end
    said: float  # m, what the servo took it for
    within: bool  # positions and velocities of the joints, all the way
    seconds: float  # of a step of the servo, in the mean
    reached: float  # s, until it said so; NaN: never


def look_of(cell: Cell, how: str) -> Callable[[int], cs.CableShape | None]:
    """What the servo is given in cycle k."""
    if how == "open loop":
        return lambda k: None
    if how == "closed loop":
        return lambda k: cell.seen()
    tracker = cs.Tracker(CABLE, noise=cell.wrong.noise, outliers=STRAY)

    def tracked(k: int) -> cs.CableShape | None:
        if k % LOOK:
            return None
        points, (start, end) = cell.cloud()
        shape = tracker.update(points, stamp=round(1e9 * k * DT), start=start, end=end)
        return None if tracker.lost else shape

    return tracked


def approach(cell: Cell, held: HeldCable, goal: np.ndarray, how: str) -> Try:
    """From home, for TIME."""
    robot = cell.robot
    cell.begin(robot.home)
    held.predictor.reset()
    servo = cs.Servo(held, cs.CentrelineTarget(goal), delay=cell.wrong.delay)
    look = look_of(cell, how)
    spent, within, reached = 0.0, True, np.nan
    for k in range(round(TIME / DT)):
        shape = look(k)
        began = perf_counter()
        velocity = servo.step(shape, DT)
        spent += perf_counter() - began
        q = servo.q
        within &= bool((np.abs(velocity) <= robot.velocity_limits + 1e-6).all())
        within &= bool((q <= robot.upper).all() and (q >= robot.lower).all())
        cell.move(q)
        if servo.reached and np.isnan(reached):
            reached = (k + 1) * DT
    off = float(np.linalg.norm(cell.positions - goal, axis=1).mean())
    return Try(off, servo.errors[0], within, spent / (k + 1), reached)


def print_servoing(figures: Figures, tries: int) -> None:
    """How many targets are reached: `tries` by the rod with other numbers, a fifth of them by MuJoCo's cable, and as
    many by the rod seen by the tracker, as a cloud of points in any order."""
    robot = Robot.from_yaml(ROBOT)
    held = HeldCable(cs.Predictor(CABLE, model="cosserat", points=POINTS), robot)
    for name, count, what, ways in (
        ("servoing", tries, "at rest", ("closed loop", "open loop")),
        ("servoing, MuJoCo's cable", tries // PART, "MuJoCo's, which swings", ("closed loop", "open loop")),
        ("servoing, tracked", tries // PART, "at rest, seen by the tracker", ("tracked", "open loop")),
    ):
        heading(f"Servoing: {count} centrelines within reach, from home, by a cable not as the model says, {what}")
        found: dict[str, list[Try]] = {how: [] for how in ways}
        for seed in tqdm(range(count), desc=name, unit="target", leave=False, disable=None):
            cell = Cell(robot, Wrong(), seed, mujoco="MuJoCo" in name)
            goal = cell.goal()
            for how, rows in found.items():
                rows.append(approach(cell, held, goal, how))
        tell(figures, found, name)


def tell(figures: Figures, found: dict[str, list[Try]], name: str) -> None:
    """Prints what came out, and holds it to what is asked."""
    print("distance from the target in the end [mm]: mean over the targets, median, 95 % of them, largest; within 5 mm")
    for how, rows in found.items():
        off = 1e3 * np.array([one.off for one in rows])
        told = f"{off.mean():7.2f} {np.median(off):7.2f} {np.quantile(off, 0.95):7.2f} {off.max():7.2f}"
        print(f"{how:12} {told}  {100.0 * (off <= 1e3 * NEAR).mean():5.1f} %")
    seen, unseen = found.values()
    nearer = float(np.mean([one.off for one in unseen]) / np.mean([one.off for one in seen]))
    near = 100.0 * float(np.mean([one.off <= NEAR for one in seen]))
    reached = np.array([one.reached for one in seen])
    if np.isfinite(reached).any():
        print(f"seen, it says that it is there after {np.nanmedian(reached):.1f} s in the median")
    print(f"a step of the servo: {1e3 * np.median([one.seconds for one in seen]):.2f} ms in the median")
    figures.at_least(f"{name}: within 5 mm", near, SHARE, "{:.1f}", " %")
    figures.at_least(f"{name}: nearer than open loop, times", nearer, NEARER, "{:.0f}")
    figures.check(f"{name}: joints within their limits", all(one.within for one in (*seen, *unseen)))
