"""What the symmetric matrix lacks where a dead moment acts on a free end: :func:`turn_with`."""

from __future__ import annotations

from cable_shape.kernels.network.compiled import viewing
from cable_shape.kernels.network.graph import solve
from cable_shape.kernels.network.system import NONE
from cable_shape.kernels.network.tables import TRIAL, Floats, Whole, model_of, plan_of, solution_of, work_of
from cable_shape.kernels.rod_algebra import (
    add,
    apply,
    get3,
    get4,
    get9,
    hat,
    inverse,
    madd,
    mscale,
    mul,
    put3,
    rotation,
    subtract,
    tapply,
)
from cable_shape.kernels.rod_element import IDENTITY


@viewing
def turn_with(ints: Whole, floats: Floats, sols: Floats, space: Floats, largest: float) -> float:
    """Solves once more where a dead moment acts on a free end: of its derivative the matrix lacks hat(g) / 2.

    Hessians of elements are symmetric: along a cable those parts of a gradient g that is not zero cancel; at its end
    the elements' gradient is the moment. To be called after `graph.solve`, whose right-hand side is left as it was;
    returns its largest step, or `largest` where there is no such moment.
    """
    plan, model = plan_of(ints), model_of(ints, floats)
    sol, work = solution_of(ints, sols, TRIAL), work_of(ints, space)
    for j in range(plan.ends.shape[0]):
        m = get3(model.moment, plan.ends[j, 1])
        if plan.tied[j, 1] != 0 or m == NONE:
            continue
        node = plan.first[j + 1] + j
        T = mscale(0.5, hat(tapply(rotation(get4(sol.q, node)), m)))
        g, d = get3(work.G, node), get3(work.d, node)
        if plan.known[j] != 0 and plan.tied[j, 0] == 0:
            B = get9(work.P, node, 0)
        else:  # how the end answers a moment, the knot that it turns with included
            put3(work.G, node, 0, (g[0] + 1.0, g[1], g[2]))
            solve(ints, floats, space)
            x = subtract(d, get3(work.d, node))
            put3(work.G, node, 0, (g[0], g[1] + 1.0, g[2]))
            solve(ints, floats, space)
            y = subtract(d, get3(work.d, node))
            put3(work.G, node, 0, (g[0], g[1], g[2] + 1.0))
            solve(ints, floats, space)
            z = subtract(d, get3(work.d, node))
            B = (x[0], y[0], z[0], x[1], y[1], z[1], x[2], y[2], z[2])
        own, _ = inverse(madd(IDENTITY, mul(B, T)))
        put3(work.G, node, 0, add(g, apply(T, apply(own, d))))
        largest = solve(ints, floats, space)
        put3(work.G, node, 0, g)
    return largest
