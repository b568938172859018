"""Points that start from the shape in their middle are those that are solved by themselves."""

import numpy as np
import pytest

import cable_shape as cs
from cable_shape.planning.study_chunk import solve_chunk

ALONG = (0.5, 0.5, 0.5, 0.5)
HELD = {
    "cable": {"length": 1.2, "linear_density": 0.1, "bending_stiffness": 0.02, "diameter": 0.01,
              "max_tension": 40.0, "allowable_stress": 1e6},
    "start": {"position": [0, 0, 1], "quaternion": ALONG},
    "end": {"position": [0.8, 0, 1], "quaternion": ALONG},
    "scene": {"obstacles": [{"name": "ledge", "box": [0.2, 0.2, 0.02], "position": [0.4, 0, 0.55]}]},
    "vary": {"cable.length": {"normal": [1.2, 0.01]}, "cable.bending_stiffness": {"uniform": [0.016, 0.024]},
             "cable.linear_density": {"normal": [0.1, 0.005]}, "end.position.z": {"normal": [1.0, 0.01]}},
    "sample": {"points": 64},
    "measure": ["bend_radius", "tension", "clearance", "lowest", "force:0.3", "moment:end", "energy", "stretch",
                "stability", "stress"],
    "points": 60,
}  # fmt: skip
CLIPS = [{"name": "mid", "arc_length": 0.6, "position": [0.4, 0.1, 0.85], "kind": "ball"}]
WITH_CLIP = {"clips": CLIPS, "masses": [{"mass": 0.02, "arc_length": 0.3}]}
CASES = {
    "cable and grip": {},
    "turned in an offset": {
        "start": {"position": [0, 0, 1], "quaternion": [0, 0, 0, 1], "offset": {"position": [0.01, 0, 0.02],
                                                                              "quaternion": ALONG}},
        "vary": {"start.quaternion.y": {"normal": [0.0, 0.01]}, "start.position.0": {"normal": [0.0, 0.002]}},
    },
    "elastic, of two stiffnesses": {
        "cable": {**HELD["cable"], "bending_stiffness": [0.02, 0.03], "twisting_stiffness": 0.02,
                  "axial_stiffness": 500.0, "rest_curvature": [[0, 0.5, 0], [0, 2.0, 0], [0, 0, 0]]},
        "vary": {"cable.axial_stiffness": {"normal": [500, 50]}, "cable.twisting_stiffness": {"normal": [0.02, 0.002]},
                 "cable.length": {"normal": [1.2, 0.01]}},
    },
    "in a clip, with a mass": {
        "scene": WITH_CLIP,
        "vary": {"scene.clips.mid.arc_length": {"normal": [0.6, 0.003]}, "cable.length": {"normal": [1.2, 0.01]},
                 "scene.clips.0.position.z": {"normal": [0.85, 0.003]}},
        "measure": ["bend_radius", "clip:mid", "lowest", "energy", "moment:end"],
    },
    "hanging, with a plug": {"end": {"mass": 0.03}, "vary": {"cable.length": {"normal": [1.2, 0.01]},
                             "start.position.z": {"normal": [1, 0.01]}}, "measure": ["lowest", "tension", "energy"]},
}  # fmt: skip


def study(**changes):
    return cs.Study.from_mapping({**HELD, **changes})


@pytest.mark.parametrize("case", CASES.values(), ids=CASES)
def test_points_beside_one_are_those_solved_alone(case):
    asked = study(**case)
    assert asked.beside.rows(asked.points).usable.all()  # the shortcut was taken
    found, alone = asked.solve(0), solve_chunk(asked.cases, asked.measures, asked.points, False)
    spread = np.ptp(alone.value, axis=0)
    for k, measure in enumerate(asked.measures):
        share = 0.02 if measure.name == "stability" else 1e-5  # which is an estimate
        room = share * np.abs(alone.value[:, k]) + 1e-3 * spread[k]
        assert np.all(np.abs(found.value - alone.value)[:, k] <= room), measure.name
    assert np.allclose(found.limit, alone.limit, equal_nan=True)
    assert np.array_equal(found.instants, alone.instants)
    assert np.array_equal(found.first, alone.first)


def test_threads_chunks_and_neighbours_change_no_bit():
    whole = study(sample={"points": 300}).run(workers=1)
    threads = study(sample={"points": 300}, chunk=7).run(workers=2)
    assert np.array_equal(whole.value, threads.value)
    assert np.array_equal(whole.place, threads.place, equal_nan=True)
    some = whole.study.points[[250, 3]]
    alone = solve_chunk(whole.study.cases, whole.study.measures, some, False, study().beside)
    assert np.array_equal(alone.value, whole.value[[250, 3]])


def test_what_is_no_cable_and_what_is_far_is_solved_by_itself():
    asked = study(vary={"cable.linear_density": {"normal": [0.02, 0.02]}, "cable.length": {"normal": [1.2, 0.2]}})
    together = asked.beside.rows(asked.points)
    assert 10 < together.usable.sum() < 60
    found, alone = asked.solve(0), solve_chunk(asked.cases, asked.measures, asked.points, True)
    refused = asked.points[:, 0] < 0.0
    assert (found.status[refused] == -1).all()
    assert all("linear_density" in told for told in found.detail[refused])
    left = ~together.usable
    assert np.array_equal(found.value[left], alone.value[left], equal_nan=True)
    assert np.array_equal(found.first, alone.first)


@pytest.mark.parametrize(
    "changes",
    [
        {"vary": {"cable.length": [1.2, 1.3]}},
        {"vary": {"cable.diameter": {"normal": [0.01, 0.001]}}},
        {"motion": {"end": [{"position": [x, 0, 1], "quaternion": ALONG} for x in (0.8, 0.85)]}, "end": None},
        {"scene": {**HELD["scene"], "contact": "solve"}},
        {"model": "gradient4"},
        {"vary": {"cable.length": {"normal": [0.7, 0.01]}}},
    ],
)
def test_everything_else_is_solved_point_by_point(changes):
    assert study(**changes).beside is None


def test_every_shape_is_told_with_its_own_length():
    asked = study()
    rows = asked.beside.rows(asked.points)
    assert rows.shape(3).length == asked.points[3, 0]
    assert rows.shape(3).arc_length[-1] == pytest.approx(asked.points[3, 0])
