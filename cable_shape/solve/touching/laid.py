"""A cable in contact as it is laid out: what holds it, and its mesh."""

from __future__ import annotations

import copy
import math
from bisect import bisect_left
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from cable_shape.cable.cable import Cable
from cable_shape.cable.pieces import pieces_of, radius_of, stretches, widest
from cable_shape.checks import Array
from cable_shape.kernels.contact import afterwards, drive, press, run
from cable_shape.kernels.contact.carry import carry
from cable_shape.kernels.contact.lay import room_for
from cable_shape.kernels.contact.near import (
    ARC,
    BARE,
    LINK,
    NEAR,
    NORMAL,
    ON,
    ROUND,
    RUB,
    SPOT,
    sharpness,
    tangent_of,
)
from cable_shape.kernels.contact.pair_friction import RUBS
from cable_shape.kernels.contact.tables import Lying, Net
from cable_shape.kernels.network import material, tables
from cable_shape.kernels.network.tables import BEFORE, NOW, TRIAL
from cable_shape.pose import FreeEnd, Grip
from cable_shape.shape import CableShape
from cable_shape.solve.network import Network
from cable_shape.solve.plan import Whole
from cable_shape.solve.problem import Problem
from cable_shape.solve.rod_common import Patience
from cable_shape.solve.touching import mesh
from cable_shape.solve.touching.bodies import TouchBodies

MOST_ELEMENTS = 600
#: Times as many elements as at first, from which on nodes are taken away again, if contacts make a smaller error [L];
#: and from which on inside of rows whatever the error is.
MANY, COARSE, FULL = 1.15, 1e-4, 1.3
KEPT = 2.0  #: the same of a cable that friction holds
EDGE = 0.3  #: radii of the cable: a body whose surface, moved out by one, is curved by more than 1 / that has an edge
LEAST_LENGTH = 5e-4  #: of the cable's length: shorter elements are not divided
_NEUTRAL = 1e-6  #: modes softer than this fraction of the stiffness / length^2 count as neutral, and neutral as stable
#: Least stretch of a cable under weight + 10 EI / L^2 + the force on a free end: between two contacts nothing else lets
#: a straight piece give.
_LEAST_STRETCH = 1e-6
_NOTHING: Array = np.zeros(3)
_HELD = (0.0, 0.0, 0.0)
_WIDER = 6  #: vertices more that an elimination joins with one, where stretches hang together by pairs
_NOWHERE: Array = np.empty((0, 3))
_DRAWN = 0.02  #: of the length: a cable that is longer or shorter by less is followed, not looked for from nothing
_AT = 1e-9  #: loads nearer to an end than this fraction of the length are carried by it


class Chain(NamedTuple):
    """One of the cables of a network, from its first support to its last one."""

    supports: slice
    pieces: Array  # (p, 4), where each ends [m], its bending stiffness [N m^2], radius [m], coefficient of friction
    free: tuple[bool, bool]  # whether nothing holds the place of its start, of its end

    @classmethod
    def of(cls, cable: Cable, supports: slice, free: tuple[bool, bool], stiffer: float = 1.0) -> Chain:
        """Of a cable that is made so many times as stiff as it is."""
        rows = [
            (end, stiffer * one.mean_bending_stiffness, 0.5 * one.diameter, one.friction)
            for _, end, one in pieces_of(cable)
        ]
        return cls(supports, np.array(rows), free)

    @property
    def bend(self) -> float:
        """[N m^2], of the softest piece."""
        return float(self.pieces[:, 1].min())

    @property
    def radius(self) -> float:
        """[m], of the thinnest piece."""
        return float(self.pieces[:, 2].min())

    @property
    def rough(self) -> float:
        """The largest coefficient of friction."""
        return float(self.pieces[:, 3].max())

    def along(self, arcs: Array) -> Array:
        """(n, 3), what `pieces` has of that at each arc length [m]; between two: mean, thicker, rougher."""
        if len(self.pieces) == 1:
            return np.tile(self.pieces[0, 1:], (arcs.size, 1))
        ends, apart = self.pieces[:-1, 0], _AT * self.pieces[-1, 0]
        one, other = (self.pieces[np.searchsorted(ends, arcs + sign * apart), 1:] for sign in (-1.0, 1.0))
        out = np.maximum(one, other)
        out[:, 0] = 0.5 * (one[:, 0] + other[:, 0])
        return np.asarray(out)


class Pair(NamedTuple):
    """Two nodes at which cables press on each other, or may."""

    arcs: Array  # (2,) [m], `gaps` added
    reach: float  # [m], least distance of the centrelines
    push: float  # [N], 0: they do not touch
    places: Array  # (2, 3) [m]
    stays: bool = False  # the first node stays along its cable, see `kernels.contact.link`
    pull: Array = _NOTHING  # (3,) [N], friction on the first cable
    slips: bool = False


class Laid:
    """The solver's memory for cables among bodies; `history` tells how many solutions there are to start from.

    This one knows a single cable: what holds it are b supports, the start, the clips, the end. Arc lengths of several
    cables are told apart by `gaps`, one a cable, that are added to them: so they ascend from cable to cable.
    """

    problem: Problem
    gaps: Array = np.zeros(1)
    bodied = 1  #: so many of them, the first ones, are kept out of bodies
    rows = slice(None)  #: of a shape's points, those of the cable
    single = True  #: whether it is one cable, and no harness

    def __init__(self, problem: Problem) -> None:
        self.history = self.elements = 0
        self.touching = False  # whether the last solution is in contact
        self.tight = 1.0  # of the least stretch
        self.widest = 0.0  # [m], element behind a support, when the mesh was laid out
        self.layer = math.inf  # [m], at what holds the cable, for which the mesh was made because tension is high
        self.rubs = True  # whether there is friction: not on ways that are no steps of the cable
        self.slipped = False  # whether it has lain without friction, too short, since the last usable shape
        self.untidy = False  # whether contacts may have run up to nodes in it
        self.stood = False  # whether its contacts stand at their nodes, since no way led to it with contacts that run
        self.factored = (
            False  # whether `refresh` has factored the matrix of the last solution, and nothing was done since
        )
        self.patience = Patience()  # until another way is looked for where none led on
        self.stuck = False  # whether the last solve has found no way
        self.hasty = False  # whether roads are short: an equilibrium is near, or there is none
        self.free: CableShape | None = None  # the last shape, if it is not, and the frames of its supports (b+1, 7)
        self.free_frames: Array = np.zeros((2, 7))
        self._positions = _NOWHERE
        self._spacing = self._middles = np.empty(0)  # [m] of the nodes at first, and where
        self.bodies = TouchBodies()
        self.points: Array = np.empty(0)  # [m], of loads between the ends
        self._arcs: Array = np.zeros(2)  # (b+1,) [m], of the supports; of eyelets, where they were laid out
        self.rings: Any = np.empty(0, np.int64)  # supports that are eyelets
        self.slid: Array = np.zeros((3, 2))  # (3, b+1 + e GRIP) [m], arc lengths of the supports, and see `eyelets`
        self.info: Array = np.zeros(drive.INFO + 3)
        self.length = 0.0
        self.links: tuple[Pair, ...] = ()  # of the last solution, when it was made
        self.reach: Array = np.empty(0)  # (l,) [m], of the pairs
        self.rubbing: Array = np.zeros((3, 0, RUBS))  # their friction, see `kernels.contact.pair_friction`
        self._knots: Any = np.arange(2)  # of the supports
        self._moves: Any = np.zeros(2, dtype=bool)  # of the knots: whether their place is looked for
        self._grips: Array = np.zeros((3, 2, 7))
        self.turns: Array = np.zeros((3, 1))
        self._kinds: tuple[str, ...] = ()
        self._held_as: tuple[str, ...] = ()  # the kinds of the last solution
        self._tip = self._moment = _NOTHING
        self.take(problem)

    def take(self, problem: Problem) -> None:
        """Makes `problem` the one to solve; the last solution stays as a start if cable, bodies and clips are the same.

        Bodies and clips may have moved.
        """
        cable, length = problem.cable, problem.cable.length
        arcs = np.array((0.0, *(clip.arc_length for clip in problem.clips), length))
        rings = np.array([1 + i for i, clip in enumerate(problem.clips) if clip.kind == "slide"], dtype=np.int64)
        same_rings = arcs.size == self._arcs.size and np.array_equal(rings, self.rings)
        if same_rings:
            arcs[rings] = self._arcs[rings]  # what is in an eyelet is found
        alike, before = self.bodies.are(problem.bodies) and same_rings, (self._arcs, self.points)
        same = alike and self.length == length and np.array_equal(arcs, self._arcs)
        drawn = alike and not same and self._nearly(length, arcs)
        if not (same or drawn):
            self.forget()
            self.elements = 0
        if arcs.size != self._arcs.size:
            self._grips = np.zeros((3, arcs.size, 7))
        if self.slid.shape[1] != arcs.size + tables.GRIP * rings.size:
            self.slid = np.zeros((3, arcs.size + tables.GRIP * rings.size))
        kept = self.length > 0.0 and self.bend == self.bend_of_cables and problem.hangs_like(self.problem)
        self._arcs, self.rings = arcs, rings
        self._knots, self._moves = np.arange(arcs.size), np.zeros(arcs.size, dtype=bool)
        self.problem = problem
        self.unfactored()
        self.length = length
        if kept:
            self.cable.problem = _divided(problem)
        else:
            self._take_cable(problem)
        if drawn and not self._draw_out(*before):
            self.forget()
            self.elements = 0
        if self.bodies.take(problem.bodies, problem.gripping, problem.links, 0.5 * widest(cable), problem.carried):
            self.forget()
        if kept:
            self._find_friction()
        else:
            self._kinds = ()

    def _nearly(self, length: float, arcs: Array) -> bool:
        """Whether a cable of that length, held there, is the one before but for a little."""
        near = abs(length - self.length) <= _DRAWN * self.length and arcs.size == self._arcs.size
        return bool(near and self.elements and self.single and not (self.rings.size or self.links))

    def _draw_out(self, arcs: Array, points: Array) -> bool:
        """Spreads the nodes, between supports and loads that were at `arcs` and `points`, over the cable as it is now.

        False: it has other loads.
        """
        if points.size != self.points.size:
            return False
        then, now = np.concatenate((arcs, points)), np.concatenate((self._arcs, self.points))
        nodes = np.interp(self.nodes, *mesh.spread(then, now, _NOTHING[:0]))
        for old, new in zip(then, now, strict=True):
            nodes[np.abs(self.nodes - old).argmin()] = new
        self.near[:TRIAL, :, ARC] += nodes - self.nodes
        share = now.max() / then.max()
        self._spacing, self._middles = share * self._spacing, share * self._middles
        self.slid[:, : self._arcs.size] = self._arcs
        self.s[:] = self.s_then[:] = nodes
        self.h[:] = np.diff(nodes)
        return True

    def _take_cable(self, problem: Problem) -> None:
        """Takes over what the cable is made of, and its loads."""
        cable, arcs, length = problem.cable, self._arcs, self.length
        self.cable = Network(_divided(problem))  # what the cable is made of, and how it is held
        self.weight = float(np.linalg.norm(self.cable.mean_load)) * length
        self.bend = self.bend_of_cables = min(one.mean_bending_stiffness for _, _, one in pieces_of(cable))
        self.limpness = math.inf if self.weight == 0.0 else self.bend / (self.weight * length**2)
        self._count = mesh.first_count(length, self.bend, self.weight / length)
        pulled = [one.axial_stiffness for _, _, one in pieces_of(cable)]
        self._stretch = max(0.0 if stiff is None else 1.0 / stiff for stiff in pulled)
        self.stretches = stretches(cable)
        at = self.cable.problem.load_arc_length.copy()
        for arc in arcs:
            at[np.abs(at - arc) < _AT * length] = arc
        inside = (at > _AT * length) & (at < (1.0 - _AT) * length)
        self.points = at[inside]
        self._stops: Array = np.union1d(self.points, arcs[1:-1])
        self.radius = radius_of(cable)

    def move_bodies(self, links: Array) -> None:
        """Puts the bodies on links where these rows of `TouchBodies.link_rows` say; without rows they are left out."""
        if self.bodies.move(links):
            self.forget()

    # -- what holds the cable

    def aim(self, start: Grip, end: Grip | FreeEnd) -> Array:
        """The frames of the supports (b+1, 7), after what holds the ends has been taken into account."""
        frames = np.zeros((self._arcs.size, 7))
        frames[0] = start.cable_frame.array
        if len(frames) > 2:
            frames[1:-1] = self.problem.clip_frames
        if isinstance(end, Grip):
            frames[-1] = end.cable_frame.array
            self._hold(start.kind, end.kind, _NOTHING, _NOTHING)
        else:
            frames[-1] = frames[0]
            self._hold(start.kind, "free", end.mass * self.problem.end_fall + end.force, end.moment)
        return frames

    def aimed(self) -> Array:
        """`aim` at the problem's ends."""
        return self.aim(self.problem.start, self.problem.end)

    def _hold(self, start: str, end: str, tip: Array, moment: Array) -> None:
        """Takes over how the ends are held, and the load on a free end."""
        kinds = (start, *[clip.kind for clip in self.problem.clips], end)
        if kinds == self._kinds and _same(tip, self._tip) and _same(moment, self._moment):
            return
        if self.elements and kinds != self._held_as:
            self.history = min(self.history, 1)
            self._grips[NOW, :, 3:] = self.q[NOW, self.held]
        self._kinds, self._held_as, self._tip, self._moment = kinds, kinds, tip, moment
        self.cable.hold((start, end), tip, moment)
        self.forces = self.cable.forces
        self._take_structure()

    def _take_structure(self) -> None:
        """Takes over how the network is held, and tells it what its cables are made of."""
        structure, plan = self.cable.structure, tables.plan_of.py_func(self.cable.bare)
        masks: list[tuple[float, ...]] = []
        for c, (first, last) in enumerate(pairwise(plan.cables.tolist())):
            for j, end in [(j, 0) for j in range(first, last)] + [(last - 1, 1)]:
                span, knot = structure.spans[j], structure.spans[j][end]
                if span.tied[end]:
                    masks.append(_HELD if span.turned[end] else structure.loose[knot])
                else:
                    masks.append(structure.free[j][end])
            assert len(masks) == last + c + 1
        self.held_mask: Array = np.array(masks)
        self._tell()

    def _chained(self) -> tuple[Chain, ...]:
        """The cables."""
        free = (False, self.forces < self._arcs.size - 1)
        stiffer = self.bend / self.bend_of_cables
        return (Chain.of(self.problem.cable, slice(0, self._arcs.size), free, stiffer),)

    @property
    def in_pieces(self) -> bool:
        """Whether what cables are made of changes along one of them."""
        return any(len(chain.pieces) > 1 for chain in self.chains)

    def _tell(self) -> None:
        """Tells the network what the cable is made of: it stretches a little, whatever it is."""
        self.chains = self._chained()
        self._find_friction()
        cable, made = self.cable, self.cable.held.copy()
        pull = self.weight + 10.0 * self.bend_of_cables / self.length**2
        self.usual_pull = pull + self._pull_of_tips()
        self.least_stretch = self.tight * _LEAST_STRETCH / self.usual_pull
        #: of what stretches least
        self.stretch = max(self._stretch, self.least_stretch) if self.stretches else self.least_stretch
        self.let_stretch(made[cable.parts.piece])
        made[tables.ELASTIC], made[tables.RIGID] = 1.0, 0.0
        made[tables.BASE_SHIFT] = _NEUTRAL * made[tables.SOFTEST]
        self.made: Array = made
        self.unfactored()
        if self.elements:
            self._fill_nodes(self.nodes, self._ends_of(self.nodes))
            self._load(self.nodes)

    def _find_friction(self) -> None:
        """Tells whether bodies have friction, or the cables."""
        self.has_friction = bool(self.bodies.rough.any() or any(chain.rough for chain in self.chains))

    def let_stretch(self, pieces: Array) -> None:
        """Lets pieces (p PIECE,) of a model stretch by the least that any cable does."""
        column = pieces.reshape(-1, tables.PIECE)[:, material.COMPLIANCE + 2]
        np.maximum(column, self.least_stretch, out=column)

    def _fill_nodes(self, nodes: Array, ends: Whole) -> None:
        """Tells the nodes (n,) what their cable is; ends (c,): the last ones of each."""
        counts = np.diff(ends, prepend=-1)
        self._gap_of_nodes: Array = np.repeat(self.gaps, counts)
        own = np.split(nodes - self._gap_of_nodes, ends[:-1] + 1)
        made = np.concatenate([chain.along(arcs) for chain, arcs in zip(self.chains, own, strict=True)])
        self.flex, self.thick, self.rough = 1.0 / made[:, 0], made[:, 1].copy(), made[:, 2].copy()

    def _pull_of_tips(self) -> float:
        """[N], force on free ends."""
        return float(np.linalg.norm(self._tip))

    def stiffen(self, factor: float) -> None:
        """Makes the cable so many times as stiff as it is."""
        self.cable.stiffen(factor)
        self.bend = factor * self.bend_of_cables
        self._tell()

    def tighten(self, tight: float) -> None:
        """Lets a cable that does not stretch give by this part of what it may."""
        self.tight = tight
        self._tell()

    # -- the mesh

    @property
    def nodes(self) -> Array:
        """(n,) [m], arc lengths, `gaps` added."""
        return self.s if self.gaps.size == 1 else self.s + self._gap_of_nodes

    def _within(self, nodes: Array) -> Any:
        """Which of the pieces between nodes (n,) are no gap between cables."""
        return ~np.isin(np.arange(nodes.size - 1), self._ends_of(nodes)[:-1])

    def _ends_of(self, nodes: Array) -> Whole:
        """The last of these nodes of each cable."""
        return np.searchsorted(nodes, [self._arcs[chain.supports][-1] for chain in self.chains])

    @property
    def arcs(self) -> Array:
        """(b+1,) [m], of the supports."""
        if not (self.elements and self.rings.size):
            return self._arcs
        arcs = self._arcs.copy()
        arcs[self.rings] = self.nodes[self.held[self.rings]]
        return arcs

    def bounds(self) -> Array:
        """`arcs`."""
        return self.arcs

    @property
    def stops(self) -> Array:
        """[m], of clips, masses and pairs, where nodes must be."""
        own = np.union1d(self.points, self.arcs[1:-1] if self.single else self.arcs) if self.rings.size else self._stops
        if not self.links:
            return own
        paired = self.nodes[self.on[NOW, :, LINK] != BARE] if self.elements else [x for p in self.links for x in p.arcs]
        return np.union1d(own, paired)

    def lay_out(self, nodes: Array) -> None:
        """Makes `nodes` (n,) the mesh and carries the last solutions over to it."""
        self._arcs = self.arcs
        n, n_old = nodes.size - 1, self.elements
        old_nodes = self.nodes.copy() if n_old else nodes
        if n_old:
            old = (self.q, self.near, self.on, self.ends)
        self.elements = n
        ends = self._ends_of(nodes)
        self._fill_nodes(nodes, ends)
        self.s: Array = nodes - self._gap_of_nodes if self.gaps.size > 1 else nodes.copy()
        self.h: Array = np.diff(nodes)
        self._gaps_at = ends[:-1]
        self.errors: Array = np.zeros(n - ends.size + 1)
        self.start: Array = np.zeros((n + 1, 4))
        self.q: Array = np.zeros((3, n + 1, 4))
        self.near: Array = np.zeros((3, n + 1, NEAR))
        self.on: Any = np.full((3, n + 1, ON), BARE)
        self.ends: Array = np.zeros((3, self._arcs.size - self.gaps.size, 3))
        self.frames: Array = np.zeros((self._arcs.size, 7))
        self.held: Any = np.abs(nodes[:, None] - self._arcs).argmin(axis=0)
        self._pairs: Any = np.array([(0, 0, pair.stays) for pair in self.links], np.int64).reshape(-1, 3)
        if not n_old:
            self.rubbing = np.zeros((3, len(self.links), RUBS))
        self.widest = float(self.h[self.held[:-1]].max())
        self.loads: Array = np.zeros((n + 1, 7))
        self.s_then: Array = self.s.copy()  # before the last step
        self.unfactored()
        self._load(nodes)
        if not n_old:
            return
        q, near, on, self.ends = old
        new = np.empty(n + 1, dtype=np.bool_)
        for which in (NOW, BEFORE):
            own = self.q[which], self.near[which], self.on[which]
            carry(old_nodes, q[which], near[which], on[which], nodes, *own, _AT * self.length, new)
            if self.has_friction and new.any():
                mesh.share_in(nodes, self.near[which], self.on[which], new)

    def _put(self, nodes: Array) -> None:
        """Puts the nodes there."""
        self.s[:] = nodes if self.gaps.size == 1 else nodes - self._gap_of_nodes
        if self.gaps.size > 1:
            fixed = np.setdiff1d(np.arange(self.held.size), self.rings)
            self.s[self.held[fixed]] = (self._arcs - self._gap_of_nodes[self.held])[fixed]
        self.h[:] = np.diff(self.s)
        self.h[self._gaps_at] = 0.0

    def _elimination(self) -> tuple[Whole, int]:
        """In which order the knots are eliminated, and how many vertices beyond the two next ones that joins."""
        return np.arange(int(self.cable.bare[tables.N_KNOTS])), 0

    def _load(self, nodes: Array) -> None:
        """Puts the nodes there, and makes room for the network."""
        self._put(nodes)
        bare = self.cable.bare
        knots, spans, n = int(bare[tables.N_KNOTS]), int(bare[tables.N_SPANS]), self.errors.size
        order, wide = self._elimination()
        wide += _WIDER if self.links else 0
        plan, model, solutions, work, run, room = room_for(bare, n, wide, len(self.links))
        where, span = np.zeros(knots + n, np.int64), np.zeros(knots + n, np.int64)
        moves = np.array([knot.moves for knot in self.cable.structure.knots], dtype=np.int64)
        self.net = Net(
            bare, self.made, order, np.argsort(order), moves, wide, np.zeros(plan, np.int64), np.empty(model),
            np.zeros(3 * solutions), np.zeros(work), np.zeros(run), where, span, np.zeros(n, np.int64),
            np.zeros(n, np.int64), np.zeros(spans + 1, np.int64), np.zeros(spans, np.int64), np.zeros(room, np.int64),
        )  # fmt: skip
        self.unfactored()

    @property
    def limp(self) -> bool:
        """Whether the cable is as soft as `press.LIMP` says."""
        return self.bend < press.LIMP * self.weight * self.length**2

    @property
    def smooth(self) -> Lying:
        """`lying` without friction."""
        return self.lying._replace(rough=np.zeros(self.elements + 1))

    @property
    def lying(self) -> Lying:
        """What the solver is told of the cable."""
        return Lying(
            self.held, self.held_mask, self.s, self.h, self.flex, self.thick, self.errors, self.start, self.q,
            self.near, self.on, self.ends, self._grips, self.turns, self.slid, self.frames, self.reach, self._pairs,
            self.rough, self.rubbing,
        )  # fmt: skip

    def insert(self, arcs: Array, shortest: float = LEAST_LENGTH) -> bool:
        """Adds nodes at these arc lengths; False if there is one at each already, or in an element shorter than this
        part of the length."""
        nodes: list[float] = self.nodes.tolist()
        for arc in arcs.tolist():
            j = min(max(bisect_left(nodes, arc), 1), len(nodes) - 1)
            h = nodes[j] - nodes[j - 1]
            if h < shortest * self.length:
                continue
            nodes.insert(j, min(max(arc, nodes[j - 1] + 0.2 * h), nodes[j] - 0.2 * h))
        if len(nodes) == self.elements + 1:
            return False
        self.lay_out(np.array(nodes))
        return True

    def ends_of_rows(self, shortest: float = LEAST_LENGTH) -> Array:
        """Arc lengths that `mesh.ends_of_rows` has for the last solution; shortest: as for `insert`."""
        least = shortest * self.length
        return mesh.ends_of_rows(self.nodes, self.q[NOW], self.near[NOW], self.on[NOW], least)

    def steep(self, least: float = mesh.TURN) -> Array:
        """Arc lengths in the middle of elements beside contacts that tension makes bend in less than their length."""
        pull = float(np.abs(self.ends[NOW]).max(initial=0.0))
        layer = 0.7 * math.sqrt(self.bend / pull) if pull > 0.0 else math.inf
        out = np.empty(self.elements)
        last = self.q[NOW], self.near[NOW], self.on[NOW]
        return out[: afterwards.steep(self.nodes, self.h, *last, layer, least, out)]

    def beside_contacts(self) -> Array:
        """Arc lengths in the middle of all elements less than two away from a contact of the last solution."""
        touched = np.convolve(self.on[NOW, :, 0] != BARE, np.ones(3), "same") > 0.0
        return np.asarray(0.5 * (self.nodes[1:] + self.nodes[:-1])[(touched[1:] | touched[:-1]) & (self.h > 0.0)])

    def too_coarse(self) -> Array:
        """Arc lengths in the middle of the elements that most of the error of the last solution comes from."""
        return mesh.worst(self.nodes, self.errors, self.h > 0.0)

    def tidy(self) -> bool:
        """Moves the nodes that contacts have run up to; whether there are any."""
        self.untidy = False
        least, last = LEAST_LENGTH * self.length, (self.q[NOW], self.near[NOW], self.on[NOW])
        nodes = mesh.tidied(self.nodes, self.h, *last, self.flex, self.stops, least)
        if nodes is not None:
            self.lay_out(nodes)
        return nodes is not None

    @property
    def askew(self) -> float:
        """Largest cosine of the angle between the cable and the push of a contact on an edge of a body."""
        cosines = [
            abs(float(np.dot(tangent_of(self.q[NOW], k), self.near[NOW, k, NORMAL : NORMAL + 3])))
            for k in np.flatnonzero(self.on[NOW, :, 0] != BARE)
            if sharpness(self.q[NOW], self.near[NOW], k) * self.thick[k] > EDGE
        ]
        return max(cosines, default=0.0)

    @property
    def off_edges(self) -> bool:
        """Whether `mesh.off_edges` says so of the last solution."""
        return mesh.off_edges(self.h, self.q[NOW], self.near[NOW], self.on[NOW], self.flex, self.bodies)

    def run(self) -> float:
        """Takes contacts of the last solution that have no neighbour to where the cable is nearest, with their nodes.

        Two at both sides of an edge become one before. Returns how far [m].
        """
        mesh.join_over_edges(self.nodes, self.q[NOW], self.near[NOW], self.on[NOW], self.thick, EDGE)
        q, near, on = self.q[NOW], self.near[NOW], self.on[NOW].copy()
        touches = self.on[NOW, :, 0] != BARE
        on[1:][touches[:-1]] = on[:-1][touches[1:]] = BARE
        before = self.s.copy()
        way = float(run.slide(self.lying, q, near, on, self.points, ROUND / self.length, False, False))
        near[self.s != before, SPOT : SPOT + 3] = 0.0  # where they are now is not known
        return way

    def thin(self) -> None:
        """If many nodes were added, takes away every other one that is far from where a row ends.

        Adds some where an eyelet has stretched the mesh, and where the cable is drawn around a body.
        """
        if self.elements < MOST_ELEMENTS:
            self.insert(self.steep(mesh.SOON))
        if self.rings.size and self.elements < MOST_ELEMENTS:
            self.insert(mesh.stretched(self.nodes, self.h > 0.0, self._spacing, self._middles))
        coarse = bool(self.info[16] > COARSE * self.length)
        full = self.elements > FULL * self._spacing.size
        if self.elements <= MANY * self._spacing.size or (coarse and not full):
            return
        if self.elements <= KEPT * self._spacing.size and self.near[NOW, :, RUB : RUB + 3].any():
            return  # what nodes carry along surfaces is best left to them
        nodes = mesh.thinned(
            self.nodes, self.near[NOW], self.on[NOW], self._spacing, self._middles, self.stops, full=full, coarse=coarse
        )
        if nodes is not None:
            self.lay_out(nodes)

    def even(self) -> bool:
        """Takes away nodes that nothing presses where elements are much shorter than they were first.

        Contacts that have run along the cable leave them; planes in front of them are too stiff for the cable beside.
        """
        free = (self.on[NOW, :, 0] == BARE) & ~np.isin(np.arange(self.nodes.size), self.held)
        nodes = mesh.evened(self.nodes, free, self._spacing, self._middles, self.stops)
        if nodes is not None:
            self.lay_out(nodes)
        return nodes is not None

    def forget(self) -> None:
        """The next solve starts from nothing."""
        self.history = 0
        self.touching = False
        self.patience.succeed()
        self.free = None
        if self.tight != 1.0:
            self.tighten(1.0)
        self._positions = _NOWHERE

    def unfactored(self) -> None:
        """The next solve starts without the factors at hand."""
        self.info[drive.AGE] = math.inf
        self.factored = False


def _same(a: Array, b: Array) -> bool:
    """Whether two vectors are the same one, or equal."""
    return a is b or bool(np.array_equal(a, b))


def _divided(problem: Problem) -> Problem:
    """The problem with a load of nothing where sections of its cable begin and end: nodes there stay there."""
    if not problem.cable.sections:
        return problem
    other, length = copy.copy(problem), problem.cable.length
    bounds = np.unique([x for a, b, _ in pieces_of(problem.cable) for x in (a, b)])
    at, force = problem.load_arc_length, problem.load_force
    near = np.concatenate(([0.0, length], at))
    bounds = bounds[np.abs(bounds[:, None] - near).min(axis=1) > _AT * length]
    order = np.argsort(np.concatenate((at, bounds)))
    other.load_arc_length = np.concatenate((at, bounds))[order]
    other.load_force = np.concatenate((force, np.zeros((bounds.size, 3))))[order]
    return other
