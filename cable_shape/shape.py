"""What comes out: :class:`CableShape`, and how good it is: :class:`Status`."""

from __future__ import annotations

import enum
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, final

import numpy as np
from numpy.typing import ArrayLike

from cable_shape import checks
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError

#: Numbers per point in a shape's buffer: arc length 1, position 3, quaternion 4, curvature 3, force 3, moment 3.
NUMBERS_PER_POINT = 17


@final
class Status(enum.Enum):
    """How a prediction ended; true in a boolean context if the shape may be acted on.

    The values are those of ``cable_shape_msgs/CableShape.status``.
    """

    OK = 0
    UNSTABLE = 1
    SNAPPED = 2
    BUDGET = 3
    OVERSTRETCHED = 4
    NOT_CONVERGED = 5
    BUDGET_EXCEEDED = 6

    def __bool__(self) -> bool:
        return self.value <= Status.BUDGET.value

    @property
    def remedy(self) -> str:
        """What the status means and what to do about it, in words."""
        return _REMEDY[self]


_REMEDY = {
    Status.OK: "The shape is a stable equilibrium within tolerance.",
    Status.UNSTABLE: "An equilibrium, but not a stable one: the cable will leave it. Move the grips back.",
    Status.SNAPPED: "The cable jumped to another stable shape. Check the path that led here.",
    Status.BUDGET: "Out of time, yet within tolerance.",
    Status.OVERSTRETCHED: "The grips are further apart than the cable is long. Bring them closer; "
    "the shape is the straight line.",
    Status.NOT_CONVERGED: "No equilibrium was found. Move the grips in smaller steps or choose another model.",
    Status.BUDGET_EXCEEDED: "Out of time and not within tolerance. Raise the time budget or the tolerance.",
}


_NO_SUPPORTS = np.empty((0, 7))


@final
@dataclass(frozen=True, slots=True, eq=False)
class ClipLoad:
    """What the cable does to the clip at `arc_length` [m].

    force, moment : (3,) [N], [N m], world: by the cable on the clip, the weight of a point mass in the clip included;
    the moment about the clip. friction [N]: of an eyelet on the cable, along it, towards its end; slips: whether that
    is as much as friction can hold.
    """

    arc_length: float
    force: Array
    moment: Array
    friction: float = 0.0
    slips: bool = False


def clip_loads(supports: Array, rubbed: Array) -> tuple[ClipLoad, ...]:
    """What rows of `CableShape.supports` and `rubbed` tell; rubbed (0, 2): there is no friction."""
    held: Any = rubbed if len(rubbed) else [(0.0, 0.0)] * len(supports)
    rows = zip(supports, held, strict=True)
    return tuple(ClipLoad(float(row[0]), row[1:4], row[4:], float(f), bool(slips)) for row, (f, slips) in rows)


NOT_RUBBED = np.empty((0, 2))
TOUCH = 13  #: numbers of a contact, see `CableShape.touches`
NO_TOUCHES = np.empty((0, TOUCH))


@final
@dataclass(frozen=True, slots=True, eq=False)
class Contact:
    """Where the cable is pressed on a body; the reaction along a piece of the cable is told as forces at its nodes.

    arc_length [m]; body: name of the obstacle or the other cable, or "itself"; point (3,) [m], world, on the body's
    surface; normal (3,), unit, out of the body; force [N], of the body on the cable along the normal.
    tangential_force (3,) [N], world, of the body on the cable along its surface: friction; slips: whether that is as
    much as friction can hold.
    """

    arc_length: float
    body: str
    point: Array
    normal: Array
    force: float
    tangential_force: Array
    slips: bool


