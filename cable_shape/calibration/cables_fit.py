"""What several cables that touch each other are made of, from how they were seen to hang: :func:`calibrate_cables`."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cable_shape import checks
from cable_shape.cable.cable import Cable
from cable_shape.cable.cable_file import AS_GIVEN, Held
from cable_shape.calibration.cables_forward import CablesForward, Look, flat
from cable_shape.calibration.cables_parameters import CablesParameters
from cable_shape.calibration.cables_result import CablesCalibration
from cable_shape.calibration.fitted import fitted_in_two, told_of_fit
from cable_shape.calibration.observation import Observation
from cable_shape.calibration.parameters import ROWS
from cable_shape.calibration.progress import Progress
from cable_shape.calibration.result import grips_of
from cable_shape.errors import ArgumentError
from cable_shape.prediction.cables_predictor import CablesPredictor, named_cables, of_all
from cable_shape.scene.scene import Clip, Scene
from cable_shape.solve.problem import GRAVITY
from cable_shape.solve.quasistatic import inertia_of

_WRITE = "Write [{'a': Observation(...), 'b': Observation(...)}, ...], each with every cable."


def calibrate_cables(
    observations: Iterable[Mapping[str, Observation]],
    cables: Mapping[str, Cable],
    fit: str | Sequence[str] = ("bending_stiffness",),
    *,
    priors: Mapping[str, float] | None = None,
    supports: int = ROWS,
    gravity: ArrayLike = GRAVITY,
    scene: Scene | None = None,
    clips: Mapping[str, Sequence[Clip]] | None = None,
    proceed: Callable[[int, float], bool] | None = None,
    progress: bool = True,
) -> CablesCalibration:
    """The cables whose predicted shapes come nearest to the observed points: what `calibrate` does for several.

    With ``contact="solve"`` in the scene they rest on each other, on themselves and on its bodies. Which way they lie
    over each other the points tell, if the arc lengths of eight of them on every cable, all along it, are known.

    Parameters
    ----------
    observations : iterable of mapping of cable name to Observation
        One look at all of the cables at once each; `group` and `planar` are the same of all of them in a look.
    cables : mapping of name to Cable
        Where the fit begins, and all that is not fitted.
    fit : sequence of str
        The names that a fit of one cable takes: alone of all cables together, as "bending_stiffness:a" of one, as
        "bending_stiffness:a+b" of several that are alike, as "bending_stiffness:each" of every cable by itself. What
        they share changes by the same factor, offsets, angles and curvatures by as much.
    priors : mapping, optional
        Standard deviation about where the fit begins, by name ("length:a") or kind ("length").
    supports : int
        As of one cable.
    gravity, scene, proceed, progress
        As of one cable.
    clips : mapping of cable name to sequence of Clip, optional
        What held that cable, in place of the scene's `clips`, which hold every cable.

    Raises
    ------
    ArgumentError
        For wrong arguments, if no look has usable shapes with the cables given, and where cables touch but no points
        tell how they lie.
    """
    named = named_cables(cables)
    looks = _looks(observations, named)
    if proceed is not None and not callable(proceed):
        raise ArgumentError.of("proceed", proceed, "it must be a function", "Leave it out, or give one.")
    if not isinstance(supports, int):
        raise ArgumentError.of("supports", supports, "of several cables it is a whole number", f"Write {ROWS}.")
    parameters = CablesParameters(named, fit, priors, supports)
    loads: dict[str, Any] = {"gravity": gravity, "scene": scene, "clips": clips}
    CablesPredictor(named, model="cosserat", **loads)  # refuses what cannot be solved for
    forward = CablesForward(parameters, looks, **loads)
    with Progress(progress, proceed) as told:
        if np.isnan(forward.misses(parameters.start)[:, 0]).all():
            raise ArgumentError.of(
                "observations", f"{len(looks)} items", "none has usable shapes with the cables given",
                "Are their lengths in metres, and at least the distances of the grips?",
            )  # fmt: skip
        found = fitted_in_two(
            lambda some: forward if len(some) == len(looks) else CablesForward(parameters, some, **loads),
            looks,
            told.step,
        )
        forward.refuse_untold(found.values)
    seen = [one for look in looks for one in look.values()]
    return CablesCalibration(
        cables=parameters.make(found.values),
        grips={name: _grips(name, looks, parameters, found.values) for name in named},
        **told_of_fit(found, parameters, [flat(look) for look in looks], more=forward.remarks(found.values)),
        inertia=math.sqrt(sum(inertia_of(o.acceleration, gravity) ** 2 for o in seen) / len(seen)),
    )


def _looks(observations: Iterable[Mapping[str, Observation]], cables: Mapping[str, Cable]) -> list[Look]:
    """The looks, every cable in each, in the order of the cables."""
    if isinstance(observations, (str, Mapping)):
        raise ArgumentError.of("observations", type(observations).__name__, "it must be a list of mappings", _WRITE)
    given = list(observations)
    if not given:
        raise ArgumentError.of("observations", "0 items", "it must be looks at the cables, one at least", _WRITE)
    looks: list[Look] = []
    for i, one in enumerate(given):
        look = of_all(f"observations[{i}]", one, cables, _WRITE)
        for name, seen in look.items():
            checks.instance(f"observations[{i}][{name!r}]", seen, (Observation,), "Write Observation(start, end, ..).")
            if seen.group is not None and seen.group < 0:
                where = f"observations[{i}][{name!r}].group"
                raise ArgumentError.of(where, seen.group, "it must be at least 0", "Number the recordings from 0.")
        try:
            flat(look)
        except ArgumentError as error:
            raise type(error)(f"observations[{i}]: {error}") from None
        looks.append(look)
    return looks


def _grips(
    name: str, looks: Sequence[Look], parameters: CablesParameters, values: np.ndarray
) -> tuple[Held, Held]:  # fmt: skip
    """How a cable was held in all the looks, and what the numbers put beside that."""
    if name not in parameters.parts:
        return AS_GIVEN, AS_GIVEN
    return grips_of([look[name] for look in looks], parameters.parts[name], parameters.own(name, values))
