"""What can go wrong, drawn as a tree.

CableShapeError                 everything that this package raises on purpose
├── ArgumentError (ValueError)  a value given by the caller: names the value, the bound and the remedy
│   └── UnknownKeyError         a key or parameter that does not exist: names the nearest one that does
├── InputError                  something read at run time: a message, a joint state, a bag
│   ├── StaleInputError         input older than allowed, or going backwards in time
│   └── BagError                a recording that cannot be read, or only in part
├── RobotError                  a robot description that does not fit what is asked of it
├── SteeringError               a cable that has no shape to be steered from
└── DependencyError             a library or a built package that is missing, with the command that brings it

Physics never raises: a chord longer than the cable is a :class:`~cable_shape.shape.Status`.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class CableShapeError(Exception):
    """Base of every error that cable_shape raises on purpose."""


class ArgumentError(CableShapeError, ValueError):
    """A value given by the caller is not allowed."""

    @classmethod
    def of(cls, name: str, value: object, bound: str, remedy: str) -> ArgumentError:
        """The one wording of all argument errors: name, value, bound, remedy."""
        return cls(f"{name} = {value!r} is not allowed: {bound}. {remedy}")


class UnknownKeyError(ArgumentError):
    """A key that does not exist."""

    @classmethod
    def among(cls, where: str, key: object, known: Iterable[str]) -> UnknownKeyError:
        """`key` was found in `where`, but only the keys `known` exist there."""
        options = sorted(known)
        near = difflib.get_close_matches(str(key), options, n=1, cutoff=0.5)
        hint = f"Did you mean {near[0]!r}? " if near else ""
        return cls(f"{where}: unknown key {key!r}. {hint}Known keys: {', '.join(options)}.")


class InputError(CableShapeError):
    """Something read at run time (a message, a joint state, a bag) cannot be used."""


class StaleInputError(InputError):
    """Input older than allowed, or going backwards in time."""


class BagError(InputError):
    """A recording that cannot be read, or only in part."""


class RobotError(CableShapeError):
    """A robot description does not fit what is asked of it."""


class SteeringError(CableShapeError):
    """The cable has no usable shape at a configuration, so that nothing is known of how it would move."""


class DependencyError(CableShapeError):
    """A library or a built package is missing."""
