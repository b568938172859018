"""The pages in examples run as they stand, and the documentation shows them all."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest
from nursery import run_program

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = sorted((ROOT / "examples").glob("*.py"))


@pytest.mark.parametrize("page", EXAMPLES, ids=lambda page: page.stem)
def test_an_example_is_a_page_that_runs(page: Path, tmp_path: Path) -> None:
    text = page.read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 80
    if "import rclpy" not in text:
        result = run_program(str(page), folder=tmp_path)
    else:  # a parser of ROS's imports a deprecated module
        result = subprocess.run([sys.executable, page], cwd=tmp_path, capture_output=True, text=True, timeout=600)
    assert result.returncode == 0, result.stderr
    assert result.stdout


def test_the_documentation_shows_every_example() -> None:
    shown = re.findall(r"\(\.\./examples/(\w+\.py)\)", (ROOT / "docs" / "examples.md").read_text(encoding="utf-8"))
    assert sorted(shown) == [page.name for page in EXAMPLES]
