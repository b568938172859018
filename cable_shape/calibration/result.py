"""What a calibration found, with error bars: :class:`Calibration`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, final

import numpy as np

from cable_shape import checks
from cable_shape.cable.cable import GRIPS, STANDARD_GRAVITY, Cable
from cable_shape.cable.cable_file import AS_GIVEN, SIDES, CableFile, Held
from cable_shape.calibration.observation import Observation
from cable_shape.calibration.parameters import Parameter, Parameters
from cable_shape.checks import Array
from cable_shape.errors import UnknownKeyError
from cable_shape.files.files import path_of
from cable_shape.pose import Grip

CONFIDENCE = 0.95
#: A point of less weight was taken for a stray one.
STRAY = 0.2
#: Misses of the usual point beyond this part of the length are those of another cable.
EXPLAINED = 0.1
#: Beyond these a number is as good as not known: standard error of a logarithm, correlation of two, error / prior.
_VAGUE, _TIED, _PRIOR_ONLY = 0.7, 0.95, 0.9


@final
@dataclass(frozen=True, slots=True)
class Estimate:
    """One fitted number: value, standard error and 95 % interval, all in `unit`; the interval of a stiffness is that of
    its logarithm. All infinite where the data say nothing; `relative`: standard error of the logarithm, or NaN.
    """

    name: str
    unit: str
    value: float
    standard_error: float
    low: float
    high: float
    relative: float = math.nan

    def __str__(self) -> str:
        if not math.isfinite(self.standard_error):
            return f"not seen by the data (left at {self.value:.4g} {self.unit})"
        error = f"{100.0 * self.relative:.2g} %" if math.isfinite(self.relative) else f"{self.standard_error:.2g}"
        return f"{self.value:.4g} {self.unit}, standard error {error}, 95 %: {self.low:.4g} to {self.high:.4g}"


class Found:
    """What calibrations of cables and of harnesses tell alike."""

    __slots__ = ()
    estimates: tuple[Estimate, ...]
    distances: Array
    weights: Array
    groups: int
    inertia: float

    def __getitem__(self, name: str) -> Estimate:
        """The estimate of this name."""
        for estimate in self.estimates:
            if estimate.name == name:
                return estimate
        raise UnknownKeyError.among("estimates", name, (e.name for e in self.estimates))

    def miss_quantile(self, share: float) -> float:
        """[m], below which that share of the misses is, stray points left out; 0 without points."""
        part = checks.number("share", share, at_least=0.0, at_most=1.0)
        kept = self.distances[self.weights > STRAY]
        return float(np.quantile(kept, part)) if len(kept) else 0.0


@final
@dataclass(frozen=True, slots=True, eq=False)
class Calibration(Found):
    """The calibrated cable and how well it is known.

    cable : the calibrated cable.
    estimates : of each fitted number.
    correlation : (k, k), of the estimates, of logarithms where these are fitted; NaN where the data say nothing.
    scale : [m], of the misses that remain, per component; robust.
    distances : (n,) [m], from each observed point to the prediction, NaN where there was none.
    weights : (n,), 1: the point counts in full; small: it was taken for a stray one.
    remarks : what the data cannot tell, and what else to know before the numbers are used.
    points, centrelines : (m, 3) and (101, 3) [m] of each observation; NaN where there is no usable shape.
    parameters, values, covariance : what was fitted, where the fit ended (k,), and (k, k) of it; see `predict_tube`.
    freedom : degrees of freedom behind the covariance.
    groups : how many groups the observations came in; 0: none were named.
    inertia : root mean square of the accelerations given with the observations, as a fraction of gravity.
    grips : how start and end were held, and where offsets, tilts and roll that were fitted put the cable's frames.
    """

    cable: Cable
    estimates: tuple[Estimate, ...]
    correlation: Array
    scale: float
    distances: Array
    weights: Array
    iterations: int
    converged: bool
    remarks: tuple[str, ...]
    points: tuple[Array, ...] = ()
    centrelines: tuple[Array, ...] = ()
    parameters: Parameters | None = None
    values: Array | None = None
    covariance: Array | None = None
    freedom: int = 0
    groups: int = 0
    inertia: float = 0.0
    grips: tuple[Held, Held] = (AS_GIVEN, AS_GIVEN)

    @property
    def trouble(self) -> str:
        """Why this is no calibration, with the remedy; empty if it is one.

        It is none where the fit did not converge, or where the usual point is missed by more than a tenth of the
        length: whatever was seen, it was not this cable between these grips.
        """
        return trouble_of(self.converged, self.distances[self.weights > STRAY], self.cable.length)

    @property
    def file(self) -> CableFile:
        """The cable and its grips: ``found.file.start.grip(pose)`` is a start as this calibration has it."""
        return CableFile(self.cable, *self.grips)

    def report(self) -> str:
        """In words, one line each."""
        weight = self.cable.linear_density * STANDARD_GRAVITY
        lines = [f"{e.name:<22} {e}" for e in self.estimates]
        if weight > 0.0:
            lines.append(f"{'EI / weight':<22} {self.cable.mean_bending_stiffness / weight:.4g} m^3")
        if not np.isfinite(self.distances).any():
            return "\n".join([*lines, *(f"note: {remark}" for remark in self.remarks)])
        lines += misses_in_words(self.distances, self.weights, self.cable.length, 22)
        lines.append(f"{'iterations':<22} {self.iterations}{'' if self.converged else ', not converged'}")
        return "\n".join([*lines, *(f"note: {remark}" for remark in self.remarks)])

    def as_dict(self) -> dict[str, Any]:
        """As plain numbers, for JSON; None for what is not finite."""
        return {
            "cable": self.cable.as_dict(),
            **told_of(self.estimates, self.correlation, self.scale, self.distances),
            "converged": self.converged,
            "trouble": self.trouble,
            "remarks": list(self.remarks),
            GRIPS: {side: held.as_dict() for side, held in zip(SIDES, self.grips, strict=True)},
        }

    def yaml(self) -> str:
        """A cable file (see :class:`cable_shape.CableFile`) with the uncertainties in comments."""
        import yaml

        lines = ["# Calibrated; standard errors and 95 % intervals beside the numbers."]
        lines += [f"# not to be used: {self.trouble}"] if self.trouble else []
        lines += [f"# note: {remark}" for remark in self.remarks]
        told = {e.name.removesuffix("_1").removesuffix("_2"): str(e) for e in self.estimates}
        if "rest_curvature_1" in {e.name for e in self.estimates}:
            told["rest_curvature"] = "; ".join(str(e) for e in self.estimates if e.name.startswith("rest_curvature"))
        values = self.cable.as_dict()
        for key, value in values.items():
            if value is None or value == {} or (key == "gradient_length" and value == self.cable.diameter):
                continue
            text = yaml.safe_dump({key: value}, default_flow_style=None, width=10_000).strip()
            text = text[1:-1] if text.startswith("{") else text
            lines.append(f"{text}  # {told[key]}" if key in told else text)
        if self.grips != (AS_GIVEN, AS_GIVEN):
            lines.append(
                f"{GRIPS}:  # how they held it; correction: the cable frame in the one that pose and offset say"
            )
        for side, held in zip(SIDES, self.grips, strict=True):
            if held != AS_GIVEN:
                text = yaml.safe_dump(held.as_dict(), default_flow_style=True, sort_keys=False, width=10_000).strip()
                lines.append(f"  {side}: {text}")
        for e in self.estimates:
            if "_at_" in e.name:
                lines.append(f"# {e.name} % of the length: {e}")
            elif e.name not in values and not e.name.startswith("rest_curvature"):
                lines.append(f"# of the grips: {e.name}: {e}")
        return "\n".join(lines) + "\n"

    def save(self, path: str | Path) -> Path:
        """Writes `yaml` to a file, whose folder must be there."""
        file = path_of(path)
        file.write_text(self.yaml(), encoding="utf-8")
        return file


def trouble_of(converged: bool, kept: Array, length: float) -> str:
    """Why a fit that left these misses [m] on a cable of this length is no calibration; empty if it is one."""
    if not converged:
        return "the fit did not converge: start nearer, fit less, or give priors."
    seen = kept[np.isfinite(kept)]
    usual = float(np.median(seen)) if len(seen) else 0.0
    if usual > EXPLAINED * length:
        part = 100.0 * usual / length
        return (
            f"the fit explains nothing: the usual point is missed by {part:.0f} % of the length. Are points and "
            "grips in one frame and in metres, the grips' kinds and the length right?"
        )
    return ""


def misses_in_words(distances: Array, weights: Array, length: float, width: int) -> list[str]:
    """Lines of a report on what a fit left, for a cable of this length [m]."""
    seen = distances[np.isfinite(distances)]
    stray = int((weights[np.isfinite(distances)] <= STRAY).sum())
    return [
        f"{'misses':<{width}} mean {1e3 * seen.mean():.3g} mm ({100.0 * seen.mean() / length:.2f} % of the length), "
        f"90 % below {1e3 * np.percentile(seen, 90.0):.3g} mm, {len(seen)} points",
        f"{'stray points':<{width}} {stray}, hardly counted",
    ]


def told_of(estimates: Sequence[Estimate], correlation: Array, scale: float, distances: Array) -> dict[str, Any]:
    """Entries of a calibration's mapping for JSON."""
    return {
        "estimates": {
            e.name: {
                "unit": e.unit,
                "value": e.value,
                "standard_error": _finite(e.standard_error),
                "interval_95": [_finite(e.low), _finite(e.high)],
            }
            for e in estimates
        },
        "correlation": [[_finite(x) for x in row] for row in correlation.tolist()],
        "scale": scale,
        "mean_miss": float(np.nanmean(distances)) if len(distances) else None,
    }


