"""The short version of scripts/soak: memory, threads and open files do not grow."""

import os
import subprocess
import sys
from pathlib import Path

SCRIPT = Path(__file__).resolve().parents[2] / "scripts" / "soak_run.py"


def test_a_minute_of_input_leaves_nothing_behind(compiled):
    command = [sys.executable, str(SCRIPT), "--minutes", "1", "--rate", "100", "--settle", "20", "--untimed"]
    environment = {**os.environ, "ROS_DOMAIN_ID": str(102 + os.getpid() % 100)}
    done = subprocess.run(command, capture_output=True, text=True, timeout=400, env=environment)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "memory" in done.stdout
