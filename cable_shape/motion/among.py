"""The bodies that a swinging cable may touch: :class:`Among`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import final

import numpy as np

from cable_shape.cable.pieces import cable_at
from cable_shape.checks import Array
from cable_shape.kernels.contact import swung
from cable_shape.kernels.contact.check import TOUCH
from cable_shape.kernels.contact.points import RING
from cable_shape.kernels.contact.tables import Bodies
from cable_shape.kernels.network.momentum import Momentum
from cable_shape.kernels.network.motion import N_PROPS
from cable_shape.kernels.network.props import DRY, ELEMENT, HOLDER, SHARE
from cable_shape.kernels.network.tables import NOW
from cable_shape.kernels.network.walls import KEPT, PUSHED, STIFF, WALL, WALLS
from cable_shape.pose import Pose
from cable_shape.shape import CableShape
from cable_shape.solve.mesh import interpolated
from cable_shape.solve.plan import Whole
from cable_shape.solve.problem import Problem
from cable_shape.solve.settle import Settling
from cable_shape.solve.touching.bodies import TouchBodies

#: [m] bodies nearer than this to a node have a plane there while it comes to rest, and stiffness of the planes, in that
#: of the elements beside them against bending, EI / h^3.
_REACH, _FIRM = 0.05, 100.0
#: Steps in time to rest, in units of `Settling.unit`: the first, the longest, the shortest; how many there may be.
_FIRST, _LONGEST, _SHORTEST, _MOST = 1e-2, 30.0, 1e-9, 300
_LONGER, _SHORTER = 4.0, 0.2
#: What drag may still take, of the largest force, and how far [m] nodes may be from planes that press them, at rest.
_AT_REST, _CLOSED = 1e-7, 1e-7


@final
class Among:
    """Bodies, and what the nodes of one network are to them."""

    def __init__(self, problem: Problem, settling: Settling, remembered: Array) -> None:
        self.bodies = TouchBodies()
        cable = problem.cable
        self.bodies.take(problem.bodies, problem.gripping, problem.links, 0.5 * cable.diameter, problem.carried)
        s = settling.model.s
        parts = [cable_at(cable, x) for x in s.tolist()]
        self.skin = swung.Skin(
            np.array([0.5 * part.diameter for part in parts]),
            np.full(s.size, cable.length),
            np.array([part.friction for part in parts]),
            np.empty(s.size),
            np.empty(settling.sols.size + remembered.size + settling.moving.size),
            self.bodies.moved_links.copy(),
            _rings(problem),
        )
        around = np.gradient(s) if s.size > 1 else np.ones(1)
        self._stiff = _FIRM * cable.mean_bending_stiffness / np.maximum(around, 0.25 * around.mean()) ** 3
        self._out = np.empty((4 * s.size, TOUCH))

    @property
    def kernel(self) -> Bodies:
        """As compiled code takes them."""
        return self.bodies.kernel

    @property
    def state(self) -> list[Array]:
        """What a step changes."""
        return [self.skin.links, self.skin.rings, self.bodies.frames]

    def move(self, links: Mapping[str, Pose] | None) -> None:
        """Puts bodies on links where those are at the end of the next step; without links they stay."""
        if links is not None and len(self.skin.links):
            self.bodies.move(self.bodies.link_rows(links))

    def touches(self, ints: Whole, floats: Array, moving: Array) -> Array:
        """(k, TOUCH), the contacts of the last step, in ascending arc length."""
        count = swung.touches(ints, floats, moving, self.skin.thick, self._out)
        found = self._out[:count].copy()
        return found[np.argsort(found[:, 0], kind="stable")]

    def rest(self, settling: Settling, memory: Momentum, remembered: Array, shape: CableShape) -> bool:
        """Lays the network where a cable lies at rest among the bodies, and lets it come to rest there on its mesh."""
        _lay(settling, shape)
        motion, dt = settling.motion, _FIRST * settling.unit
        for _ in range(_MOST):
            state = settling.sols, motion.walls, motion.props, motion.kept, motion.origin
            kept = [array.copy() for array in state]
            memory.place[...], memory.tangent[...] = motion.origin, _tangents(settling.solution(NOW).q)
            clear = swung.look_at_rest(
                settling.ints, settling.floats, settling.moving, remembered, _REACH, self._stiff, self.kernel, self.skin
            )
            if settling.step(dt):
                way = float(np.linalg.norm(motion.origin - kept[4], axis=1).max())
                if way <= clear:
                    self._note_rings(settling)
                    if settling.at_rest(_AT_REST) and self._gap(motion.walls) < _CLOSED:
                        return True
                    dt = min(_LONGER * dt, _LONGEST * settling.unit)
                    continue
            for array, old in zip(state, kept, strict=True):
                array[...] = old
            dt *= _SHORTER
            if dt < _SHORTEST * settling.unit:
                break
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


def _rings(problem: Problem) -> Array:
    """(e, RING), the eyelets of a cable."""
    clips = [clip for clip in problem.clips if clip.kind == "slide"]
    rings = np.zeros((len(clips), RING))
    for row, clip in zip(rings, clips, strict=True):
        row[:3], row[4] = clip.pose.position, clip.arc_length
    return rings


def _lay(settling: Settling, shape: CableShape) -> None:
    """Makes a shape the network's last solution."""
    now, motion, model, plan = settling.solution(NOW), settling.motion, settling.model, settling.plan
    q = interpolated(model.s, shape.arc_length, shape.quaternions)
    if q[0] @ now.q[0] < 0.0:
        q *= -1.0
    now.q[...] = q
    for j, (a, b) in enumerate(zip(plan.first[:-1], plan.first[1:], strict=True)):
        for knot, node in ((plan.ends[j, 0], a + j), (plan.ends[j, 1], b + j)):
            if now.pose[knot, 3:] @ q[node] < 0.0:
                now.pose[knot, 3:] *= -1.0
    _along(shape.positions, shape.arc_length, model.s, motion.origin)
    motion.place[...] = motion.origin
    ends = plan.first[1:] - 1
    middles = model.s[plan.left] + 0.5 * model.h
    force = np.empty((middles.size, 3))
    _along(shape.force, shape.arc_length, middles, force)
    motion.kept[...] = force - motion.load[:, 3:6]
    now.lam[...] = motion.kept[ends]
    size = settling.sols.size // 3
    settling.sols[size : 2 * size] = settling.sols[2 * size :] = settling.sols[:size]


def _along(rows: Array, at: Array, s: Array, out: Array) -> None:
    """Rows (n, 3) at arc lengths s."""
    for c in range(3):
        out[:, c] = np.interp(s, at, rows[:, c])


def _tangents(q: Array) -> Array:
    """(n, 3), d3 of frames (n, 4)."""
    x, y, z, w = q.T
    return np.stack((2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)), axis=1)
