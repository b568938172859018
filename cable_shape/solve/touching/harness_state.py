"""What the solver of a harness among bodies keeps from one solve to the next: :class:`HarnessTouchState`."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from itertools import pairwise
from typing import Any, final

import numpy as np

from cable_shape.cable.cable import Cable
from cable_shape.cable.harness import Harness, split_end
from cable_shape.cable.pieces import radius_of, widest
from cable_shape.cable.rest_form import conjugate, times
from cable_shape.checks import Array
from cable_shape.kernels.contact import check, drive, respond
from cable_shape.kernels.network import tables
from cable_shape.kernels.network.mesh import move_nodes
from cable_shape.kernels.network.tables import NOW
from cable_shape.pose import FreeEnd
from cable_shape.shape import NOT_RUBBED, NUMBERS_PER_POINT, TOUCH
from cable_shape.solve.cables import Structure
from cable_shape.solve.harness_answers import differences
from cable_shape.solve.harness_layout import Layout
from cable_shape.solve.harness_network import HarnessNetwork
from cable_shape.solve.harness_problem import HarnessProblem
from cable_shape.solve.harness_shape import HarnessShape
from cable_shape.solve.plan import Whole, moving
from cable_shape.solve.touching import mesh
from cable_shape.solve.touching.laid import Chain
from cable_shape.solve.touching.state import TouchState

_OF_LEVER = 3  #: nodes
_STRAIGHT = -0.98  #: cosine of the angle between two ends that go on in one


@final
class Laid:
    """A harness's shape as that of one long cable: one segment after the other, levers behind, gaps between them."""

    def __init__(self, shape: HarnessShape, gaps: Array, ring_arcs: Mapping[int, float] | None = None) -> None:
        """gaps (c,) [m], added to the arc lengths of each; shape: of a harness, or what has as much of one.

        ring_arcs: of supports that are eyelets, by their numbers, the arc lengths [m] there.
        """
        n = shape.points
        blocks = shape.buffer[: NUMBERS_PER_POINT * n * gaps.size].reshape(gaps.size, -1)
        self.arc_length: Array = (blocks[:, :n] + gaps[:, None]).ravel()
        self.positions: Array = blocks[:, n : 4 * n].reshape(-1, 3)
        self.quaternions: Array = blocks[:, 4 * n : 8 * n].reshape(-1, 4)
        self.force: Array = blocks[:, 11 * n : 14 * n].reshape(-1, 3)
        self.supports: Array = np.zeros((max(ring_arcs or (0,)), 7))
        for support, arc in (ring_arcs or {}).items():
            self.supports[support - 1, 0] = arc
        self.rubbed: Array = getattr(shape, "rubbed", NOT_RUBBED)
        self.turns: Any = getattr(shape, "turns", 0)
        self.bodies = shape.bodies
        rows = [row + np.eye(TOUCH)[0] * gap for own, gap in zip(shape.touches, gaps, strict=False) for row in own]
        self.touches: Array = np.array(rows).reshape(-1, TOUCH)


def standing(harness: Harness) -> frozenset[str]:
    """The ends beside which a node stands in for their junction: of the thickest segment at each, but where one runs
    straight into another, and comes down on both sides."""
    out = set[str]()
    for joint in harness.junctions:
        ways = np.array([joint.leaving(end) for end in joint.ends])
        if joint.kind == "ball" or (ways @ ways.T).min() > _STRAIGHT:
            out.add(max(joint.ends, key=lambda end: harness.segments[split_end(end)[0]].diameter))
    return frozenset(out)


