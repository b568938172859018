"""What varies in a study: :class:`Axis`, the points of all of them together, and where their values go.

A place in a study's file is named by its keys, with dots between them: ``cable.length``, ``end.position.z``,
``scene.clips.mid.arc_length``. Items of a list are found by their `name`, by their number, and those of a vector of
three by x, y and z.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, final

import numpy as np
from numpy.typing import NDArray

from cable_shape import checks
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError, UnknownKeyError

MOST_POINTS = 10_000_000
RANGE_KEYS, DISTRIBUTIONS = ("from", "to", "step", "count"), ("normal", "uniform")
SAMPLE_KEYS, SAMPLES = ("kind", "points", "seed"), ("sobol", "latin", "random")
_COMPONENTS = {"x": 0, "y": 1, "z": 2, "w": 3}
#: Shares of a distribution nearer to 0 and 1 than this are not drawn: a normal one would have no value there.
_EDGE = 1e-12


@final
class Axis(NamedTuple):
    """One thing that varies: a list of values, or a distribution.

    name: where it is; values (k,), or empty; law: "normal" (mean, standard deviation) or "uniform" (from, to). words:
    what the values 0, 1, .. stand for where it takes words, as kinds of grips and clips are.
    """

    name: str
    values: Array
    law: str = ""
    a: float = math.nan
    b: float = math.nan
    words: tuple[str, ...] = ()

    def told(self, value: float) -> float | str:
        """What stands in the file for a value."""
        return self.words[int(value)] if self.words else float(value)

    def shown(self, value: float) -> str:
        """The same to be read."""
        return self.words[int(value)] if self.words else f"{value:.6g}"

    def column(self, values: Array) -> NDArray[Any]:
        """The same of many, as a table has them."""
        return np.array([self.words[int(x)] for x in values.tolist()]) if self.words else values

    def span(self, values: Array) -> str:
        """From where to where values (k,) go, or which words they are."""
        if self.words:
            return ", ".join(self.shown(x) for x in np.unique(values).tolist())
        return f"{values.min():.6g} to {values.max():.6g}"

    def at(self, shares: Array) -> Array:
        """Values at cumulative shares (k,) of a distribution."""
        if self.law == "uniform":
            return np.asarray(self.a + shares * (self.b - self.a))
        from scipy.special import ndtri

        return np.asarray(self.a + self.b * ndtri(np.clip(shares, _EDGE, 1.0 - _EDGE)))

    @property
    def spread(self) -> float:
        """Standard deviation of a distribution."""
        return self.b if self.law == "normal" else (self.b - self.a) / math.sqrt(12.0)

    @property
    def middle(self) -> float:
        """Mean of a distribution, or the value in the middle of a list."""
        if not self.law:
            return float(self.values[len(self.values) // 2])
        return self.a if self.law == "normal" else 0.5 * (self.a + self.b)


@final
class Sample(NamedTuple):
    """How points of distributions are drawn."""

    kind: str = "sobol"
    points: int = 256
    seed: int = 0

    def shares(self, dimensions: int) -> Array:
        """(points, dimensions), between 0 and 1."""
        from scipy.stats import qmc

        rng = np.random.default_rng(self.seed)
        if self.kind == "random":
            return np.asarray(rng.random((self.points, dimensions)))
        if self.kind == "latin":
            return np.asarray(qmc.LatinHypercube(dimensions, rng=rng).random(self.points))
        drawn = qmc.Sobol(dimensions, rng=rng).random_base2(max(self.points - 1, 0).bit_length())
        return np.asarray(drawn[: self.points])


def axis_of(name: str, told: Any) -> Axis:
    """An axis from a list of values, a range or a distribution."""
    where = f"vary.{name}"
    if not isinstance(told, Mapping):
        remedy = "Write a list of numbers, {from: .., to: .., step: ..} or {normal: [mean, deviation]}."
        if isinstance(told, (list, tuple)) and told and all(isinstance(one, str) for one in told):
            if len(set(told)) < len(told):
                raise ArgumentError.of(where, told, "a word is named twice", "Keep one.")
            return Axis(name, np.arange(float(len(told))), words=tuple(told))
        values = checks.numbers(where, told, remedy)
        if values.ndim != 1 or not values.size:
            raise ArgumentError.of(where, told, "it must be a list of at least one number", remedy)
        return Axis(name, checks.vector(where, values, values.size))
    law = next((law for law in DISTRIBUTIONS if law in told), "")
    if law:
        checks.known_keys(where, told, (law,))
        a, b = checks.vector(f"{where}.{law}", told[law], 2).tolist()
        if law == "normal":
            checks.number(f"{where}.normal[1]", b, above=0.0, remedy="Give the mean and the standard deviation.")
        elif not b > a:
            raise ArgumentError.of(f"{where}.uniform", [a, b], "the second must be above the first", "Exchange them.")
        return Axis(name, np.empty(0), law, a, b)
    return Axis(name, _range(where, told))


def _range(where: str, told: Mapping[str, Any]) -> Array:
    """(k,): both ends are among them."""
    checks.known_keys(where, told, (*RANGE_KEYS, *DISTRIBUTIONS))
    for key in ("from", "to"):
        if key not in told:
            raise ArgumentError(f"{where}: the key {key!r} is missing. Write {{from: .., to: .., step: ..}}.")
    a, b = (checks.number(f"{where}.{key}", told[key]) for key in ("from", "to"))
    if ("step" in told) == ("count" in told):
        raise ArgumentError.of(where, dict(told), "it needs either step or count", "Write step: 0.001, or count: 11.")
    if "count" in told:
        return np.linspace(a, b, checks.integer(f"{where}.count", told["count"], at_least=1, at_most=MOST_POINTS))
    step = checks.number(f"{where}.step", told["step"], above=0.0)
    if not b >= a:
        raise ArgumentError.of(where, dict(told), "the range is empty: to is below from", "Exchange the two.")
    steps = (b - a) / step
    if steps > MOST_POINTS:
        raise ArgumentError.of(f"{where}.step", step, f"at most {MOST_POINTS} values are allowed", "Take a larger one.")
    return np.asarray(a + step * np.arange(math.floor(steps + 1e-9) + 1))


def sample_of(told: Any) -> Sample:
    """How to draw, from the mapping of a file."""
    given = checks.mapping("sample", told, SAMPLE_KEYS, "Write {kind: sobol, points: 256, seed: 0}.")
    kind = checks.one_of("sample.kind", given.get("kind", "sobol"), SAMPLES)
    points = checks.integer("sample.points", given.get("points", 256), at_least=1, at_most=MOST_POINTS)
    return Sample(kind, points, checks.integer("sample.seed", given.get("seed", 0), at_least=0))


def points_of(axes: Sequence[Axis], sample: Sample) -> Array:
    """(p, axes): every combination of the lists, with every point of the distributions; the first axis varies least."""
    lists, laws = [a for a in axes if not a.law], [a for a in axes if a.law]
    draws = sample.points if laws else 1
    count = math.prod(len(axis.values) for axis in lists) * draws
    if count > MOST_POINTS:
        raise ArgumentError.of("vary", f"{count} points", f"at most {MOST_POINTS} are allowed", "Take larger steps.")
    grid = np.meshgrid(*(axis.values for axis in lists), np.arange(draws), indexing="ij")
    columns = {axis.name: part.ravel() for axis, part in zip(lists, grid, strict=False)}
    if laws:
        shares = sample.shares(len(laws))
        rows = grid[-1].ravel()
        columns |= {axis.name: axis.at(shares[:, i])[rows] for i, axis in enumerate(laws)}
    return np.column_stack([columns[axis.name] for axis in axes]) if axes else np.empty((1, 0))


def varied(values: Mapping[str, Any], names: Sequence[str], row: Sequence[float | str]) -> dict[str, Any]:
    """A copy of a study's mapping with these numbers or words in their places.

    Raises
    ------
    ArgumentError
        Where a name leads to nothing.
    """
    out: dict[str, Any] = dict(values)
    for name, value in zip(names, row, strict=True):
        put(out, name, value)
    return out


def put(values: dict[str, Any], name: str, number: float | str) -> None:
    """Puts a number or a word in its place; what lies on the way there is copied, and nothing else."""
    keys = name.split(".")
    inside: Any = values
    for i, key in enumerate(keys):
        at = _key(inside, key, ".".join(keys[: i + 1]))
        if i == len(keys) - 1:
            inside[at] = number
            return
        there = inside.get(at) if isinstance(inside, dict) else inside[at]
        if there is None:
            there = {}
        inside[at] = inside = copy.copy(there) if isinstance(there, dict) else list(there) if _listed(there) else there


def get(values: Mapping[str, Any], name: str) -> Any:
    """What stands there; None if nothing does."""
    inside: Any = values
    keys = name.split(".")
    for i, key in enumerate(keys):
        if inside is None:
            return None
        at = _key(inside, key, ".".join(keys[: i + 1]))
        inside = inside.get(at) if isinstance(inside, Mapping) else inside[at]
    return inside


def _listed(value: object) -> bool:
    return isinstance(value, (list, tuple, np.ndarray))


def _key(inside: Any, key: str, where: str) -> Any:
    """A key of a mapping, or the number of a list's item."""
    if isinstance(inside, Mapping):
        return key
    if not _listed(inside):
        raise ArgumentError.of("vary", where, "this place is no part of the study", "Name keys of the file, with dots.")
    names = [item.get("name") if isinstance(item, Mapping) else None for item in inside]
    if key in names:
        return names.index(key)
    number = int(key) if key.isdecimal() else _COMPONENTS.get(key, -1) if len(inside) in (3, 4) else -1
    if not 0 <= number < len(inside):
        known = [name for name in names if name] or [str(i) for i in range(len(inside))]
        raise UnknownKeyError.among(f"vary: {where}", key, known)
    return number
