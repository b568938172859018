"""What the node starts beside itself, if it is asked to: planner and calibrator; :func:`start_workers`."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass, field, fields
from functools import partial
from pathlib import Path
from typing import Any, final
from xml.etree import ElementTree

from rclpy.node import Node

from cable_shape.cable.cable_file import CableFile
from cable_shape.errors import ArgumentError, FileError
from cable_shape.files.files import find_file, read_text
from cable_shape.ros.assembly import Assembly
from cable_shape.ros.messages import CalibrateCable, CheckTrajectory, PredictShapes
from cable_shape.ros.parameters import Settings
from cable_shape.ros.stand_in import StandIn
from cable_shape.ros.worker import WorkerProcess
from cable_shape.scene.scene import Scene

SERVICE, ACTION = "cable/predict_shapes", "cable/check_trajectory"
CALIBRATE, CALIBRATION = "cable/calibrate", "cable/calibration"


#: Unless told otherwise, the C library keeps the memory of a large answer for the next one, up to 256 MB: fresh pages
#: from the system take as long as copying the answer into them.
KEEP_MEMORY = {"MALLOC_MMAP_THRESHOLD_": "33554432", "MALLOC_TRIM_THRESHOLD_": "268435456"}
#: Where Fast DDS looks for profiles; other middlewares do not.
PROFILES = "FASTRTPS_DEFAULT_PROFILES_FILE"
PROFILES_BYTES = 1_000_000


@final
@dataclass(frozen=True, slots=True)
class PlannerSetup:
    """What the planner's process needs to know; names are absolute, after the node's own remapping."""

    name: str
    namespace: str
    service: str
    action: str
    cables: dict[str, dict[str, Any]]  # keys of CableFile
    scene: Scene
    robot: str  # path of the robot's YAML file; empty: none
    model: str
    gravity: tuple[float, float, float]  # m/s^2
    points: int
    tolerance: float  # m, 0: the default of each call
    rows: int  # grasps or waypoints in one request, at most
    threads: int
    time_limit: float  # s
    make_way: bool  # run only where no other thread wants the core
    harnesses: dict[str, dict[str, Any]] = field(default_factory=dict)  # keys of HarnessFile; every end named is held

    def to_json(self) -> str:
        """As text, for `from_json`."""
        return _json(self)

    @classmethod
    def from_json(cls, text: str) -> PlannerSetup:
        """What `to_json` wrote."""
        values = json.loads(text)
        x, y, z = values["gravity"]
        return cls(**{**values, "scene": Scene.from_mapping(values["scene"]), "gravity": (x, y, z)})


@final
@dataclass(frozen=True, slots=True)
class CalibratorSetup:
    """What the calibrator's process needs to know; names are absolute, after the node's own remapping."""

    name: str
    namespace: str
    action: str
    result: str  # topic
    cables: dict[str, dict[str, Any]]  # keys of CableFile
    scene: Scene
    topics: dict[str, tuple[str, ...]]  # of each: those of its grips, and points; empty: none is listened to
    gravity: tuple[float, float, float]  # m/s^2
    fit: tuple[str, ...]
    kinds: tuple[str | None, str | None]  # None: as the cable's file says
    offsets: tuple[tuple[float, ...], tuple[float, ...]]  # x y z [m], quaternion
    max_skew: float  # s
    window: int
    period: float  # s
    file: str
    time_limit: float  # s
    make_way: bool  # run only where no other thread wants the core
    harnesses: dict[str, dict[str, Any]] = field(default_factory=dict)  # keys of HarnessFile, with the ends as held

    def to_json(self) -> str:
        """As text, for `from_json`."""
        return _json(self)

    @classmethod
    def from_json(cls, text: str) -> CalibratorSetup:
        """What `to_json` wrote."""
        values = json.loads(text)
        values["scene"] = Scene.from_mapping(values["scene"])
        for name in ("gravity", "fit", "kinds"):
            values[name] = tuple(values[name])
        values["offsets"] = tuple(tuple(row) for row in values["offsets"])
        values["topics"] = {name: tuple(topics) for name, topics in values["topics"].items()}
        return cls(**values)


def _json(setup: PlannerSetup | CalibratorSetup) -> str:
    return json.dumps({**{f.name: getattr(setup, f.name) for f in fields(setup)}, "scene": setup.scene.as_dict()})


def clients(node: Node, setup: PlannerSetup | CalibratorSetup) -> int:
    """How many clients of a worker's services and actions a node knows, the three of an action each for itself."""
    names = [f"{setup.action}/_action/{part}" for part in ("send_goal", "get_result", "cancel_goal") if setup.action]
    if isinstance(setup, PlannerSetup):
        names.append(setup.service)
    return sum(node.count_clients(name) for name in names)


