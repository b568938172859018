"""What README and docs promise: Python that runs, files that exist, commands that are the repository's own."""

import ast
import re
import shlex
from pathlib import Path

import pytest
from nursery import run_program
from recordings import motion, write_bag
from replays import bag_of, mounted

import cable_shape as cs
from cable_shape.command.cli import build_parser, main
from cable_shape.prediction.solvers import MODELS
from cable_shape.safety.report import WarningKind
from cable_shape.safety.warnings import Levels
from cable_shape.scene.scene import CLIP_KINDS, CONTACT_KINDS, SCENE_KEYS
from cable_shape.scene.scene_files import SOLID_KEYS

ROOT = Path(__file__).resolve().parents[2]
DOCUMENTS = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
README = DOCUMENTS[0].read_text(encoding="utf-8")
ALL = "".join(document.read_text(encoding="utf-8") for document in DOCUMENTS)
#: Whole programs; docs/viewer.md shows lines for one, and the README's client runs beside a node, in test/ros.
PROGRAMS = [document for document in DOCUMENTS if document.stem != "viewer"]
PYTHON = [
    block
    for document in PROGRAMS
    for block in re.findall(r"```python\n(.*?)```", document.read_text(encoding="utf-8"), flags=re.DOTALL)
    if '"cable/shape"' not in block
]
BASH = {
    document.stem: re.findall(r"```bash\n(.*?)```", document.read_text(encoding="utf-8"), flags=re.DOTALL)
    for document in DOCUMENTS
    if document.stem != "security"  # SROS 2 is of apt; its files are looked at in test/ros/test_security.py
}
#: Pages of a terminal, of some 45 lines that are some 120 wide.
SCREENS, LINES, WIDTH = 3, 45, 120


@pytest.mark.parametrize("number", range(len(PYTHON)))
def test_python_blocks_run_as_they_stand(number: int, tmp_path: Path) -> None:
    (tmp_path / "config").symlink_to(ROOT / "config")
    result = run_program("-c", PYTHON[number], folder=tmp_path)
    assert result.returncode == 0, result.stderr
    assert result.stdout, "an example shows something"


@pytest.mark.parametrize("program", [*PYTHON, *(file.read_text() for file in sorted(ROOT.glob("examples/*.py")))])
def test_programs_take_what_the_package_exports(program: str) -> None:
    """And modules only by importing them, as the processes that run them here have imported all."""
    for node in ast.walk(ast.parse(program)):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "cs":
            assert node.attr in cs.__all__


def test_there_are_python_blocks() -> None:
    assert len(PYTHON) >= 2


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda d: d.name)
def test_links_and_pictures_exist(document: Path) -> None:
    for target, _, part in re.findall(r"\]\(([^)#]+)(#([^)]*))?\)", document.read_text(encoding="utf-8")):
        if not target.startswith("http"):
            file = document.parent / target
            assert file.exists(), f"{document.name} links to {target}"
            headings = re.findall(r"^#+ (.*)$", file.read_text(encoding="utf-8"), flags=re.MULTILINE) if part else []
            parts = {"", *(heading.lower().replace(" ", "-") for heading in headings)}
            assert part in parts, f"{document.name} links to {target}#{part}"


@pytest.mark.parametrize(
    ("head", "known"),
    [
        ("key of a scene", SCENE_KEYS),
        ("key of a solid", SOLID_KEYS),
        ("clip", CLIP_KINDS),
        ("contact", CONTACT_KINDS),
        ("model", MODELS),
        ("kind", [kind.name for kind in WarningKind]),
    ],
)
def test_tables_are_complete(head: str, known: tuple[str, ...]) -> None:
    table = re.search(rf"^\| `?{head}`? \|.*\n\| --- .*\n((?:\|.*\n)+)", ALL, flags=re.MULTILINE)
    assert table
    listed = [re.match(r"\| `(\w+)`", row) for row in table[1].splitlines()]
    assert all(listed), "every row begins with a name"
    assert sorted(row[1] for row in listed) == sorted(known)


