"""What the tests of the Cosserat predictor share: a cable, a grasp, and the rod equations integrated independently."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise
from types import ModuleType

import numpy as np
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from cable_shape.cable.cable import Cable
from cable_shape.kernels import rod_mesh
from cable_shape.kernels.network import drive
from cable_shape.kernels.network.newton import CONVERGED
from cable_shape.pose import FreeEnd, Grip, Pose
from cable_shape.prediction.predictor import Predictor
from cable_shape.shape import CableShape, Status
from cable_shape.solve import cosserat
from cable_shape.solve.network import Network
from cable_shape.solve.problem import Problem

ALONG_X = (0.5, 0.5, 0.5, 0.5)  # d1 = y, d2 = z, d3 = x
LENGTH = 1.2
CABLE = Cable(length=LENGTH, linear_density=0.1, bending_stiffness=0.01, twisting_stiffness=0.008)
START = Pose((0, 0, 0), ALONG_X)
END = Pose(
    (0.7, 0.3, -0.1),
    (Rotation.from_euler("z", 45, degrees=True) * Rotation.from_euler("y", 30, degrees=True)
     * Rotation.from_quat(ALONG_X) * Rotation.from_euler("z", 90, degrees=True)).as_quat(),
)  # fmt: skip


def solved(cable: Cable, start, end, state: Network | None = None, **options) -> CableShape:
    """A shape from nothing, or from `state`."""
    problem = Problem(cable, **options).move(start, end)
    return cosserat.solve(problem, state)


def moved(pose: Pose, shift=(0.0, 0.0, 0.0), turn=(0.0, 0.0, 0.0)) -> Pose:
    """A pose moved in the world and turned about its own origin."""
    q = Rotation.from_rotvec(turn) * Rotation.from_quat(pose.quaternion)
    return Pose(pose.position + np.asarray(shift), q.as_quat())


def rod_equations(cable: Cable, load: np.ndarray) -> Callable[[float, np.ndarray], np.ndarray]:
    """y' of y = (r, R row by row, n, m) (18,) in arc length, under `load` (3,) [N/m]."""
    K = np.array((*cable.bending_stiffness, cable.twisting_stiffness))
    C = np.array([0.0 if a is None else 1.0 / a for a in (cable.shear_stiffness,) * 2 + (cable.axial_stiffness,)])
    u0 = np.asarray(cable.rest_curvature)

    def slopes(_, y):
        R, n, m = y[3:12].reshape(3, 3), y[12:15], y[15:]
        u = R.T @ m / K + u0
        V = np.array((0.0, 0.0, 1.0)) + C * (R.T @ n)
        spin = np.array(((0.0, -u[2], u[1]), (u[2], 0.0, -u[0]), (-u[1], u[0], 0.0)))
        return np.concatenate((R @ V, (R @ spin).ravel(), -load, -np.cross(R @ V, n)))

    return slopes


def integrated_residual(cable: Cable, shape: CableShape, load: np.ndarray) -> float:
    """Largest defect when the rod's equations are integrated from each point of the shape to the next (DOP853)."""
    slopes = rod_equations(cable, load)
    stiffest = max(*cable.bending_stiffness, cable.twisting_stiffness)
    frames = Rotation.from_quat(shape.quaternions).as_matrix()
    force = max(float(np.abs(shape.force).max()), 1e-3 * stiffest / cable.length**2)
    moment = max(float(np.abs(shape.moment).max()), 1e-3 * stiffest / cable.length)
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


#: A cable in whose sensitivity every stiffness has a part.
GENERAL = CABLE.replace(
    bending_stiffness=(0.02, 0.03), axial_stiffness=50.0, shear_stiffness=30.0, rest_curvature=(1.0, 0.5, 0.2)
)


def on_mesh(state: Network, counts: list[int], layer: float | None = None) -> CableShape:
    """The equilibrium next to the last one on a mesh of `counts` elements a span, to rounding.

    Half of the elements are within a few boundary layers of the spans' ends, of `layer` times the span if given.
    """
    poses, bounds, pieces = state.poses.copy(), state.bounds().copy(), []
    layers = state.layers(poses)
    for j, (a, b) in enumerate(pairwise(bounds)):
        x, density = np.empty(129), np.empty(129)
        depth = layers[j] if layer is None else layer * (b - a)
        rod_mesh.layered(b - a, min(max(depth, 1e-5 * (b - a)), b - a), x, density)
        pieces.append((x + a, density))
    state.lay_out(pieces, tuple(counts))
    points = state.problem.points
    buffer, loads = CableShape.new_buffer(points), np.empty((state.spans + 1, 7))
    for _ in range(4):
        state.target[...] = poses
        code = drive.solve(
            state.ints, state.floats, state.sols, state.work, buffer, state.info, loads, points, 1, False,
            bool(state.rings), False, 60, math.inf,
        )  # fmt: skip
        assert code == CONVERGED
    return CableShape(buffer, points, length=state.length, model="", status=Status.OK, supports=loads[1:-1],
                      error_estimate=float(state.info[drive.I_ESTIMATE]))  # fmt: skip


def sensitivities(
    model: ModuleType, state: Network, kinds: tuple[str, str], step: float = 2e-5
) -> tuple[np.ndarray, np.ndarray]:
    """d positions / d (twists of START and END, held so), (n, 3, 12): what the model says, and by differences."""

    def positions(x) -> np.ndarray:
        start = Grip(moved(START, x[:3], x[3:6]), kind=kinds[0])
        end = FreeEnd(0.1) if kinds[1] == "free" else Grip(moved(END, x[6:9], x[9:]), kind=kinds[1])
        shape = model.solve(state.problem.move(start, end), state)
        assert shape.status is Status.OK
        return shape.positions

    positions(np.zeros(12))
    found = model.sensitivity(state)
    columns = [(positions(x) - positions(-x)) / (2.0 * step) for x in step * np.eye(12)]
    return found, np.stack(columns, axis=2)


def arch_predictor(chord: float = 0.9) -> tuple[Predictor, Pose, Pose]:
    """A weightless, buckled strip; turning both ends the same way makes it snap through."""
    cable = Cable(length=1.0, linear_density=0.0, bending_stiffness=0.02, twisting_stiffness=0.015)
    return Predictor(cable, model="cosserat"), *arch_ends(0.0, chord)


def arch_ends(tilt: float, chord: float = 0.9) -> tuple[Pose, Pose]:
    """Ends of the arch, which bows to +z: both pitched by `tilt` [rad], start and end mirrored, from bowing to flat."""
    ends = []
    for x, sign in ((0.0, 1.0), (chord, -1.0)):
        turn = sign * (tilt * (1.02 if sign > 0.0 else 1.0) - 0.6)  # a little askew: a fold, no pitchfork
        q = Rotation.from_rotvec((0.0, turn, 0.0)) * Rotation.from_quat(ALONG_X)
        ends.append(Pose((x, 0.0, 0.0), q.as_quat()))
    return ends[0], ends[1]
