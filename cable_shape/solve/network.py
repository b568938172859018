"""What the solver of networks keeps from one solve to the next: mesh, the last two solutions, work space."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Sequence
from functools import lru_cache
from itertools import pairwise
from typing import Any

import numpy as np

from cable_shape.cable.cable import Cable
from cable_shape.cable.pieces import cable_at, pieces_of
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.kernels.network import drive, gripping, guess, material, mesh, respond, start, tables
from cable_shape.kernels.network.drive import I_DOUBT, I_ESTIMATE, I_TURN, INFO, LARGEST_TURN
from cable_shape.kernels.network.gripping import FROM_FIRM, SLIPPED, TO, TO_FIRM, TO_PULL
from cable_shape.kernels.network.tables import BEFORE, NOW, TRIAL
from cable_shape.pose import FreeEnd, Grip
from cable_shape.scene.scene_parts import Clip
from cable_shape.shape import NOT_RUBBED, CableShape
from cable_shape.solve.bare import Bare, bare_of
from cable_shape.solve.cables import (
    AT,
    LOADS,
    Structure,
    kinks_of,
    material_of,
    shared_loads,
    structure_of,
    substance,
)
from cable_shape.solve.mesh import Piece, interpolated
from cable_shape.solve.plan import Whole
from cable_shape.solve.problem import NAMED_TOLERANCE, Problem

_NO_MASSES: Array = np.empty((0, 4))
_NOTHING: Array = np.zeros(3)

#: A mesh is made coarser when its error is below this fraction of the tolerance.
_TOO_FINE = 1.0 / 40.0
#: Modes softer than this fraction of the stiffness / length^2 count as neutral, and neutral as stable.
_NEUTRAL = 1e-4
#: So many times as uncertain are corrections where supports leave rotations free.
_SOFTER = 4.0
#: A frame may turn so far [rad] from its prediction whatever the supports do: predictions are not exact.
_UNMOVED = 0.2
#: Points of a shape that is worth starting from.
_FEWEST_POINTS = 20
#: Kinks of a load nearer to an eyelet than this fraction of the length are no nodes.
_BESIDE = 1e-5
#: Change of a cable's length and of its supports' arc lengths, as a fraction of it, beyond which nothing is kept.
_LENGTHENED = 0.02

_structure = lru_cache(maxsize=256)(structure_of)


def roughness(eyelets: Sequence[tuple[Clip, Cable]]) -> Array:
    """(e,): coefficients of friction of eyelets, of clip and cable the larger."""
    return np.array([max(clip.friction, cable_at(cable, clip.arc_length).friction) for clip, cable in eyelets])


class Network:
    """The solver's memory for one cable, in clips or not; one object a predictor, not shared between threads.

    `history` tells how many solutions there are to start from (0: none); `last`, a shape of the same cable held in
    other clips, is then the next best. What the arrays hold: :mod:`cable_shape.kernels.network.tables`.
    """

    rows = slice(None)  #: of a shape's points, those of the cable

    def __init__(self, problem: Problem, last: CableShape | None = None) -> None:
        self.last = last
        self.history = self.elements = 0
        self._resumed = False  # whether the last solution is a shape that was found otherwise
        self.factored = False  # whether `work` has factors at, or next to, the last solution
        self.fewest = 0  # elements with which a coarser mesh has failed
        self.info: Array = np.zeros(INFO + 2)
        self.rough, self.has_friction = _NOTHING[:0], False  # (e,) as it counts, see `roughness`; whether there is any
        self.drawn: Array = _NOTHING[:0]  # (e,) [N], by which eyelets draw the cable towards its start
        self.structure: Structure
        self.turns_freely = False
        self.rolls = False  # a dead moment on the free end may twist a start that does not hold its roll
        self.at_rest = math.inf  # rad, by which frames may turn though no support moves
        self._bare: Bare
        self.held: Array = _NOTHING  # a model with one element a span
        self.ints: Any = None
        self._model: tables.Model | None = None
        self._spans: list[tuple[int, int]] | None = None
        self.floats = self.sols = self.work = self.nodes = _NOTHING
        self.length = 0.0
        self._stiff = 1.0  # by which the cable is stiffened at present
        self._kinds: tuple[str, ...] = ()
        self._tip = self._moment = _NOTHING
        self.kinks = self.sharpness = self._still_stops = _NOTHING[:0]
        self.take(problem)

    def forget(self, problem: Problem) -> bool:
        """Forgets all solutions, as if made anew; False if it cannot, since the problem is another one or runs through
        eyelets."""
        if problem is not self.problem or self.rings or self._stiff != 1.0:
            return False
        self.history = self.elements = self.fewest = 0
        self.last = None
        self.factored = False
        self.floats = self.sols = self.work = self.nodes = _NOTHING
        self._model = self._spans = self.ints = None
        self.unsettle()
        return True

    # -- what is solved

    def take(self, problem: Problem) -> None:
        """Makes `problem` the one to solve; the last solution stays as a start if its supports are alike."""
        cable = problem.cable
        if cable.mean_bending_stiffness == 0.0:
            raise ArgumentError.of(
                "bending_stiffness",
                0.0,
                "model 'cosserat' needs it above 0 N m^2",
                "Give EI in N m^2, or choose model='catenary' and remove the clips.",
            )
        length = cable.length
        arcs = np.array((0.0, *[clip.arc_length for clip in problem.clips], length))
        self._keep(problem, arcs, length)
        self.problem, self.length, self.tolerance = problem, length, problem.tolerance
        self.arcs = arcs  # (m+1,) [m], of the supports, as they are held
        self.material, self._stiff = material_of(problem), 1.0
        self.bend = cable.mean_bending_stiffness
        parts = [one for _, _, one in pieces_of(cable)]
        stiffness = [x for one in parts for x in (*one.bending_stiffness, one.twisting_stiffness)]
        self.softest, self.stiffest = min(stiffness) / length**2, max(stiffness)
        stretches = [1.0 / one.axial_stiffness for one in parts if one.axial_stiffness is not None]
        self.stretch = max(stretches, default=0.0)
        self.elastic = bool(stretches) or any(one.shear_stiffness is not None for one in parts)
        self.round_straight = self.material.straight and all(
            one.bending_stiffness[0] == one.bending_stiffness[1] for one in parts
        )
        self._own, self.points, self.weights = shared_loads(problem, arcs)
        self.mean_load: Array = 0.5 * (problem.load[0] + problem.load[1])
        if self.points.size:
            self.mean_load = self.mean_load + self.weights.sum(axis=0) / length
        if problem.swing is not None:
            rows = len(problem.swing)
            self.mean_load = self.mean_load - cable.linear_density * problem.swing.sum(axis=0) / (rows - 1)
        self._clips = tuple(clip.kind for clip in problem.clips)
        self.spans = self.forces = arcs.size - 1
        self.rings = [i for i, kind in enumerate(self._clips, 1) if kind == "slide"]
        self._take_friction([(problem.clips[i - 1], cable) for i in self.rings])
        self.drawn = problem.retraction[self.ring_rows]
        self.kinks, self.sharpness = kinks_of(problem) if self.rings else (_NOTHING[:0], _NOTHING[:0])
        self._kinds = ()
        self.unsettle()

    def _keep(self, problem: Problem, arcs: Array, length: float) -> None:
        """Keeps mesh and solutions where the new problem's supports are where the old one's were.

        arcs (m+1,) takes what was found to be in the eyelets.
        """
        if self.length == 0.0:
            return
        kinds = tuple(clip.kind for clip in problem.clips)
        fixed = [i for i, kind in enumerate(("", *kinds, "")) if kind != "slide"]
        alike = kinds == self._clips and np.abs(arcs[fixed] - self.arcs[fixed]).max() <= _LENGTHENED * self.length
        moved = alike and not np.array_equal(arcs[fixed], self.arcs[fixed])
        if moved and self.rings:
            alike = False
        if not alike:
            self.history = self.elements = 0
            return
        if self.rings:
            arcs[self.rings] = (self.bounds() if self.history else self.arcs)[self.rings]
        if self.elements and moved:
            self.nodes[:] = np.interp(self.nodes, self.arcs, arcs)
            self.history = min(self.history, 1)

    def aim(self, start: Grip, end: Grip | FreeEnd, trial: bool = False) -> Array:
        """Poses of the supports (m+1, 7), after what holds and loads the ends has been taken into account.

        trial: into the trial itself.
        """
        if type(end) is Grip:
            kinds = (start.kind, end.kind)
            if kinds != self._kinds:
                self.hold(kinds, _NOTHING, _NOTHING)
            poses = self.target if trial else self.knots
            poses[0], poses[-1] = start.cable_frame.array, end.cable_frame.array
        else:
            assert isinstance(end, FreeEnd)
            tip = end.mass * self.problem.end_fall + end.force
            kinds = (start.kind, "free")
            if kinds != self._kinds or not (
                np.array_equal(tip, self._tip) and np.array_equal(end.moment, self._moment)
            ):
                self.hold(kinds, tip, end.moment)
            poses = self.target if trial else self.knots
            poses[0] = poses[-1] = start.cable_frame.array
        if trial and self._clips:
            poses[1:-1] = self.problem.clip_frames
        return poses

    def hold(self, kinds: tuple[str, ...], tip: Array, moment: Array) -> None:
        """Takes over how the ends are held and loaded."""
        self._kinds, self._tip, self._moment = kinds, tip, moment
        self.unsettle()
        pieces = len(self.material.pieces)
        all_kinds = (kinds[0], *self._clips, kinds[1])
        structure = _structure(all_kinds, pieces, self.points.size, self.round_straight)
        changed = self.elements and structure != self.structure
        self.structure, self._bare = structure, bare_of(structure)
        self.held = self._bare.floats.copy()
        free = kinds[1] == "free" and kinds[0] in ("swivel", "pinned")
        self.turns_freely = not set(all_kinds) <= {"clamped", "fixed"}  # some support leaves a rotation free
        self.rolls = bool(free and self.round_straight and not self._clips and np.any(moment))
        self.forces = self.spans - (kinds[1] == "free")
        self._tell()
        self._still_stops = stops = self._stops()
        if not self.elements:
            return
        on = np.abs(self.nodes[:, None] - stops).min(axis=0, initial=math.inf) if stops.size else stops
        if changed or (on > AT * self.length).any():
            pieces_of = [self._as_dense(self.nodes[a : b + 1]) for a, b in self.runs]
            inside = np.bincount(np.searchsorted(self.bounds(), stops) - 1, minlength=self.spans).tolist()
            self.lay_out(pieces_of, [max(b - a, 2 * k + 2) for (a, b), k in zip(self.runs, inside, strict=True)])
            self.history = min(self.history, 1)
        else:
            mesh.take_over(self._bare.ints, self.held, self.ints, self.floats)

    @property
    def stops(self) -> Array:
        """(j,) [m], arc lengths inside spans at which a mesh gets nodes: masses, and kinks of what varies along the
        cable; next to an eyelet only those of the load, as the cable runs through it now."""
        return self._stops() if self.kinks.size else self._still_stops

    def _stops(self) -> Array:
        """The same, found."""
        stops, apart = self.material.stops, AT * self.length
        if stops.size:
            bounds = self.bounds()
            stops = stops[np.abs(stops[:, None] - bounds).min(axis=1) > apart]
            stops = stops[~self._running(stops, bounds)]
            if self.kinks.size:
                kinks = self.kinks[np.abs(self.kinks[:, None] - bounds).min(axis=1) > _BESIDE * self.length]
                stops = np.union1d(stops, kinks[self._running(kinks, bounds)])
        if self.points.size == 0:
            return stops
        stops = stops[np.abs(stops[:, None] - self.points).min(axis=1, initial=math.inf) > apart]
        return np.union1d(stops, self.points)

    def _running(self, arcs: Array, bounds: Array) -> Any:
        """Whether these arc lengths are in a span next to an eyelet."""
        return np.isin(np.searchsorted(bounds, arcs) - 1, [knot + side for knot in self.rings for side in (-1, 0)])

    @property
    def missed(self) -> float:
        """[m], by how much a shape may be off because the cable has run on, and kinks of its load are no nodes now.

        In an element, of length h, the force is taken for a parabola. Where its second derivative jumps by D, at the
        share t of it, the moment is off by D h^3 t^2 (1 - t)^2 / 12.
        """
        if self.kinks.size == 0:
            return 0.0
        at = np.searchsorted(self.nodes, self.kinks)  # two nodes are at a knot
        left, right = self.kinks - self.nodes[at - 1], self.nodes[at] - self.kinks
        off = self.sharpness * left**2 * right**2 / (12.0 * (left + right))
        return float(off.sum() * self.length**2 / min(self.problem.cable.bending_stiffness))

    @staticmethod
    def _as_dense(nodes: Array) -> tuple[Array, Array]:
        """Abscissae and density of a span's nodes as they are."""
        return nodes.copy(), 1.0 / np.gradient(nodes)

    @property
    def doubtful(self) -> bool:
        """Whether no error estimate has told yet of the mesh that the last solution is on."""
        return self.history == 0 or self._resumed

    def settle(self) -> None:
        """The last solution is one under these loads: from it only a motion of the supports turns frames far."""
        self._resumed = False
        self.history = min(2, self.history + 1)
        self.at_rest = self.held[tables.TURN_AT_REST] = self.floats[tables.TURN_AT_REST] = _UNMOVED

    def unsettle(self) -> None:
        """The next solution may be far from the last one though no support moves."""
        self.at_rest = math.inf
        for floats in (self.held, self.floats):
            if floats.size > tables.PAR:
                floats[tables.TURN_AT_REST] = math.inf

    # -- the mesh

    @property
    def runs(self) -> list[tuple[int, int]]:
        """First and last node of each span."""
        if self._spans is None:
            first = self.ints[tables.HEAD : tables.HEAD + self.spans + 1].tolist()
            self._spans = [(a + j, b + j) for j, (a, b) in enumerate(pairwise(first))]
        return self._spans

    def finer(self, fineness: float) -> float:
        """How many times the usual number of elements a cold start's mesh has that is so much finer than its own."""
        usual: float = (NAMED_TOLERANCE * self.length / self.tolerance) ** (1.0 / 6.0)
        return fineness * min(max(usual, 0.75), 3.0)

    def first_mesh(self, poses: Array, fineness: float = 1.0, turn: float = 0.0) -> None:
        """A cold start's mesh, see ``mesh.wish_first``; turn [rad]: how far the frames turn along the cable."""
        self.elements = self.history = self.fewest = 0
        if self.rings:
            self._tell()
        finer = self.finer(fineness)
        self.take_arrays(*start.first_mesh(self._bare.ints, self.held, poses, 0.0, self.stops, finer, turn))

    def layers(self, poses: Array) -> Array:
        """(m,) [m]: boundary layers of the spans between these poses."""
        out = np.empty(self.spans)
        sols = np.zeros(3 * int(tables.solution_size.py_func(self._bare.ints)))
        start.put_knots(self._bare.ints, sols, poses, 0.0)
        drive.strip(self._bare.ints, self.held, sols)
        mesh.span_layers(self._bare.ints, self.held, sols, out, np.empty(mesh.ROOM))
        return out

    def guesses(self, poses: Array) -> list[tuple[int, float]]:
        """Kind and tilt of the guesses between `poses`, in the order to try them."""
        return [(int(kind), sag) for kind, sag in start.likeliest(self._bare.ints, self.held, poses).tolist()]

    def started(self, poses: Array, turns: float, meshes: int, out: Array, loads: Array) -> int:
        """Solves from nothing on a cold start's mesh and `meshes` that it asks for: a code of ``start.start``."""
        code, *arrays = start.start(
            self._bare.ints, self.held, poses, turns, self.stops, self.finer(1.0), self.tolerance, meshes,
            self.problem.points, out, self.info, loads,
        )  # fmt: skip
        self.history = self.fewest = 0
        self.factored = True
        self.take_arrays(*arrays)
        return int(code)

    def next_mesh(self) -> bool:
        """A mesh that the last error estimate asks for, and the last solution on it; False if it cannot be finer."""
        estimate = float(self.info[I_ESTIMATE] + self.info[I_DOUBT])
        found, *arrays = start.next_mesh(
            self._bare.ints, self.held, self.ints, self.floats, self.sols, self.stops,
            estimate if math.isfinite(estimate) else math.inf, self.tolerance,
        )  # fmt: skip
        if found:
            self.take_arrays(*arrays)
        return bool(found)

    def bounds(self) -> Array:
        """(m+1,) [m]: arc lengths of the supports as the cable runs through them now."""
        if not self.rings or not self.elements:
            return self.arcs
        return np.concatenate((self.nodes[[a for a, _ in self.runs]], [self.length]))

    def too_coarse(self, info: list[float]) -> bool:
        """Whether the error is above its tolerance, or an element turns too far for the inertia to be trusted."""
        doubt = info[I_DOUBT] if self.doubtful else 0.0  # beside a shape that was found without any there is none
        return info[I_ESTIMATE] + doubt > self.tolerance or info[I_TURN] > LARGEST_TURN

    def far_too_coarse(self, info: list[float]) -> bool:
        """Whether even a step on the way needs a finer mesh."""
        return info[I_ESTIMATE] > 30.0 * self.tolerance or info[I_TURN] > 2.0 * LARGEST_TURN

    def too_fine(self, info: list[float]) -> bool:
        """Whether a mesh of much fewer elements would do."""
        return info[I_ESTIMATE] + info[I_DOUBT] < self.too_fine_below and info[I_TURN] < 0.5 * mesh.TURN_AIM

    @property
    def too_fine_below(self) -> float:
        """[m], an error below which a mesh of much fewer elements would do; 0 where there is none."""
        least = mesh.FEWEST if self.spans == 1 else mesh.FEWEST_OF_SPAN * self.spans
        coarsest = self.elements <= max(1.5 * (least + 2 * self.stops.size), self.fewest)
        return 0.0 if coarsest else _TOO_FINE * self.tolerance

    def lay_out(self, pieces: list[Piece], counts: Sequence[int]) -> None:
        """Nodes of equal share of each span's density, `counts` elements a span; solutions are carried over."""
        bounds = self.bounds()
        for (x, _), low, high in zip(pieces, bounds[:-1], bounds[1:], strict=True):
            x[0], x[-1] = low, high
        at = np.concatenate(([0], np.cumsum([x.size for x, _ in pieces])))
        wish = mesh.Density(at, np.concatenate([x for x, _ in pieces]), np.concatenate([d for _, d in pieces]), bounds)
        self.take_arrays(
            *mesh.laid_out(
                self._bare.ints, self.held, self.ints, self.floats, self.sols, np.array(counts), self.stops, wish
            )
        )

    def take_arrays(self, ints: Any, floats: Array, sols: Array, work: Array) -> None:
        """Makes these the plan, the model, the solutions and the work space."""
        self.ints, self.floats, self.sols, self.work = ints, floats, sols, work
        self.elements = int(ints[tables.N_ELEMENTS])
        nodes = self.elements + self.spans
        self.nodes = floats[tables.PAR : tables.PAR + nodes]
        first = 2 * (sols.size // 3) + 4 * nodes + 3 * self.spans
        self.target = sols[first : first + 7 * int(ints[tables.N_KNOTS])].reshape(-1, 7)
        self._model = self._spans = None

    @property
    def model(self) -> tables.Model:
        """The model's arrays by name."""
        if self._model is None:
            self._model = tables.model_of.py_func(self.ints, self.floats)
        return self._model

    def _tell(self) -> None:
        """Tells the model with one element a span what cable and loads are."""
        held, bare = self.held, self._bare
        held[: tables.PAR] = (
            self.softest, _NEUTRAL * self.softest, self.length, self.elastic, self.stiffest, self.at_rest,
            self.stretch == 0.0, _SOFTER if self.turns_freely else 1.0, 0.0,
        )  # fmt: skip
        held[bare.s] = self.arcs.repeat(2)[1:-1]
        held[bare.heavy] = self.problem.cable.linear_density * self.problem.gravity
        held[bare.breaks] = self.material.breaks
        held[bare.piece] = self.material.pieces.ravel()
        held[bare.force] = self._own.ravel()
        held[bare.force.stop - 3 : bare.force.stop] += self._tip
        held[bare.moment] = self._moment
        held[bare.friction], held[bare.draw] = self.rough, self.drawn
        if self.points.size:
            held[bare.at] = self.points
            held[bare.act] = self.weights.ravel()
        drive.refill(bare.ints, held)

    # -- solutions

    def solution(self, which: int) -> tables.Solution:
        """Solution NOW, BEFORE or TRIAL."""
        found: tables.Solution = tables.solution_of.py_func(self.ints, self.sols, which)
        return found

    def put_aside(self) -> tuple[Any, ...]:
        """Mesh and solutions, for `put_back`."""
        return self.ints, self.floats, self.sols, self.work, self.info.copy(), self.history

    def put_back(self, kept: tuple[Any, ...]) -> None:
        """Mesh and solutions as they were when put aside; a mesh as coarse as the one now is not tried again."""
        ints, floats, sols, work, info, self.history = kept
        self.info[:] = info
        self.fewest = self.elements
        self.take_arrays(ints, floats, sols, work)

    def copied(self) -> Network:
        """The memory once more, sharing only the problem and the plan, which a solve does not change."""
        other = copy.copy(self)
        for name, part in vars(self).items():
            if isinstance(part, np.ndarray) and part is not self.ints:
                setattr(other, name, part.copy())
        if self.ints is not None:
            other.take_arrays(other.ints, other.floats, other.sols, other.work)
        return other

    def start_from(self, poses: Array, kind: int, sag: float, turns: float = 0.0) -> None:
        """Puts a guess (see ``guess.guess``) between `poses` into the trial; turns: those that their signs are of."""
        self.target[...] = poses
        self.sols[-1] = turns
        drive.strip(self.ints, self.floats, self.sols)
        placed = np.zeros(len(poses), dtype=np.int64)
        guess.guess(self.ints, self.floats, self.sols, placed, kind, sag, turns != 0.0)

    def start_with(self, poses: Array, frames: Callable[[Array], Array], force: Array) -> None:
        """Puts given frames between `poses` into the trial; force (3,) [N]: at the end."""
        trial = self.solution(TRIAL)
        trial.pose[...] = poses
        trial.turns[0] = 0.0
        trial.q[...] = frames(self.nodes)
        trial.lam[...] = force
        if float(trial.q[0] @ poses[0, 3:]) * float(trial.q[-1] @ poses[-1, 3:]) < 0.0:
            trial.pose[-1, 3:] *= -1.0

    def resume(self, poses: Array, fineness: float = 1.0) -> bool:
        """Puts the last shape in the place of the last solution, its supports where their points are; False if none.

        fineness: of the mesh, as for `first_mesh`.
        """
        shape = self.last
        if shape is None or not shape.status or shape.length != self.length or shape.points < _FEWEST_POINTS:
            return False
        self.first_mesh(poses, fineness)
        now, nodes = self.solution(NOW), self.nodes
        now.q[...] = interpolated(nodes, shape.arc_length, shape.quaternions)
        bounds = self.bounds()
        for i in range(3):
            now.pose[:, i] = np.interp(bounds, shape.arc_length, shape.positions[:, i])
        for j, (a, b) in enumerate(self.runs):
            first = a - j
            middles = 0.5 * (nodes[a:b] + nodes[a + 1 : b + 1])
            for i in range(3):
                force = np.interp(middles, shape.arc_length, shape.force[:, i])
                now.lam[j, i] = (force - self.model.load[first : first + b - a, 3 + i]).mean()
            now.pose[j, 3:] = now.q[a]
            now.pose[j + 1, 3:] = now.q[b]
        now.turns[0] = shape.turns
        now.arc[...] = bounds[self.rings]
        if self.rings:
            self.hold_along(shape)
        self.history, self._resumed = 1, True
        return True

    def masses(self, end: Grip | FreeEnd) -> Array:
        """(j, 4): arc length [m] and weight [N] of the point masses, and of a plug on this end."""
        problem = self.problem
        rows = [(mass.arc_length, *(mass.mass * problem.gravity)) for mass in problem.masses]
        if isinstance(end, FreeEnd) and end.mass > 0.0:
            rows.append((self.length, *(end.mass * problem.gravity)))
        return np.array(rows) if rows else _NO_MASSES

    def energy_of_masses(self) -> float:
        """[J], potential energy of point masses and of a plug in the last solution."""
        masses = self.masses(self.problem.end)
        return float(drive.energy_of_masses(self.ints, self.floats, self.work, masses)) if masses.size else 0.0

    def node_positions(self) -> tuple[Array, Array]:
        """Arc lengths (n,) and positions (n, 3) of the nodes of the last solution."""
        work = tables.work_of.py_func(self.ints, self.work)
        positions = np.empty((self.nodes.size, 3))
        for j, (a, b) in enumerate(self.runs):
            positions[a] = work.place[j]
            positions[a + 1 : b + 1] = work.place[j] - np.cumsum(work.first[a - j : b - j, :3], axis=0)
        return self.nodes, positions

    # -- eyelets

    def _take_friction(self, eyelets: Sequence[tuple[Clip, Cable]]) -> None:
        """Takes over the friction of eyelets and of the cables in them."""
        rough, before = roughness(eyelets), self.rough
        self.has_friction = bool(rough.any())
        self.rough = rough if self.problem.rubs else np.zeros(rough.size)
        if self.elements and before.size == rough.size:  # what had none has kept nothing
            self.solution(NOW).grip[(before == 0.0) & (rough > 0.0)] = 0.0

    @property
    def ring_rows(self) -> list[int]:
        """Which of the clips the eyelets are."""
        return [ring - 1 for ring in self.rings]

    def told_friction(self, clips: int) -> tuple[Array, bool]:
        """(clips, 2): the friction of each along the cable [N], and 1 if it slips; (0, 2) if there is none.

        And whether eyelets have friction that the last solution does not know, since it has no past.
        """
        if not (self.has_friction and self.problem.rubs):
            return NOT_RUBBED, self.has_friction
        told = gripping.told(self.ints, self.floats, self.sols, self.work)
        out = np.zeros((clips, 2))
        out[self.ring_rows] = told[:, :2]
        return out, not told[:, 2].all()

    def forget_friction(self) -> None:
        """Has the friction of eyelets not count from the last solution: they begin without."""
        if self.has_friction:
            self.solution(NOW).grip[:, [FROM_FIRM, TO_FIRM]] = 0.0

    def hold_along(self, shape: Any) -> None:
        """Has the friction of eyelets count from this shape on, which the last solution is."""
        if len(shape.rubbed) == 0:
            return
        now = self.solution(NOW)
        now.grip[:, TO], now.grip[:, TO_PULL] = now.arc, shape.rubbed[self.ring_rows, 0]
        now.grip[:, TO_FIRM], now.grip[:, SLIPPED] = self.neutral / self.length, shape.rubbed[self.ring_rows, 1]

    def ring_name(self, ring: int) -> str:
        """What an eyelet is called."""
        return f"clips[{ring - 1}]"

    def slack(self, arcs: Array, frames: Array) -> Array:
        """(m,) [m]: by how much each span between these arc lengths is longer than the way between its supports at
        `frames`; of an extensible cable, or before a free end, its length."""
        room = np.diff(arcs)
        if self.stretch == 0.0:
            chords = np.linalg.norm(np.diff(frames[:, :3], axis=0), axis=1)
            room[: self.forces] -= chords[: self.forces]
        return np.asarray(room)

    def apart(self, arcs: Array, frames: Array) -> Array:
        """(m,) [m]: how long each span seems to have to be between supports at `frames`."""
        return np.asarray(np.diff(arcs) - self.slack(arcs, frames))

    def begin_at(self, arcs: Array) -> None:
        """Makes these the arc lengths (m+1,) at which the cable is in its eyelets before it is laid out."""
        self.arcs = arcs

    def slide_to(self, arcs: Array) -> None:
        """Moves the cable through its eyelets to these arc lengths (m+1,): nodes between them are spread anew."""
        old = np.concatenate((self.bounds(), self.points))
        new = np.concatenate((arcs, self.points))
        order = np.argsort(old)
        runs = self.runs
        self.nodes[:] = np.interp(self.nodes, old[order], new[order])
        for (a, b), low, high in zip(runs, arcs[:-1], arcs[1:], strict=True):
            self.nodes[a], self.nodes[b] = low, high
        drive.refill(self.ints, self.floats)
        self.solution(TRIAL).arc[...] = arcs[self.rings]

    def predicted_arcs(self) -> Array:
        """The arc lengths of the supports, those at eyelets extrapolated along the motion of the supports."""
        arcs = self.bounds().copy()
        if self.history > 1:
            a = drive.pace_of(self.ints, self.floats, self.sols)
            arcs[self.rings] += a * (self.solution(NOW).arc - self.solution(BEFORE).arc)
        return arcs

    def beside(self, cables: Sequence[Cable], kept: dict[bytes, Array] | None = None) -> tuple[Array, Array, Array]:
        """Models (c, size) with one element a span of other cables held in the same way, and arc lengths (a,) on this
        one with where they are on those (c, a): see ``mesh.neighbours``.

        Supports and point loads stay at their arc length; both ends and kinks of what varies along the cable at their
        share of the length, short of supports. kept: what these very cables are made of, from call to call, by where
        they have kinks.
        """
        stays = np.union1d(self.bounds()[:-1], self.points[self.weights.any(axis=1)])
        kinks = np.append(np.setdiff1d(self.stops, stays), self.length)
        places = np.concatenate((stays, kinks))
        order = np.argsort(places)
        at = np.searchsorted(stays, kinks)
        low, high = stays[at - 1], np.append(stays, math.inf)[at]
        models, after = np.tile(self.held, (len(cables), 1)), np.tile(places[order], (len(cables), 1))
        pieces = self._substances(cables, {} if kept is None else kept)
        for model, there, cable, made_of in zip(models, after, cables, pieces, strict=True):
            longer = cable.length != self.length
            if cable.linear_density == self.problem.cable.linear_density and not (longer and self.problem.masses):
                model[self._bare.piece] = made_of  # loads are the same at the same share of the length
                if longer:
                    bounds = np.append(self.arcs[:-1], cable.length)
                    model[self._bare.s] = bounds.repeat(2)[1:-1]
                    model[self._bare.breaks] = self.material.breaks * (cable.length / self.length)
            else:
                other = Network(self.problem.beside(cable))
                other.hold(self._kinds, self._tip, self._moment)
                model[:] = other.held
            if longer:
                moved = np.clip(kinks * (cable.length / self.length), 0.5 * (low + kinks), 0.5 * (kinks + high))
                there[:] = np.concatenate((stays, moved))[order]
        return models, places[order], after

    def models_beside(self, cables: Sequence[Cable], kept: dict[bytes, Array] | None = None) -> Array:
        """(c, size): models of other cables held in the same way, on the mesh as it is."""
        held, before, after = self.beside(cables, kept)
        models: Array = mesh.neighbours(self.bare, held, self.ints, self.floats, before, after)
        return models

    def models_loaded(self, rows: int) -> Array:
        """(3 rows, size): models on the mesh as it is of the same cable, faster by 1 m/s^2 about x, y and z at each of
        `rows` places, evenly along it, and linear between; it has kinks there now, or `rows` is 2."""
        problem, density = self.problem, self.problem.cable.linear_density
        breaks, at = self.material.breaks, np.linspace(0.0, self.length, rows)
        hats = np.stack([np.interp(breaks, at, one) for one in np.eye(rows)])  # (rows, breaks)
        middles = 0.5 * (breaks[1:] + breaks[:-1])
        weights = np.array([cable_at(problem.cable, s).linear_density for s in middles.tolist()])
        weights = weights if problem.cable.sections else np.full(len(middles), density)
        pieces = np.tile(self.material.pieces, (rows, 3, 1, 1))
        models = np.tile(self.held, (rows, 3, 1))
        for axis in range(3):
            pieces[:, axis, :, LOADS[axis]] -= weights * hats[:, :-1]
            pieces[:, axis, :, LOADS[3 + axis]] -= weights * hats[:, 1:]
        models[:, :, self._bare.piece] = pieces.reshape(rows, 3, -1)
        places = np.union1d(self.bounds(), self.stops)
        same = np.tile(places, (3 * rows, 1))
        flat = models.reshape(3 * rows, -1)
        out: Array = mesh.neighbours(self.bare, flat, self.ints, self.floats, places, same)
        return out

    @property
    def sampled(self) -> int:
        """How many points a shape has."""
        return self.problem.points

    def knots_of(self, supports: Sequence[int]) -> Array:
        """Which knots these supports are."""
        return np.array(supports, dtype=np.int64)

    def body_columns(self, name: str) -> tuple[Array, Array]:
        """Nothing is touched: zeros (points, 3, 6), and of the eyelets' pulls (e, 6)."""
        return np.zeros((self.problem.points, 3, 6)), np.zeros((len(self.rings), 6))

    def _substances(self, cables: Sequence[Cable], kept: dict[bytes, Array]) -> Array:
        """(c, pieces * columns): pieces of these cables under the loads of this one."""
        shares = self.material.breaks / self.length
        key = np.round(shares, 12).tobytes()
        if key not in kept:
            kept[key] = np.array([substance(c, shares) for c in cables]).reshape(len(cables), -1, tables.PIECE)
        out = kept[key].copy()
        out[:, :, LOADS] = self.material.pieces[:, LOADS]
        if self.problem.velocity is not None:
            self._slow(out, cables, shares)
        return out.reshape(len(cables), -1)

    def _slow(self, out: Array, cables: Sequence[Cable], shares: Array) -> None:
        """Puts the loads of other drag and damping into pieces (c, p, PIECE) between these shares of the length."""
        problem = self.problem
        slower = np.array([problem.slowed_by(cable) for cable in cables]) - problem.slowed_by(problem.cable)
        for more, x in ((-slower[:, 0], problem.velocity), (slower[:, 1], problem.lag)):
            if x is not None and more.any():
                places = np.linspace(0.0, 1.0, len(x))
                there = np.stack([np.interp(shares, places, y) for y in x.T], axis=1)
                out[:, :, LOADS] += more[:, None, None] * np.concatenate((there[:-1], there[1:]), axis=1)

    @property
    def knots(self) -> Array:
        """(k, 7): poses of the supports, without those of the ends."""
        out = np.zeros((self.arcs.size, 7))
        if self._clips:
            out[1:-1] = self.problem.clip_frames
        return out

    @property
    def parts(self) -> Bare:
        """Where things are in `held`."""
        return self._bare

    @property
    def bare(self) -> Whole:
        """The plan with one element a span, which `held` is the model of."""
        return self._bare.ints

    @property
    def turns(self) -> float:
        """Turns of the trial."""
        return float(self.sols[-1]) if self.elements else 0.0

    @property
    def roll(self) -> int:
        """The support against which the end's turns are counted."""
        return self.structure.cables[0].roll[0]

    @property
    def neutral(self) -> float:
        """[N], eigenvalues smaller than this count as zero."""
        return _NEUTRAL * self.softest

    def stiffen(self, factor: float) -> None:
        """Makes the cable so many times as stiff as it is."""
        pieces = self.material.pieces.copy()
        pieces[:, : material.COMPLIANCE] *= self._factor(factor)
        self.material = self.material._replace(pieces=pieces)
        self._tell()
        if self.elements:
            mesh.take_over(self._bare.ints, self.held, self.ints, self.floats)

    def _factor(self, factor: float) -> Array:
        """(18,): what the columns of the pieces are multiplied with to have the bending stiffness times `factor`."""
        out = np.ones(material.COMPLIANCE)
        out[material.K_LEFT : material.K_LEFT + 3] = out[material.K_RIGHT : material.K_RIGHT + 3] = factor / self._stiff
        self._stiff = factor
        return out

    @property
    def network_nodes(self) -> int:
        """How many nodes it has, those of its knots in each of their spans."""
        return len(self.nodes)

    def refresh(self) -> None:
        """Factors the matrix of the last solution."""
        self.factored = True
        respond.refresh(self.ints, self.floats, self.sols, self.work, True)

    def runs_away(self) -> bool:
        """Whether the energy of the last solution falls as the cable runs on through its eyelets."""
        if len(self.rings) == 0:
            return False
        self.refresh()
        _, J, _ = self.pulls()
        return bool(np.linalg.eigvalsh(-0.5 * (J + J.T))[0] < -self.neutral / self.length)

    def smallest_eigenvalue(self) -> float:
        """[N], of the last solution's second variation."""
        return float(respond.smallest_eigenvalue(self.ints, self.floats, self.sols, self.work.copy()))

    def is_minimum(self) -> bool:
        """Whether the second variation at the last solution, and not at an iterate before it, is positive."""
        work = self.work.copy()  # that of the solve stays
        respond.refresh(self.ints, self.floats, self.sols, work, False)
        return bool(respond.negative_below(self.ints, self.floats, work, self.neutral) <= 0)

    def pulls(self, points: int = 0) -> tuple[Array, Array, Array]:
        """F . d3 of the eyelets (e,) [N], its derivative in the arc lengths there (e, e), and that of the positions
        (points, 3, e). Needs `refresh`."""
        e = len(self.rings)
        f, J, out = np.empty(e), np.empty((e, e)), np.empty((points, 3, e))
        jumps = np.empty((self.spans, 3))
        respond.eyelets(self.ints, self.floats, self.sols, self.work, f, J, points, out, jumps)
        return f, J, out

    @property
    def poses(self) -> Array:
        """(m+1, 7): the supports of the last solution, quaternion signs continuous."""
        return self.solution(NOW).pose
