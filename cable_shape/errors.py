"""What can go wrong, drawn as a tree.

CableShapeError                 everything that this package raises on purpose
├── ArgumentError (ValueError)  a value given by the caller: names the value, the bound and the remedy
│   └── UnknownKeyError         a key or parameter that does not exist: names the nearest one that does
├── InputError                  something read at run time: a message, a joint state, a bag
│   ├── StaleInputError         input older than allowed, or going backwards in time
│   ├── FileError (ArgumentError)  a file that cannot be read or is malformed: names file, line, key and remedy
│   └── BagError                a recording that cannot be read, or only in part
├── RobotError                  a robot description that does not fit what is asked of it
├── SteeringError               a cable that has no shape to be steered from
└── DependencyError             a library or a built package that is missing, with the command that brings it

Physics never raises: a chord longer than the cable is a :class:`~cable_shape.shape.Status`.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable

#: Characters of a value that are quoted: whatever was given, an error stays readable.
MOST_OF_A_VALUE = 300
#: Keys that look otherwise are not quoted: a file that is another one has lines for keys.
_A_KEY = re.compile(r"'?[\w ./-]{0,60}'?")


def shown(value: object) -> str:
    """`value` as an error quotes it: its repr, cut off where it is long; its type where it has none."""
    try:
        text = repr(value)
    except Exception:  # noqa: BLE001, an integer of 5000 digits, or whatever an object of the caller raises
        return f"a {type(value).__name__}"
    text = " ".join(text.split()) if "\n" in text else text
    return text if len(text) <= MOST_OF_A_VALUE else f"{text[:MOST_OF_A_VALUE]}..."


class CableShapeError(Exception):
    """Base of every error that cable_shape raises on purpose."""


class ArgumentError(CableShapeError, ValueError):
    """A value given by the caller is not allowed."""

    @classmethod
    def of(cls, name: str, value: object, bound: str, remedy: str) -> ArgumentError:
        """The one wording of all argument errors: name, value, bound, remedy."""
        return cls(f"{name} = {shown(value)} is not allowed: {bound}. {remedy}")


class UnknownKeyError(ArgumentError):
    """A key that does not exist."""

    @classmethod
    def among(cls, where: str, key: object, known: Iterable[str]) -> UnknownKeyError:
        """`key` was found in `where`, but only the keys `known` exist there."""
        options = sorted(known)
        text = shown(key)
        near = difflib.get_close_matches(str(key), options, n=1, cutoff=0.5) if _A_KEY.fullmatch(text) else []
        hint = f"Did you mean {near[0]!r}? " if near else ""
        named = f"unknown key {text}" if _A_KEY.fullmatch(text) else "a key that is not a word"
        return cls(f"{where}: {named}. {hint}Known keys: {', '.join(options)}.")


class InputError(CableShapeError):
    """Something read at run time (a message, a joint state, a bag) cannot be used."""


class StaleInputError(InputError):
    """Input older than allowed, or going backwards in time."""


class FileError(InputError, ArgumentError):
    """A file that cannot be read, or is malformed."""


class BagError(InputError):
    """A recording that cannot be read, or only in part."""


class RobotError(CableShapeError):
    """A robot description does not fit what is asked of it."""


class SteeringError(CableShapeError):
    """The cable has no usable shape at a configuration, so that nothing is known of how it would move."""


class DependencyError(CableShapeError):
    """A library or a built package is missing."""


#: module -> extra, as in pyproject.toml
EXTRAS = {
    "rosbags": "replay",
    "apsw": "replay",  # comes with rosbags
    "matplotlib": "replay",
    "PIL": "replay",  # comes with matplotlib
    "rerun": "viewer",
    "pinocchio": "robots",
    "mink": "robots",
    "mujoco": "robots",
    "coacd": "meshes",
    "ezdxf": "drawings",
    "OCP": "cad",
    "pyarrow": "studies",
    "dask": "studies",
    "distributed": "studies",
    "pxr": "usd",
    "xarray": "netcdf",
}

#: What a ROS brings, and how to get it.
ROS = (
    "Source a ROS 2 Jazzy (its Python must see this package: python3 -m venv --system-site-packages), or run "
    "scripts/test once in a clone of the repository, which installs ROS from PyPI and builds the messages."
)


def how_to_get(module: str) -> str:
    """The command that installs what `module` is a part of; empty if no extra brings it."""
    extra = EXTRAS.get(module.partition(".")[0])
    return f"pip install 'cable_shape[{extra}]'" if extra else ""


def lacking(error: ModuleNotFoundError) -> DependencyError | None:
    """What to say instead of `error` if an extra or a ROS would bring the module; None if neither does."""
    name = (error.name or "").partition(".")[0]
    remedy = how_to_get(name)
    if remedy:
        return DependencyError(f"{name} is not installed. Run: {remedy}")
    if name == "rclpy" or name.endswith(("_msgs", "_interfaces")):
        return DependencyError(f"{name} is not installed, which the node and what hears it need. {ROS}")
    return None
