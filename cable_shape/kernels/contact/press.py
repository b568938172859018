"""Newton's method for a cable pressed on bodies: which nodes touch is found along with the shape.

Contacts are knots of the network, see `knots`. Their pushes p n are what the forces of the spans on both sides differ
by; their places are those to which the cable leads. An iteration

1. drops contacts that pull, adds nodes that are inside a body, takes gaps, normals and curvatures where they are now,
2. solves the network's linear system for rotations, forces, and places that close the gaps along the normals,
3. goes at most 0.6 rad, and carries no node further than its gap and 0.6 of a body's thickness.

If the set of contacts does not settle, one contact is changed at a time.
"""

from __future__ import annotations

import math

from cable_shape.checks import Array
from cable_shape.kernels._jit import kernel
from cable_shape.kernels.contact.friction import FAINT, any_rough, forget_limits, go_along, pull_along
from cable_shape.kernels.contact.knots import close, from_model, mesh, press_on, put, step_out, walk
from cable_shape.kernels.contact.lay import laid
from cable_shape.kernels.contact.link import (
    active_pairs,
    allowed_apart,
    any_overlaps,
    change_links,
    find_pairs,
    go_apart,
    look_at_links,
    pushed_apart,
    tie_pairs,
)
from cable_shape.kernels.contact.make_room import slide_pairs
from cable_shape.kernels.contact.near import (
    ACTIVE,
    BARE,
    EXACT,
    LINKED,
    MATE,
    NORMAL,
    PRESS,
    PUSH,
    PUSHED,
    ROUND,
    SECOND,
    SECOND_EXACT,
    SECOND_PRESS,
    STANDS,
    STEP,
    THIRD,
    THIRD_EXACT,
    THIRD_PRESS,
    TOWARD,
    allowed,
    lean,
    leant,
    let_go,
    look,
    pressed,
    shares,
)
from cable_shape.kernels.contact.pair_friction import NEXT, PULLED, any_rub, forget_pulls, pulled
from cable_shape.kernels.contact.pair_system import COUPLED, hold_pairs, lead_pairs, pull_on, solve_coupled
from cable_shape.kernels.contact.run import slide, unturned
from cable_shape.kernels.contact.sets import drop, grow, meet, misplaced, spare_clips
from cable_shape.kernels.contact.tables import Bodies, Lying, Net
from cable_shape.kernels.network.compiled import inline, viewing
from cable_shape.kernels.network.graph import factor, solve, step_of_force
from cable_shape.kernels.network.newton import (
    CHORD_FROM,
    CONVERGED,
    FIRST_SHIFT,
    KICK,
    LARGEST_STEP,
    MOST_KICKS,
    MOST_SHIFTS,
    NOT_FINITE,
    SADDLE,
    SHIFT_GROWTH,
    STALLED,
    kick,
    size_at,
)
from cable_shape.kernels.network.sliding import (
    Slides,
    carried,
    columns,
    cut_short,
    move_along,
    run_through,
    slide_step,
    slides_of,
)
from cable_shape.kernels.network.system import assemble, gradient, release
from cable_shape.kernels.network.tables import (
    BASE_SHIFT,
    LENGTH,
    N_CABLES,
    N_KNOTS,
    SOFTEST,
    TRIAL,
    UNKNOWN,
    Work,
    model_of,
    plan_of,
    solution_of,
    work_of,
)
from cable_shape.kernels.rod_algebra import (
    Vector,
    add,
    apply,
    dot,
    get3,
    get4,
    get9,
    put3,
    qconj,
    qexp,
    qmul,
    qnormal,
    scale,
    subtract,
    take3,
    tapply,
)

