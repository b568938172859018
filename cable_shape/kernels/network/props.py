"""Points inside elements that bodies hold: what a plane does to a cable between two of its nodes.

At the share x of an element of length h between nodes a and b the cable is at

    r = (1 - x)^2 (1 + 2 x) y_a + x^2 (3 - 2 x) y_b + h x (1 - x)^2 d3_a - h x^2 (1 - x) d3_b.

A force on r acts on those four in the same shares, so that its work is theirs. Forces that keep n . r >= at and rub as
on the planes of nodes (`walls`, asperities that do not give) are found in every step of Newton's method together, from
the answer of the whole network to each: there are few of them. In an eyelet r is held across the cable, whatever force
it takes, and runs along it.

Where two elements may touch each other r is the way from a point of the second to one of the first: the force on r acts
on the first, and with the opposite sign on the second.
"""

from __future__ import annotations

from cable_shape.kernels.network.compiled import inline, part, viewing
from cable_shape.kernels.network.motion import (
    N_PROPS,
    ROWS,
    Motion,
    bent_by,
    firm_turn,
    motion_of,
    pull_turn,
    rotated,
)
from cable_shape.kernels.network.moving import solve
from cable_shape.kernels.network.system import release
from cable_shape.kernels.network.tables import (
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
from cable_shape.kernels.network.walls import across
from cable_shape.kernels.rod_algebra import (
    Vector,
    add,
    apply,
    cross,
    dot,
    get3,
    get4,
    get9,
    madd,
    put3,
    put9,
    rotation,
    scale,
    subtract,
    take3,
    tapply,
)

#: Columns of a point: element, body, share of the element, weights of y_a, y_b, d3_a, d3_b, outward normal 3,
#: n . r at the surface [m], push [N], coefficient of friction, where it sticks 3 [m], friction 3 [N]. In an eyelet
#: (friction below 0) the normal is the cable's tangent, and what would be friction is what holds it. More columns, of
#: asperities that give: by how much [m/N], and by how much they did under the friction before 3 [m]. Of a pair, whose
#: body is PAIRED: the second element, its share, minus the weights of that, and the row of what may touch.
ELEMENT, HOLDER, SHARE, WEIGHTS, NORMAL, LEVEL, PUSH, GRIP, STUCK, DRY = 0, 1, 2, 3, 7, 10, 11, 12, 13, 16
SOFT, GAVE = 29, 30
PARTNER, OTHER, COUNTER, WHICH, PAIRED = 33, 34, 35, 39, 1e6
MOST_ROUNDS, SAME = 200, 1e-12  # of forces in turns, and the change, of the largest, of the last
LOST = 1e-15  # of the largest number: a smaller pivot is none
MOST_TRIES, FULL = 4, 1e-9  # of those, and how near to what it may be friction is where something slips


@inline
def weigh(props: Floats, i: int, h: float) -> None:
    """Fills the weights of point i from its share."""
    x = props[i, SHARE]
    y = 1.0 - x
    props[i, WEIGHTS], props[i, WEIGHTS + 1] = y * y * (1.0 + 2.0 * x), x * x * (3.0 - 2.0 * x)
    props[i, WEIGHTS + 2], props[i, WEIGHTS + 3] = h * x * y * y, -h * x * x * y


@inline
def sides(props: Floats, i: int) -> int:
    """How many nodes point i acts on: those of its element, and of the second one of a pair."""
    return 4 if props[i, HOLDER] == PAIRED else 2


@inline
def side_of(props: Floats, i: int, side: int) -> tuple[int, int, float, float]:
    """Element, its end (0 or 1), and the weights of place and tangent there, of one of those."""
    if side < 2:
        return int(props[i, ELEMENT]), side, props[i, WEIGHTS + side], props[i, WEIGHTS + 2 + side]
    return int(props[i, PARTNER]), side - 2, props[i, COUNTER + side - 2], props[i, COUNTER + side]


@inline
def place_of(plan: Plan, props: Floats, i: int, places: Floats, tangents: Floats) -> Vector:
    """[m], of point i from places and tangents (n, 3) of the nodes; of rates of those its rate."""
    r = half_of(plan, props, i, ELEMENT, WEIGHTS, places, tangents)
    if props[i, HOLDER] == PAIRED:
        r = add(r, half_of(plan, props, i, PARTNER, COUNTER, places, tangents))
    return r


@inline
def half_of(plan: Plan, props: Floats, i: int, element: int, w: int, places: Floats, tangents: Floats) -> Vector:
    """What of that is of the element in one column, by the weights from another one on."""
    node = plan.left[int(props[i, element])]
    r = add(scale(props[i, w], get3(places, node)), scale(props[i, w + 1], get3(places, node + 1)))
    r = add(r, scale(props[i, w + 2], get3(tangents, node)))
    return add(r, scale(props[i, w + 3], get3(tangents, node + 1)))


@inline
def now_at(plan: Plan, motion: Motion, sol: Solution, i: int) -> Vector:
    """[m], the same with the nodes where they are."""
    r = half_now(plan, motion, sol, i, ELEMENT, WEIGHTS)
    if motion.props[i, HOLDER] == PAIRED:
        r = add(r, half_now(plan, motion, sol, i, PARTNER, COUNTER))
    return r


@inline
def half_now(plan: Plan, motion: Motion, sol: Solution, i: int, element: int, w: int) -> Vector:
    """See `half_of`."""
    props = motion.props
    node = plan.left[int(props[i, element])]
    r = add(scale(props[i, w], get3(motion.place, node)), scale(props[i, w + 1], get3(motion.place, node + 1)))
    for side in range(2):
        R = rotation(get4(sol.q, node + side))
        r = add(r, scale(props[i, w + 2 + side], (R[2], R[5], R[8])))
    return r


@viewing(forceinline=True)
def lean(plan: Plan, model: Model, sol: Solution, work: Work, motion: Motion) -> None:
    """Adds to `push`, gradient and matrix what holds points of elements."""
    for k in range(motion.push.shape[0]):
        put3(motion.push, k, 0, (0.0, 0.0, 0.0))
    props = motion.props
    for i in range(int(motion.par[N_PROPS])):
        F = add(scale(props[i, PUSH], take3(props, i, NORMAL)), take3(props, i, DRY))
        lean_on(plan, model, sol, work, motion, int(props[i, ELEMENT]), i, WEIGHTS, F)
        if props[i, HOLDER] == PAIRED:
            lean_on(plan, model, sol, work, motion, int(props[i, PARTNER]), i, COUNTER, F)


@inline
def lean_on(
    plan: Plan, model: Model, sol: Solution, work: Work, motion: Motion, e: int, i: int, w: int, F: Vector
) -> None:  # fmt: skip
    """The same of a force F [N] on element e, by the weights of point i from column w on."""
    props, j = motion.props, plan.left[e] - e
    for side in range(2):
        node = plan.left[e] + side
        put3(motion.push, node, 0, add(get3(motion.push, node), scale(props[i, w + side], F)))
        N = scale(-props[i, w + 2 + side], tapply(rotation(get4(sol.q, node)), F))
        if (side == 0 and e == plan.first[j]) or (side == 1 and e == plan.first[j + 1] - 1):
            pull_turn(plan, model, work, j, side, (-N[1], N[0], 0.0))
            firm_turn(plan, model, work, j, side, bent_by(N))
        else:
            put3(work.G, node, 0, add(get3(work.G, node), (-N[1], N[0], 0.0)))
            put9(work.D, node, 0, madd(get9(work.D, node, 0), bent_by(N)))


@inline
def direction(props: Floats, row: int) -> Vector:
    """Of row 3 i: the normal of point i; of the two after it: across that."""
    n = take3(props, row // 3, NORMAL)
    if row % 3 == 0:
        return n
    u = across(n)
    return u if row % 3 == 1 else cross(n, u)


@inline
def sticks(props: Floats, i: int) -> bool:
    """Whether the friction of point i is less than it may be."""
    t, limit = take3(props, i, DRY), props[i, GRIP] * props[i, PUSH]
    return bool(props[i, GRIP] > 0.0 and dot(t, t) < 0.999 * limit * limit)


@inline
def asked(motion: Motion, row: int) -> bool:
    """Whether there may be a force along this row."""
    grip = motion.props[row // 3, GRIP]
    return grip >= 0.0 if row % 3 == 0 else grip != 0.0


@inline
def load(
    plan: Plan, model: Model, sol: Solution, work: Work, motion: Motion, shove: Floats, row: int, f: float
) -> None:  # fmt: skip
    """Adds a force f [N] along a row to the right-hand side, and to `shove` on the nodes."""
    props, i, to = motion.props, row // 3, direction(motion.props, row)
    load_on(plan, sol, work, motion, shove, int(props[i, ELEMENT]), i, WEIGHTS, to, f)
    if props[i, HOLDER] == PAIRED:
        load_on(plan, sol, work, motion, shove, int(props[i, PARTNER]), i, COUNTER, to, f)


@inline
def load_on(
    plan: Plan, sol: Solution, work: Work, motion: Motion, shove: Floats, e: int, i: int, w: int, to: Vector, f: float
) -> None:  # fmt: skip
    """The same of element e, by the weights of point i from column w on."""
    props, j = motion.props, plan.left[e] - e
    for side in range(2):
        node = plan.left[e] + side
        at = node - j  # the element at its right
        F = scale(props[i, w + side] * f, to)
        put3(shove, node, 0, add(get3(shove, node), F))
        R = rotation(get4(sol.q, node))
        N = scale(-props[i, w + 2 + side] * f, tapply(R, to))
        way = apply(get9(motion.give, node, 0), F)
        loose = motion.loose[node] != 0.0
        if at == plan.first[j] or (at == plan.first[j + 1] and not loose):
            c = 0 if at == plan.first[j] else 3
            put3(motion.tug, j, c, subtract(take3(motion.tug, j, c), F))
        else:
            put3(motion.slack, at - 1, 0, add(get3(motion.slack, at - 1), way))
            if loose:
                N = add(N, scale(motion.lever[node] * motion.hold[node], tapply(R, way)))
            else:
                put3(motion.slack, at, 0, subtract(get3(motion.slack, at), way))
        put3(work.G, node, 0, add(get3(work.G, node), (-N[1], N[0], 0.0)))


@inline
def moved(plan: Plan, sol: Solution, work: Work, motion: Motion, shove: Floats, row: int) -> float:
    """[m], by how much the point of a row goes along it in the last solve's step."""
    props, i, to = motion.props, row // 3, direction(motion.props, row)
    way = moved_on(plan, sol, work, motion, shove, int(props[i, ELEMENT]), i, WEIGHTS, to)
    if props[i, HOLDER] == PAIRED:
        way += moved_on(plan, sol, work, motion, shove, int(props[i, PARTNER]), i, COUNTER, to)
    return way


@inline
def moved_on(
    plan: Plan, sol: Solution, work: Work, motion: Motion, shove: Floats, e: int, i: int, w: int, to: Vector
) -> float:  # fmt: skip
    """The same of element e, by the weights of point i from column w on."""
    props, j = motion.props, plan.left[e] - e
    way = 0.0
    for side in range(2):
        node = plan.left[e] + side
        at = node - j
        turned = apply(rotated(rotation(get4(sol.q, node))), get3(work.d, node))
        loose = motion.loose[node] != 0.0
        if at == plan.first[j] or (at == plan.first[j + 1] and not loose):
            y = take3(work.move, plan.ends[j, 0 if at == plan.first[j] else 1], 3)
        else:
            pull = subtract(get3(shove, node), get3(motion.step, at - 1))
            if loose:
                pull = subtract(pull, scale(motion.lever[node] * motion.hold[node], turned))
            else:
                pull = add(pull, get3(motion.step, at))
            y = apply(get9(motion.give, node, 0), pull)
        way += props[i, w + side] * dot(to, y) + props[i, w + 2 + side] * dot(to, turned)
    return way


@viewing
def brace(ints: Whole, floats: Floats, sols: Floats, space: Floats, moving: Floats, known: bool) -> None:
    """Puts into the right-hand side the change of all forces after which a step of Newton's method meets their laws.

    With the factors at hand; known: answers are those of them already. The change waits for `give_way`.
    """
    plan, model, work, motion = plan_of(ints), model_of(ints, floats), work_of(ints, space), motion_of(ints, moving)
    sol, props = solution_of(ints, sols, TRIAL), motion.props
    rows = 3 * int(motion.par[N_PROPS])
    N, n, m, k = ints[0], ints[0] + ints[1], ints[1], ints[2]
    o1 = 3 * n
    o2 = o1 + 3 * N
    o3 = o2 + 3 * k
    o4 = o3 + 6 * m
    o5 = o4 + 3 * n
    o6 = o5 + ROWS * ROWS
    G, slack = part(motion.aside, 0, (n, 3)), part(motion.aside, o1, (N, 3))
    pull, tug = part(motion.aside, o2, (k, 3)), part(motion.aside, o3, (m, 6))
    shove, answers = aside_of(ints, motion)
    gaps, forces = part(motion.aside, o6, (ROWS,)), part(motion.aside, o6 + ROWS, (ROWS,))
    change = part(motion.aside, o6 + 2 * ROWS, (ROWS,))
    copy_rows(G, work.G, 3)
    copy_rows(slack, motion.slack, 3)
    copy_rows(pull, work.pull, 3)
    copy_rows(tug, motion.tug, 6)
    shove[:, :] = 0.0
    solve(ints, floats, space, moving)
    for row in range(rows):
        i, to = row // 3, direction(props, row)
        r = now_at(plan, motion, sol, i)
        change[row] = 0.0
        if row % 3 == 0:
            forces[row], gaps[row] = props[i, PUSH], dot(to, r) - props[i, LEVEL]
        else:
            forces[row], gaps[row] = dot(to, take3(props, i, DRY)), dot(to, subtract(r, take3(props, i, STUCK)))
            gaps[row] += props[i, SOFT] * forces[row] - dot(to, take3(props, i, GAVE))
        gaps[row] += moved(plan, sol, work, motion, shove, row)
    if not known:
        answer(ints, floats, sols, space, moving)
        for row in range(rows):
            answers[row, row] += props[row // 3, SOFT] if row % 3 > 0 and asked(motion, row) else 0.0
    share(motion, rows, answers, gaps, forces, change, part(motion.aside, o6 + 3 * ROWS, (ROWS, ROWS + 2)))
    copy_rows(work.G, G, 3)
    copy_rows(motion.slack, slack, 3)
    copy_rows(work.pull, pull, 3)
    copy_rows(motion.tug, tug, 6)
    shove[:, :] = 0.0
    for row in range(rows):
        if change[row] != 0.0:
            load(plan, model, sol, work, motion, shove, row, change[row])
    release(plan, model, work.G)


@viewing
def answer(ints: Whole, floats: Floats, sols: Floats, space: Floats, moving: Floats) -> None:
    """Fills `answers`: how points go along all rows under a force of 1 N along each, with the factors at hand."""
    plan, model, work, motion = plan_of(ints), model_of(ints, floats), work_of(ints, space), motion_of(ints, moving)
    sol, rows = solution_of(ints, sols, TRIAL), 3 * int(motion.par[N_PROPS])
    shove, answers = aside_of(ints, motion)
    for row in range(rows):
        if not asked(motion, row):
            continue
        shove[:, :] = 0.0
        work.G[:, :] = 0.0
        motion.slack[:, :] = 0.0
        work.pull[:, :] = 0.0
        motion.tug[:, :] = 0.0
        load(plan, model, sol, work, motion, shove, row, 1.0)
        release(plan, model, work.G)
        solve(ints, floats, space, moving)
        for other in range(rows):
            answers[other, row] = moved(plan, sol, work, motion, shove, other) if asked(motion, other) else 0.0


@inline
def aside_of(ints: Whole, motion: Motion) -> tuple[Floats, Floats]:
    """Forces of rows on the nodes (n, 3) [N], and answers to rows (ROWS, ROWS) [m/N], of `aside`."""
    at = 3 * ints[0] + 3 * (ints[0] + ints[1]) + 6 * ints[1] + 3 * ints[2]
    n = ints[0] + ints[1]
    return part(motion.aside, at, (n, 3)), part(motion.aside, at + 3 * n, (ROWS, ROWS))


@inline
def share(
    motion: Motion, rows: int, answers: Floats, gaps: Floats, forces: Floats, change: Floats, room: Floats
) -> None:
    """Fills `change`: pushes and friction, until each meets its law beside the others.

    In turns, which seldom end where points near each other stick: there all at once, with what sticks and slips as
    turns have left it, and once more in turns, that all laws hold.
    """
    for k in range(MOST_TRIES):
        if take_turns(motion, rows, answers, gaps, forces, change) or k + 1 == MOST_TRIES:
            break
        for i in range(rows // 3):
            room[3 * i, ROWS + 1] = 0.0 if is_full(motion, i, forces, change) else 1.0
        for _ in range(rows // 3 + 1):
            if not meet(motion, rows, answers, gaps, forces, change, room):
                return  # points so near each other that turns alone tell how they share a force
            if not slip(motion, rows, forces, change, room):
                break


@inline
def is_full(motion: Motion, i: int, forces: Floats, change: Floats) -> bool:
    """Whether the friction of point i is as large as it may be."""
    k, grip = 3 * i, motion.props[i, GRIP]
    a, b, limit = forces[k + 1] + change[k + 1], forces[k + 2] + change[k + 2], grip * (forces[k] + change[k])
    return bool(grip >= 0.0 and a * a + b * b >= ((1.0 - FULL) * limit) ** 2)


@inline
def slip(motion: Motion, rows: int, forces: Floats, change: Floats, room: Floats) -> bool:
    """Has the point slip that sticks by most more than it may; False: none does."""
    worst, most = -1, 1.0 + FULL
    for i in range(rows // 3):
        k, grip = 3 * i, motion.props[i, GRIP]
        push = forces[k] + change[k]
        if grip > 0.0 and push > 0.0 and room[k, ROWS + 1] > 0.0:
            a, b = forces[k + 1] + change[k + 1], forces[k + 2] + change[k + 2]
            ratio = (a * a + b * b) ** 0.5 / (grip * push)
            worst, most = (i, ratio) if ratio > most else (worst, most)
    if worst >= 0:
        room[3 * worst, ROWS + 1] = 0.0
    return worst >= 0


@viewing
def take_turns(motion: Motion, rows: int, answers: Floats, gaps: Floats, forces: Floats, change: Floats) -> bool:
    """Changes forces in turns until all laws hold; whether they do."""
    for _ in range(MOST_ROUNDS):
        largest = worst = 0.0
        for i in range(rows // 3):
            k, push = 3 * i, 0.0
            if asked(motion, k) and answers[k, k] > 0.0:
                gap = gaps[k]
                for other in range(rows):
                    gap += answers[k, other] * change[other]
                push = max(0.0, forces[k] + change[k] - gap / answers[k, k])
                worst, largest = max(worst, abs(push - forces[k] - change[k])), max(largest, push)
                change[k] = push - forces[k]
            soft = max(answers[k + 1, k + 1], answers[k + 2, k + 2])
            if not (asked(motion, k + 1) and soft > 0.0):
                continue
            first, second = gaps[k + 1], gaps[k + 2]
            for other in range(rows):
                first += answers[k + 1, other] * change[other]
                second += answers[k + 2, other] * change[other]
            a, b = forces[k + 1] + change[k + 1] - first / soft, forces[k + 2] + change[k + 2] - second / soft
            size, limit = (a * a + b * b) ** 0.5, motion.props[i, GRIP] * push
            if motion.props[i, GRIP] < 0.0:
                limit, largest = size, max(largest, size)
            f = limit / size if size > limit else 1.0
            worst = max(worst, abs(f * a - forces[k + 1] - change[k + 1]), abs(f * b - forces[k + 2] - change[k + 2]))
            change[k + 1], change[k + 2] = f * a - forces[k + 1], f * b - forces[k + 2]
        if worst <= SAME * largest:
            return True
    return False


@viewing
def meet(
    motion: Motion, rows: int, answers: Floats, gaps: Floats, forces: Floats, change: Floats, room: Floats
) -> bool:  # fmt: skip
    """Changes all forces at once: what presses keeps to its plane, what sticks to its place, what slips to its limit.

    What sticks has more than 0 in column ROWS + 1 of its first row in `room`. False, and nothing changes, where they
    cannot be told apart.
    """
    for row in range(rows):
        i, k = row // 3, 3 * (row // 3)
        grip, push = motion.props[i, GRIP], forces[k] + change[k]
        for c in range(rows):
            room[row, c] = 1.0 if c == row else 0.0
        room[row, ROWS] = change[row]
        if not (asked(motion, row) and answers[row, row] > 0.0 and (grip < 0.0 or push > 0.0)):
            continue
        a, b = forces[k + 1] + change[k + 1], forces[k + 2] + change[k + 2]
        size = (a * a + b * b) ** 0.5
        if row == k or grip < 0.0 or room[k, ROWS + 1] > 0.0:
            for c in range(rows):
                room[row, c] = answers[row, c] if asked(motion, c) else 0.0
            room[row, ROWS] = -gaps[row]
        else:
            share_of_push = grip * (a if row == k + 1 else b) / size if size > 0.0 else 0.0
            room[row, k] = -share_of_push
            room[row, ROWS] = share_of_push * forces[k] - forces[row]
    return eliminate(room, change, rows, ROWS)


@viewing
def eliminate(room: Floats, out: Floats, count: int, right: int) -> bool:
    """Solves for `out` (count,) with the first `count` columns, and the right-hand side in column `right`.

    False, and `out` is as it was, if a pivot is lost in rounding.
    """
    largest = 0.0
    for k in range(count):
        for c in range(count):
            largest = max(largest, abs(room[k, c]))
    for k in range(count):
        best = k
        for i in range(k + 1, count):
            best = i if abs(room[i, k]) > abs(room[best, k]) else best
        for c in range(right + 1):
            room[k, c], room[best, c] = room[best, c], room[k, c]
        if not abs(room[k, k]) > LOST * largest:
            return False
        for i in range(k + 1, count):
            f = room[i, k] / room[k, k]
            for c in range(k, right + 1):
                room[i, c] -= f * room[k, c]
    for k in range(count - 1, -1, -1):
        value = room[k, right]
        for c in range(k + 1, count):
            value -= room[k, c] * out[c]
        out[k] = value / room[k, k]
    return True


@inline
def give_way(ints: Whole, motion: Motion, fraction: float) -> None:
    """Changes the forces by this share of what `brace` has found."""
    n = ints[0] + ints[1]
    change = part(motion.aside, 3 * ints[0] + 6 * n + 6 * ints[1] + 3 * ints[2] + ROWS * (ROWS + 2), (ROWS,))
    for i in range(int(motion.par[N_PROPS])):
        k = 3 * i
        motion.props[i, PUSH] += fraction * change[k]
        t = take3(motion.props, i, DRY)
        for row in range(k + 1, k + 3):
            if asked(motion, row):
                t = add(t, scale(fraction * change[row], direction(motion.props, row)))
        put3(motion.props, i, DRY, t)
