"""YAML and JSON files, read strictly: :func:`load`, the one loader of all files of keys and values.

What YAML 1.1 would take silently for something else is refused: a key given twice, 1:30 for 90, 010 for 8. Aliases and
merge keys are read as long as what they stand for stays within bounds. 1e-3 is a number as in YAML 1.2, a date is text.
"""

from __future__ import annotations

import difflib
import json
import re
from collections.abc import Iterable, Iterator
from itertools import islice
from pathlib import Path
from typing import Any, TypeAlias, final

from cable_shape.errors import FileError
from cable_shape.files.files import YAML_BYTES, read_text

#: Values that a file may stand for when its aliases are written out.
MAX_VALUES = 1_000_000
#: Mappings and lists within each other.
MAX_DEPTH = 64
#: Digits of a whole number: those of nanoseconds since 1970.
MAX_DIGITS = 19

#: Every key of the files that are read here. Of a file that has none of them at its top nothing is quoted.
WORDS = frozenset((
    "length", "linear_density", "bending_stiffness", "twisting_stiffness", "axial_stiffness", "shear_stiffness",
    "rest_curvature", "diameter", "gradient_length", "min_bend_radius", "max_tension", "max_twist_rate",
    "inner_diameter", "allowable_stress", "tails", "youngs_modulus", "poisson_ratio", "density", "cables",
    "obstacles", "clips", "masses", "warn_distance", "error_distance", "sockets", "plug", "contact", "name", "box",
    "sphere", "cylinder", "capsule", "half_space", "mesh", "scale", "position", "quaternion", "link", "radius",
    "vertices", "faces", "arc_length", "kind", "mass", "socket", "urdf", "grippers", "home", "left", "right",
    "frame", "offset", "gripping_links", "confidence", "misses", "start", "end", "cable", "covariance", "angle",
    "names", "matrix", "scene", "model", "gravity", "points", "tolerance", "distributed_load", "turns", "curvature",
    "force", "moment", "solution", "quantity", "grips", "correction", "harness", "segments", "junctions", "segment",
    "ends", "frames", "sections", "stiffness_interval", "retardation_time", "drag", "friction",
    "retraction", "height_field", "heights", "spacing", "file",
    "allow", "body", "max_force",
))  # fmt: skip

_INT = re.compile(r"[-+]?[0-9][0-9_]*")
_BASED = re.compile(r"[-+]?0(?:x[0-9a-fA-F][0-9a-fA-F_]*|b[01][01_]*|o[0-7][0-7_]*)")
_FLOAT = re.compile(r"[-+]?(?:\.[0-9]+|[0-9][0-9_]*(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?")
_SPECIAL = re.compile(r"([-+]?)\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN)")
_SEXAGESIMAL = re.compile(r"[-+]?[0-9][0-9_]*(?::[0-5]?[0-9])+(?:\.[0-9_]*)?")
_NULLS = frozenset(("", "~", "null", "Null", "NULL"))
_TRUE = frozenset(w for word in ("yes", "true", "on") for w in (word, word.title(), word.upper()))
_FALSE = frozenset(w for word in ("no", "false", "off") for w in (word, word.title(), word.upper()))
_STANDARD = "tag:yaml.org,2002:"
_QUOTED = re.compile(r"'[^']*'|\"[^\"]*\"")

#: A value, of how many values it is made when its aliases are written out, and how deep these lie within it.
_Found: TypeAlias = tuple[Any, int, int]


def load_yaml(path: str | Path, known: Iterable[str] | None = None) -> dict[str, Any]:
    """The mapping that is the top level of a YAML file, or of a JSON file by its ending.

    known: keys of which one must be at the top, or nearly; default :data:`WORDS`.

    Raises
    ------
    FileError
        Naming the file, line, key and remedy: not a regular file, larger than 1 MB, malformed, ambiguous, nested more
        than 64 deep, aliases that stand for more than a million values, or not a mapping of known keys.
    """
    text = read_text(path, YAML_BYTES)
    data = _from_json(text, str(path)) if str(path).endswith(".json") else read_strictly(text, str(path))
    if not isinstance(data, dict):
        kind = {list: "a list", type(None): "empty"}.get(type(data), "one value")
        raise FileError(f"{path}: the top level must be a mapping of keys to values, but it is {kind}.")
    if data and not _is_one_of_ours(data, WORDS if known is None else frozenset(known)):
        raise FileError(f"{path}: none of its keys is known. Is it the right file?")
    return data


