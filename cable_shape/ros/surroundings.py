"""What is around the node: its viewer, its planner, and other nodes of its name."""

from __future__ import annotations

from rclpy.node import Node

from cable_shape.ros.worker import PlannerProcess
from cable_shape.viewer.process import ViewerProcess


def troubles(node: Node, viewer: ViewerProcess | None, planner: PlannerProcess | None) -> dict[str, str]:
    """A code and a text with the remedy for each thing that is wrong there."""
    found = {}
    if viewer is not None and viewer.ended:
        found["viewer"] = (
            "the viewer has ended (window closed, disk full, or killed): predictions go on without it. "
            "Make room, then deactivate, clean up, configure and activate to start it again."
        )
    fallen = "" if planner is None else planner.revived()
    if fallen:
        found["planner"] = fallen
    if node.get_node_names_and_namespaces().count((node.get_name(), node.get_namespace())) > 1:
        found["name"] = (
            f"another node is called {node.get_fully_qualified_name()}, too: services and parameters may reach either. "
            "End one, or give it another namespace: --ros-args -r __ns:=/OTHER"
        )
    return found
