"""Cables and harnesses of one scene, kept out of each other: :func:`joined`, and how one moves with another's ends."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from cable_shape.cable.harness import SIDES, split_end
from cable_shape.checks import Array
from cable_shape.pose import Grip
from cable_shape.prediction.harness_predictor import HarnessPredictor
from cable_shape.prediction.layout import cable_id
from cable_shape.prediction.predictor import Predictor
from cable_shape.scene.scene import Clip
from cable_shape.shape import CableShape
from cable_shape.solve.harness_shape import HarnessShape
from cable_shape.solve.touching.crossing import Crossing
from cable_shape.solve.touching.one_cable import OneCable
from cable_shape.solve.touching.one_harness import OneHarness
from cable_shape.solve.touching.strands import Strands


def joined(predictors: Mapping[str, Predictor | HarnessPredictor]) -> Crossing:
    """What keeps cables and harnesses out of each other and of themselves; it is left to that from now on."""
    strands = strands_of(predictors)
    crossing = Crossing(strands, next(iter(predictors.values())).time_budget)
    join(crossing, predictors)
    return crossing


def strands_of(predictors: Mapping[str, Predictor | HarnessPredictor]) -> Strands:
    """Cables and segments of harnesses, of which each is solved for by its predictor."""
    return Strands(
        [
            OneHarness(solo, name) if isinstance(solo, HarnessPredictor) else OneCable(name, solo)
            for name, solo in predictors.items()
        ]
    )


def names_of(name: str, predictor: Any) -> list[str]:
    """What the strands of one are called."""
    if isinstance(predictor, HarnessPredictor):
        return [cable_id(name, segment) for segment in predictor.harness.segments]
    return [name]


def by_strand(name: str, shape: CableShape | HarnessShape) -> dict[str, CableShape]:
    """The shape of a cable, or those of the segments of a harness, by what they are called."""
    if isinstance(shape, HarnessShape):
        return {cable_id(name, segment): one for segment, one in shape.segments.items()}
    return {name: shape}


def told_of(predictors: Mapping[str, Any], shapes: Sequence[CableShape]) -> dict[str, Any]:
    """Shapes that a crossing of these has found, strand by strand, as each of them tells its own."""
    out = {}
    for name, own in rows_of(predictors).items():
        one, found = predictors[name], shapes[own.start : own.stop]
        out[name] = one.told(found if isinstance(one, HarnessPredictor) else found[0])
    return out


def rows_of(predictors: Mapping[str, Any]) -> dict[str, range]:
    """The numbers of the strands of each."""
    out, first = {}, 0
    for name, one in predictors.items():
        count = len(one.harness.segments) if isinstance(one, HarnessPredictor) else 1
        out[name] = range(first, first + count)
        first += count
    return out


def join(crossing: Crossing, predictors: Mapping[str, Predictor | HarnessPredictor]) -> None:
    """Has predictors leave what touches what to a crossing of all of them."""
    for name, own in rows_of(predictors).items():
        predictors[name].join(crossing, own[0])


def moved_with(
    crossing: Crossing | None, told: range, predictor: Predictor | HarnessPredictor, first: int, *, by_clips: bool
) -> Array:
    """(s n, 3, 6 m): how the strands `told` move with what holds another part, of which the first strand is `first`.

    That is a cable's ends, or a harness's grips, then, `by_clips`, its clips on links. Zeros, where no contact joins
    the two.
    """
    held = _held(predictor, first)
    clips = _on_links(predictor, first) if by_clips else []
    out = np.zeros((len(told) * predictor.problem.points, 3, 6 * (len(held) + len(clips))))
    gripped = [i for i, end in enumerate(held) if end is not None]
    columns = None if crossing is None else crossing.columns(told, [end for end in held if end is not None], clips)
    if columns is not None:
        of = np.array([*gripped, *range(len(held), len(held) + len(clips))], dtype=np.int64)
        out[:, :, (6 * of[:, None] + np.arange(6)).ravel()] = columns
    return out


def _held(predictor: Predictor | HarnessPredictor, first: int) -> list[tuple[int, str] | None]:
    """Strand and side of what its columns are of; None: it is free."""
    if isinstance(predictor, HarnessPredictor):
        segments = list(predictor.harness.segments)
        return [(first + segments.index(one), side) for one, side in map(split_end, predictor.grips)]
    return [(first, side) if isinstance(getattr(predictor.problem, side), Grip) else None for side in SIDES]


def _on_links(predictor: Predictor | HarnessPredictor, first: int) -> list[tuple[int, int]]:
    """Strand and place among its clips of those on links, in the order of the scene."""
    problem: Any = predictor.problem
    if isinstance(predictor, HarnessPredictor):
        at = {number: (i, k) for i, own in enumerate(problem.clips.values()) for k, number in enumerate(own)}
        return [(first + at[number][0], at[number][1]) for number in problem.moving_clips]
    clips: Sequence[Clip] = problem.clips
    return [(first, k) for k, clip in enumerate(clips) if clip.link is not None]
