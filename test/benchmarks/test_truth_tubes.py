"""Tubes of real cables that move, where their recordings are on this machine."""

import math

import numpy as np
import pytest
from truth_data import DATA, load
from truth_tubes import Tubes, as_fitted, fitted, inside, largest, put

import cable_shape as cs
from cable_shape.calibration.parameters import held
from cable_shape.replay.observations import from_bag
from cable_shape.uncertainty.tube_watch import left_out

recorded = pytest.mark.skipif(
    not DATA.is_dir(), reason=f"no recordings of real cables at {DATA.parent.name}/{DATA.name}"
)


def share(tubes: list[cs.Tube | None], seen: list[cs.Observation]) -> float:
    """Of the points in tubes that hold."""
    pairs = [(tube, one) for tube, one in zip(tubes, seen, strict=True) if tube is not None and tube.holds]
    assert len(pairs) > 0.5 * len(seen)
    return float(np.concatenate([inside(tube, one.points) for tube, one in pairs]).mean())


@recorded
def test_moving_cables_that_were_not_fitted_are_in_their_tubes() -> None:
    frames = load(4, 3)
    found = fitted([frames.moving[i] for i in frames.where(("quasi",), 0, False)[::2]], frames.cable)
    for kind in ("quasi", "moderate"):
        which = frames.where((kind,), 0, True)[::2]
        static, moving = [frames.static[i] for i in which], [frames.moving[i] for i in which]
        tubes = Tubes(found)
        assert share([tubes.tube(one, 0.0) for one in static], static) < 0.5, "one at rest would not be there"
        told = [tubes.tube(one, largest(moved)) for one, moved in zip(static, moving, strict=True)]
        assert share(told, static) > 0.9
        tubes = Tubes(found)
        given = [tubes.tube(one, left_out(found, one.acceleration)) for one in moving]  # type: ignore[arg-type]
        assert share(given, moving) > 0.9


@recorded
def test_a_recording_that_was_not_fitted_is_in_the_tubes_of_a_cell() -> None:
    frames = load(5, 3)
    learn = np.flatnonzero((frames.kind == "quasi") & (frames.traj != frames.recorded[1]))[::2]
    found = fitted([frames.moving[i] for i in learn], frames.cable)
    assert found.parameters is not None
    assert found.values is not None
    near, far = (found.parameters.offset(found.values, side) for side in ("start", "end"))
    cycle = cs.Cycle(found.cable, model="cosserat", points=101, uncertainty=cs.Uncertainty.of(found))
    rows: dict[str, list[np.ndarray]] = {}
    widest, ratios = [], []
    for k, one in enumerate(as_fitted(5, from_bag(DATA / "cable5_recording1", frames=500))[:250]):
        report = cycle.step({"cable": (held(one.start, near), held(one.end, far))}, 10_000_000 * k)
        tube = report.tubes["cable"]
        put(rows, "cell", tube, one.points)
        widest.append(tube.radius.max())
        ratios.append(tube.inertia)
    held_in = np.concatenate(rows["cell"])
    assert np.nanmean(held_in) > 0.9
    assert np.isnan(held_in).mean() < 0.5
    assert math.isnan(ratios[0])
    assert np.corrcoef(widest[20:], ratios[20:])[0, 1] > 0.8
