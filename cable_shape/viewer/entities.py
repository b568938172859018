"""Cycle reports as rerun entities: :class:`ReportLogger`. Imports rerun: see recording.

=============================  ====================================================================================
/world/obstacles/NAME          obstacles of the scene, once and when they are edited
/world/robot/LINK              pose of a robot link; its solids lie below, once
/world/cables/NAME/line        the centreline, as thick as the cable, coloured by curvature or clearance
/world/cables/NAME/start, end  cable frames at the grips: d1 red, d2 green, d3 (the tangent) blue
/world/cables/NAME/tails/SIDE  what hangs beyond a grip
/world/cables/NAME/after_snap  the shape after a snap that is about to come
/world/cables/NAME/tube        the tube that holds the cable with the confidence asked for; below tails theirs
/world/cables/NAME/speed       how fast it moves, where that is known; in trail where it has just been
/world/cables/NAME/closest     the closest pair of points and their distance, of bodies that it may not touch
/world/cables/NAME/forces      of clips and of bodies that it rests on, on the cable
/world/cables/NAME/clips/K     clips, likewise; point masses in masses
/world/harnesses/NAME/J        its junctions; its segments are cables, in cables/NAME/SEGMENT
/world/markers                 markers that were measured on the real cable
/world/sockets/NAME            frames of the sockets, once
/margins/KIND                  how much of each limit is used now, as bars
/plots/...                     limits used [1], clearance, bend radius, markers' distances [mm], tension [N], time [ms]
/warnings, /state              what is wrong, and how each cable is, in words
=============================  ====================================================================================
"""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any, final

import numpy as np
import rerun as rr

from cable_shape.cable.cable import TAIL_SIDES, Cable
from cable_shape.cable.harness import Harness, split_end
from cable_shape.cable.pieces import radius_of, thicker
from cable_shape.checks import Array
from cable_shape.cycle.parts import cable_id, cables_of, in_parts
from cable_shape.pose import IDENTITY, FreeEnd, Grip, Pose
from cable_shape.prediction.layout import Layout
from cable_shape.safety.report import Clearance, CycleReport, Severity
from cable_shape.scene.scene import Obstacle, Scene
from cable_shape.shape import CableShape
from cable_shape.solve.harness_shape import junctions_of
from cable_shape.uncertainty.uncertainty import Tube
from cable_shape.viewer import colour as colours
from cable_shape.viewer import text
from cable_shape.viewer.bars import Bars
from cable_shape.viewer.blueprint import blueprint, eye
from cable_shape.viewer.columns import TIMELINE, Columns
from cable_shape.viewer.forces import Forces
from cable_shape.viewer.plots import Plots, part, path
from cable_shape.viewer.standing import Standing, shown, transform
from cable_shape.viewer.swing import Swing
from cable_shape.viewer.tubes import capsules

#: Stamps below this are the clock of a simulation, which begins near 0, and not a date. [ns], March 1973.
FIRST_DATE = 10**17
#: A cable is drawn with at most so many segments, however many points were asked for.
_WARNING_WIDTH = 52  # characters that the log has room for
MAX_SEGMENTS = 400

_LEVELS = {Severity.WARN: rr.TextLogLevel.WARN, Severity.ERROR: rr.TextLogLevel.ERROR, None: rr.TextLogLevel.INFO}


