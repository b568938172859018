"""How a cable that is held at points answers their motion: forces and tangents there, and their derivatives."""

from __future__ import annotations

from typing import Any

from cable_shape.kernels._jit import kernel
from cable_shape.kernels.rod_algebra import add, apply, cross, get3, get4, put3, rotation, scale, subtract
from cable_shape.kernels.rod_element import E3
from cable_shape.kernels.span_factor import FORCE, take3
from cable_shape.kernels.span_stability import respond, slip
from cable_shape.kernels.span_system import NONE
from cable_shape.kernels.span_work import NOW, joints_of, mesh_parts, slot, vectors

Array = Any


@kernel
def held_points(
    par: Array, mesh: Array, sol: Array, work: Array, where: Array, mask: Array, place: Array, elements: int,
    forces: int, force: Array, tangent: Array, dforce: Array, dtangent: Array,
) -> None:  # fmt: skip
    """Of each support between the ends (k): `force` on the cable (k, 3) [N] and `tangent` (k, 3), world.

    dforce, dtangent (k, 3, k, 4): their derivatives in each support's place and in the arc length that it holds at that
    place. The matrix must be factored (`span_stability.refresh`). A point held further on is, for the material, a point
    moved back by r'.
    """
    spans = where.shape[0] - 1
    q, lam, _, _, _ = slot(sol, elements, spans, NOW)
    _, h, _, rest, _ = mesh_parts(mesh, elements)
    first, full, _, G, d, _ = vectors(work, elements)
    joints, sums, _, _ = joints_of(work, elements, spans)
    C = (par[3], par[4], par[5])
    for i in range(1, spans):
        put3(force, i - 1, 0, subtract(get3(lam, i - 1), get3(lam, i)))
        put3(tangent, i - 1, 0, apply(rotation(get4(q, where[i])), E3))
    for c in range(1, spans):
        node = where[c]
        for axis in range(4):
            G[:, :] = 0.0
            sums[:, :3] = 0.0
            if axis < 3:
                sums[c - 1, axis] = 1.0
                sums[c, axis] = -1.0
            else:
                before, after, couple = slip(q, full, node, C)
                put3(G, node, 0, couple)
                put3(sums, c - 1, 0, scale(-1.0, before))
                put3(sums, c, 0, after)
            respond(mesh, sol, work, where, mask, place, elements, forces, G, sums, 0, NONE)
            for i in range(1, spans):
                at = where[i]
                change = subtract(take3(joints, i - 1, FORCE), take3(joints, i, FORCE))
                turn = get3(d, at)
                if axis == 3 and i == c:
                    turn = add(turn, (
                        first[at - 1, 6] / par[0] + rest[at - 1, 0] + 0.5 * h[at - 1] * rest[at - 1, 3],
                        first[at - 1, 7] / par[1] + rest[at - 1, 1] + 0.5 * h[at - 1] * rest[at - 1, 4],
                        0.0,
                    ))  # fmt: skip
                bend = apply(rotation(get4(q, at)), cross(turn, E3))
                for x in range(3):
                    dforce[i - 1, x, c - 1, axis] = change[x]
                    dtangent[i - 1, x, c - 1, axis] = bend[x]
