"""Whatever is given to a public call, it is taken, or refused with an error of the package that says what to do."""

from __future__ import annotations

import inspect
import math
import random
from collections.abc import Callable
from fractions import Fraction
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import cable_shape as cs
from cable_shape.calibration.photo import Clicks
from cable_shape.scene.scene import SCENE_KEYS

BIG = 10**400
START, END = cs.Pose((0, 0, 1), (0.5,) * 4), cs.Pose((0.8, 0, 1), (0.5,) * 4)
CABLE = cs.Cable(length=1.2, linear_density=0.1, bending_stiffness=0.01)
FORK = cs.Harness({"a": CABLE, "b": CABLE}, [cs.Junction("j", ("a.end", "b.start"))])
ROWS = {end: np.tile((x, 0.0, 0.0, 0.5, 0.5, 0.5, 0.5), (2, 1)) for end, x in (("a.start", 0.0), ("b.end", 1.8))}
TWO = cs.GripPath(np.tile(START.array, (2, 1)), np.tile(END.array, (2, 1)))
SHAPE = cs.predict(CABLE, START, END, model="cosserat", points=12)
SEEN = [cs.Observation(START, END, SHAPE.positions[2:-2])]
FOUND = cs.calibrate(SEEN, CABLE)
LINKED = cs.Obstacle("tool", cs.Sphere(0.05), link="tool")
SCENE = cs.Scene(
    obstacles=[cs.Obstacle("ball", cs.Sphere(0.05)), LINKED],
    clips=[cs.Clip(0.6, cs.Pose((0.4, 0, 0.7)))],
    masses=[cs.PointMass(0.3, 0.01)],
    sockets={"port": cs.Pose()},
    plug=cs.Plug("port"),
)
WIRE, OPEN = cs.Wire(0.002, 0.01, youngs_modulus=1e9, count=3), cs.Pose(quaternion=(0.6, 0, 0, 0.8))
HARNESS = cs.Harness({"a": CABLE, "b": CABLE}, [cs.Junction("j", ("a.end", "b.end"), frames={"b.end": OPEN})])
HELD = {"a.start": START}
LOOKS = [cs.HarnessObservation(HELD, {"a": cs.predict(HARNESS, HELD, points=12).segments["a"].positions[2:-2]})]
GOOD = {"length": 1.2, "linear_density": 0.1, "bending_stiffness": 0.01}
SPREAD = cs.Uncertainty({"length": 1e-3}, (1e-3, 1e-2))
PIXELS = {
    "start": [[0, 0]], "end": [[80, 0]], "point": [[20, 30], [40, 40], [60, 30]], "known": [[0, 0], [80, 0]],
    "start_along": [], "end_along": [], "plumb": [],
}  # fmt: skip
CLICKS = Clicks(
    {kind: np.array(rows, dtype=float).reshape(-1, 2) for kind, rows in PIXELS.items()},
    np.array([[0.0, 0.0], [0.8, 0.0]]),
    np.full(3, math.nan),
)


class _Odd:
    """Neither a number nor anything else."""

    def __repr__(self) -> str:
        raise ValueError("no repr")


def stepped(**given: Any) -> object:
    names = inspect.signature(cs.Cycle).parameters
    made = {name: value for name, value in given.items() if name in names}
    cycle = cs.Cycle(made.pop("cables", CABLE), **made)
    step = {"grips": {"cable": (START, END)}, "stamp": 0, "links": {"tool": START}}
    return cycle.step(**{**step, **{name: value for name, value in given.items() if name not in names}})


def edited(part: Any, pose: Any, clip: Any, arc_length: Any, other: Any, **given: Any) -> object:
    cycle = cs.Cycle(CABLE, points=30)
    cycle.step({"cable": (START, END)}, 0)
    makers: list[Callable[[], Any]] = [
        lambda: cs.Add(part), lambda: cs.Move("box", pose), lambda: cs.Insert(clip), lambda: cs.SetCable(other),
        lambda: cs.Regrip("end", arc_length), lambda: given["edit"],
    ]  # fmt: skip
    return [cycle.edit(make(), cable=given["cable"], stamp=given["stamp"]) for make in makers]


def held(**given: Any) -> object:
    names = inspect.signature(cs.Predictor).parameters
    predictor = cs.Predictor(
        given.pop("cable", CABLE), points=given.pop("points", 12), **{n: given.pop(n) for n in names if n in given}
    )
    at = given.pop("at", "cable")
    if "new_scene" in given:
        predictor.scene = given.pop("new_scene")
    predictor.predict(**{"start": START, "end": END, **given})
    return predictor.sensitivity(at=at) if predictor.is_rod else None


