"""Requests for a transition that is not possible now: rclpy would let them end the process."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.lifecycle import LifecycleNode


def answer_wrong_transitions(node: LifecycleNode, state: Callable[[], str]) -> None:
    """From now on the node answers them, and logs in which `state` it is and what is possible."""
    service = node._service_change_state
    change = service.callback

    def answer(request: Any, response: Any) -> Any:
        possible = {entry[0]: entry[1] for entry in node._state_machine.available_transitions}
        wanted = request.transition
        if not wanted.label and wanted.id not in possible:
            node.get_logger().error(
                f"transition {wanted.id} is not possible: the node is {state()}. "
                f"Possible: {', '.join(f'{i} ({label})' for i, label in possible.items())}."
            )
            response.success = False
            return response
        return change(request, response)

    service.callback = answer
