"""How shapes of harnesses move with ends, clips, bodies and numbers, by name: against central differences."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
import pytest

import cable_shape as cs

ALONG = (0.0, math.sqrt(0.5), 0.0, math.sqrt(0.5))  # d3 along x
CABLE = cs.Cable(0.6, 0.1, (0.01, 0.012), 0.008, diameter=0.01)
ENDS = {"a.start": cs.Pose((0.0, 0.0, 0.0), ALONG), "b.end": cs.Pose((0.9, 0.1, 0.05), ALONG)}
ASIDE = cs.Pose(quaternion=(0.479426, 0.0, 0.0, 0.877583))
HARNESS = cs.Harness(
    {"a": CABLE, "b": CABLE, "c": CABLE.replace(length=0.3)},
    [cs.Junction("j", ("a.end", "b.start", "c.start"), frames={"c.start": ASIDE})],
)


def scene(around: str, shift: float = 0.0) -> cs.Scene:
    """What is around it, moved up by `shift` [m]."""
    if around == "bodies":
        table = cs.Obstacle("table", cs.HalfSpace(), cs.Pose((0.0, 0.0, -0.25 + shift)))
        return cs.Scene(obstacles=[table], contact="solve")
    kind = "slide" if around == "eyelet" else "fixed"
    return cs.Scene(clips=[cs.Clip(0.3, cs.Pose((0.68, 0.06, -0.07 + shift), ALONG), kind, segment="b", name="hook")])


def shape_of(
    near: cs.HarnessShape, harness: cs.Harness, around: str, shift: float = 0.0, **ends: cs.Pose
) -> cs.HarnessShape:
    """Gone on to from a shape: on a table there is another one that lies on its other side."""
    predictor = cs.Predictor(harness, scene=scene(around, shift), tolerance=1e-8)
    predictor.begin(near, {**ENDS, **ends}, None)
    return predictor.predict({**ENDS, **ends})


def difference(above: cs.HarnessShape, below: cs.HarnessShape, step: float) -> Mapping[str, np.ndarray]:
    """Of the centrelines, for each unit."""
    assert above.status is below.status is cs.Status.OK
    return {n: (one.positions - below.segments[n].positions) / (2.0 * step) for n, one in above.segments.items()}


@pytest.mark.parametrize("around", ["clip", "eyelet", "bodies"])
def test_columns_are_differences(around: str) -> None:
    numbers = [f"{kind}:b" for kind in ("length", "linear_density", "bending_stiffness", "twisting_stiffness")]
    thing = "body:table" if around == "bodies" else "clip:hook"
    by = ("b.end", *numbers, thing, "c.end")
    predictor = cs.Predictor(HARNESS, scene=scene(around), tolerance=1e-8)
    shape = predictor.predict(ENDS)
    assert shape.status is cs.Status.OK
    assert predictor.touching is (around == "bodies")
    columns = predictor.sensitivity(by)
    assert columns["a"].shape == (150, 3, 6 + 4 + 6 + 6)
    step, end = 1e-4, ENDS["b.end"]
    ways = (cs.Pose(end.position + np.array((0.0, 0.0, sign * step)), end.quaternion) for sign in (1.0, -1.0))
    expected = {2: difference(*(shape_of(shape, HARNESS, around, **{"b.end": way}) for way in ways), step)}
    expected[12] = difference(*(shape_of(shape, HARNESS, around, sign * step) for sign in (1.0, -1.0)), step)
    for i, name in enumerate(numbers):
        kind, share = name.partition(":")[0], 1e-3 if name.startswith("length") else 0.02
        value = np.array(getattr(CABLE, kind))
        pair = (CABLE.replace(**{kind: ((1.0 + sign * share) * value).tolist()}) for sign in (1.0, -1.0))
        both = (HARNESS.replace(segments={**HARNESS.segments, "b": one}) for one in pair)
        expected[6 + i] = difference(*(shape_of(shape, one, around) for one in both), share * float(np.mean(value)))
    for column, wanted in expected.items():
        largest = max(np.abs(x).max() for x in wanted.values())
        for name, one in wanted.items():
            assert np.abs(columns[name][:, :, column] - one).max() <= 0.02 * largest + 1e-4, (column, name)
    for one in columns.values():
        assert not one[:, :, 16:].any()  # c.end hangs free


def test_the_default_is_the_held_ends_and_names_that_mean_nothing_are_refused() -> None:
    predictor = cs.Predictor(HARNESS, scene=scene("clip"))
    predictor.predict(ENDS)
    told, named = predictor.sensitivity(), predictor.sensitivity(predictor.grips)
    for name, one in told.items():
        np.testing.assert_array_equal(one, named[name])
    with pytest.raises(cs.ArgumentError, match=r"by: unknown key 'length'"):
        predictor.sensitivity("length")
    with pytest.raises(cs.ArgumentError, match=r"unknown key 'a.end'"):  # in a junction
        predictor.sensitivity(("a.end",))
    with pytest.raises(cs.ArgumentError, match=r"by = 'a.start' .* named once"):
        predictor.sensitivity(("a.start", "a.start"))
    with pytest.raises(cs.ArgumentError, match=r"by = \[\] .* name something"):
        predictor.sensitivity(())
    with pytest.raises(cs.ArgumentError, match=r"by_clips = True .* by names all columns"):
        predictor.sensitivity(("a.start",), by_clips=True)
