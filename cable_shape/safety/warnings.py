"""What to warn about: :func:`warnings_of`, from margins to words with a remedy."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import final

import numpy as np

from cable_shape.cable.cable import Cable
from cable_shape.safety.clearance import DEEPEST_REST, NOT_JUDGED
from cable_shape.safety.margins import margins_of
from cable_shape.safety.report import BodyDistance, CableWarning, Clearance, Margin, Severity, WarningKind
from cable_shape.scene.scene import Scene
from cable_shape.shape import CableShape, Status
from cable_shape.solve.problem import TAIL_TOLERANCE
from cable_shape.uncertainty.uncertainty import Tube

#: A load is warned of from this fraction of its limit, and is an error at the limit.
WARN_FRACTION = 0.9
#: The stretch of a cable is warned of from this fraction of its length: up to there it hangs slack without harm.
STRETCH_FRACTION = 0.99
#: The inertial load is an error from so many times its limit on: by default where it is as large as the weight.
INERTIA_ERROR = 4.0
#: A warning is over, and an error a mere warning again, this fraction below where it began.
HYSTERESIS = 0.05
#: Of the length: the limit of STATUS warnings if the tolerance is not given.
_LIMIT = 1e-3
_FROM = "from the start grip"


@final
@dataclass(frozen=True, slots=True)
class Levels:
    """From which `used` on there is a warning, and an error."""

    warn: float
    error: float

    @classmethod
    def of(cls, kind: WarningKind, warn_distance: float, error_distance: float) -> Levels:
        """Of one kind of margin, with the distances [m] of a scene."""
        if kind is WarningKind.CLEARANCE:
            limit = max(warn_distance, error_distance)
            error = 2.0 - error_distance / limit if limit > 0.0 else 1.0
            return cls(math.nextafter(1.0, 2.0), math.nextafter(error, 3.0))  # at the very distance all is still well
        if kind is WarningKind.QUASISTATIC:
            return cls(1.0, INERTIA_ERROR)
        if kind is WarningKind.CAUGHT:  # what it may come to, the cable's own limits say
            return cls(1.0, math.inf)
        return cls(STRETCH_FRACTION if kind is WarningKind.OVERSTRETCHED else WARN_FRACTION, 1.0)

    def severity(self, used: float, before: Severity | None) -> Severity | None:
        """The severity, given the one of the last cycle."""
        keep = 1.0 - HYSTERESIS
        if used >= (self.error * keep if before is Severity.ERROR else self.error):
            return Severity.ERROR
        if used >= (self.warn if before is None else self.warn * keep):
            return Severity.WARN
        return None


@lru_cache(maxsize=16)
def _levels(warn_distance: float, error_distance: float) -> Mapping[WarningKind, Levels]:
    """Those of all kinds of margins."""
    return {kind: Levels.of(kind, warn_distance, error_distance) for kind in WarningKind}


@final
class Standing:
    """The warnings that stand, for one cable: it gives them hysteresis."""

    __slots__ = ("_levels", "_severities")

    def __init__(self, scene: Scene) -> None:
        self._levels = _levels(scene.warn_distance, scene.error_distance)
        self._severities: dict[tuple[WarningKind, str], Severity] = {}

    def reset(self) -> None:
        """Forgets them all."""
        self._severities = {}

    def go_on_from(self, other: Standing) -> None:
        """Takes over those of another one."""
        self._severities = dict(other._severities)

    def judge(self, margins: tuple[Margin, ...]) -> list[tuple[Margin, Severity]]:
        """The margins to warn of; those that are gone no longer stand."""
        before, now = self._severities, {}
        found = []
        for margin in margins:
            levels = self._levels[margin.kind]
            if margin.used < levels.warn and not before:
                continue
            key = (margin.kind, margin.other)
            severity = levels.severity(margin.used, before.get(key))
            if severity is not None:
                now[key] = severity
                found.append((margin, severity))
        self._severities = now
        return found


def warnings_of(
    cable_id: str,
    cable: Cable,
    scene: Scene,
    shape: CableShape,
    clearance: Clearance,
    tolerance: float | None = None,
    *,
    margins: tuple[Margin, ...] | None = None,
    standing: Standing | None = None,
    period: float = math.nan,
    tails: Sequence[CableShape] = (),
) -> tuple[CableWarning, ...]:
    """All warnings that hold for one cable, errors first, then by falling margin.

    `margin` says how much of a limit is used up, 1 at the limit, as in :mod:`cable_shape.safety.margins`. Loads, stress
    and stability are warned of from 0.9 on, stretch from 0.99, and are errors from 1 on; clearance is warned of below
    the warning distance and an error below the error distance.

    Of a shape that did not converge only that is told, and that clearance and loads were not judged. On the straight
    line of an overstretched cable, or its way past bodies, clearance is judged, loads are not.

    Parameters
    ----------
    cable_id : str
        Name of the cable.
    scene : Scene
        Its warning distances.
    tolerance : float, optional
        [m], that the shape was asked for; the limit of STATUS warnings. Default: 1e-3 of the length.
    margins : optional
        Of this shape. Default: those that it has by itself, see `margins_of`.
    standing : Standing, optional
        The warnings of the last cycle: one that stands is over only 5 % below where it began.
    period : float
        [s], with which the cable swings.
    tails : optional
        That hang beyond the grips, and may lie on bodies, too.
    """
    if margins is None:
        margins = margins_of(cable, scene, shape, clearance)
    found = [
        _warning(cable_id, margin, severity, scene, (shape, *tails), clearance, period)
        for margin, severity in (standing or Standing(scene)).judge(margins)
    ]
    if shape.status is Status.OVERSTRETCHED:
        found = [w for w in found if w.kind is not WarningKind.OVERSTRETCHED]
        found.append(_overstretched(cable_id, shape))
    elif shape.status is not Status.OK:
        found.append(_status(cable_id, shape, _LIMIT * shape.length if tolerance is None else tolerance))
    return tuple(sorted(found, key=lambda w: (-w.severity.value, -w.margin))) if found else ()


def _status(cable_id: str, shape: CableShape, tolerance: float) -> CableWarning:
    """The predictor's own doubts."""
    text = f"{cable_id}: {shape.status.name}. {shape.detail or shape.status.remedy}"
    if shape.status in NOT_JUDGED:
        text += " Clearance and loads were not judged."
    severity = Severity.WARN if shape.status else Severity.ERROR
    return _doubt(cable_id, shape, severity, text, shape.error_estimate, tolerance)


