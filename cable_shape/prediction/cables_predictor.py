"""Several cables in one scene, from their grips to their shapes: :class:`CablesPredictor`."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Mapping, Sequence
from typing import Any, final

import numpy as np
from numpy.typing import ArrayLike

from cable_shape import checks
from cable_shape.cable.cable import Cable
from cable_shape.cable.harness import Harness
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.pose import Ends, FreeEnd, Grip, Pose
from cable_shape.prediction.harness_predictor import HarnessPredictor
from cable_shape.prediction.predictor import Predictor
from cable_shape.prediction.together import by_strand, join, joined, moved_with, names_of, rows_of, strands_of, told_of
from cable_shape.scene.scene import Clip, Scene
from cable_shape.shape import CableShape
from cable_shape.solve.answers import ENDS, Solved, sensitivity
from cable_shape.solve.harness_shape import HarnessShape
from cable_shape.solve.touching.crossing import Crossing
from cable_shape.solve.touching.told import ITSELF

_REMEDY = "Write {name of the cable: ..}."
_HELD, _ENDS = (Pose, Grip), (Pose, Grip, FreeEnd)


def check_models(predictors: Mapping[str, Predictor | HarnessPredictor], scene: Scene) -> None:
    """Only the rod rests on other cables."""
    for name, predictor in predictors.items():
        if isinstance(predictor, Predictor) and not predictor.is_rod:
            raise ArgumentError.of(
                "scene.contact", scene.contact, f"the model of cable {name!r} knows no contact with other cables",
                "Write contact='warn', or choose model='cosserat' and a bending stiffness above 0 N m^2.",
            )  # fmt: skip


def accelerate(name: str, predictor: Any, acceleration: ArrayLike | None) -> None:
    """Tells how a cable moves; what is refused is said to be this cable's."""
    try:
        predictor.accelerate(acceleration)
    except ArgumentError as error:
        raise ArgumentError(f"acceleration[{name!r}]: {error}") from None


def check_ends(name: str, ends: Any, opened: str = "") -> None:
    """Refuses what is no pair of ends; opened: the one that nothing holds, "start" or "end", if any."""
    if not isinstance(ends, (tuple, list)) or len(ends) != 2:
        raise ArgumentError.of(f"grips[{name!r}]", ends, "it must be (start, end)", "Write (Pose(...), Pose(...)).")
    start, end = ends
    if opened == "start" and not isinstance(end, _HELD):
        bound = "the start is open: something must hold the cable"
        raise ArgumentError.of(f"grips[{name!r}][1]", end, bound, "Write Pose(position, ..).")
    if not isinstance(start, _HELD) and not (opened == "start" and isinstance(start, (FreeEnd, type(None)))):
        raise ArgumentError.of(f"grips[{name!r}][0]", start, "it must be a Pose or a Grip", "Write Pose(position, ..).")
    if end is not None and not isinstance(end, _ENDS):
        bound = "it must be a Pose, a Grip, a FreeEnd or None"
        raise ArgumentError.of(f"grips[{name!r}][1]", end, bound, "Write Pose(position, quaternion).")


def lies_on_itself(shape: CableShape) -> bool:
    """Whether a cable touches itself."""
    return any(contact.body == ITSELF for contact in shape.contacts)


def named_cables(cables: object) -> dict[str, Cable]:
    """Cables by their names, one at least."""
    found: dict[str, Any] = named_parts(cables, (Cable,))
    return found


def named_parts(cables: object, kinds: tuple[type, ...] = (Cable, Harness)) -> dict[str, Cable | Harness]:
    """Cables and harnesses by their names, one at least."""
    checks.instance("cables", cables, (Mapping,), "Write {name: Cable(...)}.")
    assert isinstance(cables, Mapping)
    if not cables:
        raise ArgumentError("cables = {} is not allowed: there must be at least one. Give a Cable.")
    for name, cable in cables.items():
        checks.word("cables", name)
        remedy = "Write Cable(length=..., ...)."
        if Harness not in kinds:
            remedy = "Write Cable(length=..., ...); a harness is calibrated by itself, where it touches no cable."
        checks.instance(f"cables[{name!r}]", cable, kinds, remedy)
    return dict(cables)


def of_all(where: str, told: object, names: Mapping[str, object], remedy: str) -> dict[str, Any]:
    """What is told of every cable by its name; none may be missing."""
    if told is None:
        raise ArgumentError.of(where, None, "it must be a mapping", remedy)
    given: dict[str, Any] = checks.mapping(where, told, names, remedy)
    for name in names:
        if name not in given:
            raise ArgumentError.of(where, sorted(given), f"cable {name!r} is missing", remedy)
    return {name: given[name] for name in names}


