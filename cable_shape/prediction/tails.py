"""What hangs beyond the grips: :func:`predict_tails` and :class:`Tail`.

A cable longer than the span between its grips ends in two tails, each a cable of its own with one free end. A clamped
grip holds its tail as it holds the span, so that neither feels the other: span and tails together are the exact shape.
At a swivel or pinned grip the tail leaves along the span's tangent, and the moment of its weight on the span is left
out. The tail at the start runs backwards: in its own frame d1 is that of the cable, d2 and d3 are reversed.

In a scene with ``contact="solve"`` bodies and robot links keep a tail out, too, with friction and memory, and it is
kept out of itself: it is a cable like others, with a free end. Of the span and of other cables it knows nothing.
"""

from __future__ import annotations

import copy
from collections.abc import Iterable, Mapping
from typing import final

import numpy as np
from numpy.typing import ArrayLike

from cable_shape import checks
from cable_shape.cable.cable import TAIL_SIDES, Cable
from cable_shape.cable.pieces import cable_at
from cable_shape.errors import ArgumentError
from cable_shape.pose import Grip, Pose, as_grip
from cable_shape.prediction.predictor import Predictor
from cable_shape.scene.scene import Obstacle, Scene
from cable_shape.shape import CableShape
from cable_shape.solve.mesh import interpolated
from cable_shape.solve.problem import GRAVITY, MAX_POINTS, MIN_POINTS, TAIL_TOLERANCE

_BACKWARDS = Pose(quaternion=(1.0, 0.0, 0.0, 0.0))  # half a turn about d1
_FEWEST_POINTS = 12
_FEWEST_AMONG_BODIES = 30  #: what lies on something is bent in places


@final
class Tail:
    """One tail, predicted again and again.

    Parameters
    ----------
    cable : Cable
        That it is a part of.
    side : str
        "start" or "end".
    length : float
        [m], above 0.
    gravity : (3,) array_like
        [m/s^2], world.
    points : int
        Of the whole cable; a tail gets its share, but not fewer than 12, and where it may lie on bodies 30.
    own_points : int, optional
        Of the tail itself, in place of its share.
    scene, robot_links, gripping_links, time_budget
        As for :class:`Predictor`. Of the scene its bodies keep the tail out, if contact with them is solved for.
    """

    __slots__ = ("cable", "predictor", "side")

    def __init__(
        self,
        cable: Cable,
        side: str,
        length: float,
        *,
        gravity: ArrayLike = GRAVITY,
        points: int = 150,
        own_points: int | None = None,
        scene: Scene | None = None,
        robot_links: Iterable[Obstacle] = (),
        gripping_links: Iterable[str] = (),
        time_budget: float | None = None,
    ) -> None:
        self.side = checks.one_of("side", side, TAIL_SIDES)
        self.cable = tail_cable(cable, side, length)
        checks.integer("points", points, at_least=MIN_POINTS, at_most=MAX_POINTS)
        limp = cable.mean_bending_stiffness == 0.0
        among = None if limp or scene is None else _bodies_of(scene)
        fewest = _FEWEST_POINTS if among is None else _FEWEST_AMONG_BODIES
        share = max(fewest, round(points * self.cable.length / cable.length))
        self.predictor = Predictor(
            self.cable,
            model="catenary" if limp else "cosserat",
            gravity=gravity,
            points=share if own_points is None else own_points,
            tolerance=TAIL_TOLERANCE * self.cable.length,
            scene=among,
            robot_links=() if among is None else robot_links,
            gripping_links=() if among is None else gripping_links,
            time_budget=time_budget,
        )

    @property
    def lies(self) -> bool:
        """Whether there is something that it may lie on, the robot's links or itself."""
        return self.predictor.scene is not None

    def predict(self, frame: Pose, links: Mapping[str, Pose] | None = None) -> CableShape:
        """The tail at a grip whose cable frame is `frame`; arc length counts from the grip outwards.

        links: where the robot's are, see :meth:`Predictor.predict`.
        """
        return self.predictor.predict(self._own(frame), None, links)

    def begin(self, shape: CableShape, frame: Pose, links: Mapping[str, Pose] | None) -> None:
        """Goes on from a shape at a grip with this cable frame, with the links there."""
        self.predictor.begin(_spread(shape, self.predictor.problem.points), (self._own(frame), None), links)

    def _own(self, frame: Pose) -> Pose:
        """The frame in which it begins."""
        return frame * _BACKWARDS if self.side == "start" else frame

    def twin(self) -> Tail:
        """Once more: it goes on from the last shape, and this one stays as it is."""
        other = copy.copy(self)
        other.predictor = self.predictor.twin()
        return other

    def along(self, arc_length: float, length: float) -> float:
        """Arc length [m] on the tail as that of a span of `length` [m]: negative, or beyond the length."""
        first, way = runs(self.side, length)
        return first + way * arc_length

    def reset(self) -> None:
        """Forgets the last solution."""
        self.predictor.reset()


