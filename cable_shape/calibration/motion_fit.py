"""A cable from how it swung: :func:`calibrate_motion`."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from cable_shape.cable.cable import Cable
from cable_shape.calibration.fitted import ONE_GROUP, fitted, told_of_fit
from cable_shape.calibration.motion_forward import MotionForward, Recording, recordings_of
from cable_shape.calibration.observation import Observation
from cable_shape.calibration.parameters import KNOWN, VARYING, Parameters
from cable_shape.calibration.progress import Progress
from cable_shape.calibration.result import Calibration, grips_of
from cable_shape.calibration.robust import Fit
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.motion.run import STEP

#: [s], of each recording that is fitted first, and in so many iterations at most: what is far off swings out of step.
#: There logarithms have a prior of this, lest what is not seen so soon runs away.
FIRST, _ROUGH, _NEAR = (0.5, 1.0), 8, 1.0
#: [rad], turns from which the first of these fits begins with a roll: its loss has a minimum near each of several.
_ROLLS, _ROLL = (0.0, 2.0 * math.pi / 3.0, -2.0 * math.pi / 3.0), ("roll", "start_roll")
#: Points of a centreline, and how many of a fit are told, evenly spread.
_POINTS, _TOLD = 101, 12


def calibrate_motion(
    seen: Sequence[Observation],
    cable: Cable,
    fit: str | Sequence[str],
    *,
    priors: Mapping[str, float] | None,
    supports: int,
    proceed: Callable[[int, float], bool] | None = None,
    progress: bool = True,
    longest: float = STEP,
    **loads: Any,
) -> Calibration:
    """See :func:`cable_shape.calibrate` with `motion`; longest [s]: no step is longer; loads: `gravity`, `scene` and
    `elements` of :class:`cable_shape.Motion`.

    Raises
    ------
    ArgumentError
        For wrong arguments, or if no recording has a usable shape to begin with.
    """
    parameters = Parameters(cable, fit, priors, supports)
    recordings = recordings_of(seen, longest)
    with Progress(progress, proceed) as told:
        loads |= {"finer": False}  # what a mesh makes of a cable is part of what is fitted: one for all
        forward, values = MotionForward(parameters, recordings, **loads), parameters.start
        if np.isnan(MotionForward(parameters, recordings, FIRST[0], **loads).misses(values)[:, 0]).all():
            raise ArgumentError.of(
                "observations", f"{len(recordings)} recordings", "none has a usable shape with the cable given",
                "Is its length in metres, and at least the distance of the grips?",
            )  # fmt: skip
        logs = {name: _NEAR for name in parameters.names if KNOWN[name][-1] and name not in VARYING}
        near = Parameters(cable, fit, {**logs, **(priors or {})}, supports)
        for most in FIRST:
            if any(one.steps.sum() > most for one in recordings):
                short = MotionForward(near, recordings, most, **loads)
                begin = _turned(parameters, values) if most == FIRST[0] else [values]
                rough = [fitted(short, lambda i, scale: i <= _ROUGH and told.step(i, scale), one) for one in begin]
                values = min(rough, key=_miss).values
        found = fitted(forward, told.step, values)
        forward.misses(found.values)
    remarks = [ONE_GROUP] if len(recordings) == 1 else []
    if forward.lost:
        steps = sum(len(one.parts) for one in recordings)
        remarks.append(f"{forward.lost} of {steps} steps in time could not be taken; there the cable stands still.")
    looks = [one.looks[i] for one, i in _some(recordings)]
    return Calibration(
        cable=parameters.make_cable(found.values),
        **told_of_fit(found, parameters, recordings, (), (*remarks, *parameters.by_prior(found.covariance))),
        points=tuple(look.points for look in looks),
        centrelines=tuple(_lines(forward, found.values, recordings)),
        grips=grips_of(seen, parameters, found.values),
    )


def _turned(parameters: Parameters, values: Array) -> list[Array]:
    """The values (k,), with each of some rolls if one is fitted."""
    rolls = [parameters.where(name) for name in _ROLL if name in parameters.names]
    if not rolls:
        return [values]
    out = [values.copy() for _ in _ROLLS]
    for one, roll in zip(out, _ROLLS, strict=True):
        one[rolls[0]] += roll
    return out


def _miss(found: Fit) -> float:
    """[m], mean miss; infinite if there is none."""
    return float(np.nan_to_num(np.linalg.norm(found.misses, axis=1), nan=math.inf).mean())


def _some(recordings: Sequence[Recording]) -> list[tuple[Recording, int]]:
    """Which looks are told, recording by recording: some recordings, and of each one look later than the last."""
    which = np.unique(np.linspace(0, len(recordings) - 1, _TOLD).round().astype(int)).tolist()
    each = -(-_TOLD // len(which))
    return [
        (recordings[k], int(i))
        for k in which
        for i in np.unique(np.linspace(2, len(recordings[k].looks) - 1, each + 1)[1:].round().astype(int))
    ]


def _lines(forward: MotionForward, values: Array, recordings: Sequence[Recording]) -> list[Array]:
    """(101, 3) [m] of the looks that are told; NaN where a recording does not begin."""
    length, runs, out = forward.parameters.make_cable(values).length, {}, []
    for one, i in _some(recordings):
        if id(one) not in runs:
            run = forward.run(values, one)
            runs[id(one)] = None if run is None else run.at(np.linspace(0.0, length, _POINTS))
        lines = runs[id(one)]
        out.append(np.full((_POINTS, 3), np.nan) if lines is None else lines[i - 2])
    return out
