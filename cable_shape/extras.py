"""Which extra of the package brings a library that not everybody needs: `pip install 'cable_shape[replay]'`."""

from __future__ import annotations

from cable_shape.errors import DependencyError

#: module -> extra, as in pyproject.toml
EXTRAS = {
    "rosbags": "replay",
    "apsw": "replay",  # comes with rosbags
    "matplotlib": "replay",
    "PIL": "replay",  # comes with matplotlib
    "rerun": "viewer",
    "pinocchio": "robots",
    "mink": "robots",
    "mujoco": "robots",
}

#: What a ROS brings, and how to get it.
ROS = (
    "Source a ROS 2 Jazzy (its Python must see this package: python3 -m venv --system-site-packages), or run "
    "scripts/test once in a clone of the repository, which installs ROS from PyPI and builds the messages."
)


def how_to_get(module: str) -> str:
    """The command that installs what `module` is a part of; empty if no extra brings it."""
    extra = EXTRAS.get(module.partition(".")[0])
    return f"pip install 'cable_shape[{extra}]'" if extra else ""


def lacking(error: ModuleNotFoundError) -> DependencyError | None:
    """What to say instead of `error` if an extra or a ROS would bring the module; None if neither does."""
    name = (error.name or "").partition(".")[0]
    remedy = how_to_get(name)
    if remedy:
        return DependencyError(f"{name} is not installed. Run: {remedy}")
    if name == "rclpy" or name.endswith(("_msgs", "_interfaces")):
        return DependencyError(f"{name} is not installed, which the node and what hears it need. {ROS}")
    return None
