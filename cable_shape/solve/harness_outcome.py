"""What is told of a harness where there is no shape: straight lines between its knots, and what is too far apart."""

from __future__ import annotations

import math
from itertools import combinations, pairwise

import numpy as np

from cable_shape.checks import Array
from cable_shape.kernels.frames import align
from cable_shape.kernels.network.drive import STRAIGHT
from cable_shape.pose import rotate
from cable_shape.shape import NUMBERS_PER_POINT, Status
from cable_shape.solve.harness_layout import Name, holds
from cable_shape.solve.harness_network import HarnessNetwork
from cable_shape.solve.harness_problem import HarnessProblem

#: Steps in which strings are laid out, and what they lack [longest segments] that is no rounding of that.
_STRINGS, _SHORT = 300, 1e-3
#: So many times as stiff as a string is what holds ends beside their junctions.
_BAR = 1e3
_AHEAD: Array = np.array((0.0, 0.0, 1.0))


def out_of_reach(task: HarnessProblem, state: HarnessNetwork, poses: Array) -> tuple[Status, Array, str, float] | None:
    """Two supports further apart than the segments between them are long: status, poses, what to say, what is missing
    [m]; None where there are none, or segments stretch."""
    names, places = list(state.layout.knots), poses[:, :3].tolist()
    worst: tuple[float, int, int, float, float] = (0.0, -1, -1, 0.0, 0.0)
    for k, other, length in state.layout.ways:
        apart = math.dist(places[k], places[other])
        if apart >= STRAIGHT * length and (worst[1] < 0 or apart - length > worst[0]):
            worst = (apart - length, k, other, apart, length)
    missing, a, b, apart, length = worst
    if a < 0:
        return _through_eyelets(state, poses)
    detail = (
        f"{_told(task, names[a])} and {_told(task, names[b])} are {apart:.4g} m apart, {missing:.3g} m more than the "
        f"segments between them are long ({length:.4g} m). Bring them closer, or give the segments an axial_stiffness; "
        "the shape is straight lines."
    )
    return Status.OVERSTRETCHED, poses, detail, max(missing, 0.0)


def _through_eyelets(state: HarnessNetwork, poses: Array) -> tuple[Status, Array, str, float] | None:
    """The same of a segment that is too short for its way through its eyelets."""
    if not state.rings or state.stretch != 0.0:
        return None
    needed, arcs = state.needed(poses), state.bounds()
    holding = [row for row in range(arcs.size) if row not in state.rings]
    for a, b in pairwise(holding):
        missing = float(needed[a:b].sum() - STRAIGHT * (arcs[b] - arcs[a]))
        if b - a > 1 and missing >= 0.0:
            through = ", ".join(state.ring_name(ring) for ring in range(a + 1, b))
            detail = (
                f"through {through} the way is {needed[a:b].sum():.4g} m long, {missing:.3g} m more than the "
                "cable there. Bring supports closer, or give segments an axial_stiffness; the shape is straight lines."
            )
            return Status.OVERSTRETCHED, poses, detail, max(missing, 0.0)
    return None


def _told(task: HarnessProblem, name: Name) -> str:
    """What a support is called."""
    return f"clip {task.clip_names[int(name[1])]!r}" if name[0] == "clip" else f"the grip at {name[1]!r}"


def laid_straight(task: HarnessProblem, state: HarnessNetwork, poses: Array, buffer: Array) -> None:
    """Fills a buffer of all segments with straight lines between the knots; no forces."""
    n = task.points
    buffer[:] = 0.0
    spans = state.structure.spans
    for i, (name, cable) in enumerate(task.harness.segments.items()):
        own = buffer[NUMBERS_PER_POINT * n * i : NUMBERS_PER_POINT * n * (i + 1)]
        s = np.linspace(0.0, cable.length, n)
        own[:n] = s
        positions, quaternions = own[n : 4 * n].reshape(n, 3), own[4 * n : 8 * n].reshape(n, 4)
        q = np.array((0.0, 0.0, 0.0, 1.0))
        for j in state.layout.spans[name]:
            low, high = state.layout.arcs[j]
            inside = (s >= low) & (s <= high)
            a, b = poses[spans[j].start, :3], poses[spans[j].end, :3]
            size = float(np.linalg.norm(b - a))
            if size > 0.0:
                align(q, *((b - a) / size))
            positions[inside] = a + np.outer((s[inside] - low) / (high - low), b - a)
            quaternions[inside] = q


def _bars(state: HarnessNetwork) -> list[tuple[int, int, float]]:
    """Ends that lie beside one junction: two knots each, and how far they are from each other [m]."""
    spans, frames = state.structure.spans, state.layout.frames
    beside: dict[int, list[tuple[int, Array]]] = {}
    for j, size in state.layout.levers:
        beside.setdefault(spans[j].start, []).append((spans[j].end, size * rotate(frames[j, 0], _AHEAD)))
    pairs = (pair for ends in beside.values() for pair in combinations(ends, 2))
    return [(one, other, float(np.linalg.norm(x - y))) for (one, x), (other, y) in pairs if not np.array_equal(x, y)]


def lacking(task: HarnessProblem, state: HarnessNetwork, poses: Array) -> tuple[float, str]:
    """[m], what segments that do not stretch lack together to reach all supports at once, by how much they could not be
    laid out as strings; and the segment that lacks most. 0: nothing, or it cannot be told, as with eyelets."""
    if state.rings:
        return 0.0, ""
    spans = state.structure.spans
    bars = _bars(state)
    a, b = (np.array([*(span[i] for span in spans), *(bar[i] for bar in bars)], dtype=np.int64) for i in (0, 1))
    length = np.array([*(state.layout.arcs[:, 1] - state.layout.arcs[:, 0]), *(bar[2] for bar in bars)])
    cables = list(task.harness.segments.values())
    limits = np.ones(len(a), dtype=bool)
    for cable, rows in zip(cables, state.layout.spans.values(), strict=True):
        limits[rows.start : rows.stop] = holds(cable)
    stiff = np.arange(len(a)) >= len(spans) - len(state.layout.levers)
    moves = np.array([knot.moves for knot in state.structure.knots])
    y = poses[:, :3].copy()
    n = len(y)
    for _ in range(_STRINGS):
        d = y[b] - y[a]
        size = np.maximum(np.linalg.norm(d, axis=1), 1e-12)
        tight = limits & (size > length)
        if not (tight & ~stiff).any() and (np.abs(size - length)[stiff] <= _SHORT * length[stiff]).all():
            return 0.0, ""
        tight |= stiff
        k = np.where(stiff, _BAR, np.where(tight, 1.0, 1e-4)) / length
        goal = d * np.where(tight, length / size, 1.0)[:, None]
        K, right = np.zeros((n, n)), np.zeros((n, 3))
        for i, j, sign in ((a, a, 1.0), (b, b, 1.0), (a, b, -1.0), (b, a, -1.0)):
            np.add.at(K, (i, j), sign * k)
        np.add.at(right, a, -k[:, None] * goal)
        np.add.at(right, b, k[:, None] * goal)
        y[moves] = np.linalg.solve(K[np.ix_(moves, moves)], right[moves] - K[np.ix_(moves, ~moves)] @ y[~moves])
    d = np.linalg.norm(y[b] - y[a], axis=1)
    over = np.where(limits, np.maximum(d - length, 0.0), 0.0)
    if over.sum() <= _SHORT * state.length:
        return 0.0, ""
    worst = int(over.argmax())
    names = [name for name, rows in state.layout.spans.items() if worst in rows]
    return float(over.sum()), names[0] if names else "a junction"
