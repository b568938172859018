"""What a swinging network remembers from step to step, as named arrays: :class:`Momentum`.

Time goes by the scheme of Wood, Bossak and Zienkiewicz (1980): with a step dt and the spectral radius rho at infinity,

    m ((1 - alpha) a + alpha a_last) + c v + (forces of the elements) = 0,   alpha = (rho - 1) / (rho + 1),
    v = v_last + dt ((1 - gamma) a_last + gamma a),                          gamma = 1/2 - alpha,
    x = x_last + dt v_last + dt^2 ((1/2 - beta) a_last + beta a),            beta = (1 - alpha)^2 / 4,

so that mass m and drag c hold a node with `Motion.hold` = m A + c C to a place that is known before the step, with
A = (1 - alpha) / (beta dt^2) and C = gamma / (beta dt). Rates of curvature, for damping, are differences of second
order backwards: K and the rest curvature change, and nothing else.

Energy is kept by the scheme in a form of its own. Let the force f_k = m ((1 - alpha) a_k + alpha a_(k-1)) work along
the way of a step as its mean, and g = a - a_last; then

    (f + f_last) / 2 . (x - x_last) = T - T_last + m dt^2 |a - a_(last but one)|^2 |alpha| (1 - alpha)^2 / 16,

    2 T / m = v^2 + alpha dt g . (v + dt a / 2) + (alpha^2 / 4 - alpha / 2) dt^2 a^2 - alpha (1 - alpha)^2 / 8 dt^2 g^2,

in equal steps from rest, to the last digit. T is what `kinetic` tells: nothing comes from nowhere, but for what
elements that turn far in a step do. It differs from m v^2 / 2 by dt^2.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from cable_shape.kernels.network.compiled import inline, part, viewing
from cable_shape.kernels.network.motion import Motion, mass_place
from cable_shape.kernels.network.tables import Floats, Model, Plan, Solution, Whole, solution_size
from cable_shape.kernels.rod_algebra import (
    Vector,
    add,
    cross,
    dot,
    get3,
    get4,
    put3,
    rotation,
    scale,
    subtract,
    take3,
    tapply,
    times,
)
from cable_shape.kernels.rod_element import (
    E3,
    angle_series,
    bowed,
    firmness,
    midpoint,
    relative,
)

#: Numbers that belong to the whole, see `Momentum.par`.
PAR = 8
RADIUS, LAST_DT, ENERGY, KINETIC, LOSING, PERIOD, LIKE, LIKE_FORCE = 0, 1, 2, 3, 4, 5, 6, 7


class Momentum(NamedTuple):
    """What motion remembers of a network of N elements, n nodes and k knots; all world but curvatures."""

    par: Floats  # (PAR,) spectral radius; last step [s], 0: none; energy and kinetic energy [J]; what damping takes
    #              [W]; mass length^3 / stiffness [s^2]; what share of `swerve` and of that of the forces comes again
    mass: Floats  # (n,) [kg], of the cable around each node
    point: Floats  # (n,) [kg], of what else is there
    delay: Floats  # (N,) [s], retardation time
    rest: Floats  # (N, 6) `Model.rest` and
    section: Floats  # (N, 9) `Model.section` without damping
    place: Floats  # (n, 3) [m]
    velocity: Floats  # (n, 3)
    acceleration: Floats  # (n, 3)
    tangent: Floats  # (n, 3)
    turning: Floats  # (n, 3) [1/s], its rate
    bending: Floats  # (n, 3) [1/s^2], and the rate of that
    lam: Floats  # (N, 3) [N], forces of the elements at the end of the last step
    before: Floats  # (N, 3) and one before
    strain: Floats  # (N, 6) [1/m, 1/m^2] mean curvature of an element and its slope, after the last step
    strained: Floats  # (N, 6) and one before
    reaction: Floats  # (k, 6) [N, N m] of the knots on the cable
    jump: Floats  # (n, 3) [m/s^2], by how much the acceleration of each mass has changed in the last step
    swerve: Floats  # (solution,) second difference of the last three solutions, in equal steps; else 0
    swerving: Floats  # (N, 3) [N] and of the forces of the elements


@viewing(forceinline=True)
def momentum_of(ints: Whole, memory: Floats) -> Momentum:
    """The parts of what is remembered."""
    n, m = ints[0], ints[1]
    k = n + m
    o1 = PAR
    o2 = o1 + k
    o3 = o2 + k
    o4 = o3 + n
    o5 = o4 + 6 * n
    o6 = o5 + 9 * n
    o7 = o6 + 3 * k
    o8 = o7 + 3 * k
    o9 = o8 + 3 * k
    o10 = o9 + 3 * k
    o11 = o10 + 3 * k
    o12 = o11 + 3 * k
    o13 = o12 + 3 * n
    o14 = o13 + 3 * n
    o15 = o14 + 6 * n
    o16 = o15 + 6 * n
    o17 = o16 + 6 * ints[2]
    o18 = o17 + 3 * k
    o19 = o18 + solution_size(ints)
    return Momentum(
        part(memory, 0, (PAR,)),
        part(memory, o1, (k,)),
        part(memory, o2, (k,)),
        part(memory, o3, (n,)),
        part(memory, o4, (n, 6)),
        part(memory, o5, (n, 9)),
        part(memory, o6, (k, 3)),
        part(memory, o7, (k, 3)),
        part(memory, o8, (k, 3)),
        part(memory, o9, (k, 3)),
        part(memory, o10, (k, 3)),
        part(memory, o11, (k, 3)),
        part(memory, o12, (n, 3)),
        part(memory, o13, (n, 3)),
        part(memory, o14, (n, 6)),
        part(memory, o15, (n, 6)),
        part(memory, o16, (ints[2], 6)),
        part(memory, o17, (k, 3)),
        part(memory, o18, (o19 - o18,)),
        part(memory, o19, (n, 3)),
    )  # fmt: skip


@viewing
def momentum_size(ints: Whole) -> int:
    """Numbers that are remembered of a network with this head."""
    return PAR + 23 * (ints[0] + ints[1]) + 37 * ints[0] + 6 * ints[2] + solution_size(ints)


class Scheme(NamedTuple):
    """Numbers of one step in time."""

    dt: float
    alpha: float
    beta: float
    gamma: float


@inline
def scheme_of(radius: float, dt: float) -> Scheme:
    """The numbers of a step dt [s]."""
    alpha = (radius - 1.0) / (radius + 1.0)
    return Scheme(dt, alpha, 0.25 * (1.0 - alpha) ** 2, 0.5 - alpha)


@inline
def of_mass(motion: Motion, ends: Floats, directions: Floats, node: int) -> Vector:
    """A quantity of a node's mass from that of the node and of its tangent."""
    return add(get3(ends, node), scale(motion.lever[node], get3(directions, node)))


