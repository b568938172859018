"""What a harness is made of, and how its branches leave its junctions, from how it was seen to hang."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from cable_shape import checks
from cable_shape.cable.harness import Harness
from cable_shape.calibration.fitted import fitted_in_two, told_of_fit
from cable_shape.calibration.harness_forward import HarnessForward, flat
from cable_shape.calibration.harness_observation import HarnessObservation
from cable_shape.calibration.harness_parameters import HarnessParameters
from cable_shape.calibration.harness_result import HarnessCalibration
from cable_shape.calibration.progress import Progress
from cable_shape.errors import ArgumentError
from cable_shape.solve.problem import GRAVITY
from cable_shape.solve.quasistatic import inertia_of


def calibrate_harness(
    observations: Iterable[HarnessObservation],
    harness: Harness,
    fit: str | Sequence[str] = ("bending_stiffness",),
    *,
    priors: Mapping[str, float] | None = None,
    gravity: ArrayLike = GRAVITY,
    proceed: Callable[[int, float], bool] | None = None,
    progress: bool = True,
) -> HarnessCalibration:
    """The harness whose predicted shapes come nearest to the observed points: what `calibrate` does for a harness.

    Only ratios of stiffness and weight shape a harness between grips: not all of them can be fitted at once. Stray
    points, errors and the misses told are as for a cable.

    Parameters
    ----------
    observations : iterable of HarnessObservation
    harness : Harness
        Where the fit begins, and all that is not fitted.
    fit : sequence of str
        "bending_stiffness" (the values keep their ratios; GJ follows unless fitted), "twisting_stiffness",
        "linear_density", "length" and "rest_curvature" (about d1 and d2): alone of all segments together, as
        "bending_stiffness:a" of one, as "bending_stiffness:a+b" of several that are alike, as "bending_stiffness:each"
        of every segment by itself. "tilt:a.start" (about d1 and d2) and "roll:a.start": how the cable frame of an end
        is turned in itself, in its grip or its rigid junction; "offset:a.start" of one in a grip. "frames", or
        "frames:fork" of one junction: the tilts of all ends but the first of a junction.
    priors : mapping, optional
        Standard deviation about where the fit begins, by name ("tilt:a.start") or kind ("tilt"), in the unit of what is
        fitted; of stiffness and density as a fraction of it.
    gravity, proceed, progress
        As for a cable.

    Raises
    ------
    ArgumentError
        For wrong arguments, or if no observation has a usable shape with the harness given.
    """
    looks = checks.entries("observations", observations, HarnessObservation, "Write HarnessObservation(ends, points).")
    if not looks:
        raise ArgumentError.of("observations", "0 items", "it must be HarnessObservations, one at least", "Give some.")
    checks.instance("harness", harness, (Harness,), "Write Harness(segments={...}, junctions=[...]).")
    if proceed is not None and not callable(proceed):
        raise ArgumentError.of("proceed", proceed, "it must be a function", "Leave it out, or give one.")
    for i, look in enumerate(looks):
        try:
            look.check(harness)
        except ArgumentError as error:
            raise type(error)(f"observations[{i}]: {error}") from None
    parameters = HarnessParameters(harness, fit, priors)

    def model(some: Sequence[HarnessObservation]) -> HarnessForward:
        return HarnessForward(parameters, some, gravity=gravity)

    with Progress(progress, proceed) as told:
        if not any(np.isfinite(model([look]).misses(parameters.start)).any() for look in looks):
            raise ArgumentError.of(
                "observations", f"{len(looks)} items", "none has a usable shape with the harness given",
                "Are its lengths in metres, and does it reach its grips?",
            )  # fmt: skip
        found = fitted_in_two(model, looks, told.step)
    moved = [max((inertia_of(a, gravity) for a in (look.acceleration or {}).values()), default=0.0) for look in looks]
    return HarnessCalibration(
        harness=parameters.make(found.values),
        inertia=math.sqrt(sum(x * x for x in moved) / len(looks)),
        **told_of_fit(found, parameters, [flat(look) for look in looks]),
    )
