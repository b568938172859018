"""The README's node: the command as it stands, and the client beside it."""

import os
import re
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path

from harness import TIMEOUT

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def test_the_node_answers_the_client_of_the_readme(tmp_path: Path) -> None:
    command = re.search(r"^cable_shape_node (.*)$", README, flags=re.MULTILINE)
    client = next(block for block in re.findall(r"```python\n(.*?)```", README, flags=re.DOTALL) if "rclpy" in block)
    assert command
    log = tmp_path / "node.log"
    with log.open("w") as out:
        node = subprocess.Popen(
            [sys.executable, "-m", "cable_shape.ros.node", *shlex.split(command[1])],
            cwd=ROOT, stdout=out, stderr=subprocess.STDOUT,
        )  # fmt: skip
    try:
        end = time.monotonic() + TIMEOUT
        while True:  # it loads for some seconds, the client sends for four
            done = subprocess.run(
                [sys.executable, "-c", client], cwd=ROOT, capture_output=True, text=True, timeout=TIMEOUT, check=False,
                env=os.environ,
            )  # fmt: skip
            assert done.returncode == 0, done.stderr
            if not done.stdout.startswith("0 shapes") or time.monotonic() > end:
                break
    finally:
        node.send_signal(signal.SIGINT)
        node.wait(TIMEOUT)
    said = re.match(r"(\d+) shapes; (\w+), usable True, middle", done.stdout)
    assert said, f"{done.stdout}\n{log.read_text()}"
    assert int(said[1]) > 0
