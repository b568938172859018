"""Reading a robot description: Pinocchio itself, the URDF's text and its meshes, and the collision geometry.

What leaves this file is self-contained: the URDF without visual geometry and with absolute mesh paths.
"""

from __future__ import annotations

import contextlib
import importlib
import importlib.util
import math
import os
import re
import sys
import tempfile
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator, Mapping
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from types import ModuleType
from typing import Any
from xml.parsers import expat

import numpy as np

from cable_shape.errors import DependencyError, RobotError
from cable_shape.files.files import TEXT_BYTES, path_of, read_text, regular
from cable_shape.pose import Pose
from cable_shape.scene.mesh_files import MAX_BYTES as MESH_BYTES
from cable_shape.scene.scene import Box, Capsule, Cylinder, Mesh, Obstacle, Solid, Sphere

#: elements within each other
MAX_DEPTH = 64
_PIECE = 1 << 16
#: where in its own sources the parser noticed it
_AT_LINE = re.compile(r" at line \d+ in \S+")


def load_pinocchio() -> ModuleType:
    """The Pinocchio of the wheel `pin`, checked before it is imported: another build of it may crash the process.

    Raises
    ------
    DependencyError
        If there is none, or if another one (from a sourced ROS through PYTHONPATH, or PyPI's unrelated `pinocchio`)
        would be imported in its place; names both files.
    """
    if "pinocchio" in sys.modules:
        found: str | None = getattr(sys.modules["pinocchio"], "__file__", None)
    else:
        spec = importlib.util.find_spec("pinocchio")
        found = spec.origin if spec else None
    try:
        wheel = distribution("pin")
        listed = [f for f in wheel.files or () if f.as_posix().endswith("/pinocchio/__init__.py")]
        expected = str(wheel.locate_file(listed[0])) if listed else None
    except PackageNotFoundError:
        expected = None
    if found is None:
        raise DependencyError(
            "Pinocchio is not installed. `pip install pin` brings it (`pinocchio` is another project)."
        )
    if expected is not None and os.path.realpath(found) != os.path.realpath(expected):
        raise DependencyError(
            f"The wrong Pinocchio would be imported: {found} hides {expected}. "
            "Unset PYTHONPATH and LD_LIBRARY_PATH (a sourced ROS sets them), and uninstall PyPI's `pinocchio`."
        )
    module = importlib.import_module("pinocchio")
    if not hasattr(module, "buildModelFromXML"):
        raise DependencyError(
            f"{found} is not the rigid-body library. `pip uninstall pinocchio`, then `pip install pin`."
        )
    return module


def read_urdf(source: str | Path) -> str:
    """The self-contained text of a URDF: visual geometry dropped, paths of collision meshes absolute.

    `source` is a path, or the XML itself (a string that begins with "<"); relative mesh paths are then taken from the
    working directory.

    Raises
    ------
    RobotError
        If it is not well-formed XML, not a URDF, still a xacro, or names a mesh that is not found.
    """
    if isinstance(source, str) and source.lstrip().startswith("<"):
        text, where, folder = source, "URDF", Path.cwd()
    else:
        text, where = read_text(source, what="URDF"), str(source)
        folder = path_of(source).resolve().parent
    root = _parsed(text.strip(), where)
    if any("www.ros.org/wiki/xacro" in element.tag for element in root.iter()):
        raise RobotError(f"{where}: this is a xacro, not a URDF. Expand it first: xacro FILE.xacro > FILE.urdf")
    if root.tag != "robot":
        raise RobotError(f"{where}: the top element is <{root.tag}>, it must be <robot>. Is it a URDF?")
    for link in root.iter("link"):
        for visual in link.findall("visual"):
            link.remove(visual)
        for mesh in link.iter("mesh"):
            found = _find_mesh(mesh.get("filename", ""), folder, f"{where}: link {link.get('name')!r}")
            mesh.set("filename", str(found))
    return ElementTree.tostring(root, encoding="unicode")


def _parsed(text: str, where: str) -> ElementTree.Element:
    """The top element of an XML text; no entities, which may stand for more than memory holds, and no deep nesting."""
    if len(text) > TEXT_BYTES or "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise RobotError(f"{where}: more than {TEXT_BYTES} characters, or a DOCTYPE: no URDF has these. Remove it.")
    parser: Any = ElementTree.XMLPullParser(("start", "end"))
    root: ElementTree.Element | None = None
    depth = 0
    try:
        for begin in range(0, len(text), _PIECE):
            parser.feed(text[begin : begin + _PIECE])
            for event, element in parser.read_events():
                root = element if root is None else root
                depth += 1 if event == "start" else -1
                if depth > MAX_DEPTH:
                    raise RobotError(f"{where}: elements are nested more than {MAX_DEPTH} deep. Is it a URDF?")
        parser.close()
    except ElementTree.ParseError as error:
        reason = f"{expat.ErrorString(error.code)}, line {error.position[0]}"
        raise RobotError(f"{where}: not well-formed XML: {reason}. Check that line.") from None
    except ValueError:
        raise RobotError(f"{where}: not well-formed XML: it has characters that no XML has. Is it a URDF?") from None
    if root is None:
        raise RobotError(f"{where}: it is empty, it must be a URDF. Check the path.")
    return root


