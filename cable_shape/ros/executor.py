"""An executor with a short way from an input message to its callback: :class:`InputFirstExecutor`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, final

from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node

PATIENCE = 0.01  #: [s] for so long at most what else is to be done waits for the next input


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
            others, taken = 0, False
            while not others and self._context.ok() and not self._is_shutdown:
                others = self._wait(subscriptions)
                taken = self._take(subscriptions)
            if others and not taken and self._context.ok():
                self._wait(subscriptions, PATIENCE)  # right after an input there is most time until the next one
                self._take(subscriptions)
            for _ in range(others + 1):
                self.spin_once(timeout_sec=0)
                self._take(tuple(self._inputs()))

    @staticmethod
    def _take(subscriptions: Sequence[Any]) -> bool:
        """Calls back for each input that is there, once; whether any was."""
        found = False
        for subscription in subscriptions:
            taken = subscription.handle.take_message(subscription.msg_type, subscription.raw)
            if taken is not None:
                found = True
                subscription.callback(*taken)
        return found

    def _wait(self, subscriptions: Sequence[Any], patience: float | None = None) -> int:
        """Blocks until something is ready; how many things other than `subscriptions` are.

        patience [s]: only for `subscriptions`, no longer than that.
        """
        node, others = self._node, patience is None
        timers = tuple(node.timers) if others else ()
        services = tuple(node.services) if others else ()
        clients = tuple(node.clients) if others else ()
        guards = (*(node.guards if others else ()), self._guard, self._sigint_gc)
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
        wait_set.wait(-1 if patience is None else int(1e9 * patience))
        if not self._context.ok():
            raise ExternalShutdownException
        return sum(len(wait_set.get_ready_entities(kind)) for kind in ("guard_condition", "timer", "client", "service"))
