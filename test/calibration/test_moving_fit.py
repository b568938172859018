"""What slows a moving cable, found again from how it was seen to move."""

import math

import numpy as np
import pytest
from test_calibration import grips

import cable_shape as cs
from cable_shape.calibration.forward import Forward
from cable_shape.calibration.parameters import Parameters
from cable_shape.errors import ArgumentError
from cable_shape.replay.observations import from_arrays

TRUE = cs.Cable(length=1.0, linear_density=0.06, bending_stiffness=0.004, retardation_time=0.08, drag=0.03)
SLOWED = ("retardation_time", "drag")
SHARES = np.linspace(0.0, 1.0, 25)[:, None]


def moving(rng: np.random.Generator) -> np.ndarray:
    """(25, 6): accelerations and velocities of two waves."""
    waves = np.sin(math.pi * SHARES) ** 2, np.sin(2.0 * math.pi * SHARES) * np.sin(math.pi * SHARES)
    fast = sum(wave * rng.normal(size=3) for wave in waves)
    return np.concatenate((sum(3.0 * wave * rng.normal(size=3) for wave in waves), fast), axis=1)


def seen_of(cable: cs.Cable, count: int, noise: float) -> list[cs.Observation]:
    rng, out = np.random.default_rng(5), []
    while len(out) < count:
        start, end = grips(rng, cable.length)
        load, far = moving(rng), cs.Grip(end, "swivel")
        shape = cs.predict(cable, start, far, model="cosserat", points=101, acceleration=load)
        if shape.status is cs.Status.OK:
            points = shape.positions[8:-8:12]
            out.append(cs.Observation(start, far, points + noise * rng.normal(size=points.shape), acceleration=load))
    return out


def test_retardation_time_and_drag_come_back() -> None:
    begin = TRUE.replace(bending_stiffness=0.006, twisting_stiffness=None, retardation_time=0.05, drag=0.01)
    found = cs.calibrate(seen_of(TRUE, 8, 5e-4), begin, ("bending_stiffness", *SLOWED))
    assert found.converged
    for name, true in (("bending_stiffness", 0.004), ("retardation_time", 0.08), ("drag", 0.03)):
        assert abs(math.log(found[name].value / true)) < 3.0 * found[name].relative
        assert found[name].relative < 0.15
    assert 1e3 * np.nanmean(found.distances) < 1.0
    assert "retardation_time" in found.yaml()
    np.testing.assert_allclose(cs.CableFile.from_mapping(found.file.as_dict()).cable.drag, found.cable.drag)


def test_derivatives_are_those_of_differences() -> None:
    """Loads of damping stay as they are, as they do between the fresh predictions of a fit."""
    cable = TRUE.replace(sections=[cs.Section(0.4, 0.5, bending_stiffness=0.006, retardation_time=0.1, drag=0.05)])
    for one in (TRUE, cable):
        parameters = Parameters(one, ("bending_stiffness", "length", *SLOWED))
        forward = Forward(parameters, seen_of(one, 2, 2e-3))
        at = parameters.start
        now = forward.afresh(at)
        told = forward.jacobian(at, now)
        for j, step in enumerate((1e-3, 1e-5, 1e-3, 1e-3)):
            move = step * np.eye(len(at))[j]
            differences = (forward.misses(at + move) - forward.misses(at - move)) / (2.0 * step)
            np.testing.assert_allclose(told[:, :, j], differences, atol=0.02 * np.abs(differences).max())


def test_a_cable_that_does_not_say_what_slows_it_is_no_hindrance() -> None:
    one = TRUE.replace(drag=0.0)  # shapes and damping are found together to 1e-5 of the length
    assert cs.calibrate(seen_of(TRUE, 2, 0.0), one, "drag").cable.drag == pytest.approx(0.03, rel=5e-3)
    piece = cs.Section(0.4, 0.5, bending_stiffness=0.006)
    with pytest.raises(ArgumentError, match=r"drag.*above 0.*rough value"):
        cs.calibrate(seen_of(TRUE, 1, 0.0), one.replace(sections=[piece]), "drag")


def test_arrays_hold_velocities_beside_accelerations() -> None:
    seen = seen_of(TRUE, 2, 0.0)
    arrays = {
        "start": np.array([o.start.pose.array for o in seen]),
        "end": np.array([o.end.pose.array for o in seen]),  # type: ignore[union-attr]
        "points": np.array([o.points for o in seen]),
        "acceleration": np.array([o.acceleration[:, :3] for o in seen]),  # type: ignore[index]
        "velocity": np.array([o.acceleration[:, 3:] for o in seen]),  # type: ignore[index]
    }
    read = from_arrays(arrays, ("clamped", "swivel"))
    np.testing.assert_array_equal(read[1].acceleration, seen[1].acceleration)
    with pytest.raises(ArgumentError, match="velocity"):
        from_arrays({key: arrays[key] for key in arrays if key != "acceleration"}, ("clamped", "swivel"))
