"""The commands `cable-shape predict` and `cable-shape replay`: their options, and what they do."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from cable_shape.command import EXIT_ERROR, EXIT_PARTIAL
from cable_shape.errors import ArgumentError

if TYPE_CHECKING:
    from cable_shape.cable.cable import Cable
    from cable_shape.cable.cable_file import Held
    from cable_shape.scene.scene import Scene

Commands: TypeAlias = "argparse._SubParsersAction[argparse.ArgumentParser]"


def add_predict(commands: Commands) -> None:
    """The options of `predict`."""
    predict = commands.add_parser(
        "predict",
        help="predict one shape from a file",
        description="Solves CASE (YAML or JSON; keys: the arguments of cable_shape.predict) and prints a table.",
    )
    predict.add_argument(
        "case", type=Path, metavar="CASE", help="see docs/replay.md; one of its own is cases/harness.yaml"
    )
    predict.add_argument(
        "-o", "--out", type=Path, action="append", default=[], metavar="FILE",
        help=".json, .csv, .png or .rrd; repeatable",
    )  # fmt: skip
    predict.add_argument("--picture", action="store_true", help="the same as -o CASE.png -o CASE.rrd")
    _add_model(predict)
    predict.set_defaults(run=_predict)


def add_replay(commands: Commands) -> None:
    """The options of `replay`."""
    replay = commands.add_parser(
        "replay",
        help="predict the cable in a recording; no middleware",
        description="Reads a rosbag2 (mcap or sqlite3) with gripper poses, joint states or transforms and writes "
        "OUT/replay/ (a rosbag2 with the node's messages), OUT/replay.rrd and OUT/report.md, .json and .png.",
    )
    replay.add_argument("bag", type=Path, metavar="BAG", help="rosbag2 folder, or one .mcap or .db3 file")
    replay.add_argument("-o", "--out", type=Path, required=True, metavar="OUT", help="folder for the results")
    replay.add_argument("--cable", type=Path, metavar="CABLE.yaml", help="a cable's file")
    replay.add_argument("--harness", type=Path, metavar="HARNESS.yaml", help="a harness's file, in place of --cable")
    replay.add_argument("--held-ends", metavar="ENDS", help="of the harness: a.start,b.end; else as its file says")
    replay.add_argument(
        "--end-topic",
        action="append",
        default=[],
        metavar="END=TOPIC",
        help="of one of them, repeatable; /NAME/a_start/pose",
    )
    replay.add_argument("--scene", type=Path, metavar="SCENE.yaml", help="keys: the keywords of Scene")
    replay.add_argument("--robot", type=Path, metavar="ROBOT.yaml", help="needed for joint states")
    replay.add_argument("--uncertainty", type=Path, metavar="FILE.yaml", help="keys: those of Uncertainty; a tube")
    _add_model(replay)
    replay.add_argument("--gravity", type=float, nargs=3, default=(0.0, 0.0, -9.81), metavar=("X", "Y", "Z"))
    for side, end in (("start", "left"), ("end", "right")):
        replay.add_argument(
            f"--{side}-kind", choices=("clamped", "swivel", "pinned"), help=f"how the {end} gripper holds"
        )
        replay.add_argument(
            f"--{side}-offset",
            type=float,
            nargs=7,
            metavar=("X", "Y", "Z", "QX", "QY", "QZ", "QW"),
            help=f"the cable frame in the {end} tool frame; the default is the tool frame itself",
        )
    replay.add_argument("--max-skew", type=float, default=0.02, metavar="S", help="pair poses within S seconds (0.02)")
    replay.add_argument(
        "--input", choices=("auto", "poses", "joints", "tf"), default="auto", help="what to compute from"
    )
    replay.add_argument("--left-topic", default="/left_gripper/pose", metavar="TOPIC")
    replay.add_argument("--right-topic", default="/right_gripper/pose", metavar="TOPIC")
    replay.add_argument("--joints-topic", default="/joint_states", metavar="TOPIC")
    replay.add_argument("--tf-topic", default="/tf", metavar="TOPIC", help="and TOPIC_static")
    replay.add_argument("--left-frame", default="", metavar="FRAME", help="of the left gripper on /tf: --input tf")
    replay.add_argument("--right-frame", default="", metavar="FRAME", help="the same for the right gripper")
    replay.add_argument(
        "--frame-id", default="world", metavar="FRAME", help="frame of the shapes, for --input tf (world)"
    )
    replay.add_argument("--markers-topic", default="/cable/markers", metavar="TOPIC", help="PoseArray to compare with")
    replay.add_argument("--edits-topic", default="/cable/edits", metavar="TOPIC", help="CableEdits to repeat")
    replay.add_argument("--inertia", action="store_true", help="the markers' accelerations load the cable")
    replay.add_argument(
        "--motion", choices=("quasistatic", "dynamic"), default="quasistatic", help="dynamic: as the cable swings"
    )
    replay.add_argument("--no-rrd", action="store_true", help="do not write replay.rrd")
    replay.add_argument("--no-picture", action="store_true", help="do not write report.png")
    replay.set_defaults(run=_replay)


def _add_model(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--model", help="catenary, gradient4, gradient6, cosserat or auto (auto)")
    parser.add_argument("--points", type=int, metavar="N", help="points of the shape (150)")
    parser.add_argument("--tolerance", type=float, metavar="M", help="largest position error allowed [m]")


def _replay(arguments: argparse.Namespace) -> int:
    from cable_shape.files.files import find_file
    from cable_shape.replay.interrupt import Interruptible
    from cable_shape.replay.report import headline, summarise
    from cable_shape.replay.run import replay
    from cable_shape.replay.settings import Settings
    from cable_shape.scene.scene import Scene
    from cable_shape.uncertainty.uncertainty import Uncertainty

    robot = None
    if arguments.robot is not None:
        from cable_shape.robots.robot import Robot

        robot = Robot.from_yaml(find_file(arguments.robot))
    scene = None if arguments.scene is None else Scene.from_yaml(find_file(arguments.scene))
    settings = Settings(
        **_carried(arguments, scene),
        scene=scene,
        robot=robot,
        uncertainty=None if arguments.uncertainty is None else Uncertainty.from_yaml(find_file(arguments.uncertainty)),
        **_model_options(arguments),
        gravity=tuple(arguments.gravity),
        max_skew=arguments.max_skew,
        input=arguments.input,
        left_topic=arguments.left_topic,
        right_topic=arguments.right_topic,
        joints_topic=arguments.joints_topic,
        tf_topic=arguments.tf_topic,
        left_frame=arguments.left_frame,
        right_frame=arguments.right_frame,
        frame_id=arguments.frame_id,
        markers_topic=arguments.markers_topic,
        edits_topic=arguments.edits_topic,
        inertia=arguments.inertia,
        motion=arguments.motion,
        rrd=not arguments.no_rrd,
        picture=not arguments.no_picture,
    )
    with Interruptible() as interruptible:
        try:
            outcome = replay(arguments.bag, arguments.out, settings, lambda m, n: interruptible.messages(_bar(m, n)))
        except KeyboardInterrupt:
            done = f"what was replayed until then is in {arguments.out}, without a report"
            print(f"cable-shape: {done}", file=sys.stderr)
            raise
    _print_table(headline(summarise(outcome)))
    print(f"written: {arguments.out}")
    for note in outcome.notes:
        print(f"cable-shape: note: {note}", file=sys.stderr)
    for refused in outcome.refusals:
        first = f"{refused.count} messages of {refused.topic} refused, {refused.reason}"
        print(f"cable-shape: warning: {first}; the first: {refused.example}", file=sys.stderr)
    for problem in outcome.problems:
        print(f"cable-shape: error: not read: {problem}", file=sys.stderr)
    return EXIT_PARTIAL if outcome.problems else 0


def _carried(arguments: argparse.Namespace, scene: Scene | None) -> dict[str, Any]:
    """The cable or the harness of a replay, and how its ends are held."""
    from cable_shape.cable.cable_file import CableFile
    from cable_shape.cycle.harness_ends import HarnessFile
    from cable_shape.files.files import find_file

    if arguments.harness is None:
        if arguments.cable is None:
            raise ArgumentError(
                "--cable CABLE.yaml is missing: its length, weight and stiffness decide the shape. "
                "Write at least length [m], linear_density [kg/m] and bending_stiffness [N m^2]; "
                "config/cables holds examples. A harness is given by --harness."
            )
        for option in ("held_ends", "end_topic"):
            if getattr(arguments, option):
                raise ArgumentError(f"--{option.replace('_', '-')}: ends of this name has a harness. Give --harness.")
        file = CableFile.from_yaml(find_file(arguments.cable))
        note_slips(file.cable, scene)
        return {
            "cable": file.cable,
            "start": _held("start", file.start, arguments.start_kind, arguments.start_offset),
            "end": _held("end", file.end, arguments.end_kind, arguments.end_offset),
        }
    for option in ("cable", "start_kind", "end_kind", "start_offset", "end_offset"):
        if getattr(arguments, option) is not None:
            remedy = "Leave it out; the key `ends` of the harness's file has kinds and offsets."
            raise ArgumentError(f"--{option.replace('_', '-')}: it is not for a harness. {remedy}")
    harness = HarnessFile.from_yaml(find_file(arguments.harness))
    for segment in harness.harness.segments.values():
        note_slips(segment, scene)
    ends = (arguments.held_ends or "").split(",")
    topics = [text.partition("=") for text in arguments.end_topic]
    for end, _, topic in topics:
        if not topic:
            raise ArgumentError.of("--end-topic", end, "it must be END=TOPIC", "Write a.start=/tracker/pose.")
    return {
        "harness": harness,
        "held_ends": tuple(end.strip() for end in ends if end.strip()),
        "end_topics": {end: topic for end, _, topic in topics},
    }


def _held(side: str, known: Held, kind: str | None, offset: Sequence[float] | None) -> Held:
    """How one gripper holds the cable: as its file knows, but for what the command line tells."""
    from cable_shape.pose import Pose

    try:
        held = known.told(kind, None if offset is None else Pose(offset[:3], offset[3:]))
    except ArgumentError as error:
        raise ArgumentError(f"--{side}-offset: {error}") from None
    if known.kind not in (None, held.kind):
        text = f"--{side}-kind {held.kind}: the cable's file was fitted with a {known.kind} {side}"
        print(f"cable-shape: note: {text}", file=sys.stderr)
    return held


def _model_options(arguments: argparse.Namespace) -> dict[str, Any]:
    """model, points and tolerance, those that were given."""
    options = {name: getattr(arguments, name) for name in ("model", "points", "tolerance")}
    return {name: value for name, value in options.items() if value is not None}


def _bar(messages: Iterable[Any], count: int) -> Iterable[Any]:
    """A progress bar on stderr, if that is a terminal."""
    from tqdm import tqdm

    bar: Iterable[Any] = tqdm(messages, total=count or None, unit=" messages", disable=None, leave=False)
    return bar


def _predict(arguments: argparse.Namespace) -> int:
    from cable_shape.command import case_output as output
    from cable_shape.command import harness_case as harness
    from cable_shape.command.load_case import load_case
    from cable_shape.files.files import find_file

    if arguments.picture:
        arguments.out += [arguments.case.with_suffix(suffix) for suffix in (".png", ".rrd")]
    for path in arguments.out:
        output.check_suffix(path)
    case: Any = load_case(find_file(arguments.case))
    of_harness = isinstance(case, harness.HarnessCase)
    told: Any = harness if of_harness else output
    for cable in case.harness.segments.values() if of_harness else (case.cable,):
        note_slips(cable, case.scene)
    options = _model_options(arguments)
    case.predict(**options)  # loads the kernels, so that the solve time below is that of solving
    shape = case.predict(**options)
    print(case.name)
    _print_table(told.rows(case, shape))
    for path in arguments.out:
        told.write(case, shape, path)
        print(f"written: {path}")
    if not shape.usable:
        reason = shape.detail or shape.status.remedy
        print(f"cable-shape: error: {shape.status.name}: do not act on this shape. {reason}", file=sys.stderr)
        return EXIT_ERROR
    return 0


def note_slips(cable: Cable, scene: Scene | None = None) -> None:
    """Says on stderr what is hardly meant."""
    from cable_shape.command.units import slips_of

    for slip in slips_of(cable, scene):
        print(f"cable-shape: note: {slip}", file=sys.stderr)


def _print_table(table: Iterable[tuple[str, str]]) -> None:
    for label, value in table:
        print(f"  {label:<26} {value}")