def tail_warning(cable_id: str, side: str, tail: CableShape) -> CableWarning:
    """A tail without a shape, or with one to be looked at."""
    text = f"{cable_id}: tail at the {side}: {tail.status.name}. {tail.detail or tail.status.remedy}"
    if tail.status in NOT_JUDGED:
        text += " Its clearance was not judged."
    severity = Severity.WARN if tail.status else Severity.ERROR
    limit = TAIL_TOLERANCE * tail.length
    return _doubt(cable_id, tail, severity, text, tail.error_estimate, limit, f"{side} tail")


def tube_warning(cable_id: str, shape: CableShape, reason: str) -> CableWarning:
    """How well the shape is known is asked for, and not known."""
    text = f"{cable_id}: no tube is known, {reason}: clearance is that of the predicted line. Keep further away."
    return _doubt(cable_id, shape, Severity.WARN, text, math.nan, math.nan, "tube", margin=1.0)


def narrow_warning(cable_id: str, tube: Tube) -> CableWarning:
    """The tube may be too narrow, see `Tube.holds`."""
    if math.isnan(tube.inertia):
        why = "holds a cable at rest only, and how this one moves is not known"
    else:
        why = f"does not hold: its inertia loads the cable with {100.0 * tube.inertia:.0f} % of its weight"
    text = f"{cable_id}: the tube {why}: clearance may be less. Keep further away."
    shape = tube.shape
    return _doubt(cable_id, shape, Severity.WARN, text, math.nan, math.nan, "tube", margin=1.0)


def bridged_warning(cable_id: str, shape: CableShape, seconds: float) -> CableWarning:
    """Inputs were late or missing, and how the grips moved meanwhile is not known."""
    text = f"{cable_id}: no input for {seconds:.2g} s: as if the grips had gone the straight way. Send them steadily."
    return _doubt(cable_id, shape, Severity.WARN, text, seconds, math.nan, "input", margin=1.0)


