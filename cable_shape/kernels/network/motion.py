"""What the solver of a network knows of motion, as named arrays: :class:`Motion`; and how nodes answer to forces.

A node between two elements is held to a place a by a spring that time makes: with y'' = A (y - y^) and y' = C (y - y^)
at the end of a step, a mass m and a drag c at the node, `hold` is m A + c C, and

    y = a + (lam_right - lam_left) / hold.

Without mass C is 1 / dt and a is where the node was. What else may act on a node, such as bodies that it touches, has a
place here: it changes its place and the derivative of it, `give`, and nothing else.
"""

from __future__ import annotations

from typing import NamedTuple

from cable_shape.kernels.network.compiled import inline, part, viewing
from cable_shape.kernels.network.tables import Floats, Plan, Solution, Whole
from cable_shape.kernels.rod_algebra import Vector, add, get3, put3, scale, subtract, take3

#: Numbers of a node in `Motion.chain` and of a span in `Motion.ends`, see `chain`.
CHAIN, ENDS = 87, 69


class Motion(NamedTuple):
    """What motion adds to a network of N elements, m spans and n = N + m nodes."""

    lam: Floats  # (N, 3) internal force of each element without the loads beyond it [N]
    kept: Floats  # (N, 3) the same at the end of the last step
    slack: Floats  # (N, 3) by how much the nodes' places miss each element's step [m]
    step: Floats  # (N, 3) step of lam
    place: Floats  # (n, 3) places of the nodes [m]
    origin: Floats  # (n, 3) to which they are held
    drag: Floats  # (n,) [N s/m], of the cable around the node
    hold: Floats  # (n,) [N/m]
    give: Floats  # (n, 9) derivative of a place in the force on the node [m/N]; 0 at the ends of spans
    chain: Floats  # (n, CHAIN) factors
    load: Floats  # (N, 9) `Model.load` without drag
    weight: Floats  # (m, 3) `Model.weight` without drag
    ends: Floats  # (m, ENDS) condensed spans: what concerns the places of their ends


@viewing(forceinline=True)
def motion_of(ints: Whole, moving: Floats) -> Motion:
    """The parts of what motion adds."""
    n, m = ints[0], ints[1]
    k = n + m
    o1 = 3 * n
    o2 = 6 * n
    o3 = 9 * n
    o4 = 12 * n
    o5 = o4 + 3 * k
    o6 = o5 + 3 * k
    o7 = o6 + k
    o8 = o7 + k
    o9 = o8 + 9 * k
    o10 = o9 + CHAIN * k
    o11 = o10 + 9 * n
    o12 = o11 + 3 * m
    return Motion(
        part(moving, 0, (n, 3)),
        part(moving, o1, (n, 3)),
        part(moving, o2, (n, 3)),
        part(moving, o3, (n, 3)),
        part(moving, o4, (k, 3)),
        part(moving, o5, (k, 3)),
        part(moving, o6, (k,)),
        part(moving, o7, (k,)),
        part(moving, o8, (k, 9)),
        part(moving, o9, (k, CHAIN)),
        part(moving, o10, (n, 9)),
        part(moving, o11, (m, 3)),
        part(moving, o12, (m, ENDS)),
    )  # fmt: skip


@viewing
def motion_size(ints: Whole) -> int:
    """Numbers of what motion adds to a network with this head."""
    return 21 * ints[0] + (17 + CHAIN) * (ints[0] + ints[1]) + (3 + ENDS) * ints[1]


@inline
def pull_of(motion: Motion, e: int) -> Vector:
    """[N], the force of the elements e - 1 and e on the node between them."""
    return subtract(get3(motion.lam, e), get3(motion.lam, e - 1))


@viewing(forceinline=True)
def put_places(plan: Plan, sol: Solution, motion: Motion) -> None:
    """Fills place and give: nodes where the forces of their elements hold them, ends of spans where their knots are."""
    for j in range(plan.ends.shape[0]):
        first, last = plan.first[j], plan.first[j + 1]
        put3(motion.place, first + j, 0, take3(sol.pose, plan.ends[j, 0], 0))
        put3(motion.place, last + j, 0, take3(sol.pose, plan.ends[j, 1], 0))
        for e in range(first, last + 1):
            node = e + j
            inner = first < e < last
            soft = 1.0 / motion.hold[node] if inner else 0.0
            for c in range(9):
                motion.give[node, c] = soft if c % 4 == 0 else 0.0
            if inner:
                put3(motion.place, node, 0, add(get3(motion.origin, node), scale(soft, pull_of(motion, e))))
