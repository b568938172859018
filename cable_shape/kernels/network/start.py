"""A shape from nothing in one compiled call: meshes, guesses, Newton's method, finer meshes until the error is met."""

from __future__ import annotations

import numpy as np
from numba import types

from cable_shape.kernels._jit import kernel
from cable_shape.kernels.network.compiled import viewing
from cable_shape.kernels.network.drive import I_DOUBT, I_ESTIMATE, I_TURN, LARGEST_TURN, solve, strip
from cable_shape.kernels.network.guess import CURVED, HANGING, WAVY, bend_of, guess, length_of
from cable_shape.kernels.network.mesh import AIM, Arrays, counts_of, laid_out, next_counts, wish_first, wish_next
from cable_shape.kernels.network.newton import CONVERGED, I_ITERATIONS, STALLED
from cable_shape.kernels.network.system import NONE
from cable_shape.kernels.network.tables import (
    N_KNOTS,
    N_SPANS,
    TRIAL,
    Floats,
    Whole,
    copy,
    copy_rows,
    model_of,
    plan_of,
    solution_of,
    solution_size,
)
from cable_shape.kernels.rod_algebra import add, get3, subtract
from cable_shape.kernels.rod_guess import norm

#: What `start` returns: a shape was found; one was found and then lost on a finer mesh; no guess led to one.
FOUND, LOST, NOTHING = 0, 1, 2
MOST_ITERATIONS, MOST_MESHES = 80, 12
ANYWHERE = 1e3  # rad
TAUT = 0.97  # chord / length from which a span hangs however stiff it is

Started = tuple[int, Whole, Floats, Floats, Floats]


@viewing
def put_knots(ints: Whole, sols: Floats, poses: Floats, turns: float) -> None:
    """Puts the knots' poses (k, 7) and the turns of the cables into the trial."""
    sol = solution_of(ints, sols, TRIAL)
    copy_rows(sol.pose, poses, 7)
    sol.turns[:] = turns


@viewing
def hangs(bare: Whole, held: Floats, poses: Floats) -> tuple[bool, bool, bool]:
    """Whether some span is between places that are given, weighs something, and is soft or taut."""
    plan, model = plan_of(bare), model_of(bare, held)
    longest = whole = 0.0
    total = NONE
    taut = False
    for j in range(plan.known.shape[0]):
        length = length_of(plan, model, j)
        whole += length
        total = add(total, get3(model.weight, j))
        if plan.known[j] == 0:
            longest = max(longest, length)
            chord = subtract(get3(poses, plan.ends[j, 1]), get3(poses, plan.ends[j, 0]))
            taut = taut or norm(chord) > TAUT * length
    weight = norm(total) / whole
    return longest > 0.0, weight > 0.0, taut or bend_of(plan, model, 0) < weight * (0.3 * longest) ** 3


@kernel
def likeliest(bare: Whole, held: Floats, poses: Floats) -> Floats:
    """Guesses (g, 2) for the knots at `poses` (k, 7), kind and tilt as of `guess.guess`, in the order to try them.

    Soft or taut cables hang, stiff ones curve; what has no weight may go in waves from clip to clip.
    """
    between, weighs, soft = hangs(bare, held, poses)
    if not between:
        return np.array(((1.0 * CURVED, 0.3),))
    last = (1.0 * CURVED, 1.2) if bare[N_SPANS] == 1 else (1.0 * WAVY, 0.3)
    first, second = (1.0 * CURVED, 0.3), (1.0 * HANGING, 0.0)
    if bare[N_SPANS] > 1 and not weighs:
        first, second, last = last, first, second
    elif soft:
        first, second = second, first
    return np.array((first, second, (1.0 * CURVED, 0.8), (1.0 * CURVED, 0.02), last))


@kernel
def first_mesh(
    bare: Whole, held: Floats, poses: Floats, turns: float, stops: Floats, finer: float, turn: float
) -> Arrays:
    """Plan, model, solutions and work space on a cold start's mesh, see `mesh.wish_first`; the knots at `poses`."""
    nothing = np.zeros(3 * solution_size(bare))
    put_knots(bare, nothing, poses, turns)
    strip(bare, held, nothing)
    wish = wish_first(bare, held, nothing, finer, turn)
    if bare[N_SPANS] == 1:
        wish.share[0] += 2 * stops.shape[0]
    counts = counts_of(bare, held, wish.share, 1.0, stops)
    return laid_out(bare, held, bare, held, nothing, counts, stops, wish)


@kernel(late=types.Tuple((types.boolean, types.int64[::1], *3 * (types.float64[::1],))))
def next_mesh(
    bare: Whole, held: Floats, ints: Whole, floats: Floats, sols: Floats, stops: Floats, estimate: float,
    tolerance: float,
) -> tuple[bool, Whole, Floats, Floats, Floats]:  # fmt: skip
    """The same on the mesh that the last solution asks for, which is the trial, too; False if it cannot be finer."""
    wish = wish_next(ints, floats, sols, estimate / (AIM * tolerance))
    counts = next_counts(ints, floats, wish.share, stops, estimate > tolerance)
    if counts.shape[0] == 0:
        return False, ints, floats, sols, floats
    new, model, solutions, space = laid_out(bare, held, ints, floats, sols, counts, stops, wish)
    size = solution_size(new)
    copy(solutions[2 * size :], solutions[:size])
    return True, new, model, solutions, space


@kernel(nogil=True)
def start(
    bare: Whole, held: Floats, poses: Floats, turns: float, stops: Floats, finer: float,
    tolerance: float, meshes: int, points: int, out: Floats, info: Floats, loads: Floats,
) -> Started:  # fmt: skip
    """Solves for the knots at `poses` (k, 7): one of FOUND, LOST and NOTHING, then plan, model, solutions, work space.

    bare, held: plan and model on any mesh. turns: those that the signs of the poses are of. stops: arc lengths that are
    nodes. finer: so many times the usual number of elements. tolerance [m]: of the error, for which so many further
    `meshes` are tried. points, out, info, loads: see `drive.solve`; the iterations are those of all solves.
    """
    ints, floats, sols, space = first_mesh(bare, held, poses, turns, stops, finer, 0.0)
    guesses = likeliest(bare, held, poses)
    placed = np.zeros(bare[N_KNOTS], np.int64)
    status, iterations = STALLED, 0.0
    for g in range(guesses.shape[0]):
        put_knots(ints, sols, poses, turns)
        strip(ints, floats, sols)
        guess(ints, floats, sols, placed, int(guesses[g, 0]), guesses[g, 1], turns != 0.0)
        status = solve(
            ints, floats, sols, space, out, info, loads, points, 0, False, False, True, MOST_ITERATIONS, ANYWHERE
        )
        iterations += info[I_ITERATIONS]
        if status == CONVERGED:
            break
    found = FOUND if status == CONVERGED else NOTHING
    for _ in range(meshes):
        if found != FOUND or not (info[I_ESTIMATE] + info[I_DOUBT] > tolerance or info[I_TURN] > LARGEST_TURN):
            break
        more, ints, floats, sols, space_of = next_mesh(
            bare, held, ints, floats, sols, stops, info[I_ESTIMATE] + info[I_DOUBT], tolerance
        )
        if not more:
            break
        space = space_of
        status = solve(
            ints, floats, sols, space, out, info, loads, points, 0, False, False, True, MOST_ITERATIONS, ANYWHERE
        )
        iterations += info[I_ITERATIONS]
        if status != CONVERGED:
            found = LOST
    info[I_ITERATIONS] = iterations
    return found, ints, floats, sols, space
