"""What makes measures unsure, against sensitivities; envelopes, against shapes drawn otherwise."""

import numpy as np
import pytest

import cable_shape as cs

ALONG = (0.5, 0.5, 0.5, 0.5)
LAWS = {
    "cable.length": {"normal": [1.2, 0.002]},
    "cable.bending_stiffness": {"normal": [0.02, 0.0005]},
    "end.position.z": {"uniform": [0.998, 1.002]},
}


def study(**changes):
    values = {
        "cable": {"length": 1.2, "linear_density": 0.1, "bending_stiffness": 0.02},
        "start": {"position": [0, 0, 1], "quaternion": ALONG},
        "end": {"position": [0.8, 0, 1], "quaternion": ALONG},
        "vary": LAWS,
        "measure": ["lowest", "bend_radius"],
        "points": 60,
        "sample": {"points": 512},
        **changes,
    }
    return cs.Study.from_mapping(values)


def test_shares_of_small_tolerances_are_those_of_the_sensitivities():
    asked = study(points=400)  # the lowest of few points is lower than the next one, not than all between
    found = asked.shares(128)
    middle = [axis.middle for axis in asked.axes]
    spread = np.array([axis.spread for axis in asked.axes])
    slopes = []
    for i, step in enumerate(spread.tolist()):
        both = [[*middle[:i], middle[i] + side * step, *middle[i + 1 :]] for side in (-1.0, 1.0)]
        low, high = ([float(m.of(asked.rows(row)[""])[0][0]) for m in asked.measures] for row in both)
        slopes.append((np.array(high) - np.array(low)) / (2.0 * step))
    moved = (np.array(slopes).T * spread) ** 2
    assert np.allclose(found.first, moved / moved.sum(axis=1, keepdims=True), atol=0.05)
    assert np.allclose(found.total, found.first, atol=0.05)
    assert np.allclose(found.linear, moved / moved.sum(axis=1, keepdims=True), atol=5e-3)
    assert np.allclose(found.slope[0], np.array(slopes)[:, 0], rtol=0.02)
    assert np.allclose(found.slope[1, :2], np.array(slopes)[:2, 1], rtol=0.02)  # by the height both ends are as sharp
    assert found.exact.all()
    assert found.deviation == pytest.approx(np.sqrt(moved.sum(axis=1)), rel=0.15)
    assert found.solves == 128 * 5
    assert found.sources == tuple(LAWS)


def test_an_envelope_holds_as_many_shapes_as_it_says():
    held = study().envelope(0.9)
    assert held.shapes == 512
    drawn = study(sample={"kind": "random", "points": 600, "seed": 5})
    lines = np.array([drawn.rows(i)[""].part(1, 3)[0] for i in range(600)])
    inside = (np.linalg.norm(lines - held.middle[""], axis=2) <= held.radius[""] + 1e-9).mean(axis=0)
    assert np.all(np.abs(inside[5:-5] - 0.9) < 0.05)  # 600 drawn: a standard deviation of 0.012
    assert study().envelope(0.5).radius[""].max() < held.radius[""].max()


def test_an_envelope_of_few_points_is_that_of_many_drawn_at_random():
    few, many = study(sample={"points": 2048}), study(sample={"kind": "random", "points": 20_000, "seed": 3})
    told, drawn = few.envelope(), many.envelope()
    off = np.linalg.norm(told.middle[""] - drawn.middle[""], axis=1) + np.abs(told.radius[""] - drawn.radius[""])
    assert off.max() < 0.02 * 2.0 * drawn.radius[""].max()
    assert drawn.shapes == 20_000


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: study(vary={"cable.length": [1.2]}).shares(), "must have a distribution"),
        (lambda: study(vary={"cable.length": [1.2]}).envelope(), "must have a distribution"),
        (lambda: study().shares(100), "a power of 2"),
        (lambda: study().envelope(1.5), "at most 1"),
        (lambda: study().envelope(instant=3), "fewer instants"),
        (lambda: study(vary={"cable.length": {"normal": [0.82, 0.1]}}).shares(64), "narrower"),
    ],
)
def test_what_is_wrong_is_refused(call, words):
    with pytest.raises(cs.ArgumentError, match=words):
        call()
