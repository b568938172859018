"""A study's file as commands read it: with recordings as motions, and the user's own functions as measures."""

from __future__ import annotations

import argparse
import importlib
import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from cable_shape.errors import ArgumentError
from cable_shape.files.files import find_file, path_of
from cable_shape.files.yaml_files import load_yaml
from cable_shape.planning.study import STUDY_KEYS, Study

#: Keys of a motion that is a recording; `instants` may stand beside them.
BAG_KEYS = ("bag", "topics", "max_skew")


def add_function(parser: argparse.ArgumentParser) -> None:
    """The option that names the user's functions."""
    parser.add_argument(
        "--function",
        action="append",
        default=[],
        metavar="NAME=MODULE:FUNCTION",
        help="a measure NAME of the file: a function of a CableShape, of a module here or installed",
    )


def read_study(file: Path, functions: Sequence[str] = (), without: Sequence[str] = ()) -> Study:
    """The study of a file, `without` some of its keys.

    functions: "name=module:function" each. Only what the command names is run, nothing that a file says.

    Raises
    ------
    ArgumentError
        Naming the file's key or the function, and what to write.
    BagError
        If a motion's recording cannot be used.
    """
    found = find_file(file)
    told = {"name": found.stem, **load_yaml(found, STUDY_KEYS)}
    values = {key: value for key, value in told.items() if key not in without}
    motion = values.get("motion")
    if isinstance(motion, dict) and "bag" in motion:
        values["motion"] = _recorded(motion, found.parent)
    given = dict(_function(one) for one in functions)
    return Study.from_mapping(values, str(file), folder=found.parent, functions=given)


def _recorded(motion: dict[str, Any], folder: Path) -> dict[str, Any]:
    """What a recording moves, with the file's own `instants`."""
    from cable_shape.replay.bag_motion import motion_of_bag

    others = [key for key in motion if key not in (*BAG_KEYS, "instants")]
    if others:
        bound = f"a recording tells the whole motion, and {', '.join(others)} too"
        raise ArgumentError.of("motion.bag", str(motion["bag"]), bound, "Remove one of both.")
    told = {key: motion[key] for key in ("topics", "max_skew") if motion.get(key) is not None}
    instants = {} if motion.get("instants") is None else {"instants": motion["instants"]}
    return {**motion_of_bag(folder / path_of(motion["bag"], "motion.bag"), **told), **instants}


def _function(told: str) -> tuple[str, Callable[..., float]]:
    """A name, and the function that it stands for."""
    name, equals, where = told.partition("=")
    module, colon, attribute = where.partition(":")
    remedy = "Write --function sag=my_measures:sag, and sag among the measures."
    if not (name and equals and module and colon and attribute):
        raise ArgumentError.of("--function", told, "it must be NAME=MODULE:FUNCTION", remedy)
    if os.getcwd() not in sys.path:
        sys.path.insert(0, os.getcwd())  # which worker processes are given, too
    try:
        found = importlib.import_module(module)
    except Exception as error:  # whatever the user's module does
        bound = f"{module} cannot be imported here ({type(error).__name__}: {error})"
        raise ArgumentError.of("--function", told, bound, "Go to its folder, or install it.") from error
    function = getattr(found, attribute, None)
    if not callable(function):
        known = [key for key, value in vars(found).items() if callable(value) and not key.startswith("_")]
        bound = f"{module} has no function {attribute}; it has {', '.join(known) or 'none'}"
        raise ArgumentError.of("--function", told, bound, remedy)
    return name, function
