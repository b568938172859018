"""Replay with --inertia, where the acceleration of the markers loads the cable; and how many markers its tube holds."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from recordings import (
    ALONG_X,
    BEGIN,
    LEFT,
    MARKERS,
    PERIOD,
    POSE_ARRAY,
    RIGHT,
    Entry,
    markers_entry,
    motion,
    pose_entry,
    write_bag,
)
from replays import CABLE, END, FRAMES, PUSH, START, pushed, report_of, run
from reports import columns

import cable_shape as cs
from cable_shape.errors import ArgumentError, BagError
from cable_shape.replay.markers import MarkerComparison, nearest_on_polyline
from cable_shape.replay.observations import load_observations
from cable_shape.replay.settings import Settings

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"


def test_the_cable_is_loaded_by_its_own_acceleration(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", pushed())
    still = run(bag, tmp_path / "still", model="auto").markers.figures()
    outcome = run(bag, tmp_path / "out", model="auto", points=200, inertia=True, picture=True)
    moved = outcome.markers.figures()
    assert still is not None
    assert moved is not None
    assert still.mean * CABLE.length > 0.03
    assert moved.worst * CABLE.length < 1e-4
    report = report_of(tmp_path / "out")
    assert report["inertia"] == {
        "source": "accelerations and velocities of the markers, smoothed over 0.11 s",
        "cycles": FRAMES,
        "cycles_without": 0,
    }
    assert not [w for w in report["replay"]["warnings"] if w["kind"] == "QUASISTATIC"]
    assert "load it in 40 cycles |" in (tmp_path / "out" / "report.md").read_text()
    assert report_of(tmp_path / "still")["inertia"] is None


def test_where_a_marker_was_lost_the_cable_is_predicted_as_at_rest_and_it_is_said(tmp_path: Path) -> None:
    entries = pushed(hidden=20)
    bag = write_bag(tmp_path / "bag", entries)
    run(bag, tmp_path / "out", model="auto", points=200, inertia=True)
    report = report_of(tmp_path / "out")
    assert (report["inertia"]["cycles"], report["inertia"]["cycles_without"]) == (FRAMES - 11, 11)
    assert "load it in 29 cycles; in 11 they are not known" in (tmp_path / "out" / "report.md").read_text()
    # a frame that is missing: derivatives by the number of the frame would be wrong all about it
    gap = write_bag(tmp_path / "gap", [entry for k, entry in enumerate(pushed()) if k != 3 * 20 + 2])
    outcome = run(gap, tmp_path / "out", model="auto", points=200, inertia=True)
    assert outcome.inertia is not None
    assert outcome.inertia.without == 11  # the 10 frames about the gap, and the one in it, which is nearest to these
    figures = outcome.markers.figures()
    assert figures is not None
    assert figures.median * CABLE.length < 1e-4


def test_a_clock_that_is_set_back_has_accelerations_of_its_own(tmp_path: Path) -> None:
    later = [Entry(e.topic, e.kind, e.log_time + 10 * 10**9, e.message) for e in pushed(begin=BEGIN - 5 * 10**9)]
    outcome = run(
        write_bag(tmp_path / "bag", [*pushed(), *later]), tmp_path / "out", model="auto", points=200, inertia=True
    )
    assert outcome.tally.restarts == 1
    assert outcome.inertia is not None
    assert (outcome.inertia.cycles, outcome.inertia.without) == (2 * FRAMES, 0)
    figures = outcome.markers.figures()
    assert figures is not None
    assert figures.worst * CABLE.length < 1e-4


@pytest.mark.parametrize(
    ("entries", "text"),
    [
        (motion(30), "has no markers .*PoseArray.* on /cable/markers, from whose motion --inertia .* Name their topic"),
        (pushed(8), "the markers on /cable/markers tell no acceleration: .* for 0.11 s at least"),
        (pushed(20, frame="table"), "the markers are in frame 'table', the grips in 'world'"),
    ],
)
def test_without_markers_that_tell_it_inertia_is_refused(entries: list[Entry], text: str, tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", entries)
    with pytest.raises(BagError, match=text):
        run(bag, tmp_path / "out", model="auto", points=200, inertia=True)


def test_a_topic_of_markers_on_which_nothing_came(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", motion(30), empty={MARKERS: POSE_ARRAY})
    with pytest.raises(BagError, match="tell no acceleration"):
        run(bag, tmp_path / "out", model="auto", points=200, inertia=True)


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"model": "gradient4"}, "inertia: .*model 'gradient4' .*linear along the cable.* Or leave inertia out"),
        (
            {"model": "auto", "cable": CABLE.replace(bending_stiffness=0.0, twisting_stiffness=0.0)},
            "model 'auto' .*linear",
        ),
        ({"model": "auto", "scene": cs.Scene(contact="solve")}, "contact='solve' knows only .*linear"),
    ],
)
def test_what_knows_no_acceleration_along_the_cable_is_refused(
    options: dict[str, Any], text: str, tmp_path: Path
) -> None:
    with pytest.raises(ArgumentError, match=text):
        run(tmp_path / "bag", tmp_path / "out", inertia=True, **options)


def test_cables_in_clips_know_accelerations_along_them() -> None:
    assert Settings(CABLE, scene=cs.Scene(clips=[cs.Clip(0.5, cs.Pose())]), inertia=True).inertia


def test_a_cycle_takes_the_acceleration_of_its_cable() -> None:
    ends = cs.Pose(START, ALONG_X), cs.Pose(END, ALONG_X)
    table = np.linspace(PUSH, -PUSH, 7) + np.sin(np.arange(7.0))[:, None]
    known = cs.Uncertainty({"length": 0.004}, (0.002, 0.02))
    cycle = cs.Cycle(CABLE, points=60, uncertainty=known)
    report = cycle.step({"cable": ends}, 0, acceleration={"cable": table})
    expected = cs.predict(CABLE, *ends, points=60, acceleration=table)
    np.testing.assert_allclose(report.shapes["cable"].positions, expected.positions, rtol=0.0, atol=2e-5)
    # the tube is that of the loaded cable: of one 4 mm longer, whose middle moves as that of the loaded one does
    longer = [
        cs.predict(CABLE.replace(length=CABLE.length + by), *ends, points=60, acceleration=table).positions[30]
        for by in (0.004, -0.004)
    ]
    own = 0.5 * (longer[0] - longer[1])
    alone = cs.Cycle(CABLE, points=60, uncertainty=cs.Uncertainty({"length": 0.004}))
    tube = alone.step({"cable": ends}, 0, acceleration={"cable": table}).tubes["cable"]
    np.testing.assert_allclose(tube.covariance[30], np.outer(own, own), rtol=0.0, atol=0.02 * float(own @ own))
    still = cycle.step({"cable": ends}, 1).shapes["cable"]
    np.testing.assert_allclose(still.positions, cs.predict(CABLE, *ends, points=60).positions, rtol=0.0, atol=2e-5)
    with pytest.raises(ArgumentError, match="acceleration: unknown key 'other'"):
        cycle.step({"cable": ends}, 2, acceleration={"other": table})


def hanging(tmp_path: Path) -> Path:
    """Markers 1, 2, 3 and 5 cm beside the centreline, in four frames."""
    ends = cs.Pose(START, ALONG_X), cs.Pose(END, ALONG_X)
    seen = cs.predict(CABLE, *ends, model="cosserat", points=60).positions[[0, 10, 20, 30, 40, 59]].copy()
    seen[1:-1, 1] += (0.01, 0.02, 0.03, 0.05)
    entries = []
    for k in range(4):
        stamp = BEGIN + k * PERIOD
        entries += [pose_entry(LEFT, stamp, START), pose_entry(RIGHT, stamp, END), markers_entry(stamp, seen)]
    return write_bag(tmp_path / "bag", entries)


def test_the_share_of_markers_inside_the_tube_is_told(tmp_path: Path) -> None:
    known = cs.Uncertainty(misses=0.025, confidence=0.9)  # as wide everywhere
    outcome = run(hanging(tmp_path), tmp_path / "out", model="auto", uncertainty=known, picture=True)
    markers = report_of(tmp_path / "out")["markers"]
    assert markers["distances_with_a_tube"] == 16
    assert markers["inside_the_tube"] == 0.5
    assert markers["confidence_of_the_tube"] == 0.9
    assert "| 50.0 % of 16; it tells 90 % |" in (tmp_path / "out" / "report.md").read_text()
    np.testing.assert_allclose(outcome.markers.radii, 0.025)
    without = run(tmp_path / "bag", tmp_path / "out", model="auto").markers.figures()
    assert without is not None
    assert without.inside is None


def test_what_swings_has_a_tube_of_its_own(tmp_path: Path) -> None:
    entries = [
        pose_entry(topic, BEGIN + k * PERIOD, np.array((x, 0.1 * np.sin(0.3 * k), 0.5, *START[3:])))
        for k in range(10)
        for topic, x in ((LEFT, 0.0), (RIGHT, 0.6))
    ]
    bag = write_bag(tmp_path / "bag", entries)
    known = cs.Uncertainty({"bending_stiffness": 0.2}, (2e-3, 0.01))
    for name in ("one", "two"):
        run(bag, tmp_path / name, model="auto", motion="dynamic", uncertainty=known)
    one, two = ((tmp_path / name / "replay" / "replay.mcap").read_bytes() for name in ("one", "two"))
    assert one == two
    assert not [w for w in report_of(tmp_path / "one")["replay"]["warnings"] if w["kind"] == "STATUS"]


def test_the_tube_counts_where_the_marker_is() -> None:
    line = np.array(((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (2.0, 0.0, 0.0)))
    distances, places = nearest_on_polyline(np.array(((0.5, 0.3, 0.0), (3.0, 0.0, 0.0), (1.0, 0.0, 0.2))), line)
    np.testing.assert_allclose(distances, (0.3, 1.0, 0.2))
    np.testing.assert_allclose(places, (0.5, 2.0, 1.0))
    comparison = MarkerComparison(length=2.0, max_skew=1)
    comparison.add_shape(0, [line], [np.array((0.0, 0.4, 0.0))])
    comparison.add_markers(0, np.array(((0, 0, 0), (0.5, 0.21, 0.0), (1.0, 0.39, 0.0), (1.75, 0.09, 0), (2, 0, 0))))
    figures = comparison.figures()
    assert figures is not None
    assert (figures.with_tube, figures.inside) == (3, pytest.approx(2 / 3))  # radii 0.2, 0.4 and 0.1
    comparison.add_shape(2, [line])  # a shape without a tube
    comparison.add_markers(2, np.array(((0, 0, 0), (1.0, 0.1, 0.0), (2, 0, 0))))
    figures = comparison.figures()
    assert figures is not None
    assert (figures.distances, figures.with_tube) == (4, 3)
    assert math.isnan(comparison.radii[-1])


def test_the_recording_plots_distances_and_tube_over_time(tmp_path: Path) -> None:
    run(hanging(tmp_path), tmp_path / "out", model="auto", uncertainty=cs.Uncertainty(misses=0.025), rrd=True)
    held = columns(tmp_path / "out" / "replay.rrd")
    rows = held["/plots/markers/distance:Scalars:scalars"]
    assert len(rows) == 4
    np.testing.assert_allclose([v for _, v in rows], np.tile((27.5, 50.0), (4, 1)), atol=1e-3)  # mm, mean and largest
    np.testing.assert_allclose([v[0] for _, v in held["/plots/markers/tube:Scalars:scalars"]], 25.0)
    np.testing.assert_allclose([v[0] for _, v in held["/plots/markers/inside:Scalars:scalars"]], 50.0)  # %
    bag = write_bag(tmp_path / "other", motion(3))
    run(bag, tmp_path / "out", model="auto", rrd=True)
    assert not [name for name in columns(tmp_path / "out" / "replay.rrd") if name.startswith("/plots/markers")]


def test_two_replays_with_inertia_are_the_same(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", pushed())
    for name in ("one", "two"):
        run(bag, tmp_path / name, model="auto", points=200, inertia=True)
    one, two = (json.loads((tmp_path / name / "report.json").read_text()) for name in ("one", "two"))
    assert one["markers"] == two["markers"]
    assert (tmp_path / "one/replay/replay.mcap").read_bytes() == (tmp_path / "two/replay/replay.mcap").read_bytes()


def test_a_real_cable_is_followed_by_what_was_calibrated_on_its_other_recording(tmp_path: Path) -> None:
    """1.50 % of the length with grips and inertia, 1.94 % without these grips, 5.3 % at rest."""
    one, other = (DATA / f"cable1_recording{k}" for k in range(2))
    if not one.is_dir():
        pytest.skip(f"the recordings of real cables are not at {DATA}")
    begin = cs.Cable(length=0.998, linear_density=0.1, bending_stiffness=0.01)
    priors = {"length": 0.005, "start_offset": 0.005, "end_offset": 0.005, "start_tilt": 0.15, "end_tilt": 0.15}
    seen = load_observations(one, ("clamped", "swivel"), inertia=True)
    file = cs.calibrate(seen, begin, ("bending_stiffness", *priors), priors=priors).file
    means = []
    for held, inertia in ((file.held, True), ((cs.Held(), cs.Held("swivel")), True), (file.held, False)):
        options: dict[str, Any] = {"cable": file.cable, "start": held[0], "end": held[1], "inertia": inertia}
        figures = run(other, tmp_path / "out", model="auto", points=150, **options).markers.figures()
        assert figures is not None
        means.append(100.0 * figures.mean)
    assert means[0] < 1.7
    assert means[1] > means[0] + 0.2
    assert means[2] > 3.0 * means[0]