# [m] a node deeper inside becomes a contact: far from and at the solution, for a step misses by its square
MOST, ADD = 2e-5, 1e-6
PULL = 1e-5  # of weight + EI / L^2: a contact that pulls by more is dropped
STEP_TOLERANCE = 3e-7  # rad
NEUTRAL_TOLERANCE = 1e-6
RUNNING = 14  # iterations in which contacts on bodies that are not sharp run along the cable
MERGING = 3  # iterations in which two contacts with a dip between them become one: it may come apart again
BLOCK = 8  # iterations in which all contacts that are wrong change at once
RESTLESS = 1e-4  # of the length: contacts that run further along the cable have changed the system
CHORD_TOLERANCE, SURE = 2e-6, 0.05  # rad, of a step with old factors that is so much shorter than the one before
#: Of how firm contacts are, what they are at first in a gentle solve, or one that is more so, and how much firmer they
#: are from solution to solution.
FIRST, FIRMER = (1.0, 1e-2, 0.0), 5.0
TIGHTENED = 1e-3  # rad: a step below which such a solution counts as found
RUBBED = 1e-5  # of the largest limit: by how much a force along a surface may miss the law of friction
SHRINKING = 0.2  # of what it missed by before the last step: what is no more will shrink as much again in the next
LIMP = 2e-3  # EI / (w L^3): in softer cables errors of rotation carry nodes of steep legs far off their places
CALM = 0.1  # rad: contacts are dropped after steps below this only
SQUARE = 1e-3  # rad: pushes turn from the first step below this on, see `run.slide`; with friction they do not
#: What `press` tells in `info`: iterations, last step [rad], negative eigenvalues beyond those of the forces (0:
#: stable), knots, assemblies, kicks off a saddle, changes of the set of contacts, the largest gap at a contact [m], how
#: far the node that slid furthest slid last [m].
I_ITERATIONS, I_STEP, I_EXCESS, I_KNOTS, I_ASSEMBLIES, I_KICKS, I_CHANGES, I_GAP, I_SLID = 0, 1, 2, 3, 4, 11, 14, 15, 17


