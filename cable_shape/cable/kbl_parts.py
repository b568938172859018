"""What a KBL file says, in SI units: :class:`KblFile`. No mechanics, and nothing made up."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import final

from cable_shape.checks import Array


@final
@dataclass(slots=True)
class Strand:
    """A wire, or a whole multi-core cable, as it lies in a segment: figures of one."""

    part: str
    cores: int  # that are routed here
    mass: float | None  # [kg/m]
    diameter: float | None  # [m]
    area: float | None  # [m^2], of the conductor
    bend_radius: float | None  # [m], the smallest allowed


@final
@dataclass(slots=True)
class Fixing:
    """What holds a segment: at `location`, a fraction of it."""

    id: str
    location: float
    kind: str
    placement: Array | None  # (3,) [m], of the part itself


@final
@dataclass(slots=True)
class Protection:
    """A tape or a tube about a segment, between two fractions of it."""

    id: str
    kind: str
    start: float
    end: float
    mass: float | None  # [kg/m]


@final
@dataclass(slots=True)
class KblSegment:
    """A bundle between two nodes."""

    id: str
    name: str
    start: str
    end: str
    physical: float | None  # [m]
    virtual: float | None  # [m]
    curves: list[tuple[int, Array]]  # degree, and control points (n, 3) [m]
    area: float | None  # [m^2]
    fixings: list[Fixing] = field(default_factory=list)
    protections: list[Protection] = field(default_factory=list)
    strands: list[Strand] = field(default_factory=list)


@final
@dataclass(slots=True)
class KblNode:
    """Where segments meet or end."""

    id: str
    name: str
    position: Array  # (3,) [m]
    parts: list[tuple[str, float | None]]  # connectors and the like by name, with what is in them [kg]


@final
@dataclass(slots=True)
class KblFile:
    """Everything of a file that a harness is made of; `notes`: what was found odd, or left out."""

    name: str
    version: str
    nodes: dict[str, KblNode]
    segments: dict[str, KblSegment]
    unplaced: list[str]  # fixings on no segment
    routings: int
    notes: list[str] = field(default_factory=list)
