"""The network of cables in contact, laid: every contact divides the stretch of cable that it is on into two spans.

Knots that the network has without contacts come first, then contacts, along the cables. The force of a span beside a
contact is a vertex of the graph, too, see `network.graph.scatter_force`. Vertices are eliminated in the order of the
knots that are no contacts (`Net.rank`), those on a stretch just before the later one of its two, from the earlier one
on: place, rotation, force behind. On a tree nothing fills in by that.
"""

from __future__ import annotations

from cable_shape.checks import Array
from cable_shape.kernels._jit import kernel
from cable_shape.kernels.contact.knots import mesh
from cable_shape.kernels.contact.near import BARE, LINK, NONE, is_knot
from cable_shape.kernels.contact.tables import Lying, Net
from cable_shape.kernels.network.compiled import inline, part, viewing
from cable_shape.kernels.network.sliding import FIRST_PRESSED
from cable_shape.kernels.network.tables import (
    HEAD,
    LENGTH,
    LINK_PLAN,
    N_BLOCKS,
    N_CABLES,
    N_ELEMENTS,
    N_KNOTS,
    N_LINKS,
    N_PRESSED,
    N_RINGS,
    N_SPANS,
    N_STRIPPED,
    N_TARGETS,
    N_VERTICES,
    UNKNOWN,
    Floats,
    Plan,
    Whole,
    copy,
    copy_rows,
    model_of,
    model_size,
    plan_of,
    solution_size,
    work_size,
)
from cable_shape.kernels.rod_algebra import add, get3, put3, put9
from cable_shape.kernels.rod_element import IDENTITY

IDENTITY_FRAME = (0.0, 0.0, 0.0, 1.0)

#: Of a span, between what is unknown of its ends and its force, and of a contact that it ends at; and of a link.
EDGES, EDGES_OF_LINK = 7, 6
SNARL = 16  # links that may all hang together


@kernel
def room_for(bare: Whole, elements: int, wide: int, links: int) -> tuple[int, int, int, int, int, int]:
    """Numbers of plan, model, one solution, work space, eyelets and scratch where every node of a mesh may be a knot.

    wide: how many vertices beyond the two next ones an elimination may join with one; links: pairs of cables that may
    press on each other.
    """
    head = bare[:HEAD].copy()
    n, m, k = elements, elements, bare[N_KNOTS] + elements - bare[N_SPANS]
    v = 2 * k + m + links
    head[N_LINKS] = links
    head[N_ELEMENTS], head[N_SPANS], head[N_KNOTS], head[N_VERTICES], head[N_PRESSED] = n, m, k, v, k
    head[N_BLOCKS] = blocks_of(wide, v, links)
    head[N_TARGETS] = (2 + wide) * (3 + wide) // 2 * v + 25 * links * min(links, SNARL) ** 2
    e = head[N_RINGS]
    own = HEAD + n + 23 * m + 2 * k + 3 * v + head[N_BLOCKS] + head[N_TARGETS] + 2 * head[N_STRIPPED]
    own += 5 * head[N_CABLES] + 2 * e + 6 + LINK_PLAN * links
    run = e * (12 * n + 9 * m + 6 * k + 3 * e + 2) + 4 * n + 14 * m + 3 * k if e > 0 else 0
    room = 2 + 2 * k + 3 * EDGES * m + 3 * EDGES_OF_LINK * links + 5 * v + k
    return own, model_size(head), solution_size(head), work_size(head), run, room


@viewing
def blocks_of(wide: int, vertices: int, links: int) -> int:
    """How many blocks there is room for: what links join is joined with all of that at the end.

    More than SNARL links must follow each other along their cables.
    """
    return (2 + wide) * vertices + 25 * links * min(links, SNARL)


@viewing
def is_same(net: Net, held: Whole, on: Array) -> bool:
    """Whether the contacts are those of the network as it is laid."""
    if net.ints[N_CABLES] == 0:
        return False
    plan = plan_of(net.bare)
    i, knots = net.bare[N_KNOTS], net.ints[N_KNOTS]
    for c in range(plan.cables.shape[0] - 1):
        for j in range(plan.cables[c] + c, plan.cables[c + 1] + c):
            for k in range(held[j] + 1, held[j + 1]):
                if is_knot(on, k):
                    if i >= knots or net.where[i] != k:
                        return False
                    i += 1
    return i == knots


