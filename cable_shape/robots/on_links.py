"""What a scene has on links of a robot, and whether that robot has them: :func:`check_links`."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping
from typing import Protocol

from cable_shape.errors import RobotError
from cable_shape.pose import Pose
from cable_shape.scene.scene import Clip, Obstacle, Scene
from cable_shape.scene.scene_parts import clip_names


class _Robot(Protocol):
    """What a :class:`cable_shape.robots.robot.Robot` is here."""

    def link_poses(self) -> Mapping[str, Pose]: ...


def check_links(robot: _Robot | None, scene: Scene | None) -> None:
    """Refuses clips and obstacles of a scene on links that a Robot does not have; None: there is none, for any clip.

    Raises
    ------
    RobotError
        Naming the link and what is on it.
    """
    if scene is None:
        return
    known = None if robot is None else robot.link_poses()
    parts: list[tuple[str, Clip | Obstacle]] = [*zip(clip_names(scene.clips), scene.clips, strict=True)]
    for name, part in [*parts, *((body.name, body) for body in scene.obstacles)]:
        if part.link is None or (known is not None and part.link in known):
            continue
        if known is not None:
            raise RobotError(f"{name!r} is on a link of the scene: {no_such('link', part.link, known)}")
        if isinstance(part, Clip):
            raise RobotError(
                f"clip {name!r} is on link {part.link!r}, and no joint positions tell where that is. Give the robot, "
                "and its joints as the input, or hold the clip in the world, without a link."
            )


def no_such(what: str, name: str, known: Iterable[str]) -> str:
    """The wording for a link or joint that the URDF does not have, with the nearest that it has."""
    names = sorted(known)
    near = difflib.get_close_matches(name, names, n=1, cutoff=0.0)
    nearest = f" The nearest is {near[0]!r}." if near else ""
    return f"the URDF has no {what} {name!r}.{nearest} It has: {', '.join(names)}."
