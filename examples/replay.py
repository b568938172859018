"""A recording predicted from Python: the poses of two grippers in, messages, a table and a report out."""

import json
from pathlib import Path

import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

import cable_shape as cs
from cable_shape.replay.run import replay
from cable_shape.replay.settings import Settings

POSE, SECOND = "geometry_msgs/msg/PoseStamped", 10**9
store = get_typestore(Stores.ROS2_JAZZY)


def message(stamp: int, position: tuple[float, float, float]) -> bytes:
    """A gripper's pose, as a recorder writes it; the cable runs along x."""
    time = store.types["builtin_interfaces/msg/Time"](*divmod(stamp, SECOND))
    header = store.types["std_msgs/msg/Header"](time, "world")
    point = store.types["geometry_msgs/msg/Point"](*position)
    turn = store.types["geometry_msgs/msg/Quaternion"](0.5, 0.5, 0.5, 0.5)
    pose = store.types["geometry_msgs/msg/Pose"](point, turn)
    return bytes(store.serialize_cdr(store.types[POSE](header, pose), POSE))


# A second of two grippers at 100 Hz: a recording of your own takes the place of this one.
bag = Path("bag")
with Writer(bag, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
    left, right = (writer.add_connection(f"/{side}_gripper/pose", POSE, typestore=store) for side in ("left", "right"))
    for k in range(100):
        stamp = 1_700_000_000 * SECOND + k * SECOND // 100
        writer.write(left, stamp, message(stamp, (0.0, 0.0, 0.5)))
        writer.write(right, stamp, message(stamp, (0.8 + 0.05 * float(np.sin(0.06 * k)), 0.0, 0.5)))

cable = cs.Cable(length=1.2, linear_density=0.1, bending_stiffness=0.01)
table = cs.Scene(obstacles=[cs.Obstacle("table", cs.HalfSpace())], warn_distance=0.2)
outcome = replay(bag, "out", Settings(cable=cable, scene=table))
print(f"read {outcome.topics}, refused {outcome.refusals.total}, unpaired {outcome.unpaired}")
report = json.loads(Path("out/report.json").read_text())
print("the report has", ", ".join(report))
print("written:", ", ".join(sorted(str(file) for file in Path("out").rglob("*") if file.is_file())))