@viewing(forceinline=True)
def aim_nodes(motion: Motion, memory: Momentum, dt: float) -> None:
    """Fills hold and origin of every node for a step dt."""
    t = scheme_of(memory.par[RADIUS], dt)
    for k in range(motion.hold.shape[0]):
        mass, drag = memory.mass[k] + memory.point[k], motion.drag[k]
        x, v = of_mass(motion, memory.place, memory.tangent, k), of_mass(motion, memory.velocity, memory.turning, k)
        a = of_mass(motion, memory.acceleration, memory.bending, k)
        hold = mass * (1.0 - t.alpha) / (t.beta * dt * dt) + drag * t.gamma / (t.beta * dt)
        ahead = add(x, add(scale(dt, v), scale(dt * dt * (0.5 - t.beta), a)))
        known = add(scale(mass * t.alpha, a), scale(drag, add(v, scale(dt * (1.0 - t.gamma), a))))
        motion.hold[k] = hold
        put3(motion.aim, k, 0, subtract(ahead, scale(1.0 / hold, known)) if hold > 0.0 else ahead)
        put3(motion.origin, k, 0, get3(motion.aim, k))


@inline
def rates(memory: Momentum, dt: float) -> tuple[float, float, float]:
    """Weights of now, last and the one before in the rate of a curvature."""
    last = memory.par[LAST_DT]
    r = dt / last if last > 0.0 else 0.0
    return (1.0 + 2.0 * r) / (1.0 + r) / dt, -(1.0 + r) / dt, r * r / (1.0 + r) / dt


