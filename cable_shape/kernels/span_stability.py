"""How stable a cable in spans is, and how it answers its supports: from the factors of the spans."""

from __future__ import annotations

from cable_shape.checks import Array
from cable_shape.kernels._jit import kernel
from cable_shape.kernels.rod_algebra import (
    Vector,
    add,
    apply,
    cross,
    dot,
    get3,
    get4,
    get9,
    inlined,
    put3,
    rotation,
    scale,
    subtract,
    take3,
    tapply,
    times,
)
from cable_shape.kernels.rod_defect import node_slope
from cable_shape.kernels.rod_element import E3, element_hessian
from cable_shape.kernels.rod_mesh import forces as forces_at
from cable_shape.kernels.span_factor import FORCE, backward, factor, forward
from cable_shape.kernels.span_slide import grip
from cable_shape.kernels.span_system import NONE, assemble, fold, release
from cable_shape.kernels.span_work import NOW, joints_of, matrices, mesh_parts, slot, vectors


@kernel
def refresh(
    par: Array, mesh: Array, sol: Array, work: Array, where: Array, mask: Array, place: Array, elements: int,
    forces: int,
) -> None:  # fmt: skip
    """Assembles and factors the Newton matrix of the solution now."""
    _, h, load, rest, _ = mesh_parts(mesh, elements)
    spans = where.shape[0] - 1
    q, lam, _, _, _ = slot(sol, elements, spans, NOW)
    D, U, parts, P, Y, W = matrices(work, elements)
    first, full, _, G, _, _ = vectors(work, elements)
    joints, sums, _, _ = joints_of(work, elements, spans)
    fold(load, lam, where, full)
    assemble(q, full, h, rest, par[0:6], par[6:9], where, mask, D, U, G, parts, first, sums)
    # far below what else is accurate, yet enough to leave a neutral mode finite
    factor(D, U, parts, sums, where, mask, place, forces, 1e-4 * par[12], h, P, Y, W, joints)


@kernel
def smallest_eigenvalue(
    par: Array, mesh: Array, sol: Array, work: Array, where: Array, mask: Array, place: Array, elements: int,
    forces: int,
) -> float:  # fmt: skip
    """Smallest eigenvalue [N] of the second variation of the solution now, to 1e-3 of itself, by bisection."""
    refresh(par, mesh, sol, work, where, mask, place, elements, forces)
    h = mesh_parts(mesh, elements)[1]
    D, U, parts, P, Y, W = matrices(work, elements)
    joints, sums, _, _ = joints_of(work, elements, where.shape[0] - 1)
    unstable = factor(D, U, parts, sums, where, mask, place, forces, par[12], h, P, Y, W, joints) > 3 * forces
    # grow a shift until it changes the verdict: up if unstable, down if stable; then bisect
    sign = 1.0 if unstable else -1.0
    low, high = 0.0, 1e-3 * max(par[0], par[1], par[2]) / par[13] ** 2
    changed = False
    for _ in range(100):
        shift = 0.5 * (low + high) if changed else high
        negative = factor(D, U, parts, sums, where, mask, place, forces, sign * shift, h, P, Y, W, joints)
        if (negative > 3 * forces) != unstable:
            high = shift
            changed = True
        else:
            low = shift
            high = high if changed else 4.0 * high
        if changed and high - low < 1e-3 * high:
            break
    return -sign * 0.5 * (low + high)


@kernel
def respond(
    work: Array, where: Array, mask: Array, place: Array, elements: int, forces: int, G: Array, sums: Array,
    turned: int, turn: Vector,
) -> None:  # fmt: skip
    """Solves for the answer to a change of the gradient, into d and joints; node `turned` itself turns by `turn`."""
    spans = where.shape[0] - 1
    _, _, _, P, Y, W = matrices(work, elements)
    _, _, _, _, d, _ = vectors(work, elements)
    joints, _, pull, given = joints_of(work, elements, spans)
    pull[:, :] = 0.0
    given[:, :] = 0.0
    release(G, where, mask)
    forward(G, sums, pull, given, where, place, forces, P, Y, W, joints)
    backward(where, place, forces, P, Y, W, joints, d)
    for i in range(3):
        d[turned, i] += turn[i]