def _find_mesh(name: str, folder: Path, where: str) -> Path:
    """A mesh by file:// or plain path, or by package:// from AMENT_PREFIX_PATH and the folders above the URDF."""
    if name.startswith(("package://", "model://")):
        relative = Path(name.split("://", 1)[1])
        shares = [Path(p) / "share" for p in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if p]
        candidates = [base / relative for base in (*shares, *folder.parents)]
        remedy = "Source the workspace that holds the package (AMENT_PREFIX_PATH), or put the URDF inside the package."
    else:
        candidates = [folder / name.removeprefix("file://")]
        remedy = "Relative paths are taken from the URDF's folder."
    for candidate in candidates:
        if candidate.is_file():
            return regular(candidate, MESH_BYTES, "mesh file")
    raise RobotError(f"{where}: mesh {name!r} is not found in {', '.join(map(str, candidates))}. {remedy}")


def build(pinocchio: ModuleType, urdf: str) -> tuple[Any, Any]:
    """Pinocchio's model and collision geometry model of a self-contained URDF.

    Raises
    ------
    RobotError
        With the parser's own message.
    """
    with _captured_stderr() as said:
        try:
            model = pinocchio.buildModelFromXML(urdf)
            geometry = pinocchio.buildGeomFromUrdfString(model, urdf, pinocchio.GeometryType.COLLISION)
        except (ValueError, RuntimeError) as error:
            said.seek(0)
            message = _AT_LINE.sub("", " ".join(said.read().decode(errors="replace").split()))
            raise RobotError(f"The URDF is refused by its parser: {error} {message}".rstrip()) from None
    return model, geometry


@contextlib.contextmanager
def _captured_stderr() -> Iterator[Any]:
    """Collects what C++ libraries print to standard error: the URDF parser gives its reasons nowhere else."""
    sys.stderr.flush()
    saved = os.dup(2)
    with tempfile.TemporaryFile() as said:
        os.dup2(said.fileno(), 2)
        try:
            yield said
        finally:
            os.dup2(saved, 2)
            os.close(saved)


def obstacles_of(pinocchio: ModuleType, model: Any, geometry: Any) -> tuple[Obstacle, ...]:
    """The collision geometry as obstacles with `link` set and poses in the link's frame, named LINK or LINK/1, LINK/2.

    Raises
    ------
    RobotError
        For a kind of geometry that the scene does not have.
    """
    count: dict[str, int] = {}
    out = []
    for item in geometry.geometryObjects:
        frame = model.frames[item.parentFrame]
        link = frame.name
        number = count.get(link, 0)
        count[link] = number + 1
        in_link = pinocchio.SE3ToXYZQUAT(frame.placement.actInv(item.placement))
        name = link if number == 0 else f"{link}/{number}"
        out.append(Obstacle(name, _solid(link, item.geometry), Pose(in_link[:3], in_link[3:]), link))
    return tuple(out)


def _solid(link: str, shape: Any) -> Solid:
    """A Coal shape as a solid of the scene."""
    kind = type(shape).__name__
    if kind == "Box":
        return Box(2.0 * np.array(shape.halfSide))
    if kind == "Sphere":
        return Sphere(float(shape.radius))
    if kind == "Cylinder":
        return Cylinder(float(shape.radius), 2.0 * float(shape.halfLength))
    if kind == "Capsule":
        return Capsule(float(shape.radius), 2.0 * float(shape.halfLength))
    if kind.startswith("BVHModel"):
        vertices = np.array(shape.vertices(), dtype=np.float64)
        triangles = (shape.tri_indices(i) for i in range(shape.num_tris))
        return Mesh(vertices, np.array([(t[0], t[1], t[2]) for t in triangles], dtype=np.int64))
    raise RobotError(f"Link {link!r} has collision geometry of kind {kind}. Use boxes, spheres, cylinders or meshes.")


def mimics_of(urdf: str) -> dict[str, tuple[str, float, float]]:
    """Joint -> (the joint that it mimics, multiplier, offset)."""
    out = {}
    for joint in ElementTree.fromstring(urdf).findall("joint"):  # noqa: S314, `read_urdf` has written it
        mimic = joint.find("mimic")
        if mimic is not None:
            name = joint.get("name", "")
            try:
                out[name] = (
                    mimic.get("joint", ""),
                    float(mimic.get("multiplier", "1")),
                    float(mimic.get("offset", "0")),
                )
            except ValueError:
                raise RobotError(f"Joint {name!r}: multiplier and offset of <mimic> must be numbers.") from None
    return out


def leader_of(name: str, mimics: Mapping[str, tuple[str, float, float]]) -> tuple[str, float, float]:
    """The joint that `name` follows in the end, and how: position = multiplier * leader + offset."""
    multiplier, offset = 1.0, 0.0
    for _ in range(len(mimics) + 1):
        if name not in mimics:
            return name, multiplier, offset
        name, factor, constant = mimics[name]
        multiplier, offset = multiplier * factor, multiplier * constant + offset
    raise RobotError(f"Joint {name!r} mimics itself in a circle. Correct the URDF.")


def longest_chain(model: Any, travel: Mapping[str, float]) -> float:
    """[m], from the world to the frame that is furthest along the chains of joints, all stretched out.

    travel: by the name of each joint, how far it goes from zero; counted for those that slide.
    """
    steps = []
    for joint in range(model.njoints):
        step = math.hypot(*model.jointPlacements[joint].translation.tolist())
        if model.joints[joint].shortname().startswith("JointModelP"):
            step += travel.get(model.names[joint], 0.0)
        steps.append(step)
    chains = [sum(steps[j] for j in model.supports[joint]) for joint in range(model.njoints)]
    frames = ((chains[f.parentJoint], f.placement.translation.tolist()) for f in model.frames)
    return float(max(chain + math.hypot(*place) for chain, place in frames))
