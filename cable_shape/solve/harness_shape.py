"""What comes out for a harness: :class:`HarnessShape`."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any, final

import numpy as np

from cable_shape.cable.harness import Harness, split_end
from cable_shape.cable.pieces import energy_of_sections
from cable_shape.checks import Array
from cable_shape.pose import Pose
from cable_shape.shape import NO_TOUCHES, NOT_RUBBED, NUMBERS_PER_POINT, CableShape, ClipLoad, Status, clip_loads


def junctions_of(harness: Harness, segments: Mapping[str, CableShape]) -> dict[str, Pose]:
    """The frame of each junction in the world, by its name: that of its first end, its entry undone."""
    out = {}
    for junction in harness.junctions:
        end = junction.ends[0]
        name, side = split_end(end)
        shape, i = segments[name], 0 if side == "start" else -1
        at = Pose(shape.positions[i], shape.quaternions[i])
        out[junction.name] = at * junction.frame(end).inverse()
    return out


@final
class HarnessShape:
    """The predicted shape of one harness: a :class:`CableShape` a segment, and where its junctions are.

    Attributes
    ----------
    status, detail : Status, str
        Of the whole; every segment's shape has the same.
    energy : float
        [J], elastic + gravitational, zero at the world origin; that of each segment is in its own shape, without
        masses.
    error_estimate, force_error, moment_error : float
        [m], [N], [N m], estimated largest errors over all segments.
    residual, iterations, solve_time, missing_length, reused, before
        As of a CableShape.
    kinetic_energy, work, dissipated, lost : float
        [J], of a harness in motion, as of a CableShape.
    clips : tuple of ClipLoad
        What the harness does to the scene's clips, in their order.
    frictionless : bool
        Eyelets have friction, which the shape does not know: it has no past.
    """

    def __init__(
        self,
        harness: Harness,
        buffer: Array,
        points: int,
        *,
        model: str,
        status: Status,
        detail: str = "",
        energy: float = math.nan,
        energies: Array | None = None,
        twists: Array | None = None,
        error_estimate: float = math.inf,
        force_error: float = math.inf,
        moment_error: float = math.inf,
        residual: float = math.inf,
        iterations: int = 0,
        solve_time: float = 0.0,
        missing_length: float = 0.0,
        reused: bool = False,
        before: HarnessShape | None = None,
        clips: Array | None = None,
        clips_of: Mapping[str, list[int]] | None = None,
        rubbed: Array = NOT_RUBBED,
        frictionless: bool = False,
        touches: Sequence[Array] = (),
        bodies: tuple[str, ...] = (),
        velocity: Array | None = None,
        kinetic_energy: float = 0.0,
        work: float = 0.0,
        dissipated: float = 0.0,
        lost: float = 0.0,
    ) -> None:
        self.harness = harness
        self.buffer = buffer  # (17 n c,): that of one CableShape a segment
        self.points = points
        self.model = model
        self.status = status
        self.detail = detail
        self.energy = energy
        self.energies = energies  # (c,) J
        self.twists = twists  # (c,) rad
        self.error_estimate = error_estimate
        self.force_error = force_error
        self.moment_error = moment_error
        self.residual = residual
        self.iterations = iterations
        self.solve_time = solve_time
        self.missing_length = missing_length
        self.reused = reused
        self.before = before
        self.supports = np.empty((0, 7)) if clips is None else clips  # (k, 7), of each clip, in the scene's order
        self._clips_of = clips_of or {}
        self.rubbed = rubbed  # (k, 2), as of a CableShape
        self.frictionless = frictionless
        self.touches = touches  # of each segment (k, TOUCH), or none at all, see CableShape
        self.bodies = bodies
        self.velocity = velocity  # (c n, 3) [m/s], world, of one segment after the other; None: at rest
        self.kinetic_energy = kinetic_energy
        self.work = work
        self.dissipated = dissipated
        self.lost = lost

    def on(
        self, harness: Harness, segments: Mapping[str, CableShape], clips_of: Mapping[str, list[int]]
    ) -> HarnessShape:
        """These shapes of a harness's segments, with as many parts as this one's, as one; the rest is as here.

        clips_of: the numbers of each segment's clips in the scene.
        """
        size = NUMBERS_PER_POINT * self.points
        levers = self.buffer[size * len(self.harness.segments) :]
        clips = np.zeros((sum(map(len, clips_of.values())), 7))
        rubbed = np.zeros((len(clips), 2))
        for name, numbers in clips_of.items():
            clips[numbers] = segments[name].supports
            if len(segments[name].rubbed):
                rubbed[numbers] = segments[name].rubbed
        other = self.again()
        other.harness, other.reused = harness, False
        other.buffer = np.concatenate([*(segments[name].buffer for name in harness.segments), levers])
        other.supports, other._clips_of, other.rubbed = clips, clips_of, rubbed
        other.touches = [segments[name].touches for name in harness.segments]
        rates = [one.velocity for one in (segments[name] for name in harness.segments) if one.velocity is not None]
        other.velocity = np.concatenate(rates) if len(rates) == len(harness.segments) else None
        other.twists = np.array([segments[name].twist for name in harness.segments])
        return other

    @property
    def usable(self) -> bool:
        """Whether the shape may be acted on: what the status says."""
        return bool(self.status)

    @property
    def clips(self) -> tuple[ClipLoad, ...]:
        """Where each clip of the scene holds the harness, and the force and moment on it; in the scene's order."""
        return clip_loads(self.supports, self.rubbed)

    @cached_property
    def segments(self) -> dict[str, CableShape]:
        """The shape of each segment, by its name."""
        size = NUMBERS_PER_POINT * self.points
        out = {}
        for i, (name, cable) in enumerate(self.harness.segments.items()):
            out[name] = CableShape(
                self.buffer[i * size : (i + 1) * size],
                self.points,
                length=cable.length,
                model=self.model,
                status=self.status,
                detail=self.detail,
                energy=math.nan if self.energies is None else float(self.energies[i]),
                error_estimate=self.error_estimate,
                residual=self.residual,
                iterations=self.iterations,
                solve_time=self.solve_time,
                reused=self.reused,
                twist=0.0 if self.twists is None else float(self.twists[i]),
                supports=self.supports[self._clips_of.get(name, [])],
                rubbed=self.rubbed[self._clips_of.get(name, [])] if len(self.rubbed) else NOT_RUBBED,
                frictionless=self.frictionless,
                force_error=self.force_error,
                moment_error=self.moment_error,
                touches=self.touches[i] if len(self.touches) else NO_TOUCHES,
                bodies=self.bodies,
                velocity=None if self.velocity is None else self.velocity[i * self.points : (i + 1) * self.points],
            )
        return out

    @cached_property
    def junctions(self) -> dict[str, Pose]:
        """The frame of each junction in the world, by its name."""
        return junctions_of(self.harness, self.segments)

    def weigh_sections(self, gravity: Array) -> None:
        """Adds to the energies what sections weigh more than the rest of their segments."""
        for i, (name, cable) in enumerate(self.harness.segments.items()):
            if not cable.sections:
                continue
            more = energy_of_sections(cable, self.segments[name], gravity)
            self.segments[name].energy += more
            self.energy += more
            if self.energies is not None:
                self.energies[i] += more

    def again(self) -> HarnessShape:
        """The same shape, marked as reused: arrays are shared, the time is 0."""
        other = object.__new__(HarnessShape)
        kept: dict[str, Any] = {k: v for k, v in vars(self).items() if k not in ("segments", "junctions")}
        vars(other).update(kept, reused=True, solve_time=0.0, iterations=0)
        return other

    def __repr__(self) -> str:
        detail = f", {self.detail}" if self.detail else ""
        return (
            f"HarnessShape({self.model}, {self.status.name}{detail}, {len(self.harness.segments)} segments, error "
            f"estimate {self.error_estimate:.2g} m, {self.iterations} iterations, {self.solve_time * 1e6:.0f} us)"
        )
