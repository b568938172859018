"""A tracker of its own process: two gripper poses at 100 Hz in namespace argv[1], until it is killed."""

import sys
import time

import harness
import rclpy
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseStamped

rclpy.init()
node = rclpy.create_node("mover", namespace=sys.argv[1])
publishers = [node.create_publisher(PoseStamped, f"{side}_gripper/pose", 1) for side in ("left", "right")]
for k in range(100_000):
    now = time.time_ns()
    for side, publisher in enumerate(publishers):
        message = PoseStamped()
        message.header.stamp = Time(sec=now // 10**9, nanosec=now % 10**9)
        message.header.frame_id = "world"
        p, q = message.pose.position, message.pose.orientation
        p.x, p.y, p.z = (0.0, 0.8 + 0.001 * (k % 100))[side], 0.0, 0.5
        q.x, q.y, q.z, q.w = harness.ALONG_X
        publisher.publish(message)
    time.sleep(0.01)