def swung(**given: Any) -> object:
    motion = cs.Motion(**{name: given[name] for name in ("cable", "scene", "gravity", "points", "elements")})
    motion.begin(given["start"], given["end"], by=given["by"], at=given["at"])
    motion.step(given["start"], given["end"], given["dt"])
    return motion.sensitivity(given["of"])


def swung_tube(**given: Any) -> object:
    names = ("cable", "uncertainty", "scene", "gravity", "points", "elements")
    tubes = cs.MotionTube(**{name: given[name] for name in names})
    tubes.begin(given["start"], given["end"])
    return tubes.step(given["start"], given["end"], given["dt"])


@cache
def held_by_arms() -> Any:
    from cable_shape.robots.robot import Robot
    from cable_shape.robots.steering import HeldCable

    robot = Robot.from_yaml(Path(__file__).resolve().parents[2] / "config/robots/dual_arm.yaml")
    return HeldCable(cs.Predictor(CABLE, points=12), robot)


def tracked(**given: Any) -> Any:
    """One look."""
    names = ("stamp", "start", "end")
    tracker = cs.Tracker(**{name: x for name, x in given.items() if name not in (*names, "seen")})
    return tracker.update(given["seen"], **{name: given[name] for name in names})


def servoed(**given: Any) -> object:
    names = ("targets", "rate", "speed", "delay", "settling", "q")
    servo = cs.Servo(held_by_arms(), limits=given["limits"], **{name: given[name] for name in names})
    servo.q = given["measured"]
    return servo.step(given["shape"], given["dt"])


def gripped(**given: Any) -> object:
    names = ("ends", "acceleration", "at")
    predictor = cs.Predictor(given["harness"], **{n: x for n, x in given.items() if n not in (*names, "harness")})
    predictor.predict(given["ends"], acceleration=given["acceleration"])
    return predictor.sensitivity(at=given["at"])


def pose_methods(position: Any, quaternion: Any, turns: Any, other: Any) -> object:
    pose = cs.Pose(position, quaternion, turns)
    return pose.distance(other), pose.inverse().matrix(), hash(pose), pose == other, repr(pose)


