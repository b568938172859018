"""The bodies that a swinging cable may touch: :class:`Among`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any, NamedTuple, final

import numpy as np

from cable_shape.cable.cable import Cable
from cable_shape.cable.pieces import cable_at, widest
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.kernels.contact import swung, swung_look, swung_touches
from cable_shape.kernels.contact.check import TOUCH
from cable_shape.kernels.contact.points import HELD, INSIDE, RING
from cable_shape.kernels.contact.tables import Bodies, Skin
from cable_shape.kernels.network.momentum import Momentum
from cable_shape.kernels.network.motion import N_PROPS, PROPS
from cable_shape.kernels.network.props import DRY, ELEMENT, HOLDER, PAIRED, PUSH, SHARE
from cable_shape.kernels.network.settle import LARGEST_TURN
from cable_shape.kernels.network.tables import NOW
from cable_shape.kernels.network.walls import KEPT, PUSHED, STIFF, WALL, WALLS
from cable_shape.motion.meeting import may_touch
from cable_shape.pose import Pose
from cable_shape.scene.scene import Scene
from cable_shape.shape import CableShape
from cable_shape.solve.harness_problem import HarnessProblem
from cable_shape.solve.mesh import interpolated
from cable_shape.solve.plan import Whole
from cable_shape.solve.problem import Problem
from cable_shape.solve.settle import Settling
from cable_shape.solve.touching.bodies import TouchBodies
from cable_shape.solve.touching.harness_state import Laid
from cable_shape.solve.touching.told import ITSELF
from cable_shape.solve.touching.touching import BURIED

#: [m] bodies nearer than this to a node have a plane there while it comes to rest, and stiffness of the planes, in that
#: of the elements beside them against bending, EI / h^3.
_REACH, _FIRM = 0.05, 100.0
#: Steps in time to rest, in units of `Settling.unit`: the first, the longest, the shortest; how many there may be.
_FIRST, _LONGEST, _SHORTEST, _MOST = 1e-2, 30.0, 1e-9, 300
_LONGER, _SHORTER = 4.0, 0.2
#: The longest step where longer ones go round in circles: pairs are found anew in each.
_SHORT = 0.02
#: What drag may still take, of the largest force, and how far [m] nodes may be from planes that press them, at rest.
_AT_REST, _CLOSED = 1e-7, 1e-7
_NO_GAP: Array = np.zeros(1)


class Lying(NamedTuple):
    """Cables as they are as one long one, `gaps` (c,) [m] added to the arc lengths of each; all have as many points."""

    arc_length: Array  # (n,) [m]
    positions: Array  # (n, 3) [m]
    quaternions: Array  # (n, 4)
    force: Array  # (n, 3) [N]
    gaps: Array
    velocity: Array | None  # (n, 3) [m/s]; None: at rest

    @classmethod
    def of(cls, shape: CableShape | Laid, gaps: Array = _NO_GAP, velocity: Array | None = None) -> Lying:
        """That of a shape; velocity of as many of its points as have some, from the first on."""
        rates = None
        if velocity is not None:
            rates = np.zeros_like(shape.positions)
            rates[: len(velocity)] = velocity
        return cls(shape.arc_length, shape.positions, shape.quaternions, shape.force, gaps, rates)

    def moving(self, s: Array) -> tuple[Array, Array]:
        """(k, 3) [m/s], (k, 3) [1/s]: velocity and its slope at arc lengths s (k,) [m], the gaps with them."""
        rate, slope = np.zeros((s.size, 3)), np.zeros((s.size, 3))
        if self.velocity is not None:
            own = self.gaps.size, -1
            arcs, there = self.arc_length.reshape(own), self.velocity.reshape(*own, 3)
            slopes = [np.gradient(v, x, axis=0) for x, v in zip(arcs, there, strict=True)]
            _along(self.velocity, self.arc_length, s, rate)
            _along(np.concatenate(slopes), self.arc_length, s, slope)
        return rate, slope


@final
class Among:
    """Bodies, and what the nodes of one network are to them.

    cables: of the network; None: one that knows no bodies. eyelets: the numbers of those among the clips, and of
    the cable that runs through each. supports (k, 7): what holds the clips at rest, see `CableShape`. names: of cables
    that may touch each other.
    """

    def __init__(
        self, problem: Problem | HarnessProblem, cables: Sequence[Cable | None], eyelets: Sequence[tuple[int, int]],
        supports: Array, settling: Settling, remembered: Array, names: Sequence[str] = (),
    ) -> None:  # fmt: skip
        self.bodies, self._cables = TouchBodies(), tuple(names)
        self._eyelets = [number for number, _ in eyelets]
        rings = np.zeros((len(eyelets), RING))
        if eyelets:
            rings[:, :3], rings[:, 3] = problem.clip_frames[self._eyelets, :3], [cable for _, cable in eyelets]
            rings[:, 4], rings[:, 5:8] = supports[self._eyelets, 0], -supports[self._eyelets, 1:4]
        thickest = 0.5 * max(widest(cable) for cable in cables if cable is not None)
        self.bodies.take(problem.bodies, problem.gripping, problem.links, thickest, problem.carried)
        self._plan, self._s = settling.plan, settling.model.s
        n, plan, h = settling.model.s.size, settling.plan, settling.model.h
        thick, whole, rough, bend, around = -np.ones(n), np.zeros(n), np.zeros(n), np.zeros(n), np.ones(n)
        for c, cable in enumerate(cables):
            for j in range(plan.cables[c], plan.cables[c + 1]):
                a, b = plan.first[j], plan.first[j + 1]
                own = slice(a + j, b + j + 1)
                around[own] = 0.5 * (h[[*range(a, b), b - 1]] + h[[a, *range(a, b)]])
                if cable is None:
                    continue
                parts = [cable_at(cable, x) for x in settling.model.s[own].tolist()]
                thick[own], rough[own] = [0.5 * part.diameter for part in parts], [part.friction for part in parts]
                whole[own], bend[own] = cable.length, cable.mean_bending_stiffness
        self.skin = Skin(
            thick, whole, rough, _knots(settling, thick), np.empty(n),
            np.empty(settling.sols.size + remembered.size + settling.moving.size), self.bodies.moved_links.copy(),
            rings, rings[:, :3].copy(), np.zeros((1 + swung.LOG, 3)), self.bodies.moved_links.copy(), rings.copy(),
            may_touch(problem),
        )  # fmt: skip
        for node in np.flatnonzero(self.skin.knot >= 0):
            beside = _nodes_in(settling, self.skin.knot[node])
            rough[node], bend[node], around[node] = rough[beside].max(), bend[beside].max(), around[beside].min()
        self._stiff = _FIRM * bend / np.maximum(around, 0.25 * h.mean()) ** 3
        self._out = np.empty((4 * n, TOUCH))

    @property
    def names(self) -> tuple[str, ...]:
        """Of what the cables may touch, themselves last."""
        return (*self.bodies.names, *self._cables, ITSELF) if len(self.skin.touching) else self.bodies.names

    @property
    def met(self) -> bool:
        """Whether cables have pressed on each other, or on themselves, in the last step."""
        return bool(self.skin.log[0, swung.MET])

    @property
    def kernel(self) -> Bodies:
        """As compiled code takes them."""
        return self.bodies.kernel

    @property
    def state(self) -> list[Array]:
        """What a step changes."""
        return [self.skin.links, self.skin.rings, self.skin.goals, self.bodies.frames]

    def move(self, links: Mapping[str, Pose] | None, clips: Array) -> None:
        """Puts bodies on links and eyelets where those are at the end of the next step.

        clips (k, 7): where the scene's clips are then.
        """
        if links is not None and len(self.skin.links):
            self.bodies.move(self.bodies.link_rows(links))
        self.skin.goals[...] = clips[self._eyelets, :3]

    def buried(self, poses: Array) -> tuple[int, float, str] | None:
        """Which of the knots that are held is inside which body when they have come to `poses` (k, 7), and the gap [m];
        after `move`. The words of it are those of :func:`cable_shape.solve.touching.touching.inside`."""
        plan, thick = self._plan, self.skin.thick
        for j, end in np.ndindex(plan.ends.shape):
            knot, node = plan.ends[j, end], plan.first[j + end] + j
            if self.skin.knot[node] != HELD or thick[node] < 0.0 or plan.vertices[knot, 1] >= 0:
                continue
            i, body, gap = swung.buried_then(
                poses[knot : knot + 1],
                self._s[node : node + 1],
                BURIED,
                self.skin.whole[node],
                thick[node],
                self.kernel,
            )
            if i >= 0:
                return int(knot), float(gap), self.bodies.names[body]
        return None

    def tell_eyelets(self, supports: Array) -> None:
        """Fills in the rows of eyelets among (k, 7): arc length [m] and force [N] on it."""
        supports[self._eyelets, 0], supports[self._eyelets, 1:4] = self.skin.rings[:, 4], -self.skin.rings[:, 5:8]

    def touches(self, ints: Whole, floats: Array, moving: Array, remembered: Array, cable: int) -> Array:
        """(k, TOUCH), the contacts of a cable in the last step, in ascending arc length."""
        count = swung_touches.touches(ints, floats, moving, remembered, self.skin.thick, cable, self._out)
        found = self._out[:count].copy()
        others = found[:, 1] >= swung_touches.OTHERS
        to = found[others, 1] - swung_touches.OTHERS
        found[others, 1] = len(self.bodies.names) + np.where(to == cable, len(self._cables), to)
        return found[np.argsort(found[:, 0], kind="stable")]

    def rest(self, settling: Settling, memory: Momentum, remembered: Array, lying: Lying) -> bool:
        """Lays the network where it lies at rest among the bodies, and lets it come to rest there on its mesh.

        If it does not in minding itself, as if it did not.
        """
        for longest in (_LONGEST, _SHORT) if len(self.skin.touching) else (_LONGEST,):
            if self._rest(settling, memory, remembered, lying, self.skin, longest):
                return True
        alone = self.skin._replace(touching=self.skin.touching[:0])
        return len(self.skin.touching) > 0 and self._rest(settling, memory, remembered, lying, alone)

    def _rest(
        self, settling: Settling, memory: Momentum, remembered: Array, lying: Lying, skin: Skin,
        most: float = _LONGEST,
    ) -> bool:  # fmt: skip
        """The same with what may be touched, in steps of at most so many units."""
        lay(settling, lying)
        motion, dt, far = settling.motion, _FIRST * settling.unit, LARGEST_TURN
        for _ in range(_MOST):
            state = settling.sols, motion.walls, motion.props, motion.kept, motion.origin
            kept = [array.copy() for array in state]
            memory.place[...], memory.tangent[...] = motion.origin, _tangents(settling.solution(NOW).q)
            clear = swung_look.look_at_rest(
                settling.ints, settling.floats, settling.moving, remembered, _REACH, self._stiff, self.kernel, skin
            )
            if settling.step(dt, far):
                way = float(np.linalg.norm(motion.origin - kept[4], axis=1).max())
                if way <= clear:
                    self._note_rings(settling)
                    if settling.at_rest(_AT_REST) and self._gap(motion.walls) < _CLOSED:
                        pairs = motion.props[: int(motion.par[N_PROPS])]
                        met = (pairs[:, HOLDER] == PAIRED) & (pairs[:, PUSH] > 0.0)
                        self.skin.log[0, swung.MET] = met.any()
                        return True
                    dt = min(_LONGER * dt, most * settling.unit)
                    continue
            for array, old in zip(state, kept, strict=True):
                array[...] = old
            dt *= _SHORTER
            if dt < _SHORTEST * settling.unit:
                if far == np.inf:
                    break
                dt, far = _FIRST * settling.unit, np.inf  # frames between few points may be far from where they belong
        return False

    def _note_rings(self, settling: Settling) -> None:
        """Remembers where on the cable eyelets are, and what they hold it by."""
        motion, model = settling.motion, settling.model
        for row in motion.props[: int(motion.par[N_PROPS])]:
            if row[HOLDER] < 0.0:
                ring, e = self.skin.rings[-1 - int(row[HOLDER])], int(row[ELEMENT])
                ring[4], ring[5:8] = model.s[settling.plan.left[e]] + row[SHARE] * model.h[e], row[DRY : DRY + 3]

    @staticmethod
    def _gap(walls: Array) -> float:
        """[m], how far nodes are at most from planes that press them."""
        rows = walls[:, 1:].reshape(-1, WALLS, WALL)[np.arange(WALLS) < walls[:, :1]]
        rows = rows[rows[:, PUSHED] > 0.0]
        return float(np.abs((rows[:, PUSHED] - rows[:, KEPT]) / rows[:, STIFF]).max(initial=0.0))


def without_eyelets(scene: Scene | None) -> Scene | None:
    """The same scene without what cables run through: that is no support of a network that swings.

    Raises
    ------
    ArgumentError
        If there are more than a motion has room for, or one has friction, or draws the cable in.
    """
    if scene is None:
        return scene
    for clip in scene.clips:
        for key, value in (("friction", clip.friction), ("retraction", clip.retraction)):
            if value != 0.0:
                bound = (
                    f"eyelets {'hold' if key == 'friction' else 'draw'} a cable along it at rest only, not as it swings"
                )
                raise ArgumentError.of(f"Clip.{key}", value, bound, "Leave it out, or predict shapes at rest.")
    held = [clip for clip in scene.clips if clip.kind != "slide"]
    count = len(scene.clips) - len(held)
    if count > PROPS:
        raise ArgumentError.of("clips", count, f"a motion knows {PROPS} eyelets at most", "Make some 'ball' clips.")
    return replace(scene, clips=held) if count else scene


def _nodes_in(settling: Settling, knot: int) -> list[int]:
    """The nodes in a knot."""
    first = settling.plan.first
    return [int(first[j + end]) + int(j) for j, end in np.argwhere(settling.plan.ends == knot)]


def _knots(settling: Settling, thick: Array) -> Any:
    """(n,): what a node stands for, see `Skin`: the thickest in a knot that moves for that."""
    plan, found = settling.plan, np.full(thick.size, INSIDE)
    for j, (a, b) in enumerate(pairwise(plan.first.tolist())):
        found[a + j] = HELD
        if not settling.motion.loose[b + j]:
            found[b + j] = HELD
    for knot, (_, moves) in enumerate(plan.vertices.tolist()):
        if moves >= 0:
            node = max(_nodes_in(settling, knot), key=thick.__getitem__)
            if thick[node] >= 0.0:
                found[node] = knot
    return found


def lay(settling: Settling, lying: Lying) -> Array:
    """Makes it the network's last solution; returns the arc lengths (n,) [m] of the nodes, the gaps with them."""
    now, motion, model, plan = settling.solution(NOW), settling.motion, settling.model, settling.plan
    counts = [plan.first[b] - plan.first[a] for a, b in pairwise(plan.cables.tolist())]
    more = np.repeat(lying.gaps, np.array(counts) + np.diff(plan.cables))
    q, s = interpolated(model.s + more, lying.arc_length, lying.quaternions), model.s + more
    for a, b in pairwise(plan.cables.tolist()):
        own = slice(plan.first[a] + a, plan.first[b] + b)
        if q[own.start] @ now.q[own.start] < 0.0:
            q[own] *= -1.0
    now.q[...] = q
    for j, end in np.argwhere(plan.tied == 0):
        knot, node = plan.ends[j, end], plan.first[j + end] + j
        if now.pose[knot, 3:] @ q[node] < 0.0:
            now.pose[knot, 3:] *= -1.0
    _along(lying.positions, lying.arc_length, s, motion.origin)
    motion.place[...] = motion.origin
    ends = plan.first[1:] - 1
    middles = s[plan.left] + 0.5 * model.h
    force = np.empty((middles.size, 3))
    _along(lying.force, lying.arc_length, middles, force)
    motion.kept[...] = force - motion.load[:, 3:6]
    now.lam[...] = motion.kept[ends]
    size = settling.sols.size // 3
    settling.sols[size : 2 * size] = settling.sols[2 * size :] = settling.sols[:size]
    return np.asarray(s)


def _along(rows: Array, at: Array, s: Array, out: Array) -> None:
    """Rows (n, 3) at arc lengths s."""
    for c in range(3):
        out[:, c] = np.interp(s, at, rows[:, c])


def _tangents(q: Array) -> Array:
    """(n, 3), d3 of frames (n, 4)."""
    x, y, z, w = q.T
    return np.stack((2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)), axis=1)
