"""What the node runs, loaded from the files that its parameters name: :class:`Assembly`."""

from __future__ import annotations

import time
from pathlib import Path
from typing import final

from cable_shape.cable.cable import Cable
from cable_shape.cable.cable_file import CableFile, Held
from cable_shape.cable.harness import Harness
from cable_shape.cycle.cycle import Cycle
from cable_shape.cycle.dynamic import DYNAMIC
from cable_shape.cycle.harness_ends import HarnessFile
from cable_shape.errors import ArgumentError
from cable_shape.files.files import find_file
from cable_shape.files.yaml_files import load_yaml
from cable_shape.robots.on_links import check_links
from cable_shape.robots.robot import Robot
from cable_shape.ros.holding import NAME, Holding
from cable_shape.ros.interrupt import ends_when_told
from cable_shape.ros.parameters import VIEW_OFF, Settings
from cable_shape.ros.stand_in import StandIn
from cable_shape.ros.worker import WorkerProcess
from cable_shape.scene.scene import Scene
from cable_shape.uncertainty.uncertainty import Uncertainty
from cable_shape.viewer.process import ViewerProcess
from cable_shape.warm_up import warm_up_cycles, warm_up_harnesses, warm_up_motion

#: name of a cable that is alone
CABLE = "cable"

MAX_CABLES = 100

#: [s], that the end of the node waits for viewer and planner, which end by themselves all the same
LEAVE = 0.5


def load_cables(path: Path) -> dict[str, CableFile]:
    """One cable, or several from a file whose only key `cables` maps names to keys of a cable's file or to other files.

    Raises
    ------
    ArgumentError
    """
    values = load_yaml(path)
    if list(values) != ["cables"]:
        return {CABLE: CableFile.from_mapping(values, where=str(path))}
    several = values["cables"]
    if not isinstance(several, dict) or not 0 < len(several) <= MAX_CABLES:
        bound = f"it must map 1 to {MAX_CABLES} names to cables"
        raise ArgumentError.of(f"{path}: cables", type(several).__name__, bound, "For example {front: ethernet.yaml}.")
    cables = {}
    for name, cable in several.items():
        if not isinstance(name, str) or not NAME.fullmatch(name):
            bound = "a name must be letters, digits and _, beginning with a letter"
            raise ArgumentError.of(f"{path}: cables", name, bound, "It is a part of the cable's topics.")
        where = f"{path}: {name}"
        if isinstance(cable, str):
            cables[name] = CableFile.from_yaml(path.parent / cable)
        elif isinstance(cable, dict):
            cables[name] = CableFile.from_mapping(cable, where=where)
        else:
            raise ArgumentError.of(where, cable, "it must be a file name or a mapping", "See config/cables.")
    return cables


