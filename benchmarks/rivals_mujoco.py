"""MuJoCo's cable (plugin mujoco.elasticity.cable, ball joints, the end held by a weld): a worker of `bench rivals`.

A setting: time step [s], damping [1/s] (a part of all velocities is taken away in each step, which damps slow swinging
best), and armature [kg m^2] of each joint for a bending stiffness of 0.01 N m^2. Armature changes no equilibrium, but
lets the explicit springs of the plugin take time steps of 10 to 40 ms. Integrator implicitfast,
dense Newton solver (the fastest here), contact off.
"""

from __future__ import annotations

import mujoco
import numpy as np
from rivals_common import GRAVITY, Rod, Setting, Swing, serve
from scipy.spatial.transform import Rotation

#: Body frame in the cable frame: MuJoCo's cable runs along x.
ALONG_X = Rotation.from_matrix(((0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (1.0, 0.0, 0.0)))
RADIUS = 0.004
STEPS = 400
APART = '><flag contact="disable"/>'

MODEL = """
<mujoco>
  <compiler boundmass="0" boundinertia="0"/>
  <extension><plugin plugin="mujoco.elasticity.cable"/></extension>
  <option timestep="{step}" integrator="implicitfast" jacobian="dense" tolerance="1e-10" gravity="0 0 {gravity}"
    {contact}
  </option>
  <size memory="100M"/>
  <worldbody>
    {bodies}
    <body name="hand" mocap="true" pos="{start}" quat="{start_quat}">
      <composite type="cable" curve="s" count="{vertices} 1 1" size="{size}" initial="none">
        <plugin plugin="mujoco.elasticity.cable">
          <config key="twist" value="{shear_modulus}"/><config key="bend" value="{modulus}"/>
        </plugin>
        <joint kind="main" armature="{armature}"/>
        <geom type="capsule" size="{radius}" mass="{mass}" {surface}/>
      </composite>
    </body>
    <body name="grip" mocap="true" pos="{end}" quat="{end_quat}"/>
  </worldbody>
  <equality>
    <weld body1="grip" body2="B_last" relpose="0 0 0 1 0 0 0" solref="{twice} 1" solimp="0.9999 0.9999 0.001"
      torquescale="{lever}"/>
  </equality>
</mujoco>
"""


def wxyz(rotation: Rotation) -> np.ndarray:
    """(..., 4) in MuJoCo's order."""
    return np.roll(rotation.as_quat(), 1, axis=-1)


def model_of(
    rod: Rod, joints: int, setting: Setting, bodies: str = "", contact: str = APART, surface: str = ""
) -> mujoco.MjModel:
    """The compiled model; bodies: geoms of the world, contact: the rest of the options, surface: that of the cable."""
    h = rod.length / joints
    fourth = np.pi * RADIUS**4
    ends = {}
    for side, (place, turn) in (("start", rod.start), ("end", rod.end)):
        values = {side: place - turn.apply((0.0, 0.0, 0.5 * h)), f"{side}_quat": wxyz(turn * ALONG_X)}
        ends |= {key: " ".join(f"{x:.17g}" for x in value) for key, value in values.items()}
    xml = MODEL.format(
        step=setting["step"], twice=2.0 * setting["step"], gravity=-GRAVITY, vertices=joints + 2, size=rod.length + h,
        modulus=4.0 * rod.bending_stiffness / fourth, shear_modulus=2.0 * rod.twisting_stiffness / fourth,
        armature=setting["armature"] * rod.bending_stiffness / 0.01, radius=RADIUS, mass=rod.linear_density * h,
        lever=0.25 * rod.length, bodies=bodies, contact=contact, surface=surface, **ends,
    )  # fmt: skip
    return mujoco.MjModel.from_xml_string(xml)


class Cable:
    """One model at its first guess."""

    def __init__(self, model: mujoco.MjModel, rod: Rod, joints: int, damping: float) -> None:
        self.model, self.data = model, mujoco.MjData(model)
        frames = rod.links(joints) * ALONG_X
        self.data.qpos[:] = wxyz(frames[:-1].inv() * frames[1:]).ravel()
        self.keep = 1.0 - damping * model.opt.timestep
        first = model.body("B_first").id
        self.bodies = slice(first, first + joints)
        self.along = np.array((rod.length / joints, 0.0, 0.0))

    def step(self, count: int) -> None:
        model, data, keep = self.model, self.data, self.keep
        for _ in range(count):
            mujoco.mj_step(model, data)
            data.qvel *= keep

    def joints(self) -> np.ndarray:
        turns = self.data.xmat[self.bodies].reshape(-1, 3, 3)
        return self.data.xpos[self.bodies] + turns @ self.along


def make(rod: Rod, joints: int, setting: Setting) -> tuple:
    """A maker of simulations, how many steps to run, and how often to look."""
    model = model_of(rod, joints, setting)
    return lambda: Cable(model, rod, joints, setting["damping"]), STEPS, 1


class Swinging(Cable):
    """One model from rest on, without damping, whose end goes its way."""

    def __init__(self, model: mujoco.MjModel, rod: Rod, joints: int, rest: Cable, swing: Swing) -> None:
        super().__init__(model, rod, joints, 0.0)
        self.swing, self.end = swing, self.data.mocap_pos[0].copy()
        self.data.qpos[:] = rest.data.qpos

    def step(self, count: int) -> None:
        model, data, swing = self.model, self.data, self.swing
        for _ in range(count):
            data.mocap_pos[0] = self.end + swing.share(data.time + model.opt.timestep) * swing.way
            mujoco.mj_step(model, data)


def swinging(rod: Rod, joints: int, setting: Setting, swing: Swing) -> tuple:
    """A maker of simulations at rest, and their time step [s].

    setting: that of a settling, and of how to swing from there.
    """
    rest = Cable(model_of(rod, joints, setting), rod, joints, setting["damping"])
    rest.step(STEPS)
    own = {"step": setting["swing_step"], "armature": setting["swing_armature"]}
    model = model_of(rod, joints, own)
    return lambda: Swinging(model, rod, joints, rest, swing), own["step"]


if __name__ == "__main__":
    serve(make, mujoco.__version__, swinging)
