"""The pages in examples run as they stand."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = sorted((Path(__file__).resolve().parents[2] / "examples").glob("*.py"))


@pytest.mark.parametrize("page", EXAMPLES, ids=lambda page: page.stem)
def test_an_example_is_a_page_that_runs(page: Path, tmp_path: Path) -> None:
    assert len(page.read_text(encoding="utf-8").splitlines()) <= 80
    result = subprocess.run(
        [sys.executable, "-W", "error", str(page)],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )
    assert result.returncode == 0, result.stderr
    assert result.stdout
