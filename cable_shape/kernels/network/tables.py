"""What the solver of a network knows, as named arrays: :class:`Plan`, :class:`Model`, :class:`Solution`, :class:`Work`.

A network has m spans between k knots. A span is a stretch of cable without a support inside, cut into elements; a knot
is whatever the ends of spans are held in, joined at or pressed on: a grip, a free end, a clip, a junction. Cables are
runs of spans that follow each other. With N elements and n = N + m nodes (every span has nodes of its own at both
ends), V vertices of the graph of what is unknown of the knots, E blocks beside its diagonal:

    node    of element e of span j: e + j at its left, e + j + 1 at its right
    vertex  the rotation or the place of a knot, where it is unknown: a block of three rows

Python hands over one array of whole numbers and one of floats for each of the four; what they hold is known by name
here alone.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cable_shape.kernels import rod_arcs, rod_lanes
from cable_shape.kernels.network.compiled import inline, part, viewing

Floats = NDArray[np.float64]
Whole = NDArray[np.int64]

#: Numbers at the head of a plan: elements, spans, knots, vertices, blocks, targets, cables, stripped spans, pieces,
#: point loads, eyelets, links.
HEAD = 16
N_ELEMENTS, N_SPANS, N_KNOTS, N_VERTICES, N_BLOCKS, N_TARGETS, N_CABLES, N_STRIPPED = 0, 1, 2, 3, 4, 5, 6, 7
N_PIECES, N_POINTS, N_RINGS, UNKNOWN, N_LINKS = 8, 9, 10, 11, 12
#: Knots whose places bodies press on: all of them, or 0 where none can be, and nothing is kept of it.
N_PRESSED = 13
#: Columns of a link in `Plan` and `Model`: where two knots press on each other, see `contact.link`.
LINK_PLAN, LINK_MODEL = 11, 120
#: Columns of `Model.links`: two rows B of 12, second derivative as ten blocks, normal, step that closes the gap, 1:
#: the push is one of the unknowns.
L_ROWS, L_BENT, L_NORMAL, L_REST, L_ACTIVE = 0, 24, 114, 117, 118
#: Columns of a piece of a cable: stiffness, rest curvature and distributed load at its left and right, compliance.
PIECE = 21
#: Numbers that belong to the whole network, see `Model.par`.
PAR = 9
SOFTEST, BASE_SHIFT, LENGTH, ELASTIC, STIFFEST, TURN_AT_REST, RIGID, SOFT, SWINGS = 0, 1, 2, 3, 4, 5, 6, 7, 8
#: Numbers of scratch: rows of elements side by side, and a few more.
LANES_SIZE, SCRATCH = max(rod_lanes.ROWS, rod_arcs.ROWS) * rod_lanes.LANES, 16
#: Solutions that are kept.
NOW, BEFORE, TRIAL = 0, 1, 2
#: Numbers that a solution keeps of the friction of an eyelet, see `gripping`.
GRIP = 7
#: Numbers of a span's condensed matrix, see `condense`.
CONDENSED = 72


class Plan(NamedTuple):
    """Who is joined to whom."""

    head: Whole  # (HEAD,)
    first: Whole  # (m+1,) first element of each span
    left: Whole  # (N,) left node of each element
    ends: Whole  # (m, 2) knots at the start and the end
    tied: Whole  # (m, 2) 1: the span's end turns with the knot; 0: it is held, or free, for itself
    turned: Whole  # (m, 2) 1: the end's frame is not the knot's
    known: Whole  # (m,) 1: the force at its end follows from loads alone
    corners: Whole  # (m, 4) vertices: rotation and place of the first knot, of the second; -1 none
    blocks: Whole  # (m, 6) where the blocks between those four are; negative: transposed, -1 - place
    vertices: Whole  # (k, 2) vertices of a knot's rotation and place; -1 given
    links: Whole  # (l, LINK_PLAN) knots a and b, vertex of the push between them, blocks of their rotations and places:
    #               ta-ya, ta-tb, ta-yb, ya-tb, ya-yb, tb-yb, ya-push, yb-push
    pointer: Whole  # (V+1,) of each vertex, in the order of elimination, its neighbours still left
    neighbour: Whole  # (E,)
    goal: Whole  # (V+1,) of each vertex, where its pairs of neighbours are updated
    target: Whole  # (T,) block, or -1 - vertex on the diagonal
    stripped: Whole  # (r, 2) spans whose force is known, leaves first, and which end is the leaf
    cables: Whole  # (c+1,) first span of each cable
    roll: Whole  # (c, 2) knots between which a cable's turns are counted
    pieces: Whole  # (c+1,) first piece of each cable
    points: Whole  # (c+1,) first point load of each cable
    rings: Whole  # (e, 2) eyelets: knot, and the span before it
    forces: Whole  # (m, 5) where knots can be pressed on, else none: vertex of the span's force, -1 where the span is
    #                condensed; its blocks with those of `corners`


class Model(NamedTuple):
    """What cables and supports are made of; lengths in m, forces in N."""

    par: Floats  # (PAR,) softest stiffness / length^2, shift that is always there, length, whether a compliance is
    #              above 0, largest stiffness, turn [rad] that needs no motion of supports, whether nothing stretches,
    #              how many times as uncertain corrections are as between clamped ends, whether it has mass
    s: Floats  # (n,) arc length of the nodes, on their cable
    h: Floats  # (N,)
    load: Floats  # (N, 9) internal force without the span's own at the left, middle and right of each element
    rest: Floats  # (N, 6) rest curvature in the middle and its slope
    section: Floats  # (N, 9) stiffness in the middle, compliance, slope of the stiffness
    errors: Floats  # (N,) each element's share of the last solution's error
    rough: Floats  # (N,) [m] by how much a shape may be off inside, as its rest curvature is no straight line there
    free: Floats  # (m, 2, 3) rotations of an end that is not tied, 1 free, 0 held
    frame: Floats  # (m, 2, 4) the end's frame in that of its knot
    loose: Floats  # (k, 3) rotations of a knot that are unknown
    force: Floats  # (k, 3) dead force on a knot
    moment: Floats  # (k, 3) dead moment on the one end that is in a knot
    weight: Floats  # (m, 3) whole load of a span
    heavy: Floats  # (c, 3) weight [N/m] of each cable, for the energy
    breaks: Floats  # (P + c,) arc lengths between the pieces of each cable
    piece: Floats  # (P, PIECE)
    beyond: Floats  # (P + c, 3) integral of the distributed load up to each break
    at: Floats  # (p,) arc length of point loads
    act: Floats  # (p, 3)
    carried: Floats  # (k, 3) scratch
    along: Floats  # (l, 9) l = `N_PRESSED`: columns are the directions in which a knot's place is free, or zero
    bent: Floats  # (l, 9) second derivative of what presses on it, in the place [N/m]
    lean: Floats  # (l, 6) a (rotation), b (place): what else it adds is half the square of a . theta + b . y
    given: Floats  # (l, 3) [m] the step in its place that is not left to it
    links: Floats  # (links, LINK_MODEL)
    firmer: Floats  # (N, 2) [N m^2] of what has mass, see `rod_element.element_gradient`
    friction: Floats  # (e,) coefficient of friction of the eyelets
    draw: Floats  # (e,) [N], by which they draw the cable towards its start


class Solution(NamedTuple):
    """One solution."""

    q: Floats  # (n, 4)
    lam: Floats  # (m, 3) internal force at the end of each span, the loads there included
    pose: Floats  # (k, 7) place and rotation of the knots
    arc: Floats  # (e,) arc length of the cable at its eyelets
    grip: Floats  # (e, GRIP) what friction in them remembers, see `gripping`
    turns: Floats  # (c,)


class Work(NamedTuple):
    """Newton's matrix, its factors, and right-hand sides."""

    D: Floats  # (n, 9) diagonal blocks
    U: Floats  # (N, 9) blocks right of them
    parts: Floats  # (N, 36) of each element: H22, B1, B2, CC
    P: Floats  # (n, 9) inverse pivots
    Y: Floats  # (N, 9)
    W: Floats  # (n, 21) columns of the first knot's rotation, of the span's force, of a right-hand side
    first: Floats  # (N, 9) derivatives in the force (minus the step in position), delta_1, delta_2 (-M, +M)
    full: Floats  # (N, 9) internal force
    G: Floats  # (n, 3) gradient in the rotations
    d: Floats  # (n, 3) step of the rotations
    start: Floats  # (n, 4) rotations that Newton's method starts from; the corrected ones afterwards
    slack: Floats  # (N, 3)
    moments: Floats  # (N, 6) at the left and right of each element, corrected
    sums: Floats  # (m, 21) closure 3, CC 9, second derivative in the first rotation of the first element alone 9
    spans: Floats  # (m, CONDENSED)
    pull: Floats  # (k, 3) gradient in the places
    move: Floats  # (k, 6) step of rotation and place of the knots
    place: Floats  # (k, 3) places, corrected
    pulled: Floats  # (m, 3) forces of the spans, corrected
    diagonal: Floats  # (V, 9) inverse pivots of the graph
    block: Floats  # (E, 9)
    gap: Floats  # (V, 3) right-hand side, then the answer
    size: Floats  # (V, 9) the diagonal as assembled
    missing: Floats  # (m, 3)
    lanes: Floats  # (LANES_SIZE,) scratch
    sums_of: Floats  # (16,) scratch


