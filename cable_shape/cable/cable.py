"""What the cable is: :class:`Cable`."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, final

import numpy as np
from numpy.typing import ArrayLike

from cable_shape import checks
from cable_shape.cable.section import Section, sections_of
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError

if TYPE_CHECKING:
    from cable_shape.cable.centreline import Centreline
    from cable_shape.cable.wires import Wire

STANDARD_GRAVITY = 9.81  # m/s^2
TAIL_SIDES = ("start", "end")
LENGTHS = (1e-6, 1e6)  # m
#: Key of a cable's file under which a calibration says how grips held it, see :class:`cable_shape.CableFile`.
GRIPS = "grips"


@final
class Cable:
    """Geometry, stiffness and limits of one cable; SI units, per unit of stress-free arc length.

    Parameters
    ----------
    length : float
        [m], stress-free length between the grips, from 1e-6 to 1e6.
    linear_density : float
        [kg/m], at least 0.
    bending_stiffness : float or (2,) array_like
        EI about d1 and d2 [N m^2]; one number means both. 0 is allowed for the catenary only.
    twisting_stiffness : float or None
        GJ about d3 [N m^2]; None: the mean bending stiffness divided by 1.3, a solid round section of
        Poisson ratio 0.3.
    axial_stiffness, shear_stiffness : float or None
        EA, GA [N]; None: inextensible, unshearable.
    rest_curvature : (3,) or (n, 3) array_like
        [1/m], natural Darboux vector in the cable frame; (n, 3): uniform in arc length, linear between.
    diameter : float
        [m], for clearance and stress, above 0.
    gradient_length : float or None
        [m], l of the 6th-order term EI l^2 x^(6); None: `diameter`.
    min_bend_radius, max_tension, max_twist_rate : float or None
        [m], [N], [rad/m]: limits that warnings compare with; None: no limit.
    inner_diameter : float
        [m], of a tube, for stress; 0: solid. Below `diameter`.
    allowable_stress : float or None
        [Pa], limit of the von Mises stress, see :mod:`cable_shape.safety.stress`; None: no limit.
    tails : mapping of "start" and "end" to a length, optional
        [m], cable that hangs beyond the grips, not counted in `length`; see :mod:`cable_shape.prediction.tails`.
    sections : sequence of Section, optional
        Stretches with properties of their own, which do not overlap; see :class:`cable_shape.Section`.
    stiffness_interval : (2,) array_like, optional
        [N m^2], between which EI is, low and high, as of a bundle whose wires slip or stick; for `stiffness_spread`.
    retardation_time : float
        [s], of a cable in motion: its moment is that of its stiffness times (u - u0) + retardation_time du/dt.
    drag : float
        [N s/m^2], of a cable in motion: the air holds a metre of it back with drag times its velocity.
    friction : float
        Coulomb's coefficient on bodies that it rests on, and in eyelets, 0 to 10; of cable and body, or eyelet, the
        larger one counts.

    Raises
    ------
    ArgumentError
        Naming the value, the bound and the remedy.
    """

    __slots__ = (
        "allowable_stress",
        "axial_stiffness",
        "bending_stiffness",
        "diameter",
        "drag",
        "friction",
        "gradient_length",
        "inner_diameter",
        "length",
        "linear_density",
        "max_tension",
        "max_twist_rate",
        "min_bend_radius",
        "rest_curvature",
        "retardation_time",
        "sections",
        "shear_stiffness",
        "stiffness_interval",
        "tails",
        "twisting_stiffness",
    )

    length: float
    linear_density: float
    bending_stiffness: tuple[float, float]
    twisting_stiffness: float
    axial_stiffness: float | None
    shear_stiffness: float | None
    rest_curvature: Array
    diameter: float
    gradient_length: float
    min_bend_radius: float | None
    max_tension: float | None
    max_twist_rate: float | None
    inner_diameter: float
    allowable_stress: float | None
    tails: Mapping[str, float]
    sections: tuple[Section, ...]
    stiffness_interval: tuple[float, float] | None
    retardation_time: float
    drag: float
    friction: float

    def __init__(
        self,
        length: float,
        linear_density: float,
        bending_stiffness: float | ArrayLike,
        twisting_stiffness: float | None = None,
        axial_stiffness: float | None = None,
        shear_stiffness: float | None = None,
        rest_curvature: ArrayLike = (0.0, 0.0, 0.0),
        diameter: float = 0.008,
        gradient_length: float | None = None,
        min_bend_radius: float | None = None,
        max_tension: float | None = None,
        max_twist_rate: float | None = None,
        inner_diameter: float = 0.0,
        allowable_stress: float | None = None,
        tails: Mapping[str, float] | None = None,
        sections: Sequence[Section] | None = None,
        stiffness_interval: ArrayLike | None = None,
        retardation_time: float = 0.0,
        drag: float = 0.0,
        friction: float = 0.0,
    ) -> None:
        put = object.__setattr__
        put(self, "length", _length("length", length))
        put(self, "linear_density", checks.number("linear_density", linear_density, at_least=0.0, unit="kg/m"))
        put(self, "bending_stiffness", _bending(bending_stiffness))
        mean = 0.5 * sum(self.bending_stiffness)
        if twisting_stiffness is None:
            put(self, "twisting_stiffness", mean / 1.3)
        else:
            above, at_least = (0.0, None) if mean > 0.0 else (None, 0.0)
            twisting = checks.number(
                "twisting_stiffness", twisting_stiffness, above=above, at_least=at_least, unit="N m^2"
            )
            put(self, "twisting_stiffness", twisting)
        put(self, "axial_stiffness", checks.optional_number("axial_stiffness", axial_stiffness, above=0.0, unit="N"))
        put(self, "shear_stiffness", checks.optional_number("shear_stiffness", shear_stiffness, above=0.0, unit="N"))
        put(self, "rest_curvature", _rest_curvature(rest_curvature))
        put(self, "diameter", checks.number("diameter", diameter, above=0.0, unit="m"))
        length_l = self.diameter if gradient_length is None else gradient_length
        put(self, "gradient_length", checks.number("gradient_length", length_l, above=0.0, unit="m"))
        put(self, "min_bend_radius", checks.optional_number("min_bend_radius", min_bend_radius, above=0.0, unit="m"))
        put(self, "max_tension", checks.optional_number("max_tension", max_tension, above=0.0, unit="N"))
        put(self, "max_twist_rate", checks.optional_number("max_twist_rate", max_twist_rate, above=0.0, unit="rad/m"))
        put(self, "inner_diameter", _inner_diameter(inner_diameter, self.diameter))
        put(
            self, "allowable_stress", checks.optional_number("allowable_stress", allowable_stress, above=0.0, unit="Pa")
        )
        put(self, "tails", _tails(tails))
        put(self, "stiffness_interval", _interval(stiffness_interval))
        put(self, "retardation_time", checks.number("retardation_time", retardation_time, at_least=0.0, unit="s"))
        put(self, "drag", checks.number("drag", drag, at_least=0.0, unit="N s/m^2"))
        put(self, "friction", checks.number("friction", friction, at_least=0.0, at_most=10.0))
        put(self, "sections", sections_of(sections, self.length))
        for i, section in enumerate(self.sections):
            _check_section(self, section, f"sections[{i}]")

    def __setattr__(self, name: str, value: object) -> None:
        raise AttributeError(f"a Cable is fixed; make another with cable.replace({name}=...)")

    def __reduce__(self) -> tuple[Any, ...]:
        return Cable.from_mapping, (self.as_dict(),)

    @classmethod
    def from_material(
        cls,
        length: float,
        diameter: float,
        youngs_modulus: float,
        poisson_ratio: float,
        density: float,
        inner_diameter: float = 0.0,
        allowable_stress: float | None = None,
        **limits: Any,
    ) -> Cable:
        """A solid round or tubular cable of one material.

        EI = E pi (D^4 - d^4) / 64, GJ = 2 G I, EA = E A, GA = G A (no shear correction factor), G = E / 2 (1 + nu).

        Parameters
        ----------
        length, diameter, inner_diameter : float
            [m].
        youngs_modulus : float
            [Pa].
        poisson_ratio : float
            Above -1, at most 0.5.
        density : float
            [kg/m^3].
        allowable_stress : float, optional
            [Pa]; limit of the von Mises stress. It also sets `min_bend_radius` = E D / 2 sigma and `max_tension` =
            sigma A, each as if it acted alone.
        **limits
            Further keywords of :class:`Cable`.
        """
        outer = checks.number("diameter", diameter, above=0.0, unit="m")
        inner = _inner_diameter(inner_diameter, outer)
        young = checks.number("youngs_modulus", youngs_modulus, above=0.0, unit="Pa")
        nu = checks.number("poisson_ratio", poisson_ratio, above=-1.0)
        if nu > 0.5:
            raise ArgumentError.of("poisson_ratio", nu, "it must be at most 0.5", "Rubber has 0.5, metals about 0.3.")
        rho = checks.number("density", density, at_least=0.0, unit="kg/m^3")
        area = math.pi / 4.0 * (outer**2 - inner**2)
        inertia = math.pi / 64.0 * (outer**4 - inner**4)
        shear_modulus = young / (2.0 * (1.0 + nu))
        if allowable_stress is not None:
            stress = checks.number("allowable_stress", allowable_stress, above=0.0, unit="Pa")
            limits.setdefault("min_bend_radius", young * outer / (2.0 * stress))
            limits.setdefault("max_tension", stress * area)
        return cls(
            length=length,
            linear_density=rho * area,
            bending_stiffness=young * inertia,
            twisting_stiffness=2.0 * shear_modulus * inertia,
            axial_stiffness=young * area,
            shear_stiffness=shear_modulus * area,
            diameter=outer,
            inner_diameter=inner,
            allowable_stress=allowable_stress,
            **limits,
        )

    @classmethod
    def from_wires(cls, wires: Sequence[Wire], length: float, covering: Wire | None = None, **keywords: Any) -> Cable:
        """A bundle of wires, packed round, as one cable.

        `bending_stiffness` is that of full slip, to which a bundle tends as it is bent, and `stiffness_interval` that
        from full slip to full stick: see :mod:`cable_shape.cable.wires`.

        Parameters
        ----------
        wires : sequence of Wire
        length : float
            [m].
        covering : Wire, optional
            A tube around the bundle, such as tape or a protection; its EI and mass are added.
        **keywords
            Further keywords of :class:`Cable`, which go before what the wires say.
        """
        from cable_shape.cable.wires import keywords_of

        return cls(length, **{**keywords_of(wires, covering), **keywords})

    @classmethod
    def from_centreline(
        cls,
        curve: Centreline | ArrayLike,
        linear_density: float,
        bending_stiffness: float | ArrayLike,
        **keywords: Any,
    ) -> Cable:
        """A preformed cable or hose: without load it rests in the form of a curve, between that curve's end frames.

        Parameters
        ----------
        curve : Centreline or (n, 3) array_like
            [m], points along the cable, or a curve as :mod:`cable_shape.cable.curves` reads it from files. It gives
            `length` and `rest_curvature`; ``Centreline.from_points(points).start`` and ``.end`` are where it was drawn.
        linear_density, bending_stiffness, **keywords
            Keywords of :class:`Cable`.

        Raises
        ------
        ArgumentError
            For points that are no curve, and a curve that runs through itself.
        """
        from cable_shape.cable.preformed import check_crossing, form_of

        line = form_of(curve, keywords)
        made = cls(line.length, linear_density, bending_stiffness, rest_curvature=line.rest_curvature()[0], **keywords)
        check_crossing(line, 0.5 * made.diameter)
        return made

    @classmethod
    def from_mapping(cls, values: Mapping[str, Any], where: str = "cable") -> Cable:
        """From a mapping whose keys are the keywords of :class:`Cable`, or of :meth:`from_material`.

        What a calibration says of the grips, under `grips`, is no part of the cable: see
        :class:`cable_shape.CableFile`.
        """
        if isinstance(values, Mapping) and GRIPS in values:
            values = {key: value for key, value in values.items() if key != GRIPS}
        if isinstance(values, Mapping) and "youngs_modulus" in values:
            material = ("youngs_modulus", "poisson_ratio", "density", "inner_diameter", "allowable_stress")
            limits = (
                "gradient_length",
                "min_bend_radius",
                "max_tension",
                "max_twist_rate",
                "rest_curvature",
                "tails",
                "sections",
            )
            checks.known_keys(where, values, ("length", "diameter", *material, *limits))
            return _called(cls.from_material, values, where)
        checks.known_keys(where, values, cls.__slots__)
        return _called(cls, values, where)

    @classmethod
    def from_yaml(cls, path: str | Path) -> Cable:
        """From a YAML file, see :meth:`from_mapping`."""
        from cable_shape.files.yaml_files import load_yaml

        return cls.from_mapping(load_yaml(path), where=str(path))

    def as_dict(self) -> dict[str, Any]:
        """The keywords that make this cable, as plain numbers, lists and None."""
        out = {name: getattr(self, name) for name in self.__slots__}
        out["bending_stiffness"] = list(self.bending_stiffness)
        out["rest_curvature"] = self.rest_curvature.tolist()
        out["tails"] = dict(self.tails)
        out["stiffness_interval"] = None if self.stiffness_interval is None else list(self.stiffness_interval)
        out["sections"] = [section.as_dict() for section in self.sections]
        return out

    def replace(self, **changes: Any) -> Cable:
        """A copy with some keywords changed."""
        return Cable.from_mapping({**self.as_dict(), **changes})

    @property
    def mean_bending_stiffness(self) -> float:
        """[N m^2], what the isotropic models use for EI."""
        return 0.5 * (self.bending_stiffness[0] + self.bending_stiffness[1])

    @property
    def stiffness_spread(self) -> float:
        """Root mean square of ln(EI' / EI), EI' every value in `stiffness_interval` alike; 0 without one.

        What an :class:`cable_shape.Uncertainty` takes for that of `bending_stiffness` where it is told none.
        """
        if self.stiffness_interval is None or self.mean_bending_stiffness == 0.0:
            return 0.0
        low, high = (x / self.mean_bending_stiffness for x in self.stiffness_interval)
        if high - low < 1e-9:
            return abs(math.log(high)) if high > 0.0 else 0.0
        mean = [x * (math.log(x) ** 2 - 2.0 * math.log(x) + 2.0) if x > 0.0 else 0.0 for x in (low, high)]
        return math.sqrt((mean[1] - mean[0]) / (high - low))

    def describe(self) -> str:
        """What these numbers mean in plain words, to catch a slip of units."""
        stiffness = self.mean_bending_stiffness
        weight = self.linear_density * STANDARD_GRAVITY
        head = f"{self.length:.4g} m long, {self.diameter * 1e3:.3g} mm thick, {self.linear_density * 1e3:.4g} g/m"
        if weight == 0.0:
            return f"{head}; weightless"
        if stiffness == 0.0:
            return f"{head}; without bending stiffness: a chain"
        # Linear beam theory, which holds for small sags only: w / 8 EI for 1 m held level at one end.
        sag = weight / (8.0 * stiffness)
        words = f"would sag {sag * 1e3:.3g} mm" if sag < 0.2 else "would hang down"
        return f"{head}; a metre of it held level at one end {words}"

    def __eq__(self, other: object) -> bool:
        if self is other or not isinstance(other, Cable):
            return self is other
        rest = self.rest_curvature, other.rest_curvature
        names = (name for name in self.__slots__ if name != "rest_curvature")
        return all(getattr(self, name) == getattr(other, name) for name in names) and np.array_equal(*rest)

    def __hash__(self) -> int:
        stiffness, bends = (
            (self.bending_stiffness, self.twisting_stiffness),
            tuple(self.rest_curvature.ravel().tolist()),
        )
        return hash((self.length, self.linear_density, stiffness, bends, self.diameter, self.drag, self.sections))

    def __repr__(self) -> str:
        return f"Cable({', '.join(f'{k}={v!r}' for k, v in self.as_dict().items())})"


def _interval(value: ArrayLike | None) -> tuple[float, float] | None:
    """Two numbers of at least 0, the second not below the first."""
    if value is None:
        return None
    low, high = checks.vector("stiffness_interval", value, 2, "N m^2").tolist()
    if not 0.0 <= low <= high:
        remedy = "Give (low, high) in N m^2."
        raise ArgumentError.of("stiffness_interval", [low, high], "it must be two numbers, 0 <= low <= high", remedy)
    return low, high


def _check_section(cable: Cable, section: Section, where: str) -> None:
    """Makes the cable that a section is a stretch of, with errors that name it."""
    try:
        made = cable.replace(sections=None, **section.properties)
    except ArgumentError as error:
        raise type(error)(f"{where}: {error}") from None
    if (made.mean_bending_stiffness == 0.0) or (cable.mean_bending_stiffness == 0.0):
        bound = "a cable with sections needs it above 0 N m^2"
        raise ArgumentError.of(f"{where}: bending_stiffness", 0.0, bound, "Give EI in N m^2, however small it is.")


def _inner_diameter(value: float, outer: float) -> float:
    """At least 0 and below the outer diameter."""
    inner = checks.number("inner_diameter", value, at_least=0.0, unit="m")
    if inner >= outer:
        raise ArgumentError.of(
            "inner_diameter", inner, f"it must be below diameter = {outer:g} m", "Use 0 for a solid cable."
        )
    return inner


def _tails(value: Mapping[str, float] | None) -> Mapping[str, float]:
    """Lengths above 0 by side, in the order of the sides, read-only."""
    given = checks.mapping("tails", value, TAIL_SIDES, "Write {start: .., end: ..}, lengths in m.")
    return MappingProxyType({side: _length(f"tails.{side}", given[side]) for side in TAIL_SIDES if side in given})


def _length(name: str, value: float) -> float:
    """[m], of something between a hair and a continent."""
    low, high = LENGTHS
    length = checks.number(name, value, above=0.0, at_most=high, unit="m")
    if length < low:
        remedy = f"Give {name} in m as one finite number."
        raise ArgumentError.of(name, length, f"it must be at least {low:g} m", remedy)
    return length


def _bending(value: float | ArrayLike) -> tuple[float, float]:
    """One number or two, both positive or both zero."""
    remedy = "Give EI in N m^2; 0 (a chain) is solved by model='catenary' only."
    if value is None or np.isscalar(value) or isinstance(value, (str, np.generic)):
        one = checks.number("bending_stiffness", value, at_least=0.0, unit="N m^2", remedy=remedy)
        return (one, one)
    pair = checks.vector("bending_stiffness", value, 2, "N m^2")
    if (pair < 0.0).any():
        raise ArgumentError.of("bending_stiffness", pair.tolist(), "both must be at least 0 N m^2", remedy)
    if (pair == 0.0).any() != (pair == 0.0).all():
        raise ArgumentError.of("bending_stiffness", pair.tolist(), "both or neither may be 0", remedy)
    return (float(pair[0]), float(pair[1]))


def _rest_curvature(value: ArrayLike) -> Array:
    """(3,) or (n, 3) with n >= 2, finite, read-only."""
    remedy = "Give three numbers in 1/m, or an (n, 3) table with n >= 2 rows, uniform in arc length."
    a = checks.numbers("rest_curvature", value, remedy)
    if not (a.shape == (3,) or (a.ndim == 2 and a.shape[1] == 3 and a.shape[0] >= 2)):
        raise ArgumentError.of("rest_curvature", f"shape {a.shape}", "it must be (3,) or (n, 3)", remedy)
    if not np.isfinite(a).all():
        raise ArgumentError.of("rest_curvature", a.tolist(), "every entry must be finite", remedy)
    a.flags.writeable = False
    return a


def _called(make: Any, values: Mapping[str, Any], where: str) -> Cable:
    """`make(**values)`, with a missing keyword or a bad value reported together with where it was read."""
    try:
        cable: Cable = make(**values)
    except ArgumentError as error:
        raise type(error)(f"{where}: {error}") from None
    except TypeError as error:
        raise ArgumentError(f"{where}: {error}. Add the missing key.") from None
    return cable
