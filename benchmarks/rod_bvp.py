"""The rod as a boundary value problem for scipy's solve_bvp: the independent reference of benches."""

from __future__ import annotations

import numpy as np
from scipy.integrate import solve_bvp
from scipy.spatial.transform import Rotation, Slerp

import cable_shape as cs
from cable_shape.kernels.network.guess import CURVED, HANGING
from cable_shape.kernels.network.tables import TRIAL
from cable_shape.solve.network import Network
from cable_shape.solve.problem import Problem


class Collocation:
    """The rod as a boundary value problem of 13 states (r, q, M in the cable frame, n) for solve_bvp, vectorised,
    with its analytic Jacobian."""

    def __init__(self, cable: cs.Cable) -> None:
        self.flex = 1.0 / np.array((*cable.bending_stiffness, cable.twisting_stiffness))
        self.load = np.array((0.0, 0.0, -9.81 * cable.linear_density))

    def directors(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Directors (3 of them, 3 components, k) and their derivatives in q (3, 3, 4, k)."""
        x, y, z, w = q
        o = np.zeros_like(x)
        d = np.array((
            (1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)),
            (2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)),
            (2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)),
        ))  # fmt: skip
        g = 2 * np.array((
            ((o, -2 * y, -2 * z, o), (y, x, w, z), (z, -w, x, -y)),
            ((y, x, -w, -z), (-2 * x, o, -2 * z, o), (w, z, y, x)),
            ((z, w, x, y), (-w, z, y, -x), (-2 * x, -2 * y, o, o)),
        ))  # fmt: skip
        return d, g

    def slopes(self, s: np.ndarray, Y: np.ndarray) -> np.ndarray:
        """d/ds of the states."""
        q, M, n = Y[3:7], Y[7:10], Y[10:13]
        d, _ = self.directors(q)
        u = self.flex[:, None] * M
        N = (d * n).sum(axis=1)
        x, y, z, w = q
        a, b, c = 0.5 * u
        out = np.empty_like(Y)
        out[0:3] = d[2]
        out[3:7] = w * a + y * c - z * b, w * b + z * a - x * c, w * c + x * b - y * a, -(x * a + y * b + z * c)
        out[7:10] = np.cross(M.T, u.T).T + np.array((N[1], -N[0], 0 * N[0]))
        out[10:13] = -self.load[:, None]
        return out

    def jacobian(self, s: np.ndarray, Y: np.ndarray) -> np.ndarray:
        """Derivative of the slopes in the states."""
        q, M, n = Y[3:7], Y[7:10], Y[10:13]
        d, g = self.directors(q)
        J = np.zeros((13, 13, Y.shape[1]))
        J[0:3, 3:7] = g[2]
        x, y, z, w = q
        a, b, c = 0.5 * self.flex[:, None] * M
        o = np.zeros_like(a)
        J[3:7, 3:7] = np.array(((o, c, -b, a), (-c, o, a, b), (b, -a, o, c), (-a, -b, -c, o)))
        e, f, h = 0.5 * self.flex
        J[3:7, 7:10] = np.array(
            ((w * e, -z * f, y * h), (z * e, w * f, -x * h), (-y * e, x * f, w * h), (-x * e, -y * f, -z * h))
        )
        i, j, k = self.flex
        m1, m2, m3 = M
        J[7:10, 7:10] = np.array(
            ((o, (k - j) * m3, (k - j) * m2), ((i - k) * m3, o, (i - k) * m1), ((j - i) * m2, (j - i) * m1, o))
        )
        J[7, 3:7], J[8, 3:7] = (g[1] * n[:, None]).sum(axis=0), -(g[0] * n[:, None]).sum(axis=0)
        J[7, 10:13], J[8, 10:13] = d[1], -d[0]
        return J

    def solve(self, x: np.ndarray, Y: np.ndarray, start: cs.Pose, end: cs.Pose, tol: float = 1e-3) -> object:
        """solve_bvp from the states Y at x."""
        q0 = start.quaternion * np.sign(start.quaternion @ Y[3:7, 0])
        p = end.quaternion * np.sign(end.quaternion @ Y[3:7, -1])
        px, py, pz, pw = p
        L = np.array(((pw, pz, -py, -px), (-pz, pw, px, -py), (py, -px, pw, -pz)))  # vector part of conj(p) q
        A, B = np.zeros((13, 13)), np.zeros((13, 13))
        A[0:3, 0:3], A[3:7, 3:7], B[7:10, 0:3], B[10:13, 3:7] = np.eye(3), np.eye(4), np.eye(3), L
        target = np.concatenate((start.position, q0, end.position, np.zeros(3)))
        return solve_bvp(
            self.slopes, lambda a, b: A @ a + B @ b - target, x, Y, fun_jac=self.jacobian,
            bc_jac=lambda a, b: (A, B), tol=tol, max_nodes=20_000,
        )  # fmt: skip


def states(shape: cs.CableShape) -> np.ndarray:
    """A shape as solve_bvp's states."""
    M = Rotation.from_quat(shape.quaternions).inv().apply(shape.moment)
    return np.hstack((shape.positions, shape.quaternions, M, shape.force)).T


def same_guess(cable: cs.Cable, start: cs.Pose, end: cs.Pose, points: int = 11) -> tuple[np.ndarray, np.ndarray]:
    """A cold start for solve_bvp: the frames and force that the rod solver itself starts from."""
    problem = Problem(cable).move(start, end)
    state = Network(problem)
    poses = state.aim(problem.start, problem.end)
    state.first_mesh(poses)
    kind, sag = (CURVED, 0.3) if cable.bending_stiffness[0] > 0.1 else (HANGING, 0.0)
    state.start_from(poses, kind, sag)
    trial, s = state.solution(TRIAL), state.nodes
    frames = Rotation.from_quat(trial.q)
    x = np.linspace(0.0, cable.length, points)
    between = Slerp(s, frames)
    q = between(x).as_quat()
    q[1:] *= np.cumprod(np.sign((q[1:] * q[:-1]).sum(axis=1)))[:, None]
    h = 1e-3 * cable.length
    near = np.clip(x, h, cable.length - h)
    u = (between(near - h).inv() * between(near + h)).as_rotvec() / (2 * h)
    Y = np.empty((13, points))
    tangents = between(x).apply((0.0, 0.0, 1.0))
    steps = 0.5 * (tangents[1:] + tangents[:-1]) * np.diff(x)[:, None]
    Y[0:3] = (start.position + np.vstack((np.zeros(3), np.cumsum(steps, axis=0)))).T
    Y[3:7], Y[7:10] = q.T, u.T * np.array((*cable.bending_stiffness, cable.twisting_stiffness))[:, None]
    Y[10:13] = trial.lam[0][:, None] + np.outer((0.0, 0.0, -9.81 * cable.linear_density), cable.length - x)
    return x, Y
