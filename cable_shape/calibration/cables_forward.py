"""From the numbers of cables that may touch each other, or themselves, to misses: :class:`CablesForward`.

Which way cables are wound about each other, or onto themselves, no grip tells. The points that were seen do, where
their arc lengths are known: shapes come to rest from the path through them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, final

import numpy as np

from cable_shape.calibration.answers import Answers
from cable_shape.calibration.cables_parameters import CablesParameters
from cable_shape.calibration.forward import NOISE, POINTS, Forward
from cable_shape.calibration.observation import Observation
from cable_shape.calibration.parameters import Parameters, held
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.kernels.distance.misses import changes, misses
from cable_shape.pose import FreeEnd, Grip
from cable_shape.prediction.cables_predictor import CablesPredictor, lies_on_itself
from cable_shape.shape import CableShape
from cable_shape.solve.cables import FREE_ROTATIONS
from cable_shape.solve.problem import Problem
from cable_shape.solve.seen import Seen, laid_on, seen_of, turns_of

#: [1], of the longest cable: discretisation error of a prediction.
TOLERANCE = 1e-5
#: Points of known arc length along a cable that tell how it is wound, at least; and by how much their path may be
#: longer or shorter than the cable [1].
FEWEST, OFF = 8, 0.1
#: [1], of the length: shapes as near to what was seen, on the mean, are those that were seen.
_NEAR = 0.02
#: [1], of the length: points nearer to each other count as one.
_APART = 1.0 / 32.0

Look = Mapping[str, Observation]
Held = tuple[Grip, Grip | FreeEnd]


@final
class Flat(NamedTuple):
    """The points of one look at several cables in one array, as a fit takes them."""

    points: Array  # (n, 3) [m]
    arc_length: Array  # (n,) [m]
    group: int | None
    planar: bool


class _Followed(NamedTuple):
    """Cables with their shapes, and whether it was told how they are wound."""

    cables: CablesPredictor
    shapes: dict[str, CableShape]
    ends: dict[str, Held]
    told: bool

    def length(self, name: str) -> float:
        """[m], of a cable."""
        return self.shapes[name].length


@final
class CablesForward:
    """Misses of all observed points (n, 3) [m], look by look, and how they change with parameters.

    Shapes at new values are followed from those where the last derivatives were taken, whatever was tried in between;
    :meth:`afresh` finds each anew: from the points where they tell that cables touch, else from nothing.

    loads: keywords of :class:`CablesPredictor`.
    """

    def __init__(self, parameters: CablesParameters, looks: Sequence[Look], **loads: Any) -> None:
        self.parameters = parameters
        self.looks = list(looks)
        self.observations = [flat(look) for look in self.looks]
        self._loads = loads
        self._from: list[_Followed | None] = [None] * len(self.looks)  # where shapes are followed from
        self._states: list[_Followed | None] = self._from.copy()  # with the last values
        self._last: tuple[Array, list[_Followed]] | None = None  # values, and all shapes with them

    def shapes(self, values: Array) -> list[dict[str, CableShape]]:
        """Of each look, by the names of the cables."""
        return [one.shapes for one in self._found(values)]

    def centrelines(self, values: Array) -> list[Array]:
        """(101, 3) [m] of each look's cables in turn; NaN where there is no usable shape."""
        nothing = np.full((POINTS, 3), np.nan)
        return [
            shape.positions.copy() if shape.status else nothing
            for shapes in self.shapes(values)
            for shape in shapes.values()
        ]

    def misses(self, values: Array) -> Array:
        """(n, 3) [m]; NaN where there is no usable shape."""
        return np.concatenate([self._missed(look, s) for look, s in zip(self.looks, self.shapes(values), strict=True)])

    def afresh(self, values: Array) -> Array:
        """`misses` of every look found anew; from there on shapes are followed."""
        self._from, self._last = [None] * len(self.looks), None
        return self.misses(values)

    def refuse_untold(self, values: Array) -> None:
        """Refuses looks where no points tell how cables are wound, and these touch, or are not where points were seen.

        Raises
        ------
        ArgumentError
        """
        for i, (look, one) in enumerate(zip(self.looks, self._found(values), strict=True)):
            if one.told or not (one.cables.touching or self._elsewhere(look, one.shapes)):
                continue
            name = next(name for name, seen in look.items() if path_of(seen, *one.ends[name], one.length(name)) is None)
            where = f"observations[{i}]" + (f"[{name!r}]" if len(look) > 1 else "")
            known = int(np.isfinite(look[name].arc_length).sum())
            raise ArgumentError.of(
                f"{where}.arc_length", f"known of {known} points",
                f"cables touch there, or may, and how they are wound {FEWEST} points at least have to tell, on a path "
                f"as long as the cable but for {100.0 * OFF:g} %",
                "Give the arc lengths of points all along it, or leave out contact='solve'.",
            )  # fmt: skip

    def remarks(self, values: Array) -> tuple[str, ...]:
        """What is taken for granted of the cables that lie on themselves with these numbers."""
        count = 0
        for one in self._found(values):
            itself = [name for name, shape in one.shapes.items() if shape.status and lies_on_itself(shape)]
            count += any(_holds_roll(one.ends[name]) and not _turns(one.ends[name]) for name in itself)
        if not count:
            return ()
        return (
            f"{count} observations show a cable on itself: beside its windings it is taken to be twisted by less than "
            "half a turn, or as is nearest to the points; the turns of its end's pose would tell.",
        )

    def _elsewhere(self, look: Look, shapes: Mapping[str, CableShape]) -> bool:
        """Whether the usual point is missed by so much that what was seen may be wound."""
        far = np.linalg.norm(self._missed(look, shapes), axis=1)
        seen = far[np.isfinite(far)]
        return len(seen) > 0 and float(np.median(seen)) > _NEAR * self.parameters.longest

    def jacobian(self, values: Array, now: Array) -> Array:
        """(n, 3, parameters) at `values`, where the misses are `now`; 0 where there is no shape.

        By the rods' own sensitivities. A parameter that moves points by no more than the discretisation's own noise
        moves none.
        """
        found = self._found(values)
        self._from = self._states
        answers = {
            name: Answers(part, self.parameters.own(name, values)) for name, part in self.parameters.parts.items()
        }
        pairs = zip(self.looks, found, strict=True)
        out = np.concatenate([self._moved(look, one, answers, len(values)) for look, one in pairs])
        steps = np.array([parameter.step for parameter in self.parameters.each])
        spread = steps * np.sqrt((out * out).sum(axis=(0, 1)) / len(out))
        out[:, :, spread <= NOISE * self.parameters.longest] = 0.0
        return out

    def _moved(self, look: Look, found: _Followed, answers: Mapping[str, Answers], count: int) -> Array:
        """(n, 3, count): how the misses of one look change with the parameters."""
        parts = []
        for told, seen in look.items():
            part, shape = np.zeros((*seen.points.shape, count)), found.shapes[told]
            for name, answer in answers.items():
                state = found.cables.state_of(name, told) if shape.status else None
                if state is None:
                    continue
                moves = answer.moves(state, look[name].start, look[name].end)
                own = np.empty((*seen.points.shape, moves.shape[2]))
                changes(shape.buffer, shape.points, seen.points, seen.arc_length, moves, own)
                known = np.isfinite(seen.arc_length)
                if known.any() and name == told:  # there the arc length stays, not its share of the length
                    share = shape.arc_length / shape.length
                    moves -= (share[:, None] * shape.tangents)[:, :, None] * answer.longer
                    some = np.empty((int(known.sum()), 3, moves.shape[2]))
                    changes(shape.buffer, shape.points, seen.points[known], seen.arc_length[known], moves, some)
                    own[known] = some
                part += own @ self.parameters.spread[name]
            parts.append(part)
        return np.concatenate(parts)

    @staticmethod
    def _missed(look: Look, shapes: Mapping[str, CableShape]) -> Array:
        """(m, 3) [m] of one look."""
        out = []
        for name, seen in look.items():
            miss = np.full(seen.points.shape, np.nan)
            if shapes[name].status:
                misses(shapes[name].buffer, shapes[name].points, seen.points, seen.arc_length, miss)
            out.append(miss)
        return np.concatenate(out)

    # -- shapes

    def _found(self, values: Array) -> list[_Followed]:
        """The shapes of each look at these values."""
        if self._last is None or not np.array_equal(self._last[0], values):
            cables = self.parameters.make(values)
            found = []
            for look, last in zip(self.looks, self._from, strict=True):
                ends = {name: self._held(name, values, seen) for name, seen in look.items()}
                moves = {name: seen.acceleration for name, seen in look.items() if seen.acceleration is not None}
                if last is None or not all(shape.status for shape in last.shapes.values()):
                    found.append(self._begun(look, cables, ends, moves))
                    continue
                there = last.cables.onto(cables)
                found.append(_Followed(there, there.predict(ends, acceleration=moves), ends, last.told))
            self._states, self._last = list(found), (values.copy(), found)
        return self._last[1]

    def _held(self, name: str, values: Array, seen: Observation) -> Held:
        """The ends of a cable where the parameters have them."""
        near, far = (self.parameters.offset(name, values, side) for side in ("start", "end"))
        start = held(seen.start, near)
        assert isinstance(start, Grip)
        return start, held(seen.end, far)

    def _begun(
        self, look: Look, cables: Mapping[str, Any], ends: dict[str, Held], moves: Mapping[str, Array]
    ) -> _Followed:
        """The shapes of one look, found anew."""
        tolerance = TOLERANCE * max(cable.length for cable in cables.values())
        options = {"model": "cosserat", "points": POINTS, "tolerance": tolerance, "friction": False, **self._loads}
        made = CablesPredictor(cables, **options)
        paths = {name: path_of(seen, *ends[name], cables[name].length) for name, seen in look.items()}
        known = {name: path for name, path in paths.items() if path is not None}
        if not made.solves_crossing or len(known) < len(paths):
            return _Followed(made, made.predict(ends, acceleration=moves), ends, not made.solves_crossing)

        def laid(turns: Mapping[str, int]) -> dict[str, CableShape]:
            """The shapes that were seen, with these twists."""
            return {
                name: laid_on(path, *ends[name], cables[name].length, POINTS, turns[name])
                for name, path in known.items()
            }

        lines = {name: path.places(np.linspace(0.0, cables[name].length, POINTS)) for name, path in known.items()}

        def far(shapes: Mapping[str, CableShape]) -> dict[str, float]:
            """How far shapes are from what was seen [1]."""
            return {
                name: float(np.linalg.norm(shape.positions - lines[name], axis=1).mean()) / shape.length
                if shape.status
                else np.inf
                for name, shape in shapes.items()
            }

        even = dict.fromkeys(look, 0)
        told = {name: _turns(both) for name, both in ends.items() if _turns(both)}
        for name, shape in laid(even).items():
            even[name] = told[name] - turns_of(shape) if name in told else 0
        wound = made.wound(laid(even))

        def begun(turns: Mapping[str, int] | None, more: Sequence[str] = ()) -> dict[str, CableShape]:
            """The shapes from those seen with these twists, None: from nothing; more: also of cables not wound."""
            if turns is not None:
                return made.begin(ends, laid(turns), more=more, acceleration=moves)
            made.reset()
            return made.predict(ends, acceleration=moves)

        shapes = begun(even if wound else None)
        least = far(shapes)
        if max(least.values()) > _NEAR:
            apart = [name for name, off in least.items() if off > _NEAR and name not in wound]
            ways: list[tuple[dict[str, int] | None, list[str]]] = [(even if wound else None, []), (even, apart)]
            ways += [({**even, name: turns}, apart) for name in sorted(wound - set(told)) for turns in (-1, 1)]
            ways += [(None, [])] if wound else []
            off = [max(least.values()), *(max(far(begun(*way)).values()) for way in ways[1:])]
            shapes = begun(*ways[int(np.argmin(off))])
        return _Followed(made, shapes, ends, True)