def read_strictly(text: str, where: str) -> Any:
    """What a text in YAML says, for errors said to be in `where`; see :func:`load`."""
    return _Reader(text, where).document()


def _is_one_of_ours(data: dict[Any, Any], known: frozenset[str]) -> bool:
    if any(key in known for key in data):
        return True
    words = [key for key in islice(data, 20) if isinstance(key, str) and len(key) < 40]
    return any(difflib.get_close_matches(word, known, n=1, cutoff=0.7) for word in words)


@final
class _Reader:
    """Builds what a text says from the parser's events."""

    def __init__(self, text: str, where: str) -> None:
        import yaml

        self._yaml = yaml
        self._where = where
        self._anchors: dict[str, _Found | None] = {}  # None while it is being read
        self._key: Any = None  # the one whose value is being read
        loader: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
        self._events: Iterator[Any] = yaml.parse(text, Loader=loader)

    def document(self) -> Any:
        """What the only document says."""
        yaml = self._yaml
        try:
            next(self._events)  # the stream begins
            if isinstance(next(self._events), yaml.StreamEndEvent):
                return None
            value = self._node(next(self._events), 0)[0]
            next(self._events)  # the document ends
            after = next(self._events)
        except yaml.MarkedYAMLError as error:
            reason = _QUOTED.sub(lambda m: "it" if re.search(r"\w", m[0]) else m[0], error.problem or "")
            mark: Any = error.problem_mark
            raise self._error(f"not well formed: {reason}. Correct that line.", mark) from None
        except yaml.YAMLError:
            raise self._error("it has characters that YAML does not allow. Is it the right file?", None) from None
        if not isinstance(after, yaml.StreamEndEvent):
            raise self._error("a second document begins. Keep one in a file.", after.start_mark)
        return value

    def _node(self, event: Any, depth: int) -> _Found:
        """What a node says that lies `depth` mappings and lists deep."""
        yaml = self._yaml
        if isinstance(event, yaml.AliasEvent):
            found = self._anchors.get(event.anchor)
            if found is None:
                raise self._error("an alias to nothing before it. Name an anchor (&name) that has ended.", event)
            if depth + found[2] > MAX_DEPTH:
                raise self._error(f"aliases nest more than {MAX_DEPTH} deep. Write it flatter.", event)
            return found
        if event.anchor is not None:
            self._anchors[event.anchor] = None
        if isinstance(event, yaml.ScalarEvent):
            found = self._scalar(event), 1, 0
        else:
            if depth >= MAX_DEPTH:
                raise self._error(f"nested more than {MAX_DEPTH} deep. Write it flatter.", event)
            sequence = isinstance(event, yaml.SequenceStartEvent)
            if event.tag not in (None, "!", _STANDARD + ("seq" if sequence else "map")):
                raise self._error("tags (!) are not read. Remove it.", event)
            found = self._sequence(depth) if sequence else self._mapping(depth)
        if event.anchor is not None:
            self._anchors[event.anchor] = found
        return found

    def _sequence(self, depth: int) -> _Found:
        out, size, height = [], 1, 0
        while not isinstance(event := next(self._events), self._yaml.SequenceEndEvent):
            value, more, high = self._node(event, depth + 1)
            out.append(value)
            size, height = self._sum(size, more, event), max(height, high)
        return out, size, height + 1

    def _mapping(self, depth: int) -> _Found:
        out: dict[Any, Any] = {}
        merged: list[dict[Any, Any]] = []
        lines: dict[Any, int] = {}
        size, height = 1, 0
        while not isinstance(event := next(self._events), self._yaml.MappingEndEvent):
            if not isinstance(event, self._yaml.ScalarEvent):
                raise self._error("a key must be a word, not a list, a mapping or an alias. Write it out.", event)
            merge = event.value == "<<" and event.implicit[0]
            outer, self._key = self._key, None
            key = event.value if merge else self._scalar(event)
            self._key = key
            if key in lines:
                text = f"it was given before, in line {lines[key]}. Keep one of them."
                raise self._error(text, event)
            mark: Any = event.start_mark
            lines[key] = mark.line + 1
            value, more, high = self._node(next(self._events), depth + 1)
            size, height = self._sum(size, more, event), max(height, high)
            if merge:
                merged = value if isinstance(value, list) else [value]
                if not all(isinstance(one, dict) for one in merged):
                    raise self._error("<< merges mappings only. Name anchors (&name) of mappings.", event)
            else:
                out[key] = value
            self._key = outer
        base: dict[Any, Any] = {}
        for one in reversed(merged):
            base |= one
        return base | out, size, height + 1

    def _sum(self, size: int, more: int, event: Any) -> int:
        """Refuses small files that stand for huge ones."""
        if size + more > MAX_VALUES:
            text = f"its aliases (*name) make more than {MAX_VALUES} values. Write out what is meant."
            raise self._error(text, event)
        return size + more

    def _scalar(self, event: Any) -> Any:
        """Text, number, truth or nothing."""
        text, tag = event.value, event.tag
        if tag is None or tag == "!":
            return self._plain(text, event) if tag is None and event.implicit[0] else text
        kind = tag.removeprefix(_STANDARD)
        if kind == "str":
            return text
        value = self._plain(text, event)
        if kind == "float" and isinstance(value, int) and not isinstance(value, bool):
            return float(value)
        if {"null": type(None), "bool": bool, "int": int, "float": float}.get(kind) is not type(value):
            raise self._error("this tag (!) is not read here. Remove it.", event)
        return value

    def _plain(self, text: str, event: Any) -> Any:
        """What a text without quotes stands for."""
        if text in _NULLS:
            return None
        if text in _TRUE or text in _FALSE:
            return text in _TRUE
        if _INT.fullmatch(text):
            digits = text.replace("_", "").lstrip("+-")
            if len(digits) > 1 and digits[0] == "0" and digits.strip("0"):
                raise self._error("YAML takes a whole number that begins with 0 for octal. Remove the 0.", event)
            return self._whole(text, 10, event)
        if _BASED.fullmatch(text):
            return self._whole(text, 0, event)
        if _FLOAT.fullmatch(text):
            return float(text.replace("_", ""))
        if special := _SPECIAL.fullmatch(text):
            return float("nan") if special[1] is None else float(f"{special[1]}inf")
        if _SEXAGESIMAL.fullmatch(text):
            remedy = "Write the number out, or quotes about a text."
            raise self._error(f"YAML takes colons between digits for base 60. {remedy}", event)
        return text

    def _whole(self, text: str, base: int, event: Any) -> int:
        digits = text.replace("_", "")
        if len(digits.lstrip("+-0")) > MAX_DIGITS:
            text = f"a whole number of more than {MAX_DIGITS} digits. Give it in a larger unit, or as 1.0e+20."
            raise self._error(text, event)
        return int(digits, base)

    def _error(self, text: str, at: Any) -> FileError:
        """`at`: an event or a mark."""
        mark: Any = getattr(at, "start_mark", at)
        line = "" if mark is None else f", line {mark.line + 1}"
        key = f", key {self._key!r}" if isinstance(self._key, str) and self._key in WORDS else ""
        return FileError(f"{self._where}{line}{key}: {text}")


