"""What the README promises: its Python runs, the files it names exist, and its commands are the repository's own."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from cable_shape.report import WarningKind
from cable_shape.scene import CLIP_KINDS, CONTACT_KINDS, SCENE_KEYS, Scene
from cable_shape.scene_files import SOLID_KEYS
from cable_shape.solvers import MODELS
from cable_shape.warn import Levels

ROOT = Path(__file__).resolve().parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")
PLANNING = (ROOT / "docs" / "planning.md").read_text(encoding="utf-8")
PYTHON = re.findall(r"```python\n(.*?)```", README + PLANNING, flags=re.DOTALL)
DOCUMENTS = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]


@pytest.mark.parametrize("number", range(len(PYTHON)))
def test_python_blocks_run_as_they_stand(number: int) -> None:
    result = subprocess.run(
        [sys.executable, "-W", "error", "-c", PYTHON[number]],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert result.returncode == 0, result.stderr
    assert result.stdout, "an example shows something"


def test_there_are_python_blocks() -> None:
    assert len(PYTHON) >= 2


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda d: d.name)
def test_links_and_pictures_exist(document: Path) -> None:
    for target in re.findall(r"\]\(([^)#]+)[^)]*\)", document.read_text(encoding="utf-8")):
        if not target.startswith("http"):
            assert (document.parent / target).exists(), f"{document.name} links to {target}"


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
    table = re.search(rf"^\| `?{head}`? \|.*\n\| --- .*\n((?:\|.*\n)+)", README, flags=re.MULTILINE)
    assert table
    listed = [re.match(r"\| `(\w+)`", row) for row in table[1].splitlines()]
    assert all(listed), "every row begins with a name"
    assert sorted(row[1] for row in listed) == sorted(known)


def test_the_levels_of_warnings_are_those_of_the_code() -> None:
    """The last two columns of the table of margins: from where on a limit's use is a warning, and an error."""
    levels = {kind: Levels.of(kind, Scene(warn_distance=0.03, error_distance=0.01)) for kind in WarningKind}
    for kind in set(WarningKind) - {WarningKind.SNAP, WarningKind.STATUS}:
        row = re.search(rf"^\| `{kind.name}`.*\| ([^|]*) \| ([^|]*) \|$", README, flags=re.MULTILINE)
        assert row
        assert float(row[1]) == pytest.approx(levels[kind].warn)
        error = 2.0 - 0.01 / 0.03 if row[2] == "`error_distance`" else float(row[2])
        assert error == pytest.approx(levels[kind].error)


def test_the_two_commands_are_executable() -> None:
    first_block = re.search(r"```bash\n(.*?)```", README, flags=re.DOTALL)
    assert first_block
    commands = [line.split()[0] for line in first_block[1].splitlines() if line]
    assert commands == ["scripts/demo", "scripts/test"]
    for command in commands:
        assert (ROOT / command).stat().st_mode & 0o111, f"{command} is not executable"
