"""Small problems that run every kernel once; what is run is imported where it is run."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import TYPE_CHECKING, ParamSpec

if TYPE_CHECKING:
    from cable_shape.cable.cable import Cable
    from cable_shape.scene.scene import Scene


P = ParamSpec("P")


def _whole(run: Callable[P, None]) -> Callable[P, None]:
    """With the kernels that those which it runs call in rare cases alone."""

    @functools.wraps(run)
    def whole(*args: P.args, **keywords: P.kwargs) -> None:
        from cable_shape.kernels._late import load_all

        run(*args, **keywords)
        load_all()

    return whole


def warm_up() -> None:
    """Runs every kernel on a small problem, so that nothing has to wait for the compiler.

    The first call on a machine compiles and fills the cache on disk, on one core; later ones load from it. `python -m
    cable_shape.warm_up` does it on all cores, and set-up by that.
    """
    for run in STAGES.values():
        run()


def warm_up_shapes() -> None:
    """Runs the kernels of single shapes of a plain cable."""
    from cable_shape.cable.cable import Cable
    from cable_shape.pose import Pose
    from cable_shape.prediction.predictor import predict

    along = (0.5, 0.5, 0.5, 0.5)
    cable = Cable(length=1.2, linear_density=0.1, bending_stiffness=0.01)
    predict(cable, Pose((0.0, 0.0, 1.0), along), Pose((0.8, 0.0, 1.0), along))


@_whole
def warm_up_plans() -> None:
    """Runs the kernels of batches, trajectories and calibrations."""
    import numpy as np

    from cable_shape.cable.cable import Cable
    from cable_shape.calibration.fit import calibrate
    from cable_shape.calibration.observation import Observation
    from cable_shape.planning.batch import predict_batch
    from cable_shape.planning.paths import GripPath
    from cable_shape.planning.trajectory import check_trajectory
    from cable_shape.pose import IDENTITY, Pose
    from cable_shape.scene.scene import Capsule, HalfSpace, Obstacle, Scene

    cable = Cable(length=1.0, linear_density=0.1, bending_stiffness=0.01, max_tension=1e3, allowable_stress=1e9)
    scene = Scene(
        obstacles=(Obstacle("capsule", Capsule(0.05, 0.1), IDENTITY, link="tool"), Obstacle("floor", HalfSpace()))
    )
    start = Pose((0.0, 0.0, 0.5), (0.5, 0.5, 0.5, 0.5))
    end, later = (Pose((x, 0.0, 0.5), (0.5, 0.5, 0.5, 0.5)) for x in (0.8, 0.79))
    calibrate([Observation(start, end, [(0.4, 0.0, 0.2)], acceleration=[(0, 0, 0), (0, 0, 1), (0, 0, 0)])], cable)
    starts, ends = (np.array([pose.array for pose in poses]) for poses in ((start, start), (end, later)))
    predict_batch(cable, starts, ends, scene=scene)
    check_trajectory(cable, scene, None, GripPath(starts, ends))


@_whole
def warm_up_forms() -> None:
    """Runs the kernels of the gradient cables, which cycles need that name them."""
    for model in ("gradient4", "gradient6"):
        _run_model(model)


def _cable() -> Cable:
    """With all that cycles look at."""
    from cable_shape.cable.cable import Cable

    return Cable(
        length=1.0,
        linear_density=0.1,
        bending_stiffness=0.01,
        max_tension=1e3,
        allowable_stress=1e9,
        tails={"end": 0.1},
    )


def _scene() -> Scene:
    """One of each body."""
    from cable_shape.pose import IDENTITY, Pose
    from cable_shape.scene.scene import Box, Capsule, Cylinder, HalfSpace, Obstacle, PointMass, Scene, Sphere

    return Scene(
        obstacles=(
            Obstacle("box", Box((0.1, 0.1, 0.1)), Pose((0.4, 0.0, 0.1))),
            Obstacle("sphere", Sphere(0.05), Pose((0.4, 0.1, 0.1))),
            Obstacle("cylinder", Cylinder(0.05, 0.1), Pose((0.4, -0.1, 0.1))),
            Obstacle("capsule", Capsule(0.05, 0.1), IDENTITY, link="tool"),
            Obstacle("floor", HalfSpace()),
        ),
        masses=(PointMass(0.5, 0.01),),
    )


def _run_model(model: str) -> None:
    """Shapes and cycles of one model."""
    from cable_shape.cycle.cycle import Cycle
    from cable_shape.pose import FreeEnd, Grip, Pose
    from cable_shape.prediction.predictor import predict

    cable, scene = _cable(), _scene()
    start = Pose((0.0, 0.0, 0.5), (0.5, 0.5, 0.5, 0.5))
    end, later = (Pose((x, 0.0, 0.5), (0.5, 0.5, 0.5, 0.5)) for x in (0.8, 0.79))
    for far in (end, Grip(end, kind="pinned"), FreeEnd(mass=0.01)):
        predict(cable, start, far, model=model, scene=scene)
    cycle = Cycle(cable, model=model, scene=scene)
    for stamp, far in enumerate((end, later, end)):
        cycle.step({"cable": (start, far)}, stamp=stamp * 10_000_000, links={"tool": start})


@_whole
def warm_up_cycles(model: str = "auto") -> None:
    """Runs the kernels of cycles and of single shapes alone: all that the node and a replay of a model need."""
    from cable_shape.cycle.cycle import Cycle
    from cable_shape.pose import Pose
    from cable_shape.prediction.predictor import Predictor, predict
    from cable_shape.scene.scene import Capsule, Clip, HalfSpace, Obstacle, Scene
    from cable_shape.uncertainty.uncertainty import Uncertainty

    for one in dict.fromkeys(("cosserat", "catenary", "cosserat" if model == "auto" else model)):
        _run_model(one)
    cable, scene = _cable(), _scene()
    start, end = (Pose((x, 0.0, 0.5), (0.5, 0.5, 0.5, 0.5)) for x in (0.0, 0.8))
    spread = Cycle(cable, model="cosserat", scene=scene, uncertainty=Uncertainty({"length": 1e-3}, (1e-3, 0.0)))
    spread.step({"cable": (start, end)}, stamp=0, links={"tool": start})
    predict(cable, start, Pose((1.2, 0.0, 0.5), end.quaternion))  # overstretched
    clips = [Clip(0.3, Pose((0.2, 0.0, 0.5)), "slide"), Clip(0.6, Pose((0.45, 0.0, 0.5)))]
    held = Predictor(cable, model="cosserat", scene=Scene(clips=clips))
    for k in range(3):
        held.predict(start, Pose((0.8, 0.0, 0.5 + 0.001 * k), end.quaternion))
    held.sensitivity()
    table = Scene(obstacles=[Obstacle("table", HalfSpace())], contact="solve")
    for around in (table, table.replace(clips=[Clip(0.5, Pose((0.4, 0.0, 0.1)), "slide")])):
        lowered = Cycle(cable, model="cosserat", scene=around, uncertainty=Uncertainty({"length": 1e-3}))
        for k in range(10):
            low = Pose((0.0, 0.0, 0.4 - 0.02 * k), start.quaternion), Pose((0.8, 0.0, 0.4 - 0.02 * k), end.quaternion)
            lowered.step({"cable": low}, stamp=k * 10_000_000)
        resting = lowered._cables["cable"].predictor
        resting.sensitivity(("start", "body:table", "length"))
    limp = Predictor(cable.replace(tails={}, bending_stiffness=1e-4), model="cosserat", scene=table)
    for height in (0.3, 0.2, 0.15, 0.1, 0.08, 0.06, 0.05, 0.05, 0.06, 0.08, 0.1):  # nodes come and go
        near, far_end = (Pose((x, 0.0, height), start.quaternion) for x in (0.0, 0.8))
        limp.predict(near, far_end)
    across_it = Pose((0.0, 0.0, 0.0), (0.7071067811865476, 0.0, 0.0, 0.7071067811865476))
    bar = Obstacle("bar", Capsule(0.03, 0.6), across_it, link="tool")
    pushed = Predictor(cable.replace(tails={}), model="cosserat", scene=Scene(obstacles=[bar], contact="solve"))
    for height in (0.0, 0.2, 0.3, 1.5, 0.0):  # against it, through it, and back
        pushed.predict(start, end, links={"tool": Pose((0.4, 0.0, height))})
    thin = cable.replace(tails={}, diameter=0.02)
    crossed = Cycle({"a": thin, "b": thin}, model="cosserat", scene=Scene(contact="solve"))
    over = (0.7071067811865476, 0.0, 0.0, -0.7071067811865476)
    for k in range(3):
        across = (Pose((0.4, -0.4, 0.515 - 0.001 * k), over), Pose((0.4, 0.4, 0.515 - 0.001 * k), over))
        crossed.step({"a": (start, end), "b": across}, stamp=k * 10_000_000)
    crossed._cables["a"].predictor.sensitivity(("start", "length"))


@_whole
def warm_up_harnesses() -> None:
    """Runs the kernels of harnesses: what a cycle with one needs beside those of `warm_up_cycles`."""
    from cable_shape.cable.cable import Cable
    from cable_shape.cable.harness import Harness
    from cable_shape.cable.junction import Junction
    from cable_shape.cycle.cycle import Cycle
    from cable_shape.pose import FreeEnd, Pose
    from cable_shape.scene.scene import Clip, HalfSpace, Obstacle, PointMass, Scene

    along = (0.5, 0.5, 0.5, 0.5)
    cable = Cable(length=0.6, linear_density=0.1, bending_stiffness=0.01)
    scene = Scene(
        obstacles=[Obstacle("floor", HalfSpace(), Pose((0.0, 0.0, -1.0)))],
        clips=[Clip(0.3, Pose((0.28, 0.0, 0.4), along), "hinge", segment="a")],
        masses=[PointMass(0.3, 0.01, segment="b")],
    )
    for kind in ("rigid", "ball"):
        harness = Harness(dict.fromkeys("abc", cable), [Junction("fork", ("a.end", "b.start", "c.start"), kind)])
        cycle = Cycle({"h": harness}, scene=scene)
        for k in range(3):
            ends = {"a.start": Pose((0.0, 0.0, 0.5), along), "b.end": Pose((0.8, 0.0, 0.5 + 0.001 * k), along)}
            cycle.step({"h": {**ends, "c.end": FreeEnd(mass=0.01)}}, stamp=k * 10_000_000)  # type: ignore[dict-item]
    floor = Obstacle("floor", HalfSpace(), Pose((0.0, 0.0, 0.3)))
    frames = {
        f"{name}.start": Pose(quaternion=(side, 0.0, 0.0, math.sqrt(0.96))) for name, side in (("b", 0.2), ("c", -0.2))
    }
    fork = Junction("fork", ("a.end", "b.start", "c.start"), frames=frames)
    laid = Cycle(
        {"h": Harness(dict.fromkeys("abc", cable.replace(diameter=0.02)), [fork])},
        scene=Scene([floor], contact="solve"),
    )
    for k in range(3):  # on the floor, kept out of itself
        ends = {"a.start": Pose((0.0, 0.0, 0.5), along), "b.end": Pose((0.9, 0.1, 0.5), along)}
        laid.step({"h": {**ends, "c.end": Pose((0.9, -0.1, 0.5 + 0.01 * k), along)}}, stamp=k * 10_000_000)  # type: ignore[dict-item]


@_whole
def warm_up_motion() -> None:
    """Runs the kernels of cables that swing, and of those that are seen."""
    from cable_shape.cable.cable import Cable
    from cable_shape.motion.motion import Motion
    from cable_shape.pose import Pose
    from cable_shape.prediction.predictor import Predictor
    from cable_shape.tracking.tracker import Tracker

    along = (0.5, 0.5, 0.5, 0.5)
    start, end = Pose((0.0, 0.0, 0.5), along), Pose((0.8, 0.0, 0.5), along)
    motion = Motion(Cable(length=1.0, linear_density=0.1, bending_stiffness=0.01), points=12)
    motion.begin(start, end)
    motion.step(start, end, 0.01)
    motion.run([start.array], [end.array], [0.01])
    predictor = Predictor(motion.problem.cable, model="cosserat")
    seen = predictor.predict(start, end).positions
    predictor.turning(0.5)
    tracker = Tracker(motion.problem.cable)
    for k in range(2):
        tracker.update(seen, stamp=k * 100_000_000, start=start, end=end)


#: In the order in which they are compiled ahead: who wants a later one needs those before.
STAGES = {
    "shapes": warm_up_shapes,
    "cycles": warm_up_cycles,
    "harnesses": warm_up_harnesses,
    "forms": warm_up_forms,
    "plans": warm_up_plans,
    "motion": warm_up_motion,
}
