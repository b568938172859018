"""Compiles all kernels, or those that some stages need, on all cores: python -m cable_shape.warm_up [--until STAGE].

Stages, each with those before it: shapes (single shapes of a plain cable), cycles (what node, demo and replay need),
harnesses, forms (gradient cables), plans (batches, trajectories, calibrations), motion (cables that swing, or are
seen). --record writes the list of kernels anew, on one core from an empty cache: where kernels have come or are called
with other types.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import subprocess
import sys
import tempfile
from collections import Counter
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from time import monotonic

from tqdm import tqdm

from cable_shape.warm_up import kernel_list
from cable_shape.warm_up.ahead import compile_all
from cable_shape.warm_up.runs import STAGES

SAY_S = 15.0  # between lines where nobody watches a bar


def compile_until(stage: str, cores: int | None = None, touch: Path | None = None) -> None:
    """Compiles what the list has for stages up to this one, then runs them: what it lacks is compiled by that.

    touch: a file to be made once the kernels of the first stage are there.
    """
    names = list(STAGES)[: list(STAGES).index(stage) + 1]
    here = {one[1:] for one in kernel_list.cached()}
    wanted = [entry for entry in kernel_list.read() if entry.stage in names and entry[1:] not in here]
    began = said = monotonic()
    left = Counter(entry.stage for entry in wanted)
    how = {"desc": "kernels", "bar_format": "{desc} {bar} {n:.0f} % {postfix}", "disable": None}
    with tqdm(total=100.0, **how) as bar, contextlib.suppress(BrokenProcessPool):  # then it goes on in this process
        for entry, part in compile_all(wanted, cores):
            now = monotonic()
            told = f"about {(now - began) * (1.0 / part - 1.0):.0f} s left"
            bar.n = 100.0 * part
            bar.set_postfix_str(told)
            if bar.disable and now > said + SAY_S:
                said = now
                print(f"kernels: {100.0 * part:.0f} %, {told}", file=sys.stderr, flush=True)
            left[entry.stage] -= 1
            if not left[entry.stage]:
                tqdm.write(f"kernels of {entry.stage} after {now - began:.0f} s", file=sys.stderr)
            if touch and not left[names[0]]:
                touch.touch()
    for name in names:
        STAGES[name]()
        if touch:
            touch.touch()


def record() -> None:
    """Writes the list: runs each stage in a process of its own on one cache, and looks at what has come."""
    known: set[tuple[str, str, str, bool]] = set()
    entries = []
    with tempfile.TemporaryDirectory(prefix="warm_up_") as folder:
        os.environ["NUMBA_CACHE_DIR"] = folder
        for stage in tqdm(STAGES, desc="record", unit="stage"):
            run = f"from cable_shape.warm_up.runs import STAGES; STAGES[{stage!r}]()"
            before = os.times().children_user
            subprocess.run([sys.executable, "-c", run], check=True)
            tqdm.write(f"{stage}: {os.times().children_user - before:.0f} s of processor time", file=sys.stderr)
            found = [one[1:] for one in kernel_list.cached()]
            entries += [kernel_list.Entry(stage, *one) for one in found if one not in known]
            known.update(found)
    kernel_list.write(entries)


def main(arguments: list[str] | None = None) -> int:
    """See the module."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--until", choices=STAGES, default=list(STAGES)[-1], help="the last stage (all)")
    parser.add_argument("--cores", type=int, help="on so many processes (all cores)")
    parser.add_argument("--touch", type=Path, metavar="FILE", help="make it once the kernels of shapes are there")
    parser.add_argument("--record", action="store_true", help="write the list of kernels")
    options = parser.parse_args(arguments)
    if options.cores is not None and options.cores < 1:
        parser.error(f"--cores {options.cores}: it must be at least 1")
    if options.record:
        record()
    else:
        compile_until(options.until, options.cores, options.touch)
    return 0


if __name__ == "__main__":
    sys.exit(main())