@kernel
def press(
    lying: Lying, bodies: Bodies, net: Net, weight: float, limp: bool, sunk: float, most: int, drag: float,
    running: int, factored: bool, gentle: int, info: Array,
) -> int:  # fmt: skip
    """Solves for the trial; CONVERGED, STALLED or NOT_FINITE.

    `lying` takes the last step, the network's solution does not: it is left in the right-hand sides, to be corrected.

    weight [N]: of all cables; limp: whether one of them is, see LIMP. sunk [m]: see `near.look`. drag [N]: moment per
    length and angle that holds the rotations back from `Lying.start`. running: iterations in which contacts run along
    the cable, see RUNNING; 0: none does, not even on a sharp body. factored: the factors in `net` are a nearby
    solution's, and serve while steps are short. gentle: friction gives way more easily at first, and less
    and less then, where it would else not be found what sticks and what slips. info: see I_ITERATIONS and the rest.
    """
    ints, floats, sols, space = net.ints, net.floats, net.sols, net.space
    q, near, on = lying.q[TRIAL], lying.near[TRIAL], lying.on[TRIAL]
    s, h, start, flex = lying.s, lying.h, lying.start, lying.flex
    par = model_of(net.bare, net.made).par
    length = par[LENGTH]
    masses = model_of(net.bare, net.made).at
    softest, base_shift = par[SOFTEST], par[BASE_SHIFT]
    least = PULL * (weight + softest)
    runs_through = net.run.shape[0] > 0
    shift = largest = before = 0.0
    iterations = changed = 0
    reuse = factored
    gone = 0.0 if reuse else math.inf  # rad, since the matrix was assembled
    rough, faint = any_rough(lying, bodies), FAINT * (weight + softest)
    unchanged = True
    flips, off_law, off_before, part, firm = 0, 0.0, 0.0, 1.0, FIRST[gentle] if rough else 1.0
    forget_limits(near)
    if not rough:
        for k in range(near.shape[0]):
            let_go(near, k)
            near[k, MATE] = 0.0
    decided = square = False
    find_pairs(lying, on)
    rubs, few = rough and any_rub(lying), active_pairs(lying, on) <= COUPLED
    of_pairs = 2.0 if few and gentle == 0 else 1.0
    forget_pulls(lying, not rubs)
    while iterations < most:
        iterations += 1
        one = iterations > BLOCK
        settled = iterations > 1 and largest < (LARGEST_STEP if one else CALM)
        if rough and one:  # what friction holds has to have found its place before it tells who pulls
            settled = settled and unchanged
        if settled:
            changed += drop(near, on, s, least, one)
        deep = min(ADD + length * largest * largest, MOST)
        changed += change_links(lying, near, on, least if settled else math.inf, deep)
        runs = STANDS if running == 0 else (ROUND / length if iterations <= running else math.inf)
        merging = iterations <= min(MERGING, running)
        square = square or (not rough and iterations > 1 and largest < SQUARE)
        slid = slide(lying, q, near, on, masses, runs, merging, square)
        way, matters = slide_pairs(lying, q, near, on)
        slid, matters = max(slid, way), max(slid, matters)
        reuse = reuse and changed == 0 and slid < RESTLESS * length
        if laid(net, lying, on):
            reuse = False
        elif slid > 0.0:
            mesh(net, s)
        if ints[N_CABLES] == 0:
            return STALLED
        put(net, lying, TRIAL, near, NORMAL)
        if reuse:
            gradient(ints, floats, sols, space)
        else:
            info[I_ASSEMBLIES] += 1.0
            gone = 0.0
            assemble(ints, floats, sols, space)
        walk(net, near)
        look_around(net, lying, near, on, bodies, sunk)
        look_at_links(lying, near)
        spare_clips(near, on, lying.held)
        if meet(near, on, min(ADD + length * largest * largest, MOST)) > 0:
            changed += 1
            reuse = False
            look_around(net, lying, near, on, bodies, sunk)
        off = misplaced(near, on) if limp else 0.0
        changed += grow(near, on, min(ADD + length * largest * largest, MOST), off, one)
        if laid(net, lying, on):
            changed += 1
            reuse = False
            if ints[N_CABLES] == 0:
                return STALLED
            put(net, lying, TRIAL, near, STEP)
            info[I_ASSEMBLIES] += 1.0
            gone = 0.0
            assemble(ints, floats, sols, space)
        info[I_CHANGES] += changed
        unchanged = changed == 0
        info[I_KNOTS] = ints[N_KNOTS]
        close(net, near)
        info[I_GAP] = press_on(net, q, h, near, on, runs, flex, drag, reuse)
        info[I_GAP] = max(info[I_GAP], tie_pairs(net, lying, q, near, on, reuse))
        if rough:
            off_before = off_law
            flips, off_law, part = pull_along(net, lying, bodies, q, near, on, firm, faint, length, part, reuse)
        if rubs:
            turned, off, of_pairs = hold_pairs(
                net, lying, q, near, on, firm, faint, length, of_pairs, reuse, largest, decided
            )
            flips, off_law = flips + turned, max(off_law, off)
            decided = reuse and turned > 0
            if decided:  # the factors are of what stuck or slipped before
                reuse = False
                continue
        if drag > 0.0:
            hold_back(net, q, start, drag)
        wanted = ints[UNKNOWN] + active_pairs(lying, on)
        untested = False
        if not reuse:
            step_out(net, lying, near, on, 0.0)
            trial = shift / SHIFT_GROWTH if largest > CHORD_FROM and shift > FIRST_SHIFT * softest else 0.0
            untested = trial > 0.0
            negative = 0
            for _ in range(MOST_SHIFTS):
                negative = factor(ints, floats, space, trial + drag + base_shift)
                if trial == 0.0 or negative == wanted:
                    info[I_EXCESS] = negative - wanted
                if negative == wanted:
                    break
                trial = max(SHIFT_GROWTH * trial, FIRST_SHIFT * softest)
            if negative != wanted:
                return STALLED
            shift = trial
            if runs_through:
                columns(ints, floats, sols, space, net.run)
        step_out(net, lying, near, on, 1.0)
        before = largest
        largest = solve_coupled(net, lying, q, near) if rubs else solve(ints, floats, space)
        if runs_through:
            falling = slide_step(ints, floats, sols, space, net.run, 1.0)
            largest = run_through(ints, floats, sols, space, net.run)
            if not reuse:
                info[I_EXCESS] += falling
                if falling > 0:
                    return STALLED
        moves(net, near)
        info[I_ITERATIONS], info[I_STEP] = iterations, largest
        if iterations == 1 and reuse and not largest < CHORD_FROM:
            reuse = False
            gone, largest, changed = math.inf, 0.0, 0
            continue
        gone += largest
        if not math.isfinite(largest):
            return NOT_FINITE
        if shift > 0.0 and largest < SADDLE and not untested and changed == 0:
            if info[I_KICKS] >= MOST_KICKS:
                return STALLED
            info[I_KICKS] += 1.0
            step_out(net, lying, near, on, 0.0)
            kick(ints, floats, space)
            if runs_through:
                slides_of(ints, net.run).way[:] = 0.0
            largest = KICK
            moves(net, near)
        if rubs:
            lead_pairs(net, lying, q, near, on, firm, faint, length)
        fraction = min(1.0, LARGEST_STEP / largest) if largest > 0.0 else 1.0
        fraction = min(fraction, allowed(near, on, bodies.table, lying.thick), allowed_apart(lying, near))
        if runs_through:
            fraction = min(fraction, cut_short(ints, floats, sols, net.run))
            if fraction == 0.0:
                return STALLED
        info[I_SLID] = slid
        calm = fraction == 1.0 and shift == 0.0 and changed == 0 and slid < RESTLESS * length
        again = reuse and iterations > 1
        done = False
        if calm:
            small = matters < STEP_TOLERANCE * length and (
                largest < STEP_TOLERANCE
                or (again and max(largest, before) < NEUTRAL_TOLERANCE)
                or (again and largest < CHORD_TOLERANCE and largest < SURE * before)
            )
            if firm < 1.0 and largest < TIGHTENED:
                firm = min(max(FIRMER * firm, FIRST[1]), 1.0)
                changed = 1
            shrinks = iterations > 1 and flips == 0 and off_law < SHRINKING * off_before
            law = off_law * off_law / off_before if shrinks else off_law
            done = small and changed == 0 and law < RUBBED and not pulls(net, lying, near, on, least)
            if done and not (square or rough):
                done = unturned(lying, q, near, on, runs) < least
        forces_on(net, lying, near, on, lying.ends[TRIAL], fraction)
        for k in range(near.shape[0]):
            if lies(on, k):
                lean(near, k, fraction)
        turn(net, q, lying.grips[TRIAL], fraction)
        if done and not any_overlaps(lying, near, on, ADD):
            return CONVERGED
        if runs_through:
            move_along(ints, floats, net.run, fraction)
            from_model(net, s, h)
        if calm:
            pulling = False
            for k in range(near.shape[0]):
                pulling = pulling or (lies(on, k) and near[k, PRESS] < -least)
            if again and largest > 0.3 * before:
                gone = math.inf
            reuse = largest < CHORD_FROM and not pulling and gone < math.inf and flips == 0
        else:
            reuse = False
        changed = 0
    return STALLED


