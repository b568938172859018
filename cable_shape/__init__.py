"""cable_shape: the quasistatic shape of the cable held between two grippers, every control cycle.

The public contract is what this module exports. It imports no ROS, viewer, collision or robot library, and each name's
module only when the name is first used, so that a process pays for what it uses.
"""

import sys
from importlib import import_module
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import TYPE_CHECKING, Any

from cable_shape.warm_up import warm_up

if TYPE_CHECKING:
    from cable_shape.cable.cable import Cable
    from cable_shape.cable.cable_file import CableFile, Held
    from cable_shape.cable.centreline import Centreline
    from cable_shape.cable.harness import Harness
    from cable_shape.cable.imported import Imported
    from cable_shape.cable.junction import Junction
    from cable_shape.cable.section import Section
    from cable_shape.cable.wires import Wire
    from cable_shape.calibration.cables_result import CablesCalibration
    from cable_shape.calibration.fit import calibrate
    from cable_shape.calibration.harness_observation import HarnessObservation
    from cable_shape.calibration.harness_result import HarnessCalibration
    from cable_shape.calibration.memory import rest_curvature_from
    from cable_shape.calibration.observation import Observation
    from cable_shape.calibration.photo import calibrate_photo
    from cable_shape.calibration.result import Calibration, Estimate
    from cable_shape.calibration.sag import calibrate_sag
    from cable_shape.cycle.cycle import Cycle
    from cable_shape.errors import (
        ArgumentError,
        BagError,
        CableShapeError,
        DependencyError,
        FileError,
        InputError,
        RobotError,
        StaleInputError,
        SteeringError,
        UnknownKeyError,
    )
    from cable_shape.motion.motion import Motion
    from cable_shape.planning.batch import predict_batch
    from cable_shape.planning.cables_batch import CablesBatch
    from cable_shape.planning.export import export
    from cable_shape.planning.harness_batch import HarnessBatch
    from cable_shape.planning.paths import EndsPath, GripPath, JointPath
    from cable_shape.planning.shape_batch import ShapeBatch
    from cable_shape.planning.shape_stop import ShapedStop, shape_stop
    from cable_shape.planning.study import Study
    from cable_shape.planning.study_result import StudyResult
    from cable_shape.planning.swept import Swept, swept
    from cable_shape.planning.trajectory import check_trajectory
    from cable_shape.planning.trajectory_report import Reason, Stop, TrajectoryCheck, Violation
    from cable_shape.pose import FreeEnd, Grip, Pose
    from cable_shape.prediction.edits import (
        Add,
        EditResult,
        Insert,
        Move,
        Open,
        Regrip,
        Release,
        Remove,
        SetCable,
    )
    from cable_shape.prediction.predictor import Predictor, predict
    from cable_shape.prediction.tails import predict_tails
    from cable_shape.robots.servo import Servo
    from cable_shape.robots.servo_targets import (
        CentrelineTarget,
        KeepClear,
        MouthTarget,
        PointsTarget,
        TangentTarget,
        TwistTarget,
    )
    from cable_shape.safety.report import (
        BodyDistance,
        CableWarning,
        Clearance,
        CycleReport,
        Margin,
        Severity,
        WarningKind,
    )
    from cable_shape.safety.stress import Stress, stress_of
    from cable_shape.scene.plug import Plug, PlugError
    from cable_shape.scene.scene import (
        Allow,
        Box,
        Capsule,
        Clip,
        Cylinder,
        HalfSpace,
        HeightField,
        Mesh,
        Obstacle,
        PointMass,
        Points,
        Scene,
        Sphere,
    )
    from cable_shape.shape import CableShape, ClipLoad, Contact, Status
    from cable_shape.solve.harness_shape import HarnessShape
    from cable_shape.tracking.tracker import Tracker
    from cable_shape.uncertainty.calibrated_tube import predict_tube
    from cable_shape.uncertainty.motion_tube import MotionTube
    from cable_shape.uncertainty.uncertainty import Tube, Uncertainty

__version__ = "0.1.0"

__all__ = [
    "Add",
    "Allow",
    "ArgumentError",
    "BagError",
    "BodyDistance",
    "Box",
    "Cable",
    "CableFile",
    "CableShape",
    "CableShapeError",
    "CableWarning",
    "CablesBatch",
    "CablesCalibration",
    "Calibration",
    "Capsule",
    "Centreline",
    "CentrelineTarget",
    "Clearance",
    "Clip",
    "ClipLoad",
    "Contact",
    "Cycle",
    "CycleReport",
    "Cylinder",
    "DependencyError",
    "EditResult",
    "EndsPath",
    "Estimate",
    "FileError",
    "FreeEnd",
    "Grip",
    "GripPath",
    "HalfSpace",
    "Harness",
    "HarnessBatch",
    "HarnessCalibration",
    "HarnessObservation",
    "HarnessShape",
    "HeightField",
    "Held",
    "Imported",
    "InputError",
    "Insert",
    "JointPath",
    "Junction",
    "KeepClear",
    "Margin",
    "Mesh",
    "Motion",
    "MotionTube",
    "MouthTarget",
    "Move",
    "Observation",
    "Obstacle",
    "Open",
    "Plug",
    "PlugError",
    "PointMass",
    "Points",
    "PointsTarget",
    "Pose",
    "Predictor",
    "Reason",
    "Regrip",
    "Release",
    "Remove",
    "RobotError",
    "Scene",
    "Section",
    "Servo",
    "SetCable",
    "Severity",
    "ShapeBatch",
    "ShapedStop",
    "Sphere",
    "StaleInputError",
    "Status",
    "SteeringError",
    "Stop",
    "Stress",
    "Study",
    "StudyResult",
    "Swept",
    "TangentTarget",
    "Tracker",
    "TrajectoryCheck",
    "Tube",
    "TwistTarget",
    "Uncertainty",
    "UnknownKeyError",
    "Violation",
    "WarningKind",
    "Wire",
    "calibrate",
    "calibrate_photo",
    "calibrate_sag",
    "check_trajectory",
    "export",
    "predict",
    "predict_batch",
    "predict_tails",
    "predict_tube",
    "rest_curvature_from",
    "shape_stop",
    "stress_of",
    "swept",
    "warm_up",
]

