"""The `cable-shape` command.

Exit codes: 0 all is well; 1 `doctor` found something to repair, or a node of `status` is not well; 2 wrong arguments,
input that cannot be used, or a result that must not be: a shape of `predict`, a fit of `calibrate`; 3 a part of the
recording of a `replay` could not be read; 130 interrupted.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn, TypeAlias

import cable_shape
from cable_shape.errors import ArgumentError, CableShapeError, DependencyError, lacking

if TYPE_CHECKING:
    from cable_shape.cable.cable import Cable
    from cable_shape.cable.cable_file import Held
    from cable_shape.scene.scene import Scene

Commands: TypeAlias = "argparse._SubParsersAction[argparse.ArgumentParser]"

LOOPBACK = "127.0.0.1"
EXIT_UNWELL, EXIT_ERROR, EXIT_PARTIAL, EXIT_INTERRUPTED = 1, 2, 3, 130


def main(argv: Sequence[str] | None = None) -> int:
    """Runs one command and returns its exit code."""
    arguments = build_parser().parse_args(argv)
    try:
        code: int = arguments.run(arguments)
    except CableShapeError as error:
        if arguments.debug:
            raise
        return _refuse(error)
    except ModuleNotFoundError as error:
        known = lacking(error)
        if arguments.debug or known is None:
            raise
        return _refuse(known)
    except OSError as error:
        if arguments.debug:
            raise
        print(f"cable-shape: error: {error}. Check the path, permissions and free space.", file=sys.stderr)
        return EXIT_ERROR
    except KeyboardInterrupt:
        print("cable-shape: interrupted", file=sys.stderr)
        return EXIT_INTERRUPTED
    return code


def _refuse(error: CableShapeError, command: str = "cable-shape") -> int:
    """Says what is wrong on one line."""
    print(f"{command}: error: {' '.join(str(error).split())}", file=sys.stderr)
    return EXIT_ERROR


def run_node() -> NoReturn:
    """The executable `cable_shape_node`, see cable_shape.ros.node."""
    try:
        from cable_shape.ros.node import run
    except DependencyError as error:
        sys.exit(_refuse(error, "cable_shape_node"))
    except ModuleNotFoundError as error:
        known = lacking(error)
        if known is None:
            raise
        sys.exit(_refuse(known, "cable_shape_node"))
    run()


def build_parser() -> argparse.ArgumentParser:
    """All commands and their options."""
    parser = argparse.ArgumentParser(
        prog="cable-shape",
        description="Predicts the quasistatic shape of the cable held between two grippers.",
        epilog="Exit codes: 0 well, 1 doctor or status found something, 2 error or a result that must not be used, "
        "3 only a part of a recording could be read, 130 interrupted.",
    )
    parser.add_argument("--version", action="version", version=f"cable-shape {cable_shape.__version__}")
    parser.add_argument("--debug", action="store_true", help="show the traceback of an error")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    _add_replay(commands)
    _add_predict(commands)
    _add_import(commands)
    _add_view(commands)
    _add_calibrate(commands)
    _add_status(commands)
    _add_bench(commands)
    doctor = commands.add_parser("doctor", help="check libraries, messages, compiled kernels, and your files")
    for name in ("cable", "harness", "scene", "robot"):
        doctor.add_argument(f"--{name}", type=Path, metavar=f"{name.upper()}.yaml", help=f"also look at this {name}")
    doctor.set_defaults(run=_doctor)
    return parser


def _add_replay(commands: Commands) -> None:
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
    replay.add_argument("--inertia", action="store_true", help="the markers' accelerations load the cable")
    replay.add_argument("--no-rrd", action="store_true", help="do not write replay.rrd")
    replay.add_argument("--no-picture", action="store_true", help="do not write report.png")
    replay.set_defaults(run=_replay)


def _add_model(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--model", help="catenary, gradient4, gradient6, cosserat or auto (auto)")
    parser.add_argument("--points", type=int, metavar="N", help="points of the shape (150)")
    parser.add_argument("--tolerance", type=float, metavar="M", help="largest position error allowed [m]")


def _add_predict(commands: Commands) -> None:
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


def _add_import(commands: Commands) -> None:
    from cable_shape.command.import_files import add_arguments, run

    parser = commands.add_parser(
        "import",
        help="make a harness or a cable of a KBL, WireViz, CSV, DXF, mesh or STEP file",
        description="Reads FILE and writes DIR/harness.yaml with a formboard (.svg, .dxf), or DIR/cable.yaml and "
        "case.yaml, and DIR/import.md, which says what was derived, merged and left out.",
    )
    add_arguments(parser)
    parser.set_defaults(run=run)


def _add_view(commands: Commands) -> None:
    view = commands.add_parser("view", help="open a .rrd in the rerun viewer")
    view.add_argument("file", type=Path, metavar="FILE.rrd", help="of a replay, a node or the demo")
    view.add_argument("--web", action="store_true", help="for a browser instead of a window, until Ctrl-C")
    view.add_argument(
        "--bind", default=LOOPBACK, metavar="ADDRESS",
        help="who may connect to the viewer: this machine only (127.0.0.1), or 0.0.0.0 for all that reach it",
    )  # fmt: skip
    view.set_defaults(run=_view)


def _add_calibrate(commands: Commands) -> None:
    from cable_shape.command.calibrate import add_arguments, run

    calibrate = commands.add_parser(
        "calibrate",
        help="find a cable's stiffness from how it was seen",
        description="Fits the cable to observed points (a rosbag2, .npz or .csv, or clicks in a photograph), to one "
        "number (--sag) or to how it rests without load (--rest), and writes a cable file with error bars.",
    )
    add_arguments(calibrate)
    calibrate.set_defaults(run=run)


def _add_status(commands: Commands) -> None:
    status = commands.add_parser(
        "status",
        help="say what the running nodes say of themselves; needs a ROS, but no `ros2` command",
        description="Hears /diagnostics and asks the lifecycle of the nodes on this ROS_DOMAIN_ID, then prints their "
        "lines. Exit code 0: all are well; 1: one is not; 2: there is none.",
    )
    status.add_argument(
        "--node", default="", metavar="NAME", help="only this one, with its namespace: /cell/cable_shape_node"
    )
    status.add_argument("--timeout", type=float, default=5.0, metavar="S", help="wait so long for nodes to speak (5)")
    status.add_argument("--follow", action="store_true", help="go on, and tell each change, until Ctrl-C")
    status.add_argument("--values", action="store_true", help="with all numbers: rates, ages, times, counts")
    status.add_argument("--json", action="store_true", help="for a program, with all numbers")
    status.set_defaults(run=_status)


def _add_bench(commands: Commands) -> None:
    bench = commands.add_parser("bench", help="run a benchmark of the source tree; without a name: all of them")
    bench.add_argument("name", nargs="?", metavar="NAME", help="a benchmarks/bench_NAME.py")
    bench.add_argument("options", nargs=argparse.REMAINDER, metavar="...", help="options of that benchmark")
    bench.set_defaults(run=_bench)


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
        inertia=arguments.inertia,
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


def _view(arguments: argparse.Namespace) -> int:
    import ipaddress
    import os
    import subprocess

    from cable_shape.viewer.process import viewer_executable

    if not arguments.file.is_file():
        raise ArgumentError(f"{arguments.file}: no such file. `cable-shape replay` and scripts/demo write .rrd files.")
    try:
        address = str(ipaddress.ip_address(arguments.bind))
    except ValueError:
        raise ArgumentError.of("--bind", arguments.bind, "it must be an IP address", "Write 127.0.0.1.") from None
    command = [viewer_executable(), "--bind", address]
    screen = sys.platform != "linux" or os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    if arguments.web:
        command += ["--serve-web", "--port", "0", "--web-viewer-port", "0"]  # free ones; it prints them
    elif not screen:
        raise DependencyError(
            f"No screen: DISPLAY and WAYLAND_DISPLAY are not set. Copy {arguments.file} to a machine with one, or look "
            f"at it in a browser: cable-shape view --web {arguments.file}"
        )
    return subprocess.run([*command, str(arguments.file)], check=False).returncode


def _status(arguments: argparse.Namespace) -> int:
    from cable_shape.checks import number

    timeout = number("--timeout", arguments.timeout, above=0.0, unit="s")
    if arguments.json and arguments.follow:
        raise ArgumentError("--json is for one answer: leave it or --follow out.")
    from cable_shape.ros.status import run

    well = run(arguments.node, timeout, arguments.follow, arguments.values, arguments.json)
    return 0 if well else EXIT_UNWELL


def _bench(arguments: argparse.Namespace) -> int:
    import subprocess

    script = Path(cable_shape.__file__).resolve().parent.parent / "scripts" / "bench"
    if not script.is_file():
        raise DependencyError(
            f"{script} is not there: benchmarks are in the source tree only. Clone the repository, run scripts/bench."
        )
    named = [] if arguments.name is None else [arguments.name]
    return subprocess.run([str(script), *named, *arguments.options], check=False).returncode


def _doctor(arguments: argparse.Namespace) -> int:
    from cable_shape.command.doctor import examine
    from cable_shape.command.doctor_files import examine_files

    findings = [*examine(), *examine_files(arguments.cable, arguments.scene, arguments.robot, arguments.harness)]
    for finding in findings:
        print(f"{'ok  ' if not finding.remedy else 'FAIL'}  {finding.subject}: {finding.found}")
        if finding.remedy:
            print(f"      remedy: {finding.remedy}")
    faults = sum(1 for finding in findings if finding.remedy)
    print("all is well" if not faults else f"{faults} to repair")
    return EXIT_UNWELL if faults else 0


def _print_table(table: Iterable[tuple[str, str]]) -> None:
    for label, value in table:
        print(f"  {label:<26} {value}")


if __name__ == "__main__":
    sys.exit(main())