def ahead_warnings(
    cable_id: str, scene: Scene, shape: CableShape, clearance: Clearance, time: float, ahead: CableShape,
    body: BodyDistance | None,
) -> list[CableWarning]:  # fmt: skip
    """The cable swings too near to a body after `time` [s] if its grips stop now, and is not there yet."""
    limit = max(scene.warn_distance, scene.error_distance)
    if body is None or body.distance >= limit:
        return []
    if any(now.body == body.body and now.distance < limit for now in clearance.bodies):
        return []
    where = f"{body.body!r} {_at(body.arc_length, shape.length)}"
    near = (
        f"overlaps {where} by {metres(-body.distance)}"
        if body.distance < 0.0
        else f"{metres(body.distance)} from {where}"
    )
    text = f"swings on when the grips stop: {near} in {time:.2g} s. Stop more gently, or further away."
    return [
        CableWarning(
            cable_id=cable_id,
            kind=WarningKind.CLEARANCE,
            severity=Severity.WARN,
            text=_told(cable_id, text),
            value=body.distance,
            limit=limit,
            margin=2.0 - body.distance / limit,
            arc_length=body.arc_length,
            point_on_cable=body.point_on_cable,
            point_on_other=body.point_on_body,
            other=body.body,
            time_to_limit=time,
        )
    ]


def _doubt(
    cable_id: str,
    shape: CableShape,
    severity: Severity,
    text: str,
    value: float,
    limit: float,
    other: str = "",
    margin: float | None = None,
) -> CableWarning:
    """About a shape as a whole; its first point stands for it."""
    point = shape.positions[0]
    return CableWarning(
        cable_id=cable_id,
        kind=WarningKind.STATUS,
        severity=severity,
        text=text,
        value=value,
        limit=limit,
        margin=value / limit if margin is None else margin,
        arc_length=0.0,
        point_on_cable=point,
        point_on_other=point,
        other=other,
    )


def _overstretched(cable_id: str, shape: CableShape) -> CableWarning:
    """The ends are further apart than the cable is long, by themselves or through clips or past bodies."""
    first, last = shape.positions[0], shape.positions[-1]
    span = math.dist(first, last)
    text = (
        f"the grips are {metres(span)} apart, {metres(span - shape.length)} more than the cable is long. "
        "Bring them closer."
    )
    if span < shape.length:
        span, text = shape.length + shape.missing_length, shape.detail
    return CableWarning(
        cable_id=cable_id,
        kind=WarningKind.OVERSTRETCHED,
        severity=Severity.ERROR,
        text=f"{cable_id}: {text}",
        value=span,
        limit=shape.length,
        margin=span / shape.length,
        arc_length=shape.length,
        point_on_cable=last,
        point_on_other=last,
        time_to_limit=0.0,
    )


def snap_warning(cable_id: str, stability: Margin, time: float, shape: CableShape, after: CableShape) -> CableWarning:
    """The cable will snap in `time` [s]; `after`: its shape then."""
    far = np.linalg.norm(after.positions - shape.positions, axis=1)
    at = int(far.argmax())
    return CableWarning(
        cable_id=cable_id,
        kind=WarningKind.SNAP,
        severity=Severity.WARN,
        text=_told(
            cable_id,
            f"snaps to another shape in {time:.2g} s at this speed, moving by up to {metres(float(far[at]))} "
            f"{_at(float(shape.arc_length[at]), shape.length)}. Stop, or move back.",
        ),
        value=stability.value,
        limit=stability.limit,
        margin=stability.used,
        arc_length=float(shape.arc_length[at]),
        point_on_cable=shape.positions[at],
        point_on_other=after.positions[at],
        time_to_limit=time,
    )


def _warning(
    cable_id: str,
    margin: Margin,
    severity: Severity,
    scene: Scene,
    parts: Sequence[CableShape],
    clearance: Clearance,
    period: float,
) -> CableWarning:
    """One margin that is used up, or nearly; parts: the span, and its tails."""
    shape = parts[0]
    if margin.kind is WarningKind.CLEARANCE:
        body = next(b for b in clearance.bodies if b.body == margin.other and b.arc_length == margin.arc_length)
        point, other = body.point_on_cable, body.point_on_body
        pressed = sum(float(part.presses(margin.other).sum()) for part in parts)
        if pressed > 0.0 and margin.value > -DEEPEST_REST:
            severity = Severity.WARN
            where = f"{margin.other!r} {_at(margin.arc_length, shape.length)}"
            text = f"rests on {where}, with {pressed:.2g} N in all. Lift it off, if it is not to touch."
        else:
            text = _clearance(margin, severity, scene, shape.length, clearance)
    elif margin.kind is WarningKind.QUASISTATIC:
        point = other = shape.positions[-1 if margin.arc_length > 0.0 else 0]
        text = _moving(margin, period)
    else:
        point = other = shape.positions[round(margin.arc_length / shape.length * (shape.points - 1))]
        text = _words(margin, shape.length)
    if 0.0 < margin.time_to_limit < math.inf:
        text += f" At this speed the limit is reached in {margin.time_to_limit:.2g} s."
    return CableWarning(
        cable_id=cable_id,
        kind=margin.kind,
        severity=severity,
        text=_told(cable_id, text),
        value=margin.value,
        limit=margin.limit,
        margin=margin.used,
        arc_length=margin.arc_length,
        point_on_cable=point,
        point_on_other=other,
        other=margin.other,
        time_to_limit=margin.time_to_limit,
    )


