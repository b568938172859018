"""A cable's stiffness and what else is asked for from how it was seen to hang: :func:`calibrate`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from cable_shape import checks
from cable_shape.cable import Cable
from cable_shape.calibration.forward import Forward
from cable_shape.calibration.observation import Observation
from cable_shape.calibration.parameters import Parameters
from cable_shape.calibration.result import Calibration, correlation_of, estimates_of, grips_of, remarks_of
from cable_shape.calibration.robust import Robust
from cable_shape.errors import ArgumentError
from cable_shape.problem import GRAVITY
from cable_shape.scene import Scene


def calibrate(
    observations: Iterable[Observation],
    cable: Cable,
    fit: str | Sequence[str] = ("bending_stiffness",),
    *,
    priors: Mapping[str, float] | None = None,
    gravity: ArrayLike = GRAVITY,
    scene: Scene | None = None,
    proceed: Callable[[int, float], bool] | None = None,
) -> Calibration:
    """The cable whose predicted shapes come nearest to the observed points, and how well it is known.

    Each observation is predicted by the Cosserat rod. Stray points are weighted down (see
    :mod:`cable_shape.calibration.robust`). Only the ratio of stiffness to weight shapes a cable between grips:
    `cable.linear_density` is taken for granted. Where observations come in twelve groups or more, the errors are judged
    by how much these disagree, so that what the model leaves out is in the error bars; with fewer, by the scatter of
    single points.

    Parameters
    ----------
    observations : iterable of Observation
    cable : Cable
        Where the fit begins, and all that is not fitted.
    fit : sequence of str
        "bending_stiffness" (its two values keep their ratio; GJ follows unless fitted), "twisting_stiffness",
        "axial_stiffness", "length", "rest_curvature" (constant, about d1 and d2), "rest_curvature_along" (of five hat
        functions of arc length, a smooth change of what the cable has), "start_offset", "end_offset" (of the cable in
        the grip's cable frame), "start_tilt", "end_tilt" (about d1 and d2 there), "roll" (of the end's).
    priors : mapping, optional
        Standard deviation about where the fit begins, by name and in the unit of what is fitted; of a stiffness as a
        fraction of it; of "rest_curvature_along" that of its change over the whole length, 3 / length by default.
    gravity : (3,) array_like
        [m/s^2], world.
    scene : Scene, optional
        Its clips held the cable, its masses loaded it; its obstacles did not touch it.
    proceed : callable, optional
        Is asked before each iteration, with its number and the scale of the misses [m], whether to go on. If not, the
        result is where the fit is then, not converged.

    Raises
    ------
    ArgumentError
        For wrong arguments, or if no observation has a usable shape with the cable given.
    """
    seen = checks.entries("observations", observations, Observation)
    if not seen:
        raise ArgumentError.of("observations", "0 items", "it must be Observations, one at least", "Give some.")
    checks.instance("cable", cable, (Cable,), "Write Cable(length=..., ...).")
    if proceed is not None and not callable(proceed):
        raise ArgumentError.of("proceed", proceed, "it must be a function", "Leave it out, or give one.")
    parameters = Parameters(cable, (fit,) if isinstance(fit, str) else fit, priors)
    forward = Forward(parameters, seen, gravity=gravity, scene=scene)
    owners = np.repeat(np.arange(len(seen)), [len(o.points) for o in seen])
    groups = np.array([-1 - i if o.group is None else o.group for i, o in enumerate(seen)])
    if any(o.group is not None and o.group < 0 for o in seen):
        raise ArgumentError.of("group", int(groups.min()), "it must be at least 0", "Number the recordings from 0.")
    arc = np.concatenate([o.arc_length for o in seen])
    if np.isnan(forward.misses(parameters.start)[:, 0]).all():
        raise ArgumentError.of(
            "observations", f"{len(seen)} items", "none has a usable shape with the cable given",
            "Is its length in metres, and at least the distance of the grips?",
        )  # fmt: skip
    each = parameters.each
    steps, before = np.array([p.most for p in each]), parameters.precision
    freedom = 3 - np.isnan(arc) - np.array([o.planar for o in seen])[owners]
    robust = Robust(forward.misses, forward.jacobian, forward.retry, freedom, groups[owners], steps, before)
    found = robust.run(parameters.start, proceed)
    correlation = correlation_of(found.covariance)
    lost = len(np.unique(owners[np.isnan(found.misses[:, 0])]))
    return Calibration(
        cable=parameters.make_cable(found.values),
        estimates=estimates_of(each, found.values, found.covariance, found.freedom),
        correlation=correlation,
        scale=found.scale,
        distances=np.linalg.norm(found.misses, axis=1),
        weights=found.weights,
        iterations=found.iterations,
        converged=found.converged,
        remarks=(
            *remarks_of(each, found.covariance, correlation, found.blind, found.converged, lost),
            *parameters.by_prior(found.covariance),
        ),
        points=tuple(o.points for o in seen),
        centrelines=tuple(forward.centrelines(found.values)),
        parameters=parameters,
        values=found.values,
        covariance=found.covariance,
        freedom=found.freedom,
        grips=grips_of(seen, parameters, found.values),
    )
