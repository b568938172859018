"""Starts the node in its own process: ros2 launch cable_shape cable_shape.launch.py params:=FILE.

The node configures and activates itself unless autostart is false in the parameter file.
"""

from pathlib import Path

from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import LifecycleNode

from launch import LaunchDescription

CONFIG = Path(__file__).resolve().parents[1] / "config"  # in the sources and in share/cable_shape alike


def generate_launch_description() -> LaunchDescription:
    """The node and its arguments."""
    return LaunchDescription(
        [
            DeclareLaunchArgument("namespace", default_value="", description="Prefix of the node and its topics."),
            DeclareLaunchArgument(
                "params",
                default_value=str(CONFIG / "node.yaml"),
                description="Parameter file: config/node.yaml (poses), node_joints.yaml (joints), node_tf.yaml (tf), "
                "node_harness.yaml (poses of a harness), node_live.yaml, node_simulation.yaml or node_replay.yaml.",
            ),
            DeclareLaunchArgument(
                "use_sim_time", default_value="false", description="Follow /clock; the file goes first."
            ),
            LifecycleNode(
                package="cable_shape",
                executable="cable_shape_node",
                name="cable_shape_node",
                namespace=LaunchConfiguration("namespace"),
                # the file comes last: what it says holds
                parameters=[{"use_sim_time": LaunchConfiguration("use_sim_time")}, LaunchConfiguration("params")],
                output="screen",
            ),
        ]
    )
