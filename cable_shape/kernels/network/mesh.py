"""Where the nodes of a network go: the mesh of a start from nothing, and the one that an error asks for.

A mesh is told by a `Density`, nodes per length along each span, and by how many elements a span gets; `laid_out` makes
the arrays of a network with it, and carries the solutions over.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cable_shape.kernels._jit import kernel
from cable_shape.kernels.network.compiled import inline, viewing
from cable_shape.kernels.network.guess import bend_of, end_frame, length_of
from cable_shape.kernels.network.material import add_up, fill
from cable_shape.kernels.network.tables import (
    GRIP,
    HEAD,
    NOW,
    TRIAL,
    Floats,
    Model,
    Plan,
    Solution,
    Whole,
    copy,
    copy_rows,
    model_of,
    model_size,
    plan_of,
    solution_of,
    solution_size,
    work_size,
)
from cable_shape.kernels.rod_algebra import add, dot, get3, get4, qnormal, subtract
from cable_shape.kernels.rod_guess import hanging_force, tangent
from cable_shape.kernels.rod_mesh import equidistribute, indicated, layered

#: Points at which the density of a span's first mesh is given.
ABSCISSAE = 65
#: Elements of a cable between two grips, of a span between knots, and of a whole network.
FEWEST, FEWEST_OF_SPAN, MOST = 8, 4, 1200
#: A network of many spans may have so many elements a span.
MOST_OF_SPAN = 24
#: A new mesh aims at this fraction of the tolerance, and at elements that turn by so much [rad].
AIM, TURN_AIM = 0.9, 0.55
#: A mesh is changed at most as for an error so many times off.
MOST_EXCESS = 700.0
ROOM = 11  # numbers of scratch for `span_layers`


class Density(NamedTuple):
    """How dense the nodes of every span are."""

    at: Whole  # (m+1,) first row of each span in the next two
    x: Floats  # arc lengths [m]
    density: Floats  # there, linear in between; only ratios count
    share: Floats  # (m,) elements that each span asks for


@kernel
def wish_first(ints: Whole, floats: Floats, sols: Floats, finer: float, turn: float) -> Density:
    """A cold start's mesh: half of each span's nodes within a few boundary layers of its ends.

    From the trial's knots and known forces, on whatever mesh. finer: so many times the usual number of elements. turn
    [rad]: how far the frames turn along the cable, as far as that is known.
    """
    spans = ints[1]
    at = np.empty(spans + 1, np.int64)
    for j in range(spans + 1):
        at[j] = ABSCISSAE * j
    x, density, share = np.empty(ABSCISSAE * spans), np.empty(ABSCISSAE * spans), np.empty(spans)
    span_layers(ints, floats, sols, share, np.empty(ROOM))
    for j in range(spans):
        a, b = span_between(ints, floats, j)
        layer, length = share[j], b - a
        own = x[at[j] : at[j + 1]]
        layered(length, min(max(layer, 1e-5 * length), length), own, density[at[j] : at[j + 1]])
        for i in range(ABSCISSAE):
            own[i] += a
        own[ABSCISSAE - 1] = b
        if spans == 1:
            usual = 18 if layer > 0.08 * length else 20 if layer > 0.02 * length else 30
            share[j] = min(MOST, max(math.ceil(usual * finer), math.ceil(1.3 * turn / TURN_AIM)))
        else:
            usual = 5 if layer > 0.3 * length else 8 if layer > 0.1 * length else 12 if layer > 0.02 * length else 22
            share[j] = usual * finer
    return Density(at, x, density, share)


@viewing
def span_between(ints: Whole, floats: Floats, j: int) -> tuple[float, float]:
    """Arc lengths at which span j begins and ends."""
    plan, model = plan_of(ints), model_of(ints, floats)
    return float(model.s[plan.first[j] + j]), float(model.s[plan.first[j + 1] + j])


@viewing
def span_layers(ints: Whole, floats: Floats, sols: Floats, layers: Floats, small: Floats) -> None:
    """Fills layers (m,) [m] with the length over which an end of each span bends; small (ROOM,): scratch."""
    plan, model, sol = plan_of(ints), model_of(ints, floats), solution_of(ints, sols, TRIAL)
    for j in range(layers.shape[0]):
        layers[j] = layer_of(plan, model, sol, j, small)


@viewing(forceinline=True)
def layer_of(plan: Plan, model: Model, sol: Solution, j: int, small: Floats) -> float:
    """That of span j."""
    length, bend = length_of(plan, model, j), bend_of(plan, model, j)
    if plan.known[j] != 0:
        n = get3(sol.lam, j)
        more = add(n, get3(model.weight, j))
        tension = math.sqrt(max(dot(n, n), dot(more, more)))
        return math.sqrt(bend / max(tension, 1e-9 * bend / length**2))
    force, held, load, span = small[0:3], small[3:5], small[5:8], small[8:11]
    chord = subtract(get3(sol.pose, plan.ends[j, 1]), get3(sol.pose, plan.ends[j, 0]))
    first = last = (0.0, 0.0, 1.0)
    held[:] = 0.0
    if plan.known.shape[0] == 1:  # bent ends take up length, and tighten what is nearly taut
        first, last = tangent(end_frame(plan, model, sol, j, 0)), tangent(end_frame(plan, model, sol, j, 1))
        for end in range(2):
            held[end] = 1.0 - model.free[j, end, 0]
    for i in range(3):
        span[i], load[i] = chord[i], model.weight[j, i] / length
    return float(hanging_force(span, load, length, model.section[plan.first[j], 5], bend, first, last, held, force))


@kernel
def wish_next(ints: Whole, floats: Floats, sols: Floats, excess: float) -> Density:
    """What the last solution's errors ask for: one share for all elements. excess: by which factor they miss their aim.

    A span's own share of the error is what `rod_mesh.indicated` is told of it.
    """
    n, spans = ints[0], ints[1]
    at = np.empty(spans + 1, np.int64)
    x, density, share = np.empty(n + 2 * spans), np.empty(n + 2 * spans), np.empty(spans)
    wish_spans(ints, floats, sols, min(max(excess, 1.0 / MOST_EXCESS), MOST_EXCESS), at, x, density, share)
    return Density(at, x, density, share)


@viewing
def wish_spans(
    ints: Whole, floats: Floats, sols: Floats, excess: float, at: Whole, x: Floats, density: Floats, share: Floats
) -> None:
    """`wish_next` into these arrays."""
    plan, model, sol = plan_of(ints), model_of(ints, floats), solution_of(ints, sols, NOW)
    worst = whole = 0.0
    for e in range(model.h.shape[0]):
        worst, whole = max(worst, model.errors[e]), whole + model.errors[e]
    if not math.isfinite(whole):
        worst, whole = 1.0, 1.0 * model.h.shape[0]
        model.errors[:] = 1.0
    at[0] = 0
    for j in range(share.shape[0]):
        a, b = plan.first[j], plan.first[j + 1]
        at[j + 1] = at[j] + b - a + 2
        most = own = part = 0.0
        for e in range(a, b):
            most, own = max(most, model.errors[e]), own + model.errors[e]
        if most > 0.0:
            part = excess * model.h.shape[0] * worst / whole * (most / worst) ** (6.0 / 7.0) * own / ((b - a) * most)
        share[j] = indicated(
            model.s[a + j : b + j + 1], sol.q[a + j : b + j + 1], model.errors[a:b], part, TURN_AIM,
            x[at[j] : at[j + 1]], density[at[j] : at[j + 1]],
        )  # fmt: skip


@kernel
def counts_of(ints: Whole, floats: Floats, share: Floats, finer: float, stops: Floats) -> Whole:
    """Elements of each span (m,), `finer` times what it asks for, none too few for the stops inside."""
    out = np.empty(share.shape[0], np.int64)
    for j in range(share.shape[0]):
        a, b = span_between(ints, floats, j)
        least = FEWEST if share.shape[0] == 1 else FEWEST_OF_SPAN
        for stop in stops:
            if a < stop < b:
                least += 2
        out[j] = max(math.ceil(finer * share[j]), least)
    return out


@kernel
def next_counts(ints: Whole, floats: Floats, share: Floats, stops: Floats, finer: bool) -> Whole:
    """Elements of each span for what `wish_next` asks; none at all if they should be finer and there are too many."""
    n, spans = ints[0], share.shape[0]
    most = max(MOST, MOST_OF_SPAN * spans)
    out, asked = counts_of(ints, floats, share, 1.0, stops), 0.0
    for j in range(spans):
        asked += share[j]
    if finer:
        if n >= most:
            return out[:0]
        if all_of(out) < n + max(1, n // 20):
            out = counts_of(ints, floats, share, (n + max(1.0, 0.05 * n)) / asked, stops)
    if all_of(out) > most:
        out = counts_of(ints, floats, share, (most - spans) / asked, stops)
    return out


@kernel(inline="always")
def all_of(counts: Whole) -> int:
    """Their sum."""
    total = 0
    for count in counts:
        total += count
    return total


Arrays = tuple[Whole, Floats, Floats, Floats]


@kernel
def laid_out(
    bare: Whole, held: Floats, ints: Whole, floats: Floats, sols: Floats, counts: Whole, stops: Floats, wish: Density
) -> Arrays:
    """Plan, model, solutions and work space of a network with `counts` (m,) elements in its spans, see `wish`.

    bare, held: plan and model of the same network on any mesh; ints, floats, sols: mesh and solutions to be carried
    over, of as many spans and knots. stops: ascending arc lengths inside spans that are nodes.
    """
    new = np.empty(bare.shape[0] - bare[0] + all_of(counts), np.int64)
    recount(bare, counts, new)
    model = np.zeros(model_size(new))
    solutions, space = np.zeros(3 * solution_size(new)), np.zeros(work_size(new))
    copy_model(bare, held, new, model)
    put_nodes(new, model, stops, wish.at, wish.x, wish.density)
    add_up(new, model)
    fill(new, model)
    carry_over(ints, floats, sols, new, model, solutions)
    return new, model, solutions, space


@viewing
def recount(ints: Whole, counts: Whole, new: Whole) -> None:
    """Fills a new plan: the same, with so many elements in its spans."""
    spans = counts.shape[0]
    copy(new[:HEAD], ints[:HEAD])
    total = 0
    new[HEAD] = 0
    for j in range(spans):
        total += counts[j]
        new[HEAD + 1 + j] = total
    new[0] = total
    to = HEAD + spans + 1
    e = 0
    for j in range(spans):
        for _ in range(counts[j]):
            new[to + e] = e + j
            e += 1
    copy(new[to + total :], ints[to + ints[0] :])


@viewing
def copy_model(ints: Whole, floats: Floats, new_ints: Whole, new: Floats) -> None:
    """Copies what is not of the mesh."""
    a, b = model_of(new_ints, new), model_of(ints, floats)
    copy(a.par, b.par)
    copy(a.breaks, b.breaks)
    copy(a.at, b.at)
    copy(a.friction, b.friction)
    copy(a.draw, b.draw)
    copy_rows(a.loose, b.loose, 3)
    copy_rows(a.force, b.force, 3)
    copy_rows(a.moment, b.moment, 3)
    copy_rows(a.heavy, b.heavy, 3)
    copy_rows(a.piece, b.piece, b.piece.shape[1])
    copy_rows(a.act, b.act, 3)
    for j in range(a.free.shape[0]):
        copy_rows(a.free[j], b.free[j], 3)
        copy_rows(a.frame[j], b.frame[j], 4)


@viewing
def put_nodes(ints: Whole, floats: Floats, stops: Floats, at: Whole, x: Floats, density: Floats) -> None:
    """Fills s with nodes of equal share of the density of each span."""
    plan, model = plan_of(ints), model_of(ints, floats)
    for j in range(plan.ends.shape[0]):
        a, b = at[j], at[j + 1]
        low = high = 0
        for i in range(stops.shape[0]):
            low += stops[i] <= x[a]
            high += stops[i] < x[b - 1]
        first, last = plan.first[j], plan.first[j + 1]
        equidistribute(
            x[a:b], density[a:b], stops[low : max(low, high)], last - first, model.s[first + j : last + j + 1]
        )  # fmt: skip


@viewing
def carry_over(ints: Whole, floats: Floats, sols: Floats, new_ints: Whole, new: Floats, new_sols: Floats) -> None:
    """Fills all three solutions of another mesh: rotations linear between nodes, the rest as it is."""
    plan, own = plan_of(ints), plan_of(new_ints)
    s, at = model_of(ints, floats).s, model_of(new_ints, new).s
    for which in range(3):
        was, now = solution_of(ints, sols, which), solution_of(new_ints, new_sols, which)
        for j in range(plan.ends.shape[0]):
            k, last = plan.first[j] + j, plan.first[j + 1] + j
            sign = 1.0
            for i in range(own.first[j] + j, own.first[j + 1] + j + 1):
                while k < last - 1 and at[i] >= s[k + 1]:
                    sign = sign * next_sign(was.q, k)
                    k += 1
                y = min(max((at[i] - s[k]) / (s[k + 1] - s[k]), 0.0), 1.0)
                y, z = sign * (1.0 - y), sign * next_sign(was.q, k) * y
                p, r = get4(was.q, k), get4(was.q, k + 1)
                mean = (
                    y * p[0] + z * r[0], y * p[1] + z * r[1], y * p[2] + z * r[2], y * p[3] + z * r[3]
                )  # fmt: skip
                if mean != (0.0, 0.0, 0.0, 0.0):
                    mean = qnormal(mean)
                now.q[i, 0], now.q[i, 1], now.q[i, 2], now.q[i, 3] = mean
        copy_rows(now.lam, was.lam, 3)
        copy_rows(now.pose, was.pose, 7)
        copy(now.arc, was.arc)
        copy_rows(now.grip, was.grip, GRIP)
        copy(now.turns, was.turns)


@inline
def next_sign(q: Floats, k: int) -> float:
    """1, or -1 where the quaternion of the next node has the other sign."""
    cosine = q[k, 0] * q[k + 1, 0] + q[k, 1] * q[k + 1, 1] + q[k, 2] * q[k + 1, 2] + q[k, 3] * q[k + 1, 3]
    return 1.0 if cosine >= 0.0 else -1.0


@viewing
def take_over(bare: Whole, held: Floats, ints: Whole, floats: Floats) -> None:
    """Makes what is not of the mesh that of another model of the same network."""
    copy_model(bare, held, ints, floats)
    add_up(ints, floats)
    fill(ints, floats)


@kernel
def neighbours(bare: Whole, held: Floats, ints: Whole, floats: Floats, before: Floats, after: Floats) -> Floats:
    """Models (c, size) of changed cables on a mesh, as far as the gradient depends on them.

    held (c, size): models of the changed cables with one element a span. before (a,), after (c, a) [m]: ascending arc
    lengths on the mesh, and where they are on the changed cables; nodes stay in between.
    """
    out = np.empty((held.shape[0], floats.shape[0]))
    for c in range(held.shape[0]):
        one_neighbour(bare, held[c], ints, floats, before, after[c], out[c])
    return out


@viewing
def one_neighbour(
    bare: Whole, held: Floats, ints: Whole, floats: Floats, before: Floats, after: Floats, out: Floats
) -> None:
    """Fills one row of `neighbours`."""
    copy(out, floats)
    copy_model(bare, held, ints, out)
    copy(model_of(ints, out).par, model_of(ints, floats).par)
    move_nodes(ints, floats, before, after, out)


@viewing
def move_nodes(ints: Whole, floats: Floats, before: Floats, after: Floats, out: Floats) -> None:
    """Puts the nodes of another model of the network where those of `floats` go as `before` (a,) goes to `after`."""
    own, s = model_of(ints, out), model_of(ints, floats).s
    for k in range(s.shape[0]):
        i = 0
        while i < before.shape[0] - 2 and s[k] > before[i + 1]:
            i += 1
        own.s[k] = after[i] + (s[k] - before[i]) / (before[i + 1] - before[i]) * (after[i + 1] - after[i])
    add_up(ints, out)
    fill(ints, out)
