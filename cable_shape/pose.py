"""Where the cable's ends are: :class:`Pose`, :class:`Grip` and :class:`FreeEnd`.

World z is up. A quaternion is x, y, z, w. The cable frame is right-handed with d3 = tangent in the direction of
increasing arc length, so at both ends it points along the cable from start to end.
"""

from __future__ import annotations

import math
from typing import Any, final

import numpy as np
from numpy.typing import ArrayLike

from cable_shape import checks
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.kernels.poses import compose

GRIP_KINDS = ("clamped", "swivel", "pinned")


#: In place of an end that was not named.
NOT_GIVEN: Any = object()


def both_given(call: str, end: object, name: str = "end") -> None:
    """Refuses a cable's start alone: a harness has its ends in one mapping."""
    if end is NOT_GIVEN:
        raise ArgumentError(f"{name} is missing. Write {call}; None is a free end.")


def one_mapping(ends: object, more: tuple[object, ...]) -> None:
    """Refuses a start and an end in place of the one mapping of a harness."""
    if more:
        raise ArgumentError.of(
            "ends", (ends, *more), "the ends of a harness are one mapping", "Write {'a.start': Pose(...)}."
        )


def rotate(q: Array, v: Array) -> Array:
    """`v` (3,) turned by the unit quaternion `q` (x, y, z, w)."""
    x, y, z, w = q
    a, b, c = v
    # t = 2 u x v;  v + w t + u x t
    tx, ty, tz = 2.0 * (y * c - z * b), 2.0 * (z * a - x * c), 2.0 * (x * b - y * a)
    return np.array(
        (a + w * tx + y * tz - z * ty, b + w * ty + z * tx - x * tz, c + w * tz + x * ty - y * tx), dtype=np.float64
    )


def between(p: Array, q: Array, x: float) -> Array:
    """The pose (7,) at the fraction x of the straight way and the shortest turn from p (7,) to q."""
    if x == 0.0 or x == 1.0:
        return p if x == 0.0 else q
    cosine = float(p[3:] @ q[3:])
    if cosine < 0.0:
        q = np.concatenate((q[:3], -q[3:]))
    out = (1.0 - x) * p + x * q
    angle = math.acos(min(1.0, abs(cosine)))
    if angle > 1e-6:  # below, straight within angle^3 / 6
        out[3:] = (math.sin((1.0 - x) * angle) * p[3:] + math.sin(x * angle) * q[3:]) / math.sin(angle)
    out[3:] /= math.sqrt(float(out[3:] @ out[3:]))
    out.flags.writeable = False
    return out


def multiply(p: Array, q: Array) -> Array:
    """Hamilton product p q of quaternions in the order x, y, z, w."""
    px, py, pz, pw = p
    qx, qy, qz, qw = q
    return np.array(
        (
            pw * qx + px * qw + py * qz - pz * qy,
            pw * qy - px * qz + py * qw + pz * qx,
            pw * qz + px * qy - py * qx + pz * qw,
            pw * qw - px * qx - py * qy - pz * qz,
        ),
        dtype=np.float64,
    )


@final
class Pose:
    """A place and an orientation in the world frame.

    Parameters
    ----------
    position : (3,) array_like
        [m], world.
    quaternion : (4,) array_like
        x, y, z, w; its sign is ignored. Within 1e-3 of unit length it is normalised, otherwise refused.
    turns : int
        Winding of the cable's end: the shape reached by turning the end ``2 pi turns`` right-handed about its d3,
        counted from the relative rotation whose quaternion has w >= 0.

    Raises
    ------
    ArgumentError
        For a wrong number of entries, NaN or infinite entries, or a quaternion that is not of unit length.
    """

    __slots__ = ("array", "turns")

    array: Array  # (7,) position and quaternion, read-only
    turns: int

    def __init__(
        self,
        position: ArrayLike = (0.0, 0.0, 0.0),
        quaternion: ArrayLike = (0.0, 0.0, 0.0, 1.0),
        turns: int = 0,
    ) -> None:
        array = np.empty(7)
        array[:3] = checks.vector("position", position, 3, "m")
        array[3:] = checks.quaternion("quaternion", quaternion)
        array.flags.writeable = False
        self.array = array
        plain = type(turns) is int and turns == 0
        self.turns = 0 if plain else checks.integer("turns", turns, at_least=-1000, at_most=1000)

    @classmethod
    def trusted(cls, array: Array, turns: int = 0) -> Pose:
        """A pose that keeps `array` (7,), position and unit quaternion x y z w, without copying or checking it.

        For numbers that this package has computed itself, such as forward kinematics; nothing may write to `array`,
        which is read-only from now on.
        """
        array.flags.writeable = False
        pose = object.__new__(cls)
        pose.array = array
        pose.turns = turns
        return pose

    @property
    def position(self) -> Array:
        """(3,) [m], world."""
        return self.array[:3]

    @property
    def quaternion(self) -> Array:
        """(4,) x, y, z, w."""
        return self.array[3:]

    def __mul__(self, other: Pose) -> Pose:
        """This pose followed by `other`, given in this pose's frame; `turns` is taken from this pose."""
        if not isinstance(other, Pose):
            return NotImplemented
        return Pose.trusted(compose(self.array, other.array), self.turns)

    def inverse(self) -> Pose:
        """The pose that undoes this one: ``pose * pose.inverse()`` is the identity."""
        q = self.quaternion * np.array((-1.0, -1.0, -1.0, 1.0))
        return Pose(-rotate(q, self.position), q)

    def distance(self, other: Pose) -> tuple[float, float]:
        """How far `other` is away [m] and turned [rad, from 0 to pi] from this pose."""
        checks.instance("other", other, (Pose,), "Write Pose(position, quaternion).")
        turn = multiply(self.quaternion * np.array((-1.0, -1.0, -1.0, 1.0)), other.quaternion)
        # atan2 of sine and cosine of half the angle is exact for small angles too
        angle = 2.0 * np.arctan2(np.linalg.norm(turn[:3]), abs(turn[3]))
        return float(np.linalg.norm(other.position - self.position)), float(angle)

    def matrix(self) -> Array:
        """(4, 4) homogeneous transformation."""
        m = np.eye(4)
        for i in range(3):
            m[:3, i] = rotate(self.quaternion, np.eye(3)[i])
        m[:3, 3] = self.position
        return m

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Pose) and self.turns == other.turns and bool(np.array_equal(self.array, other.array))

    def __hash__(self) -> int:
        return hash((self.array.tobytes(), self.turns))

    def __repr__(self) -> str:
        turns = f", turns={self.turns}" if self.turns else ""
        return f"Pose({self.position.tolist()}, {self.quaternion.tolist()}{turns})"


