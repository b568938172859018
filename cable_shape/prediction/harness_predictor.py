"""From ends to the shape of a harness: :class:`HarnessPredictor`."""

from __future__ import annotations

import math
from collections.abc import Mapping
from time import perf_counter
from typing import Any, final

from numpy.typing import ArrayLike

from cable_shape import checks
from cable_shape.cable.harness import Harness
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.pose import FreeEnd, Grip
from cable_shape.prediction.reuse import same_end
from cable_shape.scene.scene import Scene
from cable_shape.solve import harness_search
from cable_shape.solve.answers import about_gripper
from cable_shape.solve.harness_network import HarnessNetwork
from cable_shape.solve.harness_problem import End, HarnessProblem
from cable_shape.solve.harness_shape import HarnessShape
from cable_shape.solve.problem import GRAVITY

MODELS = ("cosserat", "auto")


@final
class HarnessPredictor:
    """Predicts one harness's shape again and again, each time starting from the last solution.

    What ``Predictor(harness)`` makes. Parameters are those of :class:`cable_shape.Predictor` but for these:

    harness : Harness
    model : str
        "cosserat" or "auto", which is the same.
    points : int
        Of each segment.
    tolerance : float, optional
        [m]; default 1e-5 of the longest segment.
    scene : Scene, optional
        Clips and masses name their `segment`. Contact is not solved for.
    distributed_load : mapping of segment to (2, 3) array_like, optional
        [N/m], world, added to the weight.

    Raises
    ------
    ArgumentError
        Naming the value, the bound and the remedy.
    """

    def __init__(
        self,
        harness: Harness,
        *,
        model: str = "auto",
        gravity: ArrayLike = GRAVITY,
        points: int = 150,
        tolerance: float | None = None,
        scene: Scene | None = None,
        distributed_load: Mapping[str, ArrayLike] | None = None,
        time_budget: float | None = None,
    ) -> None:
        self.model = checks.one_of("model", model, MODELS)
        checks.optional_number("time_budget", time_budget, above=0.0, unit="s")
        self.time_budget = math.inf if time_budget is None else float(time_budget)
        self._keywords: dict[str, Any] = {
            "gravity": gravity, "points": points, "tolerance": tolerance, "distributed_load": distributed_load,
        }  # fmt: skip
        self.problem = self._still = HarnessProblem(harness, scene=scene, **self._keywords)
        self._state: HarnessNetwork | None = None
        self._last: HarnessShape | None = None
        self._last_ends: dict[str, Grip | FreeEnd] = {}

    @property
    def harness(self) -> Harness:
        """The harness, as given."""
        return self.problem.harness

    @property
    def scene(self) -> Scene | None:
        """The scene; setting it keeps the warm start where its clips hold the same points."""
        return self.problem.scene

    @scene.setter
    def scene(self, scene: Scene | None) -> None:
        before = self.problem
        self._still = HarnessProblem(before.harness, scene=scene, **self._keywords)
        self._still.ends = before.ends
        self._load(self._still)

    @property
    def grips(self) -> tuple[str, ...]:
        """Names of the ends held at the last prediction, in the order of the segments: those of `sensitivity`."""
        return self.problem.grips

    def predict(self, ends: Mapping[str, End], *, acceleration: Mapping[str, ArrayLike] | None = None) -> HarnessShape:
        """The shape between these ends; never raises for a physical reason: look at `status`.

        Parameters
        ----------
        ends : mapping of open end to Pose, Grip or FreeEnd
            "a.start" or "a.end"; a bare Pose is clamped, ends not named are free.
        acceleration : mapping of segment to (3,) or (m, 3) array_like, optional
            [m/s^2], world, of the segment, uniform in arc length, linear between the rows; segments not named are at
            rest. For this prediction only; `energy` leaves it out.

        Raises
        ------
        ArgumentError
            For an end that does not exist or is in a junction, a part of the harness that nothing holds, other wrong
            arguments.
        """
        if acceleration is not None:
            problem = self._still.moving(acceleration)
            problem.ends, problem._given = self.problem.ends, self.problem._given
            self._load(problem)
        elif self.problem is not self._still:
            self._still.ends, self._still._given = self.problem.ends, self.problem._given
            self._load(self._still)
        problem = self.problem.move(ends)
        last = self._last_ends
        if self._last is not None and all(same_end(last[name], end) for name, end in problem.ends.items()):
            return self._last.again()
        deadline = math.inf if self.time_budget == math.inf else perf_counter() + self.time_budget
        shape, self._state = harness_search.solve(problem, self._state, deadline=deadline)
        self._last, self._last_ends = shape, dict(problem.ends)
        return shape

    def reset(self) -> None:
        """Forgets the last solution: the next one starts cold."""
        self._state = self._last = None

    def sensitivity(self, *, at: str = "cable") -> dict[str, Array]:
        """{segment: (points, 3, 6 g)}: how the centrelines move with the g held ends, in the order of `grips`.

        Six columns a grip: d positions at fixed arc length / d (vx vy vz [m/s] wx wy wz [rad/s]), world axes, rotation
        about that end, or with ``at="gripper"`` about the gripper's own origin. Of the last solved shape, exact.

        Raises
        ------
        ArgumentError
            If nothing was predicted yet.
        """
        checks.one_of("at", at, ("cable", "gripper"))
        state = self._state
        if state is None or state.history == 0:
            raise ArgumentError("sensitivity() needs a solution, and there is none yet. Call predict first.")
        grips = self.grips
        out = state.sensitivities(grips)
        if at == "gripper":
            for i, name in enumerate(grips):
                end = self.problem.ends[name]
                assert isinstance(end, Grip)
                about_gripper(end, out[:, :, 6 * i : 6 * i + 6])
        points = self.problem.points
        return {name: out[i * points : (i + 1) * points] for i, name in enumerate(self.harness.segments)}

    def _load(self, problem: HarnessProblem) -> None:
        """Makes this the problem, whose loads may be others."""
        self.problem = problem
        self._last = None