def _turns(ends: Held) -> int:
    """How many times the end is told to have been turned; 0: no more is told than how it is held."""
    return ends[1].cable_frame.turns if isinstance(ends[1], Grip) else 0


def _holds_roll(ends: Held) -> bool:
    """Whether the grips at both ends hold the cable's roll."""
    return all(isinstance(end, Grip) and not FREE_ROTATIONS[end.kind][2] for end in ends)


def forward_of(parameters: Parameters, seen: Sequence[Observation], **loads: Any) -> Forward | CablesForward:
    """What predicts observations of one cable; loads: the keywords of :class:`Forward`."""
    if not Problem(parameters.cable, **loads).solves_crossing:
        return Forward(parameters, seen, **loads)
    return CablesForward(CablesParameters.alone("cable", parameters), [{"cable": one} for one in seen], **loads)


def path_of(seen: Observation, start: Grip, end: Grip | FreeEnd, length: float) -> Seen | None:
    """The path through the points of known arc length; None where they are too few to tell how the cable is wound.

    Points nearer to each other than a part of the length count as one in their middle, those so near to a grip are left
    out: what scatters between them is no shape of the cable.
    """
    known = np.isfinite(seen.arc_length) & (seen.arc_length <= length)
    if np.count_nonzero(known) < FEWEST:
        return None
    parts = np.floor(seen.arc_length[known] / (_APART * length)).astype(np.int64)
    arcs, places = seen.arc_length[known], seen.points[known]
    rows = np.array([np.append(arcs[parts == k].mean(), places[parts == k].mean(axis=0)) for k in np.unique(parts)])
    inside = (rows[:, 0] > 0.5 * _APART * length) & (
        (rows[:, 0] < (1.0 - 0.5 * _APART) * length) | isinstance(end, FreeEnd)
    )
    if np.count_nonzero(inside) < FEWEST:
        return None
    path = seen_of(start, end, length, rows[inside, 0], rows[inside, 1:], None)
    line = path.places(np.linspace(0.0, length, POINTS))
    long = float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum())
    return path if abs(long - length) <= OFF * length else None


def flat(look: Look) -> Observation | Flat:
    """The points of one look, those of one cable after those of the other."""
    seen = list(look.values())
    if len(seen) == 1:
        return seen[0]
    for what in ("group", "planar"):
        told = {name: getattr(one, what) for name, one in look.items()}
        if len(set(told.values())) > 1:
            raise ArgumentError.of(what, told, "it must be the same of all cables of a look", "Tell it alike.")
    points, arcs = (np.concatenate([getattr(one, what) for one in seen]) for what in ("points", "arc_length"))
    return Flat(points, arcs, seen[0].group, seen[0].planar)