@inline
def copy(a: Floats, b: Floats) -> None:
    """Fills a (n,) with b, which does not overlap it."""
    for i in range(a.shape[0]):
        a[i] = b[i]


@inline
def copy_rows(a: Floats, b: Floats, columns: int) -> None:
    """Fills the first columns of a (n, m) with those of b, which does not overlap it."""
    for i in range(a.shape[0]):
        for c in range(columns):
            a[i, c] = b[i, c]


@viewing(forceinline=True)
def plan_of(ints: Whole) -> Plan:
    """The parts of a plan."""
    n, m, k, v, b, t = ints[0], ints[1], ints[2], ints[3], ints[4], ints[5]
    c, r, e = ints[N_CABLES], ints[N_STRIPPED], ints[N_RINGS]
    o0 = 0
    o1 = o0 + HEAD
    o2 = o1 + (m + 1)
    o3 = o2 + n
    o4 = o3 + m * 2
    o5 = o4 + m * 2
    o6 = o5 + m * 2
    o7 = o6 + m
    o8 = o7 + m * 4
    o9 = o8 + m * 6
    o10 = o9 + k * 2
    o10b = o10 + LINK_PLAN * ints[N_LINKS]
    o11 = o10b + (v + 1)
    o12 = o11 + b
    o13 = o12 + (v + 1)
    o14 = o13 + t
    o15 = o14 + r * 2
    o16 = o15 + (c + 1)
    o17 = o16 + c * 2
    o18 = o17 + (c + 1)
    o19 = o18 + (c + 1)
    o20 = o19 + e * 2
    return Plan(
        part(ints, o0, (o1 - o0,)),
        part(ints, o1, (o2 - o1,)),
        part(ints, o2, (o3 - o2,)),
        part(ints, o3, (m, 2)),
        part(ints, o4, (m, 2)),
        part(ints, o5, (m, 2)),
        part(ints, o6, (o7 - o6,)),
        part(ints, o7, (m, 4)),
        part(ints, o8, (m, 6)),
        part(ints, o9, (k, 2)),
        part(ints, o10, (ints[N_LINKS], LINK_PLAN)),
        part(ints, o10b, (o11 - o10b,)),
        part(ints, o11, (o12 - o11,)),
        part(ints, o12, (o13 - o12,)),
        part(ints, o13, (o14 - o13,)),
        part(ints, o14, (r, 2)),
        part(ints, o15, (o16 - o15,)),
        part(ints, o16, (c, 2)),
        part(ints, o17, (o18 - o17,)),
        part(ints, o18, (o19 - o18,)),
        part(ints, o19, (e, 2)),
        part(ints, o20, (m if ints[N_PRESSED] > 0 else 0, 5)),
    )  # fmt: skip


