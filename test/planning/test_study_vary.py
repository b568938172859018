"""What varies in a study: lists, ranges, distributions, and where their values go."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

import cable_shape as cs
from cable_shape.planning.study_vary import Sample, axis_of, get, points_of, put, varied


def test_a_range_has_both_its_ends():
    assert np.allclose(axis_of("a", {"from": 0.63, "to": 0.9, "step": 0.001}).values, np.linspace(0.63, 0.9, 271))
    assert axis_of("a", {"from": 1, "to": 2, "count": 3}).values.tolist() == [1.0, 1.5, 2.0]
    assert axis_of("a", [3, 1]).values.tolist() == [3.0, 1.0]


@pytest.mark.parametrize(
    ("told", "words"),
    [
        ({"from": 1, "to": 0, "step": 0.1}, "the range is empty"),
        ({"from": 0, "to": 1}, "step or count"),
        ({"from": 0, "to": 1, "step": 1e-9}, "at most"),
        ({"from": 0, "step": 1}, "'to' is missing"),
        ({"fromm": 0, "to": 1}, "Did you mean 'from'"),
        ([], "at least one"),
        ("many", "numbers"),
        ({"normal": [1.0, -0.1]}, "above 0"),
        ({"uniform": [1.0, 1.0]}, "must be above the first"),
    ],
)
def test_what_is_no_range_is_refused(told, words):
    with pytest.raises(cs.ArgumentError, match=words):
        axis_of("cable.length", told)


def test_lists_are_combined_with_every_point_drawn():
    axes = [axis_of("a", [1, 2]), axis_of("b", {"normal": [5, 0.1]}), axis_of("c", [7, 8, 9])]
    points = points_of(axes, Sample("latin", 4, 1))
    assert points.shape == (2 * 3 * 4, 3)
    assert {(a, c) for a, _, c in points.tolist()} == {(a, c) for a in (1, 2) for c in (7, 8, 9)}
    assert len(np.unique(points[:, 1])) == 4


@pytest.mark.parametrize("kind", ["sobol", "latin", "random"])
def test_what_is_drawn_follows_its_law_and_is_the_same_again(kind):
    axes = [axis_of("a", {"normal": [2.0, 0.5]}), axis_of("b", {"uniform": [-1.0, 3.0]})]
    drawn = points_of(axes, Sample(kind, 1024, 3))
    assert np.array_equal(drawn, points_of(axes, Sample(kind, 1024, 3)))
    assert not np.array_equal(drawn, points_of(axes, Sample(kind, 1024, 4)))
    for column, law in zip(drawn.T, (stats.norm(2.0, 0.5), stats.uniform(-1.0, 4.0)), strict=True):
        assert stats.kstest(column, law.cdf).pvalue > 0.01
    assert axes[1].spread == pytest.approx(stats.uniform(-1.0, 4.0).std())
    assert axes[1].middle == 1.0


FILE = {"cable": {"length": 1.0}, "scene": {"clips": [{"name": "mid", "position": [1, 2, 3]}, {"arc_length": 0.5}]}}


def test_places_are_found_by_key_name_number_and_letter():
    out = varied(FILE, ["cable.length", "scene.clips.mid.position.z", "scene.clips.1.arc_length"], [2.0, 9.0, 0.25])
    assert out["cable"] == {"length": 2.0}
    assert out["scene"]["clips"] == [{"name": "mid", "position": [1, 2, 9.0]}, {"arc_length": 0.25}]
    assert FILE["scene"]["clips"][0]["position"] == [1, 2, 3]
    assert get(out, "scene.clips.mid.position.z") == 9.0
    assert get(FILE, "scene.masses.0.mass") is None


def test_a_place_that_is_not_there_is_refused():
    with pytest.raises(cs.UnknownKeyError, match="Did you mean 'mid'"):
        put(dict(FILE), "scene.clips.mit.position.z", 1.0)
    with pytest.raises(cs.ArgumentError, match="no part of the study"):
        put(dict(FILE), "cable.length.x", 1.0)


@given(st.integers(1, 5), st.integers(1, 5), st.integers(1, 9))
def test_there_are_as_many_points_as_combinations(a, b, n):
    axes = [axis_of("a", list(range(a))), axis_of("b", list(range(b))), axis_of("c", {"uniform": [0, 1]})]
    assert len(points_of(axes, Sample("random", n, 0))) == a * b * n
