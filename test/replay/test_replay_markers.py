"""How far a replay finds markers on the cable from the centreline; where present, on real cables."""

from __future__ import annotations

import itertools
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from recordings import (
    ALONG_X,
    BEGIN,
    LEFT,
    MARKERS,
    PERIOD,
    RIGHT,
    Entry,
    markers_entry,
    pose_entry,
    write_bag,
)
from replays import CABLE, MODEL, report_of, run

import cable_shape as cs
from cable_shape.replay.markers import MarkerComparison, distance_to_polyline

ROOT = Path(__file__).resolve().parents[2]
DATA = ROOT.parent / "shared" / "data"


def test_markers_beside_the_centreline_are_measured(tmp_path: Path) -> None:
    """Inner markers a known distance sideways of the vertical plane in which the cable hangs, the outer ones far."""
    start, end = (0.0, 0.0, 0.5), (0.8, 0.0, 0.5)
    shape = cs.predict(CABLE, cs.Pose(start, ALONG_X), cs.Pose(end, ALONG_X), model=MODEL, points=60)
    on_line = shape.positions[[0, 10, 20, 30, 40, 59]].copy()
    sideways = np.array((9.0, 0.010, 0.020, 0.030, 0.050, 9.0))
    on_line[:, 1] += sideways
    entries = []
    for k in range(4):
        entries += [
            pose_entry(LEFT, BEGIN + k * PERIOD, start),
            pose_entry(RIGHT, BEGIN + k * PERIOD, end),
            markers_entry(BEGIN + k * PERIOD, on_line),
        ]
    hidden = on_line.copy()
    hidden[2] = math.nan
    entries[-1] = markers_entry(BEGIN + 3 * PERIOD, hidden)
    entries.append(markers_entry(BEGIN + 9 * PERIOD, on_line))
    entries.append(
        Entry(MARKERS, entries[-1].kind, BEGIN + 9 * PERIOD + 1, markers_entry(BEGIN, on_line, "table").message)
    )
    outcome = run(write_bag(tmp_path / "bag", entries), tmp_path / "out")
    expected = np.concatenate([np.tile(sideways[1:-1], 3), sideways[[1, 3, 4]]]) / CABLE.length
    markers = report_of(tmp_path / "out")["markers"]
    assert markers["frames_compared"] == 4
    assert markers["frames_without_a_shape"] == 1
    assert markers["markers_not_finite"] == 1
    assert markers["distances"] == len(expected)
    assert markers["mean"] == pytest.approx(expected.mean(), abs=1e-6)
    assert markers["median"] == pytest.approx(np.median(expected), abs=1e-6)
    assert markers["p90"] == pytest.approx(np.percentile(expected, 90.0), abs=1e-6)
    (refused,) = outcome.refusals
    assert (refused.topic, refused.reason) == (MARKERS, "other frame")


def test_markers_go_with_the_shape_nearest_in_time_in_whatever_order_they_come() -> None:
    line = np.array(((0.0, 0.0, 0.0), (1.0, 0.0, 0.0)))
    above = [np.array(((0.0, 0.0, 0.0), (0.5, 0.0, height), (1.0, 0.0, 0.0))) for height in (0.1, 0.2, 0.3)]
    comparison = MarkerComparison(length=2.0, max_skew=4)
    comparison.add_markers(0, above[0])  # before any shape
    comparison.add_shape(1, [line])
    comparison.add_shape(10, [line + np.array((0.0, 0.0, 0.1))])
    comparison.add_markers(8, above[1])  # nearer to 10
    comparison.add_markers(12, above[2])  # waits for the end
    comparison.add_shape(30, None)
    comparison.add_markers(29, above[2])  # the shape is not usable
    comparison.add_markers(50, above[2])  # no shape near
    comparison.finish()
    assert [mean for _, mean in comparison.series] == pytest.approx([0.1, 0.1, 0.2])
    assert (comparison.frames, comparison.unusable, comparison.unpaired) == (3, 1, 1)
    figures = comparison.figures()
    assert figures is not None
    assert figures.mean == pytest.approx(0.4 / 3 / 2.0)


numbers = st.floats(-1.0, 1.0, allow_subnormal=False)
points = st.lists(st.tuples(numbers, numbers, numbers), min_size=2, max_size=6).map(np.array)


@settings(derandomize=True, deadline=None, max_examples=60)
@given(points, points)
def test_distance_to_a_polyline_is_the_smallest_over_a_dense_sampling(markers: Any, line: Any) -> None:
    found = distance_to_polyline(markers, line)
    t = np.linspace(0.0, 1.0, 2001)[:, None]
    samples = np.concatenate([a + t * (b - a) for a, b in itertools.pairwise(line)])
    sampled = np.linalg.norm(markers[:, None] - samples[None], axis=2).min(axis=1)
    assert (found <= sampled + 1e-12).all()
    assert (sampled - found <= 2.0 * math.sqrt(3.0) / 4000.0 + 1e-12).all()


#: EI / w [m^3], free length [m], and the figure in % of a rod with static equilibrium on frames of this speed
REAL = {1: (8.8e-4, 0.998, 3.5)}


@pytest.mark.parametrize("cable_number", sorted(REAL))
def test_a_real_cable_is_followed_as_closely_as_a_static_rod_can(tmp_path: Path, cable_number: int) -> None:
    bag = DATA / f"cable{cable_number}_recording0"
    if not bag.is_dir():
        pytest.skip(f"the recordings of real cables are not at {DATA}")
    ratio, length, figure = REAL[cable_number]
    density = 0.1
    cable = cs.Cable(length=length, linear_density=density, bending_stiffness=ratio * density * 9.81)
    outcome = run(bag, tmp_path / "out", cable=cable, end=cs.Held("swivel"), points=150)
    assert outcome.tally.cycles == 500
    figures = outcome.markers.figures()
    assert figures is not None
    assert figures.frames == 500
    assert 100.0 * figures.mean <= 1.2 * figure
