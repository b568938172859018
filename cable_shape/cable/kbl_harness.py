"""From what a KBL file says to a harness: :func:`from_kbl`.

Segments and nodes keep the ids of the file. A segment's rest shape is the curve it was drawn along; ends in a node keep
the frames that they were drawn with. Stiffness, and what else the file does not state, is derived
(:mod:`cable_shape.cable.bundle`) and said to be.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from itertools import pairwise
from pathlib import Path
from typing import Any, final

import numpy as np

from cable_shape import checks
from cable_shape.cable.bundle import Bundle, bundle_of, covered
from cable_shape.cable.cable import Cable
from cable_shape.cable.centreline import Centreline, rest_shape
from cable_shape.cable.imported import Imported
from cable_shape.cable.junction import Junction
from cable_shape.cable.kbl_curves import drawn, straight
from cable_shape.cable.kbl_parts import KblFile, KblSegment
from cable_shape.cable.kbl_read import read_kbl
from cable_shape.cable.section import Section
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError, FileError
from cable_shape.pose import FreeEnd, Grip, Pose
from cable_shape.scene.scene_parts import CLIP_KINDS, Clip

#: By how much a rest shape may miss the drawn curve, as a share of the length.
TOLERANCE, SMOOTHED, NOTED = 1e-4, 2e-3, 1e-3
#: Bends tighter than a bundle is thick are smoothed; where it then misses more than SMOOTHED, to this share.
LEAST_APART = 0.125
HOLDS = ("fixings", "connectors")
#: A chord that is longer than its segment by this share is a slip of units, not of a designer.
FAR_TOO_LONG = 2.0
#: Clips nearer than this share of the segment to one another, or to an end, cannot both hold it.
APART = 1e-6


def from_kbl(
    make: Callable[..., Any],
    path: str | Path,
    merge_below: float = 0.0,
    clip_kind: str = "ball",
    hold: str = "fixings",
    bar: Callable[[Iterable[Any]], Iterable[Any]] = iter,
) -> Any:
    """The harness of a KBL file, see :meth:`cable_shape.Harness.from_kbl`.

    Parameters
    ----------
    make : Harness
    path : of a KBL file, 2.3 to 2.5
    merge_below : float [m]; nodes that are joined by a segment shorter than this become one, 0: none
    clip_kind : "ball", "hinge" or "fixed", what the fixings are
    hold : "fixings": only what fewer than two fixings hold is held at its connectors, too; "connectors": all is

    Raises
    ------
    FileError, ArgumentError
        Naming the part, the bound and the remedy.
    """
    shortest = checks.number("merge_below", merge_below, at_least=0.0, unit="m")
    checks.one_of("clip_kind", clip_kind, [kind for kind in CLIP_KINDS if kind != "slide"])
    checks.one_of("hold", hold, HOLDS)
    return _Builder(read_kbl(path), str(path), shortest, clip_kind).made(make, hold, bar)


@final
class _Builder:
    """Makes the parts of one harness."""

    def __init__(self, file: KblFile, where: str, merge_below: float, clip_kind: str) -> None:
        self.file, self.where, self.merge_below, self.clip_kind = file, where, merge_below, clip_kind
        self.lines: dict[str, Centreline] = {}
        self.lengths: dict[str, float] = {}
        self.cables: dict[str, Cable] = {}
        self.ends: dict[str, Pose] = {}  # where rest shapes end, whose frames differ a little from the drawn ones
        self.clips: list[Clip] = []
        self.derived: Counter[str] = Counter()
        self.merged: list[str] = []
        self.left_out: list[str] = list(file.notes)
        self.remarks: list[str] = []
        self.wire_mass = 0.0
        self.masses: dict[str, float] = {}  # [kg], at nodes
        self.node_of: dict[str, str] = {name: name for name in file.nodes}

    def made(self, make: Callable[..., Any], hold: str, bar: Callable[[Iterable[Any]], Iterable[Any]]) -> Any:
        """The harness, and what goes with it."""
        for name, node in self.file.nodes.items():
            self.masses[name] = sum(mass or 0.0 for _, mass in node.parts)
            unknown = [part for part, mass in node.parts if mass is None]
            if unknown:
                self.left_out.append(f"node {name}: no mass is stated for {', '.join(unknown)}; taken as 0")
        for segment in bar(self.file.segments.values()):
            self.segment(segment)
        self.merge()
        for name in self.cables:
            self.hold(self.file.segments[name])
        for name in self.file.unplaced:
            self.left_out.append(f"fixing {name}: it lies on no segment")
        harness = make(self.cables, self.junctions())
        return make(harness.segments, harness.junctions, imported=self.told(harness, hold))

    # -- segments

    def segment(self, segment: KblSegment) -> None:
        """The cable of a segment."""
        name = segment.id
        if "/" in name or not name.strip():
            raise FileError(f"{self.where}: Segment {name}: '/' is not allowed in an id: topics have it. Rename it.")
        a, b = (self.file.nodes[node].position for node in (segment.start, segment.end))
        line, odd = drawn(segment, a, b)
        chord = float(np.linalg.norm(b - a))
        if line is None:
            if chord <= 1e-6:
                raise FileError(
                    f"{self.where}: Segment {name}: {odd}, and its nodes are in one place. Give it a Center_curve."
                )
            line = straight(a, b)
        length = segment.physical or segment.virtual or line.length
        if chord > FAR_TOO_LONG * length:
            raise FileError(
                f"{self.where}: Segment {name}: its nodes are {chord:.4g} m apart, its length is {length:.4g} m. "
                "Correct the unit of its length, or the coordinates, which are in mm."
            )
        if odd:
            self.remarks.append(f"segment {name}: {odd}: it is taken as straight" if "no" in odd else f"{name}: {odd}")
        if abs(line.length - length) > 1e-3 * length:
            self.remarks.append(f"segment {name}: {line.length:.4f} m long as drawn, {length:.4f} m as stated")
        bundle = bundle_of(segment.strands, segment.area)
        self.derived.update(bundle.derived)
        self.wire_mass += bundle.stated * length
        self.lines[name], self.lengths[name] = line, length
        self.cables[name] = self.cable(segment, bundle, line, length)

    def cable(self, segment: KblSegment, bundle: Bundle, line: Centreline, length: float) -> Cable:
        """Of its wires and protections, bent as it was drawn."""
        rest, missed = line.rest_curvature(TOLERANCE, bundle.diameter)
        if missed > SMOOTHED * line.length:
            rest, missed = line.rest_curvature(SMOOTHED, LEAST_APART * bundle.diameter)
        self.ends[segment.id] = Pose(line.end.position, rest_shape(rest, line.length, line.start)[1][-1])
        rest *= line.length / length
        if missed > NOTED * line.length:
            told = (
                f"drawn with bends as tight as a part of its thickness: smoothed, and {1e3 * missed:.2g} mm beside it"
            )
            self.remarks.append(f"segment {segment.id}: {told}")
        if not np.abs(rest).max() * length > 1e-9:
            rest = np.zeros(3)
        try:
            return Cable(
                length, bundle.linear_density, bundle.stiffness[0], axial_stiffness=bundle.pull, rest_curvature=rest,
                diameter=bundle.diameter,
                min_bend_radius=bundle.bend_radius, stiffness_interval=bundle.stiffness,
                sections=self.sections(segment, bundle, length),
            )  # fmt: skip
        except ArgumentError as error:
            raise FileError(f"{self.where}: Segment {segment.id}: {error}") from None

    def sections(self, segment: KblSegment, bundle: Bundle, length: float) -> list[Section]:
        """Where it is protected: between all bounds of its protections, what covers it there together."""
        at = sorted({bound for one in segment.protections for bound in (one.start, one.end)})
        out = []
        for a, b in pairwise(at):
            covers = [one for one in segment.protections if one.start <= a and one.end >= b]
            if not covers or (b - a) * length < 1e-6:
                continue
            density, stiffness, diameter = bundle.linear_density, bundle.stiffness[0], bundle.diameter
            for one in covers:
                if one.mass is None:
                    self.derived["protections without a mass per length weigh and stiffen nothing"] += 1
                    continue
                more, diameter = covered(diameter, one.mass)
                density, stiffness = density + one.mass, stiffness + more
            out.append(
                Section(a * length, b * length, linear_density=density, bending_stiffness=stiffness, diameter=diameter)
            )
        return out

    # -- nodes

    def merge(self) -> None:
        """Joins nodes that a short segment joins; what it weighs is then at the node."""
        for name, length in self.lengths.items():
            if length >= self.merge_below:
                continue
            segment = self.file.segments[name]
            kept, gone = self.node_of[segment.start], self.node_of[segment.end]
            cable = self.cables.pop(name)
            self.masses[kept] += cable.linear_density * length + (self.masses[gone] if gone != kept else 0.0)
            for node, where in self.node_of.items():
                if where == gone:
                    self.node_of[node] = kept
            self.merged.append(
                f"segment {name}, {1e3 * length:.4g} mm: nodes {segment.start} and {segment.end} are one"
            )
            for one in segment.fixings:
                self.left_out.append(f"fixing {one.id}: it lies on segment {name}, which is merged")
        if not self.cables:
            raise ArgumentError.of(
                "merge_below", self.merge_below, "every segment is shorter", "Merge shorter ones only."
            )

    def at_nodes(self) -> dict[str, list[str]]:
        """The ends of segments at each node."""
        out: dict[str, list[str]] = {name: [] for name in self.file.nodes}
        for name in self.cables:
            segment = self.file.segments[name]
            out[self.node_of[segment.start]].append(f"{name}.start")
            out[self.node_of[segment.end]].append(f"{name}.end")
        return out

    def junctions(self) -> list[Junction]:
        """Where two or more segments meet, with the world's axes for a frame as it was drawn."""
        out = []
        for node, ends in self.at_nodes().items():
            if len(ends) == 1 or not ends:
                if not ends and self.node_of[node] == node:
                    self.left_out.append(f"node {node}: no segment ends there")
                continue
            middle = self.file.nodes[node].position
            frames = {end: self.frame(end, middle) for end in ends}
            out.append(Junction(node, ends, frames=frames, mass=self.masses[node]))
        return out

    def frame(self, end: str, middle: Array) -> Pose:
        """Of an end in its junction: as drawn; beside the origin only where nodes were merged."""
        pose = self.pose(end)
        name, side = end.rsplit(".", 1)
        segment = self.file.segments[name]
        node = segment.start if side == "start" else segment.end
        if self.node_of[node] == node:
            return Pose(quaternion=pose.quaternion)
        return Pose(self.file.nodes[node].position - middle, pose.quaternion)

    def pose(self, end: str) -> Pose:
        """The frame of an end of the rest shape, which begins as it was drawn."""
        name, side = end.rsplit(".", 1)
        return self.lines[name].start if side == "start" else self.ends[name]

    def drawn_pose(self, end: str) -> Pose:
        """The frame of an end of the drawn curve."""
        name, side = end.rsplit(".", 1)
        return self.lines[name].start if side == "start" else self.lines[name].end

    # -- what holds it

    def hold(self, segment: KblSegment) -> None:
        """The clips of a segment's fixings, in their order along it."""
        line, length = self.lines[segment.id], self.lengths[segment.id]
        before = 0.0
        for one in sorted(segment.fixings, key=lambda fixing: fixing.location):
            at = one.location * length
            if not before + APART * length < at < length * (1.0 - APART):
                self.left_out.append(f"fixing {one.id}: on segment {segment.id} it is at a node, or at another fixing")
                continue
            before = at
            self.clips.append(Clip(at, line.poses([one.location * line.length])[0], self.clip_kind, one.id, segment.id))
            if one.placement is not None:
                off = float(np.linalg.norm(one.placement - self.clips[-1].pose.position))
                if off > 0.05:
                    self.remarks.append(f"fixing {one.id}: its part is {1e3 * off:.0f} mm off segment {segment.id}")

    def told(self, harness: Any, hold: str) -> Imported:
        """Clips by unique names, ends with their connectors, and all that was done."""
        times = Counter(clip.name for clip in self.clips)
        seen: Counter[str] = Counter()
        clips = []
        for clip in self.clips:
            name = f"{clip.name}@{clip.segment}" if times[clip.name] > 1 else str(clip.name)
            seen[name] += 1
            name = name if seen[name] == 1 else f"{name}#{seen[name]}"
            clips.append(Clip(clip.arc_length, clip.pose, clip.kind, name, clip.segment))
        at_nodes = self.at_nodes()
        node_at = {ends[0]: node for node, ends in at_nodes.items() if len(ends) == 1}
        held = [clip.segment for clip in clips]
        ends: dict[str, Grip | FreeEnd] = {}
        for part in harness.parts():
            open_ends = [end for end in harness.open_ends if end.rsplit(".", 1)[0] in part]
            plugged = [end for end in open_ends if self.file.nodes[node_at[end]].parts]
            for end in open_ends:
                ends[end] = FreeEnd(mass=self.masses[node_at[end]])
            fixings = sum(segment in part for segment in held)
            if hold == "connectors" or fixings < 2:  # by one it would turn freely
                for end in plugged or open_ends:
                    ends[end] = Grip(self.drawn_pose(end))
                if hold != "connectors":
                    what = "connectors" if plugged else "open ends"
                    told = f"{fixings or 'no'} fixing holds {min(part)} and what hangs on it"
                    self.remarks.append(f"{told}: held at its {what}, too, as drawn")
        labels: dict[str, str] = {}
        for node, there in at_nodes.items():
            parts = ", ".join(name for name, _ in self.file.nodes[node].parts)
            if parts and there:
                labels[there[0] if len(there) == 1 else node] = parts
        self.derived["bending stiffness of every segment, between slip and stick; slip is taken"] = len(self.cables)
        self.derived["diameters, of the bundles' areas"] = sum(
            self.file.segments[name].area is not None for name in self.cables
        )
        self.derived["diameters, of the wires'"] = sum(self.file.segments[name].area is None for name in self.cables)
        self.derived["stiffness and thickness of protections, of their mass"] = sum(
            len(cable.sections) for cable in self.cables.values()
        )
        return Imported(
            f"{self.file.name}, KBL {self.file.version}", tuple(clips), (), ends, self.lines, labels, self.wire_mass,
            tuple(self.merged), tuple(f"{what} ({count})" for what, count in self.derived.items() if count),
            tuple(self.left_out), tuple(self.remarks),
        )  # fmt: skip