@viewing(forceinline=True)
def model_of(ints: Whole, floats: Floats) -> Model:
    """The parts of a model."""
    n, m, k, c, p, a = ints[0], ints[1], ints[2], ints[N_CABLES], ints[N_PIECES], ints[N_POINTS]
    o0 = 0
    o1 = o0 + PAR
    o2 = o1 + (n + m)
    o3 = o2 + n
    o4 = o3 + n * 9
    o5 = o4 + n * 6
    o6 = o5 + n * 9
    o7 = o6 + n
    o8 = o7 + n
    o9 = o8 + m * 2 * 3
    o10 = o9 + m * 2 * 4
    o11 = o10 + k * 3
    o12 = o11 + k * 3
    o13 = o12 + k * 3
    o14 = o13 + m * 3
    o14b = o14 + c * 3
    o15 = o14b + (p + c)
    o16 = o15 + p * PIECE
    o17 = o16 + (p + c) * 3
    o18 = o17 + a
    o19 = o18 + a * 3
    l = ints[N_PRESSED]  # noqa: E741
    o20 = o19 + k * 3
    o21 = o20 + l * 9
    o22 = o21 + l * 9
    o23 = o22 + l * 6
    o24 = o23 + l * 3
    o25 = o24 + LINK_MODEL * ints[N_LINKS]
    return Model(
        part(floats, o0, (o1 - o0,)),
        part(floats, o1, (o2 - o1,)),
        part(floats, o2, (o3 - o2,)),
        part(floats, o3, (n, 9)),
        part(floats, o4, (n, 6)),
        part(floats, o5, (n, 9)),
        part(floats, o6, (o7 - o6,)),
        part(floats, o7, (o8 - o7,)),
        part(floats, o8, (m, 2, 3)),
        part(floats, o9, (m, 2, 4)),
        part(floats, o10, (k, 3)),
        part(floats, o11, (k, 3)),
        part(floats, o12, (k, 3)),
        part(floats, o13, (m, 3)),
        part(floats, o14, (c, 3)),
        part(floats, o14b, (o15 - o14b,)),
        part(floats, o15, (p, PIECE)),
        part(floats, o16, (p + c, 3)),
        part(floats, o17, (o18 - o17,)),
        part(floats, o18, (a, 3)),
        part(floats, o19, (k, 3)),
        part(floats, o20, (l, 9)),
        part(floats, o21, (l, 9)),
        part(floats, o22, (l, 6)),
        part(floats, o23, (l, 3)),
        part(floats, o24, (ints[N_LINKS], LINK_MODEL)),
        part(floats, o25, (n, 2)),
        part(floats, o25 + 2 * n, (ints[N_RINGS],)),
        part(floats, o25 + 2 * n + ints[N_RINGS], (ints[N_RINGS],)),
    )  # fmt: skip


