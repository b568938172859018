"""A thousand grasps at once: which are good, and which of them leaves the most room."""

from time import perf_counter

import numpy as np

import cable_shape as cs

cable = cs.Cable(length=1.2, linear_density=0.1, bending_stiffness=0.01, min_bend_radius=0.05, max_tension=20.0)
post = cs.Obstacle("post", cs.Cylinder(0.03, 0.4), cs.Pose((0.4, 0.1, 0.2)))
scene = cs.Scene(obstacles=[post], warn_distance=0.03)

random = np.random.default_rng(0)
starts = np.tile((0.0, 0.0, 0.6, 0.5, 0.5, 0.5, 0.5), (1000, 1))  # x y z, quaternion x y z w
ends = np.tile((0.8, 0.0, 0.6, 0.5, 0.5, 0.5, 0.5), (1000, 1))
ends[:, :3] += random.uniform(-0.1, 0.1, (1000, 3))

began = perf_counter()
batch = cs.predict_batch(cable, starts, ends, model="cosserat", tolerance=1e-4 * cable.length, scene=scene)
print(f"{len(ends)} grasps in {perf_counter() - began:.2f} s, the compiler included where it was asked")

good = batch.usable & (batch.worst < 1.0)  # every margin below its limit
best = int(np.where(good, batch.worst, np.inf).argmin())
print(f"{good.sum()} are good; the best uses {batch.worst[best]:.2f} of its limits, with the end at {ends[best, :3]}")
print(f"its post is {batch.distances[best, 0] * 1e3:.0f} mm away: {batch.clearance_of(best).closest}")
print(f"its shape: {batch[best]}")

# A row's answer depends on its own ends and on nothing else, not on the rows beside it.
alone = cs.predict_batch(
    cable, starts[best : best + 1], ends[best : best + 1], model="cosserat", tolerance=1e-4 * cable.length, scene=scene
)
assert (alone.positions[0] == batch.positions[best]).all()
