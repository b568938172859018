"""What stands still until it is edited, bodies and clips: :class:`Standing`. Imports rerun: see recording."""

from __future__ import annotations

from typing import Any, NamedTuple, final

import rerun as rr

from cable_shape.pose import Pose
from cable_shape.prediction.layout import Layout
from cable_shape.scene.scene import Box, Capsule, Cylinder, HalfSpace, HeightField, Mesh, Points, Solid, Sphere
from cable_shape.viewer import colour as colours
from cable_shape.viewer.columns import Columns
from cable_shape.viewer.plots import part, path

FLOOR_SIZE = 6.0  # m, of the plate that stands for a half-space
FLOOR_THICKNESS = 0.01  # m
FLOOR_GAP = 0.001  # m, by which the plate is drawn too low, so that the grid of the ground lies on it


class _Thing(NamedTuple):
    """One of them."""

    what: Solid | float  # a body, or the radius [m] of a clip's ball
    pose: Pose  # in the frame of the entity above it
    colour: colours.Colour


@final
class Standing:
    """Writes bodies and clips when they come, move and go."""

    def __init__(self, columns: Columns) -> None:
        self._columns = columns
        self._drawn: dict[str, _Thing] = {}  # by entity

    def write(self, layout: Layout) -> None:
        """What is new since the last time, at the columns' present time."""
        things = {**_bodies(layout), **_clips(layout)}
        for entity in [entity for entity in self._drawn if entity not in things]:
            self._columns.write(entity, rr.Clear(recursive=True))
        for entity, thing in things.items():
            before = self._drawn.get(entity)
            if before == thing:
                continue
            if before is not None and before._replace(pose=thing.pose) == thing:
                self._columns.write(entity, transform(thing.pose))
                continue
            if before is not None:
                self._columns.write(entity, rr.Clear(recursive=True))
            self._columns.write(entity, transform(thing.pose), _shown(thing))
        self._drawn = things


def transform(pose: Pose) -> rr.Transform3D:
    """Where an entity is, in the frame of the one above it."""
    return rr.Transform3D(translation=pose.position, quaternion=rr.Quaternion(xyzw=pose.quaternion))


def _bodies(layout: Layout) -> dict[str, _Thing]:
    """The obstacles, in the world or on a link."""
    out = {}
    for body in layout.scene.obstacles:
        above = "/world/obstacles" if body.link is None else f"/world/robot/{part(body.link)}"
        colour = colours.FLOOR if isinstance(body.solid, HalfSpace) else colours.OBSTACLE
        out[f"{above}/{part(body.name)}"] = _Thing(body.solid, body.pose, colour)
    return out


def _clips(layout: Layout) -> dict[str, _Thing]:
    """Clips of every cable, in the world or on a link."""
    out = {}
    for name, laid in layout.cables.items():
        for k, clip in enumerate(laid.clips):
            above = "/world/cables" if clip.link is None else f"/world/robot/{part(clip.link)}"
            thing = _Thing(1.2 * laid.made.diameter, clip.pose, colours.CLIP)
            out[f"{above}/{path(name)}/clips/{k}"] = thing
    return out


def _shown(thing: _Thing) -> Any:
    if isinstance(thing.what, float):
        return rr.Points3D([(0.0, 0.0, 0.0)], radii=thing.what, colors=thing.colour)
    return shown(thing.what, thing.colour)


def shown(solid: Solid, colour: colours.Colour) -> Any:
    """A solid in its own frame."""
    fill = rr.components.FillMode.Solid
    if isinstance(solid, Box):
        return rr.Boxes3D(half_sizes=[0.5 * solid.size], colors=colour, fill_mode=fill)
    if isinstance(solid, Sphere):
        return rr.Ellipsoids3D(radii=[solid.radius], colors=colour, fill_mode=fill)
    if isinstance(solid, Cylinder):
        return rr.Cylinders3D(radii=[solid.radius], lengths=[solid.length], colors=colour, fill_mode=fill)
    if isinstance(solid, Capsule):
        low = (0.0, 0.0, -0.5 * solid.length)  # rerun's capsule begins at its origin
        radii, lengths = [solid.radius], [solid.length]
        return rr.Capsules3D(radii=radii, lengths=lengths, translations=[low], colors=colour, fill_mode=fill)
    if isinstance(solid, HalfSpace):
        half = (0.5 * FLOOR_SIZE, 0.5 * FLOOR_SIZE, 0.5 * FLOOR_THICKNESS)
        low = (0.0, 0.0, -half[2] - FLOOR_GAP)
        return rr.Boxes3D(half_sizes=[half], centers=[low], colors=colour, fill_mode=fill)
    if isinstance(solid, Points):
        return rr.Points3D(solid.points, radii=solid.radius, colors=colour)
    assert isinstance(solid, (Mesh, HeightField))
    vertices, faces = (solid.vertices, solid.faces) if isinstance(solid, Mesh) else solid.surface()
    return rr.Mesh3D(
        vertex_positions=vertices,
        triangle_indices=faces,
        albedo_factor=colour,
        face_rendering=rr.components.MeshFaceRendering.DoubleSided,
    )
