"""The set-up that both commands share: it stops with a remedy, is idempotent, and keeps a sourced ROS out.

And the cache of compiled kernels: processes may fill it at once, and what is broken in it is made again.
"""

import os
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]
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
        timeout=800,
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


@pytest.mark.parametrize("built", ["/opt/python/cp312-cp312", "/home/me/a checkout since deleted/.venv"])
def test_include_folders_in_wheels_become_those_here_and_no_file_of_the_cache_changes(built: str, tmp_path: Path):
    """Files were written to that all checkouts share by links: once the first was deleted, no other could be set up."""
    theirs = f"{built}/include/python3.12;{built}/lib/python3.12/site-packages/numpy/_core/include"
    line = f'INTERFACE_INCLUDE_DIRECTORIES "{theirs}"\n'
    cached, file = tmp_path / "cached.cmake", tmp_path / "venv" / "share" / "messages" / "messages.cmake"
    cached.write_text(line)
    file.parent.mkdir(parents=True)
    file.hardlink_to(cached)
    repair = 'eval "$(sed -n "/^repair_cmake_paths/,/^}/p" scripts/_setup)"; repair_cmake_paths'
    environment = {**os.environ, "python": sys.executable, "venv": str(tmp_path / "venv")}
    subprocess.run(["bash", "-c", repair], cwd=ROOT, env=environment, check=True, timeout=60)
    include, arrays = sysconfig.get_path("include"), np.get_include()
    assert file.read_text() == f'INTERFACE_INCLUDE_DIRECTORIES "{include};{arrays}"\n'
    assert cached.read_text() == line
    assert [other.name for other in file.parent.iterdir()] == [file.name]


def test_it_runs_again_in_seconds_and_drops_a_sourced_ros() -> None:
    """In this very checkout, which the test command has just set up."""
    if not (ROOT / ".venv/.cable_shape/package").exists():
        pytest.skip("this checkout was not set up by scripts/test")
    named = ("PYTHONPATH", "AMENT_PREFIX_PATH", "LD_LIBRARY_PATH", "_ROS_WHEELS_BOOTSTRAP_COMPLETE")
    script = "source scripts/_setup; echo " + "".join(f"[${{{name}-}}]" for name in named) + "[$python]"
    result = subprocess.run(
        ["bash", "-c", script],
        cwd=ROOT,
        env={**os.environ, **dict.fromkeys(named, "/opt/ros/x")},
        capture_output=True,
        text=True,
        timeout=800,
        check=True,
    )
    assert result.stdout.strip() == f"[][][][][{ROOT}/.venv/bin/python]"
    assert "installing" not in result.stderr


# -- the cache of compiled kernels

CHILD = """
import numpy as np
from cable_shape.kernels import frames, poses

a = np.array((0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0))
b = np.array((1.0, 0.2, 0.1, 0.0, 0.6, 0.0, 0.8))
out = np.empty(17 * 5)
roll = frames.straight(a, b, 1.2, 5, out)
both = (frames.straight, poses.compose)
print(poses.compose(a, b).tobytes().hex(), float(roll).hex(), out.tobytes().hex())
print(sum(k.stats.cache_hits.total() for k in both), sum(k.stats.cache_misses.total() for k in both))
"""
COMPILED, LOADED = "0 2", "2 0"  # cache hits and misses of the two kernels


def start_child(**environment: str) -> subprocess.Popen[str]:
    """A new process that calls two kernels and says what came out and where the machine code came from."""
    inherited = {k: v for k, v in os.environ.items() if k not in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME")}
    return subprocess.Popen(
        [sys.executable, "-W", "error", "-c", CHILD],
        env={**inherited, "PYTHONPATH": str(ROOT), **environment},
        cwd=environment.get("PYTHONPATH", ROOT),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def result_of(child: subprocess.Popen[str]) -> tuple[str, str]:
    """Its numbers, and hits and misses."""
    out, err = child.communicate(timeout=120)
    assert child.returncode == 0, err
    numbers, origin = out.splitlines()
    return numbers, origin


@pytest.fixture(scope="module")
def filled(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """A cache that three processes have filled at once, and the numbers that they agree on."""
    cache = tmp_path_factory.mktemp("cache")
    children = [start_child(XDG_CACHE_HOME=str(cache)) for _ in range(3)]
    numbers = {result_of(child)[0] for child in children}
    assert len(numbers) == 1
    return cache, numbers.pop()


def test_what_processes_compile_at_once_the_next_one_loads(filled: tuple[Path, str]) -> None:
    cache, numbers = filled
    assert list(cache.rglob("*.nbi"))
    assert not list(cache.rglob("*.tmp.*"))
    assert result_of(start_child(XDG_CACHE_HOME=str(cache))) == (numbers, LOADED)


def test_a_second_checkout_loads_what_the_first_one_compiled(filled: tuple[Path, str], tmp_path: Path) -> None:
    """Machine code is found by what the sources say; only what a changed source says is compiled again."""
    shutil.copytree(ROOT / "cable_shape", tmp_path / "cable_shape", ignore=shutil.ignore_patterns("__pycache__"))
    places = {"XDG_CACHE_HOME": str(filled[0]), "PYTHONPATH": str(tmp_path)}
    assert result_of(start_child(**places)) == (filled[1], LOADED)
    with open(tmp_path / "cable_shape" / "kernels" / "poses.py", "a") as file:
        file.write("# another version\n")
    assert result_of(start_child(**places)) == (filled[1], "1 1")


@pytest.mark.parametrize(("suffix", "keep"), [("nbi", 0.0), ("nbc", 0.5)])
def test_a_cache_file_cut_short_is_compiled_again(
    filled: tuple[Path, str], tmp_path: Path, suffix: str, keep: float
) -> None:
    cache = Path(shutil.copytree(filled[0], tmp_path / "cache"))
    for file in cache.rglob(f"*.{suffix}"):
        os.truncate(file, int(keep * file.stat().st_size))
    assert result_of(start_child(XDG_CACHE_HOME=str(cache))) == (filled[1], COMPILED)
    assert result_of(start_child(XDG_CACHE_HOME=str(cache))) == (filled[1], LOADED)


def test_without_a_writable_home_kernels_are_cached_in_the_temporary_folder(
    filled: tuple[Path, str], tmp_path: Path
) -> None:
    """A file where the folder should be refuses root, too."""
    (tmp_path / "file").touch()
    nowhere = {"HOME": str(tmp_path / "file"), "XDG_CACHE_HOME": str(tmp_path / "file"), "TMPDIR": str(tmp_path)}
    assert result_of(start_child(**nowhere)) == (filled[1], COMPILED)
    assert list((tmp_path / f"cable_shape_{os.getuid()}").rglob("*.nbi"))
    assert result_of(start_child(**nowhere)) == (filled[1], LOADED)
