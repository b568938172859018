"""Processes beside the node never outlive it."""

import subprocess
import sys

HUNG = """
import threading, time
from cable_shape.ros import serving
serving._LATEST = 0.5
serves = threading.Event()
serves.set()
threading.Thread(target=serving._end_with_parent, args=(serves,), daemon=True).start()
time.sleep(600)
"""


def test_one_that_hangs_in_its_end_ends():
    done = subprocess.run([sys.executable, "-c", HUNG], stdin=subprocess.DEVNULL, timeout=300)
    assert done.returncode == 1
