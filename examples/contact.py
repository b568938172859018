"""A cable that is lowered onto a table: where it lies, what carries it, and how it answers when the table rises."""

import numpy as np

import cable_shape as cs

cable = cs.Cable(length=1.2, linear_density=0.1, bending_stiffness=0.005, diameter=0.008)
table = cs.Obstacle("table", cs.HalfSpace())
scene = cs.Scene(obstacles=[table], contact="solve")  # "warn" would only tell how deep the cable is in the table
predictor = cs.Predictor(cable, scene=scene)

along_x = (0.5, 0.5, 0.5, 0.5)
for height in np.linspace(0.5, 0.2, 31):  # every shape starts from the last one
    shape = predictor.predict(cs.Pose((0.0, 0.0, height), along_x), cs.Pose((0.8, 0.0, height), along_x))
    assert shape.usable, shape.detail
    if len(shape.contacts) == 1:
        print(f"at {height:.2f} m it touches {shape.contacts[0].body} at {shape.contacts[0].arc_length:.3f} m")

# The reaction of the table is told as forces at the nodes that lie on it; with the grips they carry the weight.
lies = [contact.arc_length for contact in shape.contacts]
carried = sum(contact.force * contact.normal[2] for contact in shape.contacts)
weight = 9.81 * cable.linear_density * cable.length
print(f"at {height:.2f} m it lies from {min(lies):.3f} m to {max(lies):.3f} m of its length")
print(f"the table carries {carried:.3f} N of {weight:.3f} N, the grips {weight - carried:.3f} N")

# To first order, from the factors of the last shape: the table comes up, and what lies on it comes with it.
columns = predictor.sensitivity(("body:table",))  # (n, 3, 6): vx vy vz wx wy wz of the table
print(f"the middle rises by {columns[len(columns) // 2, 2, 2]:.3f} m a metre, the grips stay")
