"""Networks of rods built by hand from knots, spans and pieces: :class:`Net`, for tests and benches of the solver.

A rod runs through knots, has a span between each two of them, and in each piece of it stiffness and rest curvature
change linearly. What the arrays hold: :mod:`cable_shape.kernels.network.tables`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from scipy.spatial.transform import Rotation

from cable_shape.kernels.network import drive, guess, material, respond, tables
from cable_shape.kernels.network.drive import INFO
from cable_shape.kernels.network.tables import NOW, TRIAL
from cable_shape.solve.plan import Cable, Knot, Span, make_plan

HELD, TURNS = (0.0, 0.0, 0.0), (1.0, 1.0, 1.0)
STRAIGHT_ON = (0.0, 0.0, 0.0, 1.0)
#: The frame of a cable that arrives at a knot, in that of the same cable leaving it: half a turn about d1.
REVERSED = (1.0, 0.0, 0.0, 0.0)
GRAVITY = np.array((0.0, 0.0, -9.81))


@dataclass
class Point:
    """A knot: given, or unknown in rotation (`loose`, about d1 d2 d3) and place (`moves`)."""

    place: Sequence[float]
    rotation: Sequence[float] = STRAIGHT_ON
    loose: Sequence[float] = HELD
    moves: bool = False
    force: Sequence[float] = HELD  # dead, N
    moment: Sequence[float] = HELD  # dead, N m, on the ends in it that are not tied


@dataclass
class Piece:
    """A stretch of rod: stiffness (EI1, EI2, GJ) and rest curvature at its left and, if they change, at its right."""

    length: float
    stiffness: Sequence[float]
    stiffness_right: Sequence[float] | None = None
    rest: Sequence[float] = HELD
    rest_right: Sequence[float] | None = None
    weight: float = 1.0  # N/m
    compliance: Sequence[float] = HELD


@dataclass
class Rod:
    """A cable through `knots`; `nodes`: arc lengths of the nodes of each span, both ends included."""

    knots: Sequence[int]
    pieces: Sequence[Piece]
    nodes: Sequence[np.ndarray]
    frames: dict[tuple[int, int], Sequence[float]] = field(default_factory=dict)  # (span, end): own frame in its knot
    loads: Sequence[tuple[float, Sequence[float]]] = ()  # dead, at nodes
    untied: dict[tuple[int, int], Sequence[float]] = field(default_factory=dict)  # (span, end): own free rotations

    @property
    def length(self) -> float:
        return sum(piece.length for piece in self.pieces)


def even(length: float, *elements: int) -> list[np.ndarray]:
    """Nodes of spans of one length each, so many even elements in each."""
    bounds = np.linspace(0.0, length, len(elements) + 1)
    return [np.linspace(a, b, n + 1) for (a, b), n in zip(pairwise(bounds), elements, strict=True)]


def frame_along(direction: Sequence[float], roll: float = 0.0) -> np.ndarray:
    """(4,) a rotation whose d3 points along a direction."""
    t = np.asarray(direction) / np.linalg.norm(direction)
    turn, _ = Rotation.align_vectors([t], [(0.0, 0.0, 1.0)])
    return (turn * Rotation.from_rotvec((0.0, 0.0, roll))).as_quat()


class Net:
    """Rods between points, and the solver's arrays for them.

    A span's end turns with its point where that is `loose`; elsewhere the point holds it but for its `untied`
    rotations.
    """

    def __init__(
        self, points: Sequence[Point], rods: Sequence[Rod], samples: int = 41, pressed: Sequence[Sequence[int]] = ()
    ) -> None:
        self.points, self.rods, self.samples = list(points), list(rods), samples
        knots = [Knot(turns=any(point.loose), moves=point.moves) for point in points]
        spans: list[Span] = []
        free, frames = [], []
        self.runs: list[range] = []  # the spans of each rod
        for rod in rods:
            first = len(spans)
            for j, pair in enumerate(pairwise(rod.knots)):
                own = [rod.untied.get((j, end)) for end in range(2)]
                tied = [knots[pair[end]].turns and own[end] is None for end in range(2)]
                turned = [(j, end) in rod.frames for end in range(2)]
                spans.append(Span(*pair, (tied[0], tied[1]), (turned[0], turned[1])))
                free.append([HELD if mask is None else mask for mask in own])
                frames.append([rod.frames.get((j, end), STRAIGHT_ON) for end in range(2)])
            self.runs.append(range(first, len(spans)))
        cables = [Cable(len(rod.nodes), len(rod.pieces), len(rod.loads), (rod.knots[0], rod.knots[-1])) for rod in rods]
        self.nodes = [nodes for rod in rods for nodes in rod.nodes]
        self.ints = make_plan(knots, spans, cables, [nodes.size - 1 for nodes in self.nodes], pressed=pressed)
        self.floats = np.zeros(tables.model_size.py_func(self.ints))
        self.size = int(tables.solution_size.py_func(self.ints))
        self.sols = np.zeros(3 * self.size)
        self.work = np.zeros(tables.work_size.py_func(self.ints))
        self.info = np.zeros(INFO + 2 * len(rods))
        self.buffer = np.full(17 * samples * len(rods), np.nan)
        self.loads = np.zeros((len(points), 7))
        self.plan = tables.plan_of.py_func(self.ints)
        self.model = tables.model_of.py_func(self.ints, self.floats)
        self.space = tables.work_of.py_func(self.ints, self.work)
        self.model.free[...] = free
        self.model.frame[...] = frames
        self.fill()
        self.trial.pose[...] = [(*point.place, *point.rotation) for point in points]

    def fill(self) -> None:
        """Takes over what rods and points are made of."""
        model = self.model
        model.loose[...] = [point.loose if any(point.loose) else HELD for point in self.points]
        model.force[...] = [point.force for point in self.points]
        model.moment[...] = [point.moment for point in self.points]
        model.s[...] = np.concatenate(self.nodes)
        model.heavy[...] = [rod.pieces[0].weight * GRAVITY / np.linalg.norm(GRAVITY) for rod in self.rods]
        model.breaks[...] = np.concatenate(
            [np.concatenate(([0.0], np.cumsum([piece.length for piece in rod.pieces]))) for rod in self.rods]
        )
        pieces = [piece for rod in self.rods for piece in rod.pieces]
        for row, piece in zip(model.piece, pieces, strict=True):
            right = piece.stiffness if piece.stiffness_right is None else piece.stiffness_right
            bent = piece.rest if piece.rest_right is None else piece.rest_right
            weight = (0.0, 0.0, -piece.weight)
            row[: material.COMPLIANCE] = *piece.stiffness, *piece.rest, *weight, *right, *bent, *weight
            row[material.COMPLIANCE :] = piece.compliance
        loads = [load for rod in self.rods for load in rod.loads]
        if loads:
            model.at[...] = [at for at, _ in loads]
            model.act[...] = [act for _, act in loads]
        length = sum(rod.length for rod in self.rods)
        stiffness = np.array([(piece.stiffness, piece.stiffness_right or piece.stiffness) for piece in pieces])
        par = model.par
        par[tables.LENGTH], par[tables.SOFTEST] = length, stiffness.min() / length**2
        par[tables.STIFFEST], par[tables.BASE_SHIFT] = stiffness.max(), 1e-4 * stiffness.min() / length**2
        par[tables.TURN_AT_REST], par[tables.SOFT] = math.inf, 1.0
        stretchy = [any(piece.compliance) for piece in pieces]
        par[tables.ELASTIC], par[tables.RIGID] = any(stretchy), not all(piece.compliance[2] for piece in pieces)
        material.add_up(self.ints, self.floats)
        drive.refill(self.ints, self.floats)

    # -- solving

    def start(self, kind: int = guess.CURVED, sag: float = 0.3) -> None:
        """Puts a guess into the trial: unknown points are about where they were said to be."""
        self.trial.pose[...] = [(*point.place, *point.rotation) for point in self.points]
        drive.strip(self.ints, self.floats, self.sols)
        placed = np.array([int(any(point.loose)) for point in self.points], dtype=np.int64)
        guess.guess(self.ints, self.floats, self.sols, placed, kind, sag, False)

    def solve(self, history: int = 0, guard: bool = True, most: int = 100, points: int | None = None) -> int:
        """One compiled solve; see `drive.solve` for what it returns."""
        points = self.samples if points is None else points
        code = drive.solve(
            self.ints, self.floats, self.sols, self.work, self.buffer, self.info, self.loads, points, history, False,
            False, guard, most, math.inf,
        )  # fmt: skip
        return int(code)

    def settle(self, kind: int = guess.CURVED, sag: float = 0.3, guard: bool = True) -> Net:
        """The equilibrium that a guess leads to, to rounding."""
        self.start(kind, sag)
        code = self.solve(guard=guard)
        assert code == 0, f"code {code}, info {self.info}"
        return self.again(guard)

    def again(self, guard: bool = True) -> Net:
        """The solution at hand, to rounding, for points as they are now."""
        for _ in range(3):
            for pose, point in zip(self.trial.pose, self.points, strict=True):
                if not point.moves:
                    pose[:3] = point.place
                if not any(point.loose):
                    pose[3:] = point.rotation
            code = self.solve(1, guard)
            assert code == 0, f"code {code}, info {self.info}"
        return self

    def sensitivities(self, *knots: int) -> np.ndarray:
        """(rods, samples, 3, 6 k): change of the samples' positions with the poses of knots."""
        out, df = np.zeros((len(self.rods) * self.samples, 3, 6 * len(knots))), np.zeros((0, 6 * len(knots)))
        respond.refresh(self.ints, self.floats, self.sols, self.work, True)
        chosen = np.array(knots, dtype=np.int64)
        respond.sensitivities(self.ints, self.floats, self.sols, self.work, self.samples, chosen, out, df)
        return out.reshape(len(self.rods), self.samples, 3, -1)

    def softest(self) -> float:
        """[N], the smallest eigenvalue of the second variation."""
        return float(respond.smallest_eigenvalue(self.ints, self.floats, self.sols, self.work))

    # -- what was found

    @property
    def trial(self) -> tables.Solution:
        return tables.solution_of.py_func(self.ints, self.sols, TRIAL)

    @property
    def now(self) -> tables.Solution:
        return tables.solution_of.py_func(self.ints, self.sols, NOW)

    def block(self, rod: int, first: int, last: int) -> np.ndarray:
        """Columns of a rod's buffer."""
        n = self.samples
        return self.buffer[(17 * rod + first) * n : (17 * rod + last) * n].reshape(n, last - first)

    def positions(self, rod: int) -> np.ndarray:
        """(samples, 3), corrected."""
        return self.block(rod, 1, 4)

    def quaternions(self, rod: int) -> np.ndarray:
        return self.block(rod, 4, 8)

    def forces(self, rod: int) -> np.ndarray:
        return self.block(rod, 11, 14)

    def moments(self, rod: int) -> np.ndarray:
        """(samples, 3) [N m], world."""
        return self.block(rod, 14, 17)

    def at_nodes(self, span: int) -> tuple[np.ndarray, np.ndarray]:
        """Corrected positions (n, 3) and rotations (n, 4) at the nodes of a span."""
        a, b = self.plan.first[span], self.plan.first[span + 1]
        start = self.space.place[self.plan.ends[span, 0]]
        return start + self.steps(span), self.space.start[a + span : b + span + 1]

    def steps(self, span: int) -> np.ndarray:
        """(n, 3) [m]: from the first node of a span to all of them; corrected after a solve."""
        a, b = self.plan.first[span], self.plan.first[span + 1]
        return -np.concatenate((np.zeros((1, 3)), np.cumsum(self.space.first[a:b, :3], axis=0)))

    def raw(self, span: int) -> np.ndarray:
        """Rotations (n, 4) at the nodes of a span as Newton's method leaves them, not corrected."""
        a, b = self.plan.first[span], self.plan.first[span + 1]
        return self.now.q[a + span : b + span + 1]
