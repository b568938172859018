"""Names and quality of service of the node's input topics."""

from rclpy.qos import QoSProfile, ReliabilityPolicy

#: Best-effort matches every publisher; depth 1: a busy node takes the newest message and never falls behind.
SENSOR = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)

POSE_TOPICS = ("left_gripper/pose", "right_gripper/pose")
JOINT_TOPIC = "joint_states"
