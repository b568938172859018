"""Random edits of a running node: what is done, what is refused, and whether the shapes are as they should be.

Beside the node a cycle in this process is edited alike. After every edit both must have the same bits; so must the
replay of what was recorded, in which nothing is that was refused. The shape is compared with one found from nothing:
they are one, or two stable branches, each of which is found again from itself at a tenth of the tolerance.
"""

from __future__ import annotations

import random
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import Any, NamedTuple, final

import numpy as np
from cable_shape_msgs.msg import CableEdits, CableShape
from cable_shape_msgs.srv import EditCable
from cell_node import FedNode, stamp_of, stamped
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import serialize_message
from rosbags.rosbag2 import Reader, StoragePlugin, Writer
from soak_held import Held

import cable_shape as cs
from cable_shape.errors import CableShapeError
from cable_shape.messages.fields import ARRAYS
from cable_shape.pose import between
from cable_shape.prediction.predictor import Predictor
from cable_shape.prediction.turned import TurnedPredictor
from cable_shape.replay.bag_writer import EDITS_TYPE, SHAPE_TYPE, cable_shape_store
from cable_shape.replay.run import replay
from cable_shape.replay.settings import Settings
from cable_shape.ros.conversions import edit_message
from cable_shape.scene.scene import CLIP_KINDS

#: Nearly taut, so that there is mostly one branch: its chord is 0.94 of its length, and clips are held near it.
CABLE_YAML = """length: 1.0
linear_density: 0.1
bending_stiffness: 0.02
diameter: 0.008
tails: {start: 0.1, end: 0.1}
"""
SCENE_YAML = "contact: solve\n"
CHORD = 0.94
ALONG_X = (0.0, np.sqrt(0.5), 0.0, np.sqrt(0.5))
BEGIN, PERIOD = 1_700_000_000_000_000_000, 10_000_000  # ns
POSE = "geometry_msgs/msg/PoseStamped"
TOPICS = ("/left_gripper/pose", "/right_gripper/pose")
KEPT = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)
GROWTH_KB = 20_000  # the hardest search so far takes some; a leak of 2 kB an edit is as much in 10,000
SETTLED = 0.3  # share of the edits, after which memory must be flat
SAME = 1e-3  # of the length: two shapes in contact, each asked for 5e-4
FARTHEST_STEP, WIDEST_TURN = 0.02, 0.1  # m, rad, that a grip goes in a cycle
LEAST_SPAN = 0.1  # m, of cable between clips and grips
#: What a shape is beside the one from nothing: the same; another stable branch; one where nothing is found from
#: nothing; none, for no way leads there from the last one, or the cable is too short for it; another, jammed between
#: bodies so near each other that a shape's points do not tell how, of which it cannot be told whether it is stable.
KNOWN = ("one", "another", "not from nothing", "no way", "not told")
MOST_LOST = 0.02  # share of edits after which there may be no way, or which may be not told
ANSWER_S, AGAIN_S = 60.0, 0.5


class Told(NamedTuple):
    """How one edit went."""

    done: bool
    reason: str


