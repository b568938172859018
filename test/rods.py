"""What the tests of the Cosserat predictor share: a cable, a grasp, and the rod equations integrated independently."""

from __future__ import annotations

import numpy as np
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from cable_shape.cable import Cable
from cable_shape.models import clipped, cosserat
from cable_shape.models.rod_state import RodState
from cable_shape.models.span_state import SpanState
from cable_shape.pose import Pose
from cable_shape.problem import Problem
from cable_shape.shape import CableShape

ALONG_X = (0.5, 0.5, 0.5, 0.5)  # d1 = y, d2 = z, d3 = x
LENGTH = 1.2
CABLE = Cable(length=LENGTH, linear_density=0.1, bending_stiffness=0.01, twisting_stiffness=0.008)
START = Pose((0, 0, 0), ALONG_X)
END = Pose(
    (0.7, 0.3, -0.1),
    (Rotation.from_euler("z", 45, degrees=True) * Rotation.from_euler("y", 30, degrees=True)
     * Rotation.from_quat(ALONG_X) * Rotation.from_euler("z", 90, degrees=True)).as_quat(),
)  # fmt: skip


def solved(cable: Cable, start, end, state: RodState | SpanState | None = None, **options) -> CableShape:
    """A shape from nothing, or from `state`."""
    problem = Problem(cable, **options).move(start, end)
    return clipped.solve(problem, state) if problem.clips else cosserat.solve(problem, state)


def moved(pose: Pose, shift=(0.0, 0.0, 0.0), turn=(0.0, 0.0, 0.0)) -> Pose:
    """A pose moved in the world and turned about its own origin."""
    q = Rotation.from_rotvec(turn) * Rotation.from_quat(pose.quaternion)
    return Pose(pose.position + np.asarray(shift), q.as_quat())


def integrated_residual(cable: Cable, shape: CableShape, load: np.ndarray) -> float:
    """Largest defect when the rod's equations are integrated from each point of the shape to the next (DOP853)."""
    K = np.array((*cable.bending_stiffness, cable.twisting_stiffness))
    C = np.array([0.0 if a is None else 1.0 / a for a in (cable.shear_stiffness,) * 2 + (cable.axial_stiffness,)])
    u0 = np.asarray(cable.rest_curvature)

    def slopes(_, y):
        R, n, m = y[3:12].reshape(3, 3), y[12:15], y[15:]
        u = R.T @ m / K + u0
        V = np.array((0.0, 0.0, 1.0)) + C * (R.T @ n)
        spin = np.array(((0.0, -u[2], u[1]), (u[2], 0.0, -u[0]), (-u[1], u[0], 0.0)))
        return np.concatenate((R @ V, (R @ spin).ravel(), -load, -np.cross(R @ V, n)))

    frames = Rotation.from_quat(shape.quaternions).as_matrix()
    force = max(float(np.abs(shape.force).max()), 1e-3 * K.max() / cable.length**2)
    moment = max(float(np.abs(shape.moment).max()), 1e-3 * K.max() / cable.length)
    units = np.concatenate((np.full(3, cable.length), np.ones(9), np.full(3, force), np.full(3, moment)))
    states = [
        np.concatenate((r, R.ravel(), n, m))
        for r, R, n, m in zip(shape.positions, frames, shape.force, shape.moment, strict=True)
    ]
    worst = 0.0
    for k in range(shape.points - 1):
        span = (shape.arc_length[k], shape.arc_length[k + 1])
        reached = solve_ivp(slopes, span, states[k], method="DOP853", rtol=1e-9, atol=1e-10 * units).y[:, -1]
        worst = max(worst, float(np.abs((reached - states[k + 1]) / units).max()))
    return worst