#: A call, and by parameter what it takes.
CALLS: dict[str, tuple[Callable[..., object], dict[str, Any]]] = {
    "Cable": (
        cs.Cable,
        {
            **GOOD, "twisting_stiffness": 0.01, "axial_stiffness": 1e3, "shear_stiffness": 1e3, "diameter": 0.01,
            "rest_curvature": (0.0, 0.1, 0.0), "gradient_length": 0.01, "min_bend_radius": 0.01, "max_tension": 1.0,
            "max_twist_rate": 1.0, "inner_diameter": 0.0, "allowable_stress": 1e6, "tails": {"end": 0.1},
            "sections": [cs.Section(0.1, 0.2, diameter=0.02)], "stiffness_interval": (0.1, 0.2),
            "retardation_time": 0.01, "drag": 0.1, "friction": 0.1,
        },
    ),
    "Cable.from_material": (
        cs.Cable.from_material,
        {
            "length": 1.0, "diameter": 0.01, "youngs_modulus": 1e7, "poisson_ratio": 0.3, "density": 1e3,
            "inner_diameter": 0.0, "allowable_stress": 1e6, "max_tension": 1.0,
        },
    ),
    "Cable.from_mapping": (cs.Cable.from_mapping, {"values": GOOD}),
    "Cable.from_mapping, values": (lambda **values: cs.Cable.from_mapping(values), GOOD),
    "Cable.from_yaml": (cs.Cable.from_yaml, {"path": "nowhere.yaml"}),
    "Cable.replace": (CABLE.replace, GOOD),
    "CableFile.from_mapping": (cs.CableFile.from_mapping, {"values": {**GOOD, "grips": {"end": {"kind": "swivel"}}}}),
    "CableFile.from_mapping, values": (lambda **v: cs.CableFile.from_mapping(v), {**GOOD, "grips": {"start": {}}}),
    "CableFile.from_yaml": (cs.CableFile.from_yaml, {"path": "nowhere.yaml"}),
    "Held": (cs.Held, {"kind": "swivel", "offset": START, "correction": START}),
    "Held.grip": (cs.Held("swivel").grip, {"end": START}),
    "Held.from_mapping": (cs.Held.from_mapping, {"values": {"correction": {"position": (0, 0, 0)}}}),
    "Section": (cs.Section, {"start": 0.1, "end": 0.2, "bending_stiffness": 0.1, "rest_curvature": (0, 0, 1)}),
    "Wire": (cs.Wire, {"outside_diameter": 0.01, "linear_density": 0.01, "bending_stiffness": 0.01, "count": 2}),
    "Cable.from_wires": (cs.Cable.from_wires, {"wires": [WIRE], "length": 1.0, "covering": cs.Wire(0.01, 0.1, 0.1)}),
    "Centreline.from_points": (cs.Centreline.from_points, {"points": [(0, 0, 0), (0.5, 0.1, 0), (1, 0, 0)]}),
    "Cable.from_centreline": (
        cs.Cable.from_centreline,
        {"curve": [(0, 0, 0), (0.5, 0.1, 0), (1, 0, 0)], "linear_density": 0.1, "bending_stiffness": 0.01},
    ),
    "Junction": (
        cs.Junction, {"name": "j", "ends": ("a.end", "b.end"), "kind": "ball", "frames": {"a.end": OPEN}, "mass": 0.1}
    ),
    "Harness": (cs.Harness, {"segments": {"a": CABLE, "b": CABLE}, "junctions": HARNESS.junctions}),
    "Harness.from_mapping": (cs.Harness.from_mapping, {"values": HARNESS.as_dict()}),
    "Harness.from_mapping, values": (lambda **values: cs.Harness.from_mapping(values), HARNESS.as_dict()),
    "Harness.from_yaml": (cs.Harness.from_yaml, {"path": "nowhere.yaml"}),
    "Predictor, of a harness": (
        gripped,
        {
            "harness": HARNESS, "model": "auto", "gravity": (0, 0, -9.81), "points": 12, "tolerance": 1e-3,
            "scene": None, "distributed_load": {"a": np.zeros((2, 3))}, "time_budget": 1.0,
            "ends": {"a.start": START, "b.start": cs.FreeEnd(0.1)}, "acceleration": {"b": (0, 0, 1)}, "at": "gripper",
        },
    ),
    "Pose": (pose_methods, {"position": (0, 0, 1), "quaternion": (0, 0, 0, 1), "turns": 1, "other": END}),
    "Grip": (cs.Grip, {"pose": START, "kind": "swivel", "offset": cs.Pose(), "curvature": (0, 0, 0)}),
    "Grip.at": (cs.Grip(START).at, {"pose": START}),
    "FreeEnd": (cs.FreeEnd, {"mass": 0.1, "force": (0, 0, 1), "moment": (0, 0, 0)}),
    "Box": (cs.Box, {"size": (1, 1, 1)}),
    "Allow": (cs.Allow, {"body": "table", "start": 0.1, "end": 0.2, "max_force": 1.0}),
    "Add": (cs.Add, {"part": cs.PointMass(0.1, 0.1)}),
    "Remove": (cs.Remove, {"name": "a"}),
    "Move": (cs.Move, {"name": "a", "pose": START}),
    "Insert": (cs.Insert, {"clip": cs.Clip(0.1, START)}),
    "Release": (cs.Release, {"name": "a"}),
    "Regrip": (cs.Regrip, {"end": "start", "arc_length": 0.1}),
    "Open": (cs.Open, {"end": "end"}),
    "SetCable": (cs.SetCable, {"cable": CABLE}),
    "Sphere": (cs.Sphere, {"radius": 1}),
    "Cylinder": (cs.Cylinder, {"radius": 1, "length": 1}),
    "Capsule": (cs.Capsule, {"radius": 1, "length": 1}),
    "HalfSpace": (cs.HalfSpace, {}),
    "Mesh": (cs.Mesh, {"vertices": np.eye(3), "faces": [[0, 1, 2]]}),
    "Points": (cs.Points, {"points": np.eye(3), "radius": 0.01}),
    "Points.from_file": (cs.Points.from_file, {"path": "nowhere.xyz", "radius": 0.01, "scale": 1.0}),
    "HeightField": (cs.HeightField, {"heights": np.eye(3), "spacing": 0.01, "radius": 0.01}),
    "HeightField.from_file": (
        cs.HeightField.from_file,
        {"path": "nowhere.csv", "spacing": 0.01, "radius": 0.01, "scale": 1.0},
    ),
    "Mesh.from_file": (cs.Mesh.from_file, {"path": "nowhere.stl", "scale": 1.0}),
    "Obstacle": (cs.Obstacle, {"name": "a", "solid": cs.Sphere(1), "pose": START, "link": None, "friction": 0.1}),
    "Clip": (cs.Clip, {"arc_length": 0.1, "pose": START, "kind": "slide", "friction": 0.2}),
    "PointMass": (cs.PointMass, {"arc_length": 0.1, "mass": 0.1}),
    "Plug": (cs.Plug, {"socket": "port", "offset": START}),
    "Scene": (cs.Scene, {key: getattr(SCENE, key) for key in SCENE_KEYS}),
    "Scene.replace": (SCENE.replace, {key: getattr(SCENE, key) for key in SCENE_KEYS}),
    "Scene.from_mapping": (cs.Scene.from_mapping, {"values": SCENE.as_dict(), "folder": "."}),
    "Scene.from_mapping, values": (lambda **values: cs.Scene.from_mapping(values), SCENE.as_dict()),
    "Scene.from_yaml": (cs.Scene.from_yaml, {"path": "nowhere.yaml"}),
    "predict": (
        cs.predict,
        {
            "cable": CABLE, "start": START, "end": END, "model": "auto", "gravity": (0, 0, -9.81), "points": 12,
            "tolerance": 1e-3, "scene": None, "distributed_load": np.zeros((2, 3)), "acceleration": (0, 0, 1),
        },
    ),
    "Predictor": (
        held,
        {
            "cable": CABLE, "model": "cosserat", "time_budget": 1.0, "robot_links": [LINKED], "points": 12,
            "gripping_links": ["tool"], "start": START, "end": cs.Grip(END), "links": {"tool": START}, "at": "gripper",
            "scene": None, "tolerance": 1e-3, "new_scene": None, "friction": True,
        },
    ),
    "Cycle": (
        stepped,
        {
            "cables": CABLE, "scene": SCENE, "robot_links": [LINKED], "gripping_links": ["tool"], "model": "auto",
            "gravity": (0, 0, -9.81), "points": 12, "tolerance": 1e-3, "tails": {"cable": {"end": 0.1}},
            "plugs": {"cable": cs.Plug("port")}, "clips": {"cable": ()}, "snap_horizon": 1.0, "time_budget": 1.0,
            "quasistatic_limit": 0.25, "uncertainty": None,
            "distributed_load": {"cable": np.zeros((2, 3))}, "acceleration": {"cable": (0, 0, 1)},
            "grips": {"cable": (START, END)}, "stamp": 0, "links": {"tool": START}, "early": None,
        },
    ),
    "Cycle.edit": (
        edited,
        {
            "part": cs.Obstacle("box", cs.Sphere(0.1)), "pose": START, "clip": cs.Clip(0.5, cs.Pose((0.4, 0, 0.8))),
            "other": CABLE, "arc_length": 0.9, "edit": cs.Open("end"), "cable": "cable", "stamp": 1,
        },
    ),
    "predict_batch": (
        cs.predict_batch,
        {
            "cable": CABLE, "starts": START.array[None], "ends": END.array[None], "model": "auto", "points": 12,
            "gravity": (0, 0, -9.81), "scene": None, "tolerance": 1e-3, "distributed_load": None, "threads": 1,
            "time_limit": 10.0, "uncertainty": SPREAD,
        },
    ),
    "JointPath": (cs.JointPath, {"joint_names": ["a"], "positions": [[0.0], [1.0]], "times": [0.0, 1.0]}),
    "JointPath.from_message": (cs.JointPath.from_message, {"message": SimpleNamespace(joint_names=["a"], points=[])}),
    "predict_batch, harness": (
        cs.predict_batch,
        {
            "cable": FORK, "starts": ROWS, "model": "auto", "points": 12, "gravity": (0, 0, -9.81), "scene": None,
            "tolerance": 1e-3, "distributed_load": {"a": np.zeros((2, 3))}, "acceleration": {"b": (0, 0, 1)},
            "threads": 1, "time_limit": 10.0, "kinds": {"b.end": "swivel"},
        },
    ),
    "EndsPath": (cs.EndsPath, {"ends": ROWS, "times": [0.0, 1.0]}),
    "GripPath": (cs.GripPath, {"starts": TWO.starts, "ends": TWO.ends, "times": [0.0, 1.0]}),
    "Study": (
        lambda **values: cs.Study(**values).rows(0),
        {
            "cable": CABLE, "start": START, "end": END, "scene": cs.Scene(), "vary": {"cable.length": [1.2]},
            "measure": ["tension"], "at": "worst", "chunk": 1, "points": 12, "model": "auto", "tolerance": 1e-3,
            "gravity": (0, 0, -9.81), "sample": {"points": 2}, "motion": {"instants": 2}, "folder": ".",
        },
    ),
    "shape_stop": (
        cs.shape_stop,
        {"cable": CABLE, "path": TWO, "duration": 0.05, "scene": None, "gravity": (0.0, 0.0, -9.81)},
    ),
    "swept": (cs.swept, {"shapes": [SHAPE, SHAPE], "margin": 0.05, "looseness": 0.05}),
    "export": (cs.export, {"shapes": SHAPE, "path": "nowhere/a.stl", "cable": CABLE, "period": 0.1}),
    "Study.from_mapping": (cs.Study.from_mapping, {"values": {"cable": GOOD, "start": {"position": (0, 0, 0)}}}),
    "Study.from_yaml": (cs.Study.from_yaml, {"path": "nowhere.yaml"}),
    "check_trajectory": (
        cs.check_trajectory,
        {
            "cable": CABLE, "scene": None, "robot": None, "trajectory": TWO, "gravity": (0, 0, -9.81), "points": 12,
            "tolerance": 1e-3, "distributed_load": np.zeros((2, 3)), "acceleration": np.zeros((2, 3)),
            "time_limit": 10.0, "proceed": None,
        },
    ),
    "check_trajectory, harness": (
        cs.check_trajectory,
        {
            "cable": FORK, "scene": None, "robot": None, "trajectory": ROWS, "gravity": (0, 0, -9.81), "points": 12,
            "tolerance": 1e-3, "distributed_load": {"a": np.zeros((2, 3))}, "time_limit": 10.0, "proceed": None,
        },
    ),
    "Motion": (
        swung,
        {
            "cable": CABLE, "scene": None, "gravity": (0, 0, -9.81), "points": 12, "elements": 8, "start": START,
            "end": cs.Grip(END), "dt": 0.01, "by": ("drag", "start"), "at": "gripper", "of": "velocity",
        },
    ),
    "MotionTube": (
        swung_tube,
        {
            "cable": CABLE, "uncertainty": SPREAD, "scene": None, "gravity": (0, 0, -9.81), "points": 12, "elements": 8,
            "start": START, "end": cs.Grip(END), "dt": 0.01,
        },
    ),
    "PointsTarget": (
        cs.PointsTarget, {"arc_length": 0.5, "positions": (0.4, 0.0, 0.2), "weight": 1.0, "tolerance": 1e-3}
    ),
    "CentrelineTarget": (cs.CentrelineTarget, {"positions": np.eye(3), "weight": 1.0, "tolerance": 1e-3}),
    "TangentTarget": (
        cs.TangentTarget, {"arc_length": 0.5, "direction": (0, 0, 1), "weight": 1.0, "tolerance": 1e-2}
    ),
    "TwistTarget": (cs.TwistTarget, {"arc_length": 0.5, "direction": (0, 0, 1), "weight": 1.0, "tolerance": 1e-2}),
    "MouthTarget": (
        cs.MouthTarget,
        {"arc_length": 0.5, "pose": START, "outward": (0, 1, 0), "approach": 0.1, "weight": 1.0, "tolerance": 1e-3},
    ),
    "MouthTarget.of": (cs.MouthTarget.of, {"clip": cs.Clip(0.5, START), "outward": (0, 1, 0), "approach": 0.1}),
    "KeepClear": (cs.KeepClear, {"scene": SCENE, "minimum": 0.01}),
    "Tracker": (
        tracked,
        {
            "cable": CABLE, "scene": SCENE, "uncertainty": SPREAD, "noise": 0.005, "outliers": 0.1,
            "gravity": (0, 0, -9.81), "points": 21, "segment": None, "seen": np.eye(3), "stamp": 1, "start": START,
            "end": END,
        },
    ),
    "CableShape.of_points": (cs.CableShape.of_points, {"positions": np.eye(3), "length": 1.0}),
    "Servo": (
        servoed,
        {
            "targets": [cs.PointsTarget(0.5, (0.4, 0.0, 0.2))], "limits": [], "rate": 3.0, "speed": 0.1, "delay": 0.05,
            "settling": 0.2, "q": None, "measured": np.zeros(14), "shape": SHAPE, "dt": 0.02,
        },
    ),
    "Observation": (
        cs.Observation,
        {
            "start": START, "end": END, "points": [[0.4, 0, 0.8]], "arc_length": [0.5], "acceleration": (0, 0, 0),
            "group": 1, "planar": False,
        },
    ),
    "calibrate": (
        cs.calibrate,
        {
            "observations": SEEN, "cable": CABLE, "fit": ["length"], "priors": {"length": 0.1},
            "gravity": (0, 0, -9.81), "proceed": None,
        },
    ),
    "HarnessObservation": (
        cs.HarnessObservation,
        {
            "ends": HELD, "points": {"a": [[0.2, 0, 0.9]]}, "arc_length": {"a": [0.5]}, "lengths": {"b": 1.1},
            "acceleration": {"a": (0, 0, 0)}, "scene": cs.Scene(), "group": 1,
        },
    ),
    "calibrate, a harness": (
        cs.calibrate,
        {
            "observations": LOOKS, "cable": HARNESS, "fit": ["tilt:b.end"], "priors": {"tilt": 0.1},
            "gravity": (0, 0, -9.81), "proceed": None,
        },
    ),
    "calibrate_photo": (
        cs.calibrate_photo,
        {
            "clicks": CLICKS, "cable": CABLE, "fit": ["bending_stiffness"], "chord": 0.8, "click_error": 0.0,
            "priors": {"bending_stiffness": 1.0}, "gravity": (0, 0, -9.81),
        },
    ),
    "calibrate_sag": (
        cs.calibrate_sag,
        {
            "cable": CABLE, "sag": 0.4, "chord": 0.8, "held": "level", "sag_error": 1e-3, "place_error": 1e-3,
            "tilt_error": 1e-2,
        },
    ),
    "rest_curvature_from": (
        cs.rest_curvature_from,
        {"points": np.linspace((0, 0, 0), (1.2, 0, 0), 12), "cable": CABLE, "d1": (0, 0, 1)},
    ),
    "predict_tube": (
        cs.predict_tube,
        {
            "found": FOUND, "start": START, "end": END, "confidence": 0.9, "start_error": (0.0, 0.0), "points": 12,
            "end_error": (0.0, 0.0), "acceleration": None, "gravity": (0, 0, -9.81), "inertia": 0.2,
        },
    ),
    "Uncertainty": (
        cs.Uncertainty,
        {"cable": {"length": 0.1}, "start": (0.1, 0.1), "end": np.eye(6), "confidence": 0.9, "misses": 0.1},
    ),
    "Uncertainty.of": (cs.Uncertainty.of, {"found": FOUND, "start": (0.1, 0.1), "end": (0, 0), "confidence": 0.9}),
    "Uncertainty.from_mapping": (cs.Uncertainty.from_mapping, {"values": SPREAD.as_dict()}),
    "Uncertainty.from_mapping, values": (lambda **values: cs.Uncertainty.from_mapping(values), SPREAD.as_dict()),
    "Uncertainty.from_yaml": (cs.Uncertainty.from_yaml, {"path": "nowhere.yaml"}),
    "predict_tails": (
        cs.predict_tails,
        {"cable": CABLE, "start": START, "end": END, "tails": {"end": 0.1}, "gravity": (0, 0, -9.81), "points": 12},
    ),
    "stress_of": (cs.stress_of, {"cable": CABLE, "shape": SHAPE}),
}  # fmt: skip

