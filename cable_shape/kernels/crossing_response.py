"""How a cable that is held at points answers their motion: forces and tangents there, and their derivatives."""

from __future__ import annotations

from cable_shape.checks import Array
from cable_shape.kernels._jit import kernel
from cable_shape.kernels.rod_algebra import (
    add,
    apply,
    cross,
    get3,
    get4,
    put3,
    rotation,
    scale,
    subtract,
    take3,
)
from cable_shape.kernels.rod_element import E3
from cable_shape.kernels.span_factor import FORCE, backward, forward
from cable_shape.kernels.span_stability import move_end, slip
from cable_shape.kernels.span_system import release
from cable_shape.kernels.span_work import joints_of, matrices, mesh_parts, vectors


@kernel
def held_points(
    par: Array, mesh: Array, q: Array, lam: Array, work: Array, where: Array, mask: Array, place: Array, elements: int,
    forces: int, points: Array, force: Array, tangent: Array, dforce: Array, dtangent: Array,
) -> None:  # fmt: skip
    """Of the supports `points` (k,) between the ends: `force` on the cable (k, 3) [N] and `tangent` (k, 3), world.

    dforce, dtangent (k, 3, k, 4): their derivatives in each point's place and in the arc length that it holds at that
    place; other supports stay, those free to move along a surface do. q (N+1, 4), lam (m, 3): the solution, for which
    the matrix must be factored. A point held further on is, for the material, a point moved back by r'.
    """
    spans = where.shape[0] - 1
    _, h, _, rest, _ = mesh_parts(mesh, elements)
    first, full, _, G, d, _ = vectors(work, elements)
    joints, sums, pull, given = joints_of(work, elements, spans)
    _, _, _, P, Y, W = matrices(work, elements)
    C = (par[3], par[4], par[5])
    count = points.shape[0]
    for i in range(count):
        put3(force, i, 0, subtract(get3(lam, points[i] - 1), get3(lam, points[i])))
        put3(tangent, i, 0, apply(rotation(get4(q, where[points[i]])), E3))
    for c in range(count):
        support = points[c]
        node = where[support]
        for axis in range(4):
            G[:, :] = 0.0
            sums[:, :3] = 0.0
            if axis < 3:
                sums[support - 1, axis] = 1.0
                sums[support, axis] = -1.0
            else:
                before, after, couple = slip(q, full, node, C)
                put3(G, node, 0, couple)
                put3(sums, support - 1, 0, scale(-1.0, before))
                put3(sums, support, 0, after)
            pull[:, :] = 0.0
            given[:, :] = 0.0
            release(G, where, mask)
            forward(G, sums, pull, given, where, place, forces, P, Y, W, joints)
            backward(where, place, forces, P, Y, W, joints, d)
            for i in range(count):
                at = where[points[i]]
                change = subtract(take3(joints, points[i] - 1, FORCE), take3(joints, points[i], FORCE))
                turn = get3(d, at)
                if axis == 3 and i == c:
                    turn = add(turn, (
                        first[at - 1, 6] / par[0] + rest[at - 1, 0] + 0.5 * h[at - 1] * rest[at - 1, 3],
                        first[at - 1, 7] / par[1] + rest[at - 1, 1] + 0.5 * h[at - 1] * rest[at - 1, 4],
                        0.0,
                    ))  # fmt: skip
                bend = apply(rotation(get4(q, at)), cross(turn, E3))
                for x in range(3):
                    dforce[i, x, c, axis] = change[x]
                    dtangent[i, x, c, axis] = bend[x]


@kernel
def points_under_motion(
    par: Array, mesh: Array, q: Array, work: Array, where: Array, mask: Array, place: Array, elements: int, forces: int,
    points: Array, motion: Array, dforce: Array, dtangent: Array,
) -> None:  # fmt: skip
    """Fills dforce, dtangent (k, 3): change at the held `points` (k,) as the ends move by `motion` (2, 6).

    That is displacement [m] and rotation [rad] of each, world. The matrix must be factored.
    """
    spans = where.shape[0] - 1
    _, _, _, G, d, _ = vectors(work, elements)
    joints, sums, pull, given = joints_of(work, elements, spans)
    _, _, _, P, Y, W = matrices(work, elements)
    G[:, :] = 0.0
    sums[:, :3] = 0.0
    pull[:, :] = 0.0
    given[:, :] = 0.0
    for end in range(2):
        move_end(
            par, mesh, q, work, where, mask, elements, forces, end == 1, take3(motion, end, 0), take3(motion, end, 3)
        )  # fmt: skip
    release(G, where, mask)
    forward(G, sums, pull, given, where, place, forces, P, Y, W, joints)
    backward(where, place, forces, P, Y, W, joints, d)
    for i in range(points.shape[0]):
        j = points[i]
        put3(dforce, i, 0, subtract(take3(joints, j - 1, FORCE), take3(joints, j, FORCE)))
        put3(dtangent, i, 0, apply(rotation(get4(q, where[j])), cross(get3(d, where[j]), E3)))