@final
class Twin:
    """A cycle in this process, edited and stepped like the node's."""

    def __init__(self, cable: cs.Cable, scene: cs.Scene, seed: int) -> None:
        self.draw = random.Random(seed)
        self.cycle = cs.Cycle(cable, scene=scene)
        self.stamp = BEGIN
        self.times: list[float] = []  # s, of edits
        self.ends: tuple[cs.Pose, cs.Pose] = (_at(0.0), _at(1.0))
        self.shape = self.step(self.ends)

    def step(self, ends: tuple[cs.Pose, cs.Pose]) -> cs.CableShape:
        """The next cycle, with the grips at these places."""
        self.ends = ends
        start, end = (cs.Pose(pose.position, pose.quaternion) for pose in ends)  # of unit length, as the node makes it
        self.shape = self.cycle.step({"cable": (start, end)}, self.stamp).shapes["cable"]
        self.stamp += PERIOD
        return self.shape

    def way(self, edit: Any) -> list[tuple[cs.Pose, cs.Pose]]:
        """Where the grips go after an edit: one that has taken the cable elsewhere to where it is as taut as before."""
        if not isinstance(edit, cs.Regrip):
            return [self.ends]
        found = self.cycle._cables["cable"].found
        assert found is not None
        side = 0 if edit.end == "start" else 1
        then, there = found.ends[side], _at(edit.arc_length)
        assert isinstance(then, cs.Pose)
        count = 2 + int(max(then.distance(there)[0] / FARTHEST_STEP, then.distance(there)[1] / WIDEST_TURN))
        places = [cs.Pose.trusted(between(then.array, there.array, k / count)) for k in range(count)] + [there]
        return [(place, self.ends[1]) if side == 0 else (self.ends[0], place) for place in places]

    def edit(self, edit: Any) -> Told:
        """Makes it, and moves the gripper that has taken the cable elsewhere."""
        began = time.perf_counter()
        try:
            result = self.cycle.edit(edit)
        except CableShapeError as error:
            return Told(False, str(error))
        self.times.append(time.perf_counter() - began)
        return Told(result.done, result.reason)

    def at(self, s: float) -> Any:
        """(3,) m, the cable's place at an arc length."""
        return np.array([np.interp(s, self.shape.arc_length, x) for x in self.shape.positions.T])

    def random_edit(self, count: int) -> Any:
        """One that may or may not be."""
        draw, length = self.draw, self.shape.length
        clips, bodies = self.cycle.scene.clips, [body.name for body in self.cycle.scene.obstacles]
        s = draw.uniform(0.05, 0.95) * length
        shift = np.array([draw.uniform(-0.01, 0.01) for _ in range(3)])
        near, down = self.at(s) + shift, np.array((0.0, 0.0, 1.0))
        kind = draw.choice(
            ("add", "body", "body", "insert", "clip", "clip", "regrip", "cable", "mass", "open", "wrong")
        )
        opened = self.cycle.layout.cables["cable"].opened
        if opened and draw.random() < 0.5:
            return cs.Regrip(opened, draw.uniform(-0.05, 0.05) + (0.0 if opened == "start" else 1.0))
        if kind == "add" and len(bodies) < 6:
            below = self.at(s) - draw.uniform(0.02, 0.1) * down
            return cs.Add(cs.Obstacle(f"body{count}", cs.Sphere(draw.uniform(0.01, 0.03)), cs.Pose(below)))
        if kind in ("add", "body") and bodies:
            name = draw.choice(bodies)
            if draw.random() < 0.4 or kind == "add":
                return cs.Remove(name)
            return cs.Move(name, cs.Pose(near - draw.uniform(0.03, 0.1) * down))
        apart = min(abs(s - one) for one in (0.0, length, *(clip.arc_length for clip in clips)))
        if kind == "insert" and len(clips) < 4 and apart > LEAST_SPAN:
            return cs.Insert(cs.Clip(s, cs.Pose(near, ALONG_X), draw.choice(CLIP_KINDS), name=f"clip {count}"))
        if kind == "clip" and clips:
            clip = draw.choice(clips)
            if draw.random() < 0.5:
                return cs.Release(str(clip.name))
            return cs.Move(str(clip.name), cs.Pose(clip.pose.position + shift, clip.pose.quaternion))
        if kind == "regrip":
            end = draw.choice(("start", "end"))
            return cs.Regrip(end, draw.uniform(-0.05, 0.05) + (0.0 if end == "start" else 1.0))
        if kind == "mass" and not self.cycle.scene.masses:
            return cs.Add(cs.PointMass(0.5, 0.01))
        if kind == "open":
            return cs.Open(draw.choice(("start", "end")))
        if kind == "wrong":
            return draw.choice((
                cs.Release("nothing"), cs.Regrip("end", 5.0), cs.Insert(cs.Clip(3.0, cs.Pose())),
                cs.Insert(cs.Clip(s, cs.Pose(near + 5.0 * down), name="too far")),
            ))  # fmt: skip
        return cs.SetCable(cs.Cable.from_mapping({**_cable(), "bending_stiffness": draw.uniform(0.015, 0.03)}))

    def branch(self) -> str:
        """Whether the shape is the one from nothing: one of `KNOWN`, or what is wrong."""
        opened = self.cycle.layout.cables["cable"].opened
        start, end = self.ends
        ends = None if opened == "start" else start, None if opened == "end" else end
        again = self._predictor().predict(*ends)
        if not again.usable or again.status is cs.Status.UNSTABLE:
            return "not from nothing"
        if not self.shape.usable:
            lost = any(text in self.shape.detail for text in ("no way from the last shape", "too short for its way"))
            words = f"the shape is {self.shape.status.name} ({self.shape.detail}), from nothing {again.status.name}"
            return "no way" if lost else words
        length = self.shape.length
        if _apart(self.shape, again) < SAME * length:
            return "one"
        finer = [self._again(shape, ends) for shape in (self.shape, again)]
        moved = [_apart(a, b) for a, b in zip((self.shape, again), finer, strict=True)]
        stable = all(shape.status is cs.Status.OK for shape in finer)
        if stable and max(moved) < SAME * length <= _apart(*finer):
            return "another"
        if cs.Status.NOT_CONVERGED in [shape.status for shape in finer]:
            return "not told"
        words = ", ".join(f"{shape.status.name} {1e3 * way:.3g} mm" for shape, way in zip(finer, moved, strict=True))
        return f"{1e3 * _apart(self.shape, again):.3g} mm from that from nothing; from itself each comes to {words}"

    def _predictor(self, **options: Any) -> Any:
        """Of the cable as it is held now, from nothing."""
        kind = TurnedPredictor if self.cycle.layout.cables["cable"].opened == "start" else Predictor
        return kind(self.cycle.cables["cable"], scene=self.cycle.scene, **options)

    def _again(self, shape: cs.CableShape, ends: Any) -> cs.CableShape:
        """The shape found from itself, at a tenth of the tolerance."""
        predictor = self._predictor(tolerance=1e-6 * shape.length)
        predictor.begin(shape, ends, None)
        predictor.look_again()
        return predictor.solve()


