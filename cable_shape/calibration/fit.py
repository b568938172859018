"""A cable's stiffness and what else is asked for from how it was seen to hang: :func:`calibrate`."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import reduce
from typing import Any, overload

import numpy as np
from numpy.typing import ArrayLike

from cable_shape import checks
from cable_shape.cable.cable import Cable
from cable_shape.cable.harness import Harness
from cable_shape.calibration.cables_fit import calibrate_cables
from cable_shape.calibration.cables_forward import CablesForward, forward_of
from cable_shape.calibration.cables_result import CablesCalibration
from cable_shape.calibration.fitted import fitted_in_two, told_of_fit
from cable_shape.calibration.harness_fit import calibrate_harness
from cable_shape.calibration.harness_observation import HarnessObservation
from cable_shape.calibration.harness_result import HarnessCalibration
from cable_shape.calibration.motion_fit import calibrate_motion
from cable_shape.calibration.observation import Observation
from cable_shape.calibration.parameters import ROWS, Parameters
from cable_shape.calibration.progress import Progress
from cable_shape.calibration.result import Calibration, grips_of
from cable_shape.calibration.supports import Task, chosen, joined, priors_of
from cable_shape.errors import ArgumentError
from cable_shape.pose import Grip
from cable_shape.scene.scene import Clip, Scene
from cable_shape.solve.cables import FREE_ROTATIONS
from cable_shape.solve.problem import GRAVITY
from cable_shape.solve.quasistatic import inertia_of


@overload
def calibrate(
    observations: Iterable[Observation],
    cable: Cable,
    fit: str | Sequence[str] = ...,
    *,
    priors: Mapping[str, float] | None = ...,
    supports: int | str = ...,
    optional: str | Sequence[str] = ...,
    motion: bool = ...,
    gravity: ArrayLike = ...,
    scene: Scene | None = ...,
    proceed: Callable[[int, float], bool] | None = ...,
    progress: bool = ...,
) -> Calibration: ...
@overload
def calibrate(
    observations: Iterable[HarnessObservation] | Harness,
    cable: Harness | Iterable[HarnessObservation],
    fit: str | Sequence[str] = ...,
    *,
    priors: Mapping[str, float] | None = ...,
    gravity: ArrayLike = ...,
    proceed: Callable[[int, float], bool] | None = ...,
    progress: bool = ...,
) -> HarnessCalibration: ...
@overload
def calibrate(
    observations: Iterable[Mapping[str, Observation]],
    cable: Mapping[str, Cable],
    fit: str | Sequence[str] = ...,
    *,
    priors: Mapping[str, float] | None = ...,
    supports: int = ...,
    gravity: ArrayLike = ...,
    scene: Scene | None = ...,
    clips: Mapping[str, Sequence[Clip]] | None = ...,
    proceed: Callable[[int, float], bool] | None = ...,
    progress: bool = ...,
) -> CablesCalibration: ...
def calibrate(
    observations: Any,
    cable: Any,
    fit: str | Sequence[str] = ("bending_stiffness",),
    *,
    priors: Mapping[str, float] | None = None,
    supports: int | str = ROWS,
    optional: str | Sequence[str] = (),
    motion: bool = False,
    gravity: ArrayLike = GRAVITY,
    scene: Scene | None = None,
    clips: Mapping[str, Sequence[Clip]] | None = None,
    proceed: Callable[[int, float], bool] | None = None,
    progress: bool = True,
) -> Calibration | HarnessCalibration | CablesCalibration:
    """The cable whose predicted shapes come nearest to the observed points, and how well it is known.

    Each observation is predicted by the Cosserat rod. Stray points are weighted down (see
    :mod:`cable_shape.calibration.robust`). Only the ratio of stiffness to weight shapes a cable between grips:
    `cable.linear_density` is taken for granted. Where observations come in twelve groups or more, and two for each
    number, the errors are judged by how much these disagree, so that what the model leaves out is in the error bars;
    with fewer, by the scatter of single points and how much more groups disagree than these. The misses
    told are those of shapes predicted from nothing with the numbers found.

    Parameters
    ----------
    observations : iterable of Observation
    cable : Cable or Harness
        Where the fit begins, and all that is not fitted. With a harness, before its observations or after them, this is
        :func:`cable_shape.calibration.harness_fit.calibrate_harness`; with a mapping of name to Cable, and a mapping
        of name to Observation for each look, :func:`cable_shape.calibration.cables_fit.calibrate_cables`.
    fit : sequence of str
        "bending_stiffness" (its two values keep their ratio; GJ follows unless fitted), "bending_stiffness_along" (on
        pieces of one length, a smooth change of its logarithm), "twisting_stiffness", "axial_stiffness",
        "retardation_time", "drag" (of cables seen with their velocities), "length", "rest_curvature" (constant, about
        d1 and d2), "rest_curvature_along" (of hat functions of arc length, a smooth change of what the cable has),
        "start_offset", "end_offset" (of the cable in the grip's cable frame), "start_tilt", "end_tilt" (about d1 and d2
        there), "start_pitch", "end_pitch" (about d1 alone), "roll" (of the end's), "start_roll".
    priors : mapping, optional
        Standard deviation about where the fit begins, by name and in the unit of what is fitted; of what is fitted by
        its logarithm as a fraction of it; of "rest_curvature_along" and "bending_stiffness_along" that of its change
        over the whole length, 3 / length and 0.5 by default.
    supports : int or "auto"
        Hat functions of "rest_curvature_along", and pieces of "bending_stiffness_along", 3 to 33. "auto": the number
        with which groups of observations that are left out are predicted best.
    optional : sequence of str
        What is fitted, too, where groups of observations that are left out are then predicted better by 1 %.
    motion : bool
        The observations are looks at a cable that swings, with times, each recording a group: from its first two looks
        on it is run through in steps of time (:class:`cable_shape.Motion`), and all later points count. Of one cable.
    gravity : (3,) array_like
        [m/s^2], world.
    scene : Scene, optional
        Its clips held the cable, its masses loaded it, and with ``contact="solve"`` it lay on its obstacles, and on
        itself: then the points tell how it is wound.
    clips : mapping, optional
        Of several cables only.
    proceed : callable, optional
        Is asked before each iteration, with its number and the scale of the misses [m], whether to go on. If not, the
        result is where the fit is then, not converged.
    progress : bool
        A bar on a terminal where it takes more than a second.

    Raises
    ------
    ArgumentError
        For wrong arguments, or if no observation has a usable shape with the cable given.
    """
    checks.instance("motion", motion, (bool,), "Write True or False.")
    if motion and (isinstance(observations, Harness) or not isinstance(cable, Cable)):
        raise ArgumentError.of("motion", motion, "only one cable is fitted as it swings", "Leave it out.")
    if isinstance(cable, Mapping):
        if optional:
            raise ArgumentError.of("optional", optional, "several cables have none", "Name them in fit.")
        return calibrate_cables(
            observations, cable, fit, priors=priors, supports=supports, gravity=gravity, scene=scene, clips=clips,  # type: ignore[arg-type]
            proceed=proceed, progress=progress,
        )  # fmt: skip
    if clips is not None:
        raise ArgumentError.of("clips", clips, "it is of several cables", "Write scene=Scene(clips=[...]).")
    if isinstance(observations, Harness) or isinstance(cable, Harness):
        harness, looks = (observations, cable) if isinstance(observations, Harness) else (cable, observations)
        _refuse_of_cables(supports, optional, scene)
        return calibrate_harness(
            looks, harness, fit, priors=priors, gravity=gravity, proceed=proceed, progress=progress,
        )  # fmt: skip
    seen = checks.entries("observations", observations, Observation)
    if not seen:
        raise ArgumentError.of("observations", "0 items", "it must be Observations, one at least", "Give some.")
    checks.instance("cable", cable, (Cable, Harness), "Write Cable(length=..., ...).")
    assert isinstance(cable, Cable)
    if proceed is not None and not callable(proceed):
        raise ArgumentError.of("proceed", proceed, "it must be a function", "Leave it out, or give one.")
    if any(o.group is not None and o.group < 0 for o in seen):
        least = min(o.group for o in seen if o.group is not None)
        raise ArgumentError.of("group", least, "it must be at least 0", "Number the recordings from 0.")
    if motion:
        if isinstance(supports, str) or optional:
            remedy = "Give a whole number of supports, and name all that is fitted in fit."
            raise ArgumentError.of("motion", motion, "nothing is chosen by cross validation with it", remedy)
        return calibrate_motion(
            seen, cable, fit, priors=priors, supports=supports, proceed=proceed, progress=progress, gravity=gravity,
            scene=scene,
        )  # fmt: skip
    names, loads = Parameters(cable, fit).names, {"gravity": gravity, "scene": scene}
    more = (optional,) if isinstance(optional, str) else checks.entries("optional", optional, str)
    known = checks.mapping("priors", priors, (*names, *more), "Write {name: standard deviation}.")
    rows = ROWS if isinstance(supports, str) else supports
    Parameters(cable, reduce(joined, more, names), priors_of(known, more), rows)  # refuses what none of them may be
    with Progress(progress, proceed) as told:
        choice = chosen(supports, more, Task(seen, cable, names, known, loads), told.step)
        parameters = Parameters(cable, choice.names, priors_of(known, choice.names), choice.supports)
        forward = forward_of(parameters, seen, **loads)
        if np.isnan(forward.misses(parameters.start)[:, 0]).all():
            raise ArgumentError.of(
                "observations", f"{len(seen)} items", "none has a usable shape with the cable given",
                "Is its length in metres, and at least the distance of the grips?",
            )  # fmt: skip
        found = fitted_in_two(
            lambda some: forward if len(some) == len(seen) else forward_of(parameters, some, **loads), seen, told.step
        )
        wound: tuple[str, ...] = ()
        if isinstance(forward, CablesForward):
            forward.refuse_untold(found.values)
            wound = forward.remarks(found.values)
    return Calibration(
        cable=parameters.make_cable(found.values),
        **told_of_fit(
            found,
            parameters,
            seen,
            choice.remarks,
            (*parameters.by_prior(found.covariance), *_direction(names, seen), *wound),
        ),
        points=tuple(o.points for o in seen),
        centrelines=tuple(forward.centrelines(found.values)),
        inertia=math.sqrt(sum(inertia_of(o.acceleration, gravity) ** 2 for o in seen) / len(seen)),
        grips=grips_of(seen, parameters, found.values),
    )


def _refuse_of_cables(supports: int | str, optional: str | Sequence[str], scene: Scene | None) -> None:
    """Refuses what is not for a harness."""
    if supports != ROWS:
        bound = "a harness has no rest curvature along its segments to fit"
        raise ArgumentError.of("supports", supports, bound, "Fit 'rest_curvature:each', or split the segments.")
    if optional:
        raise ArgumentError.of("optional", optional, "a harness has none", "Name them in fit, or leave them out.")
    if scene is not None:
        bound = "clips of a harness belong to its observations"
        raise ArgumentError.of("scene", scene, bound, "Write HarnessObservation(..., scene=Scene(clips=[...])).")


def _direction(names: Sequence[str], seen: Sequence[Observation]) -> Iterator[str]:
    """What a rest curvature means where no grip holds the roll of the cable."""
    if not any(name.startswith("rest_curvature") for name in names):
        return
    if any(not FREE_ROTATIONS[end.kind][2] for o in seen for end in (o.start, o.end) if isinstance(end, Grip)):
        return
    yield (
        "no grip holds the cable's roll: of its rest curvature the size is known, and how it turns along the cable, "
        "but not its direction in the grips."
    )