#: What a call returns, errors, and what takes nothing.
NOT_CALLED = {
    "BodyDistance", "CableWarning", "CablesBatch", "CablesCalibration", "Calibration", "Clearance",
    "ClipLoad", "Contact", "CycleReport", "EditResult", "Estimate", "HarnessBatch", "HarnessCalibration",
    "HarnessShape", "Imported", "Margin", "PlugError", "Reason", "Severity", "ShapeBatch", "ShapedStop", "Status",
    "Stop", "Stress",
    "StudyResult", "Swept", "TrajectoryCheck", "Tube", "Violation", "WarningKind", "warm_up",
}  # fmt: skip

NUMBERS = (
    0, 1, -1, 2, 0.5, 1e-300, -1e-300, 1e300, 1e19, 1e-19, 1e6, 1e-6, 2**63, -(2**63), BIG, -BIG, math.nan, math.inf,
    -math.inf, True, 1j, Fraction(1, 3), np.float32(1), np.int8(1), np.array(1.0), np.array([1.0]),
)  # fmt: skip
ODD = (
    None, "", "a", "start", "cosserat", "1", "a\0b", "x" * 300, b"1", {}, {"a": 1}, {1: 2}, {"end": None}, (), [],
    [[]], [None], ["a"], [BIG], [math.nan] * 3, [[1], [1, 2]], {1, 2}, object(), _Odd(), iter(()), range(3), ...,
    np.zeros(0), np.zeros(3), np.zeros((2, 3)), np.full((2, 7), math.nan), np.zeros((1, 7)), np.zeros((2, 2, 2)),
    np.array(None), np.array(["a"]), np.array([1j]), np.ones(3, bool), np.full(3, 1e300), [1e300] * 7, [1e19] * 3,
    START, cs.Pose((1e19, 0, 0)), cs.Grip(START, "pinned"), cs.FreeEnd(1.0), CABLE, SHAPE, SCENE, HARNESS, WIRE,
    cs.Scene(contact="solve"), cs.Sphere(1.0), LINKED, FOUND, SPREAD, TWO, cs.Plug("a"), SEEN, [LINKED],
    [cs.Clip(0.1, START)], [START], {"cable": (START, END)}, {"cable": START}, {"cable": (END, START, END)},
    {"cable": (START, "b")}, {"cable": {"end": 1}}, {"cable": 3}, {"tool": 3}, {"cable": {}},
)  # fmt: skip
CABLES = {
    "length": (1.2, 1e6, 1e-6),
    "bending_stiffness": (0.01, 0.0, 1e20, 1e-20),
    "linear_density": (0.1, 0.0, 1e20, 1e-20),
    "axial_stiffness": (None, 1e20, 1e-20),
    "rest_curvature": ((0, 0, 0), (1e20, 0, 0)),
    "diameter": (0.01, 1e20, 1e-20),
}
TRIES = 60