@final
class HarnessTouchState(TouchState):
    """As `TouchState`, for all segments at once."""

    problem: HarnessProblem  # type: ignore[assignment]
    cable: HarnessNetwork
    single = False

    # -- what is solved

    def take(self, problem: HarnessProblem) -> None:  # type: ignore[override]
        """Makes `problem` the one to solve; the last solution stays as a start if its parts are the same."""
        self.problem = problem
        harness = problem.harness
        segments = list(harness.segments.values())
        network = HarnessNetwork(problem)
        network.aim()
        plan = tables.plan_of.py_func(network.bare)
        sizes = [cable.length for cable in segments] + [size for _, size in network.layout.levers]
        gaps = np.concatenate(([0.0], np.cumsum(2.0 * np.array(sizes))[:-1]))
        arcs = network.layout.arcs
        own = [
            gap + np.append(arcs[a, 0], arcs[a:b, 1])
            for gap, a, b in zip(gaps, plan.cables[:-1], plan.cables[1:], strict=True)
        ]
        every, rings = np.concatenate(own), np.array(network.rings, dtype=np.int64)
        if every.size == self._arcs.size and np.array_equal(rings, self.rings):
            every[rings] = self._arcs[rings]  # what is in an eyelet is found
        if not (self.bodies.are(problem.bodies) and np.array_equal(every, self._arcs)):
            self.forget()
            self.elements = 0
        self.gaps, self._of_cables, self._arcs = gaps, [one.size for one in own], every
        self._standing = standing(harness)
        self.bodied = len(segments)
        self.cable, self._told = network, np.empty(0)
        self._structure: Structure | None = None
        self.length = harness.longest
        self.bend = self.bend_of_cables = network.bend
        self.limpness = math.inf
        self.radius = min(radius_of(cable) for cable in segments)
        self._weights = [float(np.linalg.norm(one.load.mean(axis=0))) for one in problem.segments.values()]
        self.weight = sum(weight * cable.length for weight, cable in zip(self._weights, segments, strict=True))
        self._stretch, self.stretches = 0.0, False
        self.points = np.empty(0)
        self._stops = every
        self.rings = rings
        self._knots = np.concatenate(
            [[plan.ends[a, 0], *plan.ends[a:b, 1]] for a, b in zip(plan.cables[:-1], plan.cables[1:], strict=True)]
        )
        wide = every.size + tables.GRIP * rings.size
        if self.slid.shape[1] != wide or self.turns.shape[1] != gaps.size:
            self.slid, self.turns = np.zeros((3, wide)), np.zeros((3, gaps.size))
            self.info = np.zeros(drive.INFO + 3 * gaps.size)
        count = int(network.bare[tables.N_KNOTS])
        if self._grips.shape[1] != count:
            self.forget()
            self.elements = 0
            self._grips = np.zeros((3, count, 7))
        self.unfactored()
        thickest = 0.5 * max(widest(cable) for cable in segments)
        if self.bodies.take(problem.bodies, problem.gripping, problem.links, thickest, problem.carried):
            self.forget()

    @property
    def ring_rows(self) -> list[int]:
        return self.cable.ring_rows

    @property
    def layout(self) -> Layout:
        """Knots and spans by name, without contacts."""
        return self.cable.layout

    @property
    def limp(self) -> bool:
        """Never: harnesses are not made of string."""
        return False

    def aimed(self) -> Array:
        """Poses of the knots (k, 7), those that nothing holds as they are."""
        frames = self.cable.aim()
        if self.cable.structure is not self._structure or not np.array_equal(self.cable.held, self._told):
            if self._structure is not None and self.cable.structure is not self._structure:
                self.history = min(self.history, 1)
            self._structure, self._told = self.cable.structure, self.cable.held.copy()
            self._moves = np.array([knot.moves for knot in self.cable.structure.knots])
            self._order: tuple[Whole, int] | None = None
            self._take_structure()
        if self.history:
            frames[self._moves] = self._grips[NOW, self._moves]
        return frames

    def _pull_of_tips(self) -> float:
        ends = self.problem.ends.values()
        return max((float(np.linalg.norm(end.force)) for end in ends if isinstance(end, FreeEnd)), default=0.0)

    def _chained(self) -> tuple[Chain, ...]:
        """Segments, then levers."""
        out = []
        at = 0
        segments = list(self.problem.harness.segments.items())
        for c, size in enumerate(self._of_cables):
            supports = slice(at, at + size)
            at += size
            if c < self.bodied:
                name, cable = segments[c]
                start, end = (type(self.problem.ends.get(f"{name}.{side}")) is FreeEnd for side in ("start", "end"))
                out.append(Chain.of(cable, supports, (start, end)))
            else:
                lever = np.array([(math.inf, self.cable.stiffest, self.radius, 0.0)])
                out.append(Chain(supports, lever, (False, False)))
        return tuple(out)

    def _count_of(self, chain: Chain) -> int:
        c = next(i for i, one in enumerate(self.chains) if one is chain)
        arcs = self._arcs[chain.supports]
        return mesh.first_count(float(arcs[-1] - arcs[0]), chain.bend, self._weights[c])

    def _nodes_of(self, chain: Chain, shape: Any, finer: float) -> Array:
        if chain.supports.start >= sum(self._of_cables[: self.bodied]):
            arcs = self._arcs[chain.supports]
            return np.linspace(arcs[0], arcs[-1], _OF_LEVER)
        nodes = super()._nodes_of(chain, shape, finer)
        return np.sort(np.concatenate((nodes, self._stand_ins(chain))))

    def _stand_ins(self, chain: Chain) -> list[float]:
        """Arc lengths [m] of nodes that stand in for the junctions of a segment: no knot touches anything itself."""
        name = list(self.problem.harness.segments)[next(i for i, one in enumerate(self.chains) if one is chain)]
        low, high = self._arcs[chain.supports][[0, -1]]
        places = {f"{name}.start": low + mesh.STAND_IN, f"{name}.end": high - mesh.STAND_IN}
        return [float(arc) for end, arc in places.items() if end in self._standing]

    def _elimination(self) -> tuple[Whole, int]:
        if self._order is None:
            plan = tables.plan_of.py_func(moving(self.cable.bare))
            first = np.where(plan.vertices >= 0, plan.vertices, plan.pointer.size).min(axis=1)
            first[(plan.vertices < 0).all(axis=1)] = -1
            ends = np.bincount(plan.ends.ravel())
            wide = 2 * int(ends.max()) + int(np.diff(plan.pointer).max(initial=0))
            self._order = np.argsort(first, kind="stable"), wide
        assert self._order is not None
        return self._order

    # -- solutions

    def start_from(self, shape: HarnessShape, frames: Array, finer: float = 1.0) -> None:  # type: ignore[override]
        """Makes a shape the last solution, on a new mesh; `frames` (k, 7) are those of the knots that are held."""
        whole: Any = self.whole(shape)
        super().start_from(whole, self.knots_at(shape, frames), finer)

    def knots_at(self, shape: HarnessShape, frames: Array) -> Array:
        """(k, 7): poses of all knots in a shape, of which `frames` (k, 7) has those that are held.

        The signs of their quaternions are those of the shape.
        """
        whole: Any = self.whole(shape)
        poses = frames.copy()
        spans = self.cable.structure.spans
        of_frames = self.cable.layout.frames
        at, j = 0, 0
        for size in self._of_cables:
            for i in range(size):
                span, end = (j + i, 0) if i < size - 1 else (j + i - 1, 1)
                knot, arc = self._knots[at + i], self._arcs[at + i]
                k = int(np.abs(whole.arc_length - arc).argmin())
                there = times(whole.quaternions[k : k + 1], conjugate(of_frames[span, end])[None])[0]
                if self._moves[knot]:
                    poses[knot, :3] = [np.interp(arc, whole.arc_length, x) for x in whole.positions.T]
                if spans[span].tied[end] and (self._moves[knot] or self.cable.structure.knots[knot].turns):
                    poses[knot, 3:] = there
                elif poses[knot, 3:] @ there < 0.0:
                    poses[knot, 3:] *= -1.0
            at, j = at + size, j + size - 1
        return poses

    def twin(self, problem: HarnessProblem, shape: HarnessShape) -> HarnessTouchState:
        """Once more: it goes on from the last shape, that of `problem`, and this one stays as it is."""
        other = HarnessTouchState(problem)  # type: ignore[arg-type]
        frames = other.aimed()
        other.move_bodies(self.bodies.links_then)
        other.resume(shape, frames)  # type: ignore[arg-type]
        return other

    def whole(self, shape: HarnessShape) -> Any:  # type: ignore[override]
        gaps, clips = self._gap_of_supports, self.cable.ring_clips
        arcs = {ring: float(shape.supports[clips[ring], 0] + gaps[ring]) for ring in self.rings.tolist()}
        return Laid(shape, self.gaps, arcs)

    def seen(self, shape: HarnessShape) -> Array:  # type: ignore[override]
        return np.concatenate([one.positions for one in shape.segments.values()])

    def new_buffer(self) -> Array:
        return np.empty(NUMBERS_PER_POINT * self.problem.points * self.gaps.size)

    @property
    def clip_knots(self) -> Any:
        return np.array(self.cable.clip_rows, dtype=np.int64)

    def buried(self, frames: Array, deepest: float) -> tuple[int, int, float]:
        """Which knot is deeper in which body, and the gap; -1: none."""
        for c, chain in enumerate(self.chains[: self.bodied]):
            arcs = self.arcs[chain.supports] - self.gaps[c]
            knots = self._knots[chain.supports]
            held = ~self._moves[knots]
            i, body, gap = self.deep(chain, frames[knots[held]], arcs[held], float(arcs[-1]), deepest)
            if i >= 0:
                return int(knots[held][i]), body, gap
        return -1, -1, 0.0

    def touches_of_segments(self) -> list[Array]:
        """Of each segment (k, TOUCH), the contacts of the last solution as `check.touches` has them."""
        ends = self._ends_of(self.nodes) + 1
        found = []
        for a, b in zip([0, *ends[:-1]], ends[: self.bodied], strict=False):
            out = np.empty((b - a, check.TOUCH))
            count = check.touches(self.s[a:b], self.near[NOW, a:b], self.on[NOW, a:b], self.thick[a:b], out)
            found.append(out[:count])
        return found

    def largest_of_spans(self, values: Array) -> Array:
        """(m,): of values (n,) at the network's nodes the largest in each span that there is without contacts."""
        plan, out = tables.plan_of.py_func(self.net.ints), np.full(len(self.cable.structure.spans), -math.inf)
        for x, (a, b) in enumerate(pairwise(plan.first.tolist())):
            j = self.net.stretch[x]
            out[j] = max(out[j], values[a + x : b + x + 1].max())
        return out

    def turns_most(self, name: str, mode: Array) -> float:
        """[m], arc length of a segment at which it turns most in a mode (nodes, 3) of the network."""
        plan, s = tables.plan_of.py_func(self.net.ints), tables.model_of.py_func(self.net.ints, self.net.floats).s
        turns, own = (mode * mode).sum(axis=1), self.cable.layout.spans[name]
        runs = enumerate(pairwise(plan.first.tolist()))
        nodes = np.concatenate([np.arange(a + x, b + x + 1) for x, (a, b) in runs if self.net.stretch[x] in own])
        return float(s[nodes[turns[nodes].argmax()]])

    def energy_of_masses(self, segments: Collection[str] | None = None) -> float:
        """[J], potential energy of masses in the last solution: on these segments and their junctions, or on all."""
        gravity, problem, layout = self.problem.gravity, self.problem, self.cable.layout
        places = self._grips[NOW, :, :3]
        own = problem.segments.keys() if segments is None else segments
        rows = {k for name in own for j in layout.spans[name] for k in layout.structure.spans[j][:2]}
        for junction in problem.harness.junctions:
            if split_end(junction.ends[0])[0] in own:
                rows.add(layout.knots["junction", junction.name])
        out = sum(mass * float(gravity @ places[row]) for row, mass, _ in layout.at_masses if row in rows)
        for end, how in problem.ends.items():
            if isinstance(how, FreeEnd) and how.mass > 0.0 and split_end(end)[0] in own:
                out += how.mass * float(gravity @ places[layout.knots["end", end]])
        return -out

    def models_of(self, name: str, cables: Sequence[Cable]) -> Array:
        """(c, size): models with other cables as this segment, on this mesh."""
        return self.models_beside(*differences(self.problem, [self.problem.beside(name, one) for one in cables]))

    def models_beside(self, held: Array, arcs: Array) -> Array:  # type: ignore[override]
        """(c, size): models that differ as `harness_answers.differences` tells, on the mesh as it is.

        Clips and masses stay at their arc length, other knots where the others have them.
        """
        plan, still = tables.plan_of.py_func(self.net.ints), np.array((0.0, self.problem.harness.longest))
        made, everywhere = self.cable.held + held, np.tile(still, (len(held), 1))
        for row in made:
            self.let_stretch(row[self.cable.parts.piece])
        models: Array = respond.neighbours(self.net, self.s, made, still, everywhere)
        stretch = self.net.stretch[: int(self.net.ints[tables.N_SPANS])]
        own = self.cable.layout
        eyelets = [j for _, j in own.rings]  # what is in them is where it is
        for model, moved in zip(models, arcs, strict=True):
            if not moved.any():
                continue
            s = tables.model_of.py_func(self.net.ints, model).s
            for spans in own.spans.values():
                kept = [j for j in spans if j not in eyelets]
                before = np.concatenate((own.arcs[spans.start, :1], own.arcs[kept, 1]))
                after = np.concatenate((moved[spans.start, :1], moved[kept, 1])) + before
                mine = np.flatnonzero((stretch >= spans.start) & (stretch < spans.stop))
                nodes = np.concatenate([np.arange(plan.first[j] + j, plan.first[j + 1] + j + 1) for j in mine])
                s[nodes] = np.interp(s[nodes], before, after)
            move_nodes(self.net.ints, model, still, still, model)
        return models

    def sensitivities(self, ends: Sequence[str], clips: Sequence[int] = ()) -> Array:
        """As `HarnessNetwork.sensitivities`, the same points staying in contact."""
        return self.cable.columns_of(self, ends, clips)
