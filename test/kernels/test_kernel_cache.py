"""Machine code runs as the user: it is loaded only from folders into which nobody else can write."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from cable_shape.kernels import _jit
from cable_shape.kernels._jit import HERE, cache_folder, sources, trusted

KERNEL = HERE / "poses.py"
REMEMBERED = (cache_folder, sources, _jit._own_group)
FOREIGN = 12345  # a user and a group that are nobody's here


@pytest.fixture(autouse=True)
def _fresh(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    for name in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    old = os.umask(0o022)
    for known in REMEMBERED:
        known.cache_clear()
    yield
    os.umask(old)
    for known in REMEMBERED:
        known.cache_clear()


@pytest.fixture
def no_home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The home cannot be written; the folder of temporary files is sticky and open to all, as /tmp is."""
    (tmp_path / "home").write_text("no folder")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    shared = tmp_path / "tmp"
    shared.mkdir()
    shared.chmod(0o1777)
    monkeypatch.setattr(tempfile, "tempdir", str(shared))
    return shared


def mode(folder: str | Path) -> int:
    return Path(folder).stat().st_mode & 0o7777


def make_foreign(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Gives a folder to another user, or makes us another one, who may not do so."""
    if os.geteuid() == 0:
        os.chown(folder, FOREIGN, -1)
    else:
        monkeypatch.setattr(os, "geteuid", lambda: FOREIGN)


@pytest.mark.parametrize("bits", [0o777, 0o1777, 0o707, 0o702])
def test_a_folder_that_others_can_write_into_is_not_trusted(tmp_path: Path, bits: int) -> None:
    folder = tmp_path / "cache"
    folder.mkdir()
    assert trusted(folder)
    folder.chmod(bits)
    assert not trusted(folder)


def test_a_folder_above_that_others_can_exchange_is_not_trusted_unless_sticky(tmp_path: Path) -> None:
    folder = tmp_path / "open" / "own" / "cache"
    folder.mkdir(parents=True)
    (tmp_path / "open").chmod(0o777)
    assert not trusted(folder)
    (tmp_path / "open").chmod(0o1777)
    assert trusted(folder)


def test_a_folder_of_another_user_is_not_trusted_nor_what_lies_in_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "theirs" / "cache"
    folder.mkdir(parents=True)
    make_foreign(tmp_path / "theirs", monkeypatch)
    assert not trusted(tmp_path / "theirs")
    assert not trusted(folder)


def test_a_group_may_write_only_if_it_is_the_users_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "cache"
    folder.mkdir()
    folder.chmod(0o770)
    monkeypatch.setattr(_jit, "_own_group", lambda number: number == folder.stat().st_gid)
    assert trusted(folder)
    monkeypatch.setattr(_jit, "_own_group", lambda number: False)
    assert not trusted(folder)


def test_a_link_is_judged_by_where_it_leads(tmp_path: Path) -> None:
    (tmp_path / "open").mkdir()
    (tmp_path / "open").chmod(0o777)
    (tmp_path / "link").symlink_to(tmp_path / "open")
    assert not trusted(tmp_path / "link")


def test_the_cache_is_made_for_the_user_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    os.umask(0)
    monkeypatch.setenv("HOME", str(tmp_path))
    (tmp_path / ".cache").mkdir(mode=0o755)
    folder = Path(cache_folder(KERNEL))
    assert folder.parent == tmp_path / ".cache" / "cable_shape"
    assert [mode(folder), mode(folder.parent)] == [0o700, 0o700]


def test_without_a_home_a_folder_in_tmp_is_made_for_the_user_alone(no_home: Path) -> None:
    folder = Path(cache_folder(KERNEL))
    assert folder.parent == no_home / f"cable_shape_{os.getuid()}"
    assert [mode(folder), mode(folder.parent)] == [0o700, 0o700]


@pytest.mark.parametrize("deep", [False, True])
def test_a_folder_in_tmp_that_somebody_else_has_made_is_passed_over(
    no_home: Path, monkeypatch: pytest.MonkeyPatch, deep: bool
) -> None:
    """Under the very name, with machine code in it: what an attacker would do who knows the names."""
    name = Path(cache_folder(KERNEL)).name
    cache_folder.cache_clear()
    base = no_home / f"cable_shape_{os.getuid()}"
    theirs = base / name if deep else base
    (base / name / "poses.compose.nbi").write_bytes(b"machine code")
    theirs.chmod(0o777)
    made = Path(cache_folder(KERNEL))
    assert not made.is_relative_to(base)
    assert made.name.startswith("cable_shape_kernels_")
    assert mode(made) == 0o700
    cache_folder.cache_clear()
    theirs.chmod(0o755)
    assert Path(cache_folder(KERNEL)) == base / name
    cache_folder.cache_clear()
    make_foreign(theirs, monkeypatch)
    assert not Path(cache_folder(KERNEL)).is_relative_to(base)


def test_a_named_folder_that_others_can_write_into_is_passed_over(
    tmp_path: Path, no_home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "named"))
    assert Path(cache_folder(KERNEL)).parent == tmp_path / "named"
    (tmp_path / "named").chmod(0o777)
    cache_folder.cache_clear()
    assert Path(cache_folder(KERNEL)).parent == no_home / f"cable_shape_{os.getuid()}"


def closed(monkeypatch: pytest.MonkeyPatch, base: Path) -> None:
    """Makes all folders below read-only, for root, too, to whom all is open."""
    access = os.access
    for folder in (*base.rglob("*/"), base):
        folder.chmod(0o555)
    monkeypatch.setattr(
        os, "access", lambda path, bits: not (bits & os.W_OK and Path(path).is_relative_to(base)) and access(path, bits)
    )


def test_a_warm_cache_that_is_read_only_is_used_and_a_cold_one_is_not(
    tmp_path: Path, no_home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    base = tmp_path / "shipped"
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(base))
    folder = Path(cache_folder(KERNEL))
    cache_folder.cache_clear()
    with monkeypatch.context() as context:
        closed(context, base)
        assert not Path(cache_folder(KERNEL)).is_relative_to(base)
    cache_folder.cache_clear()
    folder.chmod(0o755)
    (folder / "poses.compose-1.nbi").write_bytes(b"index")
    closed(monkeypatch, base)
    assert Path(cache_folder(KERNEL)) == folder


PROGRAM = """
import os, sys
os.access = lambda path, bits, access=os.access: sys.argv[2] == "open" and access(path, bits)
sys.path.insert(0, sys.argv[1])
import own
assert own.twice(3) == 6
print("hit" if own.twice.stats.cache_hits else "missed")
"""


def test_a_kernel_is_loaded_from_a_warm_read_only_cache(tmp_path: Path) -> None:
    (tmp_path / "source").mkdir()
    shutil.copy(_jit.__file__, tmp_path / "source")
    (tmp_path / "source" / "own.py").write_text("from _jit import kernel\n\n@kernel\ndef twice(x):\n    return 2 * x\n")
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache")}

    def counts(state: str) -> str:
        command = [sys.executable, "-c", PROGRAM, str(tmp_path / "source"), state]
        return subprocess.run(command, env=environment, check=True, capture_output=True, text=True).stdout.strip()

    assert counts("open") == "missed"
    for folder in (*(tmp_path / "cache").rglob("*/"), tmp_path / "cache"):
        folder.chmod(0o555)
    kept = sorted((tmp_path / "cache").rglob("*"))
    assert counts("closed") == "hit"
    assert sorted((tmp_path / "cache").rglob("*")) == kept


LARGE = """
import math
from _jit import kernel

@kernel
def large(x):
    out = 0.0
{steps}
    return out

@kernel
def small(x):
    return large(x) + 1.0

@kernel
def top(x):
    return large(x) - small(x)
"""
CALLED = """
import sys
sys.path.insert(0, sys.argv[1])
import own
assert own.top(0.5) == -1.0
(one,) = own.top.overloads.values()
names = [f.name for f in one.library._get_module_for_linking().functions]
print(sum("large" in name for name in names), sum("small" in name for name in names), len(own.top.stats.cache_hits))
own.large(0.5)
own.small(0.5)
"""


def test_a_large_kernel_is_called_by_its_name_and_compiled_again_if_it_is_lost(tmp_path: Path) -> None:
    (tmp_path / "source").mkdir()
    shutil.copy(_jit.__file__, tmp_path / "source")
    steps = "\n".join(f"    out += math.sin(out + {k}.5 * x)" for k in range(60))
    (tmp_path / "source" / "own.py").write_text(LARGE.format(steps=steps))
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache")}

    def told() -> list[int]:
        command = [sys.executable, "-c", CALLED, str(tmp_path / "source")]
        said = subprocess.run(command, env=environment, check=True, capture_output=True, text=True).stdout
        return [int(word) for word in said.split()]

    names, _, hits = told()
    assert (names, hits) == (1, 0)  # one declaration, for both who call it
    assert told()[2] == 1
    lost = list((tmp_path / "cache").rglob("*.large-*-within*"))
    assert lost
    for path in lost:
        path.unlink()
    assert told()[2] == 1
    assert all(path.exists() for path in lost)


IN_LINE = """
from _jit import kernel

@kernel(forceinline=True)
def below(x):
    return 2.0 * x if x < 1.0 else -x

@kernel(forceinline=True)
def between(x):
    return below(x) + 1.0

@kernel
def first(x):
    return between(x) + below(3.0 * x)

@kernel
def second(x):
    return between(x) - 1.0
"""
PUT_IN_LINE = """
import sys
sys.path.insert(0, sys.argv[1])
import own
one = getattr(own, sys.argv[2])
print(one(0.5), len(own.between.within.compiled.stats.cache_hits))
(made,) = one.overloads.values()
code = made.library._final_module
print(sum("below" in f.name or "between" in f.name for f in code.functions))
(part,) = own.between.within.compiled.overloads.values()
print(part.library.get_pointer_to_function(part.fndesc.llvm_func_name) != 0, own.between(0.25))
"""


def test_a_kernel_that_is_always_in_line_is_kept_as_code_to_be_put_there_alone(tmp_path: Path) -> None:
    (tmp_path / "source").mkdir()
    shutil.copy(_jit.__file__, tmp_path / "source")
    (tmp_path / "source" / "own.py").write_text(IN_LINE)
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache")}

    def told(name: str) -> list[str]:
        command = [sys.executable, "-c", PUT_IN_LINE, str(tmp_path / "source"), name]
        return subprocess.run(command, env=environment, check=True, capture_output=True, text=True).stdout.split()

    assert told("first") == ["0.5", "0", "0", "False", "1.5"]
    assert told("second") == ["1.0", "1", "0", "True", "1.5"]  # what is cached is put in line, too


RARE = """
from numba import types
from _jit import kernel

@kernel(late=types.float64)
def seldom(x, y):
    if y < 0.0:
        raise ValueError("below")
    return x - y

@kernel(late=types.float64)
def rare(x, y=1.0):
    return x if y == 0.0 else 2.0 * seldom(x, y)

@kernel(nogil=True)
def top(x, y, rarely):
    return rare(x, y=y) + rare(0.0) if rarely else x
"""
PROMISED = """
import sys
from threading import Thread
sys.path.insert(0, sys.argv[1])
import own
from cable_shape.kernels._late import load_all
there = lambda: [len(one.within.compiled.overloads) for one in (own.rare, own.seldom)]
assert own.top(3.0, 1.0, False) == 3.0
before = there()
assert own.top(3.0, 0.0, True) == 1.0
thread = Thread(target=own.top, args=(3.0, 2.0, True))
thread.start()
thread.join()
once = there()
assert own.top(3.0, 2.0, True) == 0.0
try:
    own.top(3.0, -1.0, True)
except ValueError as error:
    assert str(error) == "below"
else:
    sys.exit("no error")
load_all()
print(before, once, there(), len(own.top.stats.cache_hits), len(own.rare.within.compiled.stats.cache_hits))
"""


def test_a_late_kernel_is_compiled_or_loaded_when_it_is_first_called_and_not_before(tmp_path: Path) -> None:
    (tmp_path / "source").mkdir()
    shutil.copy(_jit.__file__, tmp_path / "source")
    (tmp_path / "source" / "own.py").write_text(RARE)
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache")}

    def told() -> str:
        command = [sys.executable, "-c", PROMISED, str(tmp_path / "source")]
        return subprocess.run(command, env=environment, check=True, capture_output=True, text=True).stdout.strip()

    assert told() == "[0, 0] [2, 1] [2, 1] 0 0"
    assert told() == "[0, 0] [2, 1] [2, 1] 1 2"


def test_all_kernel_files_that_a_kernel_imports_are_known(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    files = {
        "top.py": "from cable_shape.kernels.one import a\nfrom cable_shape.kernels.several import (\n    b,\n    c,\n)",
        "one.py": "from cable_shape.kernels import two, three\n",
        "two.py": "",
        "three.py": "from cable_shape.kernels.network.inner import d\n",
        "several.py": "from cable_shape.kernels.network import (\n    other,\n    top_of as renamed,\n)\n",
        "network/__init__.py": "",
        "network/inner.py": "from cable_shape.kernels.two import e\n",
        "network/other.py": "import math\n",
        "network/top_of.py": "from cable_shape.cable.cable import Cable\n",
        "apart.py": "# from cable_shape.kernels.one import a\n",
        "network/apart.py": "",
    }
    (tmp_path / "network").mkdir()
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    monkeypatch.setattr(_jit, "HERE", tmp_path)
    found = {file for file in sources(tmp_path / "top.py") if file.is_relative_to(tmp_path)}
    assert {str(file.relative_to(tmp_path)) for file in found} == set(files) - {
        "apart.py", "network/apart.py", "network/__init__.py",
    }  # fmt: skip
    assert {path.name for path in sources(tmp_path / "apart.py")} >= {"_jit.py", "_late.py", "_library.py"}


def test_all_imports_of_the_kernels_themselves_are_known() -> None:
    """As Python's own parser sees them."""
    import ast

    files = sorted(HERE.rglob("*.py"))
    assert len(files) > 60
    for file in files:
        wanted = set()
        for node in ast.parse(file.read_text()).body:
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("cable_shape.kernels"):
                module = HERE.joinpath(*(node.module or "").split(".")[2:])
                wanted |= {module.with_suffix(".py"), *(module / f"{alias.name}.py" for alias in node.names)}
        assert {path for path in wanted if path.is_file()} <= sources(file), file


def test_a_link_in_place_of_the_cache_is_followed_once_and_for_all(no_home: Path, tmp_path: Path) -> None:
    """Whoever can write into /tmp may put a link to a good folder there, and turn it to another one later."""
    (tmp_path / "good").mkdir(mode=0o700)
    link = no_home / f"cable_shape_{os.getuid()}"
    link.symlink_to(tmp_path / "good")
    folder = Path(cache_folder(KERNEL))
    assert folder.parent == tmp_path / "good"
    link.unlink()
    link.symlink_to(tmp_path)
    assert folder.is_dir()
    assert mode(folder) == 0o700
