"""The gradient cable as a boundary value problem for scipy's solve_bvp: the independent reference of bench and tests.

In lengths of L and forces of B / L^2, with s = l / L: componentwise z x'' - x'''' + c x^(6) + q(s) = 0, z = T L^2 / B
unknown, and the arc length as one more state. No formula is shared with the kernels.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_bvp
from scipy.spatial.transform import Rotation

from cable_shape.pose import FreeEnd, Grip
from cable_shape.solve.problem import Problem

Array = NDArray[np.float64]


class GradientBvp:
    """One gradient cable of order 4 or 6 between ends of any kind, without concentrated loads."""

    def __init__(self, problem: Problem, order: int) -> None:
        cable = problem.cable
        self.order, self.length = order, cable.length
        self.stiffness = cable.mean_bending_stiffness
        self.c = 0.0 if order == 4 else (cable.gradient_length / cable.length) ** 2
        self.to_force = self.length**2 / self.stiffness
        self.give = 0.0
        if cable.axial_stiffness is not None:
            self.give = 1.0 / (self.to_force * cable.axial_stiffness)
        self.load = problem.load * self.length * self.to_force
        self.start, self.end = problem.start, problem.end
        self.origin = problem.start.cable_frame.position
        self.tip = np.zeros(3)
        if isinstance(problem.end, FreeEnd):
            if problem.end.moment.any():
                raise ValueError("a moment at a free end is not part of this reference")
            self.tip = (problem.end.force + problem.end.mass * problem.gravity) * self.to_force

    def rate(self, s: Array, y: Array, z: Array) -> Array:
        """dy/ds; y holds x, x', ... by component, then the arc length."""
        d = y[:-1].reshape(self.order, 3, -1)
        out = np.empty_like(y)
        out[:-4] = y[3:-1]
        q = self.load[0][:, None] + (self.load[1] - self.load[0])[:, None] * s
        if self.order == 4:
            out[-4:-1] = z[0] * d[2] + q
        else:
            out[-4:-1] = (d[4] - z[0] * d[2] - q) / self.c
        out[-1] = np.sqrt(d[1, 0] ** 2 + d[1, 1] ** 2 + d[1, 2] ** 2)
        return out

    def conditions(self, before: Array, after: Array, z: Array) -> Array:
        """Boundary defects."""
        defects = [self._defect(self.start, before, z[0]), self._defect(self.end, after, z[0])]
        return np.concatenate((*defects, (before[-1], after[-1] - 1.0 - z[0] * self.give)))

    def _defect(self, end: Grip | FreeEnd, y: Array, z: float) -> Array:
        d = y[:-1].reshape(self.order, 3)
        sixth = self.order == 6
        no_moment = d[2] - self.c * d[4] if sixth else d[2]
        if isinstance(end, FreeEnd):
            force = z * d[1] - d[3] + (self.c * d[5] if sixth else 0.0)
            conditions = [force - self.tip, no_moment, d[3]]
        else:
            place = d[0] - (end.cable_frame.position - self.origin) / self.length
            if end.kind == "pinned":
                conditions = [place, no_moment, d[3]]
            else:
                tangent = Rotation.from_quat(end.cable_frame.quaternion).apply((0.0, 0.0, 1.0))
                conditions = [place, d[1] - tangent, d[2] - end.curvature * self.length]
        return np.concatenate(conditions[: self.order // 2])

    def guess(self, nodes: int) -> tuple[Array, Array]:
        """A parabola of about the right length that sags along the load: a straight line would be singular."""
        s = np.linspace(0.0, 1.0, nodes)
        y = np.zeros((3 * self.order + 1, nodes))
        if isinstance(self.end, FreeEnd):
            chord = 0.5 * Rotation.from_quat(self.start.cable_frame.quaternion).apply((0.0, 0.0, 1.0))
        else:
            chord = (self.end.cable_frame.position - self.origin) / self.length
        size = float(np.linalg.norm(chord))
        load = self.load.sum(axis=0) if self.load.any() else np.array((0.3, 0.5, -1.0))
        load = load - (load @ chord) * chord / size**2
        sag = np.sqrt(0.375 * size * max(1.0 - size, 1e-9)) * load / np.linalg.norm(load)
        y[:3] = chord[:, None] * s + 4.0 * sag[:, None] * s * (1.0 - s)
        y[3:6] = chord[:, None] + 4.0 * sag[:, None] * (1.0 - 2.0 * s)
        y[6:9] = -8.0 * sag[:, None]
        y[-1] = s
        return s, y

    def solve(self, tolerance: float, last: Any = None, z: float = 10.0, nodes: int = 10) -> Any:
        """solve_bvp's answer, from a parabola on `nodes` nodes or from its `last` answer and mesh."""
        if last is None:
            s, y = self.guess(nodes)
            return solve_bvp(self.rate, self.conditions, s, y, [z], tol=tolerance, max_nodes=5_000)
        return solve_bvp(self.rate, self.conditions, last.x, last.y, last.p, tol=tolerance, max_nodes=5_000)

    def at_uniform_arc_length(self, answer: Any, points: int) -> Array:
        """Parameters s (points,) of an answer at uniform arc length, by Newton's method on the length state."""
        s = np.linspace(0.0, 1.0, 20_001)
        arc = answer.sol(s)[-1]
        wanted = np.linspace(arc[0], arc[-1], points)
        out = np.interp(wanted, arc, s)
        for _ in range(3):
            y = answer.sol(out)
            speed = np.linalg.norm(y[3:6], axis=0)
            out = np.clip(out - (y[-1] - wanted) / np.maximum(speed, 1e-6), 0.0, 1.0)
        return out

    def positions(self, answer: Any, points: int) -> Array:
        """(points, 3) [m], world, at uniform arc length."""
        return self.origin + self.length * answer.sol(self.at_uniform_arc_length(answer, points))[:3].T

    def force(self, answer: Any, points: int) -> Array:
        """(points, 3) [N], world: T x' - B x''' + C x^(5)."""
        d = answer.sol(self.at_uniform_arc_length(answer, points))[:-1].reshape(self.order, 3, -1)
        out = answer.p[0] * d[1] - d[3] + (self.c * d[5] if self.order == 6 else 0.0)
        return (out / self.to_force).T
