"""The command `cable-shape calibrate`."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from cable_shape.cable.cable import Cable
from cable_shape.cable.cable_file import AS_GIVEN, SIDES, CableFile, Held
from cable_shape.calibration.photo import PhotoCalibration, calibrate_photo, is_photo
from cable_shape.calibration.result import Calibration
from cable_shape.command.units import slips_of
from cable_shape.errors import ArgumentError
from cable_shape.pose import Grip, Pose
from cable_shape.uncertainty.uncertainty import Uncertainty


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options."""
    parser.add_argument(
        "source",
        type=Path,
        nargs="?",
        metavar="SOURCE",
        help="a rosbag2, .npz or .csv with grips and points, or a .csv of clicks in a photograph",
    )
    parser.add_argument("-o", "--out", type=Path, metavar="CABLE.yaml", help="write the calibrated cable there")
    parser.add_argument(
        "--force", action="store_true", help="write -o and --uncertainty though the fit must not be used; exit code 0"
    )
    parser.add_argument("--report", type=Path, metavar="FILE", help="write the report, too: .json, .txt or .png")
    parser.add_argument("--uncertainty", type=Path, metavar="FILE.yaml", help="write what is left open, for a tube")
    parser.add_argument("--cable", type=Path, metavar="CABLE.yaml", help="where the fit begins, and what is not fitted")
    parser.add_argument("--length", type=float, metavar="M", help="in place of --cable: length between the grips")
    parser.add_argument("--mass", type=float, metavar="KG", help="in place of --cable: mass of that length")
    parser.add_argument("--diameter", type=float, default=0.008, metavar="M", help="with --length (0.008)")
    parser.add_argument(
        "--fit",
        default="bending_stiffness",
        metavar="NAMES",
        help="with commas; see docs/calibration.md (bending_stiffness)",
    )
    parser.add_argument(
        "--prior",
        action="append",
        default=[],
        metavar="NAME=SD[,..]",
        help="standard deviations about where the fit begins; repeatable",
    )
    parser.add_argument(
        "--supports",
        default="5",
        metavar="N",
        help="of what varies along the cable, 3 to 33, or auto: by cross validation over observations left out (5)",
    )
    parser.add_argument(
        "--optional", default="", metavar="NAMES", help="with commas: fitted where the same cross validation says so"
    )
    parser.add_argument("--start-kind", choices=("clamped", "swivel", "pinned"), default="clamped")
    parser.add_argument(
        "--end-kind", choices=("clamped", "swivel", "pinned"), help="swivel for a recording, clamped otherwise"
    )
    for side in SIDES:
        parser.add_argument(
            f"--{side}-offset",
            type=float,
            nargs=7,
            metavar=("X", "Y", "Z", "QX", "QY", "QZ", "QW"),
            help=f"the cable frame in that of the poses of the {side}, as for replay; the default is that frame itself",
        )
    parser.add_argument("--frames", type=int, default=50, metavar="N", help="of a recording, evenly spread (50)")
    parser.add_argument("--inertia", action="store_true", help="of a recording: markers' accelerations load the cable")
    parser.add_argument(
        "--motion", action="store_true", help="the cable swings: run through whole recordings; every frame counts"
    )
    parser.add_argument("--left-topic", default="/left_gripper/pose", metavar="TOPIC")
    parser.add_argument("--right-topic", default="/right_gripper/pose", metavar="TOPIC")
    parser.add_argument("--markers-topic", default="/cable/markers", metavar="TOPIC")
    photo = parser.add_argument_group("from a photograph", "a .csv with columns what, u, v; see docs/calibration.md")
    photo.add_argument("--click-error", type=float, default=2.0, metavar="PX", help="standard error of a click (2)")
    photo.add_argument("--picture", type=Path, metavar="IMAGE", help="the photograph, to be drawn in --report FILE.png")
    parser.add_argument(
        "--rest", action="store_true", help="SOURCE is a .csv with x, y, z of a cable that lies without load"
    )
    sag = parser.add_argument_group("from one number", "a cable held as --held says hangs --sag below its start")
    sag.add_argument("--sag", type=float, metavar="M")
    sag.add_argument("--chord", type=float, metavar="M", help="distance of the two level ends; also for a photograph")
    sag.add_argument("--held", choices=("level", "pinned", "free"), default="level", help="free: one end only (level)")
    sag.add_argument("--sag-error", type=float, default=0.003, metavar="M", help="standard error of the sag (0.003)")


