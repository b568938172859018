"""Answers in the place of a worker that has died: :class:`StandIn`."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterable
from functools import partial
from typing import Any, final

from action_msgs.msg import GoalStatus
from action_msgs.srv import CancelGoal
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy, qos_profile_services_default
from rclpy.type_support import check_for_type_support

from cable_shape.ros.worker import WorkerProcess

#: Requests that name nothing but a goal are small, and many may wait for a result.
_MANY = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE)


@final
class StandIn:
    """Hears every request to a worker, and answers with an error what it would have answered had it not died.

    ROS gives a request to each server of its name. This one lets them lie, unread, while the worker serves: what goes
    through the node's process is one copy that no Python sees. Once the worker has ended they are answered, those that
    it had under way and those that come before it serves again. Clients pass over a second answer to one request.

    Parameters
    ----------
    node : Node
    worker : WorkerProcess
    services : iterable of (type, absolute name)
        Their responses have the field `error`.
    actions : iterable of (type, absolute name)
        Their results have the field `error`.
    """

    def __init__(
        self,
        node: Node,
        worker: WorkerProcess,
        services: Iterable[tuple[Any, str]],
        actions: Iterable[tuple[Any, str]],
    ) -> None:
        self._node, self._worker = node, worker
        self._services, self._actions = tuple(services), tuple(actions)
        self._servers: list[tuple[Any, Any, Callable[[str], Any]]] = []  # handle, type, what makes a response

    def tend(self) -> None:
        """To be called some times a second: listens from when the worker serves, and answers once it does not."""
        if self._worker.serves:
            if not self._servers:
                self._listen()
        elif self._servers:
            self._answer(self._worker.excuse)

    def destroy(self) -> None:
        """After the worker has ended for good: answers what is left, and listens no more."""
        self._answer(self._worker.excuse)
        for server, _, _ in self._servers:
            server.destroy_when_not_in_use()
        self._servers.clear()

    def _listen(self) -> None:
        """What a client asks last comes first: who knows the first that it asks then has all the others, too."""
        for kind, name in self._actions:
            check_for_type_support(kind)
            self._serve(CancelGoal, f"{name}/_action/cancel_goal", _not_cancelled, _MANY)
            self._serve(kind.Impl.GetResultService, f"{name}/_action/get_result", partial(_aborted, kind), _MANY)
            self._serve(kind.Impl.SendGoalService, f"{name}/_action/send_goal", partial(_accepted, kind))
        for kind, name in self._services:
            self._serve(kind, name, partial(_failed, kind))

    def _serve(
        self, kind: Any, name: str, make: Callable[[str], Any], qos: QoSProfile = qos_profile_services_default
    ) -> None:
        """A server apart from those that the node's executor asks."""
        check_for_type_support(kind)
        with self._node.handle:
            server = rclpy_implementation.Service(self._node.handle, kind, name, qos.get_c_qos_profile())
        self._servers.append((server, kind, make))

    def _answer(self, text: str) -> None:
        for server, kind, make in self._servers:
            with contextlib.suppress(rclpy_implementation.RCLError), server:  # the client, or all of ROS, has ended
                while (taken := server.service_take_request(kind.Request))[1] is not None:
                    server.service_send_response(make(text), taken[1].request_id)


def _failed(kind: Any, text: str) -> Any:
    """The response of a service."""
    return kind.Response(error=text)


def _accepted(kind: Any, _: str) -> Any:
    """A goal is accepted, since only its result has room for a text."""
    return kind.Impl.SendGoalService.Response(accepted=True)


def _aborted(kind: Any, text: str) -> Any:
    """The result of a goal."""
    return kind.Impl.GetResultService.Response(status=GoalStatus.STATUS_ABORTED, result=kind.Result(error=text))


def _not_cancelled(_: str) -> Any:
    """There is nothing to cancel."""
    return CancelGoal.Response(return_code=CancelGoal.Response.ERROR_REJECTED)