def _at(arc_length: float) -> cs.Pose:
    """Of a grip that holds the cable there, with which it is always as taut."""
    return cs.Pose((CHORD * arc_length, 0.0, 1.0), ALONG_X)


def _cable() -> dict[str, Any]:
    from cable_shape.files.yaml_files import read_strictly

    values: dict[str, Any] = read_strictly(CABLE_YAML, "cable")
    return values


def _apart(one: cs.CableShape, other: cs.CableShape) -> float:
    """[m], largest distance of points of the same number."""
    return float(np.abs(one.positions - other.positions).max())


@final
class Live:
    """The node, asked and fed."""

    def __init__(self, fed: FedNode) -> None:
        self.fed = fed
        self.shapes: dict[int, Any] = {}
        self.done: list[Any] = []
        self.repeats = 0
        fed.node.create_subscription(CableShape, "cable/shape", self._hear, 10)
        fed.node.create_subscription(CableEdits, "cable/edits", self.done.append, KEPT)
        self.client = fed.node.create_client(EditCable, "cable_shape_node/edit")
        self._until(self.client.service_is_ready, "service")

    def _hear(self, message: Any) -> None:
        self.shapes[stamp_of(message)] = message

    def _until(self, done: Any, what: str, again: Any = None) -> Any:
        """Spins until something is there; asks `again` from time to time."""
        end, due = time.monotonic() + ANSWER_S, 0.0
        while not done():
            if again is not None and time.monotonic() >= due:
                due = time.monotonic() + AGAIN_S
                again()
            self.fed.spin(0.001)
            self.fed.check()
            if time.monotonic() > end:
                raise RuntimeError(f"no {what} within {ANSWER_S:g} s")

    def edit(self, edit: Any) -> Told:
        future = self.client.call_async(EditCable.Request(edits=[edit_message(edit)]))
        self._until(future.done, "answer to an edit")
        answer = future.result()
        return Told(answer.done, answer.reason)

    def shape(self, stamp: int, ends: tuple[cs.Pose, cs.Pose]) -> Any:
        """Of this input, of which the node uses the first that it hears."""
        rows = [pose.array for pose in ends]
        self._until(lambda: stamp in self.shapes, "shape", lambda: self.fed.send(stamp, rows))
        return self.shapes.pop(stamp)

    def all_done(self, count: int) -> None:
        self._until(lambda: len(self.done) >= count, "edits on cable/edits")


def edits(count: int, seed: int, folder: Path | None = None) -> list[str]:
    """Asks for so many random edits; what was wrong.

    folder: for the recording and its replay; default: one that is removed.
    """
    from cable_shape import warm_up

    warm_up()  # as the node does: the same kernels, so the same bits
    with tempfile.TemporaryDirectory(prefix="soak_") as place:
        return _edits(count, seed, folder or Path(place))


