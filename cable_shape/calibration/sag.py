"""Bending stiffness from one number, how far a cable sags: :func:`calibrate_sag`."""

from __future__ import annotations

import math

import numpy as np

from cable_shape import checks
from cable_shape.cable.cable import STANDARD_GRAVITY, Cable
from cable_shape.calibration.result import Calibration, Estimate
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.pose import FreeEnd, Grip, Pose, multiply
from cable_shape.prediction.predictor import predict
from cable_shape.solve.rod_common import MODEL

#: EI / (weight per metre x length^3) between which a sag says something.
_SOFTEST, _STIFFEST = 1e-6, 1e2
#: Relative width of the last bracket of ln EI.
_CLOSE = 1e-6
_LEVEL = (0.5, 0.5, 0.5, 0.5)
_STEP = 1e-2
HELD = ("level", "pinned", "free")


def calibrate_sag(
    cable: Cable,
    sag: float,
    *,
    chord: float | None = None,
    held: str = "level",
    sag_error: float = 0.003,
    place_error: float = 0.002,
    tilt_error: float = 0.02,
) -> Calibration:
    """The cable whose lowest point hangs `sag` below its start.

    Parameters
    ----------
    cable : Cable
        `bending_stiffness` is what is looked for; its value does not matter. Length and density do.
    sag : float
        [m], from the start down to the lowest point of the centreline.
    chord : float, optional
        [m], distance of the two ends, which are level; not needed if `held` is "free".
    held : str
        "level": both ends are held horizontal; "pinned": both ends turn freely; "free": one end is held horizontal and
        the other hangs.
    sag_error, place_error : float
        [m], standard errors of the sag, and of length and chord.
    tilt_error : float
        [rad], standard error of what is held level, an end each. All of these go into the error of EI.

    Raises
    ------
    ArgumentError
        For wrong arguments, or a sag that no stiffness gives, with the range of those that some does.
    """
    checks.instance("cable", cable, (Cable,), "Write Cable(length=..., ...).")
    checks.one_of("held", held, HELD)
    wanted = checks.number("sag", sag, above=0.0, unit="m")
    sag_error = checks.number("sag_error", sag_error, above=0.0, unit="m")
    place_error = checks.number("place_error", place_error, at_least=0.0, unit="m")
    tilt_error = checks.number("tilt_error", tilt_error, at_least=0.0, unit="rad")
    weight = checks.number("linear_density", cable.linear_density, above=0.0, unit="kg/m") * STANDARD_GRAVITY
    if held == "free":
        span = 0.0
    elif chord is None:
        raise ArgumentError.of("chord", chord, "it is needed with two ends held", "Measure from grip to grip, in m.")
    else:
        span = checks.number("chord", chord, above=0.0, unit="m")
        if span >= cable.length:
            remedy = "Measure both again; a cable without slack does not sag."
            raise ArgumentError.of("chord", span, f"it must be below length = {cable.length:g} m", remedy)

    def at(log_stiffness: float, length: float = cable.length, apart: float = span, tilt: float = 0.0) -> float:
        return _sag(cable, math.exp(log_stiffness), length, apart, held, tilt)

    unit = math.log(weight * cable.length**3)
    ends = np.linspace(unit + math.log(_SOFTEST), unit + math.log(_STIFFEST), 25)
    sags = np.array([at(x) for x in ends])
    if np.isnan(sags).all():
        remedy = "Are its length and density in SI units?"
        raise ArgumentError.of("cable", cable, "it has no usable shape between these ends", remedy)
    crossed = np.flatnonzero((sags[:-1] - wanted) * (sags[1:] - wanted) <= 0.0)
    if not len(crossed):
        raise ArgumentError.of(
            "sag", wanted, f"with these ends it is between {np.nanmin(sags):.4g} m and {np.nanmax(sags):.4g} m",
            "Measure length, chord and sag again. Near the upper bound a cable is a chain, and its stiffness not seen.",
        )  # fmt: skip
    low, high = float(ends[crossed[0]]), float(ends[crossed[0] + 1])
    below = sags[crossed[0]] < wanted
    while high - low > _CLOSE:
        middle = 0.5 * (low + high)
        if (at(middle) < wanted) == below:
            low = middle
        else:
            high = middle
    found = 0.5 * (low + high)
    by_stiffness = (at(found + _STEP) - at(found - _STEP)) / (2.0 * _STEP)
    d = 1e-3 * cable.length
    by_length = (at(found, cable.length + d) - at(found, cable.length - d)) / (2.0 * d)
    by_chord = (at(found, apart=span + d) - at(found, apart=span - d)) / (2.0 * d) if span > 0.0 else 0.0
    by_tilt = (at(found, tilt=_STEP) - at(found, tilt=-_STEP)) / (2.0 * _STEP)
    ends_tilted = math.sqrt(2.0) if held == "level" else 1.0
    parts = (sag_error, by_length * place_error, by_chord * place_error, by_tilt * tilt_error * ends_tilted)
    error = math.hypot(*parts) / abs(by_stiffness)
    return _calibration(cable, math.exp(found), error, len(crossed))


def _calibration(cable: Cable, stiffness: float, error: float, answers: int) -> Calibration:
    """The result, with remarks."""
    remarks = []
    if answers > 1:
        remarks.append(f"{answers} stiffnesses give this sag; the softest is taken.")
    if error > 0.5:
        remarks.append(
            f"this sag knows the stiffness only to a factor of {math.exp(min(1.96 * error, 50.0)):.3g}: hold one end "
            "level and let the other hang (free), or take less slack."
        )
    factor = math.exp(min(1.96 * error, 50.0))
    estimate = Estimate(
        "bending_stiffness", "N m^2", stiffness, stiffness * error, stiffness / factor, stiffness * factor, error
    )
    ratio = cable.twisting_stiffness / cable.mean_bending_stiffness if cable.mean_bending_stiffness else 1.0 / 1.3
    nothing: Array = np.empty(0)
    return Calibration(
        cable=cable.replace(bending_stiffness=stiffness, twisting_stiffness=ratio * stiffness),
        estimates=(estimate,),
        correlation=np.ones((1, 1)),
        scale=0.0,
        distances=nothing,
        weights=nothing,
        iterations=0,
        converged=True,
        remarks=tuple(remarks),
    )


def _sag(cable: Cable, stiffness: float, length: float, chord: float, held: str, tilt: float) -> float:
    """[m], how far the lowest point is below the start, which is tilted down by `tilt`; NaN without a usable shape."""
    rod = cable.replace(
        length=length, bending_stiffness=stiffness, twisting_stiffness=stiffness, rest_curvature=(0, 0, 0)
    )
    kind = "pinned" if held == "pinned" else "clamped"
    pitched = multiply(np.array((0.0, math.sin(0.5 * tilt), 0.0, math.cos(0.5 * tilt))), np.array(_LEVEL))
    start = Grip(Pose((0.0, 0.0, 0.0), pitched), kind=kind)
    end = FreeEnd() if held == "free" else Grip(Pose((chord, 0.0, 0.0), _LEVEL), kind=kind)
    shape = predict(rod, start, end, model=MODEL, points=401, tolerance=1e-6 * length)
    return -float(shape.positions[:, 2].min()) if shape.status else math.nan
