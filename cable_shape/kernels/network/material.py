"""From cables to elements: lengths, internal force, rest curvature and section between the nodes of a mesh.

A cable is made of pieces. In each of them stiffness, rest curvature and distributed load change linearly, and the
compliance is the same all along; from one to the next they may jump.
"""

from __future__ import annotations

from numba import types

from cable_shape.kernels.network.compiled import inline, viewing
from cable_shape.kernels.network.tables import Floats, Whole, model_of, plan_of

#: Columns of a piece: stiffness, rest curvature and load at its left; the same at its right; compliance.
K_LEFT, REST_LEFT, LOAD_LEFT, K_RIGHT, REST_RIGHT, LOAD_RIGHT, COMPLIANCE = 0, 3, 6, 9, 12, 15, 18
ROUGHNESS = 1.0 / 30.0  # of change of slope times h^3: what a kink inside an element may do to its shape, and more


@inline
def find(breaks: Floats, first: int, last: int, x: float) -> int:
    """The piece, first to last, that holds the arc length x; pieces p end at breaks[p + 1]."""
    low, high = first, last
    while low < high:
        middle = (low + high) // 2
        if x < breaks[middle + 1]:
            high = middle
        else:
            low = middle + 1
    return low


@inline
def load_up_to(piece: Floats, breaks: Floats, beyond: Floats, p: int, o: int, x: float, i: int) -> float:
    """[N], component i of the distributed load from the cable's start to x, which is in piece p; o: p's own break."""
    a, b = breaks[o], breaks[o + 1]
    t = x - a
    slope = (piece[p, LOAD_RIGHT + i] - piece[p, LOAD_LEFT + i]) / (b - a)
    return beyond[o, i] + t * (piece[p, LOAD_LEFT + i] + 0.5 * slope * t)


@viewing
def add_up(ints: Whole, floats: Floats) -> None:
    """Fills `beyond`, the distributed load from the start of each cable up to each break."""
    plan, model = plan_of(ints), model_of(ints, floats)
    for c in range(plan.cables.shape[0] - 1):
        first, last = plan.pieces[c], plan.pieces[c + 1]
        for i in range(3):
            model.beyond[first + c, i] = 0.0
        for p in range(first, last):
            length = model.breaks[p + c + 1] - model.breaks[p + c]
            for i in range(3):
                mean = 0.5 * (model.piece[p, LOAD_LEFT + i] + model.piece[p, LOAD_RIGHT + i])
                model.beyond[p + c + 1, i] = model.beyond[p + c, i] + length * mean


@viewing
def fill(ints: Whole, floats: Floats) -> None:
    """Fills h, load, rest, section, rough and weight for the nodes s as they are."""
    plan = plan_of(ints)
    for c in range(plan.cables.shape[0] - 1):
        for j in range(plan.cables[c], plan.cables[c + 1]):
            fill_span(ints, floats, c, j)


@viewing
def fill_span(ints: Whole, floats: Floats, c: int, j: int) -> None:
    """The same for span j, of cable c."""
    plan, model = plan_of(ints), model_of(ints, floats)
    first, last = plan.first[j], plan.first[j + 1]
    breaks, piece, beyond, load = model.breaks, model.piece, model.beyond, model.load
    p0, p1 = plan.pieces[c], plan.pieces[c + 1] - 1
    end = model.s[last + j]
    p = p0 + find(breaks[p0 + c :], 0, p1 - p0, end) if p1 > p0 else p0
    for i in range(3):
        model.weight[j, i] = load_up_to(piece, breaks, beyond, p, p + c, end, i)  # up to the end, for now
    length = breaks[p1 + c + 1]
    for e in range(first, last):
        a, b = model.s[e + j], model.s[e + j + 1]
        h = b - a
        model.h[e] = h
        middle = 0.5 * (a + b)
        for x in range(3):
            at = a if x == 0 else (middle if x == 1 else b)
            p = p0 + find(breaks[p0 + c :], 0, p1 - p0, at) if p1 > p0 else p0
            for i in range(3):
                load[e, 3 * x + i] = model.weight[j, i] - load_up_to(piece, breaks, beyond, p, p + c, at, i)
        for k in range(plan.points[c], plan.points[c + 1]):
            if middle < model.at[k] < end - 1e-9 * length:
                for x in range(3):
                    for i in range(3):
                        load[e, 3 * x + i] += model.act[k, i]
        p = p0 + find(breaks[p0 + c :], 0, p1 - p0, middle) if p1 > p0 else p0
        if p1 == p0 or (breaks[p + c] <= a + 1e-9 * h and breaks[p + c + 1] >= b - 1e-9 * h):
            within(piece, breaks, p, p + c, middle, model.rest, model.section, e)
            model.rough[e] = 0.0
        else:
            across(piece, breaks, p0, p1, c, a, b, model.rest, model.section, model.rough, e)
    for i in range(3):
        whole = load[first, i]
        model.weight[j, i] = whole