@final
class CablesPredictor:
    """Predicts the shapes of several cables again and again, each time starting from the last ones.

    With ``contact="solve"`` they are kept out of each other and of themselves; otherwise each is by itself. Parameters
    are those of :class:`cable_shape.Predictor` but for these:

    cables : mapping of name to Cable or Harness
        Of a harness ends, accelerations and shapes are as of a :class:`HarnessPredictor`; `onto`, `begin` and `wound`
        are of cables alone.
    clips : mapping of cable name to sequence of Clip, optional
        What holds that cable, in place of the scene's `clips`, which hold every cable.
    distributed_load : (2, 3) array_like or mapping of cable name to (2, 3) array_like, optional
        [N/m], one for all cables, or each its own; of a harness by segment.
    """

    def __init__(
        self,
        cables: Mapping[str, Cable | Harness],
        *,
        scene: Scene | None = None,
        clips: Mapping[str, Sequence[Clip]] | None = None,
        distributed_load: ArrayLike | Mapping[str, ArrayLike] | None = None,
        **options: Any,
    ) -> None:
        named = named_parts(cables)
        if scene is not None:
            checks.instance("scene", scene, (Scene,), "Write Scene(obstacles=[...]), or Scene.from_yaml(path).")
        own_clips = checks.mapping("clips", clips, named, _REMEDY)
        if isinstance(distributed_load, Mapping):
            loads: dict[str, Any] = checks.mapping("distributed_load", distributed_load, named, _REMEDY)
        else:
            loads = dict.fromkeys(named, distributed_load)
        self.scene = scene or Scene()
        self.scenes: dict[str, Scene] = {}
        #: Keywords of each cable's own Predictor but for model and tolerance.
        self.options: dict[str, dict[str, Any]] = {}
        predictors: dict[str, Any] = {}
        model, tolerance = options.pop("model", "auto"), options.pop("tolerance", None)
        for name, cable in named.items():
            own = dataclasses.replace(self.scene, clips=own_clips[name]) if name in own_clips else self.scene
            self.scenes[name] = own
            self.options[name] = {**options, "scene": own, "distributed_load": loads.get(name)}
            try:
                made: Any = HarnessPredictor if isinstance(cable, Harness) else Predictor
                predictors[name] = made(cable, model=model, tolerance=tolerance, **self.options[name])
            except ArgumentError as error:
                raise type(error)(f"cable {name!r}: {error}") from None
        self._moving: dict[str, Any] = {}  # accelerations of the last shapes
        self._take(predictors)

    def _take(self, predictors: dict[str, Any], crossing: Crossing | None = None) -> None:
        """Makes these the cables' own predictors."""
        self.predictors = predictors
        self._rows = rows_of(predictors)
        if all(predictor.problem.solves_crossing for predictor in predictors.values()):
            check_models(predictors, self.scene)
            if crossing is None:
                crossing = joined(predictors)
        self._crossing = crossing

    @property
    def solves_crossing(self) -> bool:
        """Whether cables are kept out of each other."""
        return self._crossing is not None

    @property
    def touching(self) -> frozenset[str]:
        """The cables that the last shapes have been solved for together, for they touch each other or themselves."""
        held = frozenset() if self._crossing is None else self._crossing.touching
        return frozenset(name for name, own in self._rows.items() if own[0] in held)

    def predict(
        self,
        grips: Mapping[str, Ends],
        links: Mapping[str, Pose] | None = None,
        *,
        acceleration: Mapping[str, ArrayLike] | None = None,
    ) -> dict[str, Any]:
        """The shapes between these ends, of all the cables; never raises for a physical reason: look at `status`.

        grips, links, acceleration: as of :meth:`cable_shape.Cycle.step`.
        """
        self._move(grips, links, acceleration)
        if self._crossing is None:
            return {
                name: one.solve() if isinstance(one, HarnessPredictor) else one.alone()
                for name, one in self.predictors.items()
            }
        return told_of(self.predictors, self._crossing.solve())

    def overlapping(self, shapes: Mapping[str, CableShape | HarnessShape]) -> bool:
        """Whether these shapes overlap each other or themselves; never, where cables are not kept out of each other."""
        strands = [one for name in self.predictors for one in by_strand(name, shapes[name]).values()]
        return self._crossing is not None and self._crossing.overlap(strands)

    def wound(self, seen: Mapping[str, CableShape]) -> frozenset[str]:
        """The cables that touch another one or themselves, or nearly do, in shapes as they were seen."""
        close = set[int]() if self._crossing is None else self._crossing.close([seen[name] for name in self.predictors])
        return frozenset(name for i, name in enumerate(self.predictors) if i in close)

    def begin(
        self,
        grips: Mapping[str, Ends],
        seen: Mapping[str, CableShape],
        *,
        more: Collection[str] = (),
        acceleration: Mapping[str, ArrayLike] | None = None,
    ) -> dict[str, CableShape]:
        """Where the cables come to rest from shapes as they were seen, between these ends; see `Crossing.begin`."""
        self._move(grips, None, acceleration)
        if self._crossing is None:
            return {name: predictor.alone() for name, predictor in self.predictors.items()}
        names = list(self.predictors)
        found = self._crossing.begin([seen[name] for name in names], [names.index(name) for name in more])
        return dict(zip(names, found, strict=True))

    def _move(
        self,
        grips: Mapping[str, Ends],
        links: Mapping[str, Pose] | None,
        acceleration: Mapping[str, ArrayLike] | None,
    ) -> None:
        """Puts the ends and links there, and tells how the cables move."""
        ends = of_all("grips", grips, self.predictors, "Write {name of the cable: (start, end)} of every cable.")
        self._moving = checks.mapping("acceleration", acceleration, self.predictors, _REMEDY)
        for name, predictor in self.predictors.items():
            if isinstance(predictor, HarnessPredictor):
                predictor.move(ends[name], links, self._moving.get(name))
                continue
            check_ends(name, ends[name])
            accelerate(name, predictor, self._moving.get(name))
            start, end = ends[name]
            predictor.problem.move(start, end, links)

    def onto(self, cables: Mapping[str, Cable]) -> CablesPredictor:
        """Of cables almost alike, by the same names: it goes on from the last shapes, and this one stays as it is.

        Tell it the ends before anything is solved for.
        """
        other = object.__new__(CablesPredictor)
        other.scene, other.scenes, other.options = self.scene, self.scenes, self.options
        predictors = {name: predictor.onto(cables[name]) for name, predictor in self.predictors.items()}
        other._moving = self._moving
        for name, predictor in predictors.items():
            before = self.predictors[name].problem
            accelerate(name, predictor, self._moving.get(name))
            predictor.problem.move(before.start, before.end, before.links)
        crossing = None
        if self._crossing is not None:
            crossing = self._crossing.among(strands_of(predictors))
            join(crossing, predictors)
        other._take(predictors, crossing)
        return other

    def reset(self) -> None:
        """Forgets the last shapes: the next ones are found from nothing."""
        if self._crossing is not None:
            self._crossing.reset()
        for predictor in self.predictors.values():
            predictor.reset()

    def state_of(self, name: str, told: str | None = None) -> Solved | None:
        """What has solved for a cable; told: the one whose answers to that cable are asked for, None if it has none."""
        if told is not None and told != name:
            rows = self._rows[name][0], self._rows[told][0]
            return None if self._crossing is None else self._crossing.state_of(*rows)
        state: Solved | None = self.predictors[name].rod_state
        return state

    def sensitivity(self, *, by_clips: bool = False) -> dict[str, Array]:
        """{cable: (n, 3, 12 k)}: how the centrelines move with the ends of all k cables, in their order, start and end.

        Six columns an end, world axes, as of :meth:`cable_shape.Predictor.sensitivity`. by_clips: after those of a
        cable's ends come those of its clips on robot links. Of a harness it is {"harness/segment": ..}, and its columns
        are those of its grips, see `HarnessPredictor.sensitivity`.
        """
        out = {}
        for told, predictor in self.predictors.items():
            blocks = [self._moved(told, name, by_clips=by_clips) for name in self.predictors]
            columns, points = np.concatenate(blocks, axis=2), predictor.problem.points
            for i, strand in enumerate(names_of(told, predictor)):
                out[strand] = columns[i * points : (i + 1) * points]
        return out

    def _moved(self, told: str, name: str, *, by_clips: bool) -> Array:
        """(s n, 3, 6 m): how one moves with what holds another, or with what holds it."""
        predictor, other = self.predictors[told], self.predictors[name]
        if told == name and isinstance(predictor, HarnessPredictor):
            return np.concatenate(list(predictor.sensitivity(by_clips=by_clips).values()))
        if isinstance(predictor, HarnessPredictor) or isinstance(other, HarnessPredictor):
            return moved_with(self._crossing, self._rows[told], other, self._rows[name][0], by_clips=by_clips)
        state = self.state_of(name, told)
        by = (*ENDS, *(other.problem.moving_clips[0] if by_clips else ()))
        return np.zeros((predictor.problem.points, 3, 6 * len(by))) if state is None else sensitivity(state, by)
