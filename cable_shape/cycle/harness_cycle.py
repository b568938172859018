"""What a cycle does for one harness: predict it, and check every segment against the scene."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, final

from numpy.typing import ArrayLike

from cable_shape.cable.harness import Harness, split_end
from cable_shape.pose import Pose
from cable_shape.prediction.harness_predictor import HarnessPredictor
from cable_shape.safety.clearance import ClearanceChecker
from cable_shape.safety.margins import MarginWatch
from cable_shape.safety.report import CableWarning, Clearance, Margin
from cable_shape.safety.warnings import Standing, warnings_of
from cable_shape.scene.scene import Obstacle, Scene
from cable_shape.shape import CableShape
from cable_shape.solve.harness_problem import End
from cable_shape.solve.harness_shape import HarnessShape

Links = Mapping[str, Pose] | None


def cable_id(name: str, segment: str) -> str:
    """What a segment of a harness is called in reports and messages: "harness/segment"."""
    return f"{name}/{segment}"


def beside_each_other(name: str, harness: Harness) -> set[frozenset[str]]:
    """Pairs of segments, by their ids, that meet in a junction: their clearance there is no clearance."""
    out = set()
    for junction in harness.junctions:
        ids = {cable_id(name, end.rpartition(".")[0]) for end in junction.ends}
        out |= {frozenset((a, b)) for a in ids for b in ids if a != b}
    return out


@final
class HarnessCycle:
    """One harness, cycle by cycle. Parameters are those of :class:`cable_shape.Cycle`."""

    def __init__(
        self,
        name: str,
        harness: Harness,
        scene: Scene,
        robot_links: Sequence[Obstacle],
        gripping_links: Sequence[str],
        options: Mapping[str, Any],
    ) -> None:
        self.name, self.scene = name, scene
        self.predictor = HarnessPredictor(harness, scene=scene, **options)
        self.cables = {cable_id(name, segment): cable for segment, cable in harness.segments.items()}
        may_be_held = {cable_id(name, split_end(end)[0]) for end in harness.open_ends}
        self._checkers = {
            one: ClearanceChecker(
                scene,
                cable=cable,
                robot_links=robot_links,
                gripping_links=gripping_links if one in may_be_held else (),
            )
            for one, cable in self.cables.items()
        }
        gravity = self.predictor.problem.gravity
        self._watches = {one: MarginWatch(cable, scene, gravity=gravity) for one, cable in self.cables.items()}
        self._standing = {one: Standing(scene) for one in self.cables}

    def reset(self) -> None:
        """Forgets everything from before."""
        self.predictor.reset()
        for watch in self._watches.values():
            watch.reset()
        for standing in self._standing.values():
            standing.reset()

    def predict(self, ends: Mapping[str, End], acceleration: Mapping[str, ArrayLike] | None) -> HarnessShape:
        """The shape of the harness."""
        return self.predictor.predict(ends, acceleration=acceleration)

    def parts(self, shape: HarnessShape) -> dict[str, CableShape]:
        """The shapes of the segments, by their ids."""
        return {cable_id(self.name, segment): one for segment, one in shape.segments.items()}

    def check(self, shapes: Mapping[str, CableShape], links: Links) -> dict[str, Clearance]:
        """The clearance of every segment."""
        if self.scene.contact == "off":
            return {one: Clearance(beyond=0.0, robot_checked=links is not None) for one in shapes}
        return {one: self._checkers[one].check(shape, links) for one, shape in shapes.items()}

    def margins(
        self, shapes: Mapping[str, CableShape], clearance: Mapping[str, Clearance], stamp: int
    ) -> dict[str, tuple[Margin, ...]]:
        """How far trouble is of every segment, without stability; times from the last two cycles."""
        return {one: self._watches[one].margins(shape, clearance[one], stamp) for one, shape in shapes.items()}

    def warnings(
        self,
        shapes: Mapping[str, CableShape],
        clearance: Mapping[str, Clearance],
        margins: Mapping[str, tuple[Margin, ...]],
    ) -> list[CableWarning]:
        """What to say of every segment."""
        tolerance = self.predictor.problem.tolerance
        return [
            warning
            for one, shape in shapes.items()
            for warning in warnings_of(
                one,
                self.cables[one],
                self.scene,
                shape,
                clearance[one],
                tolerance=tolerance,
                margins=margins[one],
                standing=self._standing[one],
                period=self._watches[one].period,
            )
        ]
