"""An executor with a short way from an input message to its callback: :class:`InputFirstExecutor`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, final

from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node


@final
class InputFirstExecutor(SingleThreadedExecutor):
    """Takes the messages of some subscriptions by itself and leaves all else to rclpy.

    rclpy's executor builds its wait set in Python from every service, timer and event of the node before each single
    callback, which takes longer than a prediction. Here the handles are kept, and one wait serves all inputs that are
    ready, each once, so that input faster than the node starves neither services nor timers. The callbacks take a
    message and what the middleware tells about it.

    Parameters
    ----------
    node : Node
    inputs : callable
        The subscriptions, asked anew whenever rclpy's part has run, since a lifecycle transition changes them.
    """

    def __init__(self, node: Node, inputs: Callable[[], Sequence[Any]]) -> None:
        super().__init__(context=node.context)
        self._node = node
        self._inputs = inputs
        self.add_node(node)

    def spin(self) -> None:
        """Until shutdown."""
        while self._context.ok() and not self._is_shutdown:
            subscriptions = tuple(self._inputs())
            if not subscriptions:
                self.spin_once()
                continue
            others = 0
            while not others and self._context.ok() and not self._is_shutdown:
                others = self._wait(subscriptions)
                for subscription in subscriptions:
                    taken = subscription.handle.take_message(subscription.msg_type, subscription.raw)
                    if taken is not None:
                        subscription.callback(*taken)
            for _ in range(others + 1):
                self.spin_once(timeout_sec=0)

    def _wait(self, subscriptions: Sequence[Any]) -> int:
        """Blocks until something is ready; how many things other than `subscriptions` are."""
        node = self._node
        timers, services, clients = tuple(node.timers), tuple(node.services), tuple(node.clients)
        guards = (*node.guards, self._guard, self._sigint_gc)
        counts = (len(subscriptions), len(guards), len(timers), len(clients), len(services), 0)
        wait_set = rclpy_implementation.WaitSet(*counts, self._context.handle)
        wait_set.clear_entities()
        for add, entities in (
            (wait_set.add_subscription, subscriptions),
            (wait_set.add_guard_condition, guards),
            (wait_set.add_timer, timers),
            (wait_set.add_client, clients),
            (wait_set.add_service, services),
        ):
            for entity in entities:
                add(entity.handle)
        wait_set.wait(-1)
        if not self._context.ok():
            raise ExternalShutdownException
        return sum(len(wait_set.get_ready_entities(kind)) for kind in ("guard_condition", "timer", "client", "service"))
