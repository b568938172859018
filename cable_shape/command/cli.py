"""The `cable-shape` command.

Exit codes: 0 all is well; 1 `doctor` found something to repair, or a node of `status` is not well; 2 wrong arguments,
input that cannot be used, or a result that must not be: a shape of `predict`, a fit of `calibrate`; 3 a part of the
recording of a `replay` could not be read; 130 interrupted.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NoReturn

import cable_shape
from cable_shape.command import EXIT_ERROR, EXIT_INTERRUPTED, EXIT_UNWELL, predictions
from cable_shape.command.predictions import Commands
from cable_shape.errors import ArgumentError, CableShapeError, DependencyError, lacking

LOOPBACK = "127.0.0.1"


def main(argv: Sequence[str] | None = None) -> int:
    """Runs one command and returns its exit code."""
    given = sys.argv[1:] if argv is None else list(argv)
    arguments = build_parser(next((word for word in given if word in COMMANDS), None)).parse_args(given)
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


def build_parser(command: str | None = None) -> argparse.ArgumentParser:
    """All commands and their options; of one command, that alone, which imports no more than it needs."""
    parser = argparse.ArgumentParser(
        prog="cable-shape",
        description="Predicts the quasistatic shape of the cable held between two grippers.",
        epilog="Exit codes: 0 well, 1 doctor or status found something, 2 error or a result that must not be used, "
        "3 only a part of a recording could be read, 130 interrupted.",
    )
    parser.add_argument("--version", action="version", version=f"cable-shape {cable_shape.__version__}")
    parser.add_argument("--debug", action="store_true", help="show the traceback of an error")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    for name, add in COMMANDS.items():
        if command in (None, name):
            add(commands)
    return parser


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


def _add_study(commands: Commands) -> None:
    from cable_shape.command.study import add_arguments, run

    parser = commands.add_parser(
        "study",
        help="ask one question of many cables: lengths, clips, tolerances",
        description="Solves what STUDY.yaml asks for; writes OUT/results.csv, report.html and recordings. "
        "Interrupted, the same command goes on.",
    )
    add_arguments(parser)
    parser.set_defaults(run=run)


def _add_optimise(commands: Commands) -> None:
    from cable_shape.command.optimise import add_arguments, run

    parser = commands.add_parser(
        "optimise",
        help="the point of a study that is furthest from its nearest limit",
        description="Looks between the least and the greatest values that STUDY.yaml lets its places take.",
    )
    add_arguments(parser)
    parser.set_defaults(run=run)


def _add_tolerances(commands: Commands) -> None:
    from cable_shape.command.tolerances import add_arguments, run

    parser = commands.add_parser(
        "tolerances",
        help="how sure shape and measures are, and what makes them unsure",
        description="Draws what STUDY.yaml has distributions of: an envelope, and each source's share of the variance.",
    )
    add_arguments(parser)
    parser.set_defaults(run=run)


def _add_sweep(commands: Commands) -> None:
    from cable_shape.command.sweep import add_arguments, run

    parser = commands.add_parser(
        "sweep",
        help="the space that a cable sweeps, and which body it meets, where and when",
        description="Follows the motion of STUDY.yaml, nothing varied, and writes a closed mesh that holds all of it.",
    )
    add_arguments(parser)
    parser.set_defaults(run=run)


def _add_export(commands: Commands) -> None:
    from cable_shape.command.export_files import add_arguments, run

    parser = commands.add_parser(
        "export",
        help="a motion or a shape as STL, OBJ, GLB, USD, DXF, CSV, MJCF or netCDF",
        description="Follows the motion of STUDY.yaml, nothing varied, and writes it in the format of FILE's ending.",
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


def _add_doctor(commands: Commands) -> None:
    doctor = commands.add_parser("doctor", help="check libraries, messages, compiled kernels, and your files")
    for name in ("cable", "harness", "scene", "robot"):
        doctor.add_argument(f"--{name}", type=Path, metavar=f"{name.upper()}.yaml", help=f"also look at this {name}")
    doctor.set_defaults(run=_doctor)


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


COMMANDS: dict[str, Callable[[Commands], None]] = {
    "replay": predictions.add_replay,
    "predict": predictions.add_predict,
    "import": _add_import,
    "study": _add_study,
    "optimise": _add_optimise,
    "tolerances": _add_tolerances,
    "sweep": _add_sweep,
    "export": _add_export,
    "view": _add_view,
    "calibrate": _add_calibrate,
    "status": _add_status,
    "bench": _add_bench,
    "doctor": _add_doctor,
}


if __name__ == "__main__":
    sys.exit(main())
