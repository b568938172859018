"""A network that moves against drag alone: one implicit step in time, a minimum of energy and drag together.

With the nodes' places r^ of the last step, drag c_i and a step dt in time a step is a minimum of

    E(shape) + sum over nodes of c_i / (2 dt) |r_i - r^_i|^2,

so that no step adds energy. As dt grows the step becomes Newton's method at rest; small steps lead continuously over a
snap to where the network falls. Rotations about the cable meet no drag and are always at rest.
"""

from __future__ import annotations

import math

from cable_shape.kernels.network.compiled import inline, viewing
from cable_shape.kernels.network.depart import energy
from cable_shape.kernels.network.motion import (
    AS_IT_IS,
    BEGUN,
    LAW,
    N_PROPS,
    N_WALLED,
    SEATED,
    Motion,
    let_go,
    motion_of,
    move_seats,
    put_places,
    stick,
    tilt_ends,
)
from cable_shape.kernels.network.moving import factor, solve
from cable_shape.kernels.network.newton import CONVERGED, NOT_FINITE, STALLED, advance
from cable_shape.kernels.network.predict import extrapolate, follow, turn_ends, turn_knots
from cable_shape.kernels.network.props import aside_of, brace, give_way, lean
from cable_shape.kernels.network.system import assemble as at_rest
from cable_shape.kernels.network.system import gradient, release
from cable_shape.kernels.network.tables import (
    BASE_SHIFT,
    LENGTH,
    NOW,
    SOFTEST,
    SWINGS,
    TRIAL,
    Floats,
    Model,
    Plan,
    Solution,
    Whole,
    Work,
    copy,
    copy_rows,
    model_of,
    plan_of,
    solution_of,
    solution_size,
    work_of,
)
from cable_shape.kernels.network.walls import PUSHED, ROUGH, RUB, WALL, slips
from cable_shape.kernels.rod_algebra import (
    add,
    dot,
    get3,
    get4,
    put3,
    qconj,
    qmul,
    scale,
    subtract,
    take3,
)

FAR = 4  # a frame turned by more than it may: the step in time was too long
LARGEST_TURN = 0.3  # rad, of a frame in one step in time
MORE = 3.0  # of forces among bodies in an iteration: times the largest, or 10 EI / h^2, Euler's load of an element
LARGEST_STEP = 0.3  # rad, of an iteration
BEYOND = 0.7  # rad, further than a step may turn a frame, at which an iteration gives up
NUDGE = 1e-3  # rad
TOLERANCE = 1e-9  # rad, and of half the length: the last iteration
FALLING, LEFT = 0.1, 0.01  # of the iteration before, and of what a last one leaves: factors that stay are to do better
#: The same where something slips, of which the matrix does not know all; [rad] so much with them; and of what may be
#: left: so much where something slips, or where it has changed what presses, for the square is not known there.
SLIDING, STIRRED, RUBBED = 0.7, 1e-2, 0.01
FIRST_SHIFT, SHIFT_GROWTH, MOST_SHIFTS = 0.02, 6.0, 16  # as Newton's method at rest has them
MANY = 1000003  # numbers for what presses
LOOSE = 0.03  # of the length times TOLERANCE: what elements may still miss among bodies, which press from one place on
MOST_ITERATIONS = 30
#: Iterations among bodies, of which none is half the shortest one before, and the last one still longer than that
#: [rad]: no more lead anywhere.
PATIENT, ASTRAY = 30, 0.1
#: So many of them, and in time the next go half their way until one is that short: bodies that push in one and not in
#: the next lead to and fro for ever.
TO_AND_FRO = 6
STICKY = 10  # iterations, after which planes that push a node at its seat go on to
#: What `step` tells in `info`: iterations, largest turn of a frame [rad], largest force of drag at a node [N], largest
#: internal force [N], negative eigenvalues beyond three a force, energy [J] after the step, last iteration [rad];
#: how many iterations had a matrix of their own.
I_ITERATIONS, I_TURNED, I_DRAG, I_FORCE, I_EXCESS, I_ENERGY, I_LAST, I_OWN = 0, 1, 2, 3, 4, 5, 6, 7
INFO = 8


