"""The message classes of cable_shape_msgs, or a text that says how to get them."""

from cable_shape.errors import DependencyError

try:
    from cable_shape_msgs.action import CalibrateCable, CheckTrajectory
    from cable_shape_msgs.msg import (
        CableCalibration,
        CableEdit,
        CableEdits,
        CableMargin,
        CableMargins,
        CableScene,
        CableShape,
        CableTube,
        CableViolation,
        CableWarning,
        CableWarnings,
    )
    from cable_shape_msgs.srv import EditCable, PredictShapes
except ImportError as error:
    raise DependencyError(
        f"The messages cable_shape_msgs cannot be imported ({error}). Run scripts/test once, which builds them into "
        ".venv, or build msg_defs with colcon and source the workspace."
    ) from error

__all__ = [
    "CableCalibration",
    "CableEdit",
    "CableEdits",
    "CableMargin",
    "CableMargins",
    "CableScene",
    "CableShape",
    "CableTube",
    "CableViolation",
    "CableWarning",
    "CableWarnings",
    "CalibrateCable",
    "CheckTrajectory",
    "EditCable",
    "PredictShapes",
]
