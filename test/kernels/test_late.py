"""Kernels that are compiled when they are first called: what happens where that fails."""

import subprocess
import sys

import pytest

CODE = """
import cable_shape as cs
from cable_shape.kernels._jit import between_kernels
from cable_shape.kernels._late import Late

asked = Late._ask

def ask(self):
    with between_kernels(refuse):
        return asked(self)

def refuse():
    raise ERROR

Late._ask = ask
along_x = (0.5, 0.5, 0.5, 0.5)
try:
    ends = cs.Pose((0.0, 0.0, 1.0), along_x), cs.Pose((0.8, 0.0, 1.2), along_x)
    scene = cs.Scene(clips=[cs.Clip(0.5, cs.Pose((0.4, 0.0, 0.9), along_x))])
    print(cs.predict(cs.Cable(length=1.2, linear_density=0.1, bending_stiffness=0.01), *ends, scene=scene).status)
except RuntimeError as error:
    print(error)
"""


@pytest.mark.parametrize("error", ["KeyboardInterrupt", "ValueError('as nobody expects')"])
def test_what_could_not_be_compiled_is_an_error_and_no_crash(error):
    code = CODE.replace("ERROR", error)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    assert done.stdout.endswith(".late could not be compiled\n")
    assert ("as nobody expects" in done.stderr) == ("ValueError" in error)
