"""How a process of rclpy ends, whoever else ends it."""

import subprocess
import sys

import pytest
import rclpy
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import get_default_context, ok

from cable_shape.ros import interrupt


@pytest.fixture
def running():
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    yield
    rclpy.try_shutdown()


@pytest.mark.usefixtures("running")
def test_a_signal_may_shut_rclpy_down_between_its_look_and_its_call(monkeypatch):
    def overtaken():
        handle = get_default_context().handle
        rclpy.shutdown()  # by the thread of signals
        handle.shutdown()

    monkeypatch.setattr(interrupt, "try_shutdown", overtaken)
    interrupt.shut_down()
    assert not ok()


@pytest.mark.usefixtures("running")
def test_that_it_cannot_be_shut_down_is_told(monkeypatch):
    def fails():
        raise RuntimeError("cannot")

    monkeypatch.setattr(interrupt, "try_shutdown", fails)
    with pytest.raises(RuntimeError, match="cannot"):
        interrupt.shut_down()


WITHOUT = """
import time
from cable_shape.ros import interrupt
interrupt.GRACE = 0.0
with interrupt.ends_when_told():
    time.sleep(5.0 * interrupt.LOOK)
print("to its end")
"""


def test_what_is_compiled_where_rclpy_is_not_up_is_not_ended():
    done = subprocess.run([sys.executable, "-c", WITHOUT], capture_output=True, text=True, timeout=300)
    assert done.stdout == "to its end\n", done.stderr


WITHIN = """
import os, signal, time
import numpy as np
import rclpy
from cable_shape.kernels.catenary import uniform
from cable_shape.ros import interrupt
interrupt.Interrupts.begin()
rclpy.init()
interrupt.GRACE = 60.0
try:
    with interrupt.ends_when_told():
        os.kill(os.getpid(), signal.SIGNUMBER)
        time.sleep(0.5)
        print("still compiling")
        BODY
        print("not reached")
except KeyboardInterrupt:
    print("interrupted")
try:
    os.kill(os.getpid(), signal.SIGNUMBER)
    time.sleep(5.0)
except KeyboardInterrupt:
    print("as ever")
try:
    interrupt.Interrupts.ending = True
    os.kill(os.getpid(), signal.SIGNUMBER)
    time.sleep(0.5)
    print("ending")
except KeyboardInterrupt:
    print("not reached")
"""


@pytest.mark.parametrize("number", ["SIGINT", "SIGTERM"])
@pytest.mark.parametrize(
    "body",
    [
        "uniform(np.array([0.5, 0.0, 0.0]), np.array([0.0, 0.0, -1.0]), 1.0, np.zeros(3))",
        "raise RuntimeError('to which a lost interrupt has led')",
    ],
)
def test_the_compiler_is_interrupted_between_kernels_alone(number, body):
    code = WITHIN.replace("SIGNUMBER", number).replace("BODY", body)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=300)
    assert done.stdout == "still compiling\ninterrupted\nas ever\nending\n", done.stderr
