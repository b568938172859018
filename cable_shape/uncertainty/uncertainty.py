"""What is not known of a cable and of its grips: :class:`Uncertainty`, and what comes of it: :class:`Tube`."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, final

import numpy as np
from numpy.typing import ArrayLike

from cable_shape import checks
from cable_shape.cable.cable import Cable
from cable_shape.calibration.parameters import KNOWN, ROWS, STIFF_ALONG, VARYING, Parameters, supports_in
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError, UnknownKeyError
from cable_shape.files.files import path_of
from cable_shape.kernels.safety import spread as tube
from cable_shape.shape import CableShape

if TYPE_CHECKING:
    from cable_shape.cable.harness import Harness
    from cable_shape.calibration.harness_parameters import HarnessParameters
    from cable_shape.calibration.harness_result import HarnessCalibration
    from cable_shape.calibration.result import Calibration

#: Of which a bundle of wires says itself how well it is known.
STIFF = "bending_stiffness"
CONFIDENCE = 0.95
#: Load of a cable's inertia, as a fraction of its weight, beyond which no tube holds: it counts it to first order only.
MOST_INERTIA = 1.0
#: Of a grip whose pose is exactly known.
EXACT = (0.0, 0.0)
_KEYS = ("confidence", "misses", "inertia", "start", "end", "cable", "covariance")
#: Principal directions of the parameters whose variance is below this fraction of the largest move nothing.
_NOTHING = 1e-12
#: Ratios of standard deviations for which quantiles are kept, and nodes of the integral that gives them.
_RATIOS, _NODES = 33, 128


@final
@dataclass(frozen=True, slots=True, eq=False)
class Tube:
    """A predicted shape and how well it is known.

    shape : of which the tube is.
    covariance : (n, 3, 3) [m^2], of the positions, from what is not known of the cable and of its grips.
    radius : (n,) [m], of the tube that holds a point of the cable with the `confidence`.
    inertia : load of the cable's inertia that the shape leaves out and the tube counts, as a fraction of the weight;
        NaN: it is not known, and the tube holds a cable at rest only.
    """

    shape: CableShape
    covariance: Array
    radius: Array
    confidence: float = CONFIDENCE
    inertia: float = math.nan

    @property
    def holds(self) -> bool:
        """Whether it is as wide as it says: how the cable moves is known, and its inertia at most its weight."""
        return self.inertia <= MOST_INERTIA


@final
class Uncertainty:
    """Standard deviations of what a prediction rests on; what is left out is taken for exact.

    Parameters
    ----------
    cable : mapping, optional
        Standard deviation by what :func:`cable_shape.calibrate` may fit, in its unit, of each component; of a stiffness
        as a fraction of it. Of a harness the names are those that it takes for harnesses, such as
        "bending_stiffness:each". Where nothing is told of `bending_stiffness`, a cable, or segment, with a
        `stiffness_interval` has its `stiffness_spread`.
    start, end : (2,) or (6, 6) array_like
        Of the grips' poses: standard deviations of position [m] and angle [rad] about each axis, or the covariance of
        position and rotation vector [m, rad] in world axes, about the gripper's own origin, as in
        geometry_msgs/PoseWithCovariance. The two ends are independent of each other and of the cable. Of a harness
        those of every grip at a segment's start, and at its end.
    confidence : float
        That a point of the cable is in the tube, above 0 and below 1.
    misses : float
        [m], by how much predictions of an exactly known cable are off, with that confidence: model and camera.
    inertia : float
        Root mean square, as a fraction of gravity, of the accelerations under which `misses` were seen: 0.6 of what a
        given acceleration has beyond it counts as not known. Infinite, the default: none of it does.

    Raises
    ------
    ArgumentError
        Naming the value, the bound and the remedy.
    """

    __slots__ = ("confidence", "covariance", "end", "inertia", "misses", "names", "spread", "start")

    confidence: float
    misses: float  # m
    inertia: float
    names: tuple[str, ...]  # of what is not known of the cable
    spread: dict[str, float]  # standard deviations by these names; empty where a covariance was told
    covariance: Array  # (k, k), of its components; of logarithms of stiffness; empty for names of harnesses alone
    start: Array  # (6, 6)
    end: Array  # (6, 6)

    def __init__(
        self,
        cable: Mapping[str, float] | None = None,
        start: ArrayLike = EXACT,
        end: ArrayLike = EXACT,
        *,
        confidence: float = CONFIDENCE,
        misses: float = 0.0,
        inertia: float = math.inf,
    ) -> None:
        given = checks.mapping("cable", cable, _known(cable), "Write {bending_stiffness: 0.1}, a fraction.")
        self.confidence = checks.number("confidence", confidence, above=0.0)
        if self.confidence >= 1.0:
            raise ArgumentError.of("confidence", self.confidence, "it must be below 1", "Give 0.95 for 95 %.")
        self.misses = checks.number("misses", misses, at_least=0.0, unit="m")
        self.inertia = math.inf if inertia == math.inf else checks.number("inertia", inertia, at_least=0.0)
        self.start, self.end = _of_pose("start", start), _of_pose("end", end)
        self.names = tuple(given)
        self.spread = {name: checks.number(f"cable[{name!r}]", x, at_least=0.0) for name, x in given.items()}
        self.covariance = np.empty((0, 0))
        if all(name in KNOWN for name in given):
            counts = [len(KNOWN[name][0]) for name in given]
            self.covariance = np.diag(np.repeat(np.square(list(self.spread.values())), counts))

    @classmethod
    def of(
        cls,
        found: Calibration | HarnessCalibration,
        start: ArrayLike = EXACT,
        end: ArrayLike = EXACT,
        *,
        confidence: float = CONFIDENCE,
    ) -> Uncertainty:
        """What a calibration leaves open: the covariance of its parameters, and the quantile of its misses.

        Where it fitted offsets, tilts or roll of the grips, the grips of a cycle have to be given with these.

        Raises
        ------
        ArgumentError
            If its data do not see one of its parameters.
        """
        remedy = "Give what cs.calibrate returns."
        checks.instance("found", found, _calibrations(), remedy)
        made = cls(None, start, end, confidence=confidence)
        made.misses = found.miss_quantile(made.confidence) * of_few(found.groups, made.confidence)
        made.inertia = found.inertia
        estimates, covariance = found.estimates, found.covariance
        if found.parameters is None:  # a sag
            made.names, covariance = ("bending_stiffness",), np.array([[estimates[0].relative ** 2]])
        else:
            made.names = tuple(found.parameters.names)
        if covariance is None or not np.isfinite(covariance).all():
            remedy = "Calibrate with more observations, fit only what they show, or give priors."
            raise ArgumentError("found: this calibration has no finite covariance. " + remedy)
        made.covariance = np.array(covariance)
        return made

    @classmethod
    def from_mapping(cls, values: Mapping[str, Any], where: str = "uncertainty") -> Uncertainty:
        """From `confidence`, `misses`, `inertia`, `start`, `end` and either `cable` or `covariance`, all optional.

        `start` and `end` are mappings of `position` [m] and `angle` [rad], or (6, 6); `covariance` is a mapping of
        `names` and `matrix`, as :meth:`as_dict` writes it.
        """
        checks.known_keys(where, values, _KEYS)
        ends = {side: _pose_key(f"{where}: {side}", values[side]) for side in ("start", "end") if side in values}
        whole = values.get("covariance")
        if whole is not None and "cable" in values:
            raise ArgumentError(f"{where}: covariance is not allowed beside cable. Leave one of them out.")
        numbers = {key: values[key] for key in ("confidence", "misses", "inertia") if key in values}
        made = cls(values.get("cable"), ends.get("start", EXACT), ends.get("end", EXACT), **numbers)
        if whole is not None:
            checks.known_keys(f"{where}: covariance", whole, ("names", "matrix"))
            made.names = checks.entries(f"{where}: covariance.names", whole.get("names") or (), str)
            known = _known(made.names)
            for name in made.names:
                if name not in known:
                    raise UnknownKeyError.among(f"{where}: covariance.names", name, known)
            size = sum(len(known[name][0]) for name in made.names)
            if size:
                matrix = whole.get("matrix")
                if (
                    isinstance(matrix, (list, tuple))
                    and set(VARYING) & set(made.names)
                    and supports_in(made.names, len(matrix))
                ):
                    size = len(matrix)  # any number of supports along the cable
                made.covariance = _semidefinite(f"{where}: covariance.matrix", matrix, size)
        return made

    @classmethod
    def from_yaml(cls, path: str | Path) -> Uncertainty:
        """From a YAML file, see :meth:`from_mapping`."""
        from cable_shape.files.yaml_files import load_yaml

        return cls.from_mapping(load_yaml(path), where=str(path))

    def as_dict(self) -> dict[str, Any]:
        """The mapping that makes it, as plain numbers and lists."""
        told: dict[str, Any] = {"covariance": {"names": list(self.names), "matrix": self.covariance.tolist()}}
        if self.names and not self.covariance.size:
            told = {"cable": dict(self.spread)}
        told |= {"inertia": self.inertia} if self.inertia < math.inf else {}
        return {
            "confidence": self.confidence, "misses": self.misses, "start": _told(self.start), "end": _told(self.end),
            **told,
        }  # fmt: skip

    def yaml(self) -> str:
        """A file for :meth:`from_yaml`."""
        import yaml

        text: str = yaml.safe_dump(self.as_dict(), default_flow_style=None, sort_keys=False, width=10_000)
        return "# How well a cable and its grips are known; m, rad, stiffness as fractions.\n" + text

    def save(self, path: str | Path) -> Path:
        """Writes `yaml` to a file, whose folder must be there."""
        file = path_of(path)
        file.write_text(self.yaml(), encoding="utf-8")
        return file

    def parameters(self, cable: Cable) -> tuple[Parameters | None, Array]:
        """The numbers that are not known of a cable, None if there are none, and (m, k): independent steps of one
        standard deviation each that make up their covariance."""
        names, covariance = self.names, self.covariance
        if names and not covariance.size:
            bound = "they are names of a harness"
            raise ArgumentError.of("uncertainty.cable", list(names), bound, f"Of a cable: {', '.join(KNOWN)}.")
        if not {STIFF, STIFF_ALONG} & set(names) and cable.stiffness_spread > 0.0:
            names = (*names, STIFF)
            covariance = np.pad(covariance, (0, 1))
            covariance[-1, -1] = cable.stiffness_spread**2
        if not names:
            return None, np.empty((0, 0))
        supports = supports_in(self.names, len(self.covariance)) or ROWS
        return Parameters(cable, names, supports=supports), directions_of(covariance)

    def harness_parameters(self, harness: Harness) -> tuple[HarnessParameters | None, Array]:
        """The same of a harness."""
        from cable_shape.calibration.harness_parameters import HarnessParameters

        spread = {name: x for name, x in self.spread.items() if x > 0.0}
        names: list[str] = list(spread) if self.spread else list(self.names)
        named = HarnessParameters(harness, names) if names else None
        told = {} if named is None else {s for target in named.targets if target.kind == STIFF for s in target.of}
        bundles = {
            f"{STIFF}:{name}": cable.stiffness_spread
            for name, cable in harness.segments.items()
            if name not in told and cable.stiffness_spread > 0.0
        }
        if not (names or bundles):
            return None, np.empty((0, 0))
        known = HarnessParameters(harness, [*names, *bundles], priors=spread | bundles)
        covariance = np.diag(np.square([p.prior for p in known.each]))
        if names and not self.spread:
            k = len(self.covariance)
            if k != len(known.each) - len(bundles):
                bound = f"this harness has {len(known.each) - len(bundles)} numbers of these names"
                raise ArgumentError.of("uncertainty.covariance", f"{k} rows", bound, "Take that of its calibration.")
            covariance[:k, :k] = self.covariance
        return known, directions_of(covariance)

    @property
    def poses(self) -> Array:
        """(12, m): the same of start and end; an orthogonal choice of them."""
        both = np.zeros((12, 12))
        both[:6, :6], both[6:, 6:] = self.start, self.end
        return np.ascontiguousarray(directions_of(both).T)

    def radius(self, covariance: Array, tangents: Array) -> Array:
        """(n,) [m], of the tube about points of these covariances (n, 3, 3) [m^2] on a line of these tangents (n, 3).

        Misses and the quantile across the line, that of a normal distribution in the plane, join in quadrature.
        """
        out = np.empty(len(covariance))
        tube.radii(covariance, np.ascontiguousarray(tangents), self.misses, quantiles(self.confidence), out)
        return out


def _calibrations() -> tuple[type, ...]:
    """The classes of calibrations, which are made of uncertainties."""
    from cable_shape.calibration.harness_result import HarnessCalibration
    from cable_shape.calibration.result import Calibration

    return Calibration, HarnessCalibration


def _known(names: Any) -> dict[str, tuple[tuple[str, ...], str, float, float, bool]]:
    """What may be told of a cable, and those of these names that may be told of a harness."""
    from cable_shape.calibration import harness_parameters

    kinds = harness_parameters.KNOWN | {harness_parameters.FRAMES: harness_parameters.KNOWN["tilt"]}
    given = names if isinstance(names, (Mapping, list, tuple)) else ()
    own = (name for name in given if isinstance(name, str) and name not in KNOWN)
    return KNOWN | {name: kinds[kind] for name in own if (kind := name.partition(":")[0]) in kinds}


def of_few(groups: int, confidence: float) -> float:
    """[1], by how much the quantile of misses of another group is beyond that of so many groups that were fitted.

    Misses of one group hang together: each tells once the scale of a normal vector across the cable, which has two
    directions. Student's quantile of 2 (groups - 1) degrees of freedom, and what the mean over the groups is off by. 1
    where no groups were named, and of a single one, which cannot tell how another differs from it.
    """
    from scipy.special import ndtri, stdtrit

    if groups < 2:
        return 1.0
    upper = 0.5 + 0.5 * confidence
    return float(stdtrit(2 * (groups - 1), upper) / ndtri(upper)) * math.sqrt(1.0 + 1.0 / groups)


@cache
def quantiles(confidence: float) -> Array:
    """(33,): square of the radius that holds a normal vector in the plane with the confidence, its larger variance 1.

    Its smaller standard deviation goes evenly from 0 (1.96^2 at 95 %) to 1 (2.45^2).
    """
    from scipy.special import erf, erfinv

    places, weights = np.polynomial.legendre.leggauss(_NODES)
    angles = 0.25 * math.pi * (places + 1.0)
    sine, cosine = np.sin(angles), np.cos(angles)
    narrow = np.linspace(0.0, 1.0, _RATIOS)[1:, None]
    low, high = np.zeros((_RATIOS - 1, 1)), np.full((_RATIOS - 1, 1), math.sqrt(-2.0 * math.log1p(-confidence)))
    for _ in range(36):
        r = 0.5 * (low + high)
        beside = np.exp(-0.5 * (r * sine) ** 2) * erf(r * cosine / (math.sqrt(2.0) * narrow))
        inside = r * math.sqrt(0.125 * math.pi) * (beside * (weights * cosine)).sum(axis=1, keepdims=True)
        low, high = np.where(inside < confidence, r, low), np.where(inside < confidence, high, r)
    out = np.concatenate(([2.0 * erfinv(confidence) ** 2], high[:, 0] ** 2))
    return np.asarray(out)


def directions_of(covariance: Array) -> Array:
    """(m, k): rows whose outer products add up to the covariance (k, k)."""
    scale = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    unit = np.where(scale > 0.0, scale, 1.0)
    sizes, vectors = np.linalg.eigh(covariance / np.outer(unit, unit))
    kept = sizes > _NOTHING * max(float(sizes.max(initial=0.0)), _NOTHING)
    return np.asarray((vectors[:, kept] * np.sqrt(sizes[kept])).T * unit)


def _of_pose(name: str, value: ArrayLike) -> Array:
    """(6, 6) from two standard deviations or a covariance."""
    remedy = "Give (position [m], angle [rad]) or a covariance (6, 6)."
    a = checks.numbers(name, value, remedy)
    if a.shape == (2,):
        position = checks.number(f"{name}[0]", a[0], at_least=0.0, unit="m")
        angle = checks.number(f"{name}[1]", a[1], at_least=0.0, unit="rad")
        return np.diag(np.repeat((position**2, angle**2), 3))
    return _semidefinite(name, value, 6, remedy)


def _semidefinite(name: str, value: Any, size: int, remedy: str = "Give variances and covariances.") -> Array:
    """(size, size), finite, symmetric, without a negative variance in any direction."""
    a = checks.numbers(name, value, remedy)
    if a.shape != (size, size):
        raise ArgumentError.of(name, f"shape {a.shape}", f"it must be ({size}, {size})", remedy)
    if not np.isfinite(a).all() or np.abs(a).max(initial=0.0) > checks.MOST:
        bound = f"every entry must be finite, none above {checks.MOST:g}"
        raise ArgumentError.of(name, a.tolist(), bound, remedy)
    scale = np.sqrt(np.abs(np.diag(a)))
    unit = np.where(scale > 0.0, scale, 1.0)
    scaled = a / np.outer(unit, unit)
    if size and (np.abs(scaled - scaled.T).max() > 1e-6 or np.linalg.eigvalsh(scaled)[0] < -1e-6):
        raise ArgumentError.of(name, a.tolist(), "it must be symmetric and have no negative eigenvalue", remedy)
    return 0.5 * (a + a.T)


def _told(covariance: Array) -> Any:
    """What :func:`_pose_key` reads of a grip's covariance (6, 6): two standard deviations where these say it all."""
    position, angle = covariance[0, 0], covariance[3, 3]
    if np.array_equal(covariance, np.diag(np.repeat((position, angle), 3))):
        return {"position": math.sqrt(position), "angle": math.sqrt(angle)}
    return covariance.tolist()


def _pose_key(where: str, value: Any) -> Sequence[float] | Array:
    """What a file says of a grip."""
    if isinstance(value, Mapping):
        checks.known_keys(where, value, ("position", "angle"))
        return value.get("position", 0.0), value.get("angle", 0.0)
    return _of_pose(where, value)
