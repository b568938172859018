"""Goals of an action in a process beside the node, worked on one at a time: :class:`Goals`, :func:`told`."""

from __future__ import annotations

import threading
import time
import traceback
from collections.abc import Callable, Mapping
from typing import Any, final

from rclpy.action.server import ActionServer, CancelResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node

from cable_shape.errors import ArgumentError, CableShapeError

MOST_GOALS = 4  # under way at the same time, one of them being worked on
FEEDBACK_PERIOD = 0.1  # s
RESULT_KEPT = 60  # s, for a client that asks late


@final
class Goals:
    """Serves an action; a goal that finds `MOST_GOALS` others under way is refused.

    Parameters
    ----------
    node : Node
    kind : type
        Of the action; its result has the field `error`.
    name : str
    work : callable
        Does what a goal asks for and fills its result; where it raises, the goal is aborted with what :func:`told`
        says.
    unheard : mapping
        Fields of the result of a goal that is cancelled before its turn.
    check : callable
        Raises while no goals are served; they are aborted then.
    """

    def __init__(
        self,
        node: Node,
        kind: Any,
        name: str,
        work: Callable[[Any, Any], None],
        unheard: Mapping[str, Any],
        check: Callable[[], None],
    ) -> None:
        self._node, self._kind, self._work, self._unheard, self._check = node, kind, work, unheard, check
        self._count = 0
        self._counting, self._turn = threading.Lock(), threading.Lock()
        ActionServer(
            node,
            kind,
            name,
            self.run,
            callback_group=ReentrantCallbackGroup(),
            cancel_callback=lambda _: CancelResponse.ACCEPT,
            result_timeout=RESULT_KEPT,
        )

    def run(self, goal: Any) -> Any:
        """The result of a goal, which is succeeded, aborted or cancelled then."""
        result = self._kind.Result()
        with self._counting:
            self._count += 1
            busy = self._count > MOST_GOALS
        try:
            self._check()
            if busy:
                bound = f"at most {MOST_GOALS} may be under way"
                raise ArgumentError.of("goals", MOST_GOALS + 1, bound, "Wait for a result, or cancel one.")
            if self._taken_turn(goal):
                try:
                    self._work(goal, result)
                finally:
                    self._turn.release()
            else:
                for name, value in self._unheard.items():
                    setattr(result, name, value)
        except Exception as error:  # noqa: BLE001 a defect is answered, too
            result.error = told(error, self._node)
            goal.abort()
            return result
        finally:
            with self._counting:
                self._count -= 1
        if goal.is_cancel_requested:
            goal.canceled()
        else:
            goal.succeed()
        return result

    def _taken_turn(self, goal: Any) -> bool:
        """Waits for the goals before; False if the goal was cancelled meanwhile."""
        while not self._turn.acquire(timeout=FEEDBACK_PERIOD):
            if goal.is_cancel_requested:
                return False
        return True


@final
class Feedback:
    """Publishes what a goal has come to, at most once in `FEEDBACK_PERIOD`, first after it or at once."""

    def __init__(self, goal: Any, at_once: bool = False) -> None:
        self._goal, self._told = goal, -FEEDBACK_PERIOD if at_once else time.monotonic()

    def offer(self, make: Callable[[], Any]) -> None:
        """Publishes what `make` makes, if it is time."""
        now = time.monotonic()
        if now - self._told >= FEEDBACK_PERIOD:
            self._told = now
            self._goal.publish_feedback(make())


def told(error: Exception, node: Node) -> str:
    """What an answer says about an error; one that is not ours is a defect, and the process goes on."""
    if isinstance(error, CableShapeError):
        return str(error)
    node.get_logger().error("".join(traceback.format_exception(error)))
    return (
        f"a defect ended this request ({type(error).__name__}: {error}); others are answered. "
        "Report it with the traceback in the node's log."
    )
