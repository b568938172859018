"""A node of your own in twenty lines: two grippers' poses in, the centreline out; `cable_shape_node` does much more."""

import rclpy
from cable_shape_msgs.msg import CableShape
from geometry_msgs.msg import PoseStamped
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

import cable_shape as cs
from cable_shape.messages.fields import shape_fields


class Minimal(Node):
    """Predicts whenever a pose has come and both are known."""

    def __init__(self, cable: cs.Cable) -> None:
        super().__init__("minimal")
        self.cycle, self.ends = cs.Cycle(cable), {}
        self.shapes = self.create_publisher(CableShape, "cable/shape", 1)
        for side in ("left", "right"):
            self.create_subscription(PoseStamped, f"{side}_gripper/pose", lambda m, s=side: self.take(s, m), 1)

    def take(self, side: str, message: PoseStamped) -> None:
        p, q = message.pose.position, message.pose.orientation
        self.ends[side] = cs.Pose((p.x, p.y, p.z), (q.x, q.y, q.z, q.w))
        if len(self.ends) == 2:
            report = self.cycle.step(
                {"cable": (self.ends["left"], self.ends["right"])}, self.get_clock().now().nanoseconds
            )
            fields = shape_fields("cable", report.shapes["cable"])
            self.shapes.publish(CableShape(header=message.header, **fields))


rclpy.init()
cell = Minimal(cs.Cable(length=1.2, linear_density=0.1, bending_stiffness=0.01))

# The other side, here in the same process; in a cell these are the arms' drivers and whoever needs the shape.
peer, came = rclpy.create_node("peer"), []
peer.create_subscription(CableShape, "cable/shape", came.append, 1)
grippers = [peer.create_publisher(PoseStamped, f"{side}_gripper/pose", 1) for side in ("left", "right")]
executor = SingleThreadedExecutor()
executor.add_node(cell)
executor.add_node(peer)
while len(came) < 10:
    for gripper, x in zip(grippers, (0.0, 0.8), strict=True):
        pose = PoseStamped()
        pose.header.frame_id, pose.header.stamp = "world", peer.get_clock().now().to_msg()
        pose.pose.position.x, pose.pose.position.z = x, 0.5
        o = pose.pose.orientation
        o.x = o.y = o.z = o.w = 0.5
        gripper.publish(pose)
    executor.spin_once(timeout_sec=0.02)
print(f"{len(came)} shapes of {came[-1].model}, usable {came[-1].usable}, middle {came[-1].positions[225:228]}")
rclpy.shutdown()