@viewing
def lies(on: Array, k: int) -> bool:
    """Whether node k is pressed on a body."""
    return bool(on[k, 0] >= 0)


@viewing
def look_around(net: Net, lying: Lying, near: Array, on: Array, bodies: Bodies, sunk: float) -> None:
    """`near.look` for every cable."""
    plan = plan_of(net.bare)
    for c in range(plan.cables.shape[0] - 1):
        look(
            lying.s, near, on, lying.thick, lying.held[plan.cables[c] + c], lying.held[plan.cables[c + 1] + c],
            bodies.table, bodies.frames, bodies.triangles, bodies.tree, sunk, bodies.stack,
        )  # fmt: skip


@viewing
def moves(net: Net, near: Array) -> None:
    """Change of the nodes' places under the step, to first order, into `near`; and of knots that nothing holds."""
    plan = plan_of(net.ints)
    work, slides = work_of(net.ints, net.space), slides_of(net.ints, net.run)
    for way in net.tour:
        j = abs(way) - 1
        a, b = net.piece[j], net.piece[j + 1]
        c = net.cable[a]
        if way > 0:
            r = take3(work.move, plan.ends[a, 0], 3)
            if a == plan.cables[c]:
                put3(near, plan.first[a] + c, STEP, r)
            for x in range(a, b):
                for e in range(plan.first[x], plan.first[x + 1]):
                    r = subtract(r, change_of(work, slides, x, e))
                    put3(near, e + c + 1, STEP, r)
            if plan.known[b - 1] != 0:
                put3(work.move, plan.ends[b - 1, 1], 3, r)
        else:
            r = take3(work.move, plan.ends[b - 1, 1], 3)
            put3(near, plan.first[b] + c, STEP, r)
            for x in range(b - 1, a - 1, -1):
                for e in range(plan.first[x + 1] - 1, plan.first[x] - 1, -1):
                    r = add(r, change_of(work, slides, x, e))
                    put3(near, e + c, STEP, r)
            put3(work.move, plan.ends[a, 0], 3, r)