@final
class CableShape:
    """The predicted shape of one cable at n points, uniform in arc length.

    Arrays are views of one buffer, made when asked for; those that are worked out of others are so once, and cannot be
    written. See the properties for shapes, units and frames.
    """

    __slots__ = (
        "_bend_radius",
        "_error",
        "_tension",
        "before",
        "bodies",
        "buffer",
        "detail",
        "dissipated",
        "energy",
        "force_error",
        "frictionless",
        "iterations",
        "kinetic_energy",
        "length",
        "lost",
        "missing_length",
        "model",
        "moment_error",
        "points",
        "residual",
        "reused",
        "roll_error",
        "rubbed",
        "solve_time",
        "status",
        "supports",
        "touches",
        "turns",
        "twist",
        "velocity",
        "work",
    )

    def __init__(
        self,
        buffer: Array,
        points: int,
        *,
        length: float,
        model: str,
        status: Status,
        detail: str = "",
        energy: float = 0.0,
        error_estimate: float | Callable[[Array], float] = 0.0,
        residual: float = 0.0,
        iterations: int = 0,
        solve_time: float = 0.0,
        reused: bool = False,
        turns: int = 0,
        twist: float = 0.0,
        roll_error: float = 0.0,
        before: CableShape | None = None,
        supports: Array = _NO_SUPPORTS,
        rubbed: Array = NOT_RUBBED,
        touches: Array = NO_TOUCHES,
        bodies: tuple[str, ...] = (),
        force_error: float = math.nan,
        moment_error: float = math.nan,
        missing_length: float = 0.0,
        frictionless: bool = False,
        velocity: Array | None = None,
        kinetic_energy: float = 0.0,
        work: float = 0.0,
        dissipated: float = 0.0,
        lost: float = 0.0,
    ) -> None:
        self.buffer = buffer  # (17 n,): arc_length n | positions 3n | quaternions 4n | curvature, force, moment 3n each
        self.points = points
        self.length = length  # m, stress-free
        self.model = model
        self.status = status
        self.detail = detail  # what the status means here, with its remedy; empty when OK
        self.energy = energy  # J, elastic + gravitational, zero at the world origin
        self._error = error_estimate  # m, or what gives it from the positions
        self.residual = residual  # 1, largest relative defect of the model's own equations and boundary conditions
        self.iterations = iterations
        self.solve_time = solve_time  # s
        self.reused = reused  # the last shape again: nothing has moved
        self.turns = turns  # winding that the shape was solved for
        self.twist = twist  # rad, integral of the twist rate u3
        self.before = before  # SNAPPED: the last shape of the branch that ended, its ends where it did
        self.roll_error = roll_error  # rad, roll about d3 that the model leaves unmet at the end grip
        self.supports = supports  # (k, 7), of each clip: arc length [m], force [N] and moment [N m] on it
        self.rubbed = rubbed  # (k, 2), of each clip: its friction along the cable [N], and 1: it slips; (0, 2): none
        #: (k, TOUCH), of each contact: arc length [m], row in `bodies`, point 3, normal 3, force [N], force along the
        #: surface 3 [N], 1: it slips
        self.touches = touches
        self.bodies = bodies  # names
        self.force_error = force_error  # N, estimated largest error of `force`; NaN: not known
        self.moment_error = moment_error  # N m, estimated largest error of `moment`; NaN: not known
        self.missing_length = missing_length  # m, what an OVERSTRETCHED cable lacks
        self.frictionless = frictionless  # surfaces or eyelets have friction, which it does not know: it has no past
        self.velocity = velocity  # (n, 3) [m/s], world, of a cable in motion; None: at rest
        self.kinetic_energy = kinetic_energy  # J, as the scheme keeps it (docs/motion.md): m v^2 / 2 but for dt^2
        self.work = work  # J, in the last step, of what holds and pulls the cable
        self.dissipated = dissipated  # J, in the last step, by drag and retardation
        self.lost = lost  # J, in the last step, to the scheme: work less dissipated less change of energies
        self._tension: Array | None = None
        self._bend_radius: Array | None = None

    @classmethod
    def of_points(cls, positions: ArrayLike, length: float) -> CableShape:
        """What was seen of a cable of `length` [m]: positions (n, 3) [m], uniform in arc length, of model "seen".

        All else is not known: NaN.

        Raises
        ------
        ArgumentError
            Naming the value, the bound and the remedy.
        """
        length = checks.number("length", length, above=0.0, unit="m")
        places = checks.numbers("positions", positions, "Give three numbers [m] for each point.")
        if places.ndim != 2 or places.shape[1] != 3 or len(places) < 2 or not np.isfinite(places).all():
            bound = "it must be finite, of shape (n, 3), n at least 2"
            remedy = "Leave out what was not seen, and interpolate to uniform arc lengths."
            raise ArgumentError.of("positions", f"array of shape {places.shape}", bound, remedy)
        n = len(places)
        buffer = cls.new_buffer(n)
        buffer[:] = math.nan
        buffer[:n], buffer[n : 4 * n] = np.linspace(0.0, length, n), places.ravel()
        nan = math.nan
        return cls(
            buffer, n, length=length, model="seen", status=Status.OK, energy=nan, error_estimate=nan, residual=nan,
            twist=nan,
        )  # fmt: skip

    @property
    def error_estimate(self) -> float:
        """[m], estimated largest position error.

        Of a closed form that says OK: its largest distance from the Cosserat rod between the same ends, which is solved
        for when this is first read, and infinite where there is none.
        """
        error = self._error
        if callable(error):
            error = self._error = error(self.positions)
        return error

    @error_estimate.setter
    def error_estimate(self, value: float | Callable[[Array], float]) -> None:
        self._error = value

    @property
    def unread_error(self) -> float | Callable[[Array], float]:
        """`error_estimate`, or as long as it has not been read what gives it from positions (n, 3)."""
        return self._error

    @property
    def usable(self) -> bool:
        """Whether the shape may be acted on: what the status says."""
        return bool(self.status)

    @staticmethod
    def new_buffer(points: int) -> Array:
        """An uninitialised buffer for `points` points."""
        return np.empty(NUMBERS_PER_POINT * points)

    @property
    def arc_length(self) -> Array:
        """(n,) [m], from 0 to length, uniform."""
        return self.buffer[: self.points]

    @property
    def positions(self) -> Array:
        """(n, 3) [m], world."""
        n = self.points
        return self.buffer[n : 4 * n].reshape(n, 3)

    @property
    def quaternions(self) -> Array:
        """(n, 4) x, y, z, w: the cable frame in the world, d3 = tangent."""
        n = self.points
        return self.buffer[4 * n : 8 * n].reshape(n, 4)

    @property
    def curvature(self) -> Array:
        """(n, 3) [1/m], Darboux vector (rest curvature included), in the cable frame."""
        n = self.points
        return self.buffer[8 * n : 11 * n].reshape(n, 3)

    @property
    def force(self) -> Array:
        """(n, 3) [N], world, acting on the section from its far side."""
        n = self.points
        return self.buffer[11 * n : 14 * n].reshape(n, 3)

    @property
    def moment(self) -> Array:
        """(n, 3) [N m], world, acting on the section from its far side."""
        n = self.points
        return self.buffer[14 * n :].reshape(n, 3)

    @property
    def clips(self) -> tuple[ClipLoad, ...]:
        """Where each clip of the scene holds the cable, and the force and moment on it; in ascending arc length."""
        return clip_loads(self.supports, self.rubbed)

    @property
    def contacts(self) -> tuple[Contact, ...]:
        """Where the cable is pressed on something, in ascending arc length; empty unless ``Scene(contact="solve")``."""
        return tuple(
            Contact(
                float(row[0]), self.bodies[int(row[1])], row[2:5], row[5:8], float(row[8]), row[9:12], bool(row[12])
            )
            for row in self.touches
        )

    def presses(self, body: str) -> Array:
        """(k,) [N], of the `contacts` with a body, or another cable."""
        rows = [row for row, name in enumerate(self.bodies) if name == body]
        return np.asarray(self.touches[np.isin(self.touches[:, 1], rows), 8])

    @property
    def tangents(self) -> Array:
        """(n, 3), unit, world: the third axis of the cable frame."""
        x, y, z, w = self.quaternions.T
        tangents = np.empty((self.points, 3))
        tangents[:, 0] = 2.0 * (x * z + w * y)
        tangents[:, 1] = 2.0 * (y * z - w * x)
        tangents[:, 2] = 1.0 - 2.0 * (x * x + y * y)
        return tangents

    @property
    def tension(self) -> Array:
        """(n,) [N]: the force along the tangent, negative in compression."""
        if self._tension is None:
            self._tension = np.asarray(np.einsum("ij,ij->i", self.force, self.tangents))
            self._tension.setflags(write=False)
        return self._tension

    @property
    def bend_radius(self) -> Array:
        """(n,) [m]: 1 over the bending curvature, infinite where straight."""
        if self._bend_radius is None:
            with np.errstate(divide="ignore"):
                self._bend_radius = np.asarray(1.0 / np.hypot(self.curvature[:, 0], self.curvature[:, 1]))
            self._bend_radius.setflags(write=False)
        return self._bend_radius

    def again(self) -> CableShape:
        """The same shape, marked as reused: arrays are shared, the time is 0."""
        keywords: dict[str, Any] = {name: getattr(self, name) for name in self.__slots__ if name[0] != "_"}
        keywords.update(error_estimate=self._error, reused=True, solve_time=0.0, iterations=0)
        return CableShape(**keywords)

    def __repr__(self) -> str:
        detail = f", {self.detail}" if self.detail else ""
        return (
            f"CableShape({self.model}, {self.status.name}{detail}, {self.points} points, length {self.length:.4g} m, "
            f"error estimate {self.error_estimate:.2g} m, {self.iterations} iterations, {self.solve_time * 1e6:.0f} us)"
        )