@kernel
def motion(
    par: Array, mesh: Array, sol: Array, work: Array, where: Array, elements: int, origin: Vector, support: int,
    jump: Vector, points: int, out: Array, column: int,
) -> None:  # fmt: skip
    """Fills out[:, :, column] (points, 3) with the change of the positions that d and joints cause.

    origin: change of the start; jump: by how much more the cable moves just after `support` than just before it.
    Between nodes by the cubic through the nodes' changes of r and r'.
    """
    s, h, _, _, _ = mesh_parts(mesh, elements)
    spans = where.shape[0] - 1
    q = slot(sol, elements, spans, NOW)[0]
    C = (par[3], par[4], par[5])
    _, _, parts, _, _, _ = matrices(work, elements)
    _, full, _, _, d, _ = vectors(work, elements)
    joints = joints_of(work, elements, spans)[0]
    length = s[elements]
    r = origin
    i = 0
    for j in range(spans):
        dl = take3(joints, j, FORCE)
        if j == support:
            r = add(r, jump)
        for k in range(where[j], where[j + 1]):
            change = add(
                add(tapply(get9(parts, k, 9), get3(d, k)), tapply(get9(parts, k, 18), get3(d, k + 1))),
                apply(get9(parts, k, 27), dl),
            )
            rb = subtract(r, change)
            nL, _, nR = forces_at(full, k, NONE)
            va, vb = node_slope(q, k, get3(d, k), nL, dl, C), node_slope(q, k + 1, get3(d, k + 1), nR, dl, C)
            while i < points:
                at = i * length / (points - 1)
                if at >= s[k + 1] and k < elements - 1:
                    break
                x = (at - s[k]) / h[k]
                z = 1.0 - x
                p = add(
                    add(scale(z * z * (1.0 + 2.0 * x), r), scale(z * z * x * h[k], va)),
                    add(scale(x * x * (3.0 - 2.0 * x), rb), scale(-x * x * z * h[k], vb)),
                )
                out[i, 0, column], out[i, 1, column], out[i, 2, column] = p
                i += 1
            r = rb


@inlined
def slip(q: Array, full: Array, node: int, C: Vector) -> tuple[Vector, Vector, Vector]:
    """r' (world) just before and just after a node, and by how much V x N (cable frame) is larger after it."""
    R = rotation(get4(q, node))
    a, b = tapply(R, take3(full, node - 1, 6)), tapply(R, take3(full, node, 0))
    va, vb = add(E3, times(C, a)), add(E3, times(C, b))
    return apply(R, va), apply(R, vb), subtract(cross(vb, b), cross(va, a))


@kernel
def eyelets(
    par: Array, mesh: Array, sol: Array, work: Array, where: Array, mask: Array, place: Array, elements: int,
    forces: int, rings: Array, f: Array, J: Array, points: int, out: Array,
) -> None:  # fmt: skip
    """How the eyelets `rings` (k,) (numbers of supports) pull along the cable, f (k,) [N], and J = df/dsigma (k, k).

    sigma are the arc lengths of the cable at the eyelets. The matrix must be factored (`refresh`). out (points, 3, k):
    change of the positions at fixed arc length with sigma; points 0: none.

    Moving the eyelet on by d sigma is, for the material, to move the point at the eyelet back by r' d sigma, with the
    difference of the moments that the two forces exert over that length.
    """
    spans = where.shape[0] - 1
    q, lam, _, _, _ = slot(sol, elements, spans, NOW)
    rest = mesh_parts(mesh, elements)[3]
    h = mesh_parts(mesh, elements)[1]
    first, full, _, G, d, _ = vectors(work, elements)
    joints, sums, _, _ = joints_of(work, elements, spans)
    C = (par[3], par[4], par[5])
    for c in range(rings.shape[0]):
        node = where[rings[c]]
        before, after, couple = slip(q, full, node, C)
        G[:, :] = 0.0
        sums[:, :3] = 0.0
        put3(G, node, 0, couple)
        put3(sums, rings[c] - 1, 0, scale(-1.0, before))
        put3(sums, rings[c], 0, after)
        respond(work, where, mask, place, elements, forces, G, sums, 0, NONE)
        for i in range(rings.shape[0]):
            f[i], J[i, c] = grip(lam, q, joints, d, where, rings[i])
        # the tangent at the eyelet changes by the curvature, too
        R = rotation(get4(q, node))
        F = subtract(get3(lam, rings[c] - 1), get3(lam, rings[c]))
        u = (
            first[node - 1, 6] / par[0] + rest[node - 1, 0] + 0.5 * h[node - 1] * rest[node - 1, 3],
            first[node - 1, 7] / par[1] + rest[node - 1, 1] + 0.5 * h[node - 1] * rest[node - 1, 4],
            0.0,
        )
        J[c, c] += dot(F, apply(R, cross(u, E3)))
        if points > 0:
            jump = subtract(before, after)
            motion(par, mesh, sol, work, where, elements, NONE, rings[c], jump, points, out, c)


