"""Bodies as the tables that compiled code reads, and where links are that carry some, or clips."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from cable_shape.checks import Array
from cable_shape.errors import ArgumentError
from cable_shape.kernels.distance import bounds, distance, triangles
from cable_shape.pose import Pose
from cable_shape.scene.mesh_tree import mesh_tables, spheres_tables
from cable_shape.scene.points import HeightField, Points
from cable_shape.scene.scene_parts import Clip, Obstacle, clip_names
from cable_shape.scene.solids import Box, Capsule, Cylinder, HalfSpace, Mesh, Solid, Sphere

#: Kinds of clips that hold no rotation.
_TURNING = ("ball", "slide")


def carried_by(bodies: Iterable[Obstacle], clips: Sequence[Clip] = ()) -> dict[str, str]:
    """The links that carry bodies and clips, in their order, and the first thing on each."""
    carried: dict[str, str] = {}
    for body in bodies:
        if body.link is not None:
            carried.setdefault(body.link, body.name)
    for name, clip in zip(clip_names(clips), clips, strict=True):
        if clip.link is not None:
            carried.setdefault(clip.link, name)
    return carried


def clip_frames(clips: Sequence[Clip], links: Array, carried: Mapping[str, str]) -> Array:
    """(k, 7), where clips are in the world, with the links in rows (m, 7), see `link_rows`; without rows NaN.

    What holds no rotation has that of the world.
    """
    out = np.empty((len(clips), 7))
    order = list(carried)
    for row, clip in zip(out, clips, strict=True):
        if clip.link is None:
            row[:] = clip.pose.array
        elif len(links):
            row[:] = (Pose.trusted(links[order.index(clip.link)]) * clip.pose).array
        else:
            row[:] = np.nan
        if clip.kind in _TURNING:
            row[3:] = (0.0, 0.0, 0.0, 1.0)
    return out


def link_rows(links: Mapping[str, Pose], carried: Mapping[str, str]) -> Array:
    """(k, 7) poses of the links that carry something, see `carried_by`; one dummy row if there are none.

    Raises
    ------
    ArgumentError
        If `links` lacks one of them.
    """
    if not isinstance(links, Mapping):
        raise ArgumentError.of("links", links, "it must be a mapping", "Write {link: Pose(...)}, or None.")
    if not carried:
        return np.zeros((1, 7))
    poses = [links.get(name) for name in carried]
    for pose, (name, body) in zip(poses, carried.items(), strict=True):
        if pose is None:
            raise ArgumentError.of(
                "links",
                sorted(map(str, links)),
                f"the pose of link {name!r} is missing, which carries {body!r}",
                "Give the pose of every link that carries a body or a clip, or None if the robot is not known.",
            )
        if not isinstance(pose, Pose):
            raise ArgumentError.of(f"links[{name!r}]", pose, "it must be a Pose", "Write Pose(position, quaternion).")
    return np.array([links[name].array for name in carried])


def body_tables(
    bodies: Sequence[Obstacle], links: Sequence[str], gripping: frozenset[str]
) -> tuple[Array, Array, Array]:
    """Bodies, triangles and tree nodes as the tables that the kernels read."""
    table = np.zeros((len(bodies), bounds.BODY_COLUMNS))
    all_triangles: list[Array] = [np.empty((0, triangles.TRIANGLE_COLUMNS))]
    all_nodes: list[Array] = [np.empty((0, triangles.NODE_COLUMNS))]
    first_triangle = first_node = 0
    for row, body in zip(table, bodies, strict=True):
        row[0], row[1:4] = _kind_and_sizes(body.solid)
        row[4:11] = body.pose.array
        row[11] = -1 if body.link is None else links.index(body.link)
        row[12] = body.link in gripping
        if isinstance(body.solid, (Mesh, Points, HeightField)):
            more = 0.0
            if isinstance(body.solid, Mesh):
                faces, nodes, row[14] = mesh_tables(body.name, body.solid)
            else:
                faces, nodes, row[19] = spheres_tables(body.solid)
                row[14] = more = body.solid.radius
            row[13], nodes = first_node, nodes.copy()
            corners = faces[:, :9].reshape(-1, 3) if isinstance(body.solid, Mesh) else faces[:, :3]
            low, high = corners.min(axis=0), corners.max(axis=0)
            row[15:18], row[1:4] = 0.5 * (low + high), 0.5 * (high - low) + more
            nodes[:, 6] += np.where(nodes[:, 7] > 0, first_triangle, first_node)
            all_triangles.append(faces)
            all_nodes.append(nodes)
            first_triangle += len(faces)
            first_node += len(nodes)
    return table, np.concatenate(all_triangles), np.concatenate(all_nodes)


def _kind_and_sizes(solid: Solid) -> tuple[int, tuple[float, float, float]]:
    """Kind and sizes as :mod:`cable_shape.kernels.distance.distance` has them; a tree's are those of its box."""
    if isinstance(solid, Box):
        a, b, c = (0.5 * solid.size).tolist()
        return distance.BOX, (a, b, c)
    if isinstance(solid, Sphere):
        return distance.SPHERE, (solid.radius, 0.0, 0.0)
    if isinstance(solid, Cylinder):
        return distance.CYLINDER, (solid.radius, 0.5 * solid.length, 0.0)
    if isinstance(solid, Capsule):
        return distance.CAPSULE, (solid.radius, 0.5 * solid.length, 0.0)
    if isinstance(solid, HalfSpace):
        return distance.HALF_SPACE, (0.0, 0.0, 0.0)
    return distance.MESH if isinstance(solid, Mesh) else distance.SPHERES, (0.0, 0.0, 0.0)
