"""Dry friction of a cable in an eyelet: Coulomb's law with memory, in increments.

With the cable's forces a and b before and behind the eyelet, its tangent t and F = a - b, the force of the eyelet on
the cable, friction is F . t, and that is at most

    L = |F - (F . t) t| sinh(mu theta / 2) / sin(theta / 2),   theta the angle between a and b.

Where the cable hardly turns that is mu times the force across. A limp one has the tensions |a| and |b| on its two
sides and F . t = |a| - |b|, for F . t is what n . t + M^2 / (2 EI) jumps by, which is the same all along a span without
loads; and |F . t| = L is then the capstan's |a| / |b| = exp(mu theta), the law of slip rings and pulleys of a small
radius. A stiff cable that only rests on the eyelet is held by up to pi / 2 times as much as by Coulomb's law there.

In between the law is that of `kernels.contact.friction`: where the eyelet was at s' along the cable in the last
solution and carried f', it carries

    f = f' + k (s - s') if that is no longer than L: it sticks; else as long as that: it slips,

k such that what carries its limit has given way by FIRMNESS of the length. An eyelet that has no past carries nothing.

References: L. Euler, Remarques sur l'effet du frottement dans l'equilibre, Mem. Acad. Berlin 18, 1769 (the capstan);
F. Ju and Y. S. Choo, Super element approach to cable passing through multiple pulleys, IJSS 42, 2005 (pulleys as
points with its ratio); D. Bigoni et al., Eshelby-like forces acting on elastic structures, Mech. Mater. 80, 2015 (what
jumps at a sliding sleeve).
"""

from __future__ import annotations

import math

import numpy as np
from numba import types

from cable_shape.kernels._jit import kernel
from cable_shape.kernels.network.compiled import inline, viewing
from cable_shape.kernels.network.graph import step_of_force
from cable_shape.kernels.network.tables import (
    LENGTH,
    NOW,
    SOFTEST,
    TRIAL,
    Floats,
    Model,
    Plan,
    Solution,
    Whole,
    Work,
    copy_rows,
    model_of,
    plan_of,
    solution_of,
    work_of,
)
from cable_shape.kernels.rod_algebra import (
    Vector,
    add,
    apply,
    cross,
    dot,
    get3,
    get4,
    rotation,
    scale,
    subtract,
)
from cable_shape.kernels.rod_element import E3

#: What a solution keeps of an eyelet: arc length [m] and friction [N] that it counts from, and how firm that is [N/m]
#: (0: it has no past); the same of what the next one counts from; 1: it slips.
FROM, FROM_PULL, FROM_FIRM, TO, TO_PULL, TO_FIRM, SLIPPED = 0, 1, 2, 3, 4, 5, 6
#: Of the length: how far what carries its limit has given way; the same as on bodies.
FIRMNESS = 1e-4
#: Of weight + EI / L^2: eyelets that carry less across are as firm as if it were so much.
FAINT = 1e-3
#: Of the larger force: a smaller one has no direction to speak of; and a turn [rad^2] from 0 or pi that is none.
NEARLY, ROUNDED = 1e-6, 1e-9
#: rad, half a turn below which a series tells.
SLIGHT_TURN = 1e-3


@inline
def turn_of(mu: float, c: float) -> tuple[float, float]:
    """sinh(mu h) / sin(h) of half the angle 2 h with the cosine c, and its derivative by c."""
    h = math.atan2(math.sqrt(1.0 - c + ROUNDED), math.sqrt(1.0 + c + ROUNDED))
    if h < SLIGHT_TURN:
        return mu * (1.0 + (1.0 + mu * mu) * h * h / 6.0), -mu * (1.0 + mu * mu) / 12.0
    sine, cosine = math.sin(h), math.cos(h)
    lifts = math.sinh(mu * h)
    slope = (mu * math.cosh(mu * h) * sine - lifts * cosine) / (sine * sine)
    return lifts / sine, -0.5 * slope / (2.0 * sine * cosine)


@inline
def limit_of(mu: float, a: Vector, b: Vector, t: Vector, da: Vector, db: Vector, dt: Vector) -> tuple[float, float]:
    """L [N], and how it changes as forces and tangent do."""
    F, dF = subtract(a, b), subtract(da, db)
    along = dot(F, t)
    across = subtract(F, scale(along, t))
    size = math.sqrt(dot(across, across))
    if size == 0.0:
        return 0.0, 0.0
    change = (dot(across, dF) - along * dot(across, dt)) / size
    aa, bb, ab = dot(a, a), dot(b, b), dot(a, b)
    daa, dbb, dab = 2.0 * dot(a, da), 2.0 * dot(b, db), dot(a, db) + dot(b, da)
    whole = NEARLY * NEARLY * (aa + bb)
    square = aa * bb + whole * (aa + bb)
    root = math.sqrt(square)
    c = ab / root
    dc = (dab - 0.5 * c / root * (daa * bb + aa * dbb + 2.0 * whole * (daa + dbb))) / root
    more, slope = turn_of(mu, c)
    return size * more, change * more + size * slope * dc


@inline
def forces_at(plan: Plan, model: Model, sol: Solution, c: int) -> tuple[Vector, Vector, Vector]:
    """The cable's forces before and behind eyelet c [N], and its tangent there."""
    j = plan.rings[c, 1]
    t = apply(rotation(get4(sol.q, plan.first[j + 1] + j)), E3)
    return get3(sol.lam, j), add(get3(sol.lam, j + 1), get3(model.weight, j + 1)), t