def _clearance(margin: Margin, severity: Severity, scene: Scene, length: float, clearance: Clearance) -> str:
    """The cable, or the tube that holds it, is too near to another body."""
    where = f"{margin.other!r} {_at(margin.arc_length, length)}"
    if clearance.confidence > 0.0:
        tube = "the tube that holds" if clearance.holds else "a tube that may be too narrow to hold"
        where += f", by {tube} the cable with {100.0 * clearance.confidence:g} %"
    if margin.value < 0.0:
        return f"overlaps {where} by {metres(-margin.value)}. Move the cable off it."
    if severity is Severity.ERROR:
        bound = f"error below {metres(scene.error_distance)}"
    else:
        bound = f"warning below {metres(margin.limit)}"
    return f"{metres(margin.value)} from {where} ({bound}). Keep away from it."


def _moving(margin: Margin, period: float) -> str:
    """The cable may not be taken for one at rest."""
    side = "end" if margin.arc_length > 0.0 else "start"
    swings = f" It swings with a period of about {period:.2g} s." if period < math.inf else ""
    return (
        f"moves too fast to be taken for at rest: its inertia loads it with {100.0 * margin.value:.2g} % of its weight "
        f"or has done so a moment ago, most at the {side} grip; {100.0 * margin.limit:.2g} % is allowed, and the shape "
        f"leaves it out.{swings} Write motion='dynamic', accelerate less, or keep further away."
    )


def _words(margin: Margin, length: float) -> str:
    """A load, the stretch or the stability."""
    value, limit = margin.value, margin.limit
    if margin.kind is WarningKind.OVERSTRETCHED:
        return f"the grips are {metres(value)} apart, and at most {metres(limit)} is allowed. Bring them closer."
    where = f"{_at(margin.arc_length, length)}, "
    if margin.kind is WarningKind.TENSION:
        return f"{where}tension {value:.3g} N of at most {limit:.3g} N. Bring the grips closer."
    if margin.kind is WarningKind.BEND_RADIUS:
        remedy = "Move the grips apart or turn them along the cable."
        return f"{where}bend radius {metres(value)} of at least {metres(limit)}. {remedy}"
    if margin.kind is WarningKind.TWIST_RATE:
        return f"{where}twist rate {value:.3g} rad/m of at most {limit:.3g} rad/m. Turn the end grip back."
    if margin.kind is WarningKind.CONTACT_FORCE:
        return (
            f"is pressed on {margin.other!r}, most {where}with {value:.3g} N of at most {limit:.3g} N. "
            "Lift the cable, or let it be pressed harder."
        )
    if margin.kind is WarningKind.CAUGHT:
        return (
            f"is caught on {margin.other!r}, most {where}and drawn taut there: it is held with {value:.3g} N, and "
            f"at ease with {limit:.3g} N at most. Go back, or lift it off."
        )
    if margin.kind is WarningKind.STRESS:
        stress = f"stress {value * 1e-6:.3g} MPa of at most {limit * 1e-6:.3g} MPa"
        return f"{where}{stress}, safety factor {limit / value:.3g}. Unload the cable there."
    return (
        f"{where}the cable is about to snap to another shape (stability {value:.3g}, 0 where it snaps). "
        "Move the grips back."
    )


def _told(cable_id: str, text: str) -> str:
    """What is the matter with which cable; a segment of a harness begins where it begins, held by a grip or not."""
    return f"{cable_id}: {text.replace(_FROM, 'from its start') if '/' in cable_id else text}"


def _at(arc_length: float, length: float) -> str:
    """Where along the cable or its tails."""
    if arc_length < 0.0:
        return f"on the tail, {-arc_length:.3f} m before the start grip"
    if arc_length > length:
        return f"on the tail, {arc_length - length:.3f} m beyond the end grip"
    return f"at {arc_length:.3f} m {_FROM}"


def metres(value: float) -> str:
    """In millimetres below a metre."""
    return f"{value * 1e3:.1f} mm" if abs(value) < 1.0 else f"{value:.3f} m"