@inline
def within(piece: Floats, breaks: Floats, p: int, o: int, middle: float, rest: Floats, section: Floats, e: int) -> None:
    """Rest curvature and section of element e inside piece p."""
    a, b = breaks[o], breaks[o + 1]
    f = 1.0 / (b - a)
    x = f * (middle - a)
    for i in range(3):
        slope = piece[p, REST_RIGHT + i] - piece[p, REST_LEFT + i]
        rest[e, i], rest[e, 3 + i] = piece[p, REST_LEFT + i] + x * slope, f * slope
        slope = piece[p, K_RIGHT + i] - piece[p, K_LEFT + i]
        section[e, i], section[e, 6 + i] = piece[p, K_LEFT + i] + x * slope, f * slope
        section[e, 3 + i] = piece[p, COMPLIANCE + i]


@viewing(late=types.none)
def across(
    piece: Floats, breaks: Floats, p0: int, p1: int, c: int, a: float, b: float, rest: Floats, section: Floats,
    rough: Floats, e: int,
) -> None:  # fmt: skip
    """The same of an element from a to b with breaks inside: the least-squares lines, and what they leave."""
    h, middle = b - a, 0.5 * (a + b)
    for i in range(6):
        rest[e, i] = 0.0
    for i in range(9):
        section[e, i] = 0.0
    kinks = 0.0
    p = p0 + find(breaks[p0 + c :], 0, p1 - p0, a + 1e-12 * h)
    left = a
    while left < b:
        far = breaks[p + c + 1]
        right = b if p == p1 else min(b, far)
        if right > left:
            d = right - left
            along = far - breaks[p + c]
            x = (0.5 * (left + right) - breaks[p + c]) / along
            off = 0.5 * (left + right) - middle
            for i in range(3):
                slope = (piece[p, REST_RIGHT + i] - piece[p, REST_LEFT + i]) / along
                mean = piece[p, REST_LEFT + i] + x * along * slope
                rest[e, i] += mean * d / h
                rest[e, 3 + i] += 12.0 / h**3 * (mean * d * off + slope * d**3 / 12.0)
                slope = (piece[p, K_RIGHT + i] - piece[p, K_LEFT + i]) / along
                mean = piece[p, K_LEFT + i] + x * along * slope
                section[e, i] += mean * d / h
                section[e, 6 + i] += 12.0 / h**3 * (mean * d * off + slope * d**3 / 12.0)
                section[e, 3 + i] += piece[p, COMPLIANCE + i] * d / h
            if right < b:
                kinks += kink(piece, breaks, p, c, h)
        left = right
        p += 1
    rough[e] = ROUGHNESS * kinks * h**3


@inline
def kink(piece: Floats, breaks: Floats, p: int, c: int, h: float) -> float:
    """[1/m^2]: how sharply the rest curvature turns, or jumps within h, from piece p to the next."""
    total = 0.0
    for i in range(3):
        here = (piece[p, REST_RIGHT + i] - piece[p, REST_LEFT + i]) / (breaks[p + c + 1] - breaks[p + c])
        there = (piece[p + 1, REST_RIGHT + i] - piece[p + 1, REST_LEFT + i]) / (breaks[p + c + 2] - breaks[p + c + 1])
        jump = abs(piece[p + 1, REST_LEFT + i] - piece[p, REST_RIGHT + i]) / h
        total += abs(there - here) + jump
    return total
