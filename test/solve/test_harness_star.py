"""Harnesses of three arms against collocation of the coupled problem, which shares no code with the solver."""

from __future__ import annotations

import collocation
import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

import cable_shape as cs

STIFFNESS = ((0.012, 0.012, 0.009), (0.03, 0.02, 0.02), (0.006, 0.006, 0.005))
LENGTHS, WEIGHTS = (0.5, 0.7, 0.6), (0.6, 1.2, 0.9)  # m, N/m
WAYS = np.array(((1.0, 0.1, 0.2), (-0.7, 0.8, 0.1), (-0.6, -0.9, 0.3)))
FAR = ((0.42, 0.05, 0.1), (-0.35, 0.4, 0.05), (-0.3, -0.38, 0.15))
REST = (0.5, 0.0, 0.3)
TIP, COUPLE = np.array((0.05, 0.1, -0.2)), np.array((0.002, 0.004, 0.003))
MASS = 0.04
NAMES = ("a", "b", "c")


def frame_along(direction, roll: float = 0.0) -> np.ndarray:
    """(4,) a rotation whose d3 points along a direction."""
    t = np.asarray(direction) / np.linalg.norm(direction)
    turn, _ = Rotation.align_vectors([t], [(0.0, 0.0, 1.0)])
    return (turn * Rotation.from_rotvec((0.0, 0.0, roll))).as_quat()


def star(free: tuple[int, ...], couple: np.ndarray):
    """Three arms of different stiffness, weight and length on a junction with a mass; the second one ends in it."""
    segments, frames, ends, arms = {}, {}, {}, []
    for i, way in enumerate(WAYS / np.linalg.norm(WAYS, axis=1)[:, None]):
        meets = int(i == 1)
        rotation = frame_along(np.add(way, (0.0, 0.2, 0.3)), -0.3)
        if meets:
            rotation = frame_along(-np.add(way, (0.0, 0.0, 0.3)), 0.2)
        rest = REST if i == 2 else (0.0, 0.0, 0.0)
        k = STIFFNESS[i]
        segments[NAMES[i]] = cs.Cable(LENGTHS[i], WEIGHTS[i] / 9.81, k[:2], k[2], rest_curvature=rest)
        here, far = (f"{NAMES[i]}.{side}" for side in (("end", "start") if meets else ("start", "end")))
        frame = frame_along(-way if meets else way, 0.3)
        frames[here] = cs.Pose(quaternion=frame)
        tip = (TIP, couple) if i in free else None
        ends[far] = cs.FreeEnd(0.0, TIP, couple) if i in free else cs.Pose(FAR[i], rotation)
        arms.append(
            collocation.Arm(
                LENGTHS[i], collocation.constant(k), collocation.constant(rest), WEIGHTS[i], FAR[i], rotation, meets,
                frame, tip,
            )
        )  # fmt: skip
    junction = cs.Junction("fork", tuple(frames), frames=frames, mass=MASS)
    return cs.Harness(segments, [junction]), ends, arms


def states(shape: cs.CableShape):
    """A segment as collocation's states at fractions of it."""
    moments = Rotation.from_quat(shape.quaternions).inv().apply(shape.moment)
    rows = np.concatenate((shape.positions, shape.quaternions, moments, shape.force), axis=1)
    spline = CubicSpline(np.linspace(0.0, 1.0, shape.points), rows, axis=0)
    return lambda x: spline(x).T


@pytest.mark.parametrize(
    ("free", "couple"), [((), 0.0 * COUPLE), ((2,), 0.0 * COUPLE), ((1,), COUPLE), ((1, 2), 0.0 * COUPLE)]
)
def test_three_arms_are_what_collocation_finds(free, couple):
    """To a millionth of the length, forces and moments to that of EI / L^2 and EI / L; within its own estimates."""
    harness, ends, arms = star(free, couple)
    fine = cs.predict(harness, ends, points=161, tolerance=1e-9)
    assert fine.status is cs.Status.OK
    starts = [states(shape) for shape in fine.segments.values()]
    found = collocation.solve(arms, starts, MASS * np.array((0.0, 0.0, -9.81)), tol=1e-10)
    x = np.linspace(0.0, 1.0, 161)
    for shape, share, unit in ((fine, 1e-8, 1e-6), (cs.predict(harness, ends, points=161, tolerance=1e-6), 1e-6, 1e-3)):
        for i, one in enumerate(shape.segments.values()):
            rows = found.sol(x)[13 * i : 13 * i + 13].T
            off = np.linalg.norm(one.positions - rows[:, :3], axis=1).max()
            assert off <= min(max(share * one.length, shape.error_estimate), 1e-6 * one.length)
            force, moment = rows[:, 10:], Rotation.from_quat(rows[:, 3:7]).apply(rows[:, 7:10])
            bend = STIFFNESS[i][0]
            assert np.abs(one.force - force).max() <= unit * bend / one.length**2 * 100.0
            assert np.abs(one.moment - moment).max() <= unit * bend / one.length * 10.0
