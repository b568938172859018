"""The node's side of the planner: a process of its own, started, watched, started again: :class:`PlannerProcess`.

That process is a ROS node, too (:mod:`cable_shape.ros.planning`), so that neither the work nor the megabytes of an
answer pass through the process that runs the cycles.
"""

from __future__ import annotations

import contextlib
import os
import pickle
import subprocess
import sys
import time
from dataclasses import dataclass
from typing import Any, final

from rclpy.node import Node

from cable_shape.cycle import Cycle
from cable_shape.ros.parameters import Settings, find_file
from cable_shape.scene import Scene

SERVICE, ACTION = "cable/predict_shapes", "cable/check_trajectory"
_GRACE = 1.0  # s, between asking the process to end and ending it
_FIRST_WAIT, _LONGEST_WAIT = 1.0, 60.0  # s, before a start after an end; twice as long after each that was soon
_SOON = 30.0  # s, a process that ends sooner after its start has not got over it
_TOLD = 10.0  # s, an end stays in the diagnostics for so long


@final
@dataclass(frozen=True, slots=True)
class PlannerSetup:
    """What the planner's process needs to know; names are absolute, after the node's own remapping."""

    name: str
    namespace: str
    service: str
    action: str
    cables: dict[str, dict[str, Any]]  # keywords of Cable
    scene: Scene
    robot: str  # path of the robot's YAML file; empty: none
    model: str
    gravity: tuple[float, float, float]  # m/s^2
    points: int
    tolerance: float  # m, 0: the default of each call
    rows: int  # grasps or waypoints in one request, at most
    threads: int
    time_limit: float  # s


def start_planner(node: Node, settings: Settings, cycle: Cycle) -> PlannerProcess | None:
    """The planner beside `node`, for what its cycles run with; None if it is not asked for."""
    if not settings.planner:
        return None
    cores = len(os.sched_getaffinity(0))
    return PlannerProcess(
        PlannerSetup(
            name=f"{node.get_name()}_planner",
            namespace=node.get_namespace(),
            service=node.resolve_service_name(SERVICE),
            action=node.resolve_topic_name(ACTION),
            cables={name: cable.as_dict() for name, cable in cycle.cables.items()},
            scene=cycle.scene,
            robot=str(find_file(settings.robot_file).resolve()) if settings.robot_file else "",
            model=settings.model,
            gravity=settings.gravity,
            points=settings.points,
            tolerance=settings.tolerance,
            rows=settings.planner_rows,
            threads=settings.planner_threads or max(1, cores - 1),
            time_limit=settings.planner_time_limit,
        )
    )


@final
class PlannerProcess:
    """Runs :mod:`cable_shape.ros.planning` until it is closed; the process ends with its caller in whatever way."""

    def __init__(self, setup: PlannerSetup) -> None:
        self._papers = os.memfd_create("cable_shape_planner_setup", os.MFD_CLOEXEC)
        with open(self._papers, "wb", closefd=False) as file:
            pickle.dump(setup, file)
        self.ends = 0  # how often the process has ended by itself
        self._wait = _FIRST_WAIT
        self._ended: float | None = None  # when it was seen that the process is gone; None: it runs
        self._text, self._told = "", 0.0
        self._start()

    @property
    def pid(self) -> int:
        """Of the planner's process."""
        return self._process.pid

    def revived(self) -> str:
        """Starts the process again if it has ended; a text about an end that was not long ago, else an empty one.

        To be called about once a second.
        """
        now = time.monotonic()
        if self._ended is None and self._process.poll() is not None:
            self._ended = now
            self._tell(now)
        elif self._ended is not None and now - self._ended >= self._wait:
            self._release()
            self._start()
        return self._text if self._ended is not None or now - self._told < _TOLD else ""

    def close(self) -> None:
        """Ends the process; calls under way get no answer."""
        self._release()
        for end in (None, self._process.terminate, self._process.kill):
            if self._process.poll() is None:
                if end is not None:
                    end()
                with contextlib.suppress(subprocess.TimeoutExpired):
                    self._process.wait(_GRACE)
        os.close(self._papers)

    def _start(self) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-m", "cable_shape.ros.planning", str(self._papers)],
            stdin=subprocess.PIPE,  # by ending, it ends the process
            pass_fds=(self._papers,),
            process_group=0,  # Ctrl-C ends the caller, which closes the pipe
        )
        self._started, self._ended = time.monotonic(), None

    def _release(self) -> None:
        """Closes the pipe."""
        assert self._process.stdin is not None
        self._process.stdin.close()

    def _tell(self, now: float) -> None:
        self.ends += 1
        soon = now - self._started < _SOON
        self._wait = min(2.0 * self._wait, _LONGEST_WAIT) if soon and self.ends > 1 else _FIRST_WAIT
        code = self._process.returncode
        how = f"by signal {-code}" if code < 0 else f"with exit code {code}"
        self._told = now
        self._text = (
            f"the planner's process has ended {how} ({self.ends} times so far): requests under way get no answer. "
            f"It is started again after {self._wait:g} s; the cycles go on. If it ends again, read the log, and ask "
            "for fewer rows or points in one request."
        )
