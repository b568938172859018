"""Speed of the Cosserat predictor beside scipy's solve_bvp, and along one motion, in one run."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from time import perf_counter, thread_time

import numpy as np
from figures import Figures, heading
from scipy.integrate import solve_bvp
from scipy.spatial.transform import Rotation, Slerp
from tqdm import tqdm

import cable_shape as cs
from cable_shape.kernels.network.guess import CURVED, HANGING
from cable_shape.kernels.network.tables import TRIAL
from cable_shape.solve import cosserat
from cable_shape.solve.network import Network
from cable_shape.solve.problem import Problem

ALONG_X = (0.5, 0.5, 0.5, 0.5)
CABLE = cs.Cable(length=1.2, linear_density=0.1, bending_stiffness=0.01, twisting_stiffness=0.008)
START = cs.Pose((0, 0, 0), ALONG_X)
TURNED = (
    Rotation.from_euler("z", 45, degrees=True) * Rotation.from_euler("y", 30, degrees=True)
    * Rotation.from_quat(ALONG_X) * Rotation.from_euler("z", 90, degrees=True)
)  # fmt: skip
END = cs.Pose((0.7, 0.3, -0.1), TURNED.as_quat())
R = np.sqrt(0.5)
#: Runs of ours between two of solve_bvp's, which take far longer.
OURS_A_ROUND = 5
GRASPS = {
    "A": (CABLE, START, cs.Pose((0.8, 0, 0), ALONG_X)),
    "B": (CABLE, START, END),
    "C": (CABLE, START, cs.Pose((1.15, 0, 0), ALONG_X)),
    "D": (CABLE.replace(bending_stiffness=0.2), cs.Pose((0, 0, 0), (0, 0, R, R)), cs.Pose((0.5, 0, 0), (R, R, 0, 0))),
}


def motion(steps: int = 200) -> list[cs.Pose]:
    """End poses of a smooth lift, swing and turn."""
    axis = np.array((1.0, 2.0, 1.0)) / np.sqrt(6.0)
    poses = []
    for t in np.arange(1, steps + 1) / steps:
        x = 10 * t**3 - 15 * t**4 + 6 * t**5
        shift = np.array((-0.15 * x, 0.15 * np.sin(np.pi * x) - 0.10 * x, 0.20 * x))
        turn = Rotation.from_rotvec(np.radians(40) * x * axis)
        poses.append(cs.Pose(END.position + shift, (turn * TURNED).as_quat()))
    return poses


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


def in_turns(ours: Callable[[], object], theirs: Callable[[], object], rounds: int) -> tuple[float, float]:
    """Median processor times [s] of two, run in turns, `OURS_A_ROUND` of the first to one of the second."""
    spent: tuple[list[float], list[float]] = ([], [])
    for _ in range(rounds):
        for which, run, times in ((0, ours, OURS_A_ROUND), (1, theirs, 1)):
            for _ in range(times):
                began = thread_time()
                run()
                spent[which].append(thread_time() - began)
    return float(np.median(spent[0])), float(np.median(spent[1]))


def print_speed(figures: Figures, quick: bool = False) -> None:
    """Warm steps along the motion, cold grasps, and the first shape of a process."""
    heading("Speed beside scipy.integrate.solve_bvp (tol 1e-3, analytic Jacobian, mesh reused when warm), in turns")
    print_motion(figures, 1 if quick else 3)
    print_cold(figures, 5 if quick else 15)
    script = (
        "import time; import cable_shape as cs; cs.Cable, cs.Pose, cs.predict; t = time.perf_counter(); "
        "cs.predict(cs.Cable(1.2, 0.1, 0.01), cs.Pose(), cs.Pose((0.5, 0, 0.5)), model='cosserat'); "
        "print(time.perf_counter() - t)"
    )
    runs = [
        float(subprocess.run((sys.executable, "-c", script), check=True, timeout=300, stdout=subprocess.PIPE).stdout)
        for _ in range(1 if quick else 3)
    ]
    figures.at_most("first shape after import, kernels cached", float(np.median(runs)), 1.0, "{:.2f}", " s")


def print_motion(figures: Figures, rounds: int) -> None:
    """Warm steps of the motion M: all of ours, then every fourth by solve_bvp, in turns."""
    predictor = cs.Predictor(CABLE, model="cosserat")
    collocation = Collocation(CABLE)
    coarse = cs.predict(CABLE, START, END, model="cosserat", points=11)
    ours, theirs, errors, iterations, estimates = [], [], [], [], []
    poses = motion()
    predictor.predict(START, END)
    shapes = [predictor.predict(START, pose) for pose in poses]
    for _ in tqdm(range(rounds), desc="motion", unit="round", leave=False, disable=None):
        predictor.predict(START, END)
        for pose in poses:
            began = perf_counter()
            shape = predictor.predict(START, pose)
            ours.append(perf_counter() - began)
            iterations.append(shape.iterations)
            estimates.append(shape.error_estimate)
        x, Y = coarse.arc_length.copy(), states(coarse)
        for pose, shape in zip(poses[::4], shapes[::4], strict=True):
            began = perf_counter()
            answer = collocation.solve(x, Y, START, pose)
            theirs.append(perf_counter() - began)
            x, Y = answer.x, answer.y
            apart = np.linalg.norm(answer.sol(shape.arc_length)[:3].T - shape.positions, axis=1)
            errors.append(apart.mean() / CABLE.length)
    a, b = float(np.median(ours)), float(np.median(theirs))
    print(
        f"warm step of the motion M, 150 points: {a * 1e6:.1f} us (99 % {np.percentile(ours, 99) * 1e6:.0f} us, "
        f"{np.mean(iterations):.1f} iterations, estimate at most {max(estimates) / CABLE.length:.1e} L);\n"
        f"solve_bvp {b * 1e3:.2f} ms on {len(x)} nodes, {np.mean(errors):.1e} L from ours"
    )
    exact = cs.Predictor(CABLE, model="cosserat", tolerance=1e-9)
    off = [
        np.linalg.norm(exact.predict(START, pose).positions - shape.positions, axis=1).mean()
        for pose, shape in zip(poses, shapes, strict=True)
    ]
    figures.at_most("motion M, warm: mean error / L, worst step", max(off) / CABLE.length, 1e-5)
    figures.at_least("motion M, warm: times faster than solve_bvp", b / a, 100.0, "{:.0f}")
    state = Network(predictor.problem)
    cosserat.solve(predictor.problem.move(START, END), state)
    spent = []
    for _ in range(200):
        began = perf_counter()
        cosserat.sensitivity(state)
        spent.append(perf_counter() - began)
    print(f"12 sensitivities: {np.median(spent) * 1e6:.0f} us more")


def planar_motion(steps: int = 200) -> list[cs.Pose]:
    """End poses in the plane of START and gravity, lifting and pitching."""
    poses = []
    for x in np.arange(1, steps + 1) / steps:
        pitch = Rotation.from_euler("y", -40 * x, degrees=True) * Rotation.from_quat(ALONG_X)
        poses.append(cs.Pose((0.8 - 0.2 * x, 0, 0.1 * np.sin(np.pi * x) + 0.1 * x), pitch.as_quat()))
    return poses


def print_cold(figures: Figures, rounds: int) -> None:
    """The grasps A to D from nothing."""
    for name, (cable, start, end) in GRASPS.items():
        other, guess = Collocation(cable), same_guess(cable, start, end)
        a, b = in_turns(
            lambda c=cable, s=start, e=end: cs.predict(c, s, e, model="cosserat"),
            lambda o=other, g=guess, s=start, e=end: o.solve(*g, s, e),
            rounds,
        )
        shape, answer = cs.predict(cable, start, end, model="cosserat"), other.solve(*guess, start, end)
        note = "" if answer.status == 0 else ", which failed"
        if answer.status == 0:
            apart = np.linalg.norm(answer.sol(shape.arc_length)[:3].T - shape.positions, axis=1).mean() / cable.length
            figures.at_most(f"grasp {name}, cold: mean distance / L to solve_bvp's shape", apart, 1e-4)
        print(f"cold {name}: {a * 1e6:.0f} us, {shape.status.name}; solve_bvp {b * 1e3:.1f} ms{note}")
        figures.at_least(f"grasp {name}, cold: times faster than solve_bvp", b / a, 50.0, "{:.0f}")