@viewing(forceinline=True)
def change_of(work: Work, slides: Slides, x: int, e: int) -> Vector:
    """Change of minus the step in position along element e, of span x."""
    change = add(
        add(
            tapply(get9(work.parts, e, 9), get3(work.d, e + x)),
            tapply(get9(work.parts, e, 18), get3(work.d, e + x + 1)),
        ),
        apply(get9(work.parts, e, 27), step_of_force(work, x)),
    )
    return add(change, carried(slides, e, 0)) if slides.way.shape[0] > 0 else change


@viewing(forceinline=True)
def jump_at(net: Net, lying: Lying, near: Array, on: Array, i: int) -> Vector:
    """[N], what bodies push contact i by with the step: the jump of the force there."""
    sol, work = solution_of(net.ints, net.sols, TRIAL), work_of(net.ints, net.space)
    model = model_of(net.ints, net.floats)
    x, k = net.span[i], net.where[i]
    jump = subtract(get3(sol.lam, x), add(get3(sol.lam, x + 1), add(get3(model.weight, x + 1), get3(model.force, i))))
    jump = add(jump, subtract(step_of_force(work, x), step_of_force(work, x + 1)))
    if on[k, LINKED] == ACTIVE:
        push = pushed_apart(net, near, on, k, 1.0)
        jump = subtract(jump, scale(push, take3(near, k, TOWARD)))
        jump = subtract(jump, pulled(lying.rubs[TRIAL], on, k, NEXT))
    return jump


@viewing(forceinline=True)
def pushed(net: Net, lying: Lying, near: Array, on: Array, i: int, fraction: float) -> Vector:
    """[N], the pushes of up to three bodies on contact i with a fraction of the step; 0 of those that there are not.

    What a body holds a contact by along its surface turns with that under the step: the push is along the normal after
    it, else forces would miss by what the step turns friction by, and Newton's method would be linear.
    """
    k = net.where[i]
    jump = jump_at(net, lying, near, on, i)
    if near[k, MATE] != 0.0 and on[k, SECOND] == BARE:
        force = pressed(near, k, NORMAL)
        return dot(add(force, scale(fraction, subtract(jump, force))), leant(near, k, fraction)), 0.0, 0.0
    own = shares(near, on, k, jump)
    first = near[k, PRESS] + fraction * (own[0] - near[k, PRESS])
    second = near[k, SECOND_PRESS] + fraction * (own[1] - near[k, SECOND_PRESS]) if on[k, SECOND] != BARE else 0.0
    third = near[k, THIRD_PRESS] + fraction * (own[2] - near[k, THIRD_PRESS]) if on[k, THIRD] != BARE else 0.0
    return first, second, third


@viewing
def pulls(net: Net, lying: Lying, near: Array, on: Array, least: float) -> bool:
    """Whether a contact would pull by more than `least` [N] after the step."""
    count = 0
    for i in range(net.bare[N_KNOTS], net.ints[N_KNOTS]):
        k = net.where[i]
        if on[k, 0] != BARE:
            first, second, third = pushed(net, lying, near, on, i, 1.0)
            count += min(first, second, third) < -least
        count += on[k, LINKED] == ACTIVE and pushed_apart(net, near, on, k, 1.0) < -least
    return count > 0


@viewing
def forces_on(net: Net, lying: Lying, near: Array, on: Array, ends: Array, fraction: float) -> None:
    """Takes a fraction of the step of the forces: those of contacts, and those at the ends of stretches."""
    plan, sol, work = plan_of(net.ints), solution_of(net.ints, net.sols, TRIAL), work_of(net.ints, net.space)
    for x in range(plan.ends.shape[0]):
        knot = plan.ends[x, 1]
        if knot >= net.bare[N_KNOTS]:
            if on[net.where[knot], 0] != BARE:
                k = net.where[knot]
                own = pushed(net, lying, near, on, knot, fraction)
                if near[k, MATE] != 0.0:
                    go_along(near, on, k, jump_at(net, lying, near, on, knot), fraction)
                near[k, PRESS], near[k, SECOND_PRESS], near[k, THIRD_PRESS] = own
        elif plan.known[x] != 0:
            put3(ends, net.stretch[x], 0, get3(sol.lam, x))
        else:
            put3(ends, net.stretch[x], 0, add(get3(ends, net.stretch[x]), scale(fraction, step_of_force(work, x))))
    go_apart(net, lying, near, on, fraction)
    pull_on(lying, near, fraction)


