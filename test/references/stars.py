"""Stars of three arms, as they are held to collocation, and what it found: harnesses/stars.json, written by this file.

Three arms of different stiffness, weight and length on a junction with a mass; the second one ends in it. Far ends are
clamped, or nothing holds them. Nothing of the package is used but a shape that the collocation starts from.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

HERE = Path(__file__).parent
FILE = HERE / "harnesses" / "stars.json"
if __name__ == "__main__":
    sys.path += [str(HERE.parent / "helpers"), str(HERE.parents[1])]

import collocation  # noqa: E402

import cable_shape as cs  # noqa: E402

STIFFNESS = ((0.012, 0.012, 0.009), (0.03, 0.02, 0.02), (0.006, 0.006, 0.005))
LENGTHS, WEIGHTS = (0.5, 0.7, 0.6), (0.6, 1.2, 0.9)  # m, N/m
WAYS = np.array(((1.0, 0.1, 0.2), (-0.7, 0.8, 0.1), (-0.6, -0.9, 0.3)))
FAR = ((0.42, 0.05, 0.1), (-0.35, 0.4, 0.05), (-0.3, -0.38, 0.15))
REST = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.5, 0.0, 0.3))
TIP, COUPLE = np.array((0.05, 0.1, -0.2)), np.array((0.002, 0.004, 0.003))  # on far ends that are free
NO_COUPLE = 0.0 * COUPLE
MASS = 0.04
FORCE = MASS * np.array((0.0, 0.0, -9.81))
NAMES = ("a", "b", "c")
#: Of each what is free, and the dead moment on it.
CASES = (((), NO_COUPLE), ((2,), NO_COUPLE), ((1,), NO_COUPLE), ((1, 2), NO_COUPLE), ((2,), COUPLE), ((1,), COUPLE))
POINTS = 41  # of each arm
TOLERANCE = 1e-10  # of solve_bvp


class Solved(NamedTuple):
    """What collocation found of one arm, at even fractions of its length."""

    positions: np.ndarray  # (POINTS, 3) [m]
    forces: np.ndarray  # (POINTS, 3) [N]
    moments: np.ndarray  # (POINTS, 3) [N m], world


def meets(arm: int) -> int:
    """0: it starts at the junction, 1: it ends there."""
    return int(arm == 1)


def frame_along(direction: Sequence[float], roll: float = 0.0) -> np.ndarray:
    """(4,) a rotation whose d3 points along a direction."""
    t = np.asarray(direction) / np.linalg.norm(direction)
    turn, _ = Rotation.align_vectors([t], [(0.0, 0.0, 1.0)])
    return (turn * Rotation.from_rotvec((0.0, 0.0, roll))).as_quat()


def frames(arm: int) -> tuple[np.ndarray, np.ndarray]:
    """The frame of an arm's end in the junction, in that of the junction, and that in which its far end is clamped."""
    way = WAYS[arm] / np.linalg.norm(WAYS[arm])
    if meets(arm):
        return frame_along(-way, 0.3), frame_along(-np.add(way, (0.0, 0.0, 0.3)), 0.2)
    return frame_along(way, 0.3), frame_along(np.add(way, (0.0, 0.2, 0.3)), -0.3)


def harness(free: Sequence[int], couple: np.ndarray) -> tuple[cs.Harness, dict[str, Any]]:
    """A star, and its ends."""
    segments, inner, ends = {}, {}, {}
    for i, name in enumerate(NAMES):
        K = STIFFNESS[i]
        segments[name] = cs.Cable(LENGTHS[i], WEIGHTS[i] / 9.81, K[:2], K[2], rest_curvature=REST[i])
        here, far = (f"{name}.{side}" for side in (("end", "start") if meets(i) else ("start", "end")))
        frame, clamped = frames(i)
        inner[here] = cs.Pose(quaternion=frame)
        ends[far] = cs.FreeEnd(0.0, TIP, couple) if i in free else cs.Pose(FAR[i], clamped)
    return cs.Harness(segments, [cs.Junction("fork", tuple(inner), frames=inner, mass=MASS)]), ends


def solved(free: Sequence[int], couple: np.ndarray) -> list[Solved]:
    """A star as it was found, from the file."""
    case = next(k for k, one in enumerate(CASES) if one[0] == tuple(free) and np.array_equal(one[1], couple))
    out = []
    for arm, found in enumerate(json.loads(FILE.read_text(encoding="utf-8"))[case]):
        weight = WEIGHTS[arm] * LENGTHS[arm] * np.linspace(0.0, 1.0, POINTS)
        forces = np.array(found["force"]) + np.outer(weight, (0.0, 0.0, 1.0))
        out.append(Solved(np.array(found["positions"]), forces, np.array(found["moments"])))
    return out


def find(free: Sequence[int], couple: np.ndarray) -> list[dict[str, Any]]:
    """By collocation: of each arm positions, moments and the force at its start."""
    made, ends = harness(free, couple)
    starts, arms = [], []
    for i, shape in enumerate(cs.predict(made, ends, points=161, tolerance=1e-9).segments.values()):
        inside = Rotation.from_quat(shape.quaternions).inv().apply(shape.moment)
        rows = np.concatenate((shape.positions, shape.quaternions, inside, shape.force), axis=1)
        spline = CubicSpline(np.linspace(0.0, 1.0, shape.points), rows, axis=0)
        starts.append(lambda x, spline=spline: spline(x).T)
        frame, clamped = frames(i)
        K, rest = collocation.constant(STIFFNESS[i]), collocation.constant(REST[i])
        tip = (TIP, couple) if i in free else None
        arms.append(collocation.Arm(LENGTHS[i], K, rest, WEIGHTS[i], FAR[i], clamped, meets(i), frame, tip))
    states = collocation.solve(arms, starts, FORCE, tol=TOLERANCE).sol(np.linspace(0.0, 1.0, POINTS))
    out = []
    for rows in states.T.reshape(POINTS, len(NAMES), collocation.STATES).swapaxes(0, 1):
        moments = Rotation.from_quat(rows[:, 3:7]).apply(rows[:, 7:10])
        out.append(
            {
                "positions": rows[:, :3].round(13).tolist(),
                "moments": moments.round(13).tolist(),
                "force": rows[0, 10:].round(13).tolist(),
            }
        )
    return out


if __name__ == "__main__":
    FILE.write_text(json.dumps([find(*case) for case in CASES]) + "\n", encoding="utf-8")
