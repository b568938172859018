"""What the factors of a free end lack of the dead moment there.

Hessians of elements are symmetric: of a gradient g that is not zero the derivative has the part hat(g) / 2, too. Along
the cable those parts cancel; at the end of the cable the elements' gradient is the moment.
"""

from __future__ import annotations

from typing import Any

from cable_shape.kernels._jit import kernel
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
    tapply,
)
from cable_shape.kernels.rod_element import IDENTITY

Array = Any


@kernel
def add_moment(q: Array, moment: Array, P: Array, G: Array, d: Array) -> bool:
    """Completes the right-hand side G (N+1, 3) of a free end that was solved into d (N+1, 3) without the part above.

    q (N+1, 4); moment (3,) [N m], world; P (N+1, 9): inverse pivots. False: there is no moment, and d is the answer;
    True: solve for G once more.
    """
    if moment[0] == 0.0 and moment[1] == 0.0 and moment[2] == 0.0:
        return False
    last = q.shape[0] - 1
    turn = mscale(0.5, hat(tapply(rotation(get4(q, last)), (moment[0], moment[1], moment[2]))))
    own, _ = inverse(madd(IDENTITY, mul(get9(P, last, 0), turn)))
    put3(G, last, 0, add(get3(G, last), apply(turn, apply(own, get3(d, last)))))
    return True