@kernel
def move_end(
    par: Array, mesh: Array, q: Array, work: Array, where: Array, mask: Array, elements: int, forces: int, far: bool,
    velocity: Vector, spin: Vector,
) -> Vector:  # fmt: skip
    """Adds to G and sums in `work` how the gradient changes as the start, or the `far` end, moves and turns (world).

    Returns how the node there turns, in the cable frame, where its rotation is held.
    """
    _, h, _, rest, _ = mesh_parts(mesh, elements)
    spans = where.shape[0] - 1
    _, U, parts, _, _, _ = matrices(work, elements)
    first, full, _, G, _, _ = vectors(work, elements)
    sums = joints_of(work, elements, spans)[1]
    node, support, span = (elements, spans, spans - 1) if far else (0, 0, 0)
    if not far or forces == spans:
        put3(sums, span, 0, add(get3(sums, span), scale(1.0 if far else -1.0, velocity)))
    if spin == NONE:
        return NONE
    local = tapply(rotation(get4(q, node)), spin)
    turn = (
        local[0] * (1.0 - mask[support, 0]),
        local[1] * (1.0 - mask[support, 1]),
        local[2] * (1.0 - mask[support, 2]),
    )
    if far:
        beside = elements - 1
        across = apply(get9(U, elements - 1, 0), turn)
        change = tapply(get9(parts, elements - 1, 18), turn)
        reaction = take3(first, elements - 1, 6)
        own = apply(get9(parts, elements - 1, 0), turn)
    else:
        beside = 1
        across = tapply(get9(U, 0, 0), turn)
        change = tapply(get9(parts, 0, 9), turn)
        reaction = take3(first, 0, 3)
        nL, nM, nR = forces_at(full, 0, NONE)
        _, _, _, H11, _, _, _, _, _ = element_hessian(
            h[0], get4(q, 0), get4(q, 1), nL, nM, nR, take3(rest, 0, 0), take3(rest, 0, 3),
            (par[0], par[1], par[2]), (par[3], par[4], par[5]), NONE,
        )  # fmt: skip
        own = apply(H11, turn)
    put3(G, beside, 0, add(get3(G, beside), across))
    # the frame in which the free rotations of this node are in balance turns, too
    put3(G, node, 0, add(get3(G, node), add(own, scale(0.5, cross(reaction, turn)))))
    put3(sums, span, 0, add(get3(sums, span), change))
    return turn


@kernel
def sensitivity(
    par: Array, mesh: Array, sol: Array, work: Array, where: Array, mask: Array, place: Array, elements: int,
    forces: int, rings: Array, points: int, out: Array, df: Array,
) -> None:  # fmt: skip
    """Fills out (points, 3, 12): change of the positions at fixed arc length with the two end frames.

    Columns: velocity and angular velocity of the start, then of the end; world axes; the clips stand still. df (k, 12)
    takes the change of the pull of the eyelets `rings` along the cable. The matrix must be factored (`refresh`).
    """
    spans = where.shape[0] - 1
    q, lam, _, _, _ = slot(sol, elements, spans, NOW)
    _, _, _, G, d, _ = vectors(work, elements)
    joints, sums, _, _ = joints_of(work, elements, spans)
    for column in range(12):
        far = column >= 6
        axis = column % 3
        turning = column % 6 >= 3
        e = (1.0 if axis == 0 else 0.0, 1.0 if axis == 1 else 0.0, 1.0 if axis == 2 else 0.0)
        G[:, :] = 0.0
        sums[:, :3] = 0.0
        turn = move_end(
            par, mesh, q, work, where, mask, elements, forces, far, NONE if turning else e, e if turning else NONE
        )  # fmt: skip
        respond(work, where, mask, place, elements, forces, G, sums, elements if far else 0, turn)
        for i in range(rings.shape[0]):
            _, df[i, column] = grip(lam, q, joints, d, where, rings[i])
        origin = NONE if far or turning else e
        motion(par, mesh, sol, work, where, elements, origin, 0, NONE, points, out, column)
