"""The straight road: gripper poses -> ends -> predictor -> shape -> clearance -> report.

One :class:`Cycle` is called by the node, the bag replayer, the planner service and the tests alike. It knows no ROS,
no file and no viewer.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from time import perf_counter
from typing import final

from numpy.typing import ArrayLike

from cable_shape.cable import Cable
from cable_shape.clearance import ClearanceChecker
from cable_shape.errors import ArgumentError, StaleInputError
from cable_shape.pose import Grip, Pose
from cable_shape.predictor import Predictor
from cable_shape.report import Clearance, CycleReport
from cable_shape.scene import Obstacle, Scene
from cable_shape.warn import warnings_of

Ends = tuple[Pose | Grip, Pose | Grip | None]


@final
class Cycle:
    """One control cycle for one or more cables.

    Parameters
    ----------
    cables : Cable or mapping of name to Cable
        A single cable is named "cable".
    scene : Scene, optional
    robot_links : sequence of Obstacle
        Collision geometry of the robot, each with its `link` set (see ``Robot.link_geometry``).
    gripping_links : sequence of str
        Links that hold the cable; contact with them near the grips is not reported.
    model, gravity, points, tolerance
        As for :func:`cable_shape.predict`.
    """

    def __init__(
        self,
        cables: Cable | Mapping[str, Cable],
        *,
        scene: Scene | None = None,
        robot_links: Sequence[Obstacle] = (),
        gripping_links: Sequence[str] = (),
        model: str = "auto",
        gravity: ArrayLike = (0.0, 0.0, -9.81),
        points: int = 150,
        tolerance: float | None = None,
    ) -> None:
        named = {"cable": cables} if isinstance(cables, Cable) else dict(cables)
        if not named:
            raise ArgumentError("cables = {} is not allowed: there must be at least one. Give a Cable.")
        self.cables = named
        self.scene = scene or Scene()
        self.predictors = {
            name: Predictor(cable, model=model, gravity=gravity, points=points, tolerance=tolerance, scene=self.scene)
            for name, cable in named.items()
        }
        self.checkers = {
            name: ClearanceChecker(
                self.scene, radius=0.5 * cable.diameter, robot_links=robot_links, gripping_links=gripping_links
            )
            for name, cable in named.items()
        }
        self.last_stamp: int | None = None

    def step(self, grips: Mapping[str, Ends], stamp: int, links: Mapping[str, Pose] | None = None) -> CycleReport:
        """Predicts every cable in `grips` and checks it against the scene.

        Parameters
        ----------
        grips : mapping of cable name to (start, end)
            Poses or Grips in the world; end None: a free end.
        stamp : int
            [ns], must not be older than the stamp of the last step.
        links : mapping of robot link to its Pose in the world, optional
            Without it, clearance to the robot is reported as not checked.

        Raises
        ------
        StaleInputError
            If `stamp` goes backwards. `reset` forgets the last stamp (a bag that loops).
        ArgumentError
            For a cable that does not exist.
        """
        if self.last_stamp is not None and stamp < self.last_stamp:
            raise StaleInputError(
                f"stamp = {stamp} ns is {(self.last_stamp - stamp) * 1e-9:.6f} s older than the last one, "
                f"{self.last_stamp} ns. Drop it, or call reset() if the clock was set back or a bag loops."
            )
        began = perf_counter()
        shapes, ends = {}, {}
        for name, (start, end) in grips.items():
            predictor = self.predictors.get(name)
            if predictor is None:
                raise ArgumentError.of("cable", name, "no such cable", f"Known: {', '.join(self.predictors)}.")
            shapes[name] = predictor.predict(start, end)
            ends[name] = (start, end)
        predicted = perf_counter()
        clearance: dict[str, Clearance] = {}
        for name, shape in shapes.items():
            clearance[name] = self.checkers[name].check(shape, links)
        checked = perf_counter()
        warnings = tuple(
            warning
            for name, shape in shapes.items()
            for warning in warnings_of(
                name,
                self.cables[name],
                self.scene,
                shape,
                clearance[name],
                tolerance=self.predictors[name].problem.tolerance,
            )
        )
        ended = perf_counter()
        self.last_stamp = stamp
        return CycleReport(
            stamp=stamp,
            grips=ends,
            links=links,
            shapes=shapes,
            clearance=clearance,
            warnings=warnings,
            times={
                "predict": predicted - began,
                "clearance": checked - predicted,
                "warnings": ended - checked,
                "total": ended - began,
            },
            skipped={
                "reused": sum(s.reused for s in shapes.values()),
                "pairs_culled": sum(c.pairs_culled for c in clearance.values()),
            },
        )

    def reset(self) -> None:
        """Forgets the last stamp and the warm start: the next step starts afresh."""
        self.last_stamp = None
        for predictor in self.predictors.values():
            predictor.reset()
