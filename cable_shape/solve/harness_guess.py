"""Where a search for a harness from nothing starts: places of its knots, and frames of its junctions.

Knots are laid out as if the spans were stiff: every span leads straight on from the frames of its ends, to which it is
held by a spring as stiff as its bending, loads pull, and none is longer than it is. Places and frames take turns: the
former solve a linear system, the latter turn to where their spans lead.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cable_shape.checks import Array
from cable_shape.kernels.network import tables
from cable_shape.solve.harness_network import HarnessNetwork

#: Turns that places and frames take.
_ROUNDS = 14
#: A span is so many times as stiff along itself as it bends, while it is slack.
_SLACK = 10.0
#: Fraction of a span's length from which it holds, and so many times as stiff as its loads and bending ask for.
_TAUT, _HOLDS = 0.96, 1e3
#: Weight of a frame's first two axes where it turns to its neighbours', beside the tangent's.
_ROLL = 0.1


def laid(state: HarnessNetwork, poses: Array, load: float) -> Array:
    """`poses` (k, 7) with places and frames for what nothing holds; load: share of the loads that pull."""
    plan = tables.plan_of.py_func(state.bare)
    model = tables.model_of.py_func(state.bare, state.held)
    a, b = plan.ends.T
    length = model.s[1::2] - model.s[::2]
    bend = 0.5 * (model.section[:, 0] + model.section[:, 1])
    stiff = _SLACK * bend / length**3
    moves: Any = np.array([knot.moves for knot in state.structure.knots])
    turns: Any = np.array([knot.turns for knot in state.structure.knots])
    ball = moves & ~turns
    force = load * model.force.copy()
    for end in (a, b):
        np.add.at(force, end, 0.5 * load * model.weight)
    # of a span that turns for itself at an end nothing is known of its way there
    known: Any = (plan.tied != 0) | (model.free[:, :, 0] == 0.0)
    known &= ~np.stack((ball[a], ball[b]), axis=1)
    frames = _matrices(poses[:, 3:])
    own = _matrices(model.frame.reshape(-1, 4)).reshape(-1, 2, 3, 3)
    y = _along_the_tree(poses[:, :3].copy(), moves, a, b, length, frames, own, known)
    turning = _Turning(turns, own, plan.ends, stiff * length**2, known)
    frames = turning.turned(frames, y)
    leads = np.zeros((len(poses), len(a)))  # of each span from its first knot to the other one
    leads[a, np.arange(len(a))] -= 1.0
    leads[b, np.arange(len(a))] += 1.0
    free, given = leads[moves], leads[~moves]
    pull = np.linalg.norm(model.weight, axis=1) + np.linalg.norm(force, axis=1).max(initial=0.0)
    taut_stiff = _HOLDS * (stiff + pull / length)
    tied_somewhere = known.any(axis=1)[:, None]
    for _ in range(_ROUNDS):
        d = y[b] - y[a]
        size = np.sqrt((d * d).sum(axis=1))
        straight = d / np.maximum(size, 1e-12)[:, None]
        ahead = (turning.ends_of(frames)[:, :, :, 2] * known[:, :, None]).sum(axis=1)
        way = np.where(tied_somewhere, ahead, d)
        norm = np.sqrt((way * way).sum(axis=1))[:, None]
        way = np.where(norm > 1e-9, way / np.maximum(norm, 1e-9), straight)
        taut = size > _TAUT * length
        k = np.where(taut, taut_stiff, stiff)
        goal = np.where(taut[:, None], straight, way) * (_TAUT * length)[:, None]
        eased = free * k
        right = force[moves] + eased @ goal - eased @ (given.T @ y[~moves])
        y[moves] = np.linalg.solve(eased @ free.T, right)
        frames = turning.turned(frames, y)
    out = poses.copy()
    out[moves, :3] = y[moves]
    rigid = turns & (state.layout.placed != 0)
    out[rigid, 3:] = _quaternions(frames[rigid])
    for spans in state.layout.spans.values():
        _come_around(state, spans, frames, own, model.weight, out)
    return out


def _come_around(state: HarnessNetwork, spans: range, frames: Array, own: Array, weight: Array, out: Array) -> None:
    """Poses in `out` of the stations of a segment that comes back to the knot which it leaves.

    It comes around without a twist of more than half a turn: its tangent turns the long way from one end to the other,
    at a constant rate, and what then is left of the way is taken off along it.
    """
    plan, arcs = state.structure.spans, state.layout.arcs
    knot, middles = plan[spans[0]].start, [plan[j].end for j in spans[:-1]]
    if plan[spans[-1]].end != knot or not all(state.structure.knots[row].moves for row in middles):
        return
    down = weight[spans.start : spans.stop].sum(axis=0)
    down = down / np.linalg.norm(down) if down.any() else np.array((0.0, 0.0, -1.0))
    first, last = frames[knot] @ own[spans[0], 0], frames[knot] @ own[spans[-1], 1]
    if not state.structure.knots[knot].turns:  # a ball
        first = last = _aligned(np.eye(3)[None], np.array((_across(down),)))[0]
    a, b = first[:, 2], last[:, 2]
    axis = np.cross(a, b)
    if np.linalg.norm(axis) < 1e-3:
        axis = np.cross(down, a)
    axis = axis / np.linalg.norm(axis) if np.linalg.norm(axis) > 1e-3 else _across(a)
    way = np.arctan2(np.cross(a, b) @ axis, a @ b) - 2.0 * np.pi
    left = (_about(axis, np.array([way]))[0] @ first).T @ last
    roll = np.arctan2(left[1, 0] - left[0, 1], left[0, 0] + left[1, 1])
    length = arcs[spans[-1], 1]
    share = np.linspace(0.0, 1.0, 97)
    tangents = _about(axis, way * share) @ a
    steps = 0.5 * np.diff(share)[:, None] * (tangents[1:] + tangents[:-1])
    places = length * np.concatenate((np.zeros((1, 3)), np.cumsum(steps, axis=0)))
    places -= share[:, None] * places[-1]
    at = arcs[spans.start : spans.stop - 1, 1] / length
    turned = _about(axis, way * at) @ first @ _about(np.array((0.0, 0.0, 1.0)), roll * at)
    for i in range(3):
        out[middles, i] = out[knot, i] + np.interp(at, share, places[:, i])
    q = _quaternions(turned)
    signs = np.cumprod(np.where((q[1:] * q[:-1]).sum(axis=1) < 0.0, -1.0, 1.0))
    out[middles, 3:] = np.concatenate((q[:1], signs[:, None] * q[1:]))


def _across(t: Array) -> Array:
    """A unit vector across another one."""
    side = np.cross(t, np.eye(3)[np.abs(t).argmin()])
    return np.asarray(side / np.linalg.norm(side))


def _about(axis: Array, angles: Array) -> Array:
    """(n, 3, 3): rotations about an axis by angles (n,) [rad]."""
    x, y, z = axis
    hat = np.array(((0.0, -z, y), (z, 0.0, -x), (-y, x, 0.0)))
    return np.asarray(
        np.eye(3) + np.sin(angles)[:, None, None] * hat + (1.0 - np.cos(angles))[:, None, None] * (hat @ hat)
    )


def _along_the_tree(
    y: Array, moves: Any, a: Any, b: Any, length: Array, frames: Array, own: Array, known: Array
) -> Array:
    """Places from those that are given, each span straight on from its frame, or away from the last one."""
    found = ~moves
    todo = list(range(len(a)))
    while todo:
        left = []
        for j in todo:
            for here, there, end, sign in ((a[j], b[j], 0, 1.0), (b[j], a[j], 1, -1.0)):
                if found[here] and not found[there]:
                    t = frames[here] @ own[j, end, :, 2] if known[j, end] else np.array((0.0, 0.0, -sign))
                    y[there] = y[here] + 0.9 * sign * length[j] * t
                    found[there] = True
            if not (found[a[j]] and found[b[j]]):
                left.append(j)
        if len(left) == len(todo):
            break
        todo = left
    return y


class _Turning:
    """Turns frames (k, 3, 3) of the knots that turn to where their spans and their neighbours' frames lead.

    own (m, 2, 3, 3): frames of the ends of spans in their knots, `ends` (m, 2); weight (m,): of each span.
    """

    def __init__(self, turns: Any, own: Array, ends: Any, weight: Array, known: Any) -> None:
        self._ends, self._own, self._rows = ends, own, np.flatnonzero(turns)
        self._roll = np.where(known[:, ::-1], _ROLL, 1e-3 * _ROLL)  # of the frame at the other end
        self._back = weight[:, None, None, None] * own.swapaxes(2, 3)
        self._of_knots = np.zeros((len(turns), ends.size))
        self._of_knots[ends.ravel(), np.arange(ends.size)] = 1.0
        self._of_knots = self._of_knots[self._rows]

    def ends_of(self, frames: Array) -> Array:
        """(m, 2, 3, 3): frames of both ends of the spans."""
        return np.asarray(frames[self._ends] @ self._own)

    def turned(self, frames: Array, y: Array) -> Array:
        """The frames, with knots at y (k, 3)."""
        out = frames.copy()
        if not self._rows.size:
            return out
        d = y[self._ends[:, 1]] - y[self._ends[:, 0]]
        t = d / np.maximum(np.sqrt((d * d).sum(axis=1)), 1e-12)[:, None]
        far = self.ends_of(frames)[:, ::-1]
        aim = _aligned(far.reshape(-1, 3, 3), np.repeat(t, 2, axis=0)).reshape(far.shape)
        aim[..., :2] *= self._roll[:, :, None, None]
        B = (self._of_knots @ (aim @ self._back).reshape(-1, 9)).reshape(-1, 3, 3)
        B += 1e-6 * np.abs(B).max(axis=(1, 2), initial=1e-12)[:, None, None] * frames[self._rows]
        U, _, V = np.linalg.svd(B)
        U[:, :, 2] *= np.linalg.det(U @ V)[:, None]
        out[self._rows] = U @ V
        return out


def _aligned(R: Array, t: Array) -> Array:
    """Frames (m, 3, 3) turned by the smallest rotation that brings d3 onto t (m, 3)."""
    d = R[:, :, 2]
    c = np.maximum((d * t).sum(axis=1), -0.999)
    v = d[:, (1, 2, 0)] * t[:, (2, 0, 1)] - d[:, (2, 0, 1)] * t[:, (1, 2, 0)]
    hat = np.zeros((len(t), 3, 3))
    hat[:, 0, 1], hat[:, 0, 2], hat[:, 1, 2] = -v[:, 2], v[:, 1], -v[:, 0]
    hat -= hat.transpose(0, 2, 1)
    Q = np.eye(3) + hat + hat @ hat / (1.0 + c)[:, None, None]
    out = Q @ R
    out[:, :, 2] = t
    return np.asarray(out)


def _matrices(q: Array) -> Array:
    """Rotation matrices (k, 3, 3) of quaternions (k, 4)."""
    x, y, z, w = q.T
    return np.stack(
        (
            1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y),
            2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x),
            2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y),
        ), axis=1,
    ).reshape(-1, 3, 3)  # fmt: skip


def _quaternions(R: Array) -> Array:
    """Quaternions (k, 4) of rotation matrices (k, 3, 3)."""
    # the largest of the four numbers tells the others
    trace = np.trace(R, axis1=1, axis2=2)
    D = np.concatenate((np.diagonal(R, axis1=1, axis2=2), trace[:, None]), axis=1)
    out = np.empty((len(R), 4))
    for row, (M, diagonal) in enumerate(zip(R, D, strict=True)):
        i = int(diagonal.argmax())
        if i == 3:
            q = np.array((M[2, 1] - M[1, 2], M[0, 2] - M[2, 0], M[1, 0] - M[0, 1], 1.0 + diagonal[3]))
        else:
            j, k = (i + 1) % 3, (i + 2) % 3
            q = np.empty(4)
            q[i] = 1.0 + 2.0 * M[i, i] - diagonal[3]
            q[j], q[k], q[3] = M[j, i] + M[i, j], M[k, i] + M[i, k], M[k, j] - M[j, k]
        out[row] = q / np.linalg.norm(q)
    return out
