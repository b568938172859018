"""The set-up that both commands share: it stops with a remedy, is idempotent, and keeps a sourced ROS out."""

import os
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
NEEDED = (
    "bash",
    "cat",
    "cut",
    "dirname",
    "basename",
    "find",
    "sort",
    "sha256sum",
    "tail",
    "rm",
    "mkdir",
    "head",
    "env",
)


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """A copy of the scripts and of what the set-up reads, without .venv."""
    copy = tmp_path / "checkout"
    shutil.copytree(ROOT / "scripts", copy / "scripts")
    for name in ("requirements.txt", "setup.py", "setup.cfg", "package.xml", "pyproject.toml"):
        shutil.copy(ROOT / name, copy / name)
    return copy


def tools(folder: Path, *names: str) -> str:
    """A PATH with only these tools."""
    folder.mkdir()
    for name in names:
        where = shutil.which(name)
        assert where, f"{name} is needed for this test"
        (folder / name).symlink_to(where)
    return str(folder)


def run_setup(checkout: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        ["bash", "-c", "source scripts/_setup && echo ready"],
        cwd=checkout,
        env={"HOME": os.environ.get("HOME", "/"), **environment},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )


def test_a_missing_compiler_is_named_with_its_package(checkout: Path, tmp_path: Path) -> None:
    path = tools(tmp_path / "bin", *NEEDED, "git")
    result = run_setup(checkout, PATH=path, PYTHON=os.path.realpath("/proc/self/exe"))
    assert result.returncode == 1
    assert "missing on this machine: g++" in result.stderr
    assert "remedy: sudo apt-get install g++" in result.stderr
    assert not (checkout / ".venv").exists()


def test_no_suitable_python_is_named_with_a_remedy(checkout: Path, tmp_path: Path) -> None:
    path = tools(tmp_path / "bin", *NEEDED, "git", "g++", "false")
    result = run_setup(checkout, PATH=path, PYTHON="false")
    assert result.returncode == 1
    assert "no Python 3.11, 3.12 or 3.13 found" in result.stderr
    assert "PYTHON=/path/to/python3.12" in result.stderr


def test_it_runs_again_in_seconds_and_drops_a_sourced_ros() -> None:
    """In this very checkout, which the test command has just set up."""
    if not (ROOT / ".venv/.cable_shape/package").exists():
        pytest.skip("this checkout was not set up by scripts/test")
    script = 'source scripts/_setup; echo "[${PYTHONPATH-}][${AMENT_PREFIX_PATH-}][${LD_LIBRARY_PATH-}][$python]"'
    result = subprocess.run(
        ["bash", "-c", script],
        cwd=ROOT,
        env={
            **os.environ,
            "PYTHONPATH": "/opt/ros/x",
            "AMENT_PREFIX_PATH": "/opt/ros/x",
            "LD_LIBRARY_PATH": "/opt/ros/x",
        },
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )
    assert result.stdout.strip() == f"[][][][{ROOT}/.venv/bin/python]"
    assert "installing" not in result.stderr
