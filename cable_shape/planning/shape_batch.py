"""Many shapes of one cable in stacked arrays: :class:`ShapeBatch`."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from typing import Any, Generic, TypeVar, final

import numpy as np
from numpy.typing import NDArray

from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.kernels.distance import bounds
from cable_shape.kernels.network import drive
from cable_shape.kernels.safety import loads_used as margins
from cable_shape.safety.clearance import NOT_JUDGED
from cable_shape.safety.report import BodyDistance, Clearance
from cable_shape.shape import NUMBERS_PER_POINT, CableShape, Status
from cable_shape.solve.harness_shape import HarnessShape

_Shape = TypeVar("_Shape", CableShape, HarnessShape, dict[str, Any])
_NOT_JUDGED = [status.value for status in NOT_JUDGED]


class Rows(Generic[_Shape]):
    """What batches of cables and of harnesses have alike: what became of each of their rows."""

    def __init__(self, rows: int) -> None:
        self.status: NDArray[np.int64] = np.full(rows, Status.NOT_CONVERGED.value)
        self.done: NDArray[np.bool_] = np.zeros(rows, np.bool_)
        self.iterations: NDArray[np.int64] = np.zeros(rows, np.int64)
        self.errors: dict[int, ArgumentError] = {}
        self.details: dict[int, str] = {}
        self.partial = False
        self.time = 0.0

    def __len__(self) -> int:
        return len(self.status)

    @property
    def usable(self) -> NDArray[np.bool_]:
        """(k,): ``bool(status)`` of each row."""
        return self.done & (self.status <= Status.BUDGET.value)

    def __getitem__(self, row: int) -> _Shape:
        raise NotImplementedError

    def __iter__(self) -> Iterator[_Shape]:
        return (self[row] for row in range(len(self)))

    def __repr__(self) -> str:
        counts = zip(*np.unique(self.status[self.done], return_counts=True), strict=True)
        names = ", ".join(f"{count} {Status(value).name}" for value, count in counts)
        left = len(self) - int(self.done.sum())
        return f"{type(self).__name__}({len(self)} rows: {names or 'none done'}{f', {left} not done' if left else ''})"


@final
class ShapeBatch(Rows[CableShape]):
    """Shapes of one cable for k pairs of ends; `batch[i]` is a CableShape whose arrays are views of these.

    Attributes
    ----------
    points, length : int, float [m]
        As of CableShape.
    status : (k,) int
        Values of :class:`Status`; NOT_CONVERGED where a row was not done.
    done : (k,) bool
        Whether the row was answered: not where its input is not valid, nor where the time limit came first.
    partial : bool
        The time limit came before every row was answered.
    errors : dict of row to ArgumentError
        Rows whose input is not valid: NaN, or a quaternion that is not of unit length.
    several : (k,) bool
        The cable has shown other stable shapes for these ends, or for ends close by. Not every such row is found. Some
        are looked for when this is first read.
    details : dict of row to str
        What the status means there, where it is not OK.
    turns, iterations : (k,) int
        As of CableShape.
    distances : (k, m) [m]
        From the cable's surface to each of `bodies`, negative on overlap, infinite beyond `horizon` [m]; NaN where
        not told.
    used : (k, 6 + m)
        Margins, 1 at the limit (see :mod:`cable_shape.safety.margins`): `LOAD_MARGINS`, then each body; NaN: none. Of a
        body that the scene allows to be touched, clearance counts where it may not be, and its force against the limit.
    slopes : (k, 6 + m, 12), optional
        How `used` changes with the ends, if it was asked for: twists of start and end in world axes, per m and per rad,
        as of :meth:`cable_shape.Predictor.sensitivity`. Of the forces of bodies and of stability not; NaN: not told.
    radius : (k, n) [m], optional
        Of the tube that holds a point of the row's cable with the `confidence`, if an uncertainty was given: distances
        and `used` of bodies are those of a cable so much thicker. NaN where there is no usable shape.
    confidence : float
        0 without an uncertainty.
    time : float [s], spent
    """

    def __init__(
        self, rows: int, points: int, length: float, bodies: tuple[str, ...], horizon: float, clips: int = 0
    ) -> None:
        super().__init__(rows)
        self.points = points
        self.length = length
        self.bodies = bodies
        self.horizon = horizon
        self.buffer: Array = np.empty((rows, NUMBERS_PER_POINT * points))
        self.info: Array = np.full((rows, drive.INFO + 2), math.nan)  # see kernels.network.drive
        self.tables: Array = np.full((rows, len(bodies), bounds.RESULT_COLUMNS), math.nan)  # see kernels.bounds
        self.margin_rows: Array = np.full((rows, margins.BODIES + len(bodies), margins.COLUMNS), math.nan)
        self.loads: Array = np.full((rows, clips + 2 if clips else 0, 7), math.nan)  # see kernels.network.drive
        self.missing_length: Array = np.zeros(rows)
        self._several: NDArray[np.bool_] = np.zeros(rows, np.bool_)
        self._unread_several: list[Callable[[], None]] = []
        self.turns: NDArray[np.int64] = np.zeros(rows, np.int64)
        self.models: NDArray[np.str_] = np.full(rows, "cosserat", dtype="<U9")
        self.unread_errors: dict[int, Callable[[Array], float]] = {}  # see CableShape.unread_error
        self.touches: dict[
            int, tuple[tuple[str, ...], Array, bool]
        ] = {}  # of rows in contact: bodies, touches, frictionless
        self.radius: Array | None = None
        self.slopes: Array | None = None
        self.confidence = 0.0

    def stacks_with(self, other: ShapeBatch) -> bool:
        """Whether rows of another one, of the same cable, are laid out as these are."""
        mine, theirs = (
            (one.bodies, one.horizon, one.loads.shape, one.buffer.shape) for one in (self, other)
        )  # fmt: skip
        return mine == theirs

    def blank(self) -> None:
        """Makes NaN of rows that are not done, and of what is told beside distances and margins that there are not."""
        for kept in (self.buffer, self.info, self.tables, self.margin_rows):
            kept[~self.done] = math.nan
        self.tables[np.isinf(self.distances), 1:] = math.nan
        self.margin_rows[np.isnan(self.used)] = math.nan

    @property
    def several(self) -> NDArray[np.bool_]:
        """(k,), see the class."""
        while self._unread_several:
            self._unread_several.pop()()
        return self._several

    def flag_several(self, rows: NDArray[np.int64]) -> None:
        """These rows have shown several stable shapes."""
        self._several[rows] = True

    def tell_several_by(
        self, cells: NDArray[np.int64], rows: NDArray[np.int64], look: Callable[[NDArray[np.int64]], NDArray[np.bool_]]
    ) -> None:
        """What is asked when `several` is first read: whether cells (c, d) have several shapes; those of `rows` (r,)
        are `cells` (r, d)."""

        def find() -> None:
            keys, which = np.unique(cells, axis=0, return_inverse=True)
            self._several[rows] |= look(keys)[which.ravel()]

        self._unread_several.append(find)

    def tell_several_as(self, other: ShapeBatch) -> None:
        """When `several` is first read it is that of another batch, of the same rows."""

        def find() -> None:
            self._several |= other.several

        self._unread_several.append(find)

    @property
    def arc_length(self) -> Array:
        """(n,) [m], the same for all."""
        return np.linspace(0.0, self.length, self.points)

    @property
    def positions(self) -> Array:
        """(k, n, 3) [m], world; NaN where not done."""
        return self._part(1, 3)

    @property
    def quaternions(self) -> Array:
        """(k, n, 4) x, y, z, w."""
        return self._part(4, 4)

    @property
    def curvature(self) -> Array:
        """(k, n, 3) [1/m], cable frame."""
        return self._part(8, 3)

    @property
    def force(self) -> Array:
        """(k, n, 3) [N], world."""
        return self._part(11, 3)

    @property
    def moment(self) -> Array:
        """(k, n, 3) [N m], world."""
        return self._part(14, 3)

    def _part(self, first: int, width: int) -> Array:
        n = self.points
        return self.buffer[:, first * n : (first + width) * n].reshape(len(self), n, width)

    @property
    def energy(self) -> Array:
        """(k,) [J]."""
        return self.info[:, drive.I_ENERGY]

    @property
    def error_estimate(self) -> Array:
        """(k,) [m]; of closed forms it is found when this is first read, see CableShape."""
        for row in list(self.unread_errors):
            self.info[row, drive.I_ESTIMATE] = self.unread_errors.pop(row)(self.positions[row])
        return self.info[:, drive.I_ESTIMATE]

    @property
    def residual(self) -> Array:
        """(k,)."""
        return self.info[:, drive.I_RESIDUAL]

    @property
    def twist(self) -> Array:
        """(k,) [rad], integral of the twist rate u3."""
        return self.info[:, drive.INFO]

    @property
    def distances(self) -> Array:
        """(k, m) [m], see the class."""
        return self.tables[:, :, 0]

    @property
    def clearance(self) -> Array:
        """(k,) [m], to the nearest body; infinite beyond the horizon or without bodies, NaN where not told."""
        return np.asarray(self.distances.min(axis=1, initial=math.inf))

    @property
    def used(self) -> Array:
        """(k, 6 + m), see the class."""
        return self.margin_rows[:, :, margins.USED]

    @property
    def worst(self) -> Array:
        """(k,), the greatest of `used`; NaN where there is none."""
        return np.asarray(np.fmax.reduce(self.used, axis=1))

    def clearance_of(self, row: int) -> Clearance:
        """The distances of one row as of a cycle, with witness points."""
        row = range(len(self))[row]
        if not self.done[row] or self.status[row] in _NOT_JUDGED:
            return Clearance(beyond=0.0)
        table = self.tables[row]
        near = tuple(
            BodyDistance(name, float(r[0]), float(r[1]), r[2:5], r[5:8])
            for name, r in zip(self.bodies, table, strict=True)
            if r[0] != math.inf
        )
        told = self.radius is not None and not math.isnan(self.radius[row, 0])
        beyond = math.inf if len(near) == len(table) else self.horizon
        return Clearance(near, beyond, table=table, confidence=self.confidence if told else 0.0)

    def __getitem__(self, row: int) -> CableShape:
        """Row `row` as a CableShape; of one that was not done the status is NOT_CONVERGED and positions are NaN."""
        row = range(len(self))[row]
        info = self.info[row]
        shape = CableShape(
            self.buffer[row],
            self.points,
            length=self.length,
            model=str(self.models[row]),
            status=Status(int(self.status[row])),
            detail=self.details.get(row, ""),
            energy=float(info[drive.I_ENERGY]),
            error_estimate=self.unread_errors.get(row, float(info[drive.I_ESTIMATE])),
            residual=float(info[drive.I_RESIDUAL]),
            iterations=int(self.iterations[row]),
            turns=int(self.turns[row]),
            twist=float(info[drive.INFO]),
            force_error=float(info[drive.I_FORCE]),
            moment_error=float(info[drive.I_MOMENT]),
            missing_length=float(self.missing_length[row]),
        )
        if self.loads.shape[1]:
            shape.supports = self.loads[row, 1:-1]
        if row in self.touches:
            shape.bodies, shape.touches, shape.frictionless = self.touches[row]
        return shape


class Several(Rows[_Shape]):
    """Rows that are several cables each, or segments of a harness: a :class:`ShapeBatch` of each, by its name."""

    def __init__(self, parts: Mapping[str, ShapeBatch]) -> None:
        super().__init__(len(next(iter(parts.values()))))
        self.parts = dict(parts)

    @property
    def positions(self) -> dict[str, Array]:
        """{name: (k, n, 3)} [m], world; NaN where not done."""
        return {name: batch.positions for name, batch in self.parts.items()}

    @property
    def distances(self) -> dict[str, Array]:
        """{name: (k, m)} [m], from its surface to each of its `bodies`, see `ShapeBatch.distances`."""
        return {name: batch.distances for name, batch in self.parts.items()}

    @property
    def used(self) -> dict[str, Array]:
        """{name: (k, 6 + m)}, margins, 1 at the limit, see `ShapeBatch.used`."""
        return {name: batch.used for name, batch in self.parts.items()}

    @property
    def radius(self) -> dict[str, Array | None]:
        """{name: (k, n)} [m], of the tubes, where an uncertainty was given."""
        return {name: batch.radius for name, batch in self.parts.items()}

    @property
    def clearance(self) -> Array:
        """(k,) [m], of any of them to the nearest body; infinite beyond the horizon, NaN where not told."""
        return np.asarray(np.min([batch.clearance for batch in self.parts.values()], axis=0))

    @property
    def worst(self) -> Array:
        """(k,), the greatest of `used` of all of them; NaN where there is none."""
        return np.asarray(np.fmax.reduce([batch.worst for batch in self.parts.values()], axis=0))
