"""The form of a harness at rest, without load, as a start for the search of one whose segments are bent at rest.

Every part is put together as it was made, segment by segment through its junctions, and laid as a whole to where it is
held. Of a tree that is an equilibrium without load between supports that lie there; from it Newton's method goes on.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from cable_shape.cable.harness import split_end
from cable_shape.cable.rest_form import form, times, turned
from cable_shape.checks import Array
from cable_shape.kernels.network import material, tables
from cable_shape.pose import Pose
from cable_shape.solve.cables import material_of
from cable_shape.solve.harness_layout import MOST_ROWS
from cable_shape.solve.harness_network import HarnessNetwork
from cable_shape.solve.problem import Problem

#: Steps of a segment's form, at least.
_STEPS = 64
#: [lengths of the longest segment] at which a frame that is held counts like points beside it.
_ARM = 0.2
#: [rad], by which an element turns at rest on the first mesh.
_TURN = 0.15
#: Share of the tolerance by which a kink inside an element may move the shape: errors count some twenty times.
_FELT = 0.02


class Form(NamedTuple):
    """A segment at rest, from a start at the origin."""

    s: Array  # (n,) [m]
    r: Array  # (n, 3) [m]
    q: Array  # (n, 4)


def bent(state: HarnessNetwork) -> bool:
    """Whether a segment is drawn bent, as preformed ones are; cables that took a set hang as straight ones do."""
    cables = [one.cable for one in state.problem.segments.values()]
    return any(len(cable.rest_curvature) > MOST_ROWS and cable.rest_curvature.any() for cable in cables)


def form_of(one: Problem) -> Form:
    """The form of a segment at rest."""
    made = material_of(one)
    breaks = np.union1d(made.breaks, np.linspace(0.0, one.cable.length, _STEPS + 1))
    h = np.diff(breaks)
    i = np.clip(np.searchsorted(made.breaks, breaks[:-1] + 0.5 * h, side="right") - 1, 0, len(made.pieces) - 1)
    left, right = (made.pieces[i, first : first + 3] for first in (material.REST_LEFT, material.REST_RIGHT))
    a, size = made.breaks[i], np.diff(made.breaks)[i]
    begin, end = ((x - a) / size for x in (breaks[:-1], breaks[1:]))
    u = [left + share[:, None] * (right - left) for share in (begin, end)]
    r, q = form(h, u[0], u[1], np.array((0.0, 0.0, 0.0, 1.0)))
    return Form(breaks, r, q)


def put_together(state: HarnessNetwork) -> tuple[dict[str, Form], list[list[str]]]:
    """Each segment's form, with others of its part where that part's first one begins at the origin; the parts."""
    problem = state.problem
    own = {name: form_of(one) for name, one in problem.segments.items()}
    done: dict[str, Form] = {}
    parts: list[list[str]] = []
    for first in own:
        if first in done:
            continue
        parts.append([])
        todo = [(f"{first}.start", Pose())]
        while todo:
            end, pose = todo.pop()
            name, side = split_end(end)
            if name in done:
                continue
            done[name] = _moved(own[name], pose if side == "start" else pose * _pose(own[name], -1).inverse())
            parts[-1].append(name)
            for here, at in (("start", 0), ("end", -1)):
                this = f"{name}.{here}"
                junction = problem.harness.junction_of(this)
                if junction is None:
                    continue
                origin = _pose(done[name], at) * junction.frame(this).inverse()
                todo += [(other, origin * junction.frame(other)) for other in junction.ends if other != this]
    return done, parts


def start_at_rest(state: HarnessNetwork, poses: Array, fineness: float) -> Array:
    """Puts the rest form, laid to the supports at `poses` (k, 7), into the trial; returns the poses of all knots.

    Those of supports are where the rest form has them, which is not where they are.
    """
    forms, parts = put_together(state)
    layout = state.layout
    rows: dict[int, tuple[str, float]] = {}
    for name, spans in layout.spans.items():
        for j in spans:
            ends = state.structure.spans[j].start, state.structure.spans[j].end
            for row, arc in zip(ends, layout.arcs[j], strict=True):
                rows.setdefault(row, (name, float(arc)))
    out = poses.copy()
    part_of = {name: i for i, part in enumerate(parts) for name in part}
    for i in range(len(parts)):
        members = [(row, *at) for row, at in rows.items() if part_of[at[0]] == i]
        found = np.array([_at(forms[name], arc) for _, name, arc in members])
        knots = [state.structure.knots[row] for row, _, _ in members]
        given = np.array([not knot.moves for knot in knots])
        held = np.array([row in state._given_turns for row, _, _ in members])
        index = np.array([row for row, _, _ in members])
        move = _laid(found, poses[index], given, held, _ARM * state.length)
        for name in parts[i]:
            forms[name] = _moved(forms[name], move)
        out[index] = [_at(forms[name], arc) for _, name, arc in members]
    _frames_of_junctions(state, forms, out)
    state.first_mesh(out, fineness)
    _finer_where_bent(state, forms, fineness)
    trial = state.solution(tables.TRIAL)
    trial.pose[...] = out
    trial.lam[...] = _pulled(state, out)
    for name, spans in layout.spans.items():
        for j in spans:
            a, b = state.runs[j]
            trial.q[a : b + 1] = _frames(forms[name], state.nodes[a : b + 1])
    for j, _ in layout.levers:
        a, b = state.runs[j]
        trial.q[a : b + 1] = times(out[state.structure.spans[j].start, 3:][None], layout.frames[j, 0][None])
    return out


def _finer_where_bent(state: HarnessNetwork, forms: dict[str, Form], fineness: float) -> None:
    """Makes elements of the first mesh so short that none turns far, and that kinks inside them are not felt."""
    pieces, counts = [], []
    segment_of = {j: name for name, spans in state.layout.spans.items() for j in spans}
    for j, (low, high) in enumerate(state.layout.arcs):
        a, b = state.runs[j]
        x = np.array((low, high))
        density = np.full(2, (b - a) / (high - low))
        if j in segment_of:
            x, more = _asked(state, state.problem.segments[segment_of[j]], forms[segment_of[j]], low, high)
            density = density[0] + fineness * more
        pieces.append((x, density))
        counts.append(int(np.ceil(np.trapezoid(density, x))))
    state.lay_out(pieces, counts)


def _asked(state: HarnessNetwork, one: Problem, form: Form, low: float, high: float) -> tuple[Array, Array]:
    """Arc lengths (n,) between two, and elements a metre (n,) that turns and kinks there ask for."""
    made = material_of(one)
    x = np.linspace(low, high, 33 + 2 * int(np.count_nonzero((made.breaks > low) & (made.breaks < high))))
    q = _frames(form, x)
    turn = 2.0 * np.arccos(np.minimum(1.0, np.abs((q[1:] * q[:-1]).sum(axis=1)))) / np.diff(x)
    density = np.interp(x, 0.5 * (x[1:] + x[:-1]), turn / _TURN)
    if len(made.pieces) > 1:
        left, right = (made.pieces[:, first : first + 3] for first in (material.REST_LEFT, material.REST_RIGHT))
        slope = (right - left) / np.diff(made.breaks)[:, None]
        kink = np.concatenate(([0.0], np.abs(np.diff(slope, axis=0)).sum(axis=1), [0.0]))
        aim = _FELT * state.tolerance / material.ROUGHNESS
        density = np.maximum(density, (np.interp(x, made.breaks, kink) / aim) ** (1.0 / 3.0))
    return x, density


def _pulled(state: HarnessNetwork, out: Array) -> Array:
    """(m, 3) [N], forces at the ends of spans: half of a span's load at either end, and as much again along it.

    Of a cable without force that has a slope in its rest curvature, what limits its elements has no derivatives.
    """
    model = tables.model_of.py_func(state.ints, state.floats)
    plan = tables.plan_of.py_func(state.ints)
    chord = out[plan.ends[:, 1], :3] - out[plan.ends[:, 0], :3]
    along = chord / np.maximum(np.linalg.norm(chord, axis=1, keepdims=True), 1e-9)
    size = np.empty(len(chord))
    for name, spans in state.layout.spans.items():
        cable = state.problem.harness.segments[name]
        size[spans] = cable.mean_bending_stiffness / cable.length**2
    for j, length in state.layout.levers:
        size[j] = state.stiffest / length**2
    size += 0.5 * np.linalg.norm(model.weight, axis=1)
    return np.asarray(size[:, None] * along - 0.5 * model.weight)


def put_ends(state: HarnessNetwork, poses: Array) -> None:
    """Turns the trial's ends of spans to the frames of their knots: those that are tied, and those that are held."""
    trial, structure = state.solution(tables.TRIAL), state.structure
    for j, (span, masks) in enumerate(zip(structure.spans, structure.free, strict=True)):
        for i, (node, row) in enumerate(zip(state.runs[j], (span.start, span.end), strict=True)):
            if span.tied[i]:
                q = times(trial.pose[row : row + 1, 3:], state.layout.frames[j, i][None])[0]
            elif not any(masks[i]):
                q = poses[row, 3:]
            else:
                continue
            trial.q[node] = q if float(q @ trial.q[node]) >= 0.0 else -q


