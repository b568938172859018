"""What a scene is made of: :class:`Obstacle`, :class:`Clip` and :class:`PointMass`."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import count
from typing import Any, final

from cable_shape import checks
from cable_shape.errors import ArgumentError
from cable_shape.pose import IDENTITY, Pose
from cable_shape.scene.solids import SOLIDS, Solid

CLIP_KINDS = ("ball", "fixed", "hinge", "slide")


@final
@dataclass(frozen=True, slots=True)
class Obstacle:
    """A solid body, fixed in the world (`link` None) or attached to a robot link.

    pose: in the world, or in the frame of `link`. friction: Coulomb's coefficient, 0 to 10, of cables that rest on it;
    of cable and body the larger one counts.
    """

    name: str
    solid: Solid
    pose: Pose = IDENTITY
    link: str | None = None
    friction: float = 0.0

    def __post_init__(self) -> None:
        checks.word("Obstacle.name", self.name)
        checks.instance("Obstacle.solid", self.solid, SOLIDS, "Write for example Box((0.1, 0.2, 0.3)) or Sphere(0.05).")
        checks.instance("Obstacle.pose", self.pose, (Pose,), "Write Pose(position, quaternion).")
        if self.link is not None:
            checks.word("Obstacle.link", self.link)
        friction = checks.number("Obstacle.friction", self.friction, at_least=0.0, at_most=10.0)
        object.__setattr__(self, "friction", friction)


@final
@dataclass(frozen=True, slots=True)
class Clip:
    """Holds the cable at `arc_length` [m] from the start grip, with the cable frame of `pose`.

    "ball" holds the place of the material point, "fixed" its frame, "hinge" its place and d3: the cable may roll.
    "slide" is an eyelet through which the cable runs: it holds a place, `arc_length` is about which point is in it, and
    what is found is in the shape's `clips`. friction: Coulomb's coefficient, 0 to 10, of an eyelet; of cable and eyelet
    the larger one counts. retraction [N]: by which an eyelet draws the cable through itself towards its start, below 0
    towards its end, as the spring of a dress pack does. Of a scene's clips those without a `name` are "clip0",
    "clip1" and so on, in order of arc length. `segment`: of a harness, whose arc length is meant. With a `link` it is
    on that link of the robot, `pose` is in the link's frame, and it moves with the `links` that a prediction is given.
    """

    arc_length: float
    pose: Pose
    kind: str = "ball"
    name: str | None = None
    segment: str | None = None
    link: str | None = None
    friction: float = 0.0
    retraction: float = 0.0

    def __post_init__(self) -> None:
        _number(self, "arc_length", "m")
        for key in ("name", "segment", "link"):
            if getattr(self, key) is not None:
                checks.word(f"Clip.{key}", getattr(self, key))
        checks.instance("Clip.pose", self.pose, (Pose,), "Write Pose(position, quaternion).")
        checks.one_of("Clip.kind", self.kind, CLIP_KINDS)
        friction = checks.number("Clip.friction", self.friction, at_least=0.0, at_most=10.0)
        retraction = checks.number("Clip.retraction", self.retraction, unit="N")
        for key, value in (("friction", friction), ("retraction", retraction)):
            object.__setattr__(self, key, value)
            if value != 0.0 and self.kind != "slide":
                raise ArgumentError.of(
                    f"Clip.{key}",
                    value,
                    f"the cable runs through eyelets alone, and this is a {self.kind!r} clip",
                    f"Make it a 'slide' clip, or leave {key} out.",
                )
        if self.pose.turns:
            raise ArgumentError.of(
                "Clip.pose.turns",
                self.pose.turns,
                "windings are counted at the cable's end only",
                "Give the end's Pose the turns; a clip's own come from the path that led there.",
            )


def clip_names(clips: Iterable[Clip]) -> tuple[str, ...]:
    """The names of clips in ascending arc length: their own, or "clip0", "clip1" and so on for those without."""
    number = count()
    return tuple(f"clip{next(number)}" if clip.name is None else clip.name for clip in clips)


@final
@dataclass(frozen=True, slots=True)
class PointMass:
    """A connector of `mass` [kg] at `arc_length` [m] from the start grip, or the start of `segment` of a harness."""

    arc_length: float
    mass: float
    segment: str | None = None

    def __post_init__(self) -> None:
        if self.segment is not None:
            checks.word("PointMass.segment", self.segment)
        _number(self, "arc_length", "m")
        _number(self, "mass", "kg")


@final
@dataclass(frozen=True, slots=True)
class Allow:
    """Contact that is meant: of the cable with `body` (an obstacle, a robot link, another cable, or "itself").

    Clearance to it is no alarm from arc length `start` to `end` [m] from the start grip (None: from the very start, to
    the very end, tails and all) as long as the body presses there with at most `max_force` [N] in all (None: whatever
    it is), and the cable is bent there no more than its `min_bend_radius` allows.
    """

    body: str
    start: float | None = None
    end: float | None = None
    max_force: float | None = None

    def __post_init__(self) -> None:
        checks.word("Allow.body", self.body)
        for name, unit in (("start", "m"), ("end", "m")):
            value = getattr(self, name)
            object.__setattr__(self, name, checks.optional_number(f"Allow.{name}", value, unit=unit))
        force = checks.optional_number("Allow.max_force", self.max_force, above=0.0, unit="N")
        object.__setattr__(self, "max_force", force)
        if self.start is not None and self.end is not None and not self.start < self.end:
            bound = f"it must be above start, {self.start:g} m"
            raise ArgumentError.of("Allow.end", self.end, bound, "Give start and end in the order along the cable.")

    @property
    def stretch(self) -> tuple[float, float]:
        """[m], from where to where."""
        return -math.inf if self.start is None else self.start, math.inf if self.end is None else self.end


def _number(part: Any, name: str, unit: str) -> None:
    """Keeps field `name` of a frozen part as a finite float of at least 0."""
    label = f"{type(part).__name__}.{name}"
    object.__setattr__(part, name, checks.number(label, getattr(part, name), at_least=0.0, unit=unit))