@viewing
def still_knots(model: Model) -> None:
    """Leaves no steps to be made but those that solve for the right-hand side."""
    model.given[:, :] = 0.0
    for i in range(model.links.shape[0]):
        model.links[i, L_REST] = 0.0


@viewing
def solution_size(ints: Whole) -> int:
    """Numbers of one solution."""
    return 4 * (ints[0] + ints[1]) + 3 * ints[1] + 7 * ints[2] + (1 + GRIP) * ints[N_RINGS] + ints[N_CABLES]


@viewing(forceinline=True)
def solution_of(ints: Whole, sol: Floats, which: int) -> Solution:
    """The parts of solution NOW, BEFORE or TRIAL."""
    n, m, k, e, c = ints[0], ints[1], ints[2], ints[N_RINGS], ints[N_CABLES]
    o0 = which * (4 * (n + m) + 3 * m + 7 * k + (1 + GRIP) * e + c)
    o1 = o0 + (n + m) * 4
    o2 = o1 + m * 3
    o3 = o2 + k * 7
    o4 = o3 + e
    o5 = o4 + GRIP * e
    return Solution(
        part(sol, o0, (n + m, 4)),
        part(sol, o1, (m, 3)),
        part(sol, o2, (k, 7)),
        part(sol, o3, (o4 - o3,)),
        part(sol, o4, (e, GRIP)),
        part(sol, o5, (c,)),
    )  # fmt: skip


