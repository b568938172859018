"""What a calibration of several cables may fit: :class:`CablesParameters`, the numbers of all of them in one vector."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import final

import numpy as np

from cable_shape import checks
from cable_shape.cable.cable import Cable
from cable_shape.calibration.parameters import KNOWN, ROWS, Parameter, Parameters
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError, UnknownKeyError
from cable_shape.pose import Pose

#: After the kind: of every cable by itself.
EACH = "each"
_WRITE = "Write KIND, KIND:CABLE, KIND:CABLE+CABLE or KIND:each."


@final
class CablesParameters:
    """The numbers to be fitted, in their order, about cables to start from.

    fit: kinds of :data:`cable_shape.calibration.parameters.KNOWN`, alone of all cables together, as "KIND:a" of one,
    "KIND:a+b" of several that are alike, "KIND:each" of every one by itself; priors: standard deviation by name, or by
    kind. What cables share changes by the same logarithm, of lengths by the same share, else by as much.
    """

    def __init__(
        self,
        cables: Mapping[str, Cable],
        fit: str | Sequence[str],
        priors: Mapping[str, float] | None = None,
        supports: int = ROWS,
    ) -> None:
        given = (fit,) if isinstance(fit, str) else checks.entries("fit", fit, str, _WRITE)
        targets = [(name, one, *_meant(one, cables)) for name in given for one in _spelt_out(name, cables)]
        if not targets:
            raise ArgumentError.of("fit", given, "it must name something", _WRITE)
        kinds = {kind for _, _, kind, _ in targets}
        names = {one for _, one, _, _ in targets}
        known = checks.mapping("priors", priors, (*names, *kinds, *given), "Write {name: standard deviation}.")
        own: dict[str, list[str]] = {name: [] for name in cables}
        told: dict[str, dict[str, float]] = {name: {} for name in cables}
        for name, one, kind, run in targets:
            for cable in run:
                if kind in own[cable]:
                    raise ArgumentError.of("fit", one, f"{kind} of {cable!r} is fitted twice", "Name every cable once.")
                own[cable].append(kind)
            prior = next((known[key] for key in (one, name, kind) if key in known), None)
            if prior is not None:
                told[run[0]][kind] = prior
        self.cables = dict(cables)
        self.names = tuple(one for _, one, _, _ in targets)
        #: The numbers of each cable of which any are fitted, as they are of it alone.
        self.parts = {name: Parameters(cables[name], own[name], told[name], supports) for name in cables if own[name]}
        self._lay_out([(one, kind, run) for _, one, kind, run in targets])

    def _lay_out(self, targets: Sequence[tuple[str, str, tuple[str, ...]]]) -> None:
        """Puts the numbers of the first of the cables that share them one after the other."""
        self.each: list[Parameter] = []
        begins: list[Array] = []
        spreads: list[tuple[str, slice, slice, float]] = []
        blocks: list[tuple[slice, Array]] = []
        for one, kind, run in targets:
            first, at = self.parts[run[0]], len(self.each)
            where, suffix = first.where(kind), one.removeprefix(kind)
            for p in first.each[where]:
                self.each.append(Parameter(p.name + suffix, p.unit, p.step, p.most, p.log, p.prior))
            begins.append(first.start[where])
            whole = slice(at, len(self.each))
            blocks.append((whole, first.precision[where, where]))
            for name in run:
                share = self.cables[name].length / self.cables[run[0]].length if kind == "length" else 1.0
                spreads.append((name, self.parts[name].where(kind), whole, share))
        self.start: Array = np.concatenate(begins)
        self.precision: Array = np.zeros((len(self.each), len(self.each)))
        for whole, block in blocks:
            self.precision[whole, whole] = block
        #: (own, k) of each cable: how its own numbers go with those fitted.
        self.spread = {name: np.zeros((len(part.each), len(self.each))) for name, part in self.parts.items()}
        for name, own, whole, share in spreads:
            self.spread[name][own, whole] = share * np.eye(whole.stop - whole.start)

    @classmethod
    def alone(cls, name: str, parameters: Parameters) -> CablesParameters:
        """Those of one cable."""
        made = object.__new__(cls)
        made.cables, made.names, made.parts = {name: parameters.cable}, parameters.names, {name: parameters}
        made.each, made.start, made.precision = parameters.each, parameters.start, parameters.precision
        made.spread = {name: np.eye(len(parameters.each))}
        return made

    def own(self, name: str, values: Array) -> Array:
        """A cable's own numbers."""
        return np.asarray(self.parts[name].start + self.spread[name] @ (values - self.start))

    def make(self, values: Array) -> dict[str, Cable]:
        """The cables of these numbers."""
        return {
            name: self.parts[name].make_cable(self.own(name, values)) if name in self.parts else cable
            for name, cable in self.cables.items()
        }

    def offset(self, name: str, values: Array, side: str) -> Pose | None:
        """How a cable's frame at the "start" or "end" lies beside what its grip says; None: as it says."""
        return self.parts[name].offset(self.own(name, values), side) if name in self.parts else None

    @property
    def longest(self) -> float:
        """[m]."""
        return max((cable.length for cable in self.cables.values()), default=math.nan)


def _spelt_out(name: str, cables: Mapping[str, Cable]) -> list[str]:
    """The names that one stands for."""
    kind, _, where = name.partition(":")
    return [f"{kind}:{cable}" for cable in cables] if where == EACH and EACH not in cables else [name]


def _meant(name: str, cables: Mapping[str, Cable]) -> tuple[str, tuple[str, ...]]:
    """The kind that a name says, and of which cables."""
    kind, colon, where = name.partition(":")
    if kind not in KNOWN:
        raise UnknownKeyError.among("fit", kind, KNOWN)
    run = ((where,) if where in cables else tuple(where.split("+"))) if colon else tuple(cables)
    for cable in run:
        if cable not in cables:
            raise UnknownKeyError.among(f"fit: {kind}", cable, (*cables, EACH))
    if len(set(run)) < len(run):
        raise ArgumentError.of("fit", name, "it names a cable twice", "Name every cable once.")
    return kind, run