IDENTITY = Pose()


@final
class Grip:
    """How a gripper holds an end of the cable.

    Parameters
    ----------
    pose : Pose
        The gripper's tool frame in the world.
    kind : str
        ``"clamped"`` (all rotation held), ``"swivel"`` (twist about the tangent free) or ``"pinned"`` (all rotation
        free).
    offset : Pose
        The cable frame in the tool frame: cable frame = pose * offset. A gripper that closes across the cable turns
        its tool axis onto the tangent here.
    curvature : (3,) array_like
        [1/m], world: the curvature vector x'' at this end, the extra boundary value of the 6th-order gradient cable.
        Other models ignore it.
    """

    __slots__ = ("cable_frame", "curvature", "kind", "offset", "pose")

    def __init__(
        self,
        pose: Pose,
        kind: str = "clamped",
        offset: Pose = IDENTITY,
        curvature: ArrayLike = (0.0, 0.0, 0.0),
    ) -> None:
        if not isinstance(pose, Pose):
            raise checks.ArgumentError.of("pose", pose, "it must be a Pose", "Write Grip(Pose(position, quaternion)).")
        checks.instance("offset", offset, (Pose,), "Write Pose(position, quaternion).")
        self.pose = pose
        self.kind = checks.one_of("kind", kind, GRIP_KINDS)
        self.offset = offset
        self.curvature = checks.vector("curvature", curvature, 3, "1/m")
        self.cable_frame = pose if offset is IDENTITY else pose * offset

    def at(self, pose: Pose, cable_frame: Pose | None = None) -> Grip:
        """The same grip with the gripper moved to `pose`; `cable_frame`: ``pose * offset``, if it is known already."""
        checks.instance("pose", pose, (Pose,), "Write Pose(position, quaternion).")
        grip = object.__new__(Grip)
        grip.pose, grip.kind, grip.offset, grip.curvature = pose, self.kind, self.offset, self.curvature
        if cable_frame is None:
            cable_frame = pose if self.offset is IDENTITY else pose * self.offset
        grip.cable_frame = cable_frame
        return grip

    def __repr__(self) -> str:
        return f"Grip({self.pose!r}, kind={self.kind!r}, offset={self.offset!r}, curvature={self.curvature.tolist()})"


@final
class FreeEnd:
    """An end that nothing holds, with a plug and dead loads.

    Parameters
    ----------
    mass : float
        [kg], of a plug at the end; at least 0.
    force, moment : (3,) array_like
        [N], [N m], world: dead loads, which keep their direction.
    """

    __slots__ = ("force", "mass", "moment")

    def __init__(
        self, mass: float = 0.0, force: ArrayLike = (0.0, 0.0, 0.0), moment: ArrayLike = (0.0, 0.0, 0.0)
    ) -> None:
        self.mass = checks.number("mass", mass, at_least=0.0, unit="kg")
        self.force = checks.vector("force", force, 3, "N")
        self.moment = checks.vector("moment", moment, 3, "N m")

    def __repr__(self) -> str:
        return f"FreeEnd(mass={self.mass}, force={self.force.tolist()}, moment={self.moment.tolist()})"


#: Where both ends are; None: a free end without load.
Ends = tuple[Pose | Grip, Pose | Grip | FreeEnd | None]

_CLAMPED = Grip(IDENTITY)


def as_grip(name: str, end: Pose | Grip) -> Grip:
    """A bare Pose is a clamped grip."""
    if type(end) is Pose:  # most often
        return _CLAMPED.at(end, end)
    if type(end) is Grip:
        return end
    raise checks.ArgumentError.of(name, end, "it must be a Pose or a Grip", "Write Pose(position, quaternion).")


def pose_entry(pose: Pose) -> dict[str, Any]:
    """The keys that say where something is."""
    return {"position": pose.position.tolist(), "quaternion": pose.quaternion.tolist()}
