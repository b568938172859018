"""What a cable and its scene are to the solver of networks: knots, spans, pieces of one material, point loads."""

from __future__ import annotations

from typing import NamedTuple, final

import numpy as np

from cable_shape.cable.cable import Cable as CableProperties
from cable_shape.cable.pieces import cable_at, pieces_of
from cable_shape.checks import Array
from cable_shape.kernels.network import material
from cable_shape.solve.plan import Cable, Knot, Span
from cable_shape.solve.problem import Problem

#: Rotations of the cable frame that a grip or a clip leaves free: about d1, d2, d3.
FREE_ROTATIONS = {
    "clamped": (0.0, 0.0, 0.0),
    "fixed": (0.0, 0.0, 0.0),
    "swivel": (0.0, 0.0, 1.0),
    "hinge": (0.0, 0.0, 1.0),
    "pinned": (1.0, 1.0, 1.0),
    "ball": (1.0, 1.0, 1.0),
    "slide": (1.0, 1.0, 1.0),
    "free": (1.0, 1.0, 1.0),
}
#: Loads and kinks nearer to a support than this fraction of the length are at it.
AT = 1e-9
#: A kink of the rest curvature becomes a node if inside an element of a 20th of the length it may move the shape by
#: this fraction of the tolerance; at most so many do.
_FELT, _MOST_KINKS = 0.02, 200
#: Columns of a piece that are its loads, at its left and at its right.
LOADS: Array = np.concatenate([np.arange(first, first + 3) for first in (material.LOAD_LEFT, material.LOAD_RIGHT)])
_WEIGHTLESS: Array = np.zeros((2, 3))


@final
class Material(NamedTuple):
    """A cable from end to end."""

    breaks: Array  # (p + 1,) [m], arc lengths between its pieces
    pieces: Array  # (p, PIECE) see `kernels.network.material`
    stops: Array  # (j,) [m], those of the breaks that are to be nodes
    straight: bool  # without rest curvature


def material_of(problem: Problem) -> Material:
    """The pieces of the problem's cable: its rest curvature and its load are linear in each."""
    found = problem.cache.get("material")
    if found is None:
        found = problem.cache["material"] = _material_of(problem)
    assert isinstance(found, Material)
    return found


def _material_of(problem: Problem) -> Material:
    """The same, made."""
    cable = problem.cable
    length = cable.length
    rest = np.atleast_2d(cable.rest_curvature)
    swing = problem.swing
    if cable.sections:
        return _in_sections(problem)
    if len(rest) == 1 and swing is None:
        return Material(
            np.array((0.0, length)), _piece(cable, rest[0], rest[0], problem.load), _NOWHERE, not rest.any()
        )
    rows = 0 if swing is None else len(swing)
    made = problem.made.get((rows, problem.tolerance))
    if made is None:
        made = problem.made[rows, problem.tolerance] = _unloaded(problem, rows)
    load = problem.load[0] + made.breaks[:, None] / length * (problem.load[1] - problem.load[0])
    if swing is not None:
        places = np.linspace(0.0, length, rows)
        load -= cable.linear_density * np.stack([np.interp(made.breaks, places, x) for x in swing.T], axis=1)
    pieces = made.pieces.copy()
    pieces[:, LOADS] = np.concatenate((load[:-1], load[1:]), axis=1)
    return made._replace(pieces=pieces)


def _unloaded(problem: Problem, rows: int) -> Material:
    """The same without loads, whose slope changes at `rows` places, evenly along the cable; 0: nowhere."""
    cable = problem.cable
    length, rest = cable.length, np.atleast_2d(cable.rest_curvature)
    places = np.linspace(0.0, length, rows)
    kinks = np.concatenate((np.array((0.0, length)), np.linspace(0.0, length, len(rest))[1:-1], places))
    breaks = _distinct(kinks, AT * length)
    stops = _distinct(np.concatenate((places[1:-1], _felt(problem, rest))), AT * length)
    return Material(breaks, substance(cable, breaks / length), stops, not rest.any())


