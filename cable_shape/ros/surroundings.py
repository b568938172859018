"""What is around the node: its viewer, its workers, and other nodes of its name."""

from __future__ import annotations

from collections.abc import Mapping

from rclpy.node import Node

from cable_shape.ros.worker import WorkerProcess
from cable_shape.viewer.process import ViewerProcess


def troubles(node: Node, viewer: ViewerProcess | None, workers: Mapping[str, WorkerProcess]) -> dict[str, str]:
    """A code and a text with the remedy for each thing that is wrong there."""
    found = {}
    if viewer is not None and viewer.ended:
        found["viewer"] = (
            "the viewer has ended (window closed, disk full, or killed): predictions go on without it. "
            "Make room, then deactivate, clean up, configure and activate to start it again."
        )
    for name, worker in workers.items():
        fallen = worker.revived()
        if fallen:
            found[name] = fallen
    if node.get_node_names_and_namespaces().count((node.get_name(), node.get_namespace())) > 1:
        found["name"] = (
            f"another node is called {node.get_fully_qualified_name()}, too: services and parameters may reach either. "
            "End one, or give it another namespace: --ros-args -r __ns:=/OTHER"
        )
    return found