def test_the_levels_of_warnings_are_those_of_the_code() -> None:
    """The last two columns of the table of margins: from where on a limit's use is a warning, and an error."""
    levels = {kind: Levels.of(kind, warn_distance=0.03, error_distance=0.01) for kind in WarningKind}
    for kind in set(WarningKind) - {WarningKind.SNAP, WarningKind.STATUS}:
        row = re.search(rf"^\| `{kind.name}`.*\| ([^|]*) \| ([^|]*) \|$", ALL, flags=re.MULTILINE)
        assert row
        assert float(row[1]) == pytest.approx(levels[kind].warn)
        error = 2.0 - 0.01 / 0.03 if row[2] == "`error_distance`" else float(row[2])
        assert error == pytest.approx(levels[kind].error)


def test_the_readme_is_three_screens_long() -> None:
    wrapped = sum(max(1, -(-len(line) // WIDTH)) for line in README.splitlines())
    assert wrapped <= SCREENS * LINES


def test_the_two_commands_are_executable() -> None:
    commands = [line.split()[0] for line in BASH["README"][0].splitlines() if line]
    assert commands == ["scripts/demo", "scripts/test"]
    for command in commands:
        assert (ROOT / command).stat().st_mode & 0o111, f"{command} is not executable"


def test_every_command_is_one_that_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Those of the command line as they stand, with recordings for BAG, SEEN and OTHER; the node's runs in test/ros."""
    bag, seen = write_bag(tmp_path / "bag", motion(5)), bag_of(tmp_path / "seen", mounted(3, 8))
    monkeypatch.setenv("COLUMNS", "200")
    words = {
        "BAG": str(bag),
        "SEEN": str(seen),
        "OTHER": str(seen),
        "OUT": str(tmp_path / "out"),
        "config/cables/demo.yaml": str(ROOT / "config/cables/demo.yaml"),
    }
    ran = []
    monkeypatch.chdir(tmp_path)
    for line in "".join("".join(blocks) for blocks in BASH.values()).replace("\\\n", " ").splitlines():
        command, *arguments = shlex.split(line, comments=True) or [""]
        if command == "" or command in ("source", "cable_shape_node", "pip"):
            continue
        if command.startswith("scripts/"):
            assert (ROOT / command).stat().st_mode & 0o111
            continue
        assert command == "cable-shape", line
        arguments = [words.get(word, word).replace("OUT/", f"{tmp_path}/out/") for word in arguments]
        assert build_parser().parse_args(arguments).run
        if arguments[0] == "replay" or {"--sag", str(seen)} & set(arguments):
            assert main(arguments) == 0, line
            ran.append(arguments[0])
    assert sorted(ran) == ["calibrate", "calibrate", "replay", "replay"]


def test_benches_that_the_documentation_names_are_all_there_are() -> None:
    sentence = re.search(r"with a name, one of them: (.*?)\.", " ".join(ALL.split()))
    assert sentence
    named = set(re.findall(r"`(\w+)`", sentence[1]))
    assert named == {file.stem.removeprefix("bench_") for file in (ROOT / "benchmarks").glob("bench_*.py")} - {"all"}


def test_topics_and_services_are_those_of_the_node() -> None:
    """Of docs/node.md: what the sources of the node publish, hear and serve, and nothing else."""
    text = (ROOT / "docs" / "node.md").read_text(encoding="utf-8").split("## Topics")[1].split("\n## ")[0]
    listed = {
        name
        for row in re.findall(r"^\| (`[^|]*) \|", text, flags=re.MULTILINE)
        for name in re.findall(r"`([\w/]+)`", row.partition(" (")[0])
    }
    sources = "".join(file.read_text(encoding="utf-8") for file in sorted((ROOT / "cable_shape" / "ros").glob("*.py")))
    used = set(re.findall(r"\"((?:cable/\w+)|/diagnostics|joint_states|/tf|/tf_static|collision_object)\"", sources))
    poses = {"left_gripper/pose", "right_gripper/pose", "HARNESS/SEGMENT_start/pose", "HARNESS/SEGMENT_end/pose"}
    assert listed == used | poses
