"""A MuJoCo model made from the same URDF as the :class:`~cable_shape.robots.robot.Robot`, and checked against it.

Two descriptions of one robot drift apart, and parsers reorder joints. So the model is generated at start, joints are
mapped by name, and the tool frames of both are compared before anyone uses it.
"""

from __future__ import annotations

from typing import Any, final
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from cable_shape.checks import Array
from cable_shape.errors import RobotError
from cable_shape.pose import Pose
from cable_shape.robots.robot import Robot

#: the tool frames must agree to this at each of the compared configurations: far above rounding, far below an error
POSITION_TOLERANCE = 1e-6  # m
ROTATION_TOLERANCE = 1e-6  # rad
_COMPARED = 20
_SEED = 20


@final
class MujocoModel:
    """MuJoCo's model of a robot, with joint positions in the robot's order.

    Parameters
    ----------
    robot : Robot
    xml : str, optional
        A URDF or MJCF of one's own for the same robot; default: the robot's URDF. Bodies keep the links' names.

    Attributes
    ----------
    model : mujoco.MjModel

    Raises
    ------
    RobotError
        If a joint or tool frame is missing, or the tool frames are elsewhere than Pinocchio has them.
    """

    def __init__(self, robot: Robot, xml: str | None = None) -> None:
        import mujoco

        self.robot = robot
        try:
            spec = mujoco.MjSpec.from_string(_without_meshes(robot.urdf) if xml is None else xml)
            spec.compiler.fusestatic = False  # fixed links stay bodies, so that tool frames keep their names
            spec.compiler.boundmass = max(spec.compiler.boundmass, 1e-6)  # links without inertia are no error
            spec.compiler.boundinertia = max(spec.compiler.boundinertia, 1e-9)
            spec.compiler.balanceinertia = True
            self.model = spec.compile()
        except (ValueError, mujoco.FatalError) as error:
            raise RobotError(f"MuJoCo refuses the robot description: {' '.join(str(error).split())}") from None
        self._address = self._map_joints(mujoco)
        self._compare(mujoco)

    def _map_joints(self, mujoco: Any) -> NDArray[np.intp]:
        """Where every single joint of the robot, mimicking ones included, stands in qpos."""
        address = []
        for name in self.robot.single_joints:
            joint = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_JOINT, name)
            if joint < 0:
                known = [self.model.joint(i).name for i in range(self.model.njnt)]
                raise RobotError(f"The MuJoCo model has no joint {name!r}. It has: {', '.join(known)}.")
            address.append(self.model.jnt_qposadr[joint])
        if self.model.nq != len(address):
            raise RobotError(
                f"The MuJoCo model has {self.model.nq} positions, the URDF has {len(address)} single joints. "
                "Make both from one file."
            )
        return np.array(address, dtype=np.intp)

    def qpos(self, q: Array) -> Array:
        """MuJoCo's positions (nq,) for the robot's `q` (n,); mimicking joints follow."""
        out = np.empty(self.model.nq)
        out[self._address] = self.robot.single_positions(q)
        return out

    def q(self, qpos: Array) -> Array:
        """The robot's joint positions (n,) in MuJoCo's `qpos` (nq,)."""
        return np.array(qpos)[self._address][self.robot.leading]

    def _compare(self, mujoco: Any) -> None:
        """Refuses the model unless its tool frames are where Pinocchio has them, at random configurations."""
        data = mujoco.MjData(self.model)
        random = np.random.default_rng(_SEED)
        low, high = np.maximum(self.robot.lower, -np.pi), np.minimum(self.robot.upper, np.pi)
        for _ in range(_COMPARED):
            q = random.uniform(low, high)
            data.qpos[:] = self.qpos(q)
            mujoco.mj_kinematics(self.model, data)
            for side, grip in zip(self.robot.grippers, self.robot.grips(q), strict=True):
                frame = self.robot.grippers[side].frame
                body = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_BODY, frame)
                if body < 0:
                    raise RobotError(f"The MuJoCo model has no body {frame!r}. Keep fixed links: fusestatic=false.")
                w, x, y, z = data.xquat[body]
                moved, turned = grip.pose.distance(Pose(data.xpos[body], (x, y, z, w)))
                if moved > POSITION_TOLERANCE or turned > ROTATION_TOLERANCE:
                    at = ", ".join(f"{n} {v:.3f}" for n, v in zip(self.robot.joint_names, q, strict=True))
                    raise RobotError(
                        f"MuJoCo and Pinocchio disagree on {frame!r}: {moved * 1e3:.3g} mm and {turned:.3g} rad apart, "
                        f"at most {POSITION_TOLERANCE * 1e3:g} mm and {ROTATION_TOLERANCE:g} rad are allowed. "
                        f"Make both from one URDF. Joint positions: {at}."
                    )
        self.robot.update(self.robot.home)


def _without_meshes(urdf: str) -> str:
    """The URDF without collision meshes, of which MuJoCo reads fewer formats; kinematics need none."""
    root = ElementTree.fromstring(urdf)  # noqa: S314, it has been read within bounds, see robot_files
    for link in root.iter("link"):
        for collision in link.findall("collision"):
            if collision.find("geometry/mesh") is not None:
                link.remove(collision)
    return ElementTree.tostring(root, encoding="unicode")
