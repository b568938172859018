"""What the solver of cables pressed on bodies is told: :class:`Lying`, :class:`Bodies`, :class:`Net`.

There are C cables, one behind the other, with n nodes in all and a gap between the last node of one and the first of
the next; b of the nodes are supports: the ends of cables, and what a clip or another knot of theirs holds. What lies
between two supports is a stretch; a network without contacts has a span of each. Three solutions are kept: NOW and
BEFORE, and TRIAL, which is solved for.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from cable_shape.checks import Array


class Lying(NamedTuple):
    """Cables and their solutions."""

    held: Any  # (b,) nodes that are supports
    mask: Array  # (b, 3) rotations that are free there, 1, or held, 0
    s: Array  # (n,) arc length of the nodes on their cables [m]
    h: Array  # (n-1,) lengths between them; 0 for a gap
    flex: Array  # (n,) 1 / EI there [1/(N m^2)]
    thick: Array  # (n,) radius there [m]
    errors: Array  # (N,) each element's share of the last solution's error
    start: Array  # (n, 4) rotations that Newton's method starts from
    q: Array  # (3, n, 4) rotations
    near: Array  # (3, n, 56) see `near`
    on: Any  # (3, n, 5) see `near`
    ends: Array  # (3, m, 3) internal force at the end of each stretch, the loads there included [N]
    grips: Array  # (3, k, 7) poses of the knots of the network without contacts
    turns: Array  # (3, C)
    slid: Array  # (3, b + e GRIP) arc lengths at the supports; what friction in the eyelets remembers, see `gripping`
    frames: Array  # (b, 7) scratch: frames of the supports
    reach: Array  # (l,) [m] least distance of the centrelines of a pair, see `link`
    pairs: Any  # (l, 3) scratch: nodes of the pairs; 1: the first one stays, see `link.STAYS`
    rough: Array  # (n,) coefficient of friction there
    rubs: Array  # (3, l, 21) friction between the cables of a pair, see `pair_friction`


class Bodies(NamedTuple):
    """Bodies that the cable may touch, as rows of a table, see `bounds` and `surface`."""

    table: Array  # (m, columns)
    frames: Array  # (m, 4, 3)
    then: Array  # (m, 4, 3) the frames at the solution now
    triangles: Array  # of meshes, and their tree
    tree: Array
    stack: Any
    links: Array  # (l, 7) poses of the robot's links
    measured: Array  # (m, 8) room for what `bounds.closest_points` finds
    counts: Any
    rough: Array  # (m,) coefficients of friction


class Net(NamedTuple):
    """The network that the cables are, contacts its last knots, and room for the largest there can be."""

    bare: Any  # the plan of the cables without contacts, one element a span
    made: Array  # the model of that: what the cables are made of and how they are held
    order: Any  # (k,) its knots in the order in which they are eliminated
    rank: Any  # (k,) of each knot, where it is in that order
    moves: Any  # (k,) 1: nothing holds its place
    wide: int  # how many vertices beyond the two next ones an elimination may join with one
    ints: Any  # plan, see `kernels.network.tables`
    floats: Array  # model
    sols: Array  # solutions
    space: Array  # work space
    run: Array  # of eyelets, none without
    where: Any  # (n,) node of each knot; -1: one whose rotation is that of none
    span: Any  # (n,) of each contact, by its knot, the span that ends there
    cable: Any  # (N,) of each span its cable
    stretch: Any  # (N,) of each span its stretch
    piece: Any  # (m+1,) first span of each stretch
    #: (m,) 1 + number of the stretches, in an order in which places follow from each other; negative: from its end on
    tour: Any
    room: Any  # scratch


class Skin(NamedTuple):
    """What a network of n nodes is to bodies."""

    thick: Array  # (n,) [m] radius at each node; below 0: what there is of it knows no bodies
    whole: Array  # (n,) [m] length of its cable
    rough: Array  # (n,) coefficient of friction
    knot: Array  # (n,) the knot that moves for which a node stands; INSIDE: for itself; HELD: it has no planes
    clear: Array  # (n,) [m] room: how far each node may go
    kept: Array  # room for a whole state
    links: Array  # (l, 7) where the links were that carry bodies
    rings: Array  # (e, RING) the eyelets, see `points`
    goals: Array  # (e, 3) [m] where those are at the end of the step
    log: Array  # (1 + LOG, 3) how many parts the last step went in, MET; of each where it began, its share, and the
    #             start that led on, see `swing_start.STARTS`; BRACED: what would arrive in it has stopped
    links_then: Array  # (l, 7) links, and
    rings_then: Array  # (e, RING) eyelets, before the last step
    touching: Array  # (p, TOUCHING) what of its cables may touch each other, or itself, see `meeting`