@viewing
def divide(net: Net, held: Whole, on: Array) -> tuple[int, int]:
    """Finds contacts and spans: fills where, span, cable, stretch and piece; returns the numbers of knots and spans."""
    plan = plan_of(net.bare)
    known = net.bare[N_KNOTS]
    i, x = known, 0
    for k in range(known):
        net.where[k] = -1
    for c in range(plan.cables.shape[0] - 1):
        for j in range(plan.cables[c], plan.cables[c + 1]):
            for end in range(2):
                if plan.tied[j, end] != 0 and plan.turned[j, end] == 0:
                    net.where[plan.ends[j, end]] = held[j + c + end]
            net.piece[j] = x
            for k in range(held[j + c] + 1, held[j + c + 1]):
                if is_knot(on, k):
                    net.where[i], net.span[i] = k, x
                    net.cable[x], net.stretch[x] = c, j
                    i += 1
                    x += 1
            net.cable[x], net.stretch[x] = c, j
            x += 1
            net.piece[j + 1] = x
    return i, x


@viewing
def end_of(net: Net, old: Plan, x: int, end: int) -> int:
    """The knot at an end of span x."""
    j = net.stretch[x]
    if end == 0:
        return old.ends[j, 0] if x == net.piece[j] else contact_before(net, x)
    return old.ends[j, 1] if x + 1 == net.piece[j + 1] else contact_before(net, x + 1)


@viewing
def contact_before(net: Net, x: int) -> int:
    """The contact at which span x begins: contacts are as many as spans that do not begin a stretch."""
    return net.bare[N_KNOTS] + x - 1 - net.stretch[x]


@viewing
def strip_leaves(net: Net, old: Plan, spans: int, loose: Whole, stripped: Whole) -> int:
    """Spans beyond which nothing holds a place, now that contacts hold some; returns how many.

    loose (k,): takes how many other spans there are at each knot, 0: its place follows. stripped (2 r,): as in `Plan`.
    """
    for i in range(loose.shape[0]):
        loose[i] = 0
    for x in range(spans):
        loose[end_of(net, old, x, 0)] += 1
        loose[end_of(net, old, x, 1)] += 1
    count = 0
    for i in range(old.stripped.shape[0]):
        j, end = old.stripped[i, 0], old.stripped[i, 1]
        if loose[old.ends[j, end]] != 1:
            continue
        x = net.piece[j] if end == 0 else net.piece[j + 1] - 1
        loose[end_of(net, old, x, 0)] -= 1
        loose[end_of(net, old, x, 1)] -= 1
        stripped[2 * count], stripped[2 * count + 1] = x, end
        count += 1
    at = 0
    for j in range(net.tour.shape[0]):
        if not any_stripped(net, stripped, count, j):
            net.tour[at] = 1 + j
            at += 1
    for i in range(count - 1, -1, -1):
        j = net.stretch[stripped[2 * i]]
        net.tour[at] = 1 + j if stripped[2 * i + 1] == 1 else -1 - j
        at += 1
    return count


@viewing
def any_stripped(net: Net, stripped: Whole, count: int, j: int) -> bool:
    """Whether a span of stretch j is stripped."""
    found = 0
    for i in range(count):
        found += net.stretch[stripped[2 * i]] == j
    return found > 0


