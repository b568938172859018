"""The planner's process: service PredictShapes and action CheckTrajectory, beside the node and apart from its cycles.

    python -m cable_shape.ros.planning SETUP SERVES CLIENTS NEWS

SETUP is a descriptor of a :class:`~cable_shape.ros.workers.PlannerSetup` in JSON; for the others see
:mod:`cable_shape.ros.serving`. Standard input, by ending, ends the process. Started by
:class:`~cable_shape.ros.worker.WorkerProcess`.
"""

from __future__ import annotations

from time import perf_counter
from typing import Any, final

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.node import Node

from cable_shape.cable.cable_file import CableFile
from cable_shape.cycle.harness_ends import HarnessFile
from cable_shape.errors import ArgumentError, UnknownKeyError
from cable_shape.planning.batch import predict_batch
from cable_shape.planning.harness_batch import HarnessBatch
from cable_shape.planning.harness_trajectory import GRIPPERS
from cable_shape.planning.paths import EndsPath, JointPath, Routing
from cable_shape.planning.shape_batch import ShapeBatch
from cable_shape.planning.trajectory import check_laid, check_trajectory
from cable_shape.planning.trajectory_report import TrajectoryCheck
from cable_shape.prediction.layout import Layout, cable_id
from cable_shape.robots.robot import Robot
from cable_shape.ros import planner_messages, requests
from cable_shape.ros.following import Following
from cable_shape.ros.goals import Feedback, Goals, told
from cable_shape.ros.messages import CheckTrajectory, PredictShapes
from cable_shape.ros.serving import Gate, given, leave, news, serve
from cable_shape.ros.workers import PlannerSetup


@final
class Planner:
    """Answers requests; a check goes on beside calls of the service, of each kind one at a time.

    news: descriptor of the mailbox, see :class:`~cable_shape.ros.following.Following`.
    """

    def __init__(self, node: Node, setup: PlannerSetup, gate: Gate, news: int | None = None) -> None:
        self._node, self._setup, self._gate = node, setup, gate
        files = {name: CableFile.from_mapping(values) for name, values in setup.cables.items()}
        self._cables = tuple(files)
        robot = Robot.from_yaml(setup.robot) if setup.robot else None
        self._robots = {name: None if robot is None else robot.holding(*file.held) for name, file in files.items()}
        self._harnesses = {name: HarnessFile.from_mapping(values) for name, values in setup.harnesses.items()}
        self._robots.update(dict.fromkeys(self._harnesses, robot))
        cables, harnesses = ({name: file.cable for name, file in files.items()}, self._harnesses.items())
        made = Layout.of(setup.scene, cables, {}, {name: file.harness for name, file in harnesses})
        self._following = Following(made, news)
        node.create_service(
            PredictShapes, setup.service, self._predict, callback_group=MutuallyExclusiveCallbackGroup()
        )
        unheard = {"success": True, "partial": True}
        self.checks = Goals(node, CheckTrajectory, setup.action, self._check, unheard, gate.check)

    def _name(self, cable_id: str) -> str:
        """Of the cable that is asked for, which need not be named where it is alone."""
        known = (*self._cables, *self._harnesses)
        if not cable_id and len(known) == 1:
            return known[0]
        if cable_id not in known:
            raise UnknownKeyError.among("cable_id", cable_id, known)
        return cable_id

    def _held(self, name: str) -> Layout:
        """All as it is now, of a cable or harness that has all its grips."""
        layout = self._following.layout
        segments = layout.harnesses[name].segments if name in layout.harnesses else {}
        for one in [cable_id(name, segment) for segment in segments] or [name]:
            if opened := layout.cables[one].opened:
                bound = "an edit has opened its grip: both ends of the request are not held"
                raise ArgumentError.of(f"cable {one!r}", f"open at its {opened}", bound, "REGRIP it, and ask again.")
        return layout

    def _predict(self, request: Any, response: Any) -> Any:
        """PredictShapes."""
        setup = self._setup
        try:
            self._gate.check()
            file = self._harnesses.get(name := self._name(request.cable_id))
            layout = self._held(name)
            held, segments = ((), 1) if file is None else (tuple(file.grips), len(file.harness.segments))
            asked = requests.grasps(request, setup, held, segments)
            options: dict[str, Any] = {
                "model": request.model or setup.model, "gravity": setup.gravity,
                "points": asked.points, "tolerance": asked.tolerance, "time_limit": asked.time_limit,
            }  # fmt: skip
            batch: ShapeBatch | HarnessBatch
            if file is None:
                cable, scene = layout.cables[name].cable, layout.scene_of(name)
                batch = predict_batch(cable, asked.starts, asked.ends, scene=scene, threads=setup.threads, **options)
            else:
                tables: dict[str, Any] = {**requests.by_end(asked.starts, held), **file.free}
                kinds = {end: grip.kind for end, grip in file.grips.items()}
                harness, scene = layout.harness_of(name), layout.scene_of_harness(name)
                batch = predict_batch(harness, tables, scene=scene, kinds=kinds, **options)
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
        feedback, name = Feedback(goal), self._name(request.cable_id)
        file = self._harnesses.get(name)
        asked = requests.motion(request, setup, *(() if file is None else (tuple(file.grips), file.free)))

        def proceed(found: TrajectoryCheck) -> bool:
            feedback.offer(lambda: planner_messages.feedback(found))
            return not goal.is_cancel_requested

        robot = self._robots[name]
        options: dict[str, Any] = {"gravity": setup.gravity, "points": asked.points, "tolerance": asked.tolerance}
        if file is None:
            assert not isinstance(asked.path, EndsPath)
            ends = perf_counter() + asked.time_limit
            routing = Routing(asked.path, asked.edits)
            return check_laid(self._following.layout, name, robot, routing, ends, proceed, **options)
        layout = self._held(name)
        harness, scene = layout.harness_of(name), layout.scene_of_harness(name)
        held: dict[str, Any] | None = None
        if isinstance(asked.path, JointPath):
            held = {**dict(zip(file.grips, GRIPPERS, strict=False)), **file.free}
        limits: dict[str, Any] = {"time_limit": asked.time_limit, "proceed": proceed, "ends": held}
        return check_trajectory(harness, scene, robot, asked.path, **options, **limits)


def main() -> int:
    """Serves planners as the node asked for."""
    setup = PlannerSetup.from_json(given())

    def make(node: Node, gate: Gate) -> str:
        Planner(node, setup, gate, news())
        return f"serving {setup.service} and {setup.action}"

    return serve(setup, make)


if __name__ == "__main__":
    leave(main())