def grips_of(observations: Sequence[Observation], parameters: Parameters, values: Array) -> tuple[Held, Held]:
    """How start and end held the cable in all the observations, and what the parameters put beside what these say.

    A kind that is not the same in all is left out, and an end that nothing holds.
    """

    def held(side: str) -> Held:
        ends = [getattr(one, side) for one in observations]
        kinds = {end.kind for end in ends if isinstance(end, Grip)}
        if not kinds:
            return AS_GIVEN
        return Held(kinds.pop() if len(kinds) == 1 else None, correction=parameters.offset(values, side))

    return held("start"), held("end")


def estimates_of(each: Sequence[Parameter], values: Array, covariance: Array, freedom: int) -> tuple[Estimate, ...]:
    """Value, standard error and interval of every parameter, by Student's distribution."""
    from scipy.special import stdtrit

    t = float(stdtrit(freedom, 0.5 + 0.5 * CONFIDENCE))
    out = []
    for p, value, variance in zip(each, values.tolist(), np.diag(covariance).tolist(), strict=True):
        error = math.sqrt(variance)
        low, high = value - t * error, value + t * error
        if p.log:
            middle = math.exp(value)
            low, high = math.exp(max(low, -700.0)) if error < math.inf else 0.0, math.exp(min(high, 700.0))
            out.append(Estimate(p.name, p.unit, middle, middle * error, low, high, error))
        else:
            out.append(Estimate(p.name, p.unit, value, error, low, high))
    return tuple(out)


