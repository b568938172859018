"""Requests for a transition that is not possible now, which rclpy would let end the process, or that a lock forbids."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.lifecycle import LifecycleNode

#: What a locked node does not do for its peers; deactivate and shutdown always pass, and activate after them.
LOCKED = ("configure", "cleanup")


def guard_transitions(node: LifecycleNode, state: Callable[[], str], locked: Callable[[str], bool]) -> None:
    """From now on the node answers them, and logs in which `state` it is and what is possible.

    locked: is given the name of one of the `LOCKED` transitions, and says whether it is refused.
    """
    service = node._service_change_state
    change = service.callback

    def answer(request: Any, response: Any) -> Any:
        possible = {entry[0]: entry[1] for entry in node._state_machine.available_transitions}
        wanted = request.transition
        name = wanted.label or possible.get(wanted.id, "")
        if name in LOCKED and locked(name):
            response.success = False
            return response
        if not wanted.label and wanted.id not in possible:
            node.get_logger().error(
                f"transition {wanted.id} is not possible: the node is {state()}. "
                f"Possible: {', '.join(f'{i} ({label})' for i, label in possible.items())}.",
                throttle_duration_sec=1.0,
            )
            response.success = False
            return response
        return change(request, response)

    service.callback = answer