@viewing(forceinline=True)
def damp(model: Model, memory: Momentum, dt: float) -> None:
    """Stiffness and rest curvature of the elements with what bending and twisting are damped by in a step dt.

    A bow's slope is sin(x) / b (see `rod_element`), and what damps it K tau / b^2 (1 - cos(x - x of the past)).
    """
    now, last, before = rates(memory, dt)
    for e in range(memory.delay.shape[0]):
        delay = memory.delay[e]
        if delay == 0.0:
            continue
        more = 1.0 + delay * now
        for c in range(3):
            model.section[e, c] = more * memory.section[e, c]
            model.section[e, 6 + c] = more * memory.section[e, 6 + c]
        for c in range(6):
            past = last * memory.strain[e, c] + before * memory.strained[e, c]
            if c == 3 or c == 4:
                b = bowed(model.h[e])
                turn = -b * past / now
                past = -now * math.sin(turn) / b
                model.firmer[e, c - 3] = -delay * now * memory.section[e, c - 3] * (1.0 - math.cos(turn))
            model.rest[e, c] = (memory.rest[e, c] - delay * past) / more


@inline
def strain_of(model: Model, full: Floats, sol: Solution, e: int, node: int) -> tuple[Vector, Vector, Vector]:
    """Curvature of an element, its slope, the one that saves the most energy, and x / b of that, see `damp`."""
    q, h, K, C = get4(sol.q, node), model.h[e], take3(model.section, e, 0), take3(model.section, e, 3)
    v, w = relative(q, get4(sol.q, node + 1))
    series = angle_series(dot(v, v), w)
    k = scale(series[0] / h, v)
    bent = subtract(k, take3(model.rest, e, 0))
    N = tapply(midpoint(q, v, w), take3(full, e, 3))
    g = add(cross(k, times(K, bent)), cross(add(E3, times(C, N)), N))
    g = add(subtract(g, times(K, take3(model.rest, e, 3))), times(take3(model.section, e, 6), bent))
    b, twist = bowed(h), -g[2] / K[2]
    A, B, sA, sB = firmness(h, K, g, N, (model.firmer[e, 0], model.firmer[e, 1]))
    turns = (math.atan2(-b * g[0], A) / b, math.atan2(-b * g[1], B) / b, twist)
    return k, (-g[0] / sA, -g[1] / sB, twist), turns


@inline
def along(K: Floats, e: int, h: float, a: Vector, a1: Vector, b: Vector, b1: Vector) -> float:
    """Integral over element e of (a + x a1) . (K + x K') (b + x b1), x from its middle."""
    S, S1 = take3(K, e, 0), take3(K, e, 6)
    twice = dot(times(S1, a), b1) + dot(times(S1, a1), b)
    return h * dot(times(S, a), b) + h * h * h / 12.0 * (dot(times(S, a1), b1) + twice)


@inline
def bow(h: float, k: Vector, k1: Vector, m: Vector) -> float:
    """[J], what an element's bow, with the slope k1 of the curvature, adds to the energy under the moment m."""
    return h * h * h / 12.0 * dot(k1, cross(k, m))


@inline
def over(a: Vector, b: Vector) -> Vector:
    """diag(b)^-1 a."""
    return (a[0] / b[0], a[1] / b[1], a[2] / b[2])


@inline
def nearest(h: float, x: float, past: float) -> float:
    """x / b of a bow, whole turns more or less, as near as can be to that of the past."""
    whole = 2.0 * math.pi / bowed(h)
    return x + whole * math.floor((past - x) / whole + 0.5)


