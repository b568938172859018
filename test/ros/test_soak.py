"""The short versions of scripts/soak."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

ROOT = Path(__file__).resolve().parents[2]
SCRIPT = ROOT / "soak" / "soak_run.py"


def said_by(*options):
    """What it prints; it must end well."""
    beside = os.pathsep.join((str(ROOT / "benchmarks"), os.environ.get("PYTHONPATH", "")))  # as scripts/soak has it
    apart = str(1 + (int(os.environ["ROS_DOMAIN_ID"]) + 50) % 101)  # from the nodes of other tests
    environment = {**os.environ, "ROS_DOMAIN_ID": apart, "PYTHONPATH": beside}
    command = [sys.executable, str(SCRIPT), *options]
    done = subprocess.run(command, capture_output=True, text=True, timeout=1200, env=environment)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_a_minute_of_input_leaves_nothing_behind():
    assert "memory" in said_by("--minutes", "0.5", "--rate", "100", "--settle", "10", "--untimed")


def test_random_messages_and_hostile_peers_do_no_harm():
    # the middleware may write there, too
    first, *others = [line for line in said_by("--fuzz", "2000").splitlines() if "RTPS" not in line]
    assert first.startswith("2000 random messages sent, ")
    told = "20 requests and publishers of hostile peers"
    assert others == [f"{told}: it predicts", f"{told}, the node locked: it predicts"]


def test_replays_are_the_same():
    assert "2 replays of 200 frames, replay/replay.mcap: sha256 " in said_by("--replay", "2")


def test_random_edits_are_those_of_a_cycle_and_of_a_replay():
    said = said_by("--edits", "30").splitlines()
    assert any(line.startswith("30 edits, ") for line in said)
    (replayed,) = (line for line in said if line.startswith("replay: "))
    assert replayed.endswith("shapes to the bit")


def test_damaged_files_are_read_or_refused():
    kinds = [line.split(":")[0] for line in said_by("--files", "9").splitlines()]
    assert kinds == ["yaml", "json", "urdf", "stl", "obj", "csv", "npz", "mcap", "db3"]