def _frames_of_junctions(state: HarnessNetwork, forms: dict[str, Form], out: Array) -> None:
    """Poses of junctions, and of knots beside them, from the ends that lead there."""
    for junction in state.problem.harness.junctions:
        row = state.layout.knots["junction", junction.name]
        for i, end in enumerate(junction.ends):
            name, side = split_end(end)
            tip = _pose(forms[name], 0 if side == "start" else -1)
            origin = tip * junction.frame(end).inverse()
            if i == 0:
                out[row] = origin.array
            lever = state.layout.knots.get(("lever", end))
            if lever is not None:
                out[lever, :3], out[lever, 3:] = tip.position, out[row, 3:]


def _laid(found: Array, wanted: Array, given: Any, held: Any, arm: float) -> Pose:
    """The motion that brings `found` (k, 7) nearest to `wanted` where it is given, with its frame where it is held."""
    if not given.any():
        return Pose()
    a, b = [found[given, :3]], [wanted[given, :3]]
    for axis in np.eye(3):
        both = given & held
        a.append(found[both, :3] + arm * turned(found[both, 3:], np.broadcast_to(axis, (int(both.sum()), 3))))
        b.append(wanted[both, :3] + arm * turned(wanted[both, 3:], np.broadcast_to(axis, (int(both.sum()), 3))))
    p, w = np.concatenate(a), np.concatenate(b)
    middle, goal = p.mean(axis=0), w.mean(axis=0)
    U, _, V = np.linalg.svd((w - goal).T @ (p - middle) + 1e-12 * np.eye(3))
    U[:, 2] *= np.linalg.det(U @ V)
    from scipy.spatial.transform import Rotation

    q = Rotation.from_matrix(U @ V).as_quat()
    return Pose(goal - turned(q[None], middle[None])[0], q)


def _moved(one: Form, pose: Pose) -> Form:
    q = pose.quaternion[None]
    return Form(one.s, pose.position + turned(q, one.r), times(np.broadcast_to(q, one.q.shape), one.q))


def _pose(one: Form, i: int) -> Pose:
    return Pose(one.r[i], one.q[i])


def _at(one: Form, arc: float) -> Array:
    """(7,): place and frame at an arc length."""
    q = _frames(one, np.array([arc]))[0]
    return np.concatenate(([np.interp(arc, one.s, x) for x in one.r.T], q))


def _frames(one: Form, s: Array) -> Array:
    """Frames (n, 4) at arc lengths."""
    q = np.stack([np.interp(s, one.s, x) for x in one.q.T], axis=1)
    return np.asarray(q / np.linalg.norm(q, axis=1, keepdims=True))