@final
class Assembly:
    """Cables or a harness, scene, robot, cycle and viewer, ready to run, and the workers that are started.

    Raises
    ------
    CableShapeError
        For files that do not exist or do not say what they should.
    """

    def __init__(self, settings: Settings) -> None:
        scene = Scene.from_yaml(find_file(settings.scene_file)) if settings.scene_file else Scene()
        self.held: dict[str, tuple[Held, Held]] = {}  # what is known of the grips of each cable
        self.holdings: list[Holding] = []
        self.harnesses: dict[str, HarnessFile] = {}  # with the ends as they are held
        cables = self._load_cables(settings) if settings.cable_file else {}
        for path in settings.harness_files:
            self._load_harness(path, settings, scene, cables)
        if len(self.holdings) > 1 and settings.input == "joints":
            bound = "input = 'joints' moves one cable or harness, held by the robot's two grippers"
            remedy = "Set input to 'poses' or 'tf', or name one."
            raise ArgumentError.of("cable_file, harness_file", [one.cable_id for one in self.holdings], bound, remedy)
        robot_file = find_file(settings.robot_file) if settings.robot_file else None
        self.robot = None if robot_file is None else Robot.from_yaml(robot_file)
        check_links(self.robot, scene)
        self.uncertainty: Uncertainty | None = None
        if settings.uncertainty_file:
            self.uncertainty = Uncertainty.from_yaml(find_file(settings.uncertainty_file))
        self.cycle = Cycle(
            cables,
            scene=scene,
            robot_links=() if self.robot is None else self.robot.link_geometry,
            gripping_links=() if self.robot is None else self.robot.gripping_links,
            model=settings.model,
            gravity=settings.gravity,
            points=settings.points,
            tolerance=settings.tolerance or None,
            time_budget=settings.time_budget or None,
            snap_horizon=settings.snap_horizon,
            quasistatic_limit=settings.quasistatic_limit,
            uncertainty=self.uncertainty,
            motion=settings.motion,
            look_ahead=settings.look_ahead,
        )
        with ends_when_told():
            warm_up_cycles(settings.model)
            if self.harnesses:
                warm_up_harnesses()
            if settings.motion == DYNAMIC:
                warm_up_motion()
        self.workers: dict[str, WorkerProcess] = {}  # processes beside the node by what they are
        self.stand_ins: list[StandIn] = []  # that answer for those of them that have died
        self.viewer: ViewerProcess | None = None
        if settings.view != VIEW_OFF:
            self.viewer = ViewerProcess(settings.output("view") or settings.view, cables, scene, robot_file)

    def _load_cables(self, settings: Settings) -> dict[str, Cable | Harness]:
        """The cables, each held by two grippers."""
        files = load_cables(find_file(settings.cable_file))
        self.held = {name: file.held for name, file in files.items()}
        several = len(files) > 1
        self.holdings = [Holding(name, f"{name}/" if several else "", held) for name, held in self.held.items()]
        return {name: file.cable for name, file in files.items()}

    def _load_harness(self, path: str, settings: Settings, scene: Scene, beside: dict[str, Cable | Harness]) -> None:
        """A harness, called as its file is, `beside` what was loaded before."""
        file = HarnessFile.from_yaml(find_file(path))
        if file.name in beside:
            bound = f"there is a cable, or a harness, {file.name!r} already"
            raise ArgumentError.of("harness_file", path, bound, "Rename the file: the harness is called as it is.")
        try:
            file = file.holding(settings.held, scene)
        except ArgumentError as error:
            raise type(error)(f"held_ends: {error}") from None
        holding = Holding.of_harness(file)
        if settings.input == "joints" and len(holding.topics) != 2:
            bound = f"input = 'joints' moves two ends, the robot's two grippers; held are {len(holding.topics)}"
            raise ArgumentError.of("held_ends", settings.held_ends, bound, "Name two: left, right.")
        self.holdings.append(holding)
        self.harnesses[file.name] = file
        beside[file.name] = file.harness

    def describe(self) -> str:
        """What was loaded, in words."""
        robot = "no robot" if self.robot is None else f"robot with {len(self.robot.joint_names)} joints"
        scene = f"{len(self.cycle.scene.obstacles)} obstacles"
        cables = "; ".join(f"{name}: {cable.describe()}" for name, cable in self.cycle.parts.items())
        told = {name: CableFile(self.cycle.cables[name], *held).describe() for name, held in self.held.items()}
        grips = "".join(f"; grips of {name} as calibrated: {words}" for name, words in told.items() if words)
        ends = [f"{end} {grip.kind}" for file in self.harnesses.values() for end, grip in file.grips.items()]
        held = f"; held: {', '.join(ends)}" if ends else ""
        return f"{cables}{grips}{held}; {scene}; {robot}"

    def remarks(self, settings: Settings) -> list[str]:
        """Grips that are told to hold a cable in another way than while it was calibrated."""
        said = zip(("left", "right"), settings.kinds, strict=True)
        kinds = {side: kind for side, kind in said if kind is not None and settings.input != "joints"}
        return [
            f"grip_kind_{side} is {kinds[side]}, but {name} was calibrated {known.kind} there: set it to auto."
            for name, held in self.held.items()
            for side, known in zip(("left", "right"), held, strict=True)
            if side in kinds and known.kind not in (None, kinds[side])
        ]

    def tell_edited(self) -> None:
        """Has the processes beside the node know what edits have made of cables and bodies."""
        if self.viewer is not None:
            self.viewer.edited(self.cycle.layout)
        if self.workers:
            text = self.cycle.layout.as_text()
            for worker in self.workers.values():
                worker.tell(text)

    def close(self, leave: bool = False) -> None:
        """Ends viewer and workers at the same time, within their bounds; with `leave` for a node that must end now."""
        processes = [*self.workers.values(), *(() if self.viewer is None else (self.viewer,))]
        self.workers.clear()
        self.viewer = None
        for process in processes:
            process.release()
        until = time.monotonic() + LEAVE
        for process in processes:
            if leave:
                process.leave(max(0.0, until - time.monotonic()))
            else:
                process.close()
        for stand_in in self.stand_ins:
            stand_in.destroy()
        self.stand_ins.clear()
