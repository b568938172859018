"""`cable-shape doctor`: whether everything that cable_shape needs is there and is the right one."""

from __future__ import annotations

import importlib.util
import os
import sys
from collections.abc import Callable
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import final

from cable_shape.errors import ROS, CableShapeError, how_to_get

#: distribution on PyPI -> module
LIBRARIES = {
    "numpy": "numpy",
    "scipy": "scipy",
    "numba": "numba",
    "pin": "pinocchio",
    "mink": "mink",
    "mujoco": "mujoco",
    "rerun-sdk": "rerun",
    "rosbags": "rosbags",
    "matplotlib": "matplotlib",
    "PyYAML": "yaml",
    "tqdm": "tqdm",
}


#: how folders begin that a process makes for itself when no other may hold its kernels
PASSING = "cable_shape_kernels_"


@final
@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that was looked at; `remedy` is empty if it is well."""

    subject: str
    found: str
    remedy: str = ""


def examine() -> list[Finding]:
    """Looks at everything, in the order in which it is worth repairing."""
    checks: list[Callable[[], list[Finding]]] = [_python, _venv, _environment, _libraries, _ros, _cache, _kernels]
    return [finding for check in checks for finding in check()]


def _python() -> list[Finding]:
    version = ".".join(map(str, sys.version_info[:3]))
    fine = (3, 11) <= sys.version_info[:2] <= (3, 13)
    return [Finding("Python", f"{version}, {sys.executable}", "" if fine else "Use Python 3.11 to 3.13.")]


def _in_sources() -> bool:
    """Whether this is a clone of the repository, whose set-up brings everything, and not an installed wheel."""
    return (Path(__file__).resolve().parents[2] / "scripts" / "_setup").is_file()


def _venv() -> list[Finding]:
    """Sources that have a .venv of their own are meant to run in it."""
    own = Path(__file__).resolve().parents[2] / ".venv"
    if own.is_dir() and own.resolve() != Path(sys.prefix).resolve():
        return [Finding("environment", f"{sys.prefix}, not {own}", f"Run: source {own}/bin/activate")]
    return [Finding("environment", sys.prefix)]


def _environment() -> list[Finding]:
    """Paths of a sourced ROS may put other builds of the same libraries in front; by themselves they are no fault."""
    findings = []
    for name in ("PYTHONPATH", "LD_LIBRARY_PATH"):
        parts = os.environ.get(name, "").split(os.pathsep)
        foreign = [part for part in parts if part and not Path(part).is_relative_to(sys.prefix)]
        findings.append(Finding(name, os.pathsep.join(foreign) or "nothing foreign"))
    return findings


def _libraries() -> list[Finding]:
    return [_library(distribution, module) for distribution, module in LIBRARIES.items()]


def _library(distribution: str, module: str) -> Finding:
    """Whether it can be imported, and from this environment."""
    get = how_to_get(module)
    install = "scripts/test once" if _in_sources() else get or f"pip install {distribution}"
    try:
        version = metadata.version(distribution)
    except metadata.PackageNotFoundError:
        if get and not _in_sources():
            return Finding(distribution, f"not installed; what needs it: {get}")
        return Finding(distribution, "not installed", f"Run {install}.")
    try:
        found = importlib.import_module(module)
    except (ImportError, OSError) as error:
        return Finding(distribution, f"{version}, but import {module} fails: {error}", f"Reinstall it: {install}.")
    places = [getattr(found, "__file__", None), *getattr(found, "__path__", ())]  # a namespace package has no file
    file = Path(next(place for place in places if place))
    packaged = metadata.distribution(distribution).locate_file("")
    if not file.is_relative_to(Path(str(packaged))):
        remedy = (
            f"{module} of another installation hides the one in {packaged}: "
            "unset PYTHONPATH and LD_LIBRARY_PATH, or start from a shell in which no ROS is sourced."
        )
        return Finding(distribution, f"{version} is installed, but {file} is imported", remedy)
    loaded = str(getattr(found, "__version__", version))
    if module == "pinocchio" and not hasattr(found, "buildModelFromXML"):
        return Finding(distribution, f"{file} is not the robotics library", "pip uninstall pinocchio; pip install pin")
    if module == "numpy" and int(loaded.split(".")[0]) < 2:
        return Finding(distribution, f"{loaded}, {file}", f"numpy 2 is needed: {install}.")
    return Finding(distribution, f"{loaded}, {file}")


def _ros() -> list[Finding]:
    if not _in_sources() and importlib.util.find_spec("rclpy") is None:
        return [Finding("rclpy", "not installed; the node needs a ROS 2 Jazzy, nothing else does")]
    findings = []
    for module in ("rclpy", "cable_shape_msgs.msg"):
        try:
            found = importlib.import_module(module)
        except (ImportError, OSError) as error:
            findings.append(Finding(module, f"cannot be imported: {error}", f"{ROS} Only the node needs it."))
        else:
            findings.append(Finding(module, str(found.__file__)))
    try:
        from cable_shape.replay.bag_writer import message_folder

        findings.append(Finding("message definitions", str(message_folder())))
    except (CableShapeError, ImportError) as error:
        findings.append(Finding("message definitions", str(error), "See above."))
    return findings


def _cache() -> list[Finding]:
    """Where compiled kernels are kept."""
    from cable_shape.kernels._jit import HERE, cache_folder

    folders = sorted({Path(cache_folder(file)) for file in HERE.rglob("[!_]*.py")})
    passing = [folder for folder in folders if folder.name.startswith(PASSING)]
    if passing:
        remedy = "Set NUMBA_CACHE_DIR to a folder that you can write into, and nobody else."
        return [Finding("kernel cache", f"{passing[0]} is forgotten when the process ends", remedy)]
    kept = sum(1 for folder in folders for _ in folder.rglob("*.nbc"))
    closed = "" if all(os.access(folder, os.W_OK) for folder in folders) else ", read-only"
    found = f"{folders[0].parent}, {kept} compiled kernels{closed}"
    return [Finding("kernel cache", found if kept else f"{found}: the first start takes some minutes to compile")]


def _kernels() -> list[Finding]:
    """A prediction with a known property: the forces on the two grips carry the cable's weight."""
    from cable_shape.cable.cable import Cable
    from cable_shape.pose import Pose
    from cable_shape.prediction.predictor import predict

    remedy = "Remove the kernel cache and try again."
    along_x = (0.5, 0.5, 0.5, 0.5)
    cable = Cable(length=1.0, linear_density=0.1, bending_stiffness=0.01)
    gravity = (0.0, 0.0, -9.81)
    try:
        shape = predict(cable, Pose((0.0, 0.0, 0.0), along_x), Pose((0.8, 0.0, 0.0), along_x), gravity=gravity)
    except CableShapeError as error:
        return [Finding("kernels", str(error), remedy)]
    weight = cable.length * cable.linear_density * gravity[2]
    off = abs(float(shape.force[0, 2] - shape.force[-1, 2]) - weight) / abs(weight)
    if not shape.status or not off < 1e-6:
        return [Finding("kernels", f"a hanging cable came out as {shape!r}, its weight off by {off:.1g}", remedy)]
    return [Finding("kernels", f"a hanging cable carries its weight to {off:.1g}")]