def correlation_of(covariance: Array) -> Array:
    """(k, k), NaN where a variance is infinite."""
    spread = np.sqrt(np.diag(covariance))
    with np.errstate(invalid="ignore"):
        out = covariance / np.outer(spread, spread)
    out[~np.isfinite(spread), :] = np.nan
    out[:, ~np.isfinite(spread)] = np.nan
    return np.asarray(out)


def remarks_of(
    each: Sequence[Parameter], covariance: Array, correlation: Array, blind: Array, converged: bool, lost: int
) -> tuple[str, ...]:
    """What the data cannot tell."""
    out = [] if converged else ["the fit did not converge: start nearer, fit less, or give priors."]
    if lost:
        out.append(f"{lost} observations have no usable shape and were left out.")
    for combination in blind:
        names = [p.name for p, x in zip(each, combination, strict=True) if abs(x) > 0.1]
        out.append(f"the data do not see {' and '.join(names)}{' apart' if len(names) > 1 else ''}.")
    errors = np.sqrt(np.diag(covariance))
    for p, error in zip(each, errors.tolist(), strict=True):
        if p.log and _VAGUE < error < math.inf:
            out.append(f"{p.name} is known only to a factor of {math.exp(min(1.96 * error, 50.0)):.3g}.")
        if error > _PRIOR_ONLY * p.prior:
            out.append(f"{p.name} is known by its prior, hardly by the data.")
    for i in range(len(each)):
        out += [
            f"{each[j].name} and {each[i].name} trade off (correlation {correlation[i, j]:.2f})."
            for j in range(i)
            if abs(correlation[i, j]) > _TIED
        ]
    return tuple(out)


def _finite(x: float) -> float | None:
    return float(x) if math.isfinite(x) else None
