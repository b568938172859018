"""A shape on another stretch of the same cable: :func:`carried`, for what goes on from it after an edit."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from cable_shape.cable.cable import TAIL_SIDES
from cable_shape.checks import Array
from cable_shape.pose import Pose, multiply
from cable_shape.prediction.layout import Laid
from cable_shape.prediction.tails import runs
from cable_shape.prediction.turned import turned_shape
from cable_shape.shape import NOT_RUBBED, CableShape
from cable_shape.solve.mesh import interpolated
from cable_shape.solve.touching.resume import numbered

_HALF_TURN: Array = np.array((-1.0, 0.0, 0.0, 0.0))  # undoes that of a tail which runs backwards, see `tails`


def carried(shape: CableShape, tails: Mapping[str, CableShape], before: Laid, after: Laid) -> CableShape:
    """A shape of a cable held as `before`, its tails with it, as one of the same cable held as `after`.

    Where more of the cable is between the grips than was, that is its tail; what the tail does not reach is left
    straight. Contacts go with the cable, and what the clips do to it; of new clips that is nothing.
    """
    known = {clip.name: row for clip, row in zip(before.clips, shape.supports, strict=False)}
    shift = before.first - after.first
    supports, rubbed = np.zeros((len(after.clips), 7)), np.zeros((len(after.clips), 2))
    rubs = {clip.name: row for clip, row in zip(before.clips, shape.rubbed, strict=False)}
    for row, rub, clip in zip(supports, rubbed, after.clips, strict=True):
        row[0] = clip.arc_length
        if clip.name in known:
            row[:] = known[clip.name]
            row[0] += shift
        rub[:] = rubs.get(clip.name, 0.0)
    if not rubs:
        rubbed = NOT_RUBBED
    if (after.first, after.last) == (before.first, before.last):
        out = shape.again()
        out.supports, out.rubbed, out.reused = supports, rubbed, False
        return out
    arcs, line = _joined(shape, tails)
    length = after.cable.length
    touches, names = _joined_touches(shape, tails)
    out = _sampled(shape, length, -shift, arcs, line, supports, _between(touches, -shift, length), names)
    out.rubbed = rubbed
    if shape.velocity is not None:  # tails go along with the grips
        out.velocity = _along(out.arc_length - shift, shape.arc_length, shape.velocity)
    return out


def carried_tails(
    shape: CableShape, tails: Mapping[str, CableShape], before: Laid, after: Laid
) -> dict[str, CableShape]:
    """The tails that the same cable has where it is held as `after`, by side: what lies beyond the grips there."""
    out: dict[str, CableShape] = {}
    arcs, line = _joined(shape, tails)
    touches, names = _joined_touches(shape, tails)
    for side, length in after.cable.tails.items():
        first = after.first - before.first - length if side == "start" else after.last - before.first
        of_none, theirs = np.zeros((0, 7)), _between(touches, first, length)
        own = _sampled(shape, length, first, arcs, line, of_none, theirs, names)
        out[side] = turned_shape(own) if side == "start" else own
    return out


def stretched(shape: CableShape, length: float) -> CableShape:
    """A shape as one of a cable of another length [m], where nothing but its arc length changes."""
    if length == shape.length:
        return shape
    scale = length / shape.length
    supports, touches = shape.supports.copy(), shape.touches.copy()
    supports[:, 0] *= scale
    touches[:, 0] *= scale
    arcs = scale * shape.arc_length
    out = _sampled(shape, length, 0.0, arcs, _columns(shape), supports, touches, shape.bodies)
    out.velocity, out.rubbed = shape.velocity, shape.rubbed
    return out


def _sampled(
    shape: CableShape, length: float, first: float, arcs: Array, line: list[Array], supports: Array, touches: Array,
    bodies: tuple[str, ...],
) -> CableShape:  # fmt: skip
    """A shape of this length [m] from `first` [m] on, of a line (k, ..) given at arc lengths `arcs` (k,)."""
    n = shape.points
    here = np.linspace(first, first + length, n)
    out = CableShape.new_buffer(n)
    out[:n] = np.linspace(0.0, length, n)
    out[n : 4 * n] = _along(here, arcs, line[0]).ravel()
    q = out[4 * n : 8 * n].reshape(n, 4)
    q[:] = interpolated(here, arcs, line[1])
    for i, values in enumerate(line[2:]):
        out[(8 + 3 * i) * n : (11 + 3 * i) * n] = _along(here, arcs, values).ravel()
    _lengthen(out[n : 4 * n].reshape(n, 3), q, here, arcs)
    twist = float(np.trapezoid(out[8 * n : 11 * n].reshape(n, 3)[:, 2], out[:n]))
    return CableShape(
        out,
        n,
        length=length,
        model=shape.model,
        status=shape.status,
        detail=shape.detail,
        error_estimate=math.nan,
        turns=_turns(shape, q, twist),
        twist=twist,
        supports=supports,
        touches=touches,
        bodies=bodies,
    )


def place_of(shape: CableShape, arc_length: float) -> Pose:
    """Where the cable is at an arc length [m], with its frame."""
    at = np.array((arc_length,))
    position = _along(at, shape.arc_length, shape.positions)[0]
    return Pose(position, interpolated(at, shape.arc_length, shape.quaternions)[0])


def _columns(shape: CableShape) -> list[Array]:
    """Positions, quaternions, curvature, force and moment."""
    return [shape.positions, shape.quaternions, shape.curvature, shape.force, shape.moment]


def _joined(shape: CableShape, tails: Mapping[str, CableShape]) -> tuple[Array, list[Array]]:
    """Arc lengths [m] from the start grip, and `_columns` there: of the span and of its tails."""
    arcs, lines = [shape.arc_length], [_columns(shape)]
    tail = tails.get("start")
    if tail is not None and tail.status:
        back = [part[:0:-1] for part in _columns(tail)]
        back[1] = np.array([multiply(q, _HALF_TURN) for q in back[1]])
        back[2] = back[2] * (-1.0, 1.0, 1.0)
        back[3], back[4] = -back[3], -back[4]
        arcs.insert(0, -tail.arc_length[:0:-1])
        lines.insert(0, back)
    tail = tails.get("end")
    if tail is not None and tail.status:
        arcs.append(shape.length + tail.arc_length[1:])
        lines.append([part[1:] for part in _columns(tail)])
    return np.concatenate(arcs), [np.concatenate(parts) for parts in zip(*lines, strict=True)]


def _joined_touches(shape: CableShape, tails: Mapping[str, CableShape]) -> tuple[Array, tuple[str, ...]]:
    """Contacts of the span and of its tails by arc length [m] from the start grip, and the names of the bodies."""
    told = [one for part in (shape, *tails.values()) for one in numbered(part.bodies)]
    bodies, rows = list(dict.fromkeys(told)), []
    for part, first, way in (
        (shape, 0.0, 1.0),
        *((tails[s], *runs(s, shape.length)) for s in TAIL_SIDES if s in tails),
    ):
        own = part.touches.copy()
        own[:, 0] = first + way * own[:, 0]
        which = numbered(part.bodies)
        own[:, 1] = [bodies.index(which[int(body)]) for body in own[:, 1]]
        rows.append(own)
    every = np.concatenate(rows)
    return every[np.argsort(every[:, 0], kind="stable")], tuple(name for name, _ in bodies)


def _between(touches: Array, first: float, length: float) -> Array:
    """Those on a stretch, by arc length on it."""
    own = touches[(touches[:, 0] > first) & (touches[:, 0] < first + length)].copy()
    own[:, 0] -= first
    return own


def _along(at: Array, arcs: Array, values: Array) -> Array:
    """(k, 3) at arc lengths (k,), linear between those of the values."""
    return np.stack([np.interp(at, arcs, column) for column in values.T], axis=1)


def _lengthen(positions: Array, q: Array, here: Array, arcs: Array) -> None:
    """Goes straight on from where the line ends."""
    for beyond, end in ((here < arcs[0], int(np.argmax(here >= arcs[0]))), (here > arcs[-1], -1)):
        if not beyond.any():
            continue
        at = end if end >= 0 else int(np.argmax(beyond)) - 1
        x, y, z, w = q[at]
        along = np.array((2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)))
        positions[beyond] = positions[at] + np.outer(here[beyond] - here[at], along)


def _turns(shape: CableShape, q: Array, twist: float) -> int:
    """Windings of a stretch: as many as its twist says, of those that its frames allow."""
    start, end = q[0] * (-1.0, -1.0, -1.0, 1.0), q[-1]
    odd = int(multiply(start, end)[3] < 0.0)
    about = shape.turns + (twist - shape.twist) / (2.0 * math.pi)
    return odd + 2 * round(0.5 * (about - odd))
