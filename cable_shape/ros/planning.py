"""The planner's process: service PredictShapes and action CheckTrajectory, beside the node and apart from its cycles.

    python -m cable_shape.ros.planning SETUP

SETUP is an inherited descriptor with a :class:`~cable_shape.ros.workers.PlannerSetup` in JSON; standard input, by
ending, ends the process. Started by :class:`~cable_shape.ros.worker.WorkerProcess`.
"""

from __future__ import annotations

import threading
import time
import traceback
from typing import Any, final

from rclpy.action.server import ActionServer, CancelResponse
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup
from rclpy.node import Node

from cable_shape.batch import predict_batch
from cable_shape.cable import Cable
from cable_shape.errors import ArgumentError, CableShapeError, UnknownKeyError
from cable_shape.robot import Robot
from cable_shape.ros import planner_messages, requests
from cable_shape.ros.messages import CheckTrajectory, PredictShapes
from cable_shape.ros.serving import MOST_GOALS, leave, serve, told
from cable_shape.ros.workers import PlannerSetup
from cable_shape.trajectory import check_trajectory
from cable_shape.trajectory_report import TrajectoryCheck

FEEDBACK_PERIOD = 0.1  # s
RESULT_KEPT = 60  # s, for a client that asks late
_NICENESS = 5  # the cycles go first


@final
class Planner:
    """Answers requests; a check goes on beside calls of the service, of each kind one at a time."""

    def __init__(self, node: Node, setup: PlannerSetup) -> None:
        self._node, self._setup = node, setup
        self._cables = {name: Cable.from_mapping(values) for name, values in setup.cables.items()}
        self._robot = Robot.from_yaml(setup.robot) if setup.robot else None
        self._goals = 0
        self._counting, self._turn = threading.Lock(), threading.Lock()
        node.create_service(
            PredictShapes, setup.service, self._predict, callback_group=MutuallyExclusiveCallbackGroup()
        )
        ActionServer(
            node,
            CheckTrajectory,
            setup.action,
            self._check,
            callback_group=ReentrantCallbackGroup(),
            cancel_callback=lambda _: CancelResponse.ACCEPT,
            result_timeout=RESULT_KEPT,
        )

    def _cable(self, cable_id: str) -> Cable:
        if not cable_id and len(self._cables) == 1:
            return next(iter(self._cables.values()))
        if cable_id not in self._cables:
            raise UnknownKeyError.among("cable_id", cable_id, self._cables)
        return self._cables[cable_id]

    def _predict(self, request: Any, response: Any) -> Any:
        """PredictShapes."""
        setup = self._setup
        try:
            asked = requests.grasps(request, setup)
            batch = predict_batch(
                self._cable(request.cable_id),
                asked.starts,
                asked.ends,
                model=request.model or setup.model,
                gravity=setup.gravity,
                scene=setup.scene,
                points=asked.points,
                tolerance=asked.tolerance,
                threads=setup.threads,
                time_limit=asked.time_limit,
            )
        except Exception as error:  # noqa: BLE001 a defect is answered, too
            response.error = self._told(error)
            return response
        planner_messages.fill_shapes(response, batch, request.arrays)
        return response

    def _check(self, goal: Any) -> Any:
        """CheckTrajectory; a goal that finds `MOST_GOALS` others under way is refused."""
        result = CheckTrajectory.Result()
        with self._counting:
            self._goals += 1
            busy = self._goals > MOST_GOALS
        try:
            if busy:
                bound = f"at most {MOST_GOALS} may be under way"
                raise ArgumentError.of("goals", MOST_GOALS + 1, bound, "Wait for a result, or cancel one.")
            if not self._taken_turn(goal):
                result.success = result.partial = True
                goal.canceled()
                return result
            try:
                found = self._checked(goal)
            finally:
                self._turn.release()
        except Exception as error:  # noqa: BLE001 likewise
            result.error = self._told(error)
            goal.abort()
            return result
        finally:
            with self._counting:
                self._goals -= 1
        planner_messages.fill_check(result, found)
        if goal.is_cancel_requested:
            goal.canceled()
        else:
            goal.succeed()
        return result

    def _told(self, error: Exception) -> str:
        """What an answer says about an error; one that is not ours is a defect, and the planner goes on."""
        if isinstance(error, CableShapeError):
            return str(error)
        self._node.get_logger().error("".join(traceback.format_exception(error)))
        return (
            f"a defect ended this request ({type(error).__name__}: {error}); others are answered. "
            "Report it with the traceback in the node's log."
        )

    def _taken_turn(self, goal: Any) -> bool:
        """Waits for the goals before; False if the goal was cancelled meanwhile."""
        while not self._turn.acquire(timeout=FEEDBACK_PERIOD):
            if goal.is_cancel_requested:
                return False
        return True

    def _checked(self, goal: Any) -> TrajectoryCheck:
        """The check itself, with feedback, until the goal is cancelled."""
        setup, request = self._setup, goal.request
        asked = requests.motion(request, setup)
        told = time.monotonic()

        def proceed(found: TrajectoryCheck) -> bool:
            nonlocal told
            now = time.monotonic()
            if now - told >= FEEDBACK_PERIOD:
                told = now
                goal.publish_feedback(planner_messages.feedback(found))
            return not goal.is_cancel_requested

        return check_trajectory(
            self._cable(request.cable_id),
            setup.scene,
            self._robot,
            asked.path,
            gravity=setup.gravity,
            points=asked.points,
            tolerance=asked.tolerance,
            time_limit=asked.time_limit,
            proceed=proceed,
        )


def main() -> int:
    """Serves planners as the node asked for."""
    setup = PlannerSetup.from_json(told())

    def make(node: Node) -> str:
        Planner(node, setup)
        return f"serving {setup.service} and {setup.action}"

    return serve(setup.name, setup.namespace, _NICENESS, make)


if __name__ == "__main__":
    leave(main())
