"""Types of numba as text and back, for the list of kernels that are compiled ahead.

`f8 i8 b1` are numbers, `none` is None, `f8[2C]` is an array of two dimensions in C order, with `!` one that is read
only, `(f8,f8)` a tuple, and `network.tables.Plan(...)` a named tuple, by the kernel file that has it.
"""

from __future__ import annotations

import importlib
import re
from typing import Any

import numba

types: Any = numba.types
KERNELS = "cable_shape.kernels."
NUMBERS = {"f8": types.float64, "i8": types.int64, "b1": types.boolean, "none": types.none}
_NAMES = {number: name for name, number in NUMBERS.items()}
_TOKEN = re.compile(r"(f8|i8|b1)\[(\d)([CFA])(!?)\]|(f8|i8|b1|none)|([\w.]*)\(|(\))|,")


def text_of(types_: tuple[Any, ...]) -> str:
    """A signature's arguments as text.

    Raises
    ------
    ValueError
        If one of them is of a kind that has no text.
    """
    return f"({','.join(map(_text, types_))})"


def _text(one: Any) -> str:
    if one in _NAMES:
        return _NAMES[one]
    if isinstance(one, types.Array) and one.dtype in _NAMES and one.aligned:
        return f"{_NAMES[one.dtype]}[{one.ndim}{one.layout}{'' if one.mutable else '!'}]"
    if isinstance(one, types.BaseNamedTuple):
        where = one.instance_class.__module__.removeprefix(KERNELS)
        return f"{where}.{one.instance_class.__qualname__}{text_of(tuple(one))}"
    if isinstance(one, types.BaseTuple):
        return text_of(tuple(one))
    raise ValueError(f"{one} has no text: add it to {__name__}")


def types_of(text: str) -> tuple[Any, ...]:
    """What :func:`text_of` made a text of.

    Raises
    ------
    ValueError, AttributeError, ImportError
        If it is none, or names what is no longer there.
    """
    at = 0
    open_tuples: list[tuple[str, list[Any]]] = [("", [])]
    while at < len(text):
        found = _TOKEN.match(text, at)
        if found is None:
            raise ValueError(f"{text[at : at + 20]!r} is no type")
        at = found.end()
        dtype, ndim, layout, readonly, number, name, closes = found.groups()
        if dtype:
            open_tuples[-1][1].append(types.Array(NUMBERS[dtype], int(ndim), layout, readonly=bool(readonly)))
        elif number:
            open_tuples[-1][1].append(NUMBERS[number])
        elif name is not None:
            open_tuples.append((name, []))
        elif closes:
            own, parts = open_tuples.pop()
            open_tuples[-1][1].append(_tuple(own, parts))
    return tuple(open_tuples[0][1][0])


def _tuple(name: str, parts: list[Any]) -> Any:
    if not name:
        return types.Tuple(parts)
    module, _, own = name.rpartition(".")
    kind = getattr(importlib.import_module(KERNELS + module), own)
    same = parts and all(part == parts[0] for part in parts)
    return types.NamedUniTuple(parts[0], len(parts), kind) if same else types.NamedTuple(parts, kind)