def start_workers(node: Node, settings: Settings, assembly: Assembly) -> None:
    """Starts what the settings ask for."""
    if settings.planner:
        planner = planner_setup(node, settings, assembly)
        remedy = "ask for fewer rows or points in one request."
        environment = {name: os.environ.get(name, value) for name, value in KEEP_MEMORY.items()}
        if settings.planner_profiles:
            environment[PROFILES] = str(_profiles(settings.planner_profiles))
        worker = WorkerProcess(
            "planner",
            "cable_shape.ros.planning",
            planner.to_json(),
            remedy,
            partial(clients, node, planner),
            environment,
            _enclave(node, "planner"),
        )
        assembly.workers["planner"] = worker
        services, actions = ((PredictShapes, planner.service),), ((CheckTrajectory, planner.action),)
        assembly.stand_ins.append(StandIn(node, worker, services, actions))
    if settings.calibration or settings.calibration_points:
        calibrator = calibrator_setup(node, settings, assembly)
        remedy = "calibrate with fewer points."
        worker = WorkerProcess(
            "calibrator",
            "cable_shape.ros.calibrating",
            calibrator.to_json(),
            remedy,
            partial(clients, node, calibrator),
            arguments=_enclave(node, "calibrator"),
        )
        assembly.workers["calibrator"] = worker
        if calibrator.action:
            assembly.stand_ins.append(StandIn(node, worker, (), ((CalibrateCable, calibrator.action),)))


def _enclave(node: Node, worker: str) -> list[str]:
    """Arguments that put a worker of a node in an enclave of SROS 2 into an enclave of its own, named after that."""
    own = (node.get_name(), node.get_namespace())
    nodes = node.get_node_names_and_namespaces_with_enclaves()
    enclave = next((enclave for name, space, enclave in nodes if (name, space) == own), "/")
    return [] if enclave == "/" else ["--ros-args", "--enclave", f"{enclave}_{worker}"]


def _profiles(path: str) -> Path:
    """The file of `planner_profiles`.

    Raises
    ------
    ArgumentError
        If it is not XML, or makes the middleware write files of its own.
    """
    file = find_file(path)
    try:
        text = read_text(file, PROFILES_BYTES)
    except FileError as error:
        raise ArgumentError(f"planner_profiles: {error}") from None
    remedy = "Name one such as fastdds_planner.xml, or none."
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise ArgumentError.of("planner_profiles", path, "it has a DOCTYPE, which no profiles have", remedy)
    try:
        tree = ElementTree.fromstring(text.encode())  # noqa: S314, without entities nothing grows
    except ElementTree.ParseError as error:
        line, _ = error.position
        raise ArgumentError.of("planner_profiles", path, f"it is not XML from line {line} on", remedy) from None
    if any(element.tag.rpartition("}")[2] == "log" for element in tree.iter()):
        bound = "its <log> would write files, and files are written only below output_folder"
        raise ArgumentError.of("planner_profiles", path, bound, remedy)
    return file.resolve()


def planner_setup(node: Node, settings: Settings, assembly: Assembly) -> PlannerSetup:
    """For what the node's cycles run with."""
    cycle = assembly.cycle
    cores = len(os.sched_getaffinity(0))
    return PlannerSetup(
        name=f"{node.get_name()}_planner",
        namespace=node.get_namespace(),
        service=node.resolve_service_name(SERVICE),
        action=node.resolve_topic_name(ACTION),
        cables={name: CableFile(cable, *assembly.held[name]).as_dict() for name, cable in cycle.cables.items()},
        scene=cycle.scene,
        robot=str(find_file(settings.robot_file).resolve()) if settings.robot_file else "",
        model=settings.model,
        gravity=settings.gravity,
        points=settings.points,
        tolerance=settings.tolerance,
        rows=settings.planner_rows,
        threads=settings.planner_threads or max(1, cores - 1),
        time_limit=settings.planner_time_limit,
        make_way=settings.workers_make_way,
        harnesses={name: file.as_dict() for name, file in assembly.harnesses.items()},
    )


def calibrator_setup(node: Node, settings: Settings, assembly: Assembly) -> CalibratorSetup:
    """For what the node's cycles run with."""
    cycle, topics = assembly.cycle, {}
    if settings.calibration_points:
        for one in assembly.holdings:
            points = (one.prefix if one.harness is None else f"{one.cable_id}/") + settings.calibration_points
            topics[one.cable_id] = tuple(node.resolve_topic_name(topic) for topic in (*one.topics, points))
    return CalibratorSetup(
        name=f"{node.get_name()}_calibrator",
        namespace=node.get_namespace(),
        action=node.resolve_topic_name(CALIBRATE) if settings.calibration else "",
        result=node.resolve_topic_name(CALIBRATION),
        cables={name: CableFile(cable, *assembly.held[name]).as_dict() for name, cable in cycle.cables.items()},
        scene=cycle.scene,
        topics=topics,
        gravity=settings.gravity,
        fit=settings.fitted,
        kinds=settings.kinds,
        offsets=(settings.left_gripper_offset, settings.right_gripper_offset),
        max_skew=settings.max_skew,
        window=settings.calibration_window,
        period=settings.calibration_period,
        file=str(settings.output("calibration_file") or ""),
        time_limit=settings.planner_time_limit,
        make_way=settings.workers_make_way,
        harnesses={name: file.as_dict() for name, file in assembly.harnesses.items()},
    )
