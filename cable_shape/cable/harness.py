"""What a wire harness is: cables that meet in junctions, as :class:`Harness`."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, final

from cable_shape import checks
from cable_shape.cable.cable import Cable
from cable_shape.cable.junction import Junction
from cable_shape.errors import ArgumentError

if TYPE_CHECKING:
    from cable_shape.cable.imported import Imported
    from cable_shape.scene.scene_parts import Clip

SIDES = ("start", "end")
#: As far as an end may be from its junction, in lengths of all segments.
_BESIDE = 10.0
_WRITE = "Write Harness(segments={name: Cable(...)}, junctions=[Junction(...)])."


def split_end(end: str) -> tuple[str, str]:
    """The segment and the side of an end's name: "a.start" is ("a", "start")."""
    segment, _, side = end.rpartition(".")
    return segment, side


@final
class Harness:
    """Cables joined in junctions: trees, loops, or several of them.

    Parameters
    ----------
    segments : mapping of a name to Cable
        The name is one word without "/"; the ends of segment "a" are "a.start" and "a.end".
    junctions : sequence of Junction
        Their names are unique. Ends that are in no junction are held by grips or clips, or free.
    imported : Imported, optional
        What holds and loads it, and what was made of the file that it was read from; no part of it.

    Raises
    ------
    ArgumentError
        Naming the part, the bound and the remedy: an end that is unknown or in two junctions; a name used twice.
    """

    __slots__ = ("_junction_of", "imported", "junctions", "segments")

    segments: Mapping[str, Cable]
    junctions: tuple[Junction, ...]
    imported: Imported | None
    _junction_of: dict[str, Junction]

    def __init__(
        self, segments: Mapping[str, Cable], junctions: Iterable[Junction] = (), *, imported: Imported | None = None
    ) -> None:
        put = object.__setattr__
        put(self, "imported", imported)
        if not isinstance(segments, Mapping) or not segments:
            raise ArgumentError.of("segments", segments, "it must be a mapping of names to cables, not empty", _WRITE)
        for name, cable in segments.items():
            _check_segment(name, cable)
        put(self, "segments", MappingProxyType(dict(segments)))
        put(self, "junctions", checks.entries("junctions", junctions, Junction, _WRITE))
        known = set(self.ends)
        seen: set[str] = set()
        junction_of: dict[str, Junction] = {}
        for junction in self.junctions:
            if junction.name in seen:
                raise ArgumentError.of("junctions", junction.name, "names must be unique", "Rename one of them.")
            seen.add(junction.name)
            for end in junction.ends:
                where = f"junction {junction.name!r}: ends"
                if end not in known:
                    remedy = f"Write 'NAME.start' or 'NAME.end'; segments: {', '.join(self.segments)}."
                    raise ArgumentError.of(where, end, "there is no such end of a segment", remedy)
                if end in junction_of:
                    bound = f"this end is in junction {junction_of[end].name!r} already"
                    raise ArgumentError.of(where, end, bound, "Name every end once; one junction may have many ends.")
                beside = junction.frame(end).position
                if not float(beside @ beside) <= (most := _BESIDE * self.length) ** 2:
                    where = f"junction {junction.name!r}: frames[{end!r}].position"
                    bound = f"it must be within {most:.3g} m, {_BESIDE:g} times the length of all segments"
                    raise ArgumentError.of(where, beside.tolist(), bound, "Positions are in m.")
                junction_of[end] = junction
        put(self, "_junction_of", junction_of)
        for end in self.tails:
            if end in junction_of:
                where = f"segments[{split_end(end)[0]!r}].tails"
                bound = f"{end} is in junction {junction_of[end].name!r}: nothing hangs beyond it"
                raise ArgumentError.of(where, dict(segments[split_end(end)[0]].tails), bound, "Make a segment of it.")

    def __setattr__(self, name: str, value: object) -> None:
        raise AttributeError(f"a Harness is fixed; make another with harness.replace({name}=...)")

    def __reduce__(self) -> tuple[Any, ...]:
        return _remade, (dict(self.segments), self.junctions, self.imported)

    @property
    def ends(self) -> tuple[str, ...]:
        """All ends of segments, "a.start", "a.end", and so on in the order of the segments."""
        return tuple(f"{name}.{side}" for name in self.segments for side in SIDES)

    @property
    def open_ends(self) -> tuple[str, ...]:
        """The ends that are in no junction: those which may be held."""
        return tuple(end for end in self.ends if end not in self._junction_of)

    @property
    def tails(self) -> dict[str, float]:
        """[m], of what hangs beyond ends of segments where grips hold them, by end."""
        return {f"{name}.{side}": long for name, cable in self.segments.items() for side, long in cable.tails.items()}

    @property
    def clips(self) -> tuple[Clip, ...]:
        """What holds it as the file says that it was read from, for a Scene; none of others."""
        return () if self.imported is None else self.imported.clips

    @property
    def wire_mass(self) -> float:
        """[kg], of its wires, as far as the file that it was read from states their mass; else of all segments."""
        if self.imported is None:
            return sum(cable.linear_density * cable.length for cable in self.segments.values())
        return self.imported.wire_mass

    @property
    def length(self) -> float:
        """[m], of all segments together."""
        return sum(cable.length for cable in self.segments.values())

    @property
    def longest(self) -> float:
        """[m], of the longest segment."""
        return max(cable.length for cable in self.segments.values())

    def junction_of(self, end: str) -> Junction | None:
        """The junction that an end is in; None if it is open."""
        return self._junction_of.get(end)

    def parts(self) -> list[frozenset[str]]:
        """Names of the segments that hang together, part by part."""
        left = dict.fromkeys(self.segments)
        out = []
        while left:
            reach, found = [next(iter(left))], set[str]()
            while reach:
                name = reach.pop()
                if name in found:
                    continue
                found.add(name)
                left.pop(name, None)
                for side in SIDES:
                    junction = self.junction_of(f"{name}.{side}")
                    reach.extend(split_end(end)[0] for end in (junction.ends if junction else ()))
            out.append(frozenset(found))
        return out

    def way(self, start: str, end: str) -> float:
        """[m], the shortest way along segments from one end to another; infinite where there is none."""
        best = {start: 0.0}
        reach = [start]
        while reach:
            here = reach.pop()
            name, side = split_end(here)
            other = f"{name}.{SIDES[1 - SIDES.index(side)]}"
            junction = self.junction_of(here)
            beside = [(end, 0.0) for end in (junction.ends if junction else ())]
            for there, far in ((other, self.segments[name].length), *beside):
                if best[here] + far < best.get(there, math.inf):
                    best[there] = best[here] + far
                    reach.append(there)
        return best.get(end, math.inf)

    @classmethod
    def from_mapping(cls, values: Mapping[str, Any], where: str = "harness", folder: str | Path = ".") -> Harness:
        """From a mapping with the keys `segments` and `junctions`, see :mod:`cable_shape.cable.harness_file`."""
        from cable_shape.cable.harness_file import harness_of

        return harness_of(cls, values, where, folder)

    @classmethod
    def from_yaml(cls, path: str | Path) -> Harness:
        """From a YAML file, see :mod:`cable_shape.cable.harness_file`; paths of cables are taken from its folder."""
        from cable_shape.files.files import path_of
        from cable_shape.files.yaml_files import load_yaml

        return cls.from_mapping(load_yaml(path), where=str(path), folder=path_of(path).parent)

    @classmethod
    def from_kbl(
        cls, path: str | Path, merge_below: float = 0.0, *, clip_kind: str = "ball", hold: str = "fixings"
    ) -> Harness:
        """From a KBL file (VDA 4964) 2.3 to 2.5; its segments keep their ids, and what holds it is in `imported`.

        Parameters
        ----------
        path : path of the file
        merge_below : float
            [m]; nodes that a segment shorter than this joins become one. 0: none.
        clip_kind : str
            What the fixings are: "ball", "hinge" or "fixed".
        hold : str
            "fixings": only what fewer than two fixings hold is held at its connectors, too; "connectors": all is.

        Raises
        ------
        FileError, ArgumentError
            Naming the part, the bound and the remedy.
        """
        from cable_shape.cable.kbl_harness import from_kbl

        made: Harness = from_kbl(cls, path, merge_below, clip_kind, hold)
        return made

    def to_yaml(self, path: str | Path) -> None:
        """Writes what `from_yaml` reads."""
        from cable_shape.cable.harness_file import write

        write(self.as_dict(), path)

    def as_dict(self) -> dict[str, Any]:
        """The mapping that `from_mapping` takes, as plain numbers, lists and words."""
        from cable_shape.cable.harness_file import as_dict

        return as_dict(self.segments, self.junctions)

    def replace(
        self, segments: Mapping[str, Cable] | None = None, junctions: Iterable[Junction] | None = None
    ) -> Harness:
        """A copy with other segments or junctions."""
        return Harness(
            self.segments if segments is None else segments, self.junctions if junctions is None else junctions
        )

    def __eq__(self, other: object) -> bool:
        return (
            isinstance(other, Harness)
            and dict(self.segments) == dict(other.segments)
            and self.junctions == other.junctions
        )

    def __hash__(self) -> int:
        return hash((tuple(self.segments.items()), tuple(junction.name for junction in self.junctions)))

    def __repr__(self) -> str:
        joints = ", ".join(f"{j.name}: {'+'.join(j.ends)}" for j in self.junctions)
        return f"Harness({len(self.segments)} segments ({', '.join(self.segments)}), junctions {joints or 'none'})"


def _remade(segments: Mapping[str, Cable], junctions: tuple[Junction, ...], imported: Imported | None) -> Harness:
    """What a copy of a harness is made by."""
    return Harness(segments, junctions, imported=imported)


def _check_segment(name: object, cable: object) -> None:
    """Refuses what cannot be a segment."""
    checks.word("segments", name)
    if "/" in str(name):
        raise ArgumentError.of("segments", name, "'/' is not allowed in a name: topics have it", "Rename it.")
    where = f"segments[{name!r}]"
    checks.instance(where, cable, (Cable,), "Write Cable(length=..., ...).")
    assert isinstance(cable, Cable)
    if cable.mean_bending_stiffness == 0.0:
        remedy = "Give EI in N m^2, however small it is."
        raise ArgumentError.of(f"{where}.bending_stiffness", 0.0, "a segment needs it above 0 N m^2", remedy)


def run_of(key: str, harness: Harness) -> tuple[str, ...]:
    """The segments that a key names: one, or several joined by "+"."""
    return (key,) if key in harness.segments else tuple(word.strip() for word in key.split("+"))
