"""What a closed form is worth: :class:`Judge` estimates how far a shape is from the Cosserat rod."""

from __future__ import annotations

import math
from typing import NamedTuple, final

import numpy as np

from cable_shape.checks import Array
from cable_shape.kernels import rod_judge as kernel
from cable_shape.kernels import rod_judge_mesh as small
from cable_shape.kernels.rod_work import work_size
from cable_shape.models.rod_state import RodState
from cable_shape.pose import FreeEnd, Grip
from cable_shape.problem import Problem
from cable_shape.shape import CableShape

#: Of the sum of what is estimated: the distance, what Newton's method has left, and the small mesh's own error.
SAFETY = 1.25
#: Tolerance / length for which the small mesh is made as it is; it is of fourth order.
_MADE_FOR = 1e-3
_NO_ENDS = np.empty(0)
_NO_TIP = np.zeros(3)


class Beside(NamedTuple):
    """The rod beside a judged shape: enough to start a solver from."""

    nodes: Array  # (N+1,) [m]
    quaternions: Array  # (N+1, 4)
    force: Array  # (3,) [N] at the end
    ends: Array  # (15,) start, end, turns, signs continuous
    start: Grip
    end: Grip | FreeEnd
    layer: float  # m, boundary layer sqrt(EI / |n|), the thinner one

    def frames(self, s: Array) -> Array:
        """Quaternions (k, 4) at arc lengths s (k,), whose signs follow one another."""
        q = self.quaternions
        q[1:] *= np.cumprod(np.sign((q[1:] * q[:-1]).sum(axis=1)))[:, None]
        between = np.stack([np.interp(s, self.nodes, column) for column in q.T], axis=1)
        return np.asarray(between / np.linalg.norm(between, axis=1)[:, None])

    @property
    def twist(self) -> float:
        """[rad], integral of the twist rate."""
        p, q = self.quaternions[:-1].T, self.quaternions[1:].T
        z = p[3] * q[2] - p[2] * q[3] - p[0] * q[1] + p[1] * q[0]
        w = (p * q).sum(axis=0)
        return float(2.0 * np.arctan(z / w).sum())


@final
class Judge:
    """Judges the shapes of one problem; keeps its mesh from one to the next."""

    __slots__ = ("_elements", "_fineness", "_laid", "_mesh", "_problem", "_tip", "_width", "_work", "last")

    def __init__(self) -> None:
        self._problem: Problem | None = None
        self._laid = 0.0  # m, boundary layer that the mesh was made for; 0: none yet
        self._elements = self._width = 0
        self._fineness = 1.0
        self._mesh = self._work = np.empty(0)
        self._tip = _NO_TIP  # (3,) [N], load on a free end that the mesh was made for
        self.last: Beside | None = None

    def estimate(self, problem: Problem, shape: CableShape, state: RodState, before: Array | None) -> float:
        """[m], largest distance of `shape` from the stable rod beside it, which is then `last`; infinite: none there.

        Parameters
        ----------
        state : RodState
            Of this problem; only the numbers of its cable, ends and loads are used.
        before : (15,), optional
            Ends of the last shape: signs and turns follow from them. None: cold.
        """
        self.last = None
        if state.problem is not problem:
            state.take(problem)
        ends = state.aim(problem.start, problem.end)
        if self._problem is not problem:
            self._problem, self._laid = problem, 0.0
            self._fineness = max(1.0, _MADE_FOR * problem.cable.length / problem.tolerance) ** 0.25
        end, width = problem.end, state.width
        if width != self._width:
            self._width, self._tip, self._laid = width, _NO_TIP, 0.0
        if isinstance(end, FreeEnd):
            tip = end.mass * problem.end_fall + end.force + state.end_weight
            if not np.array_equal(tip, self._tip):
                self._tip, self._laid = tip, 0.0
        verdict = np.empty(kernel.VERDICT)
        for _ in range(2):
            q, force = np.empty((self._elements + 1, 4)), np.empty(3)
            code = kernel.OTHER_MESH
            if self._laid > 0.0:
                code = kernel.judge(
                    state.par, self._mesh, self._elements, width, shape.buffer, shape.points, self._laid,
                    _NO_ENDS if before is None else before, ends, q, force, self._work, verdict,
                )  # fmt: skip
            if code != kernel.OTHER_MESH:
                break
            if not self._lay_out(problem, shape, state):
                return math.inf
        if code != kernel.JUDGED:
            return math.inf
        distance, remainder, own, _, layer, _ = verdict.tolist()
        nodes = self._mesh[: self._elements + 1]
        self.last = Beside(nodes, q, force, ends, problem.start, problem.end, layer)
        return SAFETY * (distance + remainder + own)

    def _lay_out(self, problem: Problem, shape: CableShape, state: RodState) -> bool:
        """Another mesh, for this shape; False if it would need too many elements."""
        x, density = np.empty(small.ABSCISSAE), np.empty(small.ABSCISSAE)
        elements, self._laid = small.plan(
            state.par, shape.buffer, shape.points, self._fineness, state.stops.size, x, density
        )
        if elements > small.MOST_ELEMENTS + 2 * state.stops.size:
            self._laid = 0.0
            return False
        mesh = np.empty(17 * elements + 1)
        loads = (problem.load, state.points, state.weights, self._tip, state.table)
        small.lay_out(mesh, elements, x, density, state.stops, *loads)
        self._mesh, self._elements = mesh, elements
        self._work = np.empty(work_size(elements, state.width))
        return True
