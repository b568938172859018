"""OMPL finds a way for both grips past a post: every edge of its tree is a motion that is checked in between, too."""

import numpy as np
from ompl import base, geometric, util

import cable_shape as cs

cable = cs.Cable(length=1.2, linear_density=0.1, bending_stiffness=0.01)
post = cs.Obstacle("post", cs.Capsule(0.03, 1.0), cs.Pose((0.4, 0.0, 0.4)))
scene = cs.Scene(obstacles=[post], error_distance=0.02, warn_distance=0.05)
along_x = (0.5, 0.5, 0.5, 0.5)


def path(places: np.ndarray) -> cs.GripPath:
    """Of places (k, 3) of the cable's start; its end is 0.8 m further in x."""
    turned = np.tile(along_x, (len(places), 1))
    return cs.GripPath(*(np.column_stack((places[:, 0] + x, places[:, 1:], turned)) for x in (0.0, 0.8)))


class Edges(base.MotionValidator):
    """Whether the straight way between two states is free, all of it."""

    def checkMotion(self, a: base.State, b: base.State) -> bool:
        return cs.check_trajectory(cable, scene, None, path(np.array([list_of(a), list_of(b)]))).valid


def list_of(state: base.State) -> list[float]:
    return [state[i] for i in range(3)]


util.RNG.setSeed(1)
util.setLogLevel(util.LogLevel.LOG_WARN)
space = base.RealVectorStateSpace(3)
bounds = base.RealVectorBounds(3)
for i, (low, high) in enumerate(((-1.0, 1.0), (-0.6, 0.6), (0.5, 1.6))):
    bounds.setLow(i, low)
    bounds.setHigh(i, high)
space.setBounds(bounds)


def state(*place: float) -> base.State:
    made = space.allocState()
    for i, x in enumerate(place):
        made[i] = x
    return made


setup = geometric.SimpleSetup(space)
information = setup.getSpaceInformation()
edges = Edges(information)  # kept: OMPL does not
information.setMotionValidator(edges)
setup.setStateValidityChecker(lambda s: edges.checkMotion(s, s))
setup.setStartAndGoalStates(state(0.0, -0.4, 0.8), state(0.0, 0.4, 0.8))
planner = geometric.RRTConnect(information)
planner.setRange(0.5)
setup.setPlanner(planner)
assert setup.solve(60.0)
found = np.array([list_of(s) for s in setup.getSolutionPath().getStates()])
print(found.round(2))
print("straight there:", cs.check_trajectory(cable, scene, None, path(found[[0, -1]])))
whole = cs.check_trajectory(cable, scene, None, path(found))
print("as planned:", whole)
assert whole.valid
