"""Compiling or loading kernels once, before the first cycle.

What is warmed is imported where it is warmed: `import cable_shape`, which exports :func:`warm_up`, loads none of it.
"""

from cable_shape.warm_up.runs import warm_up, warm_up_cycles, warm_up_harnesses, warm_up_motion

__all__ = ["warm_up", "warm_up_cycles", "warm_up_harnesses", "warm_up_motion"]
