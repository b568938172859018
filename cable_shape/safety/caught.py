"""Whether a body holds a cable back: :class:`Caught`, of bodies around which grips that go on draw it taut.

A cable at ease is pressed on what it lies on by no more than it weighs, and by what its ends bend it with, so many
times EI / L^2. One that is hooked pulls, and the body that it is hooked on carries what that pull is turned by: both
grow without end as the grips go on. So a body has caught it where its force on the cable, and the tension there, are
larger than those of any cable at ease.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import final

import numpy as np

from cable_shape.cable.cable import Cable
from cable_shape.cable.pieces import pieces_of
from cable_shape.checks import Array
from cable_shape.pose import FreeEnd
from cable_shape.safety.clearance import NOT_JUDGED
from cable_shape.safety.report import Margin, WarningKind
from cable_shape.scene.scene import Scene
from cable_shape.shape import CableShape, Status

#: What a cable at ease pulls by, in EI / L^2, beside its weight.
_STIFF = 10.0
#: Columns of `CableShape.touches`.
_ARC, _BODY, _NORMAL, _FORCE, _ALONG = 0, 1, slice(5, 8), 8, slice(9, 12)


@final
class Caught:
    """The bodies that have caught one cable; `cables`: all that hang on it, of which it is one, by default itself."""

    def __init__(self, cable: Cable, scene: Scene, gravity: Array, cables: Iterable[Cable] | None = None) -> None:
        hanging = [piece for one in (cables or (cable,)) for piece in pieces_of(one)]
        mass = sum((end - start) * one.linear_density for start, end, one in hanging)
        mass += sum(mass.mass for mass in scene.masses)
        self._gravity = float(np.linalg.norm(gravity))
        bend = max(max(one.bending_stiffness) for _, _, one in pieces_of(cable))
        self._ease = mass * self._gravity + _STIFF * bend / cable.length**2
        self._allows: dict[str, list[tuple[float, float]]] = {}
        for allow in scene.allow:
            self._allows.setdefault(allow.body, []).append(allow.stretch)

    def margins(self, shape: CableShape, end: object = None) -> tuple[Margin, ...]:
        """One of each body that pushes a usable shape, but where that is meant (`Scene.allow`).

        `value` [N]: the body's force on the cable in all; `limit` [N]: what cables at ease are pushed by; `used`: that
        force, or the tension there if it is less, over the limit. end: what holds the cable's end, if anything: a free
        end's load is one more.
        """
        rows = shape.touches
        if not len(rows) or shape.status in NOT_JUDGED or shape.status is Status.OVERSTRETCHED:
            return ()
        limit = self._ease
        if isinstance(end, FreeEnd):
            limit += end.mass * self._gravity + float(np.linalg.norm(end.force))
        forces = rows[:, [_FORCE]] * rows[:, _NORMAL] + rows[:, _ALONG]
        found = []
        for body in dict.fromkeys(rows[:, _BODY].tolist()):
            name = shape.bodies[int(body)]
            own = np.flatnonzero(rows[:, _BODY] == body)
            for low, high in self._allows.get(name, ()):
                own = own[(rows[own, _ARC] < low) | (rows[own, _ARC] > high)]
            if not own.size:
                continue
            force = math.hypot(*forces[own].sum(axis=0))
            at = float(rows[own[rows[own, _FORCE].argmax()], _ARC])
            pull = float(np.interp(at, shape.arc_length, shape.tension))
            if limit > 0.0:
                found.append(Margin(WarningKind.CAUGHT, min(force, pull) / limit, limit, force, at, name))
        return tuple(found)
