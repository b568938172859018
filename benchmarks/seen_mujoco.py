"""MuJoCo's cable in the hands of the simulated cell: links in ball joints with springs, that swing and come to rest.

It is as stiff in twist as in bending. One hand is the parent of the first link, the other is welded to the last; the
first and the last link are centred on the ends, half of them outside. Damping takes a part of all velocities.
"""

from __future__ import annotations

import mujoco
import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

import cable_shape as cs

LINKS = 40
STEP = 1.25e-3  # s
DAMPING = 3.0  # 1/s
ARMATURE = 1e-4  # kg m^2, of each joint: no equilibrium is another by it

_DIVERGED = (mujoco.mjtWarning.mjWARN_BADQPOS, mujoco.mjtWarning.mjWARN_BADQVEL, mujoco.mjtWarning.mjWARN_BADQACC)

HEAD = """
<mujoco>
  <option timestep="{step}" integrator="implicitfast" gravity="0 0 -9.81"><flag contact="disable"/></option>
  <worldbody>
    <body name="start" mocap="true">
      {links}
    </body>
    <body name="end" mocap="true"/>
  </worldbody>
  <equality>
    <weld body1="end" body2="link{last}" relpose="0 0 0 1 0 0 0" anchor="0 0 0" solref="{twice} 1"
      solimp="0.9999 0.9999 0.001"/>
  </equality>
</mujoco>
"""
LINK = """<body name="link{i}" pos="0 0 {step}">{joint}
<inertial pos="0 0 {half}" mass="{mass}" diaginertia="{inertia} {inertia} {inertia}"/>"""
JOINT = '<joint type="ball" stiffness="{stiffness}" armature="{armature}"/>'


class MujocoCable:
    """A cable of isotropic links between two hands whose poses are given; z of each link is the cable's tangent."""

    def __init__(self, cable: cs.Cable) -> None:
        h = cable.length / LINKS
        mass = cable.linear_density * h
        # the first link is centred on the start: half of it outside; so is the last on the end
        joint = JOINT.format(stiffness=cable.mean_bending_stiffness / h, armature=ARMATURE)
        bodies = [
            LINK.format(
                i=i,
                step=h if i else -0.5 * h,
                joint=joint if i else "",
                half=0.5 * h,
                mass=mass,
                inertia=mass * h**2 / 12,
            )
            for i in range(LINKS + 1)
        ]
        xml = HEAD.format(step=STEP, twice=2.0 * STEP, links="".join(bodies) + "</body>" * len(bodies), last=LINKS)
        xml = xml.replace('relpose="0 0 0 1 0 0 0"', f'relpose="0 0 {-0.5 * h} 1 0 0 0"')
        mujoco.set_mju_user_warning(lambda words: None)  # no file of its own: `lost` tells
        self.model = mujoco.MjModel.from_xml_string(xml)
        self.data = mujoco.MjData(self.model)
        self.length, self.h = cable.length, h
        first = self.model.body("link0").id
        self._links = slice(first, first + LINKS + 1)

    def begin(self, shape: cs.CableShape, ends: list[cs.Pose]) -> None:
        """As a shape is, at rest."""
        mujoco.mj_resetData(self.model, self.data)
        rows = np.linspace(0.0, 1.0, LINKS + 1) * (shape.points - 1)
        frames = Rotation.from_quat(shape.quaternions[np.rint(rows).astype(int)])
        turned = (frames[:-1].inv() * frames[1:]).as_quat()
        self.data.qpos[:] = np.roll(turned, 1, axis=1).ravel()
        self.move(ends, 0.0)

    def move(self, ends: list[cs.Pose], seconds: float) -> None:
        """The hands go there in so long, in a straight line."""
        data, keep = self.data, 1.0 - DAMPING * STEP
        wanted = np.stack([end.position for end in ends])
        turned = np.stack([np.roll(end.quaternion, 1) for end in ends])
        count = round(seconds / STEP)
        before = data.mocap_pos.copy()
        turned *= np.where((turned * data.mocap_quat).sum(axis=1) < 0.0, -1.0, 1.0)[:, None]
        was = data.mocap_quat.copy()
        for k in range(1, count + 1):
            part = k / count
            data.mocap_pos[:] = before + part * (wanted - before)
            data.mocap_quat[:] = was + part * (turned - was)
            data.mocap_quat /= np.linalg.norm(data.mocap_quat, axis=1)[:, None]
            mujoco.mj_step(self.model, data)
            data.qvel *= keep
        if not count:
            data.mocap_pos[:], data.mocap_quat[:] = wanted, turned
            mujoco.mj_forward(self.model, data)

    @property
    def lost(self) -> bool:
        """Whether the simulation has diverged since it began."""
        return any(self.data.warning[kind].number > 0 for kind in _DIVERGED)

    def at(self, shares: np.ndarray) -> np.ndarray:
        """(n, 3) [m], the centreline at these shares of its length, through the middles of the links."""
        axes = self.data.xmat[self._links].reshape(-1, 3, 3)[:, :, 2]
        middles = self.data.xpos[self._links] + 0.5 * self.h * axes
        return np.asarray(CubicSpline(np.linspace(0.0, 1.0, LINKS + 1), middles)(shares))
