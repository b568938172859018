"""A structure with one element a span: what a model knows before there is a mesh, :class:`Bare`."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple, final

import numpy as np

from cable_shape.checks import Array
from cable_shape.kernels.network import tables
from cable_shape.solve.cables import Structure
from cable_shape.solve.plan import Whole, make_plan

IDENTITY = (0.0, 0.0, 0.0, 1.0)


@final
class Bare(NamedTuple):
    """A structure with one element a span, and where things are in its model; shared, never written to."""

    ints: Whole
    floats: Array  # a model in which supports are told, and nothing of the cable
    s: slice
    force: slice
    moment: slice  # of the last knot
    heavy: slice
    breaks: slice
    piece: slice
    at: slice
    act: slice
    friction: slice
    draw: slice


@lru_cache(maxsize=256)
def bare_of(structure: Structure) -> Bare:
    """A structure's plan and model but for the mesh."""
    ints = make_plan(structure.knots, structure.spans, structure.cables, [1] * len(structure.spans), structure.rings)
    floats = np.zeros(tables.model_size.py_func(ints))
    model = tables.model_of.py_func(ints, floats)
    model.free[...], model.frame[...], model.loose[...] = structure.free, IDENTITY, structure.loose
    return Bare(
        ints,
        floats,
        s=_place(model.s, floats),
        force=_place(model.force, floats),
        moment=_place(model.moment[-1], floats),
        heavy=_place(model.heavy, floats),
        breaks=_place(model.breaks, floats),
        piece=_place(model.piece, floats),
        at=_place(model.at, floats),
        act=_place(model.act, floats),
        friction=_place(model.friction, floats),
        draw=_place(model.draw, floats),
    )


def _place(part: Array, whole: Array) -> slice:
    """Where a part of a flat array is in it."""
    start = (part.ctypes.data - whole.ctypes.data) // whole.itemsize
    return slice(start, start + part.size)