@viewing
def number(net: Net, old: Plan, plan: Plan, on: Array, loose: Whole, forces: Whole) -> int:
    """Numbers the vertices in the order of elimination; returns how many there are. forces (m,): of the spans.

    Contacts that belong to links come last: then stretches hang together by them alone.
    """
    v = 0
    for x in range(forces.shape[0]):
        forces[x] = -1
    for knot in net.order:
        for j in range(old.ends.shape[0]):
            a, b = old.ends[j, 0], old.ends[j, 1]
            first, last = net.piece[j], net.piece[j + 1]
            if last == first + 1 or knot != (b if net.rank[a] <= net.rank[b] else a) or any_linked(net, plan, on, j):
                continue
            v = number_piece(plan, first, last, knot == b, forces, v)
        plan.vertices[knot, 0] = plan.vertices[knot, 1] = -1
        if loose[knot] > 0 and net.moves[knot] != 0:
            plan.vertices[knot, 1] = v
            v += 1
        if old.vertices[knot, 0] >= 0:
            plan.vertices[knot, 0] = v
            v += 1
    if plan.links.shape[0] == 0:
        return v
    for j in range(old.ends.shape[0]):
        if not any_linked(net, plan, on, j):
            continue
        first = net.piece[j]
        for x in range(first, net.piece[j + 1]):
            if x + 1 == net.piece[j + 1] or is_linked(net, on, plan.ends[x, 1]):
                forward = x + 1 < net.piece[j + 1] or not is_linked(net, on, plan.ends[first, 0])
                v = number_piece(plan, first, x + 1, forward, forces, v)
                first = x + 1
    for i in range(plan.links.shape[0]):
        for side in range(2):
            knot = plan.links[i, side]
            plan.vertices[knot, 1], plan.vertices[knot, 0] = v, v + 1
            v += 2
        plan.links[i, 2] = v
        v += 1
    return v


