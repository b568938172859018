"""Reading the messages: what the node publishes, and a replay writes, back as shapes and warnings of Python."""

from pathlib import Path

from rosbags.rosbag2 import Reader

import cable_shape as cs
from cable_shape.messages.fields import shape_from
from cable_shape.replay.bag_writer import BagWriter, cable_shape_store

# A recording of the node's topics is made here from three cycles; `ros2 bag record` makes the same of a node's own.
cable = cs.Cable(length=1.2, linear_density=0.1, bending_stiffness=0.01)
scene = cs.Scene(obstacles=[cs.Obstacle("table", cs.HalfSpace())], warn_distance=0.3)
cycle = cs.Cycle(cable, scene=scene)
along_x = (0.5, 0.5, 0.5, 0.5)
with BagWriter(Path("recorded")) as writer:
    for k in range(3):
        ends = cs.Pose((0.0, 0.0, 0.5), along_x), cs.Pose((0.8, 0.01 * k, 0.5), along_x)
        writer.write(cycle.step({"cable": ends}, stamp=10_000_000 * k), "world")

store = cable_shape_store()  # knows the messages of ROS 2 Jazzy and those of cable_shape_msgs
with Reader("recorded") as bag:
    for connection, stamp, raw in bag.messages():
        if connection.topic == "/cable/points":  # for RViz and Foxglove
            continue
        message = store.deserialize_cdr(raw, connection.msgtype)
        if connection.topic == "/cable/shape":
            shape = shape_from(message)  # a message that rclpy brought will do as well
            lowest = shape.positions[:, 2].min()
            print(f"{stamp * 1e-9:.2f} s: {message.cable_id}: {shape.status.name}, lowest {lowest:.3f} m")
        elif connection.topic == "/cable/warnings":
            print(*(f"    {warning.text}" for warning in message.warnings), sep="\n")
        else:
            print("    margins:", *(f"{cs.WarningKind(m.kind).name} {m.used:.2f}" for m in message.margins))