def _edits(count: int, seed: int, folder: Path) -> list[str]:
    files = {"cable_file": folder / "cable.yaml", "scene_file": folder / "scene.yaml"}
    files["cable_file"].write_text(CABLE_YAML)
    files["scene_file"].write_text(SCENE_YAML)
    cable, scene = cs.Cable.from_yaml(files["cable_file"]), cs.Scene.from_yaml(files["scene_file"])
    twin, wrong, found, kinds = Twin(cable, scene, seed), [], Counter[str](), Counter[str]()
    bits: dict[int, bytes] = {}
    held: list[Held] = []
    done, last = 0, ""
    with FedNode("node", folder, files) as fed, _Recorder(folder / "bag") as recorder:
        fed.wait()
        live = Live(fed)
        for k in range(count + 1):
            way = [twin.ends]
            if k:
                edit = twin.random_edit(k)
                told, answer = twin.edit(edit), live.edit(edit)
                done += told.done
                kinds[f"{type(edit).__name__} {'done' if told.done else 'refused'}"] += 1
                if told != answer:
                    wrong.append(f"edit {k}, {edit}: the node said {answer}, a cycle {told}")
                if not told.done and not told.reason:
                    wrong.append(f"edit {k}, {edit}: refused without a reason")
                if told.done:
                    way = twin.way(edit)
            for ends in way:
                stamp = twin.stamp
                recorder.poses(stamp, ends)
                bits[stamp] = _bits(live.shape(stamp, ends))
                if bits[stamp] != _bits_of(twin.step(ends)):
                    wrong.append(f"edit {k}: the shapes of node and cycle differ")
            branch = twin.branch()
            known = branch in KNOWN
            if branch != "no way" or last != branch:  # as long as there is none, there is nothing to go on from
                found[branch if known else "not understood"] += 1
            last = branch
            if not known:
                wrong.append(f"edit {k} of seed {seed}: {branch}")
            if k in (round(SETTLED * count), count):
                held.append(Held.by(fed.process.pid))
            if k % max(1, count // 20) == 0:
                print(f"{k} edits, {done} done; branches {dict(found)}; {Held.by(fed.process.pid)}", flush=True)
        live.all_done(done)
        values = fed.fresh()
        recorder.edits(live.done)
    for name, number in (("edits done", done), ("edits refused", count - done)):
        if values.get(name) != str(number):
            wrong.append(f"the diagnostics say {values.get(name)} {name}, {number} were")
    if [message.number for message in live.done] != list(range(1, done + 1)):
        wrong.append("the numbers on cable/edits do not follow each other")
    wrong += [f"{found[kind]} of {count} edits: {kind}" for kind in KNOWN[3:] if found[kind] > MOST_LOST * count + 1]
    if held[1].memory_kb > held[0].memory_kb + GROWTH_KB or held[1].files > held[0].files:
        wrong.append(f"memory or files grew from {held[0]} to {held[1]}")
    print(f"memory {held[0].memory_kb} -> {held[1].memory_kb} kB; {dict(sorted(kinds.items()))}")
    print("an edit in ms, p50 / p99 / max: {:.1f} / {:.1f} / {:.1f}".format(*_times(twin)))
    return wrong + _replayed(folder, Settings(cable=cable, scene=scene, rrd=False, picture=False), bits)


def _times(twin: Twin) -> Any:
    return 1e3 * np.percentile(twin.times, (50, 99, 100))


def _replayed(folder: Path, settings: Settings, bits: dict[int, bytes]) -> list[str]:
    """What the replay of the recording has otherwise than the node had it."""
    outcome = replay(folder / "bag", folder / "out", settings)
    store, wrong, same = cable_shape_store(), list(outcome.problems), 0
    with Reader(folder / "out" / "replay") as reader:
        wanted = [c for c in reader.connections if c.msgtype == SHAPE_TYPE]
        for connection, stamp, raw in reader.messages(wanted):
            same += _bits(store.deserialize_cdr(raw, connection.msgtype)) == bits.get(stamp)
    print(f"replay: {outcome.edits} requests repeated, {same} of {len(bits)} shapes to the bit")
    return wrong if same == len(bits) else [*wrong, f"{len(bits) - same} shapes of the replay differ from the node's"]


def _bits(message: Any) -> bytes:
    return b"".join(np.asarray(getattr(message, name), dtype=np.float64).tobytes() for name, _ in ARRAYS)


def _bits_of(shape: cs.CableShape) -> bytes:
    return np.ascontiguousarray(shape.buffer).tobytes()


@final
class _Recorder:
    """Writes what a recorder on the node's topics would."""

    def __init__(self, folder: Path) -> None:
        self._store = cable_shape_store()
        self._writer = Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP)

    def __enter__(self) -> _Recorder:
        self._writer.open()
        make = self._writer.add_connection
        self._sides = [make(topic, POSE, typestore=self._store) for topic in TOPICS]
        self._edits = make("/cable/edits", EDITS_TYPE, typestore=self._store)
        return self

    def __exit__(self, *_: object) -> None:
        self._writer.close()

    def poses(self, stamp: int, ends: tuple[cs.Pose, cs.Pose]) -> None:
        for side, pose in zip(self._sides, ends, strict=True):
            self._writer.write(side, stamp, serialize_message(stamped(stamp, pose.array)))

    def edits(self, messages: list[Any]) -> None:
        for message in messages:
            self._writer.write(self._edits, stamp_of(message) + PERIOD // 2, serialize_message(message))
