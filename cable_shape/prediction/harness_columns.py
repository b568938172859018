"""How the last shape of a harness moves with what holds it, and with its numbers: :func:`columns_by`."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np

from cable_shape.cable.harness import split_end
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError, UnknownKeyError
from cable_shape.pose import Grip
from cable_shape.solve.answers import NUMBERS, about_gripper, pair_of, refreshed, run_on
from cable_shape.solve.harness_answers import HarnessChanges, answers
from cable_shape.solve.harness_network import HarnessNetwork
from cable_shape.solve.harness_problem import HarnessProblem
from cable_shape.solve.touching.harness_state import HarnessTouchState


def columns_by(
    problem: HarnessProblem,
    state: HarnessNetwork | HarnessTouchState,
    by: Sequence[str],
    at: str,
    called: Mapping[str, str],
) -> Array:
    """(s points, 3, m), of the s segments in turn: see :meth:`.harness_predictor.HarnessPredictor.sensitivity`.

    called: the names of its segments in what solved for them, `state`, which may be of others, too.
    """
    bodies = _names(problem, by)
    whole, n = state.problem, problem.points
    first = n * list(whole.segments).index(next(iter(called.values())))
    names = [name if name in bodies else _called(problem, whole, called, name) for name in by]
    return _columns(whole, state, names, at, bodies)[first : first + n * len(called)]


def _called(problem: HarnessProblem, whole: HarnessProblem, called: Mapping[str, str], name: str) -> str:
    """What a harness names among others, as all of them call it."""
    kind, _, rest = name.partition(":")
    if kind == "clip":
        number = problem.clip_names.index(rest)
        segment, numbers = next((one, own) for one, own in problem.clips.items() if number in own)
        return f"clip:{whole.clip_names[whole.clips[called[segment]][numbers.index(number)]]}"
    if rest:
        return f"{kind}:{called[rest]}"
    segment, side = split_end(name)
    return f"{called[segment]}.{side}"


def _columns(
    problem: HarnessProblem,
    state: HarnessNetwork | HarnessTouchState,
    by: Sequence[str],
    at: str,
    bodies: Collection[str],
) -> Array:
    """Of all that `state` has solved for, whose problem this is."""
    held = [name for name in by if name in problem.grips]
    clips = [name for name in by if name.startswith("clip:")]
    numbers = [name for name in by if name.partition(":")[0] in NUMBERS]
    segments = len(problem.segments) * problem.points
    which = [problem.clip_names.index(name.removeprefix("clip:")) for name in clips]
    moved = state.sensitivities(held, which)[:segments]
    blocks = {name: moved[:, :, 6 * i : 6 * i + 6] for i, name in enumerate((*held, *clips))}
    if at == "gripper":
        for name in held:
            end = problem.ends[name]
            assert isinstance(end, Grip)
            about_gripper(end, blocks[name])
    if numbers:
        columns = _by_numbers(problem, state, numbers)
        blocks.update((name, columns[:, :, i : i + 1]) for i, name in enumerate(numbers))
    none = np.zeros((segments, 3, 6))
    for name in by:
        if name in bodies:
            touches = isinstance(state, HarnessTouchState)
            blocks[name] = _by_body(state, name.removeprefix("body:"))[:segments] if touches else none
        elif name not in blocks:
            blocks[name] = none  # a free end
    return np.concatenate([blocks[name] for name in by], axis=2)


def _names(problem: HarnessProblem, by: Sequence[str]) -> set[str]:
    """Refuses names that mean nothing here; those of bodies."""
    scene = () if problem.scene is None else problem.scene.obstacles
    bodies = {f"body:{body.name}" for body in (*scene, *problem.bodies)}
    clips = [f"clip:{name}" for name in problem.clip_names]
    if not by:
        raise ArgumentError.of("by", by, "it must name something", "Write ('a.start', 'length:b'), for example.")
    known = [
        *problem.ends,
        *clips,
        *sorted(bodies),
        *(f"{kind}:{name}" for kind in NUMBERS for name in problem.segments),
    ]
    for name in by:
        if name not in known:
            raise UnknownKeyError.among("by", name, known)
        if by.count(name) > 1:
            raise ArgumentError.of("by", name, "it must be named once", "Leave it out where it comes again.")
    return bodies


def _by_numbers(problem: HarnessProblem, state: HarnessNetwork | HarnessTouchState, names: Sequence[str]) -> Array:
    """A column for each number of a segment."""
    pairs, steps = [], []
    for name in names:
        kind, _, segment = name.partition(":")
        cables, step = pair_of(problem.harness.segments[segment], kind)
        pairs.append((problem.beside(segment, cables[0]), problem.beside(segment, cables[1])))
        steps.append(step)
    return answers(state, HarnessChanges(problem, pairs, np.array(steps)))


def _by_body(state: Any, name: str) -> Array:
    """Six columns of a body that moves."""
    out, df = state.body_columns(name)
    return run_on(out, df, refreshed(state))
