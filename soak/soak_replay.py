"""Replays one recording many times, each in a process of its own: the same bytes, the same columns of the .rrd."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from cell_replay import FRAMES, write_recording
from cell_scene import CONFIG

BYTES = ("replay/replay.mcap", "replay/metadata.yaml")


def digest(out: Path) -> dict[str, str]:
    """What a replay wrote: the bytes of the bag, the decoded rows of the .rrd."""
    import rerun as rr

    digests = {name: hashlib.sha256((out / name).read_bytes()).hexdigest() for name in BYTES}
    rows: list[str] = []
    for chunk in rr.chunk.RrdReader(str(out / "replay.rrd")).stream().to_chunks():
        batch = chunk.to_record_batch()
        names = sorted(name for name in batch.schema.names if not name.startswith("rerun.controls"))
        columns = [batch.column(name).to_pylist() for name in names]
        rows += [f"{chunk.entity_path} {names} {row}" for row in zip(*columns, strict=True)]
    digests["replay.rrd"] = hashlib.sha256("\n".join(sorted(rows)).encode()).hexdigest()
    return digests


def repeat(count: int) -> list[str]:
    """Replays it `count` times; what differed from the first time."""
    wrong: list[str] = []
    with tempfile.TemporaryDirectory(prefix="soak_") as place:
        folder = Path(place)
        write_recording(folder / "bag")
        first: dict[str, str] = {}
        for k in range(count):
            out = folder / "out"
            command = [
                sys.executable,
                "-m",
                "cable_shape.command.cli",
                "replay",
                folder / "bag",
                "-o",
                out,
                "--no-picture",
            ]
            command += ["--cable", CONFIG / "cables" / "demo.yaml", "--scene", CONFIG / "scenes" / "demo.yaml"]
            seeded = {**os.environ, "PYTHONHASHSEED": str(k)}
            done = subprocess.run(command, env=seeded, capture_output=True, text=True, check=False)
            if done.returncode:
                return [f"replay {k} ended with exit code {done.returncode}: {done.stderr}"]
            found = digest(out)
            first = first or found
            wrong += [
                f"replay {k}: {name} differs from that of replay 0" for name in found if found[name] != first[name]
            ]
        for name, value in first.items():
            print(f"{count} replays of {FRAMES} frames, {name}: sha256 {value[:16]}...")
    return wrong
