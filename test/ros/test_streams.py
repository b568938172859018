"""What the middleware writes does not get between what a command prints."""

import os
import subprocess
import sys

from cable_shape.ros.streams import middleware_to_stderr

PROGRAM = """
import os
from cable_shape.ros.streams import middleware_to_stderr
print("before")
with middleware_to_stderr():
    os.write(1, b"of the middleware\\n")
    print("own")
os.write(1, b"after\\n")
"""


def test_what_is_not_printed_goes_to_standard_error():
    done = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True, timeout=120)
    assert done.stdout.splitlines() == ["before", "own", "after"]
    assert done.stderr == "of the middleware\n"


def test_where_nothing_is_a_file_all_stays_as_it_is(capsys):
    with middleware_to_stderr():
        print("own")
    assert capsys.readouterr().out == "own\n"
    assert os.fstat(1)
