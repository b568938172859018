"""A replay that cannot write, or is told to end: a clear text, and what was replayed until then can be read."""

from __future__ import annotations

import resource
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from recordings import motion, write_bag
from rerun.chunk import RrdReader

from cable_shape.command.cli import main
from cable_shape.replay.bag_writer import MARGINS_TYPE
from cable_shape.replay.bags import Bag

ROOT = Path(__file__).resolve().parents[2]
FRAMES = 1500
LIMIT = 1_500_000  # bytes of a file; a chunk of the bag is 1 MiB


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_bag(tmp_path_factory.mktemp("in") / "bag", motion(FRAMES))


def started(bag: Path, out: Path, *options: str, prepare: Callable[[], None] | None = None) -> subprocess.Popen[str]:
    cable = bag.parent / "cable.yaml"
    cable.write_text("length: 1.0\nlinear_density: 0.1\nbending_stiffness: 0.01\ndiameter: 0.008\n")
    command = [
        sys.executable,
        "-m",
        "cable_shape.command.cli",
        "replay",
        str(bag),
        "-o",
        str(out),
        "--cable",
        str(cable),
    ]
    pipe = subprocess.PIPE
    return subprocess.Popen(
        [*command, "--no-picture", *options], stdout=pipe, stderr=pipe, text=True, cwd=ROOT, preexec_fn=prepare
    )


def full_disk() -> None:
    """Stands for one: writing beyond the limit fails with an OSError."""
    resource.setrlimit(resource.RLIMIT_FSIZE, (LIMIT, LIMIT))


def read(out: Path) -> list[int]:
    """Log times of the shapes in OUT/replay."""
    with Bag(out / "replay") as written:
        assert MARGINS_TYPE in written.types.values()
        return [log_time for _, log_time, _ in raw_messages(written)]


def raw_messages(bag: Bag) -> list[tuple[str, int, bytes]]:
    """Of a bag whose types rosbags does not know."""
    return [entry for part in bag._parts for entry in part.messages(["/cable/shape"], bag.problems)]


@pytest.mark.parametrize("options", [("--no-rrd",), ()])
def test_a_full_disk_ends_it_with_a_text(bag: Path, tmp_path: Path, options: tuple[str, ...]) -> None:
    process = started(bag, tmp_path / "out", *options, prepare=full_disk)
    _, text = process.communicate(timeout=120)
    assert process.returncode == 2, text
    assert "cannot be written any further" in text
    assert "is the disk full? Make room, or choose another one." in text
    assert "Traceback" not in text
    times = read(tmp_path / "out")
    assert 0 < len(times) < FRAMES
    assert times == sorted(set(times))
    again = [str(bag), "-o", str(tmp_path / "out"), "--cable", str(bag.parent / "cable.yaml"), "--no-rrd"]
    assert main(["replay", *again, "--no-picture"]) == 0  # what is left there is replaced
    assert len(read(tmp_path / "out")) == FRAMES


def some_is_written(out: Path) -> bool:
    """Whether a first chunk is in OUT/replay, and OUT/replay.rrd is there."""
    file = out / "replay" / "replay.mcap"
    return file.exists() and file.stat().st_size > 0 and (out / "replay.rrd").exists()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_it_between_two_cycles(bag: Path, tmp_path: Path, number: signal.Signals) -> None:
    for k in range(10):  # again, where it was done before the signal came
        out = tmp_path / f"out{k}"
        process = started(bag, out)
        end = time.monotonic() + 120.0
        while process.poll() is None and not some_is_written(out):
            assert time.monotonic() < end
            time.sleep(0.01)
        process.send_signal(number)
        _, text = process.communicate(timeout=120)
        if process.returncode:
            break
    assert process.returncode == 130, text
    assert f"what was replayed until then is in {out}, without a report" in text
    assert "Traceback" not in text
    assert (out / "replay" / "metadata.yaml").is_file()
    times = read(out)
    assert 0 < len(times) < FRAMES
    lines = [c for c in RrdReader(str(out / "replay.rrd")).stream().to_chunks() if c.entity_path.endswith("/line")]
    rows = sum(c.to_record_batch().num_rows for c in lines if not c.is_static)
    assert rows == len(times)
