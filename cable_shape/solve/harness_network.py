"""What the solver of networks keeps of a harness from one solve to the next: :class:`HarnessNetwork`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any, final

import numpy as np

from cable_shape.cable.pieces import pieces_of
from cable_shape.checks import Array
from cable_shape.kernels.network import drive, guess, material, mesh, respond, tables
from cable_shape.kernels.network.drive import I_DOUBT, I_ESTIMATE, INFO
from cable_shape.kernels.network.tables import NOW
from cable_shape.pose import FreeEnd, Grip
from cable_shape.solve.answers import refreshed, run_on
from cable_shape.solve.bare import IDENTITY, bare_of
from cable_shape.solve.cables import FREE_ROTATIONS, material_of
from cable_shape.solve.harness_layout import LEVER, Layout, layout_of, ways_from
from cable_shape.solve.harness_problem import HarnessProblem
from cable_shape.solve.mesh import interpolated
from cable_shape.solve.network import _SOFTER, Network

#: Shares of what counts as neutral by which matrices are shifted: with little of it soft modes converge as fast as
#: others, with more those are passed over that seem unstable short of rest.
FIRM = (1e-3, 0.3, 10.0)
#: Modes softer than this fraction of the whole load count as neutral: short of rest they seem as unstable as that.
_HANGING = 2e-6
#: Numbers of a solution below this are made 0, once in so many shapes.
_NOTHING_LEFT, _NOW_AND_THEN = 1e-50, 6
#: A mesh is made finer as for an error at most so many times the tolerance.
_EXCESS = 8.0
_NO_STOPS: Array = np.empty(0)


@final
class HarnessNetwork(Network):
    """The solver's memory of one harness: the mesh, the last two solutions, work space.

    `layout` names knots and spans; what the arrays hold: :mod:`cable_shape.kernels.network.tables`.
    """

    problem: HarnessProblem  # type: ignore[assignment]

    def __init__(self, problem: HarnessProblem) -> None:
        self.told_before: Array | None = None  # loads of the last solution, where they have been changed since
        self._layout: Layout | None = None
        self._settled = 0  # shapes so far
        self.firmness = FIRM[0]  # the shift that is always there, in what counts as neutral
        super().__init__(problem)  # type: ignore[arg-type]

    def forget(self, problem: Any) -> bool:
        """Never: another memory is made."""
        return False

    # -- what is solved

    def take(self, problem: HarnessProblem) -> None:  # type: ignore[override]
        """Makes `problem` the one to solve; the last solution stays as a start if its parts are the same."""
        cables = [one for cable in problem.harness.segments.values() for _, _, one in pieces_of(cable)]
        self.problem, self.tolerance = problem, problem.tolerance
        self.length = problem.harness.longest
        numbers = [x for cable in cables for x in (*cable.bending_stiffness, cable.twisting_stiffness)]
        self.softest, self.stiffest = min(numbers) / self.length**2, max(numbers)
        self.bend = min(cable.mean_bending_stiffness for cable in cables)
        self.stretch = 0.0 if any(cable.axial_stiffness is None for cable in cables) else 1.0
        loads = [abs(x) for one in problem.segments.values() for x in (one.load * one.cable.length).ravel()]
        self._weight = 0.5 * sum(loads)  # N
        self.elastic = any(c.axial_stiffness is not None or c.shear_stiffness is not None for c in cables)
        self.rings: list[int] = []
        self.points = _NO_STOPS  # masses are knots
        self.arcs = np.zeros(1)
        self.kinks = self.sharpness = self._still_stops = _NO_STOPS
        if self._layout is not None:
            self._lay_out(self._kinds)
        self.unsettle()

    @property
    def layout(self) -> Layout:
        """Knots and spans by name."""
        assert self._layout is not None
        return self._layout

    def aim(self, start: Any = None, end: Any = None, trial: bool = False) -> Array:
        """Poses of the knots (k, 7), after what holds and loads the ends has been taken into account.

        trial: into the trial itself; rows of knots that nothing holds stay as they are there.
        """
        ends = self.problem.ends
        kinds = tuple([how.kind if type(how) is Grip else "free" for how in ends.values()])
        if kinds != self._kinds or self._layout is None:
            self._lay_out(kinds)
            self.unsettle()
        self._load_tips()
        trial = trial and self.elements > 0
        poses = self.target if trial else self._frames.copy()
        if self.clip_rows:
            poses[self.clip_rows] = self.problem.clip_frames
        for row, name in self._held:
            held = ends[name]
            assert isinstance(held, Grip)
            poses[row] = held.cable_frame.array
        return poses

    def _lay_out(self, kinds: tuple[str, ...]) -> None:
        """Takes over how the ends are held, and what the segments are made of."""
        problem = self.problem
        before = self._layout
        bare = None if before is None else self._bare
        self._kinds = kinds
        if kinds not in problem.laid_out:
            problem.laid_out[kinds] = layout_of(problem, dict(zip(problem.ends, kinds, strict=True)))
        layout: Layout = problem.laid_out[kinds]
        self._layout = layout
        self.structure, self._bare = layout.structure, bare_of(layout.structure)
        self.spans = len(layout.structure.spans)
        firsts = np.cumsum([0, *(len(spans) + 1 for spans in layout.spans.values())])
        self.rings, self.ring_clips = [], dict[int, int]()  # supports that are eyelets, and the numbers of their clips
        for first, spans in zip(firsts.tolist(), layout.spans.values(), strict=False):
            for number, j in layout.rings:
                if j in spans:
                    self.ring_clips[first + j - spans.start + 1] = number
                    self.rings.append(first + j - spans.start + 1)
        if self.rings:
            assert problem.scene is not None
            through = [problem.scene.clips[number] for number, _ in layout.rings]
            segments = problem.harness.segments
            self._take_friction([(clip, segments[str(clip.segment)]) for clip in through])
            self.drawn = np.array([clip.retraction for clip in through])
        else:
            self.rough, self.has_friction, self.drawn = _NO_STOPS, False, _NO_STOPS
        self.cables = len(layout.structure.cables)
        self._held = [(layout.knots["end", end], end) for end, how in problem.ends.items() if type(how) is Grip]
        self._tips = [(layout.knots["end", end], end) for end, how in problem.ends.items() if type(how) is FreeEnd]
        self._frames = np.zeros((len(layout.knots), 7))
        self._frames[:, 3:] = IDENTITY
        self._given_turns = {k for k, knot in enumerate(layout.structure.knots) if not (knot.moves or knot.turns)}
        clips = range(0 if problem.scene is None else len(problem.scene.clips))
        self.clip_rows = [layout.knots["clip", i] for i in clips]
        lengths = [cable.length for cable in problem.harness.segments.values()]
        self.gaps = np.concatenate(([0.0], np.cumsum(2.0 * np.array(lengths))[:-1]))  # m, see `node_positions`
        masks = [mask for pair in layout.structure.free for mask in pair]
        self.turns_freely = any(any(mask) for mask in masks) or any(FREE_ROTATIONS[k] != _HELD for k in self._clipped())
        self.forces = int(self._bare.ints[tables.UNKNOWN]) // 3
        self.info = np.zeros(INFO + 3 * self.cables)
        same = before is not None and [knot[:2] for knot in before.knots] == [knot[:2] for knot in layout.knots]
        self.held = self._bare.floats.copy()
        self._model_of_held = tables.model_of.py_func(self._bare.ints, self.held)
        self._told_tips: list[object] = [None] * len(self._tips)
        self._told_by: object = None
        self._load_of_tips: Array = np.full((len(self._tips), 2, 3), np.nan)
        self._tell()
        self._load_tips()
        if not self.elements:
            return
        if not same:
            self.history = self.elements = 0
            return
        counts = np.diff(self.ints[tables.HEAD : tables.HEAD + self.spans + 1])
        assert before is not None
        if self._bare is bare and np.array_equal(layout.arcs, before.arcs):
            self.take_over(self.held)
        else:
            pieces = [self._as_dense(self.nodes[a : b + 1]) for a, b in self.runs]
            self.lay_out(pieces, counts.tolist())
        self.history = min(self.history, 1)

    def _clipped(self) -> list[str]:
        """Kinds of the clips."""
        scene = self.problem.scene
        return [] if scene is None else [clip.kind for clip in scene.clips]

    def _tell(self) -> None:
        """Tells the model with one element a span what segments and loads are."""
        model, layout, problem = self._model_of_held, self.layout, self.problem
        model.par[...] = (
            self.softest, self.firmness * self.neutral, self.length, self.elastic or bool(layout.levers), self.stiffest,
            self.at_rest,
            self.stretch == 0.0,
            _SOFTER if self.turns_freely else 1.0,
            0.0,
        )  # fmt: skip
        model.frame[...] = layout.frames
        model.friction[...], model.draw[...] = self.rough, self.drawn
        model.s[...] = self.arcs_now().ravel()
        materials = [material_of(one) for one in problem.segments.values()]
        levers = layout.levers
        heavy = [one.cable.linear_density * one.gravity for one in problem.segments.values()]
        model.heavy[...] = [*heavy, *[np.zeros(3) for _ in levers]]
        model.breaks[...] = np.concatenate([*[one.breaks for one in materials], *[(0.0, size) for _, size in levers]])
        stiff = np.zeros((len(levers), tables.PIECE))
        for first in (material.K_LEFT, material.K_RIGHT):
            stiff[:, first : first + 3] = self._of_levers()[:, None]
        stiff[:, material.COMPLIANCE + 2] = np.array([size**2 for _, size in levers]) / self._of_levers()
        model.piece[...] = np.concatenate([*[one.pieces for one in materials], stiff])
        model.force[...] = layout.own
        for junction in problem.harness.junctions:
            weight = junction.mass * problem.fall(junction.ends[0])
            model.force[layout.knots["junction", junction.name]] += weight
        drive.refill(self._bare.ints, self.held)

    def _load_tips(self) -> None:
        """Dead loads on the free ends."""
        changed = False
        for i, (row, name) in enumerate(self._tips):
            end = self.problem.ends[name]
            if end is self._told_tips[i] and self.problem is self._told_by:
                continue
            assert isinstance(end, FreeEnd)
            self._told_tips[i] = end
            tip = self._load_of_tips[i]
            force = end.mass * self.problem.fall(name) + end.force if end.mass else end.force
            if not (np.array_equal(tip[0], force) and np.array_equal(tip[1], end.moment)):
                if not np.isnan(tip).any():
                    self.keep_loads()
                self._model_of_held.force[row] = self.layout.own[row] + force
                self._model_of_held.moment[row] = end.moment
                tip[0], tip[1] = force, end.moment
                changed = True
        self._told_by = self.problem
        if changed:
            self.unsettle()
            self.take_over(self.held)

    def keep_loads(self) -> None:
        """Keeps the loads as they are, for solutions on the way from them to others."""
        if self.told_before is None and self.history > 0:
            self.told_before = self.held.copy()

    def align(self, poses: Array) -> None:
        """Signs of the quaternions that are given along each segment: the shorter turn from one to the next."""
        for spans in self.layout.spans.values():
            rows = [self.structure.spans[spans[0]].start, *(self.structure.spans[j].end for j in spans)]
            given = [row for row in rows if row in self._given_turns]
            for k, n in pairwise(given):
                if float(poses[k, 3:] @ poses[n, 3:]) < 0.0:
                    poses[n, 3:] *= -1.0

    def take_over(self, held: Array) -> None:
        """Makes the loads those of a model with one element a span; what it is held in and made of is the same."""
        if self.elements:
            mesh.take_over(self._bare.ints, held, self.ints, self.floats)

    def firm(self, firmness: float) -> None:
        """How firmly modes that are as good as neutral are held while they are solved for, see FIRM."""
        if firmness != self.firmness:
            self.firmness = firmness
            for floats in (self.held, self.floats):
                if floats.size > tables.PAR:
                    floats[tables.BASE_SHIFT] = firmness * self.neutral

    @property
    def neutral(self) -> float:
        """[N], eigenvalues smaller than this count as zero: a part that hangs turns freely about the vertical."""
        return max(super().neutral, _HANGING * self._weight)

    @property
    def stops(self) -> Array:
        """None: masses and kinks are knots."""
        return _NO_STOPS

    @property
    def missed(self) -> float:
        """[m], by how much a shape may be off because levers give."""
        if not self.layout.levers:
            return 0.0
        moments = tables.work_of.py_func(self.ints, self.work).moments
        first = self.ints[tables.HEAD : tables.HEAD + self.spans + 1]
        turns = [np.abs(moments[first[j] : first[j + 1]]).max() * size for j, size in self.layout.levers]
        return float((np.array(turns) / self._of_levers()).sum() * 2.0 * self.length)

    def _of_levers(self) -> Array:
        """[N m^2], how stiff each lever is: much more than any segment, and than all that weighs on it."""
        sizes = np.array([size for _, size in self.layout.levers])
        return LEVER * np.maximum(self.stiffest, self._weight * sizes**2)

    def bounds(self) -> Array:
        """[m], of the supports of one segment after the other, a gap between them, as they run through eyelets now."""
        arcs, out = self.arcs_now(), []
        for spans, gap in zip(self.layout.spans.values(), self.gaps, strict=True):
            rows = arcs[spans.start : spans.stop]
            out.append(gap + np.append(rows[:1, 0], rows[:, 1]))
        return np.concatenate(out)

    def arcs_now(self) -> Array:
        """(m, 2) [m]: arc lengths at which the spans begin and end."""
        if not self.rings or not self.elements:
            return self.layout.arcs
        arcs, runs = self.layout.arcs.copy(), self.runs
        for _, j in self.layout.rings:
            arcs[j, 1] = arcs[j + 1, 0] = self.nodes[runs[j][1]]
        return arcs

    @property
    def ring_rows(self) -> list[int]:
        """Which of the scene's clips the eyelets are."""
        return [number for number, _ in self.layout.rings]

    def ring_name(self, ring: int) -> str:
        """What an eyelet is called."""
        return f"clip {self.problem.clip_names[self.ring_clips[ring]]!r}"

    def slack(self, arcs: Array, frames: Array) -> Array:
        """See the base; a span to a knot that may move is as short as ways from there to what is held allow."""
        room = np.diff(arcs)
        if self.stretch == 0.0:
            room -= self.needed(frames)
        return np.asarray(room)

    def needed(self, frames: Array) -> Array:
        """(m,) [m], how long spans have to be at least, as of `bounds`: those that eyelets divide."""
        knots, row = self.structure.knots, 0
        out = np.zeros(sum(len(spans) + 1 for spans in self.layout.spans.values()) - 1)
        rings = {knot for knot, _ in self.structure.rings}
        held = [k for k, knot in enumerate(knots) if not knot.moves]
        for spans in self.layout.spans.values():
            for j in spans:
                a, b = self.structure.spans[j][:2]
                if not (knots[a].moves or knots[b].moves):
                    out[row] = math.dist(frames[a, :3].tolist(), frames[b, :3].tolist())
                elif a in rings or b in rings:
                    ring, other = (a, b) if a in rings else (b, a)
                    ways = ways_from(self.layout.beside, other, held)
                    far = [
                        math.dist(frames[k, :3].tolist(), frames[ring, :3].tolist()) - way for k, way in ways.items()
                    ]
                    out[row] = max(0.0, *far)
                row += 1
            row += 1  # the gap
        return out

    def apart(self, arcs: Array, frames: Array) -> Array:
        """See the base; by the ways between all knots as they are."""
        out, row = np.zeros(arcs.size - 1), 0
        for spans in self.layout.spans.values():
            for j in spans:
                a, b = self.structure.spans[j][:2]
                out[row] = np.linalg.norm(frames[b, :3] - frames[a, :3])
                row += 1
            row += 1  # the gap
        return np.maximum(out, self.needed(frames)) if self.stretch == 0.0 else super().apart(arcs, frames)

    def begin_at(self, arcs: Array) -> None:
        """See the base; the mesh is there already."""
        self.slide_to(arcs)

    def slide_to(self, arcs: Array) -> None:
        """Moves segments through eyelets to these arc lengths, as of `bounds`: nodes between them are spread anew."""
        runs, first = self.runs, 0
        for spans, gap in zip(self.layout.spans.values(), self.gaps, strict=True):
            own = arcs[first : first + len(spans) + 1] - gap
            first += len(spans) + 1
            for j, low, high in zip(spans, own[:-1].tolist(), own[1:].tolist(), strict=True):
                a, b = runs[j]
                shares = (self.nodes[a : b + 1] - self.nodes[a]) / (self.nodes[b] - self.nodes[a])
                self.nodes[a : b + 1] = low + shares * (high - low)
                self.nodes[a], self.nodes[b] = low, high
        drive.refill(self.ints, self.floats)
        self.solution(tables.TRIAL).arc[...] = arcs[self.rings] - self._ring_gaps()

    def _ring_gaps(self) -> Array:
        """(e,) [m], before the segments of the eyelets."""
        rows = self.bounds()[self.rings]
        return np.array([self.gaps[int(np.searchsorted(self.gaps, x, side="right")) - 1] for x in rows.tolist()])

    def pulls(self, points: int = 0) -> tuple[Array, Array, Array]:
        """See the base; points of each segment."""
        e = len(self.rings)
        f, J, out = np.empty(e), np.empty((e, e)), np.empty((self.cables * points, 3, e))
        respond.eyelets(self.ints, self.floats, self.sols, self.work, f, J, points, out, np.empty((self.spans, 3)))
        return f, J, out

    def lay_out(self, pieces: Any, counts: Any) -> None:
        """Nodes of equal share of each span's density, `counts` elements a span; solutions are carried over."""
        for (x, _), (low, high) in zip(pieces, self.arcs_now(), strict=True):
            x[0], x[-1] = low, high
        at = np.concatenate(([0], np.cumsum([x.size for x, _ in pieces])))
        x, density = (np.concatenate(parts) for parts in zip(*pieces, strict=True))
        wish = mesh.Density(at, x, density, np.empty(self.spans))
        old = self.ints
        arrays = mesh.laid_out(
            self._bare.ints, self.held, old, self.floats, self.sols, np.array(counts), _NO_STOPS, wish
        )
        self.take_arrays(*arrays)

    def settle(self) -> None:
        """The last solution is one under these loads; see `Network.settle`.

        What hangs straight is so ever more exactly from shape to shape, until squares of what is left are no longer
        normal numbers, with which processors are fifty times as slow: nothing is made of it.
        """
        super().settle()
        self._settled += 1
        if self._settled % _NOW_AND_THEN == 0:
            self.sols[np.abs(self.sols) < _NOTHING_LEFT] = 0.0

    def next_mesh(self) -> bool:
        """A mesh that the last error estimate asks for, in steps: one that is asked for at once is much too fine."""
        told = self.info[I_ESTIMATE], self.info[I_DOUBT]
        most = _EXCESS * self.tolerance
        if math.isfinite(sum(told)) and sum(told) > most:
            self.info[I_ESTIMATE], self.info[I_DOUBT] = most, 0.0
        found = super().next_mesh()
        self.info[I_ESTIMATE], self.info[I_DOUBT] = told
        return found

    # -- solutions

    def start_from(self, poses: Array, kind: int, sag: float, turns: float = 0.0) -> None:
        """Puts a guess (see ``guess.guess``) between `poses` into the trial."""
        self.target[...] = poses
        drive.strip(self.ints, self.floats, self.sols)
        guess.guess(self.ints, self.floats, self.sols, self.layout.placed, kind, sag, False)

    def energy_of_masses(self) -> float:
        """[J], potential energy of masses in the last solution."""
        if not self.layout.at_masses and not any(self.problem.ends[name].mass for _, name in self._tips):  # type: ignore[union-attr]
            return 0.0
        place = tables.work_of.py_func(self.ints, self.work).place
        gravity = self.problem.gravity
        out = sum(mass * float(gravity @ place[row]) for row, mass, _ in self.layout.at_masses)
        for row, name in self._tips:
            end = self.problem.ends[name]
            assert isinstance(end, FreeEnd)
            out += end.mass * float(gravity @ place[row])
        return -out

    def node_positions(self) -> tuple[Array, Array]:
        """Arc lengths (n,), those of each segment beyond a gap, and positions (n, 3) of the last solution's nodes."""
        work = tables.work_of.py_func(self.ints, self.work)
        positions = np.empty((self.nodes.size, 3))
        for j, (a, b) in enumerate(self.runs):
            start = work.place[self.structure.spans[j].start]
            positions[a] = start
            positions[a + 1 : b + 1] = start - np.cumsum(work.first[a - j : b - j, :3], axis=0)
        s = self.nodes.copy()
        for spans, gap in zip(self.layout.spans.values(), self.gaps, strict=True):
            s[self.runs[spans[0]][0] : self.runs[spans[-1]][1] + 1] += gap
        last = self.runs[spans[-1]][1] + 1  # levers are beyond
        return s[:last], positions[:last]

    def largest_of_spans(self, values: Array) -> Array:
        """(m,): of values (n,) at the network's nodes the largest in each span."""
        return np.array([values[a : b + 1].max() for a, b in self.runs])

    def resume_from(self, whole: Any, gaps: Array, poses: Array) -> None:
        """Makes a shape the last solution: `whole` is all its cables in turn, `gaps` (c,) [m] added to arc lengths.

        poses (k, 7): of all knots.
        """
        self.first_mesh(poses)
        if self.rings:
            arcs = self.bounds()
            arcs[self.rings] = whole.supports[np.array(self.rings) - 1, 0]
            self.slide_to(arcs)
        now, nodes = self.solution(NOW), self.nodes
        now.arc[...] = self.solution(tables.TRIAL).arc
        of_span = np.repeat(gaps, [cable.spans for cable in self.structure.cables])
        for j, (a, b) in enumerate(self.runs):
            at = nodes[a : b + 1] + of_span[j]
            now.q[a : b + 1] = interpolated(at, whole.arc_length, whole.quaternions)
            middles = 0.5 * (at[1:] + at[:-1])
            for i in range(3):
                force = np.interp(middles, whole.arc_length, whole.force[:, i])
                now.lam[j, i] = (force - self.model.load[a - j : b - j, 3 + i]).mean()
        now.pose[...] = poses
        if self.rings:
            self.hold_along(whole)
        self.history, self._resumed = 1, True

    @property
    def sampled(self) -> int:
        """How many points a shape has, with those of levers."""
        return self.problem.points * self.cables

    def sensitivities(self, ends: Sequence[str], clips: Sequence[int] = ()) -> Array:
        """(c points, 3, 6 g): change of the positions of all segments with the poses of these held ends, then clips."""
        return self.columns_of(self, ends, clips)

    def columns_of(self, state: Any, ends: Sequence[str], clips: Sequence[int] = ()) -> Array:
        """The same of another memory of the harness, of which the knots are the first ones."""
        points, knots = self.problem.points, self.layout.knots
        rows = np.array([*[knots["end", end] for end in ends], *[knots["clip", i] for i in clips]], dtype=np.int64)
        out, df = np.zeros((self.cables * points, 3, 6 * rows.size)), np.empty((len(self.rings), 6 * rows.size))
        if rows.size:
            slides = refreshed(state)
            respond.sensitivities(state.ints, state.floats, state.sols, state.work, points, rows, out, df)
            run_on(out, df, slides)
        return out

    def models_beside(self, held: Array, arcs: Array) -> Array:  # type: ignore[override]
        """(c, size): models that differ as `harness_answers.differences` tells, on the mesh as it is."""
        still = np.array((0.0, self.length))
        made, everywhere = self.held + held, np.tile(still, (len(held), 1))
        models: Array = mesh.neighbours(self.bare, made, self.ints, self.floats, still, everywhere)
        for model, moved in zip(models, arcs, strict=True):
            if not moved.any():
                continue
            s = tables.model_of.py_func(self.ints, model).s
            for (a, b), (low, high) in zip(self.runs, moved.tolist(), strict=True):
                share = (s[a : b + 1] - s[a]) / (s[b] - s[a])
                s[a : b + 1] += low + share * (high - low)
            mesh.move_nodes(self.ints, model, still, still, model)
        return models


_HELD = (0.0, 0.0, 0.0)