@inline
def law(plan: Plan, model: Model, sol: Solution, c: int, limit: float) -> tuple[float, float, float, bool]:
    """Friction of eyelet c [N], its derivatives by the arc length there [N/m] and the limit, and whether it slips."""
    grip = sol.grip
    known = grip[c, FROM_FIRM]
    if known <= 0.0 or model.friction[c] <= 0.0:
        return 0.0, 0.0, 0.0, False
    j = plan.rings[c, 1]
    way = model.s[plan.first[j + 1] + j] - grip[c, FROM]
    give = FIRMNESS * model.par[LENGTH]
    firm, more = known, 0.0
    if limit > known * give:
        firm, more = limit / give, way / give
    pull = grip[c, FROM_PULL] + firm * way
    if pull > limit:
        return limit, 0.0, 1.0, True
    if pull < -limit:
        return -limit, 0.0, -1.0, True
    return pull, firm, more, False


@inline
def short_of_turning(plan: Plan, model: Model, sol: Solution, c: int, way: float, side: float) -> float:
    """The step `way` of an eyelet that slips to `side`, cut short in the middle of where it sticks."""
    j = plan.rings[c, 1]
    grip = sol.grip
    ahead = grip[c, FROM] - grip[c, FROM_PULL] / grip[c, FROM_FIRM] - model.s[plan.first[j + 1] + j]
    if side * ahead < 0.0 and side * way < side * ahead:
        return ahead
    return way


@viewing(forceinline=True)
def holds(model: Model, sol: Solution, c: int) -> bool:
    """Whether there is friction in eyelet c, and a past that it counts from."""
    return model.friction[c] > 0.0 and sol.grip[c, FROM_FIRM] > 0.0


@viewing(forceinline=True)
def any_holds(model: Model, sol: Solution) -> bool:
    """Whether there is such an eyelet."""
    found = 0
    for c in range(model.friction.shape[0]):
        found += holds(model, sol, c)
    return found > 0


@viewing(forceinline=True)
def change_of_limit(
    plan: Plan, model: Model, sol: Solution, work: Work, c: int, more: Vector, both: Vector, turn: Vector
) -> tuple[float, float]:
    """The limit of eyelet c [N], and its change by the step at hand.

    more, both [N]: what the force behind it changes besides, and the forces on both sides; turn (own frame): so does
    the tangent.
    """
    j = plan.rings[c, 1]
    node = plan.first[j + 1] + j
    a, b, t = forces_at(plan, model, sol, c)
    dt = apply(rotation(get4(sol.q, node)), cross(add(get3(work.d, node), turn), E3))
    da, db = add(step_of_force(work, j), both), add(add(step_of_force(work, j + 1), both), more)
    return limit_of(model.friction[c], a, b, t, da, db, dt)


@viewing(late=types.none)
def begin_grips(ints: Whole, floats: Floats, sols: Floats, onward: bool) -> None:
    """Tells the trial what its eyelets count from: the solution now; unless onward, what that itself counts from."""
    model = model_of(ints, floats)
    now, sol = solution_of(ints, sols, NOW), solution_of(ints, sols, TRIAL)
    copy_rows(sol.grip, now.grip, now.grip.shape[1])
    if onward:
        for c in range(model.friction.shape[0]):
            for i in range(3):
                sol.grip[c, FROM + i] = sol.grip[c, TO + i]


@kernel
def told(ints: Whole, floats: Floats, sols: Floats, space: Floats) -> Floats:
    """(e, 3): friction of the eyelets [N] in the last solution, its discretisation error taken off; 1: it slips.

    And 1: it counts from a past, or there is none.
    """
    plan, model, work = plan_of(ints), model_of(ints, floats), work_of(ints, space)
    now = solution_of(ints, sols, NOW)
    out = np.empty((model.friction.shape[0], 3))
    for c in range(out.shape[0]):
        j = plan.rings[c, 1]
        after = add(get3(work.pulled, j + 1), get3(model.weight, j + 1))
        t = apply(rotation(get4(work.start, plan.first[j + 1] + j)), E3)
        out[c, 0] = dot(subtract(get3(work.pulled, j), after), t) + model.draw[c]
        out[c, 1] = now.grip[c, SLIPPED]
        out[c, 2] = 0.0 if model.friction[c] > 0.0 and now.grip[c, FROM_FIRM] <= 0.0 else 1.0
    return out


@viewing(late=types.none)
def end_grips(ints: Whole, floats: Floats, sols: Floats) -> None:
    """Makes the trial, which is solved, what the next one counts from."""
    plan, model, sol = plan_of(ints), model_of(ints, floats), solution_of(ints, sols, TRIAL)
    none = (0.0, 0.0, 0.0)
    weight = model.par[SOFTEST]
    for j in range(model.weight.shape[0]):
        weight += math.sqrt(dot(get3(model.weight, j), get3(model.weight, j)))
    for c in range(model.friction.shape[0]):
        mu = model.friction[c]
        if mu <= 0.0:
            sol.grip[c, TO_FIRM] = 0.0
            continue
        a, b, t = forces_at(plan, model, sol, c)
        limit, _ = limit_of(mu, a, b, t, none, none, none)
        pull, _, _, slips = law(plan, model, sol, c, limit)
        j = plan.rings[c, 1]
        sol.grip[c, TO], sol.grip[c, TO_PULL] = model.s[plan.first[j + 1] + j], pull
        sol.grip[c, TO_FIRM] = max(limit, mu * FAINT * weight) / (FIRMNESS * model.par[LENGTH])
        sol.grip[c, SLIPPED] = 1.0 if slips else 0.0
