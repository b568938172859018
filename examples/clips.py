"""A cable routed through clips: what they hold, what they are loaded with, and an eyelet in which it slides."""

import cable_shape as cs

cable = cs.Cable(length=1.4, linear_density=0.08, bending_stiffness=0.006)
along_x = (0.5, 0.5, 0.5, 0.5)
start, end = cs.Pose((0.0, 0.0, 0.5), along_x), cs.Pose((1.0, 0.1, 0.5), along_x)

for kind, holds in (
    ("fixed", "place, direction and roll"),
    ("hinge", "place and direction; it turns about itself"),
    ("ball", "its place alone"),
    ("slide", "as a hinge, and it runs through"),
):
    clip = cs.Clip(0.7, cs.Pose((0.5, 0.0, 0.35), along_x), kind=kind, name="rail")
    shape = cs.predict(cable, start, end, scene=cs.Scene(clips=[clip]))
    load = shape.clips[0]
    print(
        f"{kind:6} holds {holds}: {shape.status.name}, {load.force.round(3)} N, {load.moment.round(4)} N m on the clip"
    )

# A point of the cable that is held in an eyelet is no longer the one that was named: the cable has run on.
print(f"in the eyelet is now what lies {load.arc_length:.4f} m from the start")

# The rail is lifted: it carries less, and the grips more.
for k in range(5):
    rail = cs.Clip(0.7, cs.Pose((0.5, 0.0, 0.35 + 0.02 * k), along_x), kind="ball", name="rail")
    shape = cs.predict(cable, start, end, scene=cs.Scene(clips=[rail]))
    print(f"rail at {0.35 + 0.02 * k:.2f} m: it carries {-shape.clips[0].force[2]:.3f} N")
