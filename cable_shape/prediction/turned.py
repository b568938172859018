"""A cable told from its other end: :class:`TurnedPredictor`, for one whose start hangs free.

Arc lengths count from the other end then, and the cable frame has its d1, with d2 and d3 reversed. Turned twice, all is
as it was.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any, final

import numpy as np
from numpy.typing import ArrayLike

from cable_shape.cable.cable import Cable
from cable_shape.cable.section import Section
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.pose import FreeEnd, Grip, Pose
from cable_shape.prediction.predictor import Predictor
from cable_shape.prediction.solvers import Memory
from cable_shape.scene.scene import Scene
from cable_shape.shape import CableShape
from cable_shape.solve.answers import ENDS
from cable_shape.solve.problem import Problem
from cable_shape.solve.touching.crossing import Crossing
from cable_shape.solve.touching.spot import Spot

_TURN = Pose(quaternion=(1.0, 0.0, 0.0, 0.0))  #: half a turn about d1
_DARBOUX: Array = np.array((-1.0, 1.0, 1.0))  #: minus the Darboux vector, in the turned frame
_OTHER = {"start": "end", "end": "start"}

End = Pose | Grip | FreeEnd | None


def turned_cable(cable: Cable) -> Cable:
    """The same cable, told from its end."""
    sections = []
    for one in reversed(cable.sections):
        properties: dict[str, Any] = dict(one.properties)
        if properties.get("rest_curvature") is not None:
            properties["rest_curvature"] = _DARBOUX * properties["rest_curvature"]
        sections.append(Section(cable.length - one.end, cable.length - one.start, **properties))
    rest = cable.rest_curvature
    return cable.replace(
        rest_curvature=_DARBOUX * (rest if rest.ndim == 1 else rest[::-1]),
        sections=sections,
        tails={_OTHER[side]: long for side, long in cable.tails.items()},
    )


def turned_scene(scene: Scene, length: float) -> Scene:
    """What holds and surrounds a cable of this length [m], told from its end."""
    clips = [
        dataclasses.replace(
            clip, arc_length=length - clip.arc_length, pose=clip.pose * _TURN, retraction=-clip.retraction
        )
        for clip in reversed(scene.clips)
    ]
    masses = [dataclasses.replace(mass, arc_length=length - mass.arc_length) for mass in reversed(scene.masses)]
    return scene.replace(clips=clips, masses=masses, allow=(), plug=None)


def turned_end(end: End) -> Any:
    """A grip with the cable frame of the turned cable; what is free stays as it is."""
    if isinstance(end, Pose):
        return end * _TURN
    if isinstance(end, Grip):
        return Grip(end.pose, end.kind, end.offset * _TURN, end.curvature)
    return end


def turned_shape(shape: CableShape) -> CableShape:
    """The same shape, told from its end."""
    n = shape.points
    buffer = shape.buffer.copy()
    positions, curvature, force, moment = (buffer[k * n : (k + 3) * n].reshape(n, 3) for k in (1, 8, 11, 14))
    positions[:] = shape.positions[::-1]
    x, y, z, w = shape.quaternions[::-1].T
    buffer[4 * n : 8 * n].reshape(n, 4)[:] = np.stack((w, z, -y, -x), axis=1)  # q times that of `_TURN`
    curvature[:] = _DARBOUX * shape.curvature[::-1]
    force[:], moment[:] = -shape.force[::-1], -shape.moment[::-1]
    keywords: dict[str, Any] = {name: getattr(shape, name) for name in CableShape.__slots__ if name[0] != "_"}
    keywords.update(
        buffer=buffer,
        error_estimate=shape.unread_error,
        supports=_flipped(shape.supports, shape.length),
        rubbed=shape.rubbed[::-1] * (-1.0, 1.0),
        touches=_flipped(shape.touches, shape.length),
        before=None if shape.before is None else turned_shape(shape.before),
        velocity=None if shape.velocity is None else shape.velocity[::-1],
    )
    return CableShape(**keywords)


def _flipped(rows: Array, length: float) -> Array:
    """Rows that begin with an arc length [m], told from the other end."""
    out = rows[::-1].copy()
    out[:, 0] = length - out[:, 0]
    return out


@final
class TurnedPredictor:
    """As :class:`Predictor` of a cable whose start hangs free, which is held at its end.

    solo: what predicts the turned cable. Its problem, what it looks ahead with, and what it touches, are told as it
    sees them; all else as the cable was given.
    """

    def __init__(
        self, cable: Cable, *, scene: Scene, distributed_load: ArrayLike | None = None, **options: Any
    ) -> None:
        load = None if distributed_load is None else np.asarray(distributed_load, dtype=np.float64)[::-1]
        self.cable = cable
        self.solo = Predictor(
            turned_cable(cable), scene=turned_scene(scene, cable.length), distributed_load=load, **options
        )

    @staticmethod
    def told(shape: CableShape) -> CableShape:
        """A shape as `solo` tells it from one as the cable was given, and the other way round."""
        return turned_shape(shape)

    @property
    def problem(self) -> Problem:
        """Of the turned cable."""
        return self.solo.problem

    @property
    def crossing(self) -> Crossing | None:
        """See `Predictor.crossing`."""
        return self.solo.crossing

    @property
    def memory(self) -> Memory:
        """See `Predictor.memory`."""
        return self.solo.memory

    def end(self) -> None:
        """See `Predictor.end`."""
        self.solo.end()

    @property
    def rod_state(self) -> Any:
        """That of the turned cable."""
        return self.solo.rod_state

    @property
    def is_rod(self) -> bool:
        """See `Predictor.is_rod`."""
        return self.solo.is_rod

    @property
    def pairs_apart(self) -> int:
        """See `Predictor.pairs_apart`."""
        return self.solo.pairs_apart

    def move(self, start: Any, end: Any, links: Mapping[str, Pose] | None) -> None:
        """Puts the ends and the links there."""
        if isinstance(end, FreeEnd) or end is None:
            raise ArgumentError.of("end", end, "the start is open: something must hold the cable", "Give a Pose.")
        self.solo.problem.move(turned_end(end), start, links)

    def predict(
        self, start: Any, end: Any, links: Mapping[str, Pose] | None = None, *, acceleration: ArrayLike | None = None
    ) -> CableShape:
        """See `Predictor.predict`; start: None or a FreeEnd."""
        self.accelerate(acceleration)
        self.move(start, end, links)
        return self.solve()

    def accelerate(self, acceleration: ArrayLike | None) -> None:
        """See `Predictor.accelerate`."""
        if acceleration is not None:
            rows = np.asarray(acceleration, dtype=np.float64)
            acceleration = rows[::-1] if rows.ndim == 2 else rows
        self.solo.accelerate(acceleration)

    def solve(self) -> CableShape:
        """See `Predictor.solve`."""
        return turned_shape(self.solo.solve())

    def begin(
        self,
        shape: CableShape,
        ends: Any,
        links: Mapping[str, Pose] | None,
        *,
        cable: Cable | None = None,
        scene: Scene | None = None,
        loose: bool = False,
        memory: Memory = None,
        spots: list[Spot] | None = None,
    ) -> None:
        """See `Predictor.begin`; memory and spots are those of the turned cable."""
        start, end = ends
        self.solo.begin(
            turned_shape(shape),
            (turned_end(end), start),
            links,
            cable=None if cable is None else turned_cable(cable),
            scene=None if scene is None or cable is None else turned_scene(scene, cable.length),
            loose=loose,
            memory=memory,
            spots=spots,
        )

    def head_for(self, cable: Cable | None = None, scene: Scene | None = None) -> None:
        """See `Predictor.head_for`."""
        if cable is None or scene is None:
            self.solo.head_for()
        else:
            self.solo.head_for(turned_cable(cable), turned_scene(scene, cable.length))

    def leap(self, *, allowed: bool) -> None:
        """See `Predictor.leap`."""
        self.solo.leap(allowed=allowed)

    def look_again(self) -> None:
        """See `Predictor.look_again`."""
        self.solo.look_again()

    def reset(self) -> None:
        """See `Predictor.reset`."""
        self.solo.reset()

    def ahead(self) -> Callable[[Any, Any], CableShape]:
        """See `Predictor.ahead`; between ends of the turned cable."""
        predict = self.solo.ahead()
        return lambda start, end: turned_shape(predict(start, end))

    def sensitivity(self, by: Sequence[str] = ENDS, *, at: str = "cable") -> Array:
        """See `Predictor.sensitivity`."""
        return self.solo.sensitivity(tuple(_OTHER.get(name, name) for name in by), at=at)[::-1]