@viewing(forceinline=True)
def work_of(ints: Whole, work: Floats) -> Work:
    """The parts of the work space."""
    n, m, k, v, b = ints[0], ints[1], ints[2], ints[3], ints[4]
    o0 = 0
    o1 = o0 + (n + m) * 9
    o2 = o1 + n * 9
    o3 = o2 + n * 36
    o4 = o3 + (n + m) * 9
    o5 = o4 + n * 9
    o6 = o5 + (n + m) * 21
    o7 = o6 + n * 9
    o8 = o7 + n * 9
    o9 = o8 + (n + m) * 3
    o10 = o9 + (n + m) * 3
    o11 = o10 + (n + m) * 4
    o12 = o11 + n * 3
    o13 = o12 + n * 6
    o14 = o13 + m * 21
    o15 = o14 + m * CONDENSED
    o16 = o15 + k * 3
    o17 = o16 + k * 6
    o18 = o17 + k * 3
    o19 = o18 + m * 3
    o20 = o19 + v * 9
    o21 = o20 + b * 9
    o22 = o21 + v * 3
    o23 = o22 + v * 9
    o24 = o23 + m * 3
    o25 = o24 + LANES_SIZE
    return Work(
        part(work, o0, (n + m, 9)),
        part(work, o1, (n, 9)),
        part(work, o2, (n, 36)),
        part(work, o3, (n + m, 9)),
        part(work, o4, (n, 9)),
        part(work, o5, (n + m, 21)),
        part(work, o6, (n, 9)),
        part(work, o7, (n, 9)),
        part(work, o8, (n + m, 3)),
        part(work, o9, (n + m, 3)),
        part(work, o10, (n + m, 4)),
        part(work, o11, (n, 3)),
        part(work, o12, (n, 6)),
        part(work, o13, (m, 21)),
        part(work, o14, (m, CONDENSED)),
        part(work, o15, (k, 3)),
        part(work, o16, (k, 6)),
        part(work, o17, (k, 3)),
        part(work, o18, (m, 3)),
        part(work, o19, (v, 9)),
        part(work, o20, (b, 9)),
        part(work, o21, (v, 3)),
        part(work, o22, (v, 9)),
        part(work, o23, (m, 3)),
        part(work, o24, (o25 - o24,)),
        part(work, o25, (SCRATCH,)),
    )  # fmt: skip


@viewing
def model_size(ints: Whole) -> int:
    """Numbers of a model with this head."""
    n, m, k, c, p, a = ints[0], ints[1], ints[2], ints[N_CABLES], ints[N_PIECES], ints[N_POINTS]
    size = PAR + 30 * n + 18 * m + 12 * k + 3 * c + 4 * (p + c) + PIECE * p + 4 * a
    return size + 27 * ints[N_PRESSED] + LINK_MODEL * ints[N_LINKS] + 2 * ints[N_RINGS]


@viewing
def work_size(ints: Whole) -> int:
    """Numbers of a work space with this head."""
    n, m, k, v, b = ints[0], ints[1], ints[2], ints[3], ints[4]
    return 130 * n + (76 + CONDENSED) * m + 12 * k + 21 * v + 9 * b + LANES_SIZE + SCRATCH