@viewing
def find_links(net: Net, plan: Plan, on: Array) -> None:
    """Fills the knots of the links."""
    for i in range(net.bare[N_KNOTS], plan.vertices.shape[0]):
        which = on[net.where[i], LINK]
        if which != BARE:
            plan.links[which // 2, which % 2] = i


@viewing
def is_linked(net: Net, on: Array, knot: int) -> bool:
    """Whether a knot belongs to a link."""
    return bool(knot >= net.bare[N_KNOTS] and on[net.where[knot], LINK] != BARE)


@viewing
def any_linked(net: Net, plan: Plan, on: Array, j: int) -> bool:
    """Whether any contact on stretch j belongs to a link."""
    found = 0
    if plan.links.shape[0] > 0:
        for x in range(net.piece[j], net.piece[j + 1] - 1):
            found += is_linked(net, on, plan.ends[x, 1])
    return found > 0


@viewing
def number_piece(plan: Plan, first: int, last: int, forward: bool, forces: Whole, v: int) -> int:
    """Numbers forces of spans first to last - 1 and the contacts between them, from the one end or the other."""
    for i in range(last - first):
        x = first + i if forward else last - 1 - i
        if plan.known[x] == 0:
            forces[x] = v
            v += 1
        if i + 1 < last - first:
            contact = plan.ends[x, 1 if forward else 0]
            plan.vertices[contact, 1], plan.vertices[contact, 0] = v, v + 1
            v += 2
    return v


@inline
def join(heads: Whole, edges: Whole, count: int, a: int, b: int) -> int:
    """Puts down that two vertices have a block, if both are there: at the one that is eliminated first."""
    if a < 0 or b < 0:
        return count
    first = min(a, b)
    edges[2 * count], edges[2 * count + 1] = max(a, b), heads[first]
    heads[first] = count
    return count + 1


@viewing
def join_all(plan: Plan, known: int, forces: Whole, heads: Whole, edges: Whole) -> None:
    """The blocks that contacts (the knots from `known` on) and spans make, as lists.

    heads (v,): first edge of a vertex; edges (2 e,): of each the later vertex, and the next edge of the earlier one.
    """
    count = 0
    for i in range(known, plan.vertices.shape[0]):
        count = join(heads, edges, count, plan.vertices[i, 0], plan.vertices[i, 1])
    for x in range(plan.ends.shape[0]):
        ta, ya, tb, yb = plan.corners[x, 0], plan.corners[x, 1], plan.corners[x, 2], plan.corners[x, 3]
        force = forces[x]
        count = join(heads, edges, count, ta, tb)
        if force >= 0:
            for other in (ta, ya, tb, yb):
                count = join(heads, edges, count, force, other)
        else:
            count = join(heads, edges, count, ta, ya)
            for a, b in ((ta, yb), (ya, tb), (ya, yb), (tb, yb)):
                count = join(heads, edges, count, a, b)
    for i in range(plan.links.shape[0]):
        a, b, push = plan.links[i, 0], plan.links[i, 1], plan.links[i, 2]
        count = join(heads, edges, count, plan.vertices[a, 1], push)
        count = join(heads, edges, count, plan.vertices[b, 1], push)
        for x in range(2):
            for y in range(2):
                count = join(heads, edges, count, plan.vertices[a, x], plan.vertices[b, y])


@viewing
def eliminate(plan: Plan, heads: Whole, edges: Whole, seen: Whole, child: Whole, after: Whole) -> int:
    """Fills pointer and neighbour: of each vertex those later ones that it has a block with when it is eliminated.

    They are those of its own blocks, and of the vertices of which it is the first neighbour. Returns how many there
    are; -1: more than there is room for.
    """
    at = 0
    room = plan.neighbour.shape[0]
    vertices = plan.pointer.shape[0] - 1
    for v in range(vertices):
        if at + vertices - v > room:
            return -1
        plan.pointer[v] = at
        edge = heads[v]
        while edge >= 0:
            at = note(plan, seen, at, v, edges[2 * edge])
            edge = edges[2 * edge + 1]
        before = child[v]
        while before >= 0:
            for i in range(plan.pointer[before], plan.pointer[before + 1]):
                at = note(plan, seen, at, v, plan.neighbour[i])
            before = after[before]
        for i in range(plan.pointer[v] + 1, at):
            other, k = plan.neighbour[i], i
            while k > plan.pointer[v] and plan.neighbour[k - 1] > other:
                plan.neighbour[k] = plan.neighbour[k - 1]
                k -= 1
            plan.neighbour[k] = other
        plan.pointer[v + 1] = at
        if at > plan.pointer[v]:
            parent = plan.neighbour[plan.pointer[v]]
            after[v] = child[parent]
            child[parent] = v
    return at


@inline
def note(plan: Plan, seen: Whole, at: int, v: int, other: int) -> int:
    """Makes a later vertex a neighbour of v, unless it is one."""
    if other == v or seen[other] == v:
        return at
    seen[other] = v
    plan.neighbour[at] = other
    return at + 1


@viewing
def block_of(plan: Plan, a: int, b: int) -> int:
    """Where the block of rows a and columns b is; -1 - that, if only its transpose is; 0 if there is none."""
    if a < 0 or b < 0:
        return 0
    v, other = min(a, b), max(a, b)
    for i in range(plan.pointer[v], plan.pointer[v + 1]):
        if plan.neighbour[i] == other:
            return i if a < b else -1 - i
    return 0


@viewing
def lay(net: Net, lying: Lying, on: Array) -> bool:
    """Fills plan and model but for the mesh's arc lengths, for these contacts; False if there is no room."""
    bare, ints, room = net.bare, net.ints, net.room
    old = plan_of(bare)
    knots, spans = divide(net, lying.held, on)
    copy(ints[:HEAD], bare[:HEAD])
    ints[N_ELEMENTS], ints[N_SPANS], ints[N_KNOTS], ints[N_PRESSED] = lying.errors.shape[0], spans, knots, knots
    ints[N_VERTICES] = ints[N_BLOCKS] = ints[N_TARGETS] = 0
    ints[N_LINKS], ints[FIRST_PRESSED] = lying.pairs.shape[0], bare[N_KNOTS]
    used = knots + 2 * old.stripped.shape[0]
    loose, stripped, forces = part(room, 0, (knots,)), part(room, knots, (used - knots,)), part(room, used, (spans,))
    count = strip_leaves(net, old, spans, loose, stripped)
    ints[N_STRIPPED], ints[UNKNOWN] = count, 3 * (spans - count)
    plan = plan_of(ints)
    fill_spans(net, old, plan, lying.held)
    for i in range(count):
        plan.known[stripped[2 * i]] = 1
    find_links(net, plan, on)
    vertices = ints[N_VERTICES] = number(net, old, plan, on, loose, forces)
    fill_corners(plan)
    used += spans
    for i in range(4 * vertices):
        room[used + i] = -1
    heads, seen = part(room, used, (vertices,)), part(room, used + vertices, (vertices,))
    child, after = part(room, used + 2 * vertices, (vertices,)), part(room, used + 3 * vertices, (vertices,))
    edges = part(room, used + 4 * vertices, (2 * (EDGES * spans + EDGES_OF_LINK * plan.links.shape[0]),))
    join_all(plan, bare[N_KNOTS], forces, heads, edges)
    ints[N_BLOCKS] = blocks_of(net.wide, vertices, plan.links.shape[0])
    blocks = eliminate(plan_of(ints), heads, edges, seen, child, after)
    if blocks < 0:
        return False
    ints[N_BLOCKS] = blocks
    ints[N_TARGETS] = targets_of(plan_of(ints))
    plan = plan_of(ints)
    fill_targets(plan)
    for i in range(count):
        plan.stripped[i, 0], plan.stripped[i, 1] = stripped[2 * i], stripped[2 * i + 1]
    for x in range(spans):
        plan.forces[x, 0] = forces[x]
    fill_blocks(plan)
    fill_cables(net, old, plan)
    take_over(net, lying.s)
    return True


@viewing
def fill_spans(net: Net, old: Plan, plan: Plan, held: Whole) -> None:
    """Elements, knots and ties of the spans."""
    plan.first[0] = 0
    known = net.bare[N_KNOTS]
    for x in range(plan.ends.shape[0]):
        j, c = net.stretch[x], net.cable[x]
        for end in range(2):
            knot = end_of(net, old, x, end)
            plan.ends[x, end] = knot
            plan.tied[x, end] = old.tied[j, end] if knot < known else 1
            plan.turned[x, end] = old.turned[j, end] if knot < known else 0
        knot = plan.ends[x, 1]
        plan.first[x + 1] = (net.where[knot] if knot >= known else held[j + c + 1]) - c
        for e in range(plan.first[x], plan.first[x + 1]):
            plan.left[e] = e + x
        plan.known[x] = 0
    for i in range(known, plan.vertices.shape[0]):
        plan.vertices[i, 0] = plan.vertices[i, 1] = -1


@viewing
def fill_corners(plan: Plan) -> None:
    """The vertices of the ends of spans."""
    for x in range(plan.ends.shape[0]):
        for end in range(2):
            knot = plan.ends[x, end]
            plan.corners[x, 2 * end] = plan.vertices[knot, 0] if plan.tied[x, end] != 0 else -1
            plan.corners[x, 2 * end + 1] = plan.vertices[knot, 1] if plan.known[x] == 0 else -1


@viewing
def targets_of(plan: Plan) -> int:
    """How many pairs of neighbours there are."""
    count = 0
    for v in range(plan.pointer.shape[0] - 1):
        own = plan.pointer[v + 1] - plan.pointer[v]
        count += own * (own + 1) // 2
    return count


@viewing
def fill_targets(plan: Plan) -> None:
    """Where pairs of neighbours of each vertex are updated."""
    t = 0
    for v in range(plan.pointer.shape[0] - 1):
        plan.goal[v] = t
        for a in range(plan.pointer[v], plan.pointer[v + 1]):
            for b in range(a, plan.pointer[v + 1]):
                x, y = plan.neighbour[a], plan.neighbour[b]
                plan.target[t] = -1 - x if x == y else block_of(plan, x, y)
                t += 1
    plan.goal[plan.pointer.shape[0] - 1] = t


@viewing
def fill_blocks(plan: Plan) -> None:
    """Where the blocks of spans and links are."""
    for x in range(plan.ends.shape[0]):
        ta, ya, tb, yb = plan.corners[x, 0], plan.corners[x, 1], plan.corners[x, 2], plan.corners[x, 3]
        force, knot = plan.forces[x, 0], plan.ends[x, 1]
        plan.blocks[x, 1] = block_of(plan, ta, tb)
        if force >= 0 or plan.known[x] != 0:  # see `network.graph.press`
            plan.blocks[x, 5] = block_of(plan, plan.vertices[knot, 1], plan.vertices[knot, 0])
        if force >= 0:  # see `network.graph.scatter_force`
            plan.forces[x, 1], plan.forces[x, 2] = block_of(plan, ta, force), block_of(plan, ya, force)
            plan.forces[x, 3], plan.forces[x, 4] = block_of(plan, force, tb), block_of(plan, force, yb)
        elif plan.known[x] == 0:
            plan.blocks[x, 0], plan.blocks[x, 2] = block_of(plan, ta, ya), block_of(plan, ta, yb)
            plan.blocks[x, 3], plan.blocks[x, 4] = block_of(plan, ya, tb), block_of(plan, ya, yb)
            plan.blocks[x, 5] = block_of(plan, tb, yb)
    for i in range(plan.links.shape[0]):  # see `network.graph.tie`
        a, b, push = plan.links[i, 0], plan.links[i, 1], plan.links[i, 2]
        ta, ya, tb, yb = plan.vertices[a, 0], plan.vertices[a, 1], plan.vertices[b, 0], plan.vertices[b, 1]
        plan.links[i, 3], plan.links[i, 4] = block_of(plan, ta, ya), block_of(plan, ta, tb)
        plan.links[i, 5], plan.links[i, 6] = block_of(plan, ta, yb), block_of(plan, ya, tb)
        plan.links[i, 7], plan.links[i, 8] = block_of(plan, ya, yb), block_of(plan, tb, yb)
        plan.links[i, 9], plan.links[i, 10] = block_of(plan, ya, push), block_of(plan, yb, push)


@viewing
def fill_cables(net: Net, old: Plan, plan: Plan) -> None:
    """Which spans, pieces, point loads and eyelets are of which cable."""
    for c in range(plan.cables.shape[0]):
        plan.cables[c] = net.piece[old.cables[c]]
        plan.pieces[c], plan.points[c] = old.pieces[c], old.points[c]
    for c in range(plan.roll.shape[0]):
        plan.roll[c, 0], plan.roll[c, 1] = old.roll[c, 0], old.roll[c, 1]
    for i in range(plan.rings.shape[0]):
        plan.rings[i, 0] = old.rings[i, 0]
        plan.rings[i, 1] = net.piece[old.rings[i, 1] + 1] - 1


@viewing
def take_over(net: Net, s: Array) -> None:
    """Fills what of the model is not of the mesh."""
    old, model, plan = model_of(net.bare, net.made), model_of(net.ints, net.floats), plan_of(net.ints)
    known = net.bare[N_KNOTS]
    copy(model.par, old.par)
    copy_cable(net, net.made, s, net.floats)
    for i in range(model.force.shape[0]):
        for c in range(3):
            model.loose[i, c] = old.loose[i, c] if i < known else 1.0
        put9(model.along, i, 0, IDENTITY)
        for c in range(9):
            model.bent[i, c] = 0.0
        for c in range(6):
            model.lean[i, c] = 0.0
        put3(model.given, i, 0, NONE)
    for i in range(model.links.shape[0]):
        for c in range(model.links.shape[1]):
            model.links[i, c] = 0.0
    for x in range(model.free.shape[0]):
        j = net.stretch[x]
        for end in range(2):
            own = plan.ends[x, end] < known
            for c in range(3):
                model.free[x, end, c] = old.free[j, end, c] if own else 0.0
            for c in range(4):
                model.frame[x, end, c] = old.frame[j, end, c] if own else IDENTITY_FRAME[c]


@viewing
def copy_cable(net: Net, made: Floats, s: Array, floats: Floats) -> None:
    """Copies what the cables are made of and loaded with into a model."""
    old, model = model_of(net.bare, made), model_of(net.ints, floats)
    copy(model.breaks, old.breaks)
    copy(model.at, old.at)
    copy(model.friction, old.friction)
    copy(model.draw, old.draw)
    copy_rows(model.heavy, old.heavy, 3)
    copy_rows(model.piece, old.piece, old.piece.shape[1])
    copy_rows(model.act, old.act, 3)
    known, plan = net.bare[N_KNOTS], plan_of(net.bare)
    for i in range(model.force.shape[0]):
        for c in range(3):
            model.force[i, c] = old.force[i, c] if i < known else 0.0
            model.moment[i, c] = old.moment[i, c] if i < known else 0.0
        if i >= known:  # a point load where a body presses is the knot's
            own = net.cable[net.span[i]]
            for p in range(plan.points[own], plan.points[own + 1]):
                if abs(model.at[p] - s[net.where[i]]) < 1e-9 * model.par[LENGTH]:
                    put3(model.force, i, 0, add(get3(model.force, i), get3(model.act, p)))


@viewing
def laid(net: Net, lying: Lying, on: Array) -> bool:
    """Makes the network that of these contacts (n, 2) and of the mesh as it is; False if its knots are the same.

    A network for which there is no room is one without elements.
    """
    if is_same(net, lying.held, on):
        return False
    if lay(net, lying, on):
        mesh(net, lying.s)
    else:
        net.ints[N_CABLES] = 0
    return True
