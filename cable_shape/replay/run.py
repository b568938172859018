"""A recording in; a recording, a .rrd, a table and a report out, without middleware: :func:`replay`.

Every pair of gripper poses (or joint state) goes through the same :class:`~cable_shape.cycle.cycle.Cycle` as in the
node. Two runs give the same bytes of replay.mcap and the same decoded columns of replay.rrd; only times differ, and
these are in the report alone.
"""

from __future__ import annotations

import contextlib
import gc
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any, final

from cable_shape.checks import Array
from cable_shape.cycle.cycle import Cycle
from cable_shape.cycle.parts import in_parts
from cable_shape.errors import ArgumentError, BagError
from cable_shape.messages.pairing import SECOND
from cable_shape.pose import Grip, Pose
from cable_shape.replay.bags import Bag
from cable_shape.replay.carried import carried
from cable_shape.replay.edits import RecordedEdits
from cable_shape.replay.inertia import Inertia
from cable_shape.replay.inputs import (
    JOINTS_TYPE,
    MARKERS_TYPE,
    POSE_TYPE,
    JointSource,
    PoseSource,
    Refusals,
    Sample,
    Source,
    other_frame,
    positions_of,
    stamp_of,
)
from cable_shape.replay.markers import MarkerComparison
from cable_shape.replay.outcome import Outcome
from cable_shape.replay.report import write_report
from cable_shape.replay.settings import Settings
from cable_shape.replay.sinks import Sinks
from cable_shape.replay.tally import Tally
from cable_shape.replay.transform_input import TRANSFORM_TYPE, TransformSource
from cable_shape.robots.on_links import check_links

Progress = Callable[[Iterable[Any], int], Iterable[Any]]

_SELDOM = 50_000, 20, 50  #: how many objects come before garbage is looked for, and so on, see `gc.set_threshold`


@contextlib.contextmanager
def _settled() -> Iterator[None]:
    """Meanwhile what is there already stays, and what comes is seldom garbage: nobody looks again and again."""
    often, frozen = gc.get_threshold(), gc.get_freeze_count()
    gc.set_threshold(*_SELDOM)
    if not frozen:  # else somebody has seen to that
        gc.freeze()
    try:
        yield
    finally:
        gc.set_threshold(*often)
        if not frozen:
            gc.unfreeze()


def replay(bag: str | Path, out: str | Path, settings: Settings, progress: Progress | None = None) -> Outcome:
    """Replays a recording and writes OUT/replay/, OUT/replay.rrd and OUT/report.md, .json and .png.

    Parameters
    ----------
    bag : path
        A rosbag2 folder, or a single .mcap or .db3 file; a damaged one is replayed as far as it can be read.
    out : path
        A folder, made if missing; outputs of an earlier replay in it are replaced.
    settings : Settings
    progress : callable, optional
        Wraps the iterable of messages, given with their number; a progress bar.

    Raises
    ------
    BagError
        If the recording cannot be read, lacks the topics, or holds nothing from which a cycle can be run.
    """
    folder = _output_folder(Path(out), Path(bag))
    with Bag(bag) as opened:
        outcome = _Run(opened, folder, settings).run(progress or _silent)
    write_report(outcome, folder)
    return outcome


def _silent(messages: Iterable[Any], count: int) -> Iterable[Any]:
    return messages


def _output_folder(out: Path, bag: Path) -> Path:
    """`out` as a folder; never the place of the input."""
    out = out.expanduser()
    if out.exists() and not out.is_dir():
        raise ArgumentError(f"OUT = {str(out)!r} is a file. Give a folder.")
    if (out / "replay").resolve() in (bag.expanduser().resolve(), bag.expanduser().resolve().parent):
        raise ArgumentError(
            f"OUT = {str(out)!r} is not allowed: its replay/ is the recording itself. Give another folder."
        )
    out.mkdir(parents=True, exist_ok=True)
    for name in ("replay.rrd", "report.md", "report.json", "report.png"):
        (out / name).unlink(missing_ok=True)
    return out