@final
class ReportLogger:
    """Writes cycle reports to a rerun recording; what does not move is written with the first report, and when edited.

    Parameters
    ----------
    recording : rerun.RecordingStream
        It must have a sink already (`save`, `connect_grpc`, ...).
    cables, scene
        As given to :class:`cable_shape.cycle.cycle.Cycle`.
    links : sequence of Obstacle
        ``Robot.link_geometry``: solids of the robot, each in the frame of its link.
    colour : str
        What colours the cable: "curvature" or "clearance".
    times : bool
        Whether to show how long things took. Without, the recording depends on the reports' content only.
    markers : bool
        Whether to plot how far measured markers are from the centreline.
    live : bool
        Whether the viewer follows the newest report, or plays the recording from its beginning.
    later : bool
        Whether all that moves waits until it is flushed, in columns, which takes a fraction of the time.
    """

    def __init__(
        self,
        recording: rr.RecordingStream,
        cables: Mapping[str, Cable | Harness],
        scene: Scene,
        links: Sequence[Obstacle] = (),
        *,
        colour: str = "curvature",
        times: bool = True,
        markers: bool = False,
        live: bool = False,
        later: bool = False,
    ) -> None:
        self.recording = recording
        self.cables = cables_of(cables)
        self.harnesses = {name: one for name, one in cables.items() if isinstance(one, Harness)}
        singles = {name: one for name, one in cables.items() if isinstance(one, Cable)}
        self.layout = Layout.of(scene, singles, {}, self.harnesses)
        self._meant = frozenset(allow.body for allow in scene.allow if allow.start is None and allow.end is None)
        self.links = tuple(links)
        self.colour = colours.check_colouring(colour)
        self.times = times
        self.markers = markers
        self.live = live
        self._plots = Plots(recording, self.cables, scene, times, later)
        self._columns = Columns(recording, later)
        self._bars = Bars(recording, self._columns)
        self._standing = Standing(self._columns)
        self._forces = {
            name: Forces(f"/world/cables/{path(name)}/forces", cable) for name, cable in self.cables.items()
        }
        self._swings = {name: Swing(f"/world/cables/{path(name)}") for name in self.cables}
        self._warnings = text.WarningLog()
        self._logged: dict[str, object] = {}  # entity -> what was written there last
        self._begun = False
        self._edited = True  # whether something stands elsewhere than it was drawn
        self._dates: bool | None = None  # whether stamps are dates; the first one tells
        # One time for each row: the stamp. The wall clock and a count would differ between two runs.
        recording.set_log_time_enabled(False)
        recording.set_log_tick_enabled(False)

    def log(self, report: CycleReport) -> None:
        """Writes one report at its stamp."""
        report = in_parts(report)
        if not self._begun:
            self._begin(report)
        self._at(report.stamp)
        if self._edited:
            self._edited = False
            self._standing.write(self.layout)
        for link, pose in (report.links or {}).items():
            self._move(f"/world/robot/{part(link)}", pose)
        for name, shape in report.shapes.items():
            base = f"/world/cables/{path(name)}"
            self._log_line(base, name, shape, report)
            start, end = report.grips.get(name, (None, None))
            self._log_grip(f"{base}/start", start, shape, 0, self.cables[name].diameter)
            self._log_grip(f"{base}/end", end, shape, -1, self.cables[name].diameter)
            for side in TAIL_SIDES:
                self._log_strip(f"{base}/tails/{side}", name, report.tails.get((name, side)), colours.TAIL)
                self._log_tube(f"{base}/tails/{side}/tube", name, report.tail_tubes.get((name, side)))
            self._log_strip(f"{base}/after_snap", name, report.after_snap.get(name), colours.GHOST)
            self._log_tube(f"{base}/tube", name, report.tubes.get(name))
            self._forces[name].write(shape, self._columns)
            self._swings[name].write(shape, self.cables[name].diameter, report.stamp, self._columns)
            self._log_closest(f"{base}/closest", report.clearance.get(name), shape)
            self._plots.shape(name, shape, report.clearance.get(name), self._meant)
            self._plots.margins(name, report.margins.get(name, ()))
        self._bars.margins(report.margins)
        for name, harness in self.harnesses.items():
            segments = {segment: report.shapes.get(cable_id(name, segment)) for segment in harness.segments}
            shapes = {segment: shape for segment, shape in segments.items() if shape is not None}
            if len(shapes) == len(segments):
                for junction, pose in junctions_of(harness, shapes).items():
                    self._move(_junction(name, junction), pose)
        self._log_words(report)

    def edited(self, layout: Layout) -> None:
        """Cables, clips and bodies are these from the next report on."""
        self.layout, self._edited = layout, True
        self.cables.update((name, laid.cable) for name, laid in layout.cables.items())
        for name, forces in self._forces.items():
            forces.cable = self.cables[name]

    @property
    def scene(self) -> Scene:
        """The bodies now, and the distances at which to warn."""
        return self.layout.scene

    def log_markers(self, points: Array, stamp: int | None = None) -> None:
        """Writes measured markers (k, 3) [m], world, at `stamp` [ns], by default that of the last report."""
        if stamp is not None:
            self._at(stamp)
        radius = 0.8 * max((cable.diameter for cable in self.cables.values()), default=0.01)
        self._write("/world/markers", rr.Points3D(points, radii=radius, colors=colours.MARKER))

    def log_distances(self, distances: Array, radii: Array | None, stamp: int) -> None:
        """Plots how far measured markers are from the centreline, see :meth:`Plots.markers`, at `stamp` [ns]."""
        self._at(stamp)
        self._plots.markers(distances, radii)

    def _write(self, entity: str, *what: Any, static: bool = False) -> None:
        if static:
            self.recording.log(entity, *what, static=True)
        else:
            self._columns.write(entity, *what)

    def _at(self, stamp: int) -> None:
        if self._dates is None:
            self._dates = stamp >= FIRST_DATE
        time = np.datetime64(stamp, "ns") if self._dates else np.timedelta64(stamp, "ns")
        self._columns.at(time)
        self._plots.at(time)

    def flush(self) -> None:
        """Writes what waits."""
        self._columns.flush()
        self._plots.flush()

    def _changed(self, entity: str, what: object) -> bool:
        """Whether `what` differs from what was written to the entity last."""
        if self._logged.get(entity) == what:
            return False
        self._logged[entity] = what
        return True

    def _begin(self, report: CycleReport) -> None:
        """Everything that is written once."""
        self._begun = True
        bodies = bool(self.scene.obstacles or self.links)
        layout = blueprint(
            tuple(self.cables), eye(report, self.scene), TIMELINE, bodies=bodies, times=self.times, live=self.live,
            markers=self.markers,
        )  # fmt: skip
        self.recording.send_blueprint(layout)
        self._write("/world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        for body in self.links:
            entity = f"/world/robot/{part(body.link or '')}/{part(body.name)}"
            self._write(entity, transform(body.pose), shown(body.solid, colours.ROBOT), static=True)
        for name, pose in self.scene.sockets.items():
            axes = rr.Arrows3D(vectors=0.04 * np.eye(3), colors=colours.AXES, radii=0.0015)
            self._write(f"/world/sockets/{part(name)}", transform(pose), axes, static=True)
        for name, harness in self.harnesses.items():
            for junction in harness.junctions:
                widest = max(harness.segments[split_end(end)[0]].diameter for end in junction.ends)
                ball = rr.Points3D([(0.0, 0.0, 0.0)], radii=0.9 * widest, colors=colours.JUNCTION)
                self._write(_junction(name, junction.name), ball, static=True)
        self._plots.begin(self.markers)
        self._bars.begin()

    def _move(self, entity: str, pose: Pose) -> None:
        if self._changed(entity, pose.array.tobytes()):
            self._columns.put(entity, rr.Transform3D, translation=pose.position[None], quaternion=pose.quaternion[None])

    def _log_line(self, base: str, name: str, shape: CableShape, report: CycleReport) -> None:
        """The cable in short straight strips, each in its own colour, and the masses it carries."""
        cable = self.cables[name]
        if not shape.status:
            colour = np.tile(np.array(colours.UNUSABLE, dtype=np.uint8), (shape.points, 1))
        elif self.colour == "curvature":
            colour = colours.scale(colours.by_curvature(cable, shape))
        else:
            colour = colours.scale(colours.by_clearance(cable, shape, self.scene, self.links, report.links))
        drawn = _shown(shape.points)
        points = shape.positions[drawn].astype(np.float32)
        line = np.stack((points[:-1], points[1:]), axis=1)
        arc, radius = shape.arc_length, 0.5 * cable.diameter
        more = thicker(cable, 0.5 * (arc[drawn[:-1]] + arc[drawn[1:]]))
        radii = np.array([radius]) if more is None else radius_of(cable) + more
        self._columns.put(f"{base}/line", rr.LineStrips3D, strips=line, colors=colour[drawn[:-1]], radii=radii)
        masses = self.layout.cables[name].masses
        if masses:
            at = np.array([mass.arc_length for mass in masses])
            places = np.stack([np.interp(at, shape.arc_length, shape.positions[:, i]) for i in range(3)], axis=1)
            self._write(f"{base}/masses", rr.Points3D(places, radii=1.6 * radius, colors=colours.UNUSABLE))

    def _log_strip(self, entity: str, name: str, shape: CableShape | None, colour: colours.Colour) -> None:
        """A line in one colour, which goes away when there is none."""
        if shape is None:
            if self._logged.get(entity) is not None:
                self._write(entity, rr.Clear(recursive=True))
            self._logged[entity] = None
            return
        self._logged[entity] = shape
        radius = 0.5 * self.cables[name].diameter
        points = shape.positions.astype(np.float32)
        self._write(entity, rr.LineStrips3D([points], colors=colour, radii=radius))

    def _log_tube(self, entity: str, name: str, tube: Tube | None) -> None:
        """Capsules about the cable, wide as it and its tube together, which go away when there is none."""
        if tube is None:
            if self._logged.get(entity) is not None:
                self._write(entity, rr.Clear(recursive=True))
            self._logged[entity] = None
            return
        self._logged[entity] = tube
        self._write(entity, capsules(tube, self.cables[name].diameter))

    def _log_grip(
        self, entity: str, end: Pose | Grip | FreeEnd | None, shape: CableShape, index: int, diameter: float
    ) -> None:
        """The cable frame at a grip: three axes if clamped, the tangent if swivelling, a ball if pinned, or a plug."""
        loaded = isinstance(end, FreeEnd) and end.mass > 0.0
        kind = end.kind if isinstance(end, Grip) else "clamped" if isinstance(end, Pose) else f"free {loaded}"
        if self._changed(f"{entity}/kind", kind):
            # The axes reach well out of the cable, yet not beyond what a hand would hold.
            reach = float(np.clip(0.07 * shape.length, 0.03, 0.12))
            seen = {"clamped": (0, 1, 2), "swivel": (2,)}.get(kind, ())
            axes = rr.Arrows3D(
                vectors=[reach * np.eye(3)[i] for i in seen],
                colors=[colours.AXES[i] for i in seen],
                radii=0.045 * reach,
            )
            size = 1.2 * diameter if loaded else 0.12 * reach
            ball = rr.Points3D([(0.0, 0.0, 0.0)], radii=size, colors=colours.ROBOT)
            self._write(f"{entity}/axes", axes)
            held = loaded or not kind.startswith("free")
            self._write(f"{entity}/ball", ball if held else rr.Clear(recursive=False))
        frame = end.cable_frame if isinstance(end, Grip) else end if isinstance(end, Pose) else None
        if frame is None:
            frame = Pose(shape.positions[index], IDENTITY.quaternion)
        self._move(entity, frame)

    def _log_closest(self, entity: str, clearance: Clearance | None, shape: CableShape) -> None:
        resting = {contact.body for contact in shape.contacts} | self._meant
        apart = [] if clearance is None else [body for body in clearance.bodies if body.body not in resting]
        closest = min(apart, key=lambda body: body.distance, default=None)
        if closest is None:
            if self._changed(entity, None):
                self._write(entity, rr.Clear(recursive=True))
            return
        self._logged[entity] = closest
        pair = np.array([closest.point_on_cable, closest.point_on_body])
        colour = np.array([colours.of_distance(closest.distance, self.scene)], dtype=np.uint8)
        label = f"{closest.body}  {text.millimetres(closest.distance)}"
        radius = np.clip([0.002 * shape.length], 0.001, 0.004)
        self._columns.put(
            f"{entity}/line", rr.LineStrips3D, strips=pair[None], colors=colour, radii=radius, labels=[label],
            show_labels=[True],
        )  # fmt: skip
        self._columns.put(f"{entity}/points", rr.Points3D, positions=pair, colors=colour, radii=2.5 * radius)

    def _log_words(self, report: CycleReport) -> None:
        for severity, said in self._warnings.changes(report.warnings):
            for line in textwrap.wrap(said, _WARNING_WIDTH):  # a row of the log shows one
                self._write("/warnings", rr.TextLog(line, level=_LEVELS[severity]))
        legend = f"Colour: {_LEGENDS[self.colour]}"
        page = text.state(report, legend)
        self._columns.put("/state", rr.TextDocument, text=[page], media_type=["text/markdown"])
        if self.times and "total" in report.times:
            self._plots.times(report.times["total"], report.times.get("predict", 0.0))


_LEGENDS = {
    "curvature": "bending, from straight (blue) to the smallest bend radius (red).",
    "clearance": "clearance, from ample (blue) to the error distance (red).",
}


@lru_cache
def _shown(points: int) -> np.ndarray[Any, np.dtype[np.int64]]:
    """Which points of a cable are drawn."""
    return np.unique(np.linspace(0, points - 1, min(points, MAX_SEGMENTS + 1)).round().astype(np.int64))


def _junction(harness: str, junction: str) -> str:
    return f"/world/harnesses/{part(harness)}/{part(junction)}"