#: Module -> what is exported from it.
_HOMES = {
    "planning.batch": ("predict_batch",),
    "cable.cable": ("Cable",),
    "cable.cable_file": ("CableFile", "Held"),
    "calibration.cables_result": ("CablesCalibration",),
    "calibration.fit": ("calibrate",),
    "calibration.harness_observation": ("HarnessObservation",),
    "calibration.harness_result": ("HarnessCalibration",),
    "calibration.memory": ("rest_curvature_from",),
    "calibration.observation": ("Observation",),
    "calibration.photo": ("calibrate_photo",),
    "calibration.result": ("Calibration", "Estimate"),
    "calibration.sag": ("calibrate_sag",),
    "uncertainty.calibrated_tube": ("predict_tube",),
    "uncertainty.motion_tube": ("MotionTube",),
    "cycle.cycle": ("Cycle",),
    "errors": (
        "ArgumentError",
        "BagError",
        "CableShapeError",
        "DependencyError",
        "FileError",
        "InputError",
        "RobotError",
        "StaleInputError",
        "SteeringError",
        "UnknownKeyError",
    ),
    "cable.centreline": ("Centreline",),
    "cable.harness": ("Harness",),
    "cable.junction": ("Junction",),
    "cable.imported": ("Imported",),
    "motion.motion": ("Motion",),
    "planning.cables_batch": ("CablesBatch",),
    "planning.harness_batch": ("HarnessBatch",),
    "solve.harness_shape": ("HarnessShape",),
    "planning.paths": ("EndsPath", "GripPath", "JointPath"),
    "scene.plug": ("Plug", "PlugError"),
    "pose": ("FreeEnd", "Grip", "Pose"),
    "prediction.edits": (
        "Add",
        "EditResult",
        "Insert",
        "Move",
        "Open",
        "Regrip",
        "Release",
        "Remove",
        "SetCable",
    ),
    "prediction.predictor": ("Predictor", "predict"),
    "safety.report": ("BodyDistance", "CableWarning", "Clearance", "CycleReport", "Margin", "Severity", "WarningKind"),
    "scene.scene": (
        "Allow",
        "Box",
        "Capsule",
        "Clip",
        "Cylinder",
        "HalfSpace",
        "HeightField",
        "Mesh",
        "Obstacle",
        "PointMass",
        "Points",
        "Scene",
        "Sphere",
    ),
    "cable.section": ("Section",),
    "robots.servo": ("Servo",),
    "robots.servo_targets": (
        "CentrelineTarget",
        "KeepClear",
        "MouthTarget",
        "PointsTarget",
        "TangentTarget",
        "TwistTarget",
    ),
    "shape": ("CableShape", "ClipLoad", "Contact", "Status"),
    "planning.shape_batch": ("ShapeBatch",),
    "safety.stress": ("Stress", "stress_of"),
    "prediction.tails": ("predict_tails",),
    "planning.export": ("export",),
    "planning.study": ("Study",),
    "planning.study_result": ("StudyResult",),
    "planning.swept": ("Swept", "swept"),
    "planning.shape_stop": ("ShapedStop", "shape_stop"),
    "planning.trajectory": ("check_trajectory",),
    "planning.trajectory_report": ("Reason", "Stop", "TrajectoryCheck", "Violation"),
    "tracking.tracker": ("Tracker",),
    "uncertainty.uncertainty": ("Tube", "Uncertainty"),
    "cable.wires": ("Wire",),
}
_MODULES = {name: module for module, names in _HOMES.items() for name in names}


def __getattr__(name: str) -> Any:
    """Loads an export when it is first asked for; from then on it is a name of this module like any other."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


#: Modules that programs imported before the package had rooms.
_BEFORE = {
    "cable_shape.cli": "cable_shape.command.cli",  # commands that were installed before
    "cable_shape.fields": "cable_shape.messages.fields",
    "cable_shape.ik": "cable_shape.robots.ik",
    "cable_shape.mujoco_model": "cable_shape.robots.mujoco_model",
    "cable_shape.robot": "cable_shape.robots.robot",
    "cable_shape.steering": "cable_shape.robots.steering",
}


class _Before:
    """Finds them under the name that they had; the module is the same one."""

    def find_spec(self, name: str, path: object = None, target: object = None) -> ModuleSpec | None:
        return ModuleSpec(name, self) if name in _BEFORE else None  # type: ignore[arg-type]

    def create_module(self, spec: ModuleSpec) -> None:
        """The usual one, which the next puts aside."""

    def exec_module(self, module: ModuleType) -> None:
        sys.modules[module.__name__] = import_module(_BEFORE[module.__name__])


sys.meta_path.insert(0, _Before())
