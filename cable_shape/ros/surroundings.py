"""What is around the node: its viewer, its workers, and other nodes of its name."""

from __future__ import annotations

from typing import final

from rclpy.node import Node

from cable_shape.ros.assembly import Assembly

LOOK_PERIOD = 1.0  # s


@final
class Surroundings:
    """Looks at what is around a node once a second, and at once when a worker begins or ceases to serve."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._looked = -LOOK_PERIOD
        self._serving: tuple[bool, ...] = ()  # of the workers
        self.troubles: dict[str, str] = {}  # a code and a text with the remedy for each thing that is wrong

    def tend(self, assembly: Assembly | None, steady: float) -> bool:
        """To be called some times a second, at the time `steady` [s]; whether it has looked."""
        workers = {} if assembly is None else assembly.workers
        serving = tuple(worker.serves for worker in workers.values())
        look = serving != self._serving or steady - self._looked >= LOOK_PERIOD
        if look:
            self._looked, self._serving = steady, serving
            self.troubles = self._look(assembly)
        for stand_in in () if assembly is None else assembly.stand_ins:
            stand_in.tend()
        return look

    def _look(self, assembly: Assembly | None) -> dict[str, str]:
        found = {}
        if assembly is not None:
            if assembly.viewer is not None and assembly.viewer.ended:
                found["viewer"] = (
                    "the viewer has ended (window closed, disk full, or killed): predictions go on without it. "
                    "Make room, then deactivate, clean up, configure and activate to start it again."
                )
            for name, worker in assembly.workers.items():
                fallen = worker.revived()
                if fallen:
                    found[name] = fallen
        node = self._node
        if node.get_node_names_and_namespaces().count((node.get_name(), node.get_namespace())) > 1:
            found["name"] = (
                f"another node is called {node.get_fully_qualified_name()}, too: services and parameters may reach "
                "either. End one, or give it another namespace: --ros-args -r __ns:=/OTHER"
            )
        return found
