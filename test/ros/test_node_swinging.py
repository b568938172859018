"""Cables that touch each other as they swing, on one node: the bits of a cycle without middleware."""

from __future__ import annotations

import array

from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseStamped
from harness import nanoseconds
from rosgraph_msgs.msg import Clock

import cable_shape as cs
from cable_shape.messages.fields import shape_fields
from cable_shape.ros.assembly import load_cables

X, Y = (0.5, 0.5, 0.5, 0.5), (-0.70710678, 0.0, 0.0, 0.70710678)  # d3 along x, and along y
CABLE = "{length: 0.55, linear_density: 0.05, bending_stiffness: 0.01, diameter: 0.008, drag: 0.05}"
FIELDS = ("arc_length", "positions", "quaternions", "curvature", "force", "moment")


def held(k: int) -> dict[str, tuple[cs.Pose, cs.Pose]]:
    """A cable, and one across it that is let down on it."""
    z = max(0.04 - 0.002 * k, -0.004)
    return {
        "under": (cs.Pose((-0.25, 0.0, 0.5), X), cs.Pose((0.25, 0.0, 0.5), X)),
        "over": (cs.Pose((0.02, -0.25, 0.5 + z), Y), cs.Pose((0.02, 0.25, 0.5 + z), Y)),
    }


def test_two_cables_of_a_node_touch_each_other_as_they_swing(start, tmp_path):
    cables, scene, parameters = tmp_path / "two.yaml", tmp_path / "scene.yaml", tmp_path / "node.yaml"
    cables.write_text(f"cables:\n  under: {CABLE}\n  over: {CABLE}\n")
    scene.write_text("contact: solve\n")
    parameters.write_text(
        "/**:\n  ros__parameters:\n    motion: dynamic\n    points: 41\n    use_sim_time: true\n"
        f"    scene_file: {scene}\n"
    )
    node = start("--ros-args", "--params-file", str(parameters), cable_file=cables, active=False)
    node.until(lambda: node.state() == "active", "state active")
    clock = node.node.create_publisher(Clock, "/clock", 1)
    topics = {
        (name, side): node.node.create_publisher(PoseStamped, f"{name}/{gripper}_gripper/pose", 1)
        for name in ("under", "over")
        for side, gripper in enumerate(("left", "right"))
    }

    def publish(k: int, stamp: int) -> None:
        clock.publish(Clock(clock=Time(sec=stamp // 10**9, nanosec=stamp % 10**9)))
        for (name, side), topic in topics.items():
            message, pose = PoseStamped(), held(k)[name][side]
            message.header.stamp = Time(sec=stamp // 10**9, nanosec=stamp % 10**9)
            message.header.frame_id = "world"
            p, q = message.pose.position, message.pose.orientation
            p.x, p.y, p.z = pose.position.tolist()
            q.x, q.y, q.z, q.w = pose.quaternion.tolist()
            topic.publish(message)

    stamps = [50_000_000_000 + 10_000_000 * k for k in range(40)]
    for k, stamp in enumerate(stamps):
        node.send_until(
            lambda k=k, stamp=stamp: publish(k, stamp),
            lambda stamp=stamp: len([m for m in node.shapes if nanoseconds(m.header.stamp) == stamp]) == 2 or None,
            f"two shapes of {stamp}",
        )
    cycle = cs.Cycle(
        {name: file.cable for name, file in load_cables(cables).items()},
        scene=cs.Scene.from_yaml(scene),
        motion="dynamic",
        points=41,
    )
    touched = set()
    for k, stamp in enumerate(stamps):
        came = {m.cable_id: m for m in node.shapes if nanoseconds(m.header.stamp) == stamp}
        expected = cycle.step(held(k), stamp).shapes
        for name, message in came.items():
            fields = shape_fields(name, expected[name])
            for field in FIELDS:
                assert getattr(message, field) == array.array("d", fields[field].tobytes()), (k, name, field)
        touched |= {contact.body for contact in expected["over"].contacts}
    assert touched == {"under"}
    assert node.process.stop() == 0