def _in_sections(problem: Problem) -> Material:
    """The same of a cable with sections: what it is made of, and its weight, may jump where they begin and end."""
    cable = problem.cable
    length = cable.length
    parts = pieces_of(cable)
    bounds = [x for a, b, _ in parts for x in (a, b)]
    rest = np.atleast_2d(cable.rest_curvature)
    felt = _felt(problem, rest)
    kinks = [np.array(bounds)]
    if len(rest) > 1:
        kinks.append(np.linspace(0.0, length, len(rest)))
    if problem.acceleration is not None:
        places = np.linspace(0.0, length, len(problem.acceleration))
        kinks.append(places)
        felt = np.concatenate((felt, places[1:-1] if problem.swing is not None else places[:0]))
    breaks = _distinct(np.concatenate(kinks), AT * length)
    breaks[np.abs(breaks - length) <= AT * length] = length
    out = substance(cable, breaks / length)
    middles = 0.5 * (breaks[1:] + breaks[:-1])
    falls = np.array([problem.fall(s) for s in breaks])
    load = problem.load[0] + (breaks / length)[:, None] * (problem.load[1] - problem.load[0])
    if problem.swing is not None:
        at = np.linspace(0.0, length, len(problem.swing))
        load = load - cable.linear_density * np.stack([np.interp(breaks, at, x) for x in problem.swing.T], axis=1)
    heavier = np.array([cable_at(cable, s).linear_density - cable.linear_density for s in middles.tolist()])[:, None]
    out[:, LOADS] = np.concatenate((load[:-1] + heavier * falls[:-1], load[1:] + heavier * falls[1:]), axis=1)
    inner = np.array(bounds)
    stops = _distinct(np.concatenate((felt, inner[(inner > AT * length) & (inner < (1.0 - AT) * length)])), AT * length)
    straight = not any(one.rest_curvature.any() for _, _, one in parts)
    return Material(breaks, out, stops, straight)


def kinks_of(problem: Problem) -> tuple[Array, Array]:
    """Arc lengths (k,) [m] of the kinks of the problem's load, and by how much its slope changes there (k,) [N/m^2]."""
    swing, cable = problem.swing, problem.cable
    if swing is None or len(swing) == 2:
        return _NOWHERE, _NOWHERE
    places = np.linspace(0.0, cable.length, len(swing))
    turn = np.linalg.norm(np.diff(swing, n=2, axis=0), axis=1)
    return places[1:-1], cable.linear_density * turn / places[1]


def substance(cable: CableProperties, shares: Array) -> Array:
    """(p, PIECE): pieces of a cable between these shares (p + 1,) of its length, without loads."""
    if cable.sections:
        parts = pieces_of(cable)
        which = np.searchsorted(
            [end for _, end, _ in parts[:-1]], 0.5 * (shares[1:] + shares[:-1]) * cable.length, "right"
        )
        first = np.flatnonzero(np.diff(which, prepend=-1))
        bounds = zip(which[first].tolist(), first.tolist(), [*first[1:].tolist(), len(which)], strict=True)
        return np.concatenate([substance(parts[part][2], shares[a : b + 1]) for part, a, b in bounds])
    rest = np.atleast_2d(cable.rest_curvature)
    places = np.linspace(0.0, 1.0, len(rest)) if len(rest) > 1 else np.zeros(1)
    bent = np.stack([np.interp(shares, places, x) for x in rest.T], axis=1)
    out = np.tile(_piece(cable, bent[0], bent[0], _WEIGHTLESS), (len(shares) - 1, 1))
    out[:, material.REST_LEFT : material.REST_LEFT + 3] = bent[:-1]
    out[:, material.REST_RIGHT : material.REST_RIGHT + 3] = bent[1:]
    return out