def runs(side: str, length: float) -> tuple[float, float]:
    """Where on a span of `length` [m] the tail at this side begins, and whether it runs on (1) or back (-1)."""
    return (0.0, -1.0) if side == "start" else (length, 1.0)


def _spread(shape: CableShape, points: int) -> CableShape:
    """The shape at so many points."""
    n = shape.points
    if n == points:
        return shape
    at, own = np.linspace(0.0, 1.0, points), np.linspace(0.0, 1.0, n)
    out, first = CableShape.new_buffer(points), 0
    for size in (1, 3, 4, 3, 3, 3):  # see `CableShape`
        rows = shape.buffer[first * n : (first + size) * n].reshape(n, size)
        if size == 4:
            found = interpolated(at, own, rows)
        else:
            found = np.stack([np.interp(at, own, column) for column in rows.T], axis=1)
        out[first * points : (first + size) * points] = found.ravel()
        first += size
    other = shape.again()
    other.buffer, other.points = out, points
    return other


def _bodies_of(scene: Scene) -> Scene | None:
    """What of a scene a tail may lie on; None if contact is not solved for."""
    return Scene(obstacles=scene.obstacles, contact="solve") if scene.contact == "solve" else None


def tail_cable(cable: Cable, side: str, length: float) -> Cable:
    """The tail as a cable of its own: the same material, its rest curvature as at that end of the cable."""
    cable = cable_at(cable, 0.0 if side == "start" else cable.length)
    table = cable.rest_curvature.reshape(-1, 3)
    if side == "start":
        u1, u2, u3 = table[0]
        rest = (-u1, u2, u3)  # minus the Darboux vector, in the reversed frame
    else:
        rest = tuple(table[-1])
    return cable.replace(length=length, rest_curvature=rest, tails=None)


def predict_tails(
    cable: Cable,
    start: Pose | Grip,
    end: Pose | Grip | None,
    tails: Mapping[str, float] | None = None,
    *,
    gravity: ArrayLike = GRAVITY,
    points: int = 150,
    scene: Scene | None = None,
    links: Mapping[str, Pose] | None = None,
) -> dict[str, CableShape]:
    """The tails of a cable held by two grips, solved once from nothing; the keys are "start" and "end".

    Parameters
    ----------
    start, end : Pose or Grip
        Their cable frames hold the tails. A free end (None) has none.
    tails : mapping of "start" and "end" to a length [m], optional
        Default: those of the cable.
    scene : Scene, optional
        With ``contact="solve"`` its bodies keep the tails out.
    links : mapping of robot link to its Pose in the world, optional
        Where bodies on links are; without it these are left out.

    Raises
    ------
    ArgumentError
        For a length that is not above 0, or a tail at an end that nothing holds.
    """
    checks.instance("cable", cable, (Cable,), "Write Cable(length=..., ...).")
    lengths = dict(cable.tails) if tails is None else checks.mapping("tails", tails, TAIL_SIDES, "Write {end: 0.1}.")
    shapes = {}
    for side, length in lengths.items():
        grip = start if side == "start" else end
        if grip is None:
            raise ArgumentError.of(f"tails.{side}", length, "nothing holds this end", "Lengthen the cable instead.")
        frame = as_grip(side, grip).cable_frame
        shapes[side] = Tail(cable, side, length, gravity=gravity, points=points, scene=scene).predict(frame, links)
    return shapes


def held_frame(grip: Pose | Grip, shape: CableShape, side: str) -> Pose:
    """The cable frame at an end of the span, from which the tail hangs: that of the grip, turned where it lets go."""
    if isinstance(grip, Pose):
        return grip
    if grip.kind == "clamped":
        return grip.cable_frame
    return Pose(grip.cable_frame.position, shape.quaternions[0 if side == "start" else -1])
