"""Where rclpy writes its log files: a home that cannot be written must not keep the node from starting."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path


def find_log_folder() -> None:
    """Sets ROS_LOG_DIR to a folder for temporary files if rclpy's own choice cannot be written."""
    if os.environ.get("ROS_LOG_DIR"):
        return
    chosen = Path(os.environ.get("ROS_HOME") or Path("~/.ros").expanduser()) / "log"
    try:
        chosen.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=chosen):
            return
    except OSError:
        os.environ["ROS_LOG_DIR"] = tempfile.mkdtemp(prefix="cable_shape_log_")
