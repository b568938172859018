"""Derivatives of measures against differences of cables that were solved anew."""

import numpy as np
import pytest

import cable_shape as cs
from cable_shape.planning.study_slopes import Asked, slopes

ALONG = (0.5, 0.5, 0.5, 0.5)
CLIPS = [{"name": "mid", "arc_length": 0.6, "position": [0.4, 0.1, 0.85], "kind": "ball"}]
HELD = {
    "cable": {"length": 1.2, "linear_density": 0.1, "bending_stiffness": 0.02, "diameter": 0.01},
    "start": {"position": [0, 0, 1], "quaternion": ALONG},
    "end": {"position": [0.8, 0, 1], "quaternion": ALONG},
    "scene": {"obstacles": [{"name": "ball", "sphere": 0.05, "position": [0.45, 0.03, 0.5]},
                            {"name": "within", "sphere": 0.05, "position": [0.4, 0.01, 0.61]}], "clips": []},
    "vary": {"cable.length": [1.2], "cable.bending_stiffness": [0.02], "cable.linear_density": [0.1],
             "end.position.x": [0.8], "start.position.z": [1.0], "start.quaternion.y": [0.5]},
    "measure": ["lowest", "clearance:ball", "clearance:within", "bend_radius", "tension", "energy"],
    "tolerance": 1e-7,
    "points": 400,
}  # fmt: skip
EXACT = [True] * 5 + [False]


def differences(asked, point, instants, scale):
    """By whole motions, each solved from nothing."""
    out = []
    for a in range(len(point)):
        both = []
        for side in (1.0, -1.0):
            row = np.array(point)
            row[a] += side * 2e-3 * scale[a]
            rows = asked.rows(row.tolist())[""]
            both.append([m.of(rows)[0][i] for m, i in zip(asked.measures, instants, strict=True)])
        out.append((np.array(both[0]) - both[1]) / (4e-3 * scale[a]))
    return np.array(out).T


def study(**changes):
    return cs.Study.from_mapping({**HELD, **changes})


def test_slopes_are_those_of_cables_solved_anew():
    asked = study()
    point = [axis.middle for axis in asked.axes]
    scale = np.array([0.02, 0.001, 0.005, 0.01, 0.01, 0.02])
    found = slopes(asked, np.array(point), [Asked(m, 0) for m in range(6)], scale, range(6))
    expected = differences(asked, point, [0] * 6, scale)
    size = np.abs(expected * scale).max(axis=1, keepdims=True)
    assert np.all(np.abs(found.slope - expected) * scale < 0.01 * size)
    assert found.exact[:3].tolist() == [EXACT] * 3
    assert not found.exact[3:].any()
    assert found.solves == 1 + 2 * 6  # what is exact takes no shape: the six are for the other measures


def test_in_a_clip_at_an_instant_of_a_motion():
    moved = {"instants": 7, "end": [{"position": [x, 0, 1], "quaternion": ALONG} for x in (0.75, 0.85)]}
    vary = {"scene.clips.mid.position.z": [0.85], "scene.clips.0.position.y": [0.1], "cable.length": [1.2],
            "scene.clips.mid.arc_length": [0.6]}  # fmt: skip
    scene = {"obstacles": [{"name": "ball", "sphere": 0.05, "position": [0.23, -0.09, 0.76]}], "clips": CLIPS}
    asked = study(motion=moved, scene=scene, vary=vary, measure=["lowest", "clip:mid", "clearance:ball"])
    point, scale = [0.85, 0.1, 1.2, 0.6], np.array([0.01, 0.01, 0.01, 0.01])
    found = slopes(asked, np.array(point), [Asked(0, 3), Asked(1, 6), Asked(2, 3)], scale, range(4))
    expected = differences(asked, point, [3, 6, 3], scale)
    size = np.abs(expected).max(axis=1, keepdims=True)
    assert np.all(np.abs(found.slope - expected) < 0.01 * size)
    assert found.exact.tolist() == [[True, True, True, False], [False] * 4, [True, True, True, False]]


def test_what_compiled_code_cannot_follow_is_told_by_differences_of_motions():
    asked = study(vary={"cable.length": [1.2], "end.position.x": [0.8]}, scene={**HELD["scene"], "contact": "solve"},
                  measure=["lowest", "tension"], tolerance=None)  # fmt: skip
    found = slopes(asked, np.array([1.2, 0.8]), [Asked(0, 0), Asked(1, 0)], np.array([0.02, 0.02]), [1])
    assert found.slope.shape == (2, 1)
    assert not found.exact.any()
    assert np.isfinite(found.slope).all()


def test_where_there_is_no_cable_on_one_side_there_is_no_slope():
    asked = study(vary={"scene.clips.mid.arc_length": [0.6]}, measure=["tension"],
                  scene={"clips": [{**CLIPS[0], "arc_length": 0.6}]})  # fmt: skip
    found = slopes(asked, np.array([1.1987]), [Asked(0, 0)], np.array([0.2]), [0])
    assert np.isnan(found.slope).all()


@pytest.mark.parametrize("told", [{"cable.length": ["a", "a"]}, {"cable.length": ["a", 1]}])
def test_words_are_named_once_and_alone(told):
    with pytest.raises(cs.ArgumentError, match=r"vary\.cable\.length"):
        study(vary=told)
