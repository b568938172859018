"""The `cable-shape` command: in process, and once as a person types it."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from recordings import BEGIN, LEFT, cut, motion, pose_entry, storage_file, write_bag

import cable_shape as cs
from cable_shape.command import doctor
from cable_shape.command.cli import build_parser, main

ALONG_X = [0.5, 0.5, 0.5, 0.5]
CABLE = {"length": 1.0, "linear_density": 0.1, "bending_stiffness": 0.01}


def yaml_file(path: Path, values: object) -> str:
    path.write_text(yaml.safe_dump(values))
    return str(path)


def replay_arguments(tmp_path: Path, bag: Path, *more: str) -> list[str]:
    cable = yaml_file(tmp_path / "cable.yaml", CABLE)
    fixed = ["--model", "gradient4", "--points", "30", "--no-rrd", "--no-picture"]
    return ["replay", str(bag), "-o", str(tmp_path / "out"), "--cable", cable, *fixed, *more]


def error_line(capsys: pytest.CaptureFixture[str]) -> str:
    """The one line on stderr."""
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("cable-shape: error: ")
    return line


def test_replay_prints_the_figures_and_writes_the_outputs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene = yaml_file(tmp_path / "scene.yaml", {"obstacles": [{"name": "floor", "half_space": True}]})
    bag = write_bag(tmp_path / "bag", motion(5))
    assert main(replay_arguments(tmp_path, bag, "--scene", scene, "--end-kind", "swivel")) == 0
    captured = capsys.readouterr()
    assert captured.err == ""
    assert "cycles                     5" in captured.out
    assert "closest approach" in captured.out
    assert sorted(f.name for f in (tmp_path / "out").iterdir()) == ["replay", "report.json", "report.md"]
    settings = json.loads((tmp_path / "out/report.json").read_text())["settings"]
    assert settings["end_kind"] == "swivel"
    assert settings["points"] == 30
    assert settings["model"] == "gradient4"


def test_a_partly_readable_recording_has_an_exit_code_of_its_own(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = write_bag(tmp_path / "bag", motion(50))
    cut(bag, storage_file(bag).stat().st_size // 2)
    assert main(replay_arguments(tmp_path, bag)) == 3
    captured = capsys.readouterr()
    assert "cable-shape: error: not read: bag.mcap ends at byte" in captured.err
    assert "of 50 messages read" in captured.err
    assert "cycles" in captured.out


def test_refused_messages_are_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    entries = motion(4)
    entries[2] = pose_entry(LEFT, BEGIN + 10_000_000, (0, 0, 0), (0, 0, 0, 0))
    assert main(replay_arguments(tmp_path, write_bag(tmp_path / "bag", entries))) == 0
    text = capsys.readouterr().err
    assert f"cable-shape: warning: 1 messages of {LEFT} refused, quaternion not of unit length; the first: " in text
    assert "Normalise it" in text


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (["--cable", "missing.yaml"], "missing.yaml: no such file"),
        (["--scene", "missing.yaml"], "missing.yaml: no such file"),
        (["--robot", "missing.yaml"], "missing.yaml: no such file"),
        (["--model", "spline"], "model = 'spline' is not allowed"),
        (["--points", "1"], "points = 1 is not allowed"),
        (["--points", "0"], "points = 0 is not allowed"),
        (["--tolerance", "-1"], "tolerance = -1.0 is not allowed"),
        (["--max-skew", "0"], "max_skew = 0.0 is not allowed"),
        (["--start-offset", "0", "0", "0", "0", "0", "0", "0"], "--start-offset: quaternion"),
        (["--left-topic", "/left"], "has no topic /left. "),
    ],
)
def test_wrong_options_give_one_line_and_code_2(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], more: list[str], message: str
) -> None:
    bag = write_bag(tmp_path / "bag", motion(2))
    assert main(replay_arguments(tmp_path, bag, *more)) == 2
    assert message in error_line(capsys)


def test_replay_asks_for_the_cable(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bag = write_bag(tmp_path / "bag", motion(2))
    assert main(["replay", str(bag), "-o", str(tmp_path / "out")]) == 2
    line = error_line(capsys)
    assert "--cable CABLE.yaml is missing" in line
    assert "length [m], linear_density [kg/m] and bending_stiffness [N m^2]" in line


def test_an_unknown_key_of_the_cable_names_the_nearest(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bag = write_bag(tmp_path / "bag", motion(2))
    arguments = replay_arguments(tmp_path, bag)
    yaml_file(tmp_path / "cable.yaml", {**CABLE, "stifness": 1})
    assert main(arguments) == 2
    assert "cable.yaml: unknown key 'stifness'" in error_line(capsys)


def test_what_is_not_a_recording(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(replay_arguments(tmp_path, tmp_path / "nothing")) == 2
    assert "nothing: no such file or folder" in error_line(capsys)


def test_an_output_that_cannot_be_made(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bag = write_bag(tmp_path / "bag", motion(2))
    arguments = replay_arguments(tmp_path, bag)
    (tmp_path / "file").write_text("")
    arguments[arguments.index("-o") + 1] = str(tmp_path / "file" / "out")
    assert main(arguments) == 2
    assert "Check the path, permissions and free space" in error_line(capsys)


def test_debug_shows_the_traceback(tmp_path: Path) -> None:
    with pytest.raises(cs.BagError):
        main(["--debug", *replay_arguments(tmp_path, tmp_path / "nothing")])


def test_predict_prints_a_table_and_writes_files(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    case = yaml_file(
        tmp_path / "held.yaml",
        {
            "cable": CABLE,
            "start": {"position": [0, 0, 0], "quaternion": ALONG_X},
            "end": {"position": [0.8, 0, 0], "quaternion": ALONG_X},
        },
    )
    files = [str(tmp_path / f"out.{kind}") for kind in ("json", "csv")]
    assert main(["predict", case, "--model", "gradient4", "--points", "25", "-o", files[0], "-o", files[1]]) == 0
    text = capsys.readouterr().out
    assert text.startswith("held\n")
    for label in ("model", "status", "error estimate", "energy", "force on the end grip", "smallest bend radius"):
        assert f"  {label} " in text
    assert len(json.loads(Path(files[0]).read_text())["arc_length"]) == 25
    assert len(Path(files[1]).read_text().splitlines()) == 26


def test_predict_exits_with_2_when_the_shape_is_not_to_be_used(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    values = {"cable": CABLE, "start": {"position": [0, 0, 0]}, "end": {"position": [0, 9, 0]}}
    out = tmp_path / "out.json"
    assert main(["predict", yaml_file(tmp_path / "far.yaml", values), "-o", str(out)]) == 2
    said = capsys.readouterr()
    assert "OVERSTRETCHED" in said.out
    assert "cable-shape: error: OVERSTRETCHED: do not act on this shape. " in said.err
    assert json.loads(out.read_text())["usable"] is False


def test_predict_and_replay_remark_what_is_hardly_meant(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    ends = {"start": {"position": [0, 0, 0]}, "end": {"position": [0, 900, 0]}}
    long = yaml_file(tmp_path / "long.yaml", {"cable": {**CABLE, "length": 1200}, **ends})
    main(["predict", long])
    note = "cable-shape: note: length = 1200 m is no length between two grippers. Everything is in SI units"
    assert note in capsys.readouterr().err
    yaml_file(tmp_path / "cable.yaml", {**CABLE, "length": 1200})
    main(["replay", "nowhere", "-o", str(tmp_path / "out"), "--cable", str(tmp_path / "cable.yaml")])
    assert note in capsys.readouterr().err
    values = {"cable": CABLE, "start": {"position": [0, 0, 0]}, "end": {"position": [0, 0.8, 0]}}
    assert main(["predict", yaml_file(tmp_path / "held.yaml", values)]) == 0
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["predict", "missing.yaml"], "missing.yaml: no such file"),
        (["predict", "missing.yaml", "-o", "out.txt"], "its ending must be one of .json, .csv, .png"),
        (["view", "missing.rrd"], "missing.rrd: no such file"),
        (["view", "--bind", "everywhere", __file__], "--bind = 'everywhere' is not allowed: it must be an IP address"),
    ],
)
def test_other_commands_say_what_is_wrong(
    capsys: pytest.CaptureFixture[str], arguments: list[str], message: str
) -> None:
    assert main(arguments) == 2
    assert message in error_line(capsys)


def test_view_without_a_screen_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    (tmp_path / "a.rrd").write_bytes(b"")
    assert main(["view", str(tmp_path / "a.rrd")]) == 2
    line = error_line(capsys)
    assert "No screen" in line
    assert "cable-shape view --web" in line


def test_bench_is_in_the_source_tree_only(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    parsed = build_parser().parse_args(["bench", "gradient", "--quick"])
    assert (parsed.name, parsed.options) == ("gradient", ["--quick"])
    monkeypatch.setattr("cable_shape.__file__", str(tmp_path / "site-packages" / "cable_shape" / "__init__.py"))
    assert main(["bench", "gradient"]) == 2
    assert "benchmarks are in the source tree only" in error_line(capsys)


def test_doctor_finds_this_environment_well(capsys: pytest.CaptureFixture[str]) -> None:
    code = main(["doctor"])
    text = capsys.readouterr().out
    assert code == 0, text
    assert text.endswith("all is well\n")
    for subject in ("Python", "numpy", "pin", "rclpy", "cable_shape_msgs.msg", "kernel cache", "kernels"):
        assert f"ok    {subject}: " in text


def test_doctor_names_the_remedy(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "LIBRARIES", {"no-such-distribution": "nothing", "PyYAML": "no_such_module"})
    assert main(["doctor"]) == 1
    text = capsys.readouterr().out
    assert "FAIL  no-such-distribution: not installed" in text
    assert "FAIL  PyYAML: " in text
    assert "but import no_such_module fails" in text
    assert "remedy: Run scripts/test once" in text
    assert text.endswith("2 to repair\n")


def test_doctor_sees_a_library_that_hides_another(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "hidden_numpy.py").write_text("__version__ = '1.26'\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(doctor, "LIBRARIES", {"numpy": "hidden_numpy"})
    (finding,) = [finding for finding in doctor.examine() if finding.subject == "numpy"]
    assert "of another installation hides the one in" in finding.remedy
    assert str(tmp_path) in finding.found


def test_an_unknown_command_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        main(["replya"])
    assert caught.value.code == 2
    assert "invalid choice: 'replya'" in capsys.readouterr().err


def run_command(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = Path(sys.executable).parent / "cable-shape"
    if not command.is_file():
        pytest.skip(f"{command} is not installed")
    return subprocess.run([command, *arguments], capture_output=True, text=True, timeout=120, check=False)


def test_the_installed_command_runs() -> None:
    done = run_command("--version")
    assert (done.returncode, done.stdout) == (0, f"cable-shape {cs.__version__}\n")


def test_the_installed_command_replays(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", motion(3))
    done = run_command(*replay_arguments(tmp_path, bag))
    assert done.returncode == 0, done.stderr
    assert "cycles                     3" in done.stdout
    assert "Traceback" not in done.stderr


def test_replay_needs_no_middleware(tmp_path: Path) -> None:
    """In a fresh process, since other tests import rclpy."""
    bag = write_bag(tmp_path / "bag", motion(3))
    code = (
        "import sys; from cable_shape.command.cli import main; "
        f"assert main({replay_arguments(tmp_path, bag)!r}) == 0; "
        "print([m for m in ('rclpy', 'rerun', 'pinocchio', 'mujoco', 'matplotlib') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] == "[]"
