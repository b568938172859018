"""What a file of another program gives: :class:`Imported`, beside the harness or cable itself."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import final

from cable_shape.cable.centreline import Centreline
from cable_shape.pose import FreeEnd, Grip
from cable_shape.scene.scene_parts import Clip, PointMass


@final
@dataclass(frozen=True, slots=True, eq=False)
class Imported:
    """What holds and loads an imported harness, where it was drawn, and what was made of the file.

    Attributes
    ----------
    source : str, the file's name and its format
    clips : tuple of Clip, of the fixings, in the order of the file; their poses are those of the drawn curve
    masses : tuple of PointMass
    ends : mapping of open end to FreeEnd with its connector's mass, or to the Grip that holds what no fixing does
    drawn : mapping of segment to the Centreline that it was drawn along
    labels : mapping of an open end or a junction's name to what is there, in the file's words
    wire_mass : float [kg], of the wires, as far as the file states their mass
    merged, derived, left_out, remarks : tuples of str, what became of the rest
    """

    source: str
    clips: tuple[Clip, ...] = ()
    masses: tuple[PointMass, ...] = ()
    ends: Mapping[str, Grip | FreeEnd] = field(default_factory=dict)
    drawn: Mapping[str, Centreline] = field(default_factory=dict)
    labels: Mapping[str, str] = field(default_factory=dict)
    wire_mass: float = 0.0
    merged: tuple[str, ...] = ()
    derived: tuple[str, ...] = ()
    left_out: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()