@viewing
def turn(net: Net, q: Array, grips: Array, fraction: float) -> None:
    """Takes a fraction of the step of the rotations, and of the knots that are free."""
    plan, work = plan_of(net.ints), work_of(net.ints, net.space)
    for x in range(plan.ends.shape[0]):
        c = net.cable[x]
        for e in range(plan.first[x] + (1 if x > plan.cables[c] else 0), plan.first[x + 1] + 1):
            turn_by(q, e + c, 0, get3(work.d, e + x), fraction)
    for i in range(net.bare[N_KNOTS]):
        if plan.vertices[i, 0] >= 0 and net.where[i] < 0:
            turn_by(grips, i, 3, get3(work.move, i), fraction)
        if plan.vertices[i, 1] >= 0:
            put3(grips, i, 0, add(get3(grips, i), scale(fraction, take3(work.move, i, 3))))


@inline
def turn_by(q: Array, k: int, at: int, d: Vector, fraction: float) -> None:
    """Turns the rotation in row k, from column `at` on, by a fraction of d in its own frame."""
    own = (q[k, at], q[k, at + 1], q[k, at + 2], q[k, at + 3])
    q[k, at], q[k, at + 1], q[k, at + 2], q[k, at + 3] = qnormal(qmul(own, qexp(scale(fraction, d))))


@viewing
def hold_back(net: Net, q: Array, start: Array, drag: float) -> None:
    """Adds to the gradient what drags the rotations back to `start`: drag [N] times angle and length."""
    plan, model, work = plan_of(net.ints), model_of(net.ints, net.floats), work_of(net.ints, net.space)
    for x in range(plan.ends.shape[0]):
        c = net.cable[x]
        for e in range(plan.first[x], plan.first[x + 1] + 1):
            miss = qmul(qconj(get4(start, e + c)), get4(q, e + c))
            f = math.copysign(2.0 * drag * size_at(plan, model, x, e), miss[3])
            put3(work.G, e + x, 0, add(get3(work.G, e + x), (f * miss[0], f * miss[1], f * miss[2])))
    release(plan, model, work.G)


@viewing
def tell_pushes(net: Net, lying: Lying, near: Array, on: Array) -> None:
    """Fills in the contacts' forces after the correction of the discretisation error.

    Where a body presses on a contact, too, the push of another cable is told by the jump of the force there.
    """
    model, work = model_of(net.ints, net.floats), work_of(net.ints, net.space)
    known, links = net.bare[N_KNOTS], plan_of(net.ints).links
    for turn in range(2):  # pushes first, bodies then
        for i in range(known, net.ints[N_KNOTS]):
            x, k = net.span[i], net.where[i]
            loads = add(get3(model.weight, x + 1), get3(model.force, i))
            jump = subtract(get3(work.pulled, x), add(get3(work.pulled, x + 1), loads))
            n = take3(near, k, TOWARD)
            if turn == 0:
                near[k, PUSHED] = near[k, PUSH] if on[k, 0] != BARE else dot(jump, n)
            elif on[k, 0] != BARE:
                if on[k, LINKED] == ACTIVE:
                    jump = subtract(jump, scale(near[k, PUSHED], n))
                    jump = subtract(jump, pulled(lying.rubs[TRIAL], on, k, PULLED))
                near[k, EXACT], near[k, SECOND_EXACT], near[k, THIRD_EXACT] = shares(near, on, k, jump)
        for i in range(links.shape[0]):
            a, b = net.where[links[i, 0]], net.where[links[i, 1]]
            if turn == 0 and on[a, LINKED] == ACTIVE:
                if on[a, 0] == BARE and on[b, 0] == BARE:
                    near[a, PUSHED] = near[b, PUSHED] = 0.5 * (near[a, PUSHED] + near[b, PUSHED])
                elif on[a, 0] == BARE:
                    near[b, PUSHED] = near[a, PUSHED]
                else:
                    near[a, PUSHED] = near[b, PUSHED]
            elif turn == 0:
                near[a, PUSHED] = near[b, PUSHED] = 0.0