def shared_loads(problem: Problem, arcs: Array) -> tuple[Array, Array, Array]:
    """Concentrated loads: (m+1, 3) [N] on supports at arc lengths `arcs` (m+1,); arc lengths (k,) and forces (k, 3) of
    the others."""
    own = np.zeros((arcs.size, 3))
    at, force = problem.load_arc_length, problem.load_force
    if at.size == 0:
        return own, at, force
    near = np.abs(at[:, None] - arcs).argmin(axis=1)
    held = np.abs(at - arcs[near]) < AT * arcs[-1]
    np.add.at(own, near[held], force[held])
    return own, at[~held], force[~held]


def _piece(cable: CableProperties, first: Array, last: Array, load: Array) -> Array:
    """One row of pieces: rest curvature (3,) [1/m] and load (2, 3) [N/m] at its ends."""
    stiffness = (*cable.bending_stiffness, cable.twisting_stiffness)
    shear = 0.0 if cable.shear_stiffness is None else 1.0 / cable.shear_stiffness
    stretch = 0.0 if cable.axial_stiffness is None else 1.0 / cable.axial_stiffness
    left, right = (*first.tolist(), *load[0].tolist()), (*last.tolist(), *load[1].tolist())
    return np.array(((*stiffness, *left, *stiffness, *right, shear, shear, stretch),))


def _felt(problem: Problem, rest: Array) -> Array:
    """Arc lengths of the kinks of the rest curvature that a tolerance makes nodes of."""
    length = problem.cable.length
    if len(rest) < 3:
        return np.empty(0)
    places = np.linspace(0.0, length, len(rest))
    turn = np.abs(np.diff(rest, n=2, axis=0)).sum(axis=1) / (length / (len(rest) - 1))  # of the slope, 1/m^2
    felt = material.ROUGHNESS * turn * (length / 20.0) ** 3 > _FELT * problem.tolerance
    most = np.sort(turn)[-_MOST_KINKS] if turn.size > _MOST_KINKS else 0.0
    return np.asarray(places[1:-1][felt & (turn >= most)])


def _distinct(values: Array, apart: float) -> Array:
    """Ascending, without what is nearer than `apart` to the one before."""
    values = np.sort(values)
    if values.size == 0:
        return values
    return values[np.concatenate(([True], np.diff(values) > apart))]


@final
class Structure(NamedTuple):
    """How a cable is held: all that the plan of the network needs but the mesh."""

    knots: tuple[Knot, ...]
    spans: tuple[Span, ...]
    cables: tuple[Cable, ...]
    rings: tuple[tuple[int, int], ...]
    free: tuple[tuple[tuple[float, ...], tuple[float, ...]], ...]  # (m, 2, 3)
    loose: tuple[tuple[float, ...], ...]  # (k, 3)


_NOWHERE: Array = np.empty(0)
_HELD, _NO_TURN = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)


def structure_of(kinds: tuple[str, ...], pieces: int, points: int, round_straight: bool) -> Structure:
    """One cable in supports of these kinds: start grip, clips, end grip or "free"."""
    masks = [FREE_ROTATIONS[kind] for kind in kinds]
    last = len(kinds) - 1
    if round_straight and all(mask[2] for mask in masks):
        masks[0] = (masks[0][0], masks[0][1], 0.0)  # nothing holds the roll of a round straight cable: a zero mode
    knots = [Knot(turns=0 < k < last and any(mask), moves=kinds[k] == "free") for k, mask in enumerate(masks)]
    spans, free = [], []
    for j in range(last):
        spans.append(Span(j, j + 1, (knots[j].turns, knots[j + 1].turns)))
        free.append(tuple(_HELD if knots[k].turns else masks[k] for k in (j, j + 1)))
    held = [k for k in range(last) if FREE_ROTATIONS[kinds[k]][2] == 0.0]
    roll = (held[-1] if held else 0, last)
    return Structure(
        tuple(knots),
        tuple(spans),
        (Cable(last, pieces, points, roll),),
        tuple((k, k - 1) for k in range(1, last) if kinds[k] == "slide"),
        tuple((a, b) for a, b in free),
        tuple(mask if knot.turns else _NO_TURN for mask, knot in zip(masks, knots, strict=True)),
    )
