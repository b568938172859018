"""Reading KBL (VDA 4964) 2.3 to 2.5: :func:`read_kbl`.

Elements go by their local names: files of version 2.4 carry the namespace of 2.3. Coordinates have no unit in the
format and are millimetres; every other number names its unit.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, final
from xml.etree.ElementTree import Element

import numpy as np

from cable_shape.cable.kbl_parts import Fixing, KblFile, KblNode, KblSegment, Protection, Strand
from cable_shape.cable.xml_read import children, read_xml, tag, text
from cable_shape.checks import Array
from cable_shape.errors import FileError

PREFIXES = {
    "": 1.0, "pico": 1e-12, "nano": 1e-9, "micro": 1e-6, "milli": 1e-3, "centi": 1e-2, "deci": 1e-1, "deca": 1e1,
    "hecto": 1e2, "kilo": 1e3, "mega": 1e6,
}  # fmt: skip
DIMENSIONS = {"": 1, "none": 1, "square": 2, "cubic": 3}
#: Units that are called by a name only: factor to SI, and what it is a unit of.
NAMED = {
    "grampermetre": (1e-3, "kg/m"), "g/m": (1e-3, "kg/m"), "kilogrampermetre": (1.0, "kg/m"), "kg/m": (1.0, "kg/m"),
    "kilogramperkilometre": (1e-3, "kg/m"), "kg/km": (1e-3, "kg/m"), "gram": (1e-3, "kg"), "g": (1e-3, "kg"),
    "kilogram": (1.0, "kg"), "kg": (1.0, "kg"), "metre": (1.0, "m"), "m": (1.0, "m"), "millimetre": (1e-3, "m"),
    "mm": (1e-3, "m"), "squaremillimetre": (1e-6, "m2"), "mm2": (1e-6, "m2"), "mm^2": (1e-6, "m2"),
    "sqmm": (1e-6, "m2"), "inch": (0.0254, "m"), "in": (0.0254, "m"),
}  # fmt: skip
_MILLIMETRES = 1e-3
#: Segments and nodes of one file.
MOST_SEGMENTS = 20_000


def read_kbl(path: str | Path) -> KblFile:
    """What a KBL file says.

    Raises
    ------
    FileError
        Naming the file, the part and the remedy: no KBL, a reference to nothing, a unit that is missing or unknown, a
        number that is none.
    """
    root = read_xml(path, "KBL file")
    if tag(root) != "KBL_container":
        top = tag(root)[:40]
        raise FileError(f"{path}: the top element is <{top}>, that of a KBL is <KBL_container>. Is it a KBL file?")
    return _Reader(root, str(path)).file()


@final
class _Reader:
    """Follows the references of one file."""

    def __init__(self, root: Element, where: str) -> None:
        self.root, self.where = root, where
        self.by_id: dict[str, Element] = {}
        self.notes: list[str] = []
        for element in root.iter():
            if (name := element.get("id")) is not None:
                if name in self.by_id:
                    raise self.error(f"id {name!r}", "it is given twice", "Give every element an id of its own")
                self.by_id[name] = element
        self.units: dict[str, tuple[float, str]] = {}

    def file(self) -> KblFile:
        """All that a harness is made of."""
        root = self.root
        nodes = {str(e.get("id")): self.node(e) for e in children(root, "Node")}
        found = list(children(root, "Segment"))
        if not found:
            raise self.error("KBL_container", "it has no Segment", "Export the topology of the harness, too")
        if len(found) > MOST_SEGMENTS:
            raise self.error("KBL_container", f"it has {len(found)} segments", f"At most {MOST_SEGMENTS} are read")
        segments = {str(e.get("id")): self.segment(e, nodes) for e in found}
        routings = list(children(root, "Routing"))
        self.route(routings, segments)
        placed = {one.id for segment in segments.values() for one in segment.fixings}
        unplaced = [
            self.called(e)
            for e in self.by_id.values()
            if tag(e) == "Fixing_occurrence" and self.called(e) not in placed
        ]
        version = root.get("version_id", "")
        return KblFile(Path(self.where).name, version, nodes, segments, unplaced, len(routings), self.notes)

    # -- parts

    def node(self, e: Element) -> KblNode:
        """A node, with the connectors and other parts at it."""
        name = self.id_of(e)
        parts = []
        for reference in text(e, "Referenced_components").split():
            if (part := self.by_id.get(reference)) is None:
                self.notes.append(f"node {name}: it refers to {reference[:60]!r}, which is not there; left out")
            else:
                parts.append((self.called(part), self.mass_of_occurrence(part)))
        return KblNode(name, text(e, "Id"), self.point(text(e, "Cartesian_point"), f"Node {name}"), parts)

    def segment(self, e: Element, nodes: dict[str, KblNode]) -> KblSegment:
        """A segment with all that lies on it but its wires."""
        name = self.id_of(e)
        ends = text(e, "Start_node"), text(e, "End_node")
        for end, which in zip(ends, ("Start_node", "End_node"), strict=True):
            if end not in nodes:
                raise self.error(f"Segment {name}: {which}", f"there is no node {end[:60]!r}", "Name a Node by its id")
        area = next(children(e, "Cross_section_area_information"), None)
        out = KblSegment(
            name, text(e, "Id"), *ends,
            self.value(e, "Physical_length", "m"), self.value(e, "Virtual_length", "m"),
            [self.curve(c, name) for c in children(e, "Center_curve")],
            None if area is None else self.value(area, "Area", "m2"),
        )  # fmt: skip
        length = out.physical or out.virtual
        for one in children(e, "Fixing_assignment"):
            out.fixings.append(self.fixing(one, name, length))
        for one in children(e, "Protection_area"):
            out.protections.append(self.protection(one, name))
        return out

    def curve(self, e: Element, segment: str) -> tuple[int, Array]:
        """Degree and control points (n, 3) [m] of a curve."""
        where = f"Segment {segment}: Center_curve"
        degree = int(self.number(text(e, "Degree"), f"{where}: Degree"))
        points = np.array([self.point(name, where) for name in text(e, "Control_points").split()])
        if not 1 <= degree <= 24 or len(points) <= degree:
            raise self.error(
                where, f"degree {degree} with {len(points)} control points", "It needs one more than its degree"
            )
        return degree, points

    def fixing(self, e: Element, segment: str, length: float | None) -> Fixing:
        """A fixing on a segment; its place is a fraction, or a length from the start."""
        where = f"Segment {segment}: Fixing_assignment"
        occurrence = self.referred(text(e, "Fixing"), where)
        absolute = self.value(e, "Absolute_location", "m")
        if text(e, "Location"):
            location = self.number(text(e, "Location"), f"{where}: Location")
        elif absolute is not None and length:
            location = absolute / length
        else:
            raise self.error(where, "it says no Location", "Give the fraction of the segment from its start node")
        part = self.by_id.get(text(occurrence, "Part"))
        placement = next(children(occurrence, "Placement"), None)
        point = None if placement is None else self.point(text(placement, "Cartesian_point"), where)
        kind = "" if part is None else text(part, "Fixing_type")
        return Fixing(self.called(occurrence), self.share(location, where), kind, point)

    def protection(self, e: Element, segment: str) -> Protection:
        """A protection on a segment."""
        where = f"Segment {segment}: Protection_area"
        occurrence = self.referred(text(e, "Associated_protection"), where)
        part = self.by_id.get(text(occurrence, "Part"))
        ends = [
            self.share(self.number(text(e, name), f"{where}: {name}"), where)
            for name in ("Start_location", "End_location")
        ]
        kind = "" if part is None else text(part, "Protection_type")
        mass = None if part is None else self.value(part, "Mass_information", "kg/m", others=("kg",))
        return Protection(self.called(occurrence), kind, min(ends), max(ends), mass)

    def route(self, routings: list[Element], segments: dict[str, KblSegment]) -> None:
        """Puts the wires into the segments through which they run: the cable of several cores once in each."""
        owner = {
            str(core.get("id")): occurrence
            for occurrence in self.by_id.values()
            for core in children(occurrence, "Core_occurrence")
        }
        made: dict[tuple[str, int], Strand] = {}
        for e in routings:
            name = text(e, "Routed_wire")
            wire = self.by_id.get(name)
            if wire is not None and tag(wire) == "Connection":  # a routing names a connection, that names the wire
                wire = self.by_id.get(text(wire, "Wire"))
            if wire is None:
                self.notes.append(f"routing {e.get('id')}: it names no wire that is there; left out")
                continue
            wire = owner.get(str(wire.get("id")), wire)
            through = text(e, "Segments").split()
            for segment in through:
                if segment not in segments:
                    remedy = "Name segments by their ids"
                    raise self.error(f"Routing {e.get('id')}", f"there is no segment {segment[:60]!r}", remedy)
            length = self.stated_length(wire)
            for segment in through:
                key = (segment, id(wire))
                if key not in made:
                    made[key] = self.strand(wire, length)
                    segments[segment].strands.append(made[key])
                made[key].cores += 1

    def strand(self, wire: Element, length: float | None) -> Strand:
        """What a wire, or a cable of several cores, is made of."""
        part = self.by_id.get(text(wire, "Part"))
        if part is None:
            return Strand("", 0, None, None, None, None)
        mass = self.value(part, "Mass_information", "kg/m", others=("kg",))
        if mass is not None and self.unit_of(next(children(part, "Mass_information"))) == "kg":
            mass = mass / length if length else None  # of the whole wire
        area = self.value(part, "Cross_section_area", "m2")
        if area is None:
            areas = [self.value(core, "Cross_section_area", "m2") for core in children(part, "Core")]
            area = sum(one for one in areas if one is not None) or None
        thick, bend = (self.value(part, name, "m") or None for name in ("Outside_diameter", "Bend_radius"))
        return Strand(text(part, "Part_number"), 0, mass or None, thick, area or None, bend)

    def stated_length(self, wire: Element) -> float | None:
        """[m], the first length that a wire's occurrence states."""
        for information in children(wire, "Length_information"):
            return self.value(information, "Length_value", "m")
        return None

    def mass_of_occurrence(self, e: Element) -> float | None:
        """[kg] of a part at a node: its own and that of what is in it; None where nothing says it."""
        masses = [self.mass_of_part(text(e, "Part"))]
        inside: dict[str, None] = {}
        for child in e.iter():
            for name in ("Associated_parts", "Associated_plug"):
                inside |= dict.fromkeys(text(child, name).split())
        masses += [self.mass_of_part(text(self.by_id.get(reference), "Part")) for reference in inside]
        known = [mass for mass in masses if mass is not None]
        return sum(known) if known else None

    def mass_of_part(self, part: str) -> float | None:
        """[kg]."""
        found = self.by_id.get(part)
        return None if found is None else self.value(found, "Mass_information", "kg")

    # -- values

    def point(self, name: str, where: str) -> Array:
        """(3,) [m]."""
        e = self.referred(name, where)
        numbers = [self.number((c.text or "").strip(), f"Cartesian_point {name}") for c in children(e, "Coordinates")]
        if len(numbers) != 3:
            raise self.error(f"Cartesian_point {name}", f"it has {len(numbers)} Coordinates", "Give three, in mm")
        return _MILLIMETRES * np.array(numbers)

    def value(self, e: Element, name: str, of: str, others: tuple[str, ...] = ()) -> float | None:
        """The number of the child `name` in SI units; None where there is none."""
        child = next(children(e, name), None)
        if child is None or not text(child, "Value_component"):
            return None
        where = f"{tag(e)} {e.get('id')}: {name}"
        number = self.number(text(child, "Value_component"), where)
        factor, kind = self.unit(text(child, "Unit_component"), where)
        if kind != of:
            if kind in others:
                return number * factor if kind == "kg" else None
            raise self.error(where, f"its unit is one of {kind}, not of {of}", "Name the Unit that is meant")
        if number < 0.0:
            raise self.error(where, f"{number:g} is below 0", "Correct the number")
        return number * factor

    def unit_of(self, child: Element) -> str:
        """What the unit of a value is one of, "m", "m2", "kg" or "kg/m"."""
        return self.unit(text(child, "Unit_component"), tag(child))[1]

    def unit(self, name: str, where: str) -> tuple[float, str]:
        """Factor to SI, and what it is a unit of."""
        if not name:
            raise self.error(where, "its unit is missing", "Add a Unit_component that names a Unit")
        if name not in self.units:
            e = self.by_id.get(name)
            if e is None or tag(e) != "Unit":
                raise self.error(where, f"there is no Unit {name[:60]!r}", "Add it, with Si_unit_name and Si_prefix")
            self.units[name] = self._unit(e)
        return self.units[name]

    def _unit(self, e: Element) -> tuple[float, str]:
        base, prefix = text(e, "Si_unit_name").lower(), text(e, "Si_prefix").lower()
        if base:
            power = DIMENSIONS.get(text(e, "Si_dimension").lower(), 1)
            base = base.replace("meter", "metre")
            if prefix in PREFIXES and base in ("metre", "gram"):
                factor = PREFIXES[prefix] ** power
                return (1e-3 * factor, "kg") if base == "gram" else (factor, ("m", "m2", "m3")[power - 1])
            return 1.0, base
        named = "".join(text(e, "Unit_name").split()).lower().replace("meter", "metre")
        return NAMED.get(named, (1.0, named or "nothing"))

    def number(self, found: str, where: str) -> float:
        """A finite number."""
        try:
            number = float(found)
        except ValueError:
            number = math.nan
        if not math.isfinite(number) or "_" in found:
            raise self.error(where, "it must be a number" if found else "it is missing", "Write one, with a point")
        return number

    def share(self, location: float, where: str) -> float:
        """A fraction of a segment; one that is slightly outside is at its end."""
        if not -1e-3 <= location <= 1.001:
            raise self.error(where, f"location {location:g} is not on the segment", "Give a fraction from 0 to 1")
        return min(max(location, 0.0), 1.0)

    def referred(self, name: str, where: str) -> Element:
        """The element of this id."""
        found = self.by_id.get(name)
        if found is None:
            what = f"it refers to {name[:60]!r}, which is not there" if name else "a reference is missing"
            raise self.error(where, what, "Export it, too")
        return found

    def called(self, e: Element) -> str:
        """The name that people give to a part, else its id."""
        return text(e, "Id") or str(e.get("id"))

    def id_of(self, e: Element) -> str:
        """The id of an element that needs one."""
        name = e.get("id")
        if not name:
            raise self.error(tag(e), "it has no id", "Give it one")
        return name

    def error(self, part: Any, what: str, remedy: str) -> FileError:
        return FileError(f"{self.where}: {part}: {what}. {remedy}.")
