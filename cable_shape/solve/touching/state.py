"""What the solver of a cable in contact keeps from one solve to the next: bodies, mesh, the last two solutions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple, final

import numpy as np

from cable_shape.cable.cable import Cable
from cable_shape.checks import Array
from cable_shape.kernels.contact import check, drive, respond
from cable_shape.kernels.contact.friction import FAINT
from cable_shape.kernels.contact.near import (
    ACTIVE,
    APART,
    BARE,
    HELD,
    LINK,
    LINKED,
    MATE,
    PRESS,
    PUSH,
    PUSHED,
    RUB,
    SECOND,
    SECOND_PRESS,
    SPOT,
    THIRD,
    THIRD_PRESS,
    TOWARD,
)
from cable_shape.kernels.contact.pair_friction import PULLED, SLIPS, remember_pairs
from cable_shape.kernels.network import respond as network_respond
from cable_shape.kernels.network import tables
from cable_shape.kernels.network.gripping import FROM, FROM_FIRM, FROM_PULL, SLIPPED, TO, TO_FIRM, TO_PULL
from cable_shape.kernels.network.tables import BEFORE, NOW, TRIAL
from cable_shape.pose import FreeEnd, Grip
from cable_shape.shape import NOT_RUBBED, CableShape
from cable_shape.solve.mesh import interpolated
from cable_shape.solve.touching import mesh, resume
from cable_shape.solve.touching.laid import Chain, Laid, Pair


@final
class Kept(NamedTuple):
    """What `TouchState.copy` keeps."""

    arrays: list[Array]
    nodes: Array
    elements: int
    spacing: Array
    middles: Array
    tight: float


class TouchState(Laid):
    """The solver's memory for cables among bodies; `history` tells how many solutions there are to start from."""

    # -- solutions

    def start_from(self, shape: CableShape, frames: Array, finer: float = 1.0) -> None:
        """Makes a shape the last solution, on a new mesh; `frames` are those of its supports, clips or others.

        finer: of so many times as many elements as usual.
        """
        self.elements, self.stood = 0, False
        self.reach = np.array([pair.reach for pair in self.links])
        self._arcs[self.rings] = shape.supports[self.rings - 1, 0]
        self.slid[:, : self._arcs.size] = self._arcs - self._gap_of_supports
        self._hold_along(shape)
        nodes = np.concatenate([self._nodes_of(one, shape, finer) for one in self.chains])
        inside = self._within(nodes)
        self._spacing, self._middles = np.diff(nodes)[inside], (0.5 * (nodes[1:] + nodes[:-1]))[inside]
        rows = resume.pressed_rows(shape, self.bodies.names)
        nodes = resume.with_lone(nodes, rows)
        self.lay_out(nodes)
        self.q[NOW] = interpolated(nodes, shape.arc_length, shape.quaternions)
        self._grips[NOW] = frames
        self._align()
        resume.press_nodes(rows, nodes, self.held, self.near[NOW], self.on[NOW])
        if self.has_friction:
            resume.hold_nodes(nodes, self.s, shape, self.bodies.frames, self.near[NOW], self.on[NOW])
        for i, pair in enumerate(self.links):
            self._link(i, pair)
        if self.links:
            faint = FAINT * (self.weight + self.made[tables.SOFTEST])
            remember_pairs(self.lying, NOW, faint, self.made[tables.LENGTH])
        j = 0
        for chain in self.chains:
            arcs = self._arcs[chain.supports]
            for arc in arcs[1:]:
                side = "right" if arc == arcs[-1] else "left"
                before = int(np.searchsorted(shape.arc_length, arc, side)) - 1  # type: ignore[call-overload]
                self.ends[NOW, j] = shape.force[max(before, 0)]
                j += 1
        self.turns[NOW] = shape.turns
        self.history = 1
        for array in self._solutions:
            array[BEFORE] = array[NOW]

    @property
    def ring_rows(self) -> list[int]:
        """Which of the clips of a shape the eyelets are."""
        return [int(ring) - 1 for ring in self.rings]

    @property
    def eyelets(self) -> Array:
        """(3, e, GRIP): what friction in the eyelets remembers, see `kernels.network.gripping`."""
        return self.slid[:, self._arcs.size :].reshape(3, self.rings.size, tables.GRIP)

    def _hold_along(self, shape: CableShape) -> None:
        """Has the friction of eyelets count from this shape on."""
        grips = self.eyelets
        grips[:] = 0.0
        if len(shape.rubbed) and self.rings.size:
            rubbed = shape.rubbed[self.ring_rows]
            grips[:, :, TO] = self.slid[:, self.rings]
            grips[:, :, TO_PULL], grips[:, :, SLIPPED] = rubbed.T
            grips[:, :, TO_FIRM] = self.cable.neutral / self.length

    def told_friction(self, clips: int) -> tuple[Array, bool]:
        """See `Network.told_friction`."""
        rough = self.cable.has_friction
        if not (rough and self.problem.rubs):
            return NOT_RUBBED, rough
        out, grips = np.zeros((clips, 2)), self.eyelets[NOW]
        out[self.ring_rows] = grips[:, [TO_PULL, SLIPPED]]
        return out, bool((grips[self.cable.rough > 0.0, FROM_FIRM] <= 0.0).any())

    def forget_friction(self) -> None:
        """See `Network.forget_friction`."""
        self.eyelets[NOW][:, [FROM_FIRM, TO_FIRM]] = 0.0

    def count_again(self) -> None:
        """Has the friction of eyelets count from where the last solution counts from: it is to be solved again."""
        grips = self.eyelets[NOW]
        grips[:, TO : TO + 3] = grips[:, FROM : FROM + 3]

    def _link(self, i: int, pair: Pair) -> None:
        """Tells the last solution of a pair."""
        way = pair.places[0] - pair.places[1]
        size = float(np.linalg.norm(way))
        for side, arc in enumerate(pair.arcs):
            k = int(np.abs(self.nodes - arc).argmin())
            self.on[NOW, k, LINK] = 2 * i + side
            self.on[NOW, k, LINKED] = ACTIVE if pair.push > 0.0 else BARE
            self.near[NOW, k, TOWARD : TOWARD + 3] = (1.0 - 2.0 * side) / size * way
            self.near[NOW, k, APART], self.near[NOW, k, PUSH] = size, max(pair.push, 0.0)
        self.rubbing[NOW, i, PULLED : PULLED + 3], self.rubbing[NOW, i, SLIPS] = pair.pull, pair.slips

    def _linked(self, i: int, side: int) -> int:
        """The node of a pair on its first or second cable."""
        return int(np.flatnonzero(self.on[NOW, :, LINK] == 2 * i + side)[0])

    def toward(self) -> Array:
        """(l, 3), unit, out of the second cable of each pair in the last solution."""
        first = [self._linked(i, 0) for i in range(len(self.links))]
        return self.near[NOW, first, TOWARD : TOWARD + 3].copy()

    def pairs(self) -> list[Pair]:
        """The pairs of the last solution."""
        out = []
        for i, reach in enumerate(self.reach.tolist()):
            k = [self._linked(i, side) for side in range(2)]
            active = self.on[NOW, k[0], LINKED] == ACTIVE
            push = float(self.near[NOW, k[0], PUSHED]) if active else 0.0
            pull, slips = self.rubbing[NOW, i, PULLED : PULLED + 3].copy(), bool(self.rubbing[NOW, i, SLIPS])
            places = self.near[NOW, k, SPOT : SPOT + 3].copy()
            out.append(Pair(self.nodes[k], reach, push, places, pull=pull, slips=slips))
        return out

    def _align(self) -> None:
        """Signs of the quaternions of what is given, those of the nodes there; what is free takes theirs, what is held
        theirs.

        How a shape is turned in a clip, where it bends otherwise than beside it, its points on both sides do not tell.
        """
        for knot, k, free in zip(self._knots, self.held, self.held_mask, strict=True):
            if self._moves[knot]:
                continue
            if self._grips[NOW, knot, 3:] @ self.q[NOW, k] < 0.0:
                self._grips[NOW, knot, 3:] *= -1.0
            if not free.any():
                self.q[NOW, k] = self._grips[NOW, knot, 3:]
        for chain in self.chains:
            for support, loose in zip((chain.supports.start, chain.supports.stop - 1), chain.free, strict=True):
                if loose:
                    self._grips[NOW, self._knots[support], 3:] = self.q[NOW, self.held[support]]

    def _nodes_of(self, chain: Chain, shape: CableShape, finer: float) -> Array:
        """A cable's nodes at first."""
        arcs, elements = self._arcs[chain.supports], self._count_of(chain)
        return mesh.first_nodes(arcs, self.stops, chain.bend, chain.free, shape, elements, finer)

    def _count_of(self, chain: Chain) -> int:
        """Elements that a cable has at first."""
        return self._count

    def resume(self, shape: CableShape, frames: Array, finer: float = 1.0) -> None:
        """Makes an equilibrium that another solver has found the last one, in contact or not; finer: of its mesh."""
        self.unfactored()
        if len(resume.pressed_rows(self.whole(shape), self.bodies.names)):
            self.lie(shape, frames, finer)
        else:
            self.rest(shape, frames)

    def lie(self, shape: CableShape, frames: Array, finer: float = 1.0) -> None:
        """Makes it the last one as one in contact, which is followed among the bodies wherever it goes."""
        self.start_from(shape, frames, finer)
        self.touching = True
        self.remember(self.seen(shape))

    def take_over(self, other: TouchState, shape: CableShape) -> bool:
        """Makes the last solution of another memory, of a cable held alike, the last one, mesh, friction and all.

        False, and nothing has changed, where that solution is not this shape, or where what it knows of supports and
        bodies is of others.
        """
        if not (other.touching and other.history and other.tight == 1.0) or self.rings.size or self.links:
            return False
        alike = (self.length, self._kinds, self.gaps.size) == (other.length, other._kinds, other.gaps.size)
        pairs = ((self._arcs, other._arcs), (self._stops, other._stops), (other.positions, self.seen(shape)))
        if not (alike and all(np.array_equal(a, b) for a, b in pairs)):
            return False
        pressed = np.union1d(other.on[:2, :, [0, 1, SECOND, THIRD]], other.near[:2, :, MATE] - 1.0).astype(int)
        names, then = self.bodies.names, other.bodies.names
        if any(k >= len(names) or names[k] != then[k] for k in pressed[pressed >= 0]):
            return False
        self.layer = other.layer
        self.restore(other._now())
        self.touching, self.history = True, 1
        self.remember(self.seen(shape))
        return True

    def slide_to(self, arcs: Array) -> None:
        """Makes supports hold the cable at other arc lengths: the nodes between them and masses are spread anew."""
        nodes = np.interp(self.nodes, *mesh.spread(self._arcs, arcs, self.points))
        for at in self.points:
            nodes[np.abs(nodes - at).argmin()] = at
        nodes[self.held] = arcs
        self._arcs = arcs.copy()
        self._stops = np.union1d(self.points, arcs[1:-1])
        self.unfactored()
        self._load(nodes)

    def buried(self, frames: Array, deepest: float) -> tuple[int, int, float]:
        """Which support is deeper in which body, and the gap, as `check.buried` has it."""
        held = len(frames) - (type(self.problem.end) is not Grip)
        return self.deep(self.chains[0], frames[:held], self.arcs[:held], self.problem.cable.length, deepest)

    def deep(self, chain: Chain, frames: Array, arcs: Array, length: float, deepest: float) -> tuple[int, int, float]:
        """The first of supports (k, 7) of a chain at arc lengths (k,) [m], as `check.buried` has it."""
        bodies = self.bodies
        if len(chain.pieces) == 1:
            found: tuple[int, int, float] = check.buried(
                frames, arcs, len(arcs), deepest, length, bodies.table, bodies.frames, bodies.triangles, bodies.tree,
                chain.radius, bodies.stack,
            )  # fmt: skip
            return found
        radii = chain.along(arcs)[:, 1]
        places = [(radii == radius, float(radius)) for radius in np.unique(radii)]
        for which, radius in places:
            here = np.arange(arcs.size)[which]
            i, body, gap = check.buried(
                frames[here], arcs[here], here.size, deepest, length, bodies.table, bodies.frames, bodies.triangles,
                bodies.tree, radius, bodies.stack,
            )  # fmt: skip
            if i >= 0:
                return int(here[i]), body, gap
        return -1, -1, 0.0

    def rest(self, shape: CableShape, frames: Array) -> None:
        """Makes a shape without contacts the last one; `frames` are those of its supports."""
        self.touching = self.stood = False
        self.patience.succeed()
        self.free, self.free_frames = shape, frames
        self.remember(self.seen(shape))

    def touches(self) -> Array:
        """(k, TOUCH), the contacts of the last solution as `check.touches` has them."""
        out = np.empty((3 * self.elements, check.TOUCH))
        return out[: check.touches(self.nodes, self.near[NOW], self.on[NOW], self.thick, out)]

    def copy(self, *, then: bool = False) -> Kept:
        """All that a solve changes; `then`: with the mesh from before the last step."""
        now = self._now(then=then)
        return now._replace(arrays=[a.copy() for a in now.arrays])

    @property
    def _solutions(self) -> tuple[Array, ...]:
        """What is kept of three solutions, of each array the rows NOW, BEFORE and TRIAL."""
        return self.q, self.near, self.on, self.ends, self._grips, self.turns, self.rubbing, self.slid

    def _now(self, *, then: bool = False) -> Kept:
        """The same as long as nothing changes it."""
        nodes = (self.s_then if then else self.s) + (self._gap_of_nodes if self.gaps.size > 1 else 0.0)
        return Kept(list(self._solutions), nodes, self.elements, self._spacing, self._middles, self.tight)

    def restore(self, kept: Kept) -> None:
        """Puts back a `copy`, which stays as it is."""
        arrays, nodes, elements, self._spacing, self._middles, tight = kept
        if self.tight != tight:
            self.tighten(tight)
        if self.elements != elements or self.rings.size:
            self._arcs[self.rings] = (arrays[-1][NOW, : self._arcs.size] + self._gap_of_supports)[self.rings]
            self.elements = 0
            self.lay_out(nodes.copy())
        self.q, self.near, self.on, self.ends, self._grips, self.turns, self.rubbing, self.slid = (
            a.copy() for a in arrays
        )
        self._put(nodes)
        self.unfactored()
        self.untidy = True

    def accept(self, *, again: bool = False) -> None:
        """Makes the trial the last solution; `again`: it is the same one, solved again."""
        drive.accept(self.lying, again)

    # -- answers

    @property
    def ints(self) -> Any:
        """The network's plan; the next four are its arrays, too."""
        return self.net.ints

    @property
    def floats(self) -> Array:
        return self.net.floats

    @property
    def sols(self) -> Array:
        return self.net.sols

    @property
    def work(self) -> Array:
        return self.net.space

    @property
    def network_nodes(self) -> int:
        """How many nodes the network has, with those of contacts."""
        return int(self.ints[tables.N_ELEMENTS] + self.ints[tables.N_SPANS])

    def refresh(self) -> None:
        """Factors the matrix of the last solution, for `kernels.network.respond`, unless that is done."""
        if not self.factored:
            drive.refresh(self.lying, self.net)
            self.unfactored()
            self.factored = True

    @property
    def sampled(self) -> int:
        """How many points a shape has."""
        return self.problem.points * self.gaps.size

    def knots_of(self, supports: Sequence[int]) -> Array:
        """Which knots these supports are."""
        return np.array(supports, dtype=np.int64)

    def pulls(self, points: int = 0) -> tuple[Array, Array, Array]:
        """F . d3 of the eyelets (e,) [N], its derivative in the arc lengths there (e, e), and that of the positions
        (points, 3, e). Needs `refresh`."""
        net, e = self.net, self.rings.size
        f, J, out = np.empty(e), np.empty((e, e)), np.empty((points * self.gaps.size, 3, e))
        jumps = np.empty((int(net.ints[tables.N_SPANS]), 3))
        network_respond.eyelets(net.ints, net.floats, net.sols, net.space, f, J, points, out, jumps)
        return f, J, out

    def models_beside(self, cables: Sequence[Cable], kept: dict[bytes, Array] | None = None) -> Array:
        """(c, size): models of other cables held in the same way, on the mesh as it is."""
        self.cable.arcs = self.arcs
        made, before, after = self.cable.beside(cables, kept)
        for model in made:
            self.let_stretch(model[self.cable.parts.piece])
        models: Array = respond.neighbours(self.net, self.s, made, before, after)
        return models

    def body_columns(self, name: str) -> tuple[Array, Array]:
        """(points, 3, 6), (e, 6): how positions and the eyelets' pulls change as a body moves. Needs no `refresh`."""
        points, bodies = self.problem.points, self.bodies
        out, df = np.zeros((self.sampled, 3, 6)), np.zeros((self.rings.size, 6))
        for at in bodies.rows_of(name):
            self.refresh()
            own, pulls = np.zeros_like(out), np.zeros_like(df)
            respond.body_columns(
                self.net, self.q[NOW], self.near[NOW], self.on[NOW], at, bodies.frames[at, 3:], points, own, pulls
            )
            out, df = out + own, df + pulls
        return out, df

    def put_aside(self, *, then: bool = False) -> tuple[Any, ...]:
        """The last solution and how the cable and the bodies were then, for `put_back`; `then`: as for `copy`."""
        bodies = self.bodies
        was = bodies.frames_then, bodies.links_then
        return self.copy(then=then), self.history, self.touching, self.free, self.free_frames, self._positions, was

    def put_back(self, aside: tuple[Any, ...]) -> None:
        """Makes what was put aside the last solution again."""
        kept, self.history, self.touching, self.free, self.free_frames, self._positions, was = aside
        self.restore(kept)
        self.bodies.frames_then, self.bodies.links_then = was

    @property
    def pull(self) -> float:
        """The last solution's largest force, in weight and stiffness of the cable."""
        return float(np.abs(self.ends[NOW]).max(initial=0.0)) / self.usual_pull

    def pull_less(self, less: float) -> None:
        """Divides the last solution's forces, as of a cable that gives so much more."""
        self.ends[NOW] /= less
        for column in (PRESS, SECOND_PRESS, THIRD_PRESS, *range(RUB, RUB + 3), *range(HELD, HELD + 3)):
            self.near[NOW, :, column] /= less
        self.eyelets[NOW][:, [FROM_PULL, TO_PULL]] /= less

    def put_nodes_back(self) -> None:
        """Puts the nodes where they were before the last step."""
        if not np.array_equal(self.s, self.s_then):
            self.s[:], self.h[:] = self.s_then, np.diff(self.s_then)
            self.h[self._gaps_at] = 0.0
        self.unfactored()

    def came_from(self, kept: Kept) -> None:
        """Makes the last solution of a `copy` the one before the last, if they have the same elements."""
        if self.elements == kept.elements:
            for array, other in zip(self._solutions, kept.arrays, strict=True):
                array[BEFORE] = other[NOW]

    @property
    def positions(self) -> Array:
        """(n, 3), the last solution's; (0, 3) if there is none."""
        return self._positions

    def seen(self, shape: CableShape) -> Array:
        """(c n, 3) [m], positions of a shape, one cable after the other."""
        return shape.positions

    def whole(self, shape: CableShape) -> CableShape:
        """A shape as that of one long cable, gaps between what is joined in it."""
        return shape

    @property
    def _gap_of_supports(self) -> Array:
        """(b+1,) [m], of their cables."""
        return np.repeat(self.gaps, [chain.supports.stop - chain.supports.start for chain in self.chains])

    def new_buffer(self) -> Array:
        """Room for a shape."""
        return CableShape.new_buffer(self.problem.points)

    @property
    def clip_knots(self) -> Any:
        """Which knots the clips are."""
        return np.arange(1, self._arcs.size - 1)

    def remember(self, positions: Array) -> None:
        """Takes a solution's positions (n, 3) as those from which the cable moves on, and where the bodies are."""
        self._positions = positions.copy()
        self.bodies.remember()

    def energy_of_masses(self) -> float:
        """[J], potential energy of point masses and of a plug in the last solution."""
        problem, energy = self.problem, 0.0
        if not problem.masses and (type(problem.end) is Grip or problem.end.mass == 0.0):
            return 0.0
        spots = self.near[NOW, :, SPOT : SPOT + 3]
        for mass in problem.masses:
            energy -= mass.mass * float(problem.gravity @ spots[np.abs(self.nodes - mass.arc_length).argmin()])
        if isinstance(problem.end, FreeEnd):
            energy -= problem.end.mass * float(problem.gravity @ spots[-1])
        return energy

    @property
    def grips(self) -> Array:
        """(3, b+1, 7): frames of the supports of the solution now, the one before and the trial."""
        return self._grips

    @property
    def ends_then(self) -> Array:
        """(2, 7), frames of the first and the last support in the last solution."""
        return self._grips[NOW, [0, -1]]

    def target(self, frames: Array) -> None:
        """Makes `frames` (b+1, 7) those of the trial."""
        self._grips[TRIAL] = frames
