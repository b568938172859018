"""The planner's process: service PredictShapes and action CheckTrajectory, beside the node and apart from its cycles.

    python -m cable_shape.ros.planning SETUP SERVES CLIENTS

SETUP is a descriptor of a :class:`~cable_shape.ros.workers.PlannerSetup` in JSON; for the others see
:mod:`cable_shape.ros.serving`. Standard input, by ending, ends the process. Started by
:class:`~cable_shape.ros.worker.WorkerProcess`.
"""

from __future__ import annotations

from typing import Any, final

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.node import Node

from cable_shape.batch import predict_batch
from cable_shape.cable import Cable
from cable_shape.errors import UnknownKeyError
from cable_shape.robot import Robot
from cable_shape.ros import planner_messages, requests
from cable_shape.ros.goals import Feedback, Goals, told
from cable_shape.ros.messages import CheckTrajectory, PredictShapes
from cable_shape.ros.serving import Gate, given, leave, serve
from cable_shape.ros.workers import PlannerSetup
from cable_shape.trajectory import check_trajectory
from cable_shape.trajectory_report import TrajectoryCheck


@final
class Planner:
    """Answers requests; a check goes on beside calls of the service, of each kind one at a time."""

    def __init__(self, node: Node, setup: PlannerSetup, gate: Gate) -> None:
        self._node, self._setup, self._gate = node, setup, gate
        self._cables = {name: Cable.from_mapping(values) for name, values in setup.cables.items()}
        self._robot = Robot.from_yaml(setup.robot) if setup.robot else None
        node.create_service(
            PredictShapes, setup.service, self._predict, callback_group=MutuallyExclusiveCallbackGroup()
        )
        unheard = {"success": True, "partial": True}
        self.checks = Goals(node, CheckTrajectory, setup.action, self._check, unheard, gate.check)

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
            self._gate.check()
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
            response.error = told(error, self._node)
            return response
        planner_messages.fill_shapes(response, batch, request.arrays)
        return response

    def _check(self, goal: Any, result: Any) -> None:
        """CheckTrajectory."""
        planner_messages.fill_check(result, self._checked(goal))

    def _checked(self, goal: Any) -> TrajectoryCheck:
        """The check itself, with feedback, until the goal is cancelled."""
        setup, request = self._setup, goal.request
        asked = requests.motion(request, setup)
        feedback = Feedback(goal)

        def proceed(found: TrajectoryCheck) -> bool:
            feedback.offer(lambda: planner_messages.feedback(found))
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
    setup = PlannerSetup.from_json(given())

    def make(node: Node, gate: Gate) -> str:
        Planner(node, setup, gate)
        return f"serving {setup.service} and {setup.action}"

    return serve(setup, make)


if __name__ == "__main__":
    leave(main())