@viewing
def assemble(ints: Whole, floats: Floats, sols: Floats, space: Floats, moving: Floats) -> None:
    """Fills the matrix of the trial and its right-hand side: G, slack, pull."""
    plan, model, work, motion = plan_of(ints), model_of(ints, floats), work_of(ints, space), motion_of(ints, moving)
    sol = solution_of(ints, sols, TRIAL)
    load_up(plan, model, motion, sol)
    at_rest(ints, floats, sols, space)
    lean(plan, model, sol, work, motion)
    put_places(plan, model, sol, motion)
    tilt_ends(plan, model, sol, work, motion, True)
    slacken(plan, work, motion)
    for j in range(plan.ends.shape[0]):
        first, last = plan.first[j], plan.first[j + 1] - 1
        for c in range(9):  # blocks beside rotations that are held
            if plan.tied[j, 0] == 0:
                f = model.free[j, 0, c // 3]
                work.U[first, c] *= f
                work.parts[first, 9 + c] *= f
            if plan.tied[j, 1] == 0:
                work.U[last, c] *= model.free[j, 1, c % 3]
                work.parts[last, 18 + c] *= model.free[j, 1, c // 3]


@viewing
def balance(ints: Whole, floats: Floats, sols: Floats, space: Floats, moving: Floats) -> None:
    """Fills the right-hand side of the trial alone, of what has mass: G, slack, tug, pull."""
    plan, model, work, motion = plan_of(ints), model_of(ints, floats), work_of(ints, space), motion_of(ints, moving)
    sol = solution_of(ints, sols, TRIAL)
    load_up(plan, model, motion, sol)
    gradient(ints, floats, sols, space)
    if motion.par[N_PROPS] > 0.0:
        lean(plan, model, sol, work, motion)
    put_places(plan, model, sol, motion)
    tilt_ends(plan, model, sol, work, motion, False)
    slacken(plan, work, motion)


@viewing(forceinline=True)
def slacken(plan: Plan, work: Work, motion: Motion) -> None:
    """Fills by how much places miss the elements' steps."""
    for j in range(plan.ends.shape[0]):
        for e in range(plan.first[j], plan.first[j + 1]):
            way = subtract(get3(motion.place, e + j + 1), get3(motion.place, e + j))
            put3(motion.slack, e, 0, add(take3(work.first, e, 0), way))


@viewing(forceinline=True)
def load_up(plan: Plan, model: Model, motion: Motion, sol: Solution) -> None:
    """Adds the nodes' drag to the loads: a span's force is that of its last element."""
    for j in range(plan.ends.shape[0]):
        first, last = plan.first[j], plan.first[j + 1] - 1
        n = get3(motion.lam, last)
        put3(sol.lam, j, 0, n)
        for e in range(first, last + 1):
            for c in range(9):
                model.load[e, c] = motion.load[e, c] + (motion.lam[e, c % 3] - n[c % 3])
        put3(model.weight, j, 0, add(get3(motion.weight, j), subtract(get3(motion.lam, first), n)))


@inline
def turned(sol: Solution, now: Solution) -> float:
    """[rad], by how much a frame has turned at most."""
    largest = 0.0
    for k in range(sol.q.shape[0]):
        miss = qmul(qconj(get4(now.q, k)), get4(sol.q, k))
        size = miss[0] * miss[0] + miss[1] * miss[1] + miss[2] * miss[2]
        if not size <= largest:
            largest = size
    return 2.0 * math.asin(min(1.0, math.sqrt(largest)))


@inline
def missed(motion: Motion) -> float:
    """[m], by how much the places of nodes miss the step of an element at most."""
    largest = 0.0
    for e in range(motion.slack.shape[0]):
        way = get3(motion.slack, e)
        largest = max(largest, dot(way, way))
    return math.sqrt(largest)


@inline
def loaded(plan: Plan, model: Model, motion: Motion) -> float:
    """What fraction of the step at hand makes no force larger than it may become in an iteration."""
    most, now, soft = 0.0, 0.0, 0.0
    for e in range(motion.lam.shape[0]):
        step, n = get3(motion.step, e), get3(motion.lam, e)
        most, now = max(most, dot(step, step)), max(now, dot(n, n))
        soft = max(soft, max(model.section[e, 0], model.section[e, 1]) / (model.h[e] * model.h[e]))
    limit = MORE * max(math.sqrt(now), 10.0 * soft)
    return min(1.0, limit / math.sqrt(most)) if most > 0.0 else 1.0


@inline
def pressing(motion: Motion) -> tuple[int, bool]:
    """A number for which planes of nodes push, stick and slip, and whether any slips.

    Points of elements are no part of the matrix, and `brace` meets their laws in every iteration.
    """
    seen, slides = 1, False
    for node in range(motion.walls.shape[0]):
        for k in range(int(motion.walls[node, 0])):
            i = 1 + WALL * k
            push = motion.walls[node, i + PUSHED]
            full = slips(take3(motion.walls, node, i + RUB), motion.walls[node, i + ROUGH] * push)
            seen = (3 * seen + (2 if full else 1 if push > 0.0 else 0)) % MANY
            slides = slides or full
    return seen, slides


@viewing
def newton(
    ints: Whole, floats: Floats, sols: Floats, space: Floats, moving: Floats, far: float, most: int, least: float,
    info: Floats,
) -> int:  # fmt: skip
    """Solves for one step in time from the trial as it is; returns CONVERGED, STALLED, NOT_FINITE or FAR.

    least [rad]: an iteration that changes no more is the last, for the next one would change the square of that. One
    with the factors of an earlier one leaves its change times all since then, and costs less than half: factors stay
    where two more of those are enough for the same. Among bodies they do as long as the same presses, and where
    something slips as long as that changes less and less: no matrix does better there.
    """
    model, motion = model_of(ints, floats), motion_of(ints, moving)
    sol, now = solution_of(ints, sols, TRIAL), solution_of(ints, sols, NOW)
    softest, wanted = model.par[SOFTEST], 3 * ints[0]
    plan = plan_of(ints)
    free = motion.par[N_WALLED] == 0.0 and motion.par[N_PROPS] == 0.0
    quick = model.par[SWINGS] != 0.0 and (free or least > TOLERANCE)  # among bodies not where it comes to rest
    shift = last = since = 0.0
    least_yet, better = math.inf, 0
    stay, slides, seen = False, False, 0
    info[I_OWN] = 0.0
    seated = motion.par[LAW] == SEATED
    shove, _ = aside_of(ints, motion)
    for i in range(most):
        info[I_ITERATIONS] = i + 1.0
        begun = i == 0 and quick and not free and motion.par[LAW] == AS_IT_IS
        before = seen
        if stay:
            balance(ints, floats, sols, space, moving)
            seen, slides = pressing(motion)
            stay = seen == before
        if not stay:
            info[I_OWN] += 1.0
            if begun:
                seen, slides = pressing(motion)
                motion.par[LAW] = BEGUN
            assemble(ints, floats, sols, space, moving)
            if begun:
                motion.par[LAW] = AS_IT_IS
            else:
                seen, slides = pressing(motion)
            trial = shift / SHIFT_GROWTH if shift > FIRST_SHIFT * softest else 0.0
            negative = 0
            for _ in range(MOST_SHIFTS):
                negative = factor(ints, floats, space, moving, trial + model.par[BASE_SHIFT])
                info[I_EXCESS] = negative - wanted
                if negative <= wanted:
                    break
                trial = max(SHIFT_GROWTH * trial, FIRST_SHIFT * softest)
            if negative != wanted:
                return STALLED
            shift = trial
        loose = 0.0 if free else missed(motion)
        if motion.par[N_PROPS] > 0.0:
            brace(ints, floats, sols, space, moving, stay)
        largest = solve(ints, floats, space, moving)
        info[I_LAST] = largest
        if not math.isfinite(largest):
            return NOT_FINITE
        if largest < 0.5 * least_yet:
            least_yet, better = largest, i
        elif not free and i - better > PATIENT and largest > ASTRAY:
            return STALLED
        slow = stay and largest > (SLIDING if slides else FALLING) * last
        rough = not free and (slides or seen != before or i == 0)
        rate = max(since, largest / last) if stay else largest  # what is left of this change by the next one
        since = since + largest if stay else largest
        fraction = min(1.0, LARGEST_STEP / largest) if largest > 0.0 else 1.0
        if not free and model.par[SWINGS] != 0.0:
            fraction = min(fraction, loaded(plan, model, motion))
            fraction *= 0.5 if i - better > TO_AND_FRO else 1.0
        advance(ints, sols, space, fraction)
        for e in range(motion.lam.shape[0]):
            for c in range(3):
                motion.lam[e, c] += fraction * motion.step[e, c]
        give_way(ints, motion, fraction)
        if seated:
            largest = max(largest, 2.0 * move_seats(plan, motion, shove, fraction) / model.par[LENGTH])
        enough, kept = least * least, LOOSE * least * model.par[LENGTH]
        if quick:
            enough *= RUBBED * RUBBED if rough else LEFT
            kept *= 1.0 if free else RUBBED * (LEFT if stay else 1.0)  # of which factors that stay leave a share
            rate = largest if rough else rate
        if shift == 0.0 and not begun and largest * rate < enough and (free or loose < kept):
            if not (seated and i > STICKY and let_go(motion)):
                return CONVERGED
        elif seated and i >= STICKY:
            stick(motion)
        stay = quick and shift == 0.0 and not slow and fraction == 1.0
        stay = stay and (since < STIRRED if slides else largest * since * since * since < LEFT * least * least)
        last = largest
        if not turned(sol, now) < far + BEYOND:
            return FAR
    return STALLED


@viewing
def step(
    ints: Whole,
    floats: Floats,
    sols: Floats,
    space: Floats,
    moving: Floats,
    dt: float,
    far: float,
    most: int,
    info: Floats,
) -> int:
    """One step dt [s] from the solution now to the knots that are given in the trial; returns as `newton` does.

    far [rad]: by how much a frame may turn.
    After CONVERGED the trial has become the solution now and its forces those of `Motion.kept`; else nothing has.
    """
    plan, model, motion = plan_of(ints), model_of(ints, floats), motion_of(ints, moving)
    sol, now = solution_of(ints, sols, TRIAL), solution_of(ints, sols, NOW)
    for i in range(info.shape[0]):
        info[i] = 0.0
    for k in range(motion.hold.shape[0]):
        motion.hold[k] = motion.drag[k] / dt
    copy_rows(motion.lam, motion.kept, 3)
    copy_rows(motion.seat, motion.origin, 3)
    follow(plan, now, sol)
    turn_knots(plan, model, now, now, sol, 0.0)
    extrapolate(plan, now, now, sol, 0.0)
    turn_ends(plan, model, sol)
    status = newton(ints, floats, sols, space, moving, far, most, TOLERANCE, info)
    info[I_TURNED] = turned(sol, now)
    if status == CONVERGED and not info[I_TURNED] <= far:
        status = FAR
    if status != CONVERGED:
        return status
    put_places(plan, model, sol, motion)
    strongest(plan, model, motion, info)
    info[I_ENERGY] = energy(ints, floats, sols, moving)
    copy_rows(motion.kept, motion.lam, 3)
    copy_rows(motion.origin, motion.place, 3)
    size = solution_size(ints)
    copy(sols[size : 2 * size], sols[0:size])
    copy(sols[0:size], sols[2 * size : 3 * size])
    return CONVERGED


@viewing
def excess(ints: Whole, floats: Floats, sols: Floats, space: Floats, moving: Floats, dt: float) -> int:
    """How many modes of the trial grow so fast that a step dt cannot follow them, with the matrix factored."""
    model, motion = model_of(ints, floats), motion_of(ints, moving)
    for k in range(motion.hold.shape[0]):
        motion.hold[k] = motion.drag[k] / dt
    assemble(ints, floats, sols, space, moving)
    return factor(ints, floats, space, moving, model.par[BASE_SHIFT]) - 3 * ints[0]


@viewing
def nudge(ints: Whole, floats: Floats, sols: Floats, space: Floats, moving: Floats, dt: float) -> int:
    """Turns the trial by NUDGE rad along the mode that a step dt only just follows; returns CONVERGED or STALLED.

    From an unstable equilibrium that nothing else disturbs. The trial becomes the solution now.
    """
    plan, model, motion, work = plan_of(ints), model_of(ints, floats), motion_of(ints, moving), work_of(ints, space)
    sol = solution_of(ints, sols, TRIAL)
    if excess(ints, floats, sols, space, moving, dt) != 0:
        return STALLED
    work.pull[:, :] = 0.0
    for k in range(work.G.shape[0]):
        x = float(k) / work.G.shape[0]
        put3(work.G, k, 0, (math.sin(7.0 * x) + 0.3, math.cos(5.0 * x) + 0.2, math.sin(3.0 * x + 0.4)))
    release(plan, model_of(ints, floats), work.G)
    for e in range(motion.slack.shape[0]):
        put3(motion.slack, e, 0, (0.0, 0.0, 0.0))
    largest = solve(ints, floats, space, moving)
    if not (math.isfinite(largest) and largest > 0.0):
        return STALLED
    fraction = NUDGE / largest
    advance(ints, sols, space, fraction)
    for e in range(motion.lam.shape[0]):
        put3(motion.lam, e, 0, add(get3(motion.lam, e), scale(fraction, get3(motion.step, e))))
    put_places(plan, model, sol, motion)
    copy_rows(motion.origin, motion.place, 3)
    copy_rows(motion.lam, motion.kept, 3)
    size = solution_size(ints)
    copy(sols[0:size], sols[2 * size : 3 * size])
    return CONVERGED


@inline
def strongest(plan: Plan, model: Model, motion: Motion, info: Floats) -> None:
    """Tells the largest force of drag and the largest internal force."""
    force = drag = 0.0
    for j in range(plan.ends.shape[0]):
        for e in range(plan.first[j], plan.first[j + 1]):
            n = add(take3(motion.load, e, 3), get3(motion.lam, e))
            force = max(force, dot(n, n))
            if e > plan.first[j]:
                way = subtract(get3(motion.place, e + j), get3(motion.origin, e + j))
                drag = max(drag, motion.hold[e + j] ** 2 * dot(way, way))
        for end in range(2):
            if plan.vertices[plan.ends[j, end], 1] >= 0:
                node = plan.first[j + end] + j
                way = subtract(get3(motion.place, node), get3(motion.origin, node))
                drag = max(drag, motion.hold[node] ** 2 * dot(way, way))
    info[I_DRAG], info[I_FORCE] = math.sqrt(drag), math.sqrt(force)