@final
class _Run:
    """One walk through a recording."""

    def __init__(self, bag: Bag, out: Path, settings: Settings) -> None:
        self.bag = bag
        self.out = out
        self.settings = settings
        self.refusals = Refusals()
        self.carried = carried(settings)
        self.source, self.source_name = self._source(self.refusals)
        self.tally = Tally()
        self.edits: RecordedEdits | None = None
        if RecordedEdits.in_bag(bag, settings.edits_topic):
            self.edits = RecordedEdits(bag.path, settings.edits_topic, self._source(Refusals())[0])
        skew = round(settings.max_skew * SECOND)
        marked = self.marked = self.carried.marked
        self.inertia: Inertia | None = None
        self.markers: MarkerComparison | None = None
        if marked is not None:
            self.markers = MarkerComparison(marked.length, skew, self._compared, marked.runs)
            if settings.inertia:
                self.inertia = Inertia(bag.path, settings.markers_topic, skew, marked.along)
        has_markers = marked is not None and bag.types.get(settings.markers_topic) == MARKERS_TYPE
        self.topics = (*self.source.topics, *((settings.markers_topic,) if has_markers else ()))
        robot = settings.robot if self.source_name == "joints" else None
        check_links(robot, settings.scene)
        self.links = () if robot is None else robot.link_geometry
        self.cycle = Cycle(
            {self.carried.name: self.carried.what},
            scene=settings.scene,
            robot_links=self.links,
            gripping_links=() if robot is None else robot.gripping_links,
            model=settings.model,
            gravity=settings.gravity,
            points=settings.points,
            tolerance=settings.tolerance,
            uncertainty=settings.uncertainty,
            motion=settings.motion,
        )
        self.sinks = Sinks(out, settings)

    def run(self, progress: Progress) -> Outcome:
        """All messages of the recording."""
        from cable_shape.warm_up import warm_up_cycles, warm_up_harnesses

        total = sum(self.bag.counts.get(topic, 0) for topic in self.topics)
        has_markers = self.settings.markers_topic in self.topics
        with self.sinks, _settled():
            warm_up_cycles(self.settings.model)
            if self.settings.harness is not None:
                warm_up_harnesses()
            for topic, _, message in progress(self.bag.messages(self.topics), total):
                if topic == self.settings.markers_topic:
                    self._take_markers(topic, message)
                    continue
                sample = self.source.feed(topic, message)
                if self.source.restarted:
                    self._restart()
                if sample is None:
                    continue
                if not self.tally.cycles:
                    self._check_frames()
                    self.sinks.begin(self.carried, self.links, has_markers)
                self._take(sample)
            self._make_edits(None)
            self.source.finish()
            if self.markers is not None:
                self.markers.finish()
        if not self.tally.cycles:
            raise BagError(self._nothing())
        return self._outcome()

    def _take(self, sample: Sample) -> None:
        """One cycle."""
        self._make_edits(sample.stamp)
        moving = None if self.inertia is None else self.inertia.at(sample.stamp, self.tally.restarts)
        name, loads = self.carried.name, None
        if moving is not None:
            assert self.marked is not None
            loads = {name: self.marked.loads(list(moving))}
        report = self.cycle.step({name: sample.ends}, sample.stamp, sample.links, acceleration=loads)  # type: ignore[arg-type]
        parts = in_parts(report)
        self.tally.add(parts)
        if self.markers is not None and self.marked is not None:
            self.markers.add_shape(sample.stamp, self.marked.lines(report), self.marked.radii(report))
        self.sinks.write(parts, self.source.frame_id or "")

    def _make_edits(self, stamp: int | None) -> None:
        """Repeats what was edited before the cycle of `stamp` [ns], or before the clock is set back."""
        for message in () if self.edits is None else self.edits.make(self.cycle, self.tally.restarts, stamp):
            if stamp is not None:
                self.sinks.edited(message, self.cycle, stamp, self.source.frame_id or "")

    def _take_markers(self, topic: str, message: Any) -> None:
        frame, expected = message.header.frame_id, self.source.frame_id
        if expected is not None and frame != expected:
            self.refusals.add(topic, "other frame", other_frame(topic, frame, expected))
            return
        stamp, points = stamp_of(message), positions_of(message.poses)
        assert self.markers is not None
        assert self.marked is not None
        if self.marked.count not in (None, len(points)):
            told = f"{len(points)} markers came, the harness's file tells of {self.marked.count}"
            self.refusals.add(topic, "other number", told)
            return
        self.markers.add_markers(stamp, points)
        self.sinks.log_markers(points, stamp)

    def _compared(self, stamp: int, distances: Array, radii: Array | None) -> None:
        """A frame of markers was compared with its shape."""
        self.sinks.log_distances(distances, radii, stamp)

    def _check_frames(self) -> None:
        """Accelerations load the cable in the frame of its grips."""
        if self.inertia is not None and self.inertia.frame_id != self.source.frame_id:
            raise BagError(
                f"{self.bag.path}: --inertia: the markers are in frame {self.inertia.frame_id!r}, the grips in "
                f"{self.source.frame_id!r}. Frames are not transformed here; record both in one."
            )

    def _restart(self) -> None:
        """The clock was set back: what follows has nothing to do with what was before."""
        self._make_edits(None)
        self.cycle.reset()
        if self.markers is not None:
            self.markers.finish()
        self.tally.restarts += 1

    def _outcome(self) -> Outcome:
        read, counts = self.bag.read, self.bag.counts
        topics = {topic: (read[topic], counts.get(topic)) for topic in self.topics}
        if self.edits is not None:
            topics[self.edits.topic] = self.edits.read, counts.get(self.edits.topic)
        return Outcome(
            settings=self.settings,
            bag=self.bag.path,
            source=self.source_name,
            frame_id=self.source.frame_id or "",
            topics=topics,
            tally=self.tally,
            refusals=self.refusals,
            unpaired=self.source.unpaired,
            markers=self.markers,
            inertia=self.inertia,
            problems=(*self.bag.problems, *(() if self.edits is None else self.edits.problems)),
            edits=0 if self.edits is None else self.edits.done,
            notes=tuple(self.bag.notes),
        )

    def _source(self, refusals: Refusals) -> tuple[Source, str]:
        """Where the grips come from, by the settings and by what was recorded."""
        settings, types = self.settings, self.bag.types
        grips = self.carried.topics
        joints = settings.joints_topic in types
        chosen = settings.input
        if chosen == "auto":
            use_joints = joints and (settings.robot is not None or not any(topic in types for topic in grips))
            chosen = "tf" if settings.left_frame else "joints" if use_joints else "poses"
        if chosen == "poses":
            for topic in grips:
                self._require(topic, POSE_TYPE)
            return PoseSource(self.carried, settings.max_skew, refusals), chosen
        if chosen == "tf":
            self.carried.held([Grip(Pose())] * 2)  # as many as there are frames
            static = f"{settings.tf_topic}_static"
            for topic in (settings.tf_topic, *((static,) if static in types else ())):
                self._require(topic, TRANSFORM_TYPE)
            frames, more = (settings.left_frame, settings.right_frame), (settings.max_skew, refusals)
            return TransformSource(settings.tf_topic, frames, settings.frame_id, self.carried, *more), chosen
        self._require(settings.joints_topic, JOINTS_TYPE)
        if settings.robot is None:
            raise BagError(
                f"{self.bag.path} holds joint states on {settings.joints_topic}, which need a robot. "
                "Give --robot ROBOT.yaml (urdf, grippers)."
            )
        self.carried.held(settings.robot.grips(settings.robot.home))  # as many as there are
        return JointSource(settings.joints_topic, settings.robot, self.carried, refusals), chosen

    def _require(self, topic: str, kind: str) -> None:
        """The topic must have been recorded, as messages of this type."""
        types = self.bag.types
        found = ", ".join(f"{name} ({types[name]})" for name in sorted(types)) or "none"
        options = (
            f"Needed: {' and '.join(self.carried.topics)} ({POSE_TYPE}), or "
            f"{self.settings.joints_topic} ({JOINTS_TYPE}) with --robot, or {self.settings.tf_topic} "
            f"({TRANSFORM_TYPE}) with --left-frame and --right-frame. "
            f"Name other topics with {self._naming}, --joints-topic or --tf-topic."
        )
        if topic not in types:
            grips = self.carried.topics
            others = [name for name in grips if name in types and topic in grips]
            one = f" Only one gripper was recorded: {others[0]}." if others else ""
            if len(others) > 1:
                one = f" Only these grippers were recorded: {', '.join(others)}."
            raise BagError(f"{self.bag.path} has no topic {topic}.{one} Topics found: {found}. {options}")
        if types[topic] != kind:
            raise BagError(f"{self.bag.path}: {topic} is of type {types[topic]}, it must be {kind}. {options}")

    @property
    def _naming(self) -> str:
        """Options that name topics of poses."""
        return "--left-topic, --right-topic" if self.settings.harness is None else "--end-topic"

    def _nothing(self) -> str:
        """Why no cycle could be run."""
        read = ", ".join(f"{self.bag.read[topic]} on {topic}" for topic in self.source.topics)
        reasons = [
            f"{entry.count} refused on {entry.topic} ({entry.reason}: {entry.example})" for entry in self.refusals
        ]
        if self.source.unpaired:
            reasons.append(
                f"{self.source.unpaired} poses had no partner within max_skew = {self.settings.max_skew:g} s "
                "(raise --max-skew if the grippers are stamped further apart)"
            )
        reasons.extend(self.bag.problems)
        return f"{self.bag.path}: no cycle could be run. Messages read: {read}. {'; '.join(reasons)}"
