"""Kernels compiled ahead: by several processes, each once, none before what it calls."""

import os
import subprocess
import sys
from pathlib import Path

from cable_shape.warm_up import kernel_list
from cable_shape.warm_up.ahead import called_by, compile_one, work_of
from cable_shape.warm_up.kernel_list import Entry
from cable_shape.warm_up.runs import STAGES

COMPOSE = ("poses", "compose", "(f8[1C],f8[1C])", False)
CHILD = """
import sys
from cable_shape.warm_up import kernel_list
from cable_shape.warm_up.ahead import compile_all

wanted = [entry for entry in kernel_list.read() if entry.module in ("poses", "rod_algebra", "frames")]
done = [entry for entry, part in compile_all(wanted, 2)]
assert sorted(done) == sorted(wanted), set(wanted) - set(done)
print(len(wanted), len(kernel_list.cached()))
"""


def test_the_list_can_be_read_and_written(tmp_path: Path) -> None:
    entries = kernel_list.read()
    assert {entry.stage for entry in entries} <= {*STAGES}
    assert list(dict.fromkeys(entry.stage for entry in entries)) == [
        s for s in STAGES if s in {e.stage for e in entries}
    ]
    assert len({entry[1:] for entry in entries}) == len(entries)
    kernel_list.write(entries, tmp_path / "kernels.txt")
    assert kernel_list.read(tmp_path / "kernels.txt") == entries


def test_most_of_the_list_is_of_kernels_that_are_there() -> None:
    """What is not is passed over when it is compiled: the list is written anew now and then, not with every kernel."""
    kernels = kernel_list.all_kernels()
    entries = kernel_list.read()
    gone = [entry for entry in entries if (entry.module, entry.name) not in kernels]
    assert len(gone) < 0.1 * len(entries), f"python -m cable_shape.warm_up --record: {gone[:5]} are gone"


def test_a_kernel_waits_for_all_that_its_code_names() -> None:
    entries = kernel_list.read()
    above = called_by(entries)
    assert all(max(direct, default=-1) < k for k, direct in enumerate(above))
    place = {(entry.module, entry.name): k for k, entry in enumerate(entries)}
    solve = place["network.drive", "solve"]
    named = {(entries[i].module, entries[i].name) for i in above[solve]}
    assert ("network.drive", "attempt") in named
    work = work_of(entries)
    assert work[place["network.drive", "attempt"]] > 5.0 * work[solve] > 5.0 * min(work) > 0.0


def test_two_processes_fill_an_empty_cache_with_what_was_wanted_and_no_more(tmp_path: Path) -> None:
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    told = subprocess.run([sys.executable, "-W", "error", "-c", CHILD], env=environment, capture_output=True, text=True)
    assert told.returncode == 0, told.stderr
    wanted, cached = map(int, told.stdout.split())
    assert wanted == cached > 10


def test_what_is_no_longer_there_is_passed_over() -> None:
    assert compile_one(Entry("shapes", *COMPOSE))
    assert not compile_one(Entry("shapes", "poses", "no_such", "(f8)", False))
    assert not compile_one(Entry("shapes", "no_such", "compose", "(f8)", False))
    assert not compile_one(Entry("shapes", "poses", "compose", "(f8,f8)", True))
    assert not compile_one(Entry("shapes", "poses", "compose", "what", False))