def run(arguments: argparse.Namespace) -> int:
    """Calibrates, prints the report and writes what is asked for."""
    if (arguments.sag is None) == (arguments.source is None):
        raise ArgumentError("Give either SOURCE, a file with observations, or --sag, one number.")
    if arguments.report is not None and arguments.report.suffix not in (".json", ".txt", ".png"):
        raise ArgumentError(f"--report {arguments.report}: its ending must be .json, .txt or .png.")
    cable = _cable(arguments)
    photo = None
    if arguments.source is None:
        found = _from_sag(arguments, cable)
    elif arguments.rest:
        found = _from_rest(arguments, cable)
    elif arguments.source.suffix == ".csv" and is_photo(arguments.source):
        photo = _from_photo(arguments, cable)
        found = photo.found
    else:
        found = _from_source(arguments, cable)
    trouble = found.trouble
    if trouble:
        print(f"cable-shape: error: {trouble}", file=sys.stderr)
    print(found.report())
    print(f"{'cable':<22} {found.cable.describe()}")
    if found.file.describe():
        print(f"{'grips':<22} {found.file.describe()}")
    for slip in slips_of(found.cable):
        print(f"cable-shape: note: {slip}", file=sys.stderr)
    asked = [path for path in (arguments.out, arguments.uncertainty) if path is not None]
    if trouble and not arguments.force:
        for path in asked:
            print(f"not written: {path}: it is no fit. --force writes it all the same", file=sys.stderr)
    else:
        if arguments.out is not None:
            print(f"written: {found.save(arguments.out)}")
        if arguments.uncertainty is not None:
            print(f"written: {Uncertainty.of(found).save(arguments.uncertainty)}")
    if arguments.report is not None:
        if photo is not None and arguments.report.suffix == ".png":
            from cable_shape.calibration.picture import draw_photo

            draw_photo(photo, arguments.report, arguments.picture)
        else:
            _write_report(found, arguments.report)
        print(f"written: {arguments.report}")
    return 2 if trouble and not arguments.force else 0


def _cable(arguments: argparse.Namespace) -> Cable:
    if arguments.cable is not None:
        file = CableFile.from_yaml(arguments.cable)
        if any(held.correction is not None for held in file.held):
            text = f"{arguments.cable} corrects its grips: this fit begins without that, so fit offsets and tilts again"
            print(f"cable-shape: note: {text}", file=sys.stderr)
        return file.cable
    if arguments.length is None or arguments.mass is None:
        raise ArgumentError("Give --cable CABLE.yaml, or --length [m] and --mass [kg] of the cable between the grips.")
    # a start only: a cable that bends under its own weight over a third of its length
    density = Cable(arguments.length, arguments.mass / arguments.length, 1.0).linear_density
    stiffness = max(density * 9.81 * (arguments.length / 3.0) ** 3 / 3.0, 1e-9)
    return Cable(arguments.length, density, stiffness, diameter=arguments.diameter)


def _from_sag(arguments: argparse.Namespace, cable: Cable) -> Calibration:
    from cable_shape.calibration.sag import calibrate_sag

    return calibrate_sag(
        cable, arguments.sag, chord=arguments.chord, held=arguments.held, sag_error=arguments.sag_error
    )


def _from_rest(arguments: argparse.Namespace, cable: Cable) -> Calibration:
    from cable_shape.calibration.memory import rest_curvature_from
    from cable_shape.replay.observations import load_points

    return rest_curvature_from(load_points(arguments.source), cable)


def _from_photo(arguments: argparse.Namespace, cable: Cable) -> PhotoCalibration:
    return calibrate_photo(
        arguments.source,
        cable,
        _names(arguments.fit),
        chord=arguments.chord,
        click_error=arguments.click_error,
        priors=_priors(arguments),
    )


def _from_source(arguments: argparse.Namespace, cable: Cable) -> Calibration:
    from cable_shape.calibration.fit import calibrate
    from cable_shape.replay.observations import load_observations

    recorded = arguments.source.suffix not in (".npz", ".csv")
    options: dict[str, Any] = {}
    if recorded:
        names = ("left_topic", "right_topic", "markers_topic", "frames", "inertia", "motion")
        options = {name: getattr(arguments, name) for name in names}
    kinds = (arguments.start_kind, arguments.end_kind or ("swivel" if recorded else "clamped"))
    start, end = (_offset(side, getattr(arguments, f"{side}_offset")) for side in SIDES)
    observations = load_observations(arguments.source, kinds, **options)
    for one in observations:
        one.start = start.grip(one.start)
        one.end = end.grip(one.end) if isinstance(one.end, Grip) else one.end
    return calibrate(
        observations, cable, _names(arguments.fit), priors=_priors(arguments), supports=_supports(arguments.supports),
        optional=_names(arguments.optional), motion=arguments.motion,
    )  # fmt: skip


def _offset(side: str, given: Sequence[float] | None) -> Held:
    """How one end is held beside its poses."""
    try:
        return AS_GIVEN if given is None else Held(offset=Pose(given[:3], given[3:]))
    except ArgumentError as error:
        raise ArgumentError(f"--{side}-offset: {error}") from None


def _names(text: str) -> tuple[str, ...]:
    return tuple(name.strip() for name in text.split(",") if name.strip())


def _supports(text: str) -> int | str:
    """A whole number, or "auto"."""
    if text == "auto":
        return text
    try:
        return int(text)
    except ValueError:
        raise ArgumentError.of("--supports", text, "it must be a whole number or auto", "As in --supports 9.") from None


def _priors(arguments: argparse.Namespace) -> dict[str, float]:
    return dict(_prior(text.strip()) for several in arguments.prior for text in several.split(","))


def _prior(text: str) -> tuple[str, float]:
    """NAME=SD."""
    name, _, value = text.partition("=")
    try:
        return name, float(value)
    except ValueError:
        raise ArgumentError.of("--prior", text, "it must be NAME=SD", "As in --prior length=0.005.") from None


def _write_report(found: Calibration, path: Path) -> None:
    if path.suffix == ".png":
        from cable_shape.calibration.picture import draw

        draw(found, path)
    elif path.suffix == ".json":
        path.write_text(json.dumps(found.as_dict(), indent=1) + "\n", encoding="utf-8")
    else:
        path.write_text(found.report() + "\n", encoding="utf-8")
