"""Derivatives of measures against differences of cables that were solved anew."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import cable_shape as cs
from cable_shape.planning.study_chunk import solve_chunk
from cable_shape.planning.study_slopes import Asked, slopes
from cable_shape.robots.robot import Robot

ROOT = Path(__file__).resolve().parents[2]
ROBOT = ROOT / "config/robots/dual_arm.yaml"
ALONG = (0.5, 0.5, 0.5, 0.5)
CLIPS = [{"name": "mid", "arc_length": 0.55, "position": [0.35, 0.1, 0.82], "quaternion": ALONG, "kind": "ball"}]
#: Nothing about it is symmetric: a place that is as bad as another one would be a kink.
HELD = {
    "cable": {"length": 1.2, "linear_density": 0.1, "bending_stiffness": [0.02, 0.03], "diameter": 0.01,
              "axial_stiffness": 800.0, "rest_curvature": [0.3, 0.2, 0.1]},
    "start": {"position": [0, 0, 1], "quaternion": ALONG},
    "end": {"position": [0.8, 0.1, 0.93], "quaternion": ALONG, "offset": {"position": [0.0, 0.0, 0.02]}},
    "scene": {"obstacles": [{"name": "ball", "sphere": 0.05, "position": [0.25, 0.05, 0.7]},
                            {"name": "within", "sphere": 0.05, "position": [0.4, 0.05, 0.6]}],
              "clips": CLIPS, "masses": [{"arc_length": 0.8, "mass": 0.02}]},
    "measure": ["lowest", "clearance:ball", "bend_radius", "tension", "twist_rate", "stress", "stretch",
                "stability", "force:0.3", "moment:end", "clip:mid", "energy", "inward"],
    "tolerance": 1e-7,
    "points": 400,
}  # fmt: skip
#: What varies, where, and the scale on which the shape changes.
ALL = {"cable.length": (1.2, 0.01), "cable.bending_stiffness.1": (0.03, 0.001), "cable.linear_density": (0.1, 0.002),
       "cable.twisting_stiffness": (0.02, 0.001), "cable.axial_stiffness": (800.0, 100.0),
       "cable.rest_curvature.0": (0.3, 0.05), "end.position.x": (0.8, 0.005), "start.position.z": (1.0, 0.005),
       "start.quaternion.y": (0.5, 0.005), "end.offset.position.z": (0.02, 0.005),
       "scene.clips.mid.position.z": (0.82, 0.005), "scene.clips.0.arc_length": (0.55, 0.005),
       "scene.masses.0.mass": (0.02, 0.002), "scene.obstacles.ball.position.x": (0.45, 0.005)}  # fmt: skip
FUNCTIONS = {"inward": lambda shape: float(shape.moment[len(shape.moment) // 3, 1])}


def differences(asked, point, instants, scale, step=2e-3):
    """By whole motions, each solved from nothing, extrapolated from two steps."""
    out = []
    for size in (step, 2.0 * step):
        told = []
        for a in range(len(point)):
            both = []
            for side in (1.0, -1.0):
                row = np.array(point)
                row[a] += side * size * scale[a]
                rows = asked.rows(row.tolist())[""]
                both.append([m.of(rows)[0][i] for m, i in zip(asked.measures, instants, strict=True)])
            told.append((np.array(both[0]) - both[1]) / (2.0 * size * scale[a]))
        out.append(np.array(told).T)
    return (4.0 * out[0] - out[1]) / 3.0


def study(**changes):
    told = {**HELD, **changes}
    functions = {name: f for name, f in FUNCTIONS.items() if name in told["measure"]}
    return cs.Study.from_mapping({key: value for key, value in told.items() if value is not None}, functions=functions)


def held_against(asked, scale, instants=None, near=1e-4):
    """What `slopes` tells, which must be as whole motions have it, to a ten thousandth of what any axis changes."""
    point = [axis.middle for axis in asked.axes]
    instants = [0] * len(asked.measures) if instants is None else instants
    which = [Asked(m, i) for m, i in enumerate(instants)]
    found = slopes(asked, np.array(point), which, np.array(scale), range(len(point)))
    expected = differences(asked, point, instants, scale)
    size = np.abs(expected * scale).max(axis=1, keepdims=True)
    off = np.abs(found.slope - expected) * scale / size
    assert np.isfinite(off).all()
    assert off.max() < near, [(asked.measures[i].name, asked.axes[k].name) for i, k in np.argwhere(off >= near)]
    return found


def test_slopes_of_every_measure_by_all_that_varies():
    asked = study(vary={name: [at] for name, (at, _) in ALL.items()})
    found = held_against(asked, [scale for _, scale in ALL.values()])
    assert found.exact.all()
    assert found.solves == 1  # the shape itself, and none beside it


def test_of_cables_without_clips_and_with_a_free_end():
    scene = {**HELD["scene"], "clips": [], "masses": []}
    vary = {name: [at] for name, (at, _) in ALL.items() if "scene.clips" not in name and "masses" not in name}
    measure = [name for name in HELD["measure"] if not name.startswith("clip:")]
    scale = [ALL[name][1] for name in vary]
    assert held_against(study(vary=vary, scene=scene, measure=measure), scale).exact.all()
    kinds = {"end": {"mass": 0.03, "force": [0.05, 0.1, 0.0]}, "motion": None}
    vary = {"cable.length": [1.2], "cable.rest_curvature.0": [0.3], "start.position.z": [1.0], "end.mass": [0.03],
            "end.force.1": [0.1], "start.quaternion.y": [0.5]}  # fmt: skip
    measure = ["lowest", "bend_radius", "tension", "stress", "energy", "moment:start"]
    hanging = study(vary=vary, measure=measure, scene=scene, **kinds)
    assert held_against(hanging, [0.01, 0.05, 0.005, 0.002, 0.01, 0.005]).exact.all()


@pytest.mark.parametrize("kind", ["fixed", "hinge", "slide"])
def test_in_a_clip_at_instants_of_a_motion(kind):
    moved = {"instants": 7, "end": [{"position": [x, 0.1, 0.93], "quaternion": ALONG} for x in (0.75, 0.85)]}
    vary = {"scene.clips.mid.position.z": [0.82], "cable.length": [1.2], "scene.clips.mid.quaternion.x": [0.5],
            "scene.clips.mid.arc_length": [0.55], "motion.end.0.position.x": [0.75]}  # fmt: skip
    scene = {**HELD["scene"], "masses": [], "clips": [{**CLIPS[0], "kind": kind}]}
    measure = ["lowest", "clip:mid", "stress", "bend_radius", "moment:0.3"]
    if kind == "slide":  # what is in it is found, however it is turned
        del vary["scene.clips.mid.arc_length"], vary["scene.clips.mid.quaternion.x"]
    scale = np.full(len(vary), 0.004)
    found = held_against(study(motion=moved, scene=scene, vary=vary, measure=measure), scale, [3, 6, 3, 5, 0])
    assert found.exact.all()
    assert found.solves == 4  # instants


def test_of_a_cable_in_sections():
    parts = [{"start": 0.3, "end": 0.5, "linear_density": 0.2, "bending_stiffness": 0.05}]
    cable = {"length": 1.2, "linear_density": 0.1, "bending_stiffness": 0.02, "diameter": 0.01, "sections": parts}
    vary = {"cable.length": [1.2], "cable.sections.0.end": [0.5], "cable.sections.0.linear_density": [0.2]}
    measure = ["lowest", "tension", "moment:0.35", "energy"]
    asked = study(cable=cable, vary=vary, measure=measure, scene={**HELD["scene"], "masses": []})
    assert held_against(asked, [0.01, 0.005, 0.01]).exact.all()


def test_along_the_surface_of_a_body_it_is_inside_of():
    vary = {"cable.length": [1.2], "scene.obstacles.within.position.y": [0.05]}
    asked = study(vary=vary, measure=["clearance:within"], scene={**HELD["scene"], "clips": [], "masses": []})
    assert asked.rows([1.2, 0.05])[""].tables[0, 1, 0] < -0.01
    assert held_against(asked, [0.01, 0.005]).exact.all()


def test_out_of_reach_there_is_no_slope():
    asked = study(vary={"scene.obstacles.ball.position.x": [5.0]}, measure=["clearance:ball", "lowest"])
    found = slopes(asked, np.array([5.0]), [Asked(0, 0), Asked(1, 0)], np.array([0.02]), [0])
    assert np.isnan(found.slope[0, 0])
    assert found.slope[1, 0] == 0.0
    assert found.exact.tolist() == [[False], [True]]
    assert found.solves == 1


def on_a_body(**changes):
    ball = {"name": "ball", "sphere": 0.1, "position": [0.42, 0.06, 0.66]}
    motion = {"instants": 3, "end": [{"position": [x, 0.1, 0.93], "quaternion": ALONG} for x in (0.79, 0.81)]}
    more = {"motion": motion, "scene": {"obstacles": [ball], "contact": "solve"}, "tolerance": 1e-6, **changes}
    return study(**more)


def test_on_a_body_slopes_are_those_on_the_same_points_of_it():
    vary = {"cable.length": [1.2], "start.position.z": [1.0], "scene.obstacles.ball.position.z": [0.66],
            "cable.linear_density": [0.1]}  # fmt: skip
    asked = on_a_body(vary=vary, measure=["bend_radius", "stress", "moment:end", "energy", "clearance:ball"])
    point, scale = np.array([1.2, 1.0, 0.66, 0.1]), np.array([0.02, 0.02, 0.02, 0.01])
    found = slopes(asked, point, [Asked(m, 1) for m in range(5)], scale, range(4))
    expected = differences(asked, point, [1] * 5, scale, 0.1)[:4]  # less would be the noise of their meshes
    size = np.abs(expected * scale).max(axis=1, keepdims=True)
    assert found.exact.all()
    assert found.solves == 1
    assert np.all(np.abs(found.slope[:4] - expected) * scale < 2e-3 * size)
    assert np.all(np.abs(found.slope[4]) < 2e-3)  # it stays on the body


def test_what_is_told_of_contacts_and_of_stability_there_is_told_by_motions():
    asked = on_a_body(vary={"cable.length": [1.2]}, measure=["stability", "inward", "lowest"])
    found = slopes(asked, np.array([1.2]), [Asked(m, 1) for m in range(3)], np.array([0.02]), [0])
    assert found.exact[:, 0].tolist() == [False, False, True]
    assert np.isfinite(found.slope).all()
    assert found.solves == 1 + 2 * 3


def test_of_a_cable_on_itself_they_are_told_by_differences_of_motions():
    turns = np.pi * np.arange(0.3, 1.2, 0.01)
    ends = [(Rotation.from_rotvec((2.0 * turn, 0, 0)) * Rotation.from_quat(ALONG)).as_quat() for turn in turns]
    cable = {"length": 1.0, "linear_density": 0.005, "bending_stiffness": [0.004, 0.003], "diameter": 0.008}
    motion = {"end": [{"position": [0.3, 0, 1], "quaternion": q.tolist()} for q in ends]}
    asked = study(cable=cable, end=None, motion=motion,
                  vary={"start.position.z": [1.0]}, measure=["lowest", "energy"], tolerance=None, points=100,
                  scene={"contact": "solve"})  # fmt: skip
    found = slopes(asked, np.array([1.0]), [Asked(0, 89), Asked(1, 89)], np.array([0.02]), [0])
    assert np.isfinite(found.slope).all()
    assert not found.exact.any()
    assert found.solves == 2 * 90


@pytest.mark.parametrize("contact", ["warn", "solve"])
def test_of_a_cable_that_arms_move(contact):
    robot = Robot.from_yaml(ROBOT)
    lifted = robot.home.copy()
    lifted[robot.joint_names.index("left_shoulder_lift_joint")] += 0.05
    joints = {"names": list(robot.joint_names), "positions": [robot.home.tolist(), lifted.tolist()]}
    wrist = robot.joint_names.index("right_wrist_1_joint")
    asked = cs.Study.from_mapping({
        "cable": str(ROOT / "config/cables/demo.yaml"), "robot": str(ROBOT), "scene": {"contact": contact},
        "motion": {"joints": joints, "instants": 3}, "measure": ["bend_radius", "tension"], "tolerance": 1e-7,
        "vary": {"cable.length": [1.0], f"motion.joints.positions.1.{wrist}": [robot.home[wrist]]}, "points": 100,
    })  # fmt: skip
    point, scale = np.array([axis.middle for axis in asked.axes]), np.array([0.01, 0.01])
    found = slopes(asked, point, [Asked(0, 2), Asked(1, 2)], scale, range(2))
    expected = differences(asked, point.tolist(), [2, 2], scale, 0.05)
    assert found.exact.all()
    assert np.allclose(found.slope, expected, rtol=2e-3, atol=1e-3 * np.abs(expected).max())


HARNESS = {
    "segments": {
        "trunk": {"length": 0.6, "linear_density": 0.12, "bending_stiffness": 0.01, "diameter": 0.012},
        "left": {"length": 0.4, "linear_density": 0.05, "bending_stiffness": 0.003, "diameter": 0.006},
        "right": {"length": 0.45, "linear_density": 0.05, "bending_stiffness": 0.003, "diameter": 0.006},
    },
    "junctions": [{"name": "fork", "ends": ["trunk.end", "left.start", "right.start"], "mass": 0.01}],
}
ALONG_X = (0.0, 0.7071067811865476, 0.0, 0.7071067811865476)


def test_of_a_harness():
    ends = {"trunk.start": {"position": [0, 0, 1], "quaternion": ALONG_X},
            "left.end": {"position": [0.8, 0.12, 0.9], "quaternion": ALONG_X}}  # fmt: skip
    clip = {"name": "mid", "segment": "trunk", "arc_length": 0.3, "position": [0.27, 0.03, 1.0]}
    motion = {
        "instants": 4,
        "ends": {"left.end": [{"position": [x, 0.12, 0.9], "quaternion": ALONG_X} for x in (0.77, 0.8)]},
    }
    obstacle = {"name": "ball", "sphere": 0.05, "position": [0.6, 0.05, 0.78]}
    vary = {"harness.segments.trunk.length": [0.6], "harness.segments.left.linear_density": [0.05],
            "scene.clips.mid.position.z": [1.0], "scene.clips.mid.arc_length": [0.3],
            "harness.junctions.fork.mass": [0.01], "scene.obstacles.ball.position.z": [0.78]}  # fmt: skip
    measure = ["bend_radius", "stress", "tension", "clip:mid", "lowest", "energy", "clearance"]
    asked = cs.Study.from_mapping(
        {"harness": HARNESS, "ends": ends, "motion": motion, "scene": {"clips": [clip], "obstacles": [obstacle]},
         "vary": vary, "measure": measure, "tolerance": 1e-7, "points": 100}
    )  # fmt: skip
    point = [axis.middle for axis in asked.axes]
    scale = np.array([0.004, 0.002, 0.004, 0.004, 0.002, 0.004])
    found = slopes(asked, np.array(point), [Asked(m, 3) for m in range(len(measure))], scale, range(len(point)))
    told = []
    for a, step in enumerate(scale.tolist()):
        moved = [[*point[:a], point[a] + side * 1e-2 * step, *point[a + 1 :]] for side in (1.0, -1.0)]
        high, low = solve_chunk(asked.cases, asked.measures, np.array(moved), True).over[:, 3]
        told.append((high - low) / (2e-2 * step))
    expected = np.array(told).T
    size = np.abs(expected * scale).max(axis=1, keepdims=True)
    assert found.exact.all()
    assert found.solves == 1
    assert np.all(np.abs(found.slope - expected) * scale < 1e-3 * size)


def test_so_are_closed_forms():
    cable = {"length": 1.2, "linear_density": 0.1, "bending_stiffness": 0.0}
    more = {"model": "catenary", "scene": None, "tolerance": None}
    asked = study(cable=cable, vary={"cable.length": [1.2]}, measure=["lowest", "tension"], **more)
    found = slopes(asked, np.array([1.2]), [Asked(0, 0), Asked(1, 0)], np.array([0.02]), [0])
    assert not found.exact.any()
    assert np.allclose(found.slope, differences(asked, [1.2], [0, 0], [0.02]), rtol=1e-3)


def test_where_there_is_no_cable_on_one_side_the_other_one_tells():
    asked = study(vary={"cable.linear_density": [0.0]}, measure=["tension", "lowest"])
    found = slopes(asked, np.zeros(1), [Asked(0, 0), Asked(1, 0)], np.array([0.01]), [0])
    both = [asked.rows([x])[""] for x in (1e-5, 0.0)]
    expected = [(m.of(both[0])[0][0] - m.of(both[1])[0][0]) / 1e-5 for m in asked.measures]
    assert found.exact.all()
    assert np.allclose(found.slope[:, 0], expected, rtol=1e-3)


def test_where_there_is_no_cable_on_either_side_there_is_no_slope():
    asked = study(vary={"scene.clips.mid.arc_length": [0.55]}, measure=["tension"])
    with pytest.raises(cs.ArgumentError, match="arc_length"):
        slopes(asked, np.array([1.5]), [Asked(0, 0)], np.array([0.2]), [0])


@pytest.mark.parametrize("told", [{"cable.length": ["a", "a"]}, {"cable.length": ["a", 1]}])
def test_words_are_named_once_and_alone(told):
    with pytest.raises(cs.ArgumentError, match=r"vary\.cable\.length"):
        study(vary=told)