def _from_json(text: str, where: str) -> Any:
    """JSON as strictly."""

    def mapping(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        out: dict[str, Any] = {}
        for key, value in pairs:
            if key in out:
                named = f", key {key!r}" if key in WORDS else ""
                raise FileError(f"{where}{named}: a key is given twice in one mapping. Keep one of them.")
            out[key] = value
        return out

    def whole(digits: str) -> int:
        if len(digits) > MAX_DIGITS + 1:
            raise FileError(f"{where}: a whole number of more than {MAX_DIGITS} digits. Give it in a larger unit.")
        return int(digits)

    try:
        data = json.loads(text, object_pairs_hook=mapping, parse_int=whole)
        if _depth(data) > MAX_DEPTH:
            raise RecursionError
    except json.JSONDecodeError as error:
        raise FileError(f"{where}, line {error.lineno}: not well formed: {error.msg}. Correct that line.") from None
    except RecursionError:
        raise FileError(f"{where}: nested more than {MAX_DEPTH} deep. Write it flatter.") from None
    return data


def _depth(data: Any) -> int:
    """How deep lists and mappings lie within each other."""
    depth, level = 0, [data]
    while level := [one for one in level if isinstance(one, (list, dict))]:
        depth += 1
        level = [inner for one in level for inner in (one.values() if isinstance(one, dict) else one)]
    return depth
