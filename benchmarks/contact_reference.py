"""Shapes in contact judged: by finer meshes on the same branch, and by how deep they are in bodies."""

from __future__ import annotations

import math
import statistics
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from figures import Figures
from scipy.interpolate import CubicHermiteSpline

import cable_shape as cs
from cable_shape.kernels.network.tables import NOW
from cable_shape.safety.clearance import ClearanceChecker
from cable_shape.solve.network import Network
from cable_shape.solve.touching import touching
from cable_shape.solve.touching.state import TouchState

NEARBY = 0.05  # rad that a frame may turn where a mesh is halved, at least: further away lies another branch
ITERATIONS = 100
_DENSER = 8  # times as many points as a shape, to look for how deep it is
DEEPEST = 2e-4  # m, that a cable may be in a body


def finer(state: TouchState, halvings: int, nearby: float = NEARBY) -> cs.CableShape | None:
    """The last solution of `state`, which stays as it is, on a mesh halved so often; None if its branch is lost."""
    problem = state.problem
    fine = TouchState(problem)
    fine.aim(problem.start, problem.end)
    fine.restore(state.copy())
    frames = fine.grips[NOW].copy()
    solver = touching.Solve(problem, fine, Network(problem), math.inf, 0.0)
    for _ in range(halvings):
        nodes = fine.nodes
        fine.lay_out(np.sort(np.concatenate((nodes, 0.5 * (nodes[1:] + nodes[:-1])))))
        fine.target(frames)
        if not (solver.steps.again(ITERATIONS, far=nearby) and solver.steps.settle(frames)):
            return None
    return solver._finish(cs.Status.OK)


def force_on(shape: cs.CableShape) -> dict[str, Any]:
    """Force of each body on the cable [N], (3,)."""
    sums: dict[str, Any] = {}
    for contact in shape.contacts:
        sums[contact.body] = sums.get(contact.body, 0.0) + contact.force * contact.normal
    return sums


def compared(shape: cs.CableShape, fine: cs.CableShape) -> tuple[float, float]:
    """Largest distance [m] at equal arc length, and largest difference of a body's force over the largest force."""
    a, b = force_on(shape), force_on(fine)
    size = max((float(np.linalg.norm(force)) for force in b.values()), default=math.inf)
    apart = max((float(np.linalg.norm(a.get(name, 0.0) - b.get(name, 0.0))) for name in a | b), default=0.0)
    return float(np.linalg.norm(shape.positions - fine.positions, axis=1).max()), apart / size


def deepest(shape: cs.CableShape, scene: cs.Scene, radius: float) -> float:
    """[m], how deep the densely sampled cable is in the scene's obstacles: a curve, not the straight lines between its
    points, which cut off what is kinked more sharply than they are apart."""
    s = np.linspace(0.0, shape.length, _DENSER * (shape.points - 1) + 1)
    buffer = np.zeros_like(cs.CableShape.new_buffer(s.size))
    dense = cs.CableShape(buffer, s.size, length=shape.length, model=shape.model, status=shape.status)
    dense.arc_length[:] = s
    dense.positions[:] = CubicHermiteSpline(shape.arc_length, shape.positions, shape.tangents)(s)
    found = ClearanceChecker(scene, radius=radius).check(dense)
    return max((-body.distance for body in found.bodies), default=0.0)


HEAD = (
    f"{'':45}{'usable':>12}{'snapped':>8}{'contact':>8}{'deepest':>11}{'median':>9}{'99 %':>9}{'apart / L':>10}"
    f"{'force':>9}{'honest':>11}{'lost':>5}"
)


@dataclass
class Tally:
    """What shapes in contact came to, of one motion or of many; compared with meshes 4 times finer.

    late: 99 % of a motion's times over their median; apart: of the length; force: of a body, over the largest;
    honest: true errors within the estimate; lost: no finer mesh on the same branch.
    """

    shapes: int = 0
    usable: int = 0
    snapped: int = 0
    touched: int = 0
    compared: int = 0
    honest: int = 0
    lost: int = 0
    deepest: float = 0.0  # m
    late: float = 0.0
    apart: float = 0.0
    force: float = 0.0
    times: list[float] = field(default_factory=list)  # s

    def take(self, shape: cs.CableShape, scene: cs.Scene, radius: float, seconds: float) -> None:
        """One shape's."""
        self.shapes += 1
        self.usable += bool(shape.status)
        self.snapped += shape.status is cs.Status.SNAPPED
        self.touched += len(shape.contacts) > 0
        self.times.append(seconds)
        if shape.status:
            self.deepest = max(self.deepest, deepest(shape, scene, radius))

    def judge(self, shape: cs.CableShape, predictor: cs.Predictor, nearby: float = NEARBY) -> None:
        """Compares a usable shape in contact with a finer mesh."""
        if not shape.status or not shape.contacts:
            return
        fine = finer(predictor._solver._touch, 2, nearby)
        if fine is None:
            self.lost += 1
            return
        distance, force = compared(shape, fine)
        self.compared += 1
        self.honest += distance <= shape.error_estimate
        self.apart, self.force = max(self.apart, distance / shape.length), max(self.force, force)

    def add(self, other: Tally) -> None:
        """Another's."""
        for name in ("shapes", "usable", "snapped", "touched", "compared", "honest", "lost", "times"):
            setattr(self, name, getattr(self, name) + getattr(other, name))
        late = float(np.quantile(other.times, 0.99)) / statistics.median(other.times)
        for name, value in (("deepest", other.deepest), ("apart", other.apart), ("force", other.force), ("late", late)):
            setattr(self, name, max(getattr(self, name), value))

    def print_row(self, name: str) -> None:
        """Below :data:`HEAD`."""
        median, late = 1e6 * np.quantile(self.times, (0.5, 0.99))
        print(
            f"{name:45}{self.usable:6d}/{self.shapes:<5d}{self.snapped:8d}{self.touched:8d}{1e3 * self.deepest:8.3f} mm"
            f"{median:6.0f} us{late:6.0f} us{self.apart:10.1e}{100.0 * self.force:7.2f} %"
            f"{self.honest:6d}/{self.compared:<4d}{self.lost:5d}", flush=True
        )  # fmt: skip

    def tell(self, figures: Figures, name: str, usable: float) -> None:
        """As figures: usable [%] is asked."""
        share = 100.0 * self.usable / self.shapes
        figures.at_least(f"{name}: usable", share, usable, "{:.2f}", " %")
        figures.at_most(f"{name}: deepest", 1e3 * self.deepest, 1e3 * DEEPEST, "{:.3f}", " mm")
        figures.at_most(f"{name}: distance / L to a mesh 4 times finer", self.apart, 5e-4)
        honest = 100.0 * self.honest / max(self.compared, 1)
        figures.at_least(f"{name}: true error at most the estimate", honest, 99.0, "{:.1f}", " %")
