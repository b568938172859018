#!/usr/bin/env python
"""The first minutes: a clone set up from nothing, downloads apart, to a shape, the demo's picture and all kernels.

    scripts/bench setup [--quick] [--wheels FOLDER] [--save FILE] [--compare FILE]

Downloads what requirements.txt names into FOLDER (out/wheels) unless it is there, then clones what is committed into a
folder of its own, with a home, and so a cache of kernels, of its own, and runs `scripts/demo` there without network. A
first shape is the README's first program, tried as soon as the kernels of a shape are there; the picture is there when
the demo has ended, with 20 s of motion; everything when its command has. Wall times on all cores: meant for a quiet
machine; processor times are told beside.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
import threading
from pathlib import Path
from time import monotonic, sleep

from figures import Figures, bench_options, bench_parser, finish, heading

ROOT = Path(__file__).resolve().parents[1]
SHAPE = """
import cable_shape as cs
along_x = (0.5, 0.5, 0.5, 0.5)
cable = cs.Cable(length=1.2, linear_density=0.1, bending_stiffness=0.01)
assert cs.predict(cable, cs.Pose((0, 0, 1), along_x), cs.Pose((0.8, 0, 1), along_x)).usable
"""
ASKED = {"first shape": 60.0, "the demo's picture": 180.0, "everything": 240.0}  # s


def run(command: list[str | Path], **options: object) -> None:
    """A command that must not fail."""
    subprocess.run(command, check=True, **options)  # type: ignore[call-overload]


def downloaded(folder: Path) -> None:
    """Wheels of all that is pinned; what comes as a source is made one."""
    folder.mkdir(parents=True, exist_ok=True)
    pip = [sys.executable, "-m", "pip", "wheel", "-q", "--disable-pip-version-check", "-w", folder, "-f", folder]
    run([*pip, "-r", ROOT / "requirements.txt"])


def try_shape(clone: Path, environment: dict[str, str], came: dict[str, float]) -> None:
    """Predicts once the set-up has said that the kernels of a shape are there."""
    said = clone / "said.log"
    while "kernels of shapes" not in said.read_text(errors="replace"):
        if "demo" in came:
            return
        sleep(0.2)
    run([clone / ".venv/bin/python", "-c", SHAPE], cwd=clone, env=environment)
    came["first shape"] = monotonic()


def measured(wheels: Path, cached: bool) -> tuple[dict[str, float], float]:
    """[s] until each came, and processor time of all; cached: with the kernels that are compiled on this machine."""
    with tempfile.TemporaryDirectory(prefix="bench_setup_") as place:
        clone = Path(place) / "clone"
        run(["git", "clone", "-q", ROOT, clone])
        dropped = ("PYTHON",) if cached else ("HOME", "PYTHON", "NUMBA_", "XDG_")
        environment = {name: value for name, value in os.environ.items() if not name.startswith(dropped)}
        environment.setdefault("HOME", place)
        environment |= {"PIP_NO_INDEX": "1", "PIP_FIND_LINKS": str(wheels), "UV_NO_INDEX": "1", "UV_OFFLINE": "1"}
        environment |= {"UV_FIND_LINKS": str(wheels), "UV_CACHE_DIR": f"{place}/uv", "PYTHONUNBUFFERED": "1"}
        came: dict[str, float] = {}
        said = clone / "said.log"
        began = monotonic()
        with said.open("w") as log:
            demo = subprocess.Popen(
                [clone / "scripts/demo"], cwd=clone, env=environment, stdout=log, stderr=subprocess.STDOUT
            )
        shape = threading.Thread(target=try_shape, args=(clone, environment, came))
        shape.start()
        while demo.poll() is None:
            if "the demo's picture" not in came and "recording" in said.read_text(errors="replace"):
                came["the demo's picture"] = monotonic()
            sleep(0.2)
        came["everything"] = came["demo"] = monotonic()
        shape.join()
        print(said.read_text(errors="replace"))
        if demo.returncode:
            raise SystemExit(f"scripts/demo ended with {demo.returncode}")
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    times = {name: came[name] - began for name in ASKED if name in came}  # what is compiled already is not told of
    return times, used.ru_utime + used.ru_stime


def main() -> int:
    """The three times."""
    parser = bench_parser(__doc__, "with the kernels that are compiled already: to see that it works")
    parser.add_argument("--wheels", type=Path, metavar="FOLDER", help="what is downloaded (out/wheels)")
    options = bench_options(parser)
    wheels = (options.wheels or ROOT / "out" / "wheels").resolve()
    if not (wheels.is_dir() and any(wheels.iterdir())):
        downloaded(wheels)
    heading(f"From nothing on {len(os.sched_getaffinity(0))} cores; {os.getloadavg()[0]:.1f} processes ran before")
    came, processor = measured(wheels, options.quick)
    figures = Figures()
    figures.check("each of them came", options.quick or came.keys() == ASKED.keys())
    for name, seconds in came.items():
        figures.at_most(f"from nothing to {name}", seconds, ASKED[name], "{:.0f}", " s")
    print(f"processor time of all {processor:.0f} s")
    return finish(figures, options)


if __name__ == "__main__":
    raise SystemExit(main())