def anything(chance: random.Random) -> object:
    """One of the above, or a cable of such numbers."""
    kind = chance.randrange(3)
    if kind < 2:
        return chance.choice((NUMBERS, ODD)[kind])
    return CABLE.replace(**{name: chance.choice(values) for name, values in CABLES.items()})


def test_every_public_call_is_listed() -> None:
    public = {name: getattr(cs, name) for name in cs.__all__}
    errors = {name for name, made in public.items() if isinstance(made, type) and issubclass(made, Exception)}
    assert {name.split(".")[0].split(",")[0] for name in CALLS} == set(public) - errors - NOT_CALLED


@pytest.mark.parametrize("name", CALLS)
def test_what_is_right_is_taken(name: str) -> None:
    make, right = CALLS[name]
    try:
        make(**right)
    except cs.CableShapeError as error:
        assert "nowhere" in str(error) or "message" in name, error  # noqa: PT017


@pytest.mark.parametrize("name", [name for name, (_, right) in CALLS.items() if right])
def test_whatever_is_given_only_documented_errors_come_out(name: str) -> None:
    make, right = CALLS[name]
    chance = random.Random(name)
    for _ in range(TRIES):
        changed = chance.sample(sorted(right), min(len(right), chance.randint(1, 2)))
        given = {key: anything(chance) for key in changed}
        try:
            make(**{**right, **given})
        except cs.CableShapeError as error:
            assert len(str(error)) < 2000  # noqa: PT017
        except Exception as error:
            error.add_note(f"{name} was given {given}")
            raise


