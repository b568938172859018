"""A scene's keywords from plain mappings, as YAML and JSON hold them, and the parts of a scene as such entries.

One entry a list item; exactly one of the solids in an obstacle::

    warn_distance: 0.03                       # m
    error_distance: 0.01                      # m
    contact: warn                             # or solve, off
    obstacles:
      - {name: table, box: [1.2, 0.8, 0.04], position: [0.5, 0, -0.02]}
      - {name: ball, sphere: 0.05, position: [0.5, 0, 0.1]}
      - {name: post, cylinder: {radius: 0.03, length: 0.4}, position: [0.5, 0, 0.2]}
      - {name: rail, capsule: {radius: 0.01, length: 0.4}, quaternion: [0, 0.7071, 0, 0.7071]}
      - {name: floor, half_space: true, position: [0, 0, -0.75]}
      - {name: fixture, mesh: fixture.stl, scale: 0.001}
      - {name: scan, points: {file: scan.xyz, radius: 0.004}, scale: 0.001}   # or vertices in place of file
      - {name: ground, height_field: {file: ground.csv, spacing: 0.01}}       # or heights; radius may be given
      - {name: camera, box: [0.03, 0.09, 0.03], position: [0, 0.06, 0], link: left_tool}
    clips:
      - {arc_length: 0.5, position: [0.5, 0, 0.3], quaternion: [0, 0, 0, 1], kind: ball, name: guide}
      - {arc_length: 0.7, position: [0, 0.05, 0], kind: hinge, link: forearm}
    masses:
      - {arc_length: 0.5, mass: 0.02}         # segment: a, too, of a harness; likewise in clips
    sockets:
      port_a: {position: [0.9, 0, 0.3], quaternion: [0, 0.7071, 0, 0.7071]}
    plug: {socket: port_a, position: [0, 0, 0.02]}   # of the plug's frame in the cable frame at the end
    allow:
      - {body: table, start: 0.2, end: 0.9, max_force: 5.0}   # all but body may be left out
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from cable_shape import checks
from cable_shape.errors import ArgumentError
from cable_shape.files.files import path_of
from cable_shape.pose import Pose, pose_entry
from cable_shape.scene.plug import Plug
from cable_shape.scene.points import HeightField, Points
from cable_shape.scene.scene_parts import Allow, Clip, Obstacle, PointMass
from cable_shape.scene.solids import Box, Capsule, Cylinder, HalfSpace, Mesh, Solid, Sphere

SOLID_KEYS = ("box", "sphere", "cylinder", "capsule", "half_space", "mesh", "points", "height_field")
#: Solids that may come from a file, and so be in another unit.
FILED = ("mesh", "points", "height_field")

#: How solids are written without a file.
_WRITTEN_OUT = {
    "mesh": "Write mesh: {vertices: .., faces: ..}.",
    "points": "Write points: {vertices: .., radius: ..}.",
    "height_field": "Write height_field: {heights: .., spacing: ..}.",
}


def keywords_of(values: Mapping[str, Any], where: str, folder: Path) -> dict[str, Any]:
    """The keywords of :class:`~cable_shape.scene.scene.Scene` that `values` gives; errors name `where` and the entry.

    Meshes are read from `folder`.
    """

    def entries(key: str, make: Callable[[Mapping[str, Any], str], Any]) -> tuple[Any, ...]:
        items = values.get(key)
        if items is None:
            return ()
        if not isinstance(items, (list, tuple)):
            raise ArgumentError.of(f"{where}: {key}", items, "it must be a list", "Start every entry with a dash.")
        return tuple(_named(f"{where}: {key}[{i}]", item, make) for i, item in enumerate(items))

    keywords = {
        **values,
        "obstacles": entries("obstacles", lambda v, w: _obstacle(v, w, folder)),
        "clips": entries("clips", _clip),
        "masses": entries("masses", _mass),
        "allow": entries("allow", _allow),
        "sockets": _sockets(values.get("sockets"), f"{where}: sockets"),
    }
    if values.get("plug") is not None:
        keywords["plug"] = _named(f"{where}: plug", values["plug"], _plug)
    return keywords


def part_of(values: Any, where: str) -> Obstacle | Clip | PointMass:
    """One item of `obstacles`, `clips` or `masses`, whichever its keys tell, of somebody who may name no files.

    Raises
    ------
    ArgumentError
        Naming `where`, the key and the remedy.
    """
    if not isinstance(values, Mapping):
        raise ArgumentError.of(where, values, "it must be a mapping", "Write {name: post, sphere: 0.03, position: ..}.")
    for key, remedy in _WRITTEN_OUT.items():
        given = values.get(key)
        if isinstance(given, str) or (isinstance(given, Mapping) and "file" in given):
            raise ArgumentError.of(f"{where}: {key}", given, "no file is read for an edit", remedy)
    if "mass" in values:
        return _named(where, values, _mass)  # type: ignore[no-any-return]
    if "arc_length" in values:
        return clip_of(values, where)
    return _named(where, values, lambda v, w: _obstacle(v, w, Path()))  # type: ignore[no-any-return]


def clip_of(values: Any, where: str) -> Clip:
    """One item of `clips`; see :func:`part_of`."""
    if not isinstance(values, Mapping):
        raise ArgumentError.of(where, values, "it must be a mapping", "Write {arc_length: 0.5, position: [x, y, z]}.")
    return _named(where, values, _clip)  # type: ignore[no-any-return]


def _named(where: str, item: Any, make: Callable[[Mapping[str, Any], str], Any]) -> Any:
    """`make(item)`, with errors that name the place of the entry and, where it has one, its name."""
    name = item.get("name") if isinstance(item, Mapping) else None
    if isinstance(name, str):
        where = f"{where} ({name})"
    try:
        return make(item, where)
    except ArgumentError as error:
        text = str(error)
        raise type(error)(text if text.startswith(where) else f"{where}: {text}") from None


def _obstacle(values: Mapping[str, Any], where: str, folder: Path) -> Obstacle:
    checks.known_keys(where, values, ("name", *SOLID_KEYS, "scale", "position", "quaternion", "link", "friction"))
    if "name" not in values:
        raise ArgumentError("the key 'name' is missing. Name the obstacle; reports and warnings use the name.")
    given = [key for key in SOLID_KEYS if key in values]
    if len(given) != 1:
        raise ArgumentError.of("solid", given, "exactly one must be given", f"Keep one of {', '.join(SOLID_KEYS)}.")
    if "scale" in values and given[0] not in FILED:
        bound = f"only {', '.join(FILED)} have one"
        raise ArgumentError.of("scale", values["scale"], bound, "Remove it.")
    solid = _solid(given[0], values[given[0]], where, folder, values.get("scale", 1.0))
    return Obstacle(values["name"], solid, _pose(values), values.get("link"), values.get("friction", 0.0))


def _solid(kind: str, value: Any, where: str, folder: Path, scale: Any) -> Solid:
    if kind == "box":
        return Box(value)
    if kind == "sphere":
        return Sphere(value)
    if kind in ("cylinder", "capsule"):
        keys = ("radius", "length")
        checks.known_keys(f"{where}: {kind}", value, keys)
        missing = [key for key in keys if key not in value]
        if missing:
            raise ArgumentError(f"{kind}: the key {missing[0]!r} is missing. Write {kind}: {{radius: .., length: ..}}.")
        return Cylinder(**value) if kind == "cylinder" else Capsule(**value)
    if kind == "half_space":
        if value is not True:
            raise ArgumentError.of(kind, value, "it takes no size", "Write half_space: true; z <= 0 is solid.")
        return HalfSpace()
    if kind == "points":
        return _points(value, where, folder, scale)
    if kind == "height_field":
        return _height_field(value, where, folder, scale)
    if isinstance(value, Mapping):
        checks.known_keys(f"{where}: mesh", value, ("vertices", "faces"))
        factor = checks.number("scale", scale, above=0.0)
        mesh = Mesh(value.get("vertices", ()), value.get("faces", ()))
        return Mesh(mesh.vertices * factor, mesh.faces)
    if not isinstance(value, str):
        raise ArgumentError.of("mesh", value, "it must be a path", "Name an STL or OBJ file, from the scene's folder.")
    return Mesh.from_file(folder / path_of(value, "mesh"), scale)


def _points(value: Any, where: str, folder: Path, scale: Any) -> Points:
    told = checks.mapping("points", value, ("file", "vertices", "radius"), "Write points: {file: .., radius: ..}.")
    own = _either(told, "points", "file", "vertices")
    if "radius" not in told:
        raise ArgumentError("points: the key 'radius' is missing. Write the radius of a sphere around each, in m.")
    if own == "file":
        return Points.from_file(folder / path_of(told["file"], "points"), told["radius"], scale)
    factor = checks.number("scale", scale, above=0.0)
    made = Points(told["vertices"], told["radius"])
    return made if factor == 1.0 else Points(made.points * factor, made.radius)


def _height_field(value: Any, where: str, folder: Path, scale: Any) -> HeightField:
    remedy = "Write height_field: {file: .., spacing: ..}."
    told = checks.mapping("height_field", value, ("file", "heights", "spacing", "radius"), remedy)
    own = _either(told, "height_field", "file", "heights")
    if "spacing" not in told:
        raise ArgumentError("height_field: the key 'spacing' is missing. Write how far heights are apart, in m.")
    if own == "file":
        file = folder / path_of(told["file"], "height_field")
        return HeightField.from_file(file, told["spacing"], told.get("radius"), scale)
    factor = checks.number("scale", scale, above=0.0)
    made = HeightField(told["heights"], told["spacing"], told.get("radius"))
    return made if factor == 1.0 else HeightField(made.heights * factor, made.spacing, made.radius)


def _either(told: Mapping[str, Any], kind: str, file: str, table: str) -> str:
    """Which of the two keys is given; just one may be."""
    given = [key for key in (file, table) if key in told]
    if len(given) != 1:
        raise ArgumentError.of(kind, given, "exactly one must be given", f"Keep one of {file}, {table}.")
    return given[0]


def _clip(values: Mapping[str, Any], where: str) -> Clip:
    more = ("kind", "name", "segment", "link", "friction", "retraction")
    _required(values, where, ("arc_length", "position"), ("quaternion", *more))
    return Clip(values["arc_length"], _pose(values), **{key: values[key] for key in more if key in values})


def _mass(values: Mapping[str, Any], where: str) -> PointMass:
    _required(values, where, ("arc_length", "mass"), ("segment",))
    return PointMass(values["arc_length"], values["mass"], values.get("segment"))


def _allow(values: Mapping[str, Any], where: str) -> Allow:
    _required(values, where, ("body",), ("start", "end", "max_force"))
    return Allow(values["body"], values.get("start"), values.get("end"), values.get("max_force"))


def _sockets(values: Mapping[str, Any] | None, where: str) -> dict[str, Pose]:
    if values is None:
        return {}
    if not isinstance(values, Mapping):
        raise ArgumentError.of(where, values, "it must be a mapping", "Write name: {position: .., quaternion: ..}.")
    return {str(name): _named(f"{where}.{name}", pose, _socket) for name, pose in values.items()}


def _socket(values: Mapping[str, Any], where: str) -> Pose:
    _required(values, where, ("position",), ("quaternion",))
    return _pose(values)


def _plug(values: Mapping[str, Any], where: str) -> Plug:
    _required(values, where, ("socket",), ("position", "quaternion"))
    return Plug(values["socket"], _pose(values))


def _required(values: Mapping[str, Any], where: str, required: tuple[str, ...], optional: tuple[str, ...]) -> None:
    checks.known_keys(where, values, (*required, *optional))
    missing = [key for key in required if key not in values]
    if missing:
        raise ArgumentError(f"the key {missing[0]!r} is missing. Add it.")


def _pose(values: Mapping[str, Any]) -> Pose:
    return Pose(values.get("position", (0.0, 0.0, 0.0)), values.get("quaternion", (0.0, 0.0, 0.0, 1.0)))


def obstacle_entry(obstacle: Obstacle) -> dict[str, Any]:
    """An item of `obstacles`; a mesh is written out."""
    more: dict[str, Any] = {"link": obstacle.link} if obstacle.link else {}
    if obstacle.friction:
        more["friction"] = obstacle.friction
    return {"name": obstacle.name, **_solid_entry(obstacle.solid), **pose_entry(obstacle.pose), **more}


def clip_entry(clip: Clip) -> dict[str, Any]:
    """An item of `clips`."""
    told = {key: getattr(clip, key) for key in ("name", "link")}
    more = {key: value for key, value in told.items() if value is not None}
    more.update((key, getattr(clip, key)) for key in ("friction", "retraction") if getattr(clip, key))
    return {"arc_length": clip.arc_length, **pose_entry(clip.pose), "kind": clip.kind, **more, **_segment_entry(clip)}


def mass_entry(mass: PointMass) -> dict[str, Any]:
    """An item of `masses`."""
    return {"arc_length": mass.arc_length, "mass": mass.mass, **_segment_entry(mass)}


def allow_entry(allow: Allow) -> dict[str, Any]:
    """An item of `allow`."""
    told = {key: getattr(allow, key) for key in ("start", "end", "max_force")}
    return {"body": allow.body, **{key: value for key, value in told.items() if value is not None}}


def _segment_entry(part: Clip | PointMass) -> dict[str, Any]:
    return {} if part.segment is None else {"segment": part.segment}


def plug_entry(plug: Plug) -> dict[str, Any]:
    """The value of `plug`."""
    return {"socket": plug.socket, **pose_entry(plug.offset)}


def _solid_entry(solid: Solid) -> dict[str, Any]:
    if isinstance(solid, Box):
        return {"box": solid.size.tolist()}
    if isinstance(solid, Sphere):
        return {"sphere": solid.radius}
    if isinstance(solid, HalfSpace):
        return {"half_space": True}
    if isinstance(solid, Points):
        return {"points": {"vertices": solid.points.tolist(), "radius": solid.radius}}
    if isinstance(solid, HeightField):
        entry = {"heights": solid.heights.tolist(), "spacing": solid.spacing, "radius": solid.radius}
        return {"height_field": entry}
    if isinstance(solid, Mesh):
        return {"mesh": {"vertices": solid.vertices.tolist(), "faces": solid.faces.tolist()}}
    kind = "cylinder" if isinstance(solid, Cylinder) else "capsule"
    return {kind: {"radius": solid.radius, "length": solid.length}}
