"""WireViz YAML: which connectors are joined by which cables, how long. :func:`from_wireviz`

The format has no geometry, so the harness is straight at rest, and has no clips. Where one bundle goes to several
connectors nothing says where it branches: a table says it, of a star::

    W1: {from: X1, trunk: 0.35}      # m from connector X1 to where all others branch off
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, final

from cable_shape import checks
from cable_shape.cable.bundle import bundle_of
from cable_shape.cable.cable import Cable
from cable_shape.cable.harness import Harness
from cable_shape.cable.imported import Imported
from cable_shape.cable.junction import Junction
from cable_shape.cable.kbl_parts import Strand
from cable_shape.errors import ArgumentError, FileError
from cable_shape.files.yaml_files import load_yaml
from cable_shape.pose import FreeEnd

KEYS = ("connectors", "cables", "connections", "templates", "options", "metadata", "tweak", "additional_bom_items")
UNITS = {"m": 1.0, "mm": 1e-3, "cm": 1e-2, "ft": 0.3048, "in": 0.0254, "inch": 0.0254, "km": 1e3}
_ARROW = re.compile(r"[<]?[-=]{1,2}[>]?")
_RANGE = re.compile(r"(\d+)-(\d+)")
_LENGTH = re.compile(r"\s*([0-9.eE+-]+)\s*([A-Za-z]*)\s*")


def from_wireviz(path: str | Path, branches: str | Path | None = None) -> Harness:
    """The harness of a WireViz file.

    Raises
    ------
    FileError, ArgumentError
        Naming the part and the remedy: a cable without length, an unknown unit, a bundle whose branch is nowhere.
    """
    values = load_yaml(path, KEYS)
    told = {} if branches is None else load_yaml(branches, [str(name) for name in values.get("cables") or ()])
    return _Builder(values, str(path), told).made()


@final
class _Builder:
    def __init__(self, values: Mapping[str, Any], where: str, branches: Mapping[str, Any]) -> None:
        self.where, self.branches = where, branches
        self.separator = str((values.get("options") or {}).get("template_separator", "."))
        self.connectors = self.mapping(values, "connectors")
        self.cables = self.mapping(values, "cables")
        self.sets = values.get("connections") or []
        if not isinstance(self.sets, list):
            raise self.error("connections", "it must be a list of sets", "Start each set with a dash")
        self.runs: dict[str, dict[tuple[str, str], int]] = {}
        self.left_out: list[str] = []
        self.derived: dict[str, None] = {}

    def made(self) -> Harness:
        """Segments from connector to connector, or to where they branch."""
        for i, one in enumerate(self.sets):
            self.follow(one, f"connections[{i}]")
        cables: dict[str, Cable] = {}
        at: dict[str, list[str]] = {}
        labels: dict[str, str] = {}

        def segment(name: str, length: float, bundle: str, wires: int, start: str, end: str) -> None:
            cables[name] = self.cable(bundle, length, wires)
            at.setdefault(start, []).append(f"{name}.start")
            at.setdefault(end, []).append(f"{name}.end")

        for bundle, runs in self.runs.items():
            length = self.length(bundle)
            if len(runs) == 1:
                (((start, end), wires),) = runs.items()
                segment(bundle, length, bundle, wires, start, end)
                continue
            trunk, first = self.branch(bundle, runs, length)
            node = f"{bundle}-branch"
            segment(f"{bundle}-trunk", trunk, bundle, sum(runs.values()), first, node)
            for (start, end), wires in runs.items():
                other = end if start == first else start
                segment(f"{bundle}-{other}", length - trunk, bundle, wires, node, other)
        if not cables:
            raise self.error("connections", "no cable joins two connectors", "List sets [connector, cable, connector]")
        for node, there in at.items():
            labels[there[0] if len(there) == 1 else node] = node
        joints = [Junction(node, ends) for node, ends in at.items() if len(ends) > 1]
        free = {there[0]: FreeEnd() for there in at.values() if len(there) == 1}
        self.left_out.append("places of connectors and branches, masses of connectors, clips: the format has none")
        self.derived["masses and stiffness of all wires, of their gauges"] = None
        imported = Imported(
            f"{Path(self.where).name}, WireViz", ends=free, labels=labels, derived=tuple(self.derived),
            left_out=tuple(self.left_out),
        )  # fmt: skip
        return Harness(cables, joints, imported=imported)

    # -- who is joined to whom

    def follow(self, one: Any, where: str) -> None:
        """Counts the wires of a set: connector, cable, connector ..."""
        if not isinstance(one, list):
            raise self.error(where, "a set must be a list", "Write - [X1: [1, 2], W1: [1, 2], X2: [1, 2]] line by line")
        parts = [self.part(item, f"{where}[{i}]") for i, item in enumerate(one)]
        for i, (name, count) in enumerate(parts):
            if self.known(name) != "cable":
                continue
            sides = [parts[k][0] for k in (i - 1, i + 1) if 0 <= k < len(parts)]
            ends = [side for side in sides if self.known(side) == "connector"]
            if len(ends) < 2:
                self.left_out.append(f"{where}: {name} ends at one connector only")
                continue
            runs = self.runs.setdefault(self.instance(name), {})
            key = (self.instance(ends[0]), self.instance(ends[1]))
            key = key[::-1] if key[::-1] in runs else key
            runs[key] = runs.get(key, 0) + count

    def part(self, item: Any, where: str) -> tuple[str, int]:
        """A name, and how many pins or wires of it."""
        if isinstance(item, Mapping) and len(item) == 1:
            ((name, pins),) = item.items()
            return str(name), sum(1 for _ in self.pins(pins))
        if isinstance(item, str):
            return item, 1
        if isinstance(item, list) and item:
            return self.part(item[0], where)[0], len(item)
        raise self.error(where, "it must be a name, name: pins, or an arrow", "Write X1: [1, 2]")

    def pins(self, pins: Any) -> Iterator[Any]:
        """Each of them, ranges written out."""
        for pin in pins if isinstance(pins, list) else [pins]:
            span = _RANGE.fullmatch(pin) if isinstance(pin, str) else None
            if span is None:
                yield pin
            else:
                a, b = int(span[1]), int(span[2])
                if abs(b - a) > 1000:
                    raise self.error("connections", f"the range {pin} is too long", "Give at most 1000 pins")
                yield from range(min(a, b), max(a, b) + 1)

    def known(self, name: str) -> str:
        """What a name is: cable, connector, arrow."""
        if _ARROW.fullmatch(name):
            return "arrow"
        template = name.split(self.separator)[0]
        if template in self.cables:
            return "cable"
        if template in self.connectors:
            return "connector"
        raise self.error("connections", f"there is no connector or cable {name[:40]!r}", "Define it above")

    def instance(self, name: str) -> str:
        """The name of an instance of a template."""
        template, _, own = name.partition(self.separator)
        return own or template

    # -- cables

    def given(self, bundle: str) -> Mapping[str, Any]:
        if bundle in self.cables:
            return self.cables[bundle]  # type: ignore[no-any-return]
        for one in self.sets:
            for item in one:
                name = str(next(iter(item)) if isinstance(item, Mapping) else item)
                if self.instance(name) == bundle and name.split(self.separator)[0] in self.cables:
                    return self.cables[name.split(self.separator)[0]]  # type: ignore[no-any-return]
        raise self.error(f"cables.{bundle}", "it is not there", "Define it")

    def length(self, bundle: str) -> float:
        """[m]."""
        value = self.given(bundle).get("length")
        if value is None:
            raise self.error(f"cables.{bundle}", "it has no length", "Add length, in m")
        return self.in_metres(value, f"cables.{bundle}: length")

    def in_metres(self, value: Any, where: str) -> float:
        found = _LENGTH.fullmatch(str(value))
        unit = found[2].lower() if found and found[2] else "m"
        if found is None or unit not in UNITS:
            raise self.error(where, f"{str(value)[:30]!r} is no length", f"Known units: {', '.join(UNITS)}")
        return checks.number(f"{self.where}: {where}", _number(found[1]), above=0.0, unit="m") * UNITS[unit]

    def branch(self, bundle: str, runs: Mapping[tuple[str, str], int], length: float) -> tuple[float, str]:
        """Length of the trunk [m], and the connector at its other end."""
        told = self.branches.get(bundle)
        if not isinstance(told, Mapping) or not {"from", "trunk"} <= set(told):
            ends = ", ".join(f"{a} to {b}" for a, b in runs)
            raise self.error(
                f"cables.{bundle}", f"it goes {ends}, and nothing says where it branches",
                f"Give --branches a file with {bundle}: {{from: CONNECTOR, trunk: METRES}}",
            )  # fmt: skip
        first, trunk = str(told["from"]), self.in_metres(told["trunk"], f"{bundle}: trunk")
        if any(first not in run for run in runs):
            raise self.error(f"{bundle}: from", f"not all wires begin at {first!r}", "Split the bundle")
        if not trunk < length:
            raise self.error(f"{bundle}: trunk", f"{trunk:g} m is not below its length, {length:g} m", "Shorten it")
        return trunk, first

    def cable(self, bundle: str, length: float, wires: int) -> Cable:
        """Of so many wires of its gauge: loose ones slip, in a jacket they stick."""
        given = self.given(bundle)
        strand = Strand(bundle, 1, None, None, self.area(given.get("gauge"), bundle), None)
        made = bundle_of([strand] * max(1, min(wires, 400)), None)
        self.derived |= dict.fromkeys(made.derived)
        loose = given.get("category") == "bundle"
        return Cable(
            length, made.linear_density, made.stiffness[0 if loose else 1], axial_stiffness=made.pull,
            diameter=made.diameter, stiffness_interval=made.stiffness,
        )  # fmt: skip

    def area(self, gauge: Any, bundle: str) -> float | None:
        """[m^2] of a conductor: a number or text in mm2, or AWG."""
        if gauge is None:
            return None
        words = str(gauge).replace("mm²", "mm2").split()
        number = _number(words[0]) if words else math.nan
        if math.isfinite(number) and len(words) == 2 and words[1].upper() == "AWG":
            return 0.25 * math.pi * (0.127e-3 * math.pow(92.0, (36.0 - number) / 39.0)) ** 2  # ASTM B258
        if number > 0.0 and (len(words) == 1 or words[1] == "mm2"):
            return number * 1e-6
        self.left_out.append(f"cables.{bundle}: gauge is not understood")
        return None

    def mapping(self, values: Mapping[str, Any], key: str) -> dict[str, Any]:
        found = values.get(key)
        if not isinstance(found, Mapping) or not all(one is None or isinstance(one, Mapping) for one in found.values()):
            raise self.error(key, "it must be a mapping of names to mappings", "Is it a WireViz file?")
        return {str(name): one or {} for name, one in found.items()}

    def error(self, part: str, what: str, remedy: str) -> ArgumentError:
        return FileError(f"{self.where}: {part}: {what}. {remedy}.")


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan
