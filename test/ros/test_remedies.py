"""What the tables of docs/trouble.md and docs/node.md say that diagnostics say stands in the code."""

import ast
import re
from pathlib import Path

import pytest

import cable_shape
from cable_shape.shape import Status

PLACES = {"TOPIC", "REASON", "...", "p50"}  # where the code puts a value
ROOT = Path(__file__).resolve().parents[2]


def texts():
    """Every string of the node's code; a value inside one is a blank."""
    package = Path(cable_shape.__file__).parent
    found = [f"{status.name}" for status in Status]
    beside = (
        "messages/pairing.py",
        "messages/transforms.py",
        "files/files.py",
        "files/yaml_files.py",
        "viewer/process.py",
        "solve/touching/touching.py",
    )
    for file in (*(package / "ros").glob("*.py"), *(package / name for name in beside)):
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.JoinedStr):
                found.append("".join(p.value if isinstance(p, ast.Constant) else " " for p in node.values))
            elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                found.append(node.value)
    return [" ".join(text.split()) for text in found]


def rows(file, heading):
    """The cells of the first table below a heading, without its head."""
    lines = file.read_text().split(heading, 1)[1].split("\n| --- ", 1)[1].splitlines()[1:]
    for line in lines:
        if not line.startswith("|"):
            return
        yield [cell.strip() for cell in line.strip("|").split("|")]


@pytest.mark.parametrize(("line", "says", "do"), list(rows(ROOT / "docs" / "trouble.md", "# When something is wrong")))
def test_what_the_table_says_the_diagnostics_say_is_what_they_say(line, says, do):
    assert line.strip("`") in ("lifecycle", "input", "prediction", "cable", "any")
    assert do
    quoted = re.findall(r"`([^`]+)`", says)
    assert quoted or line == "`cable`"
    for fragment in quoted:
        assert any(fragment in text for text in texts()), fragment


@pytest.mark.parametrize(("line", "values"), list(rows(ROOT / "docs" / "node.md", "What the lines hold as values")))
def test_the_values_that_the_documentation_names_are_given(line, values):
    for fragment in re.findall(r"`([^`]+)`", values):
        words = [word.strip(":") for word in fragment.split() if word not in PLACES]
        pattern = re.compile(".*".join(map(re.escape, words)))
        assert any(pattern.search(text) for text in texts()), fragment