@viewing(forceinline=True)
def strain_up(
    plan: Plan, model: Model, full: Floats, sol: Solution, memory: Momentum, dt: float
) -> tuple[float, float]:
    """Takes over the curvatures after a step dt; 0: at rest.

    Returns what the elastic energy is without the damping's share in `Model` [J] less with it, and what damping takes
    of the power [W].
    """
    change = power = 0.0
    now, last, before = rates(memory, dt) if dt > 0.0 else (0.0, 0.0, 0.0)
    for e in range(memory.delay.shape[0]):
        delay = memory.delay[e]
        if delay == 0.0:
            continue
        k, k1, turns = strain_of(model, full, sol, e, plan.left[e])
        h, K = model.h[e], take3(memory.section, e, 0)
        a, a1 = subtract(k, take3(memory.rest, e, 0)), subtract(k1, take3(memory.rest, e, 3))
        d, d1 = subtract(k, take3(model.rest, e, 0)), subtract(k1, take3(model.rest, e, 3))
        own = 0.5 * along(memory.section, e, h, a, a1, a, a1) + bow(h, k, k1, times(K, a))
        damped = 0.5 * along(model.section, e, h, d, d1, d, d1) + bow(h, k, k1, times(take3(model.section, e, 0), d))
        change += own - damped
        for i in range(2):  # of a bow by its x, not by its slope
            more = model.section[e, i] - memory.section[e, i]
            b = bowed(h)
            round_x = (1.0 - math.cos(b * turns[i])) / (b * b)
            change += h * h * h / 12.0 * (0.5 * more * k1[i] * k1[i] - (more + model.firmer[e, i]) * round_x)
        # what stiffness acts on in the element's functional: K k + w in the middle, K k1 - k x w for the slope, with
        # w + h^2 / 12 w x k1 = h^2 / 12 K (k1 x k)
        f = h * h / 12.0
        w = scale(f, times(K, cross(k1, k)))
        w = add(w, scale(f, add(cross(k1, w), scale(f * dot(k1, w), k1))))
        w = scale(1.0 / (1.0 + f * f * dot(k1, k1)), w)
        k, k1 = add(k, over(w, K)), subtract(turns, over(cross(k, w), K))
        past, past1 = take3(memory.strain, e, 0), take3(memory.strain, e, 3)
        if dt > 0.0:
            far, far1 = take3(memory.strained, e, 0), take3(memory.strained, e, 3)
            k1 = (nearest(h, k1[0], past1[0]), nearest(h, k1[1], past1[1]), k1[2])
            r = add(scale(now, k), add(scale(last, past), scale(before, far)))
            r1 = add(scale(now, k1), add(scale(last, past1), scale(before, far1)))
            power += delay * along(memory.section, e, h, r, r1, r, r1)
        else:
            past, past1 = k, k1
        put3(memory.strained, e, 0, past)
        put3(memory.strained, e, 3, past1)
        put3(memory.strain, e, 0, k)
        put3(memory.strain, e, 3, k1)
    return change, power


@inline
def force_of_mass(motion: Motion, sol: Solution, node: int) -> Vector:
    """[N], with which mass and drag of a node hold it back: of inertia, with the opposite sign."""
    return scale(motion.hold[node], subtract(mass_place(motion, sol, node), get3(motion.aim, node)))


@viewing(forceinline=True)
def move_on(motion: Motion, sol: Solution, memory: Momentum, dt: float) -> None:
    """Takes over places and tangents after a step dt, with their rates."""
    t = scheme_of(memory.par[RADIUS], dt)
    for k in range(motion.hold.shape[0]):
        R = rotation(get4(sol.q, k))
        a = of_mass(motion, memory.acceleration, memory.bending, k)
        carry(memory.place, memory.velocity, memory.acceleration, k, get3(motion.place, k), t)
        carry(memory.tangent, memory.turning, memory.bending, k, (R[2], R[5], R[8]), t)
        put3(memory.jump, k, 0, subtract(of_mass(motion, memory.acceleration, memory.bending, k), a))


@inline
def carry(place: Floats, velocity: Floats, acceleration: Floats, k: int, x: Vector, t: Scheme) -> None:
    """Row k of a quantity that is x after the step, and of its rates."""
    v, a = get3(velocity, k), get3(acceleration, k)
    ahead = add(get3(place, k), add(scale(t.dt, v), scale(t.dt * t.dt * (0.5 - t.beta), a)))
    new = scale(1.0 / (t.beta * t.dt * t.dt), subtract(x, ahead))
    put3(velocity, k, 0, add(v, scale(t.dt, add(scale(1.0 - t.gamma, a), scale(t.gamma, new)))))
    put3(acceleration, k, 0, new)
    put3(place, k, 0, x)


@inline
def kinetic(motion: Motion, memory: Momentum) -> tuple[float, float]:
    """[J], of all masses as the scheme keeps it after the last step, and what drag takes of the power [W]."""
    energy = power = 0.0
    t = scheme_of(memory.par[RADIUS], memory.par[LAST_DT])
    still = 0.25 * t.alpha * t.alpha - 0.5 * t.alpha
    uneven = -0.125 * t.alpha * (1.0 - t.alpha) ** 2
    for k in range(motion.hold.shape[0]):
        v = of_mass(motion, memory.velocity, memory.turning, k)
        a = scale(t.dt, of_mass(motion, memory.acceleration, memory.bending, k))
        g = scale(t.dt, get3(memory.jump, k))
        twice = dot(v, v) + t.alpha * dot(g, add(v, scale(0.5, a))) + still * dot(a, a) + uneven * dot(g, g)
        energy += 0.5 * (memory.mass[k] + memory.point[k]) * twice
        power += motion.drag[k] * dot(v, v)
    return energy, power