#: What a slip looks like: each ended in a bare TypeError, AttributeError, ValueError, OverflowError or the like.
SLIPS: list[tuple[Callable[[], object], str]] = [
    (lambda: cs.Cable(length=BIG, linear_density=0.1, bending_stiffness=0.01), "length = .* at most 1e"),
    (lambda: cs.Cable(**GOOD, tails=np.zeros(2)), "tails .* must be a mapping"),  # type: ignore[arg-type]
    (lambda: CABLE.replace(length=1e-300), "length = 1e-300 .* at least"),
    (lambda: CABLE.replace(length=1e300), "length = 1e.300 .* at most 1e.06 m"),
    (lambda: cs.Pose((BIG, 0, 0)), "position = .* must be 3 numbers"),
    (lambda: cs.Sphere(BIG), r"Sphere.radius = .* at most 1e\+20 m"),
    (lambda: cs.Grip(START, offset=(0, 0, 0)), "offset = .* must be a Pose"),  # type: ignore[arg-type]
    (lambda: cs.predict(CABLE, START, END, scene={}), "scene = {} .* must be a Scene"),  # type: ignore[arg-type]
    (lambda: cs.Predictor(CABLE, robot_links=3), "robot_links = 3 .* must be a list"),  # type: ignore[arg-type]
    (lambda: cs.Predictor(CABLE, gripping_links="tool"), "gripping_links = 'tool' .* must be a list"),
    (lambda: cs.Cycle(3), "cables = 3 .* must be a Cable or a mapping"),  # type: ignore[arg-type]
    (lambda: cs.Cycle([CABLE]), "cables = .* must be a Cable or a mapping"),  # type: ignore[arg-type]
    (lambda: cs.Cycle({"a": 3}), r"cables\['a'\] = 3 .* must be a Cable"),  # type: ignore[dict-item]
    (lambda: cs.Cycle(CABLE, scene="scene.yaml"), "Scene.from_yaml"),  # type: ignore[arg-type]
    (lambda: cs.Cycle(CABLE, uncertainty=0.1), "uncertainty = 0.1 .* mapping"),  # type: ignore[arg-type]
    (lambda: cs.Cycle(CABLE, clips=0.5), "clips = 0.5 .* mapping"),  # type: ignore[arg-type]
    (lambda: stepped(grips=[(START, END)]), "grips = .* must be a mapping"),
    (lambda: stepped(grips={"cable": START}), r"grips\['cable'\] = .* must be \(start, end\)"),
    (lambda: stepped(grips={"cable": (None, END)}), r"grips\['cable'\]\[0\] = None .* must be a Pose or a Grip"),
    (lambda: stepped(grips={"cable": (START, END)}, stamp="0"), "stamp = '0' .* whole number"),
    (lambda: stepped(robot_links=[LINKED], links={"tool": 3}), r"links\['tool'\] = 3 .* must be a Pose"),
    (lambda: stepped(acceleration=(0, 0, 1)), r"acceleration = \(0, 0, 1\) .* must be a mapping"),
    (lambda: stepped(acceleration={"b": (0, 0, 1)}), "acceleration: unknown key 'b'"),
    (
        lambda: stepped(acceleration={"cable": (0, 1)}),
        r"acceleration\['cable'\]: .*shape \(2,\).*\(3,\), \(m, 3\) or \(m, 6\)",
    ),
    (lambda: stepped(distributed_load={"b": np.zeros((2, 3))}), "distributed_load: unknown key 'b'"),
    (lambda: stepped(distributed_load=(0, 0, 1)), "distributed_load = .* two rows"),
    (lambda: cs.check_trajectory(CABLE, None, None, TWO, acceleration=(0, 0, 1)), r"\(3,\).* must be \(2, 3\) or"),
    (
        lambda: cs.check_trajectory(CABLE, None, None, TWO, acceleration=np.zeros((3, 3))),
        "Give three numbers .* waypoint",
    ),
    (lambda: cs.check_trajectory(CABLE, None, None, TWO, acceleration=np.zeros((2, 1, 3))), r"\(m, 3\) with 2 to 200"),
    (
        lambda: cs.check_trajectory(CABLE, None, None, TWO, acceleration=[[0] * 3, [np.nan] * 3]),
        r"acceleration\[1\] .*fin",
    ),
    (lambda: cs.check_trajectory(CABLE, {}, None, TWO), "scene = {} .* must be a Scene"),  # type: ignore[arg-type]
    (lambda: cs.check_trajectory(CABLE, None, None, np.zeros((2, 14))), r"trajectory = .* GripPath\(starts, ends\)"),
    (lambda: cs.JointPath(3, [[0]]), "joint_names = 3 .* must be a list"),  # type: ignore[arg-type]
    (lambda: cs.calibrate(3, CABLE), "observations = 3 .* must be a list"),  # type: ignore[arg-type]
    (lambda: cs.calibrate(SEEN, 3), "cable = 3 .* must be a Cable"),  # type: ignore[arg-type]
    (lambda: cs.calibrate(SEEN, CABLE, fit=3), "fit = 3 .* must be a list"),  # type: ignore[arg-type]
    (lambda: cs.calibrate(SEEN, CABLE, priors=3), "priors = 3 .* must be a mapping"),  # type: ignore[arg-type]
    (lambda: cs.Uncertainty(3), "cable = 3 .* must be a mapping"),  # type: ignore[arg-type]
    (lambda: cs.Uncertainty.of(3), "found = 3 .* must be a Calibration"),  # type: ignore[arg-type]
    (lambda: FOUND["length"], r"estimates: unknown key 'length'\. .*bending_stiffness"),
    (lambda: cs.Cable.from_yaml(3), "file = 3 .* must be a path"),  # type: ignore[arg-type]
    (lambda: cs.Scene.from_yaml(None), "file = None .* must be a path"),  # type: ignore[arg-type]
    (lambda: cs.Mesh.from_file(3), "mesh file = 3 .* must be a path"),  # type: ignore[arg-type]
    (lambda: cs.Mesh([[1j, 0, 0]], [[0, 0, 0]]), "Mesh.vertices = .* must be numbers"),  # type: ignore[list-item]
    (lambda: cs.stress_of(CABLE, None), "shape = None .* must be a CableShape"),  # type: ignore[arg-type]
    (lambda: cs.predict_tails(3, START, END), "cable = 3 .* must be a Cable"),  # type: ignore[arg-type]
    (lambda: cs.Scene(obstacles=np.array(1.0)), "obstacles = .* must be a list"),  # type: ignore[arg-type]
]


@pytest.mark.parametrize("number", range(len(SLIPS)))
def test_a_slip_is_named_with_what_to_write(number: int) -> None:
    slip, told = SLIPS[number]
    with pytest.raises(cs.ArgumentError, match=told):
        slip()


def test_what_cannot_be_shown_is_named_by_its_kind_and_what_is_long_is_cut() -> None:
    with pytest.raises(cs.ArgumentError, match=r"kind = a _Odd is not allowed"):
        cs.Grip(START, kind=_Odd())  # type: ignore[arg-type]
    with pytest.raises(cs.ArgumentError) as caught:
        cs.Grip(START, kind="x" * 100_000)
    assert len(str(caught.value)) < 1000
    with pytest.raises(cs.ArgumentError, match="a int is not allowed"):
        cs.Sphere(10**6000)


def test_a_product_with_what_is_no_pose_is_not_known() -> None:
    with pytest.raises(TypeError, match="unsupported operand"):
        START * 3  # type: ignore[operator]
