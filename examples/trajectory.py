"""A whole motion before it is made: is the cable clear and within its limits at the waypoints, and between them?"""

import numpy as np

import cable_shape as cs

cable = cs.Cable(length=1.2, linear_density=0.1, bending_stiffness=0.01, min_bend_radius=0.05)
post = cs.Obstacle("post", cs.Capsule(0.02, 0.6), cs.Pose((0.4, 0.1, 0.0)))
scene = cs.Scene(obstacles=[post], error_distance=0.01, warn_distance=0.03)
along_x = (0.5, 0.5, 0.5, 0.5)


def carried(heights: np.ndarray) -> cs.GripPath:
    """Both grips from y = -0.5 m to 0.5 m in 4 s, at these heights at the waypoints."""
    y, times = np.linspace(-0.5, 0.5, len(heights)), np.linspace(0.0, 4.0, len(heights))
    starts, ends = (np.array([(x, v, z, *along_x) for v, z in zip(y, heights, strict=True)]) for x in (0.0, 0.8))
    return cs.GripPath(starts, ends, times)


# Straight across the post goes through the cable: the first violation says where, and by how much.
found = cs.check_trajectory(cable, scene, None, carried(np.full(5, 0.6)))
print(found)
first = found.first
print(f"{first.reason.name} of {first.other} at {first.place:.2f} of the path ({first.time:.2f} s): {first.value:.4f}")

# Over it: high enough in the middle for the cable to pass above.
for top in (0.7, 0.75, 0.8):
    found = cs.check_trajectory(cable, scene, None, carried(np.array((0.6, top, top, top, 0.6))))
    print(f"over the post at {top:.2f} m: valid {found.valid}, {found.solved} shapes solved for")
assert found.valid
