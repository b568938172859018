"""A cable that is moved fast: how far it swings on, when it hangs still, and a way after which it does so at once."""

import numpy as np

import cable_shape as cs

cable = cs.Cable(length=1.0, linear_density=0.1, bending_stiffness=0.01, retardation_time=0.05, drag=0.05)
along_x = (0.5, 0.5, 0.5, 0.5)
way, duration = 0.5, 1.2  # m, s

# Both grippers half a metre sideways, as smoothly as can be, beside the same way in the time that the cable likes.
times = np.linspace(0.0, duration, 121)
x = times / duration
smooth = way * (10 * x**3 - 15 * x**4 + 6 * x**5)
starts, ends = ([(at, y, 1.0, *along_x) for y in smooth] for at in (0.0, 0.7))
plain = cs.GripPath(starts, ends, times)
shaped = cs.shape_stop(cable, cs.GripPath([starts[0], starts[-1]], [ends[0], ends[-1]]), duration)

for name, path in (("smooth", plain), ("shaped", shaped.path)):
    stop = cs.check_trajectory(cable, None, None, path, motion=True).stops[-1]
    print(f"{name}: swings on by {stop.swing * 1e3:.1f} mm, settled {stop.settling:.2f} s after the stop")

# The same step by step: what a control loop does.
motion, spent = cs.Motion(cable), []
shape = motion.begin(cs.Pose(starts[0][:3], along_x), cs.Pose(ends[0][:3], along_x))
for start, end, dt in zip(shaped.path.starts[1:], shaped.path.ends[1:], np.diff(shaped.path.times), strict=True):
    shape = motion.step(cs.Pose(start[:3], start[3:]), cs.Pose(end[:3], end[3:]), float(dt))
    assert shape.usable, shape.detail
    spent.append(shape.solve_time)
fast = 1e3 * np.abs(shape.velocity).max()
print(f"at the stop it moves at {fast:.1f} mm/s; a step took {1e6 * np.median(spent):.0f} us")
