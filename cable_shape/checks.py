"""Checks of arguments, each with one wording: name, value, bound, remedy."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cable_shape.errors import ArgumentError, StaleInputError, UnknownKeyError

Array = NDArray[np.float64]
T = TypeVar("T")

#: Numbers beyond these magnitudes, in SI units, are slips: powers and quotients of them leave what a float holds.
LEAST, MOST = 1e-20, 1e20

#: Quaternions this close to unit length are normalised, others refused (ROS publishes rounded ones).
QUATERNION_TOLERANCE = 1e-3


def number(
    name: str,
    value: Any,
    *,
    above: float | None = None,
    at_least: float | None = None,
    at_most: float = MOST,
    unit: str = "",
    remedy: str = "",
) -> float:
    """`value` as a finite float, above or at least a bound; above 0, it is at least 1e-20."""
    suffix = f" {unit}" if unit else ""
    remedy = remedy or f"Give {name} in {unit or 'SI units'} as one finite number."
    if value is None or isinstance(value, (bool, str, bytes, bytearray)) or getattr(value, "ndim", False):
        raise ArgumentError.of(name, value, "it must be a number", remedy)
    try:
        x = float(value)
    except (TypeError, ValueError):
        raise ArgumentError.of(name, value, "it must be a number", remedy) from None
    except OverflowError:
        raise ArgumentError.of(name, value, f"it must be at most {at_most:g}{suffix}", remedy) from None
    if not math.isfinite(x):
        raise ArgumentError.of(name, x, "it must be finite", remedy)
    if above is not None and not x > above:
        raise ArgumentError.of(name, x, f"it must be above {above:g}{suffix}", remedy)
    if at_least is not None and not x >= at_least:
        raise ArgumentError.of(name, x, f"it must be at least {at_least:g}{suffix}", remedy)
    if not abs(x) <= at_most:
        raise ArgumentError.of(name, x, f"its magnitude must be at most {at_most:g}{suffix}", remedy)
    if above == 0.0 and x < LEAST:
        raise ArgumentError.of(name, x, f"it must be at least {LEAST:g}{suffix}", remedy)
    return x


def optional_number(name: str, value: Any, **bounds: Any) -> float | None:
    """Like :func:`number`, None allowed."""
    return None if value is None else number(name, value, **bounds)


def integer(name: str, value: Any, *, at_least: int, at_most: int | None = None) -> int:
    """`value` as an int within bounds; a float is refused."""
    bound = f"it must be a whole number of at least {at_least}" + (f" and at most {at_most}" if at_most else "")
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)):
        raise ArgumentError.of(name, value, bound, "")
    if value < at_least or (at_most is not None and value > at_most):
        raise ArgumentError.of(name, int(value), bound, f"Choose {name} within these bounds.")
    return int(value)


_LATEST = 2**63 - 1  # ns


def stamp(value: Any, last: int | None) -> int:
    """`value` as a stamp [ns] that is not older than the last one, if there is one."""
    if type(value) is not int or not -_LATEST <= value <= _LATEST:
        value = integer("stamp", value, at_least=-_LATEST, at_most=_LATEST)
    if last is not None and value < last:
        raise StaleInputError(
            f"stamp = {value} ns is {(last - value) * 1e-9:.6f} s older than the last one, "
            f"{last} ns. Drop it, or call reset() if the clock was set back or a bag loops."
        )
    return int(value)


def vector(name: str, value: ArrayLike, size: int = 3, unit: str = "") -> Array:
    """`value` as a new finite float64 array of shape (size,)."""
    a = _as_floats(value)
    if a is not None and a.shape == (size,):
        entries = a.tolist()
        if all(map(math.isfinite, entries)) and (not entries or (max(entries) <= MOST and min(entries) >= -MOST)):
            return a
    in_unit = f" in {unit}" if unit else ""
    remedy = f"Give {name} as {size} finite numbers{in_unit}."
    if a is None:
        raise ArgumentError.of(name, value, f"it must be {size} numbers", remedy)
    if a.shape != (size,):
        raise ArgumentError.of(name, value, f"it must have shape ({size},), not {a.shape}", remedy)
    if not np.isfinite(a).all():
        raise ArgumentError.of(name, a.tolist(), "every entry must be finite", remedy)
    raise ArgumentError.of(name, a.tolist(), f"no magnitude may be above {MOST:g}{in_unit}", remedy)


def numbers(name: str, value: Any, remedy: str) -> Array:
    """`value` as a new float64 array of whatever shape."""
    a = _as_floats(value)
    if a is None:
        raise ArgumentError.of(name, value, "it must be numbers", remedy)
    return a


def _as_floats(value: Any) -> Array | None:
    """A new array of whatever shape; None of what is no numbers, complex ones included."""
    try:
        if isinstance(value, np.ndarray) and value.dtype.kind not in "biuf":
            return None
        return np.array(value, dtype=np.float64, order="C")
    except (TypeError, ValueError, OverflowError, RecursionError, AttributeError):
        return None


def quaternion(name: str, value: ArrayLike) -> Array:
    """`value` as a new unit quaternion (4,), x y z w; refused unless within 1e-3 of unit length."""
    q = vector(name, value, 4)
    length = math.sqrt(float(q @ q))
    if abs(length - 1.0) > QUATERNION_TOLERANCE:
        raise ArgumentError.of(
            name,
            q.tolist(),
            f"its length is {length:.6g}, it must be within {QUATERNION_TOLERANCE:g} of 1",
            "Normalise it; the order is x, y, z, w and the identity is (0, 0, 0, 1).",
        )
    return q / length


def one_of(name: str, value: Any, options: Iterable[str]) -> str:
    """`value`, if it is one of the words `options`."""
    if type(options) is tuple and type(value) is str and value in options:
        return value
    words = tuple(options)
    if not isinstance(value, str) or value not in words:
        raise ArgumentError.of(name, value, f"it must be one of {', '.join(words)}", "Choose one of these.")
    return str(value)


def word(name: str, value: object) -> None:
    """Refuses what is no text, or blank."""
    if not isinstance(value, str) or not value.strip():
        raise ArgumentError.of(name, value, "it must be a word", "Give a short name in quotes.")


def instance(name: str, value: object, kinds: tuple[type, ...], remedy: str) -> None:
    """Refuses what is of none of these kinds."""
    if not isinstance(value, kinds):
        words = " or ".join(kind.__name__ for kind in kinds)
        raise ArgumentError.of(name, value, f"it must be a {words}", remedy)


def entries(name: str, values: Any, kind: type[T], remedy: str = "") -> tuple[T, ...]:
    """The items of a list, tuple or other iterable, which are all of this kind."""
    remedy = remedy or f"Give a list of {kind.__name__}."
    if isinstance(values, (str, bytes, Mapping)):
        raise ArgumentError.of(name, values, "it must be a list", remedy)
    try:
        items = tuple(values)
    except TypeError:
        raise ArgumentError.of(name, values, "it must be a list", remedy) from None
    for i, item in enumerate(items):
        instance(f"{name}[{i}]", item, (kind,), remedy)
    return items


def mapping(name: str, values: Any, known: Iterable[str], remedy: str) -> dict[str, Any]:
    """A mapping that has no keys but those `known`, as a new dict; empty for None."""
    if values is None:
        return {}
    if not isinstance(values, Mapping):
        raise ArgumentError.of(name, values, "it must be a mapping", remedy)
    known_keys(name, values, known)
    return dict(values)


def known_keys(where: str, given: Mapping[str, Any], known: Iterable[str]) -> None:
    """Refuses keys of `given` that are not among `known`, naming the nearest."""
    names = tuple(known)
    if not isinstance(given, Mapping):
        raise ArgumentError.of(where, given, "it must be a mapping of keys to values", f"Known keys: {names}.")
    for key in given:
        if key not in names:
            raise UnknownKeyError.among(where, key, names)
