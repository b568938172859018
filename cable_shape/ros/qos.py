"""Names and quality of service of the node's input topics."""

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

#: Best-effort matches every publisher; depth 1: a busy node takes the newest message and never falls behind.
SENSOR = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)

POSE_TOPICS = ("left_gripper/pose", "right_gripper/pose")
JOINT_TOPIC = "joint_states"

#: Of all senders together, as tf2 keeps them: what is lost of one cannot be had from the next message of another.
TRANSFORMS = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
STATIC_TRANSFORMS = QoSProfile(
    depth=100, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
)

TF_TOPIC, TF_STATIC_TOPIC = "/tf", "/tf_static"
