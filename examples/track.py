"""A depth camera sees a cable behind a post: it is cut out by its colour, and followed where it is hidden."""

import mujoco
import numpy as np
import rerun as rr

import cable_shape as cs
from cable_shape.viewer.recording import new_recording
from cable_shape.viewer.tubes import capsules

ALONG_X = (0.5, 0.5, 0.5, 0.5)
known = cs.Cable(length=1.0, linear_density=0.05, bending_stiffness=0.004, diameter=0.01)
true = known.replace(length=1.005, bending_stiffness=0.008, rest_curvature=(0.5, 0.3, 0.0))  # the one in the cell
LINKS, STEP = 60, 0.04

# the cell: the cable as orange capsules, a grey post before it, an orange box that is no cable, a table
LINK = '<body name="link{}" mocap="true"><geom type="capsule" size="0.005 {}" rgba="1 0.5 0 1"/></body>'
model = mujoco.MjModel.from_xml_string(f"""<mujoco><worldbody>
  <geom type="plane" size="3 3 0.1" rgba="0.8 0.8 0.8 1"/>
  <geom type="box" size="0.09 0.02 0.6" pos="0.42 -0.5 0.6" rgba="0.4 0.4 0.4 1"/>
  <geom type="box" size="0.04 0.04 0.04" pos="0.75 0.35 0.75" rgba="1 0.5 0 1"/>
  {"".join(LINK.format(i, 0.5 * true.length / LINKS) for i in range(LINKS))}
</worldbody></mujoco>""")
data = mujoco.MjData(model)

# its depth camera: where it is, and the direction of each pixel
EYE, WIDTH, HEIGHT, NOISE = np.array((0.35, -1.3, 1.1)), 320, 200, 0.002
u, v = np.meshgrid(np.linspace(-0.5, 0.5, WIDTH), np.linspace(0.25, -0.5, HEIGHT))
rays = np.stack((u, np.ones_like(u), v), axis=-1).reshape(-1, 3)
rays /= np.linalg.norm(rays, axis=1)[:, None]
rng = np.random.default_rng(0)


def image() -> tuple[np.ndarray, np.ndarray]:
    """Depth (n,) along each ray [m], noisy, and colour (n, 3)."""
    depth, hit = np.empty(len(rays)), np.empty(len(rays), dtype=np.int32)
    mujoco.mj_multiRay(model, data, EYE, rays.ravel(), None, 1, -1, hit, depth, None, len(rays), 10.0)
    colour = np.where(hit[:, None] >= 0, model.geom_rgba[hit, :3], 0.0)
    return depth + NOISE * rng.normal(size=len(depth)), colour


def orange(seen: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """(n, 3) [m]: where the image is orange. Put your own segmentation here."""
    depth, colour = seen
    cable = (np.abs(colour - (1.0, 0.5, 0.0)) < 0.1).all(axis=1)
    return EYE + (depth[cable, None] + 0.5 * known.diameter) * rays[cable]  # a camera sees its skin


cell = cs.Predictor(true, points=LINKS + 1)
tracker = cs.Tracker(known, noise=0.005, segment=orange)
with new_recording("track.rrd") as recording:
    for k in range(100):
        way = 0.15 * np.sin(0.06 * k)
        start, end = cs.Pose((way, 0.0, 1.0), ALONG_X), cs.Pose((0.7 + way, 0.1 * np.sin(0.1 * k), 1.0), ALONG_X)
        there = cell.predict(start, end)
        data.mocap_pos[:] = 0.5 * (there.positions[1:] + there.positions[:-1])
        data.mocap_quat[:] = np.roll(there.quaternions[:-1], 1, axis=1)  # MuJoCo's begin with w
        mujoco.mj_kinematics(model, data)
        picture = image()
        shape = tracker.update(picture, stamp=round(1e9 * k * STEP), start=start, end=end)
        off = 1e3 * np.linalg.norm(shape.positions[::5] - there.positions[::3], axis=1)
        recording.set_time("stamp", duration=k * STEP)
        recording.log("world/seen", rr.Points3D(orange(picture), radii=0.003, colors=(255, 128, 0)))
        recording.log("world/true", rr.LineStrips3D([there.positions], radii=0.002, colors=(0, 160, 0)))
        recording.log("world/tracked", rr.LineStrips3D([shape.positions], radii=0.003, colors=(0, 90, 255)))
        recording.log("world/tube", capsules(tracker.tube, known.diameter))
        if k % 20 == 0:
            seen = f"{len(orange(picture))} points, the cable {off.mean():.1f} mm off in the mean"
            print(f"{k * STEP:.1f} s: {seen}, lost {tracker.lost}")
