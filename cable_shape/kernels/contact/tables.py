"""What the solver of a cable pressed on bodies is told: :class:`Lying`, :class:`Bodies`, :class:`Net`.

The cable has N elements between N + 1 nodes; b + 1 of them are held, by grips and clips. Three solutions are kept:
NOW and BEFORE, and TRIAL, which is solved for.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from cable_shape.checks import Array


class Lying(NamedTuple):
    """A cable and its solutions."""

    held: Any  # (b+1,) nodes that are held
    mask: Array  # (b+1, 3) rotations that are free there, 1, or held, 0
    s: Array  # (N+1,) arc length of the nodes [m]
    h: Array  # (N,) lengths between them
    errors: Array  # (N,) each element's share of the last solution's error
    start: Array  # (N+1, 4) rotations that Newton's method starts from
    q: Array  # (3, N+1, 4) rotations
    near: Array  # (3, N+1, 21) see `near`
    on: Any  # (3, N+1, 2) see `near`
    ends: Array  # (3, b, 3) internal force just before each held node but the first [N]
    grips: Array  # (3, b+1, 7) poses of what holds them
    turns: Array  # (3,)
    slid: Array  # (3, b+1) arc lengths there


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


class Net(NamedTuple):
    """The network that the cable is, held nodes and contacts its knots, and room for the largest there can be."""

    bare: Any  # the plan of the cable without contacts, one element a span
    made: Array  # the model of that: what the cable is made of and how it is held
    ints: Any  # plan, see `kernels.network.tables`
    floats: Array  # model
    sols: Array  # solutions
    space: Array  # work space
    run: Array  # of eyelets, none without
    where: Any  # (N+1,) nodes of the knots
    base: Any  # (N+1,) of each the held node that it is, -1: a contact
