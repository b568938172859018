"""Newton's step of cables that press on each other at points: :func:`crossing_step`.

Two cables touch where their centrelines come nearest, d = y_a - y_b at right angles to both tangents. With the unit
normal n = d / |d| a contact is in balance if

    F_a = p n,   F_b = -p n,   n . t_a = n . t_b = 0,   |d| >= R,  p >= 0,  p (|d| - R) = 0,

F the forces that hold the cables at their points. Unknown are both places y, both arc lengths s and p. Moving a point
along its own cable, y with s, changes no force: in the coordinates (eta, s), y = eta + t s, the nearest points follow
from eta alone by a well-conditioned 2x2 system, also where p = 0. What is left in eta is the second variation of
energy - p |d|, symmetric at the solution: shifted until it is positive on the active contacts' tangent space, it leads
downhill; there it is positive iff the equilibrium is stable.

Where the point of a cable is itself on a body (a cable that crosses another lying on a table presses it there), the
body's push q m belongs to the balance, F_a = p n + q m, with the body's gap g(y_a) >= 0, q >= 0 and q g = 0 beside it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import final

import numpy as np
from numpy.typing import NDArray

from cable_shape.checks import Array

_NEUTRAL = 1e-9  #: of the largest eigenvalue: softer modes are neutral, and neutral is stable
_LEAST = 1e-3  #: of the largest eigenvalue: how stiff a shift makes the softest mode
_OVERSHOT, _MOST_CUTS = 0.5, 4
_DUST = 1e-9  #: of the largest force at a point: a contact that presses with less has ended


@final
@dataclass(frozen=True, slots=True, eq=False)
class Ground:
    """A body near a point: its row in the bodies' table, the gap [m], its normal (3,) there, the gap's second
    derivative (3, 3) [1/m], and the force [N] with which it presses on the point."""

    body: int
    gap: float
    normal: Array
    curved: Array
    press: float


@final
@dataclass(slots=True, eq=False)
class Spot:
    """Two points that touch, or nearly: on cables `a` and `b`, which may be one, with the numbers of their points.

    arcs (2,) [m]; places (2, 3) [m]; press [N], 0 where they do not touch; reach [m]: least distance of the
    centrelines; before (2,) [m]: the arc lengths in the last equilibrium that was accepted; grounds: the bodies near
    each of the points.
    """

    cables: tuple[int, int]
    arcs: Array
    places: Array
    reach: float
    before: Array
    press: float = 0.0
    points: tuple[int, int] = (0, 0)
    grounds: tuple[list[Ground], list[Ground]] = field(default_factory=lambda: ([], []))

    @property
    def apart(self) -> Array:
        """(3,) [m], from the point on the second cable to that on the first."""
        return np.asarray(self.places[0] - self.places[1])

    @property
    def distance(self) -> float:
        """[m], of the centrelines."""
        return float(np.linalg.norm(self.apart))

    @property
    def normal(self) -> Array:
        """(3,), unit, out of the second cable."""
        return np.asarray(self.apart / self.distance)

    def copy(self) -> Spot:
        """Once more, arrays and all."""
        return Spot(
            self.cables, self.arcs.copy(), self.places.copy(), self.reach, self.before, self.press, self.points,
            self.grounds,
        )  # fmt: skip


@final
@dataclass(frozen=True, slots=True)
class Step:
    """places (k, 2, 3) and arcs (k, 2): the step; press (k,): the forces after it; stable: no mode goes downhill.

    pushes (g,): those of the bodies near the points, in their order; softest (k, 2, 3): direction of the softest mode.
    """

    places: Array
    arcs: Array
    press: Array
    pushes: Array
    stable: bool
    softest: Array


@final
@dataclass(slots=True, eq=False)
class Way:
    """A fraction of a step from points at `arcs` (k, 2) and `places` (k, 2, 3), tangents (2 k, 3) there.

    slope [J]: how the energy changes along it at its beginning, NaN if it does not lead downhill.
    """

    step: Step
    arcs: Array
    places: Array
    fraction: float
    tangents: Array = field(default_factory=lambda: np.empty(0))
    slope: float = math.nan
    cuts: int = 0

    @property
    def end(self) -> tuple[Array, Array]:
        """Where it leads."""
        return self.arcs + self.fraction * self.step.arcs, self.places + self.fraction * self.step.places

    def overshot(self, slope: float) -> bool:
        """Shortens a way that goes uphill at its end about as steeply as downhill at its beginning, to where it turns.

        Which nodes of a cable touch a body changes on the way, which a step does not foresee.
        """
        if not (self.slope < 0.0 and slope > -_OVERSHOT * self.slope) or self.cuts >= _MOST_CUTS:
            return False
        self.cuts += 1
        self.fraction *= min(max(self.slope / (self.slope - slope), 0.1), 0.7)
        return True


def crossing_step(spots: list[Spot], force: Array, tangent: Array, dforce: Array, dtangent: Array) -> Step:
    """The step that meets the conditions to first order, with contacts that pull let go and such as would overlap held.

    force, tangent (2 k, 3) of the points, both of each spot in turn; dforce, dtangent (2 k, 3, 2 k, 4): their
    derivatives in the points' places and arc lengths.
    """
    k = len(spots)
    sides = [(2 * c + side, near) for c, spot in enumerate(spots) for side, near in enumerate(spot.grounds)]
    grounds = [(i, ground) for i, near in sides for ground in near]
    n = np.array([spot.normal for spot in spots])
    across, signs = np.zeros((2 * k, 3, 6 * k)), np.tile((1.0, -1.0), k)  # of the normal at a point, by eta
    slope = np.zeros((k + len(grounds), 6 * k))  # of the distances and the gaps
    follow = np.zeros((2 * k, 3, 2 * k))  # of the normal, by the arc lengths
    for c, spot in enumerate(spots):
        turn = (np.eye(3) - np.outer(n[c], n[c])) / spot.distance
        for side, sign in enumerate((1.0, -1.0)):
            at = 3 * (2 * c + side)
            across[2 * c : 2 * c + 2, :, at : at + 3] = sign * turn
            slope[c, at : at + 3] = sign * n[c]
            follow[2 * c : 2 * c + 2, :, 2 * c + side] = sign * turn @ tangent[2 * c + side]
    normals, press = np.repeat(n, 2, axis=0), np.repeat([spot.press for spot in spots], 2)
    along = np.einsum("ixja,ja->ixj", dtangent[..., :3], tangent) + dtangent[..., 3]  # by arc lengths, with the places
    by_place = dtangent[..., :3].reshape(2 * k, 3, 6 * k)
    # n . t: residual, and its derivatives in the arc lengths and in eta
    askew = np.einsum("ix,ix->i", normals, tangent)
    by_arc = np.einsum("ix,ixj->ij", normals, along) + np.einsum("ix,ixj->ij", tangent, follow)
    by_eta = np.einsum("ix,ixj->ij", normals, by_place) + np.einsum("ix,ixj->ij", tangent, across)
    solved = np.linalg.solve(by_arc, np.column_stack((by_eta, askew)))
    ds_eta, ds = -solved[:, :-1], -solved[:, -1]
    # F - sign p n at the present p: residual without p n, and the derivatives
    drag = np.einsum("ixja,ja->ixj", dforce[..., :3], tangent) + dforce[..., 3]
    weight = (signs * press)[:, None, None]
    stiff_arc = (drag - weight * follow).reshape(6 * k, 2 * k)
    stiff = (dforce[..., :3].reshape(2 * k, 3, 6 * k) - weight * across).reshape(6 * k, 6 * k)
    for i, ground in grounds:
        own = slice(3 * i, 3 * i + 3)
        stiff[own, own] -= ground.press * ground.curved
        stiff_arc[own, i] -= ground.press * ground.curved @ tangent[i]
    stiff = stiff + stiff_arc @ ds_eta
    pull = force.reshape(6 * k) + stiff_arc @ ds
    stiff = 0.5 * (stiff + stiff.T)
    gap = np.array([*(spot.distance - spot.reach for spot in spots), *(ground.gap for _, ground in grounds)])
    # moving along the cables changes the distance by n . t only, which is to vanish, and a gap by its m . t
    slant = np.zeros((len(gap), 2 * k))
    slant[:k] = _pairs(k) * (signs * askew)
    for row, (i, ground) in enumerate(grounds, k):
        slope[row, 3 * i : 3 * i + 3] = ground.normal
        slant[row, i] = ground.normal @ tangent[i]
    drift = slope + slant @ ds_eta
    rest = gap + slant @ ds
    pressed = [*(spot.press > 0.0 for spot in spots), *(ground.press > 0.0 for _, ground in grounds)]
    active = np.array(pressed) | (gap < 0.0)
    for _ in range(2 * len(active) + 4):
        step, after, stable, softest = _held(stiff, pull, drift, slope, rest, active)
        left = rest + drift @ step
        now = np.where(active, after > 0.0, left < -1e-12)
        if (now == active).all():
            break
        worst = int(np.flatnonzero(now != active)[0])
        active[worst] = now[worst]
    moved = ds + ds_eta @ step
    places = step.reshape(2 * k, 3) + tangent * moved[:, None]
    after[after < _DUST * np.abs(force).max()] = 0.0
    return Step(
        places.reshape(k, 2, 3), moved.reshape(k, 2), after[:k], after[k:], stable, softest.reshape(k, 2, 3)
    )  # fmt: skip


def _pairs(k: int) -> Array:
    """(k, 2 k): which points are a spot's."""
    return np.repeat(np.eye(k), 2, axis=1)


def _held(
    stiff: Array, pull: Array, drift: Array, slope: Array, rest: Array, active: NDArray[np.bool_]
) -> tuple[Array, Array, bool, Array]:
    """Step, forces of the contacts, whether the stiffness is positive where the active ones leave it free, and how."""
    m, held = len(pull), int(active.sum())
    basis = np.linalg.qr(slope[active].T, mode="complete")[0][:, held:] if held else np.eye(m)
    values, vectors = np.linalg.eigh(basis.T @ stiff @ basis)
    largest = max(float(np.abs(values).max()), 1e-300)
    stable = bool(values[0] > -_NEUTRAL * largest)
    if not stable:
        lifted = np.maximum(np.abs(values), _LEAST * largest) - values
        stiff = stiff + basis @ (vectors * lifted) @ vectors.T @ basis.T
    system = np.zeros((m + held, m + held))
    system[:m, :m], system[:m, m:], system[m:, :m] = stiff, -slope[active].T, drift[active]
    solution = np.linalg.lstsq(system, np.concatenate((-pull, -rest[active])), rcond=1e-14)[0]
    after = np.zeros(len(active))
    after[active] = solution[m:]
    return np.asarray(solution[:m]), after, stable, np.asarray(basis @ vectors[:, 0])
