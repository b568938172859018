"""cable_shape: the quasistatic shape of the cable held between two grippers, every control cycle.

The public contract is what this module exports. It imports no ROS, viewer, collision or robot library.
"""

from cable_shape.batch import predict_batch
from cable_shape.cable import Cable
from cable_shape.calibration.fit import calibrate
from cable_shape.calibration.observation import Observation
from cable_shape.calibration.result import Calibration, Estimate
from cable_shape.calibration.sag import calibrate_sag
from cable_shape.calibration.tube import Tube, predict_tube
from cable_shape.cycle import Cycle
from cable_shape.errors import (
    ArgumentError,
    BagError,
    CableShapeError,
    DependencyError,
    InputError,
    RobotError,
    StaleInputError,
    SteeringError,
    UnknownKeyError,
)
from cable_shape.paths import GripPath, JointPath
from cable_shape.plug import Plug, PlugError
from cable_shape.pose import FreeEnd, Grip, Pose
from cable_shape.predictor import Predictor, predict
from cable_shape.report import BodyDistance, CableWarning, Clearance, CycleReport, Margin, Severity, WarningKind
from cable_shape.scene import (
    Box,
    Capsule,
    Clip,
    Cylinder,
    HalfSpace,
    Mesh,
    Obstacle,
    PointMass,
    Scene,
    Sphere,
)
from cable_shape.shape import CableShape, ClipLoad, Contact, Status
from cable_shape.shape_batch import ShapeBatch
from cable_shape.stress import Stress, stress_of
from cable_shape.tails import predict_tails
from cable_shape.trajectory import check_trajectory
from cable_shape.trajectory_report import Reason, TrajectoryCheck, Violation
from cable_shape.warm_up import warm_up

__version__ = "0.1.0"

__all__ = [
    "ArgumentError",
    "BagError",
    "BodyDistance",
    "Box",
    "Cable",
    "CableShape",
    "CableShapeError",
    "CableWarning",
    "Calibration",
    "Capsule",
    "Clearance",
    "Clip",
    "ClipLoad",
    "Contact",
    "Cycle",
    "CycleReport",
    "Cylinder",
    "DependencyError",
    "Estimate",
    "FreeEnd",
    "Grip",
    "GripPath",
    "HalfSpace",
    "InputError",
    "JointPath",
    "Margin",
    "Mesh",
    "Observation",
    "Obstacle",
    "Plug",
    "PlugError",
    "PointMass",
    "Pose",
    "Predictor",
    "Reason",
    "RobotError",
    "Scene",
    "Severity",
    "ShapeBatch",
    "Sphere",
    "StaleInputError",
    "Status",
    "SteeringError",
    "Stress",
    "TrajectoryCheck",
    "Tube",
    "UnknownKeyError",
    "Violation",
    "WarningKind",
    "calibrate",
    "calibrate_sag",
    "check_trajectory",
    "predict",
    "predict_batch",
    "predict_tails",
    "predict_tube",
    "stress_of",
    "warm_up",
]
