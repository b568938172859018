"""What to warn about: :func:`warnings_of`, from a shape and its clearance to words with a remedy."""

from __future__ import annotations

import math

from cable_shape.cable import Cable
from cable_shape.clearance import NOT_JUDGED
from cable_shape.kernels.loads import most_loaded
from cable_shape.problem import AUTO_TOLERANCE
from cable_shape.report import BodyDistance, CableWarning, Clearance, Severity, WarningKind
from cable_shape.scene import Scene
from cable_shape.shape import CableShape, Status

#: A load is warned of from this fraction of its limit, and is an error at the limit.
WARN_FRACTION = 0.9


def warnings_of(
    cable_id: str,
    cable: Cable,
    scene: Scene,
    shape: CableShape,
    clearance: Clearance,
    tolerance: float | None = None,
) -> tuple[CableWarning, ...]:
    """All warnings that hold for one cable, errors first, then by falling margin.

    `margin` says how much of a limit is used up, 1 at the limit: value / limit for tension, twist rate, span and error
    estimate; limit / radius for the bend radius, which is infinite for a straight cable; 2 - distance / limit for
    clearance, so that 2 is contact.

    Of a shape that did not converge only that is told, and that clearance and loads were not judged. On the straight
    line of an overstretched cable clearance is judged, loads are not.

    Parameters
    ----------
    cable_id : str
        Name of the cable.
    scene : Scene
        Its warning distances.
    tolerance : float, optional
        [m], that the shape was asked for; the limit of STATUS warnings. Default: 1e-3 of the length.
    """
    found: list[CableWarning] = []
    if shape.status is Status.OVERSTRETCHED:
        found.append(_overstretched(cable_id, shape))
    elif shape.status is not Status.OK:
        found.append(_status(cable_id, shape, AUTO_TOLERANCE * shape.length if tolerance is None else tolerance))
    if shape.status not in NOT_JUDGED:
        limit = max(scene.warn_distance, scene.error_distance)
        found.extend(
            _clearance(cable_id, body, limit, scene.error_distance)
            for body in clearance.bodies
            if body.distance < limit
        )
        if shape.status is not Status.OVERSTRETCHED:
            found.extend(_loads(cable_id, cable, shape))
    return tuple(sorted(found, key=lambda w: (-w.severity.value, -w.margin)))


def _status(cable_id: str, shape: CableShape, tolerance: float) -> CableWarning:
    """The predictor's own doubts."""
    text = f"{cable_id}: {shape.status.name}. {shape.detail or shape.status.remedy}"
    if shape.status in NOT_JUDGED:
        text += " Clearance and loads were not judged."
    point = shape.positions[0]
    return CableWarning(
        cable_id=cable_id,
        kind=WarningKind.STATUS,
        severity=Severity.WARN if shape.status else Severity.ERROR,
        text=text,
        value=shape.error_estimate,
        limit=tolerance,
        margin=shape.error_estimate / tolerance,
        arc_length=0.0,
        point_on_cable=point,
        point_on_other=point,
    )


def _overstretched(cable_id: str, shape: CableShape) -> CableWarning:
    """The ends are further apart than the cable is long."""
    first, last = shape.positions[0], shape.positions[-1]
    span = math.dist(first, last)
    return CableWarning(
        cable_id=cable_id,
        kind=WarningKind.OVERSTRETCHED,
        severity=Severity.ERROR,
        text=(
            f"{cable_id}: the grips are {_metres(span)} apart, {_metres(span - shape.length)} more than the cable is "
            f"long. Bring them closer."
        ),
        value=span,
        limit=shape.length,
        margin=span / shape.length,
        arc_length=shape.length,
        point_on_cable=last,
        point_on_other=last,
    )


def _clearance(cable_id: str, body: BodyDistance, limit: float, error_distance: float) -> CableWarning:
    """The cable is too near to another body."""
    severe = body.distance < error_distance
    where = f"{body.body!r} at {body.arc_length:.3f} m from the start grip"
    if body.distance < 0.0:
        text = f"{cable_id}: overlaps {where} by {_metres(-body.distance)}. Move the cable off it."
    else:
        bound = f"error below {_metres(error_distance)}" if severe else f"warning below {_metres(limit)}"
        text = f"{cable_id}: {_metres(body.distance)} from {where} ({bound}). Keep away from it."
    return CableWarning(
        cable_id=cable_id,
        kind=WarningKind.CLEARANCE,
        severity=Severity.ERROR if severe else Severity.WARN,
        text=text,
        value=body.distance,
        limit=limit,
        margin=2.0 - body.distance / limit if limit > 0.0 else math.inf,
        arc_length=body.arc_length,
        point_on_cable=body.point_on_cable,
        point_on_other=body.point_on_body,
        other=body.body,
    )


def _loads(cable_id: str, cable: Cable, shape: CableShape) -> list[CableWarning]:
    """Tension, bend radius and twist rate against the limits that the cable has."""
    if cable.max_tension is None and cable.min_bend_radius is None and cable.max_twist_rate is None:
        return []
    i, tension, j, bending, k, twist = most_loaded(shape.quaternions, shape.curvature, shape.force)
    found: list[tuple[WarningKind, int, float, float, float, str]] = []
    if cable.max_tension is not None:
        text = f"tension {tension:.3g} N of at most {cable.max_tension:.3g} N. Bring the grips closer."
        found.append((WarningKind.TENSION, i, tension, cable.max_tension, tension / cable.max_tension, text))
    if cable.min_bend_radius is not None:
        radius = 1.0 / bending if bending > 0.0 else math.inf
        text = (
            f"bend radius {_metres(radius)} of at least {_metres(cable.min_bend_radius)}. Move the grips apart or turn "
            f"them along the cable."
        )
        found.append((WarningKind.BEND_RADIUS, j, radius, cable.min_bend_radius, bending * cable.min_bend_radius, text))
    if cable.max_twist_rate is not None:
        text = f"twist rate {twist:.3g} rad/m of at most {cable.max_twist_rate:.3g} rad/m. Turn the end grip back."
        found.append((WarningKind.TWIST_RATE, k, twist, cable.max_twist_rate, twist / cable.max_twist_rate, text))
    return [
        CableWarning(
            cable_id=cable_id,
            kind=kind,
            severity=Severity.ERROR if margin >= 1.0 else Severity.WARN,
            text=f"{cable_id}: at {float(shape.arc_length[at]):.3f} m from the start grip, {text}",
            value=value,
            limit=limit,
            margin=margin,
            arc_length=float(shape.arc_length[at]),
            point_on_cable=shape.positions[at],
            point_on_other=shape.positions[at],
        )
        for kind, at, value, limit, margin, text in found
        if margin >= WARN_FRACTION
    ]


def _metres(value: float) -> str:
    """In millimetres below a metre."""
    return f"{value * 1e3:.1f} mm" if abs(value) < 1.0 else f"{value:.3f} m"
