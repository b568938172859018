"""What the node runs, loaded from the files that its parameters name: :class:`Assembly`."""

from __future__ import annotations

from typing import final

from cable_shape.cable import Cable
from cable_shape.cycle import Cycle
from cable_shape.robot import Robot
from cable_shape.ros.parameters import Settings, find_file
from cable_shape.scene import Scene
from cable_shape.viewer.process import ViewerProcess
from cable_shape.warm_up import warm_up

#: name of the one cable
CABLE = "cable"


@final
class Assembly:
    """Cable, scene, robot, cycle and viewer, ready to run.

    Raises
    ------
    CableShapeError
        For files that do not exist or do not say what they should.
    """

    def __init__(self, settings: Settings) -> None:
        cable = Cable.from_yaml(find_file(settings.cable_file))
        scene = Scene.from_yaml(find_file(settings.scene_file)) if settings.scene_file else Scene()
        robot_file = find_file(settings.robot_file) if settings.robot_file else None
        self.robot = None if robot_file is None else Robot.from_yaml(robot_file)
        self.cycle = Cycle(
            {CABLE: cable},
            scene=scene,
            robot_links=() if self.robot is None else self.robot.link_geometry,
            gripping_links=() if self.robot is None else self.robot.gripping_links,
            model=settings.model,
            gravity=settings.gravity,
            points=settings.points,
            tolerance=settings.tolerance or None,
            time_budget=settings.time_budget or None,
            snap_horizon=settings.snap_horizon,
        )
        warm_up()
        self.viewer: ViewerProcess | None = None
        if settings.view != "off":
            self.viewer = ViewerProcess(settings.view, self.cycle.cables, scene, robot_file)

    def describe(self) -> str:
        """What was loaded, in words."""
        robot = "no robot" if self.robot is None else f"robot with {len(self.robot.joint_names)} joints"
        scene = f"{len(self.cycle.scene.obstacles)} obstacles"
        return f"cable: {self.cycle.cables[CABLE].describe()}; {scene}; {robot}"

    def close(self) -> None:
        """Ends the viewer, within its bound of time."""
        if self.viewer is not None:
            self.viewer.close()
            self.viewer = None
