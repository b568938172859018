"""What the processes beside the node do alike, from their start to their end: :func:`serve`.

Their arguments are two inherited descriptors, of a text that says what to do and of one that is written to as soon as
requests are served, how many clients the node knew when it started the process again, 0 at first, and the descriptor
of a mailbox that brings what edits have made of cables and bodies.
"""

from __future__ import annotations

import gc
import os
import sys
import threading
import time
from collections.abc import Callable
from functools import partial
from typing import NoReturn, final

import rclpy
from rclpy.exceptions import NotInitializedException
from rclpy.executors import ExternalShutdownException, MultiThreadedExecutor
from rclpy.node import Node
from rclpy.utilities import ok

from cable_shape.errors import InputError
from cable_shape.ros.goals import MOST_GOALS
from cable_shape.ros.interrupt import shut_down
from cable_shape.ros.workers import CalibratorSetup, PlannerSetup, clients
from cable_shape.viewer.children import be_ordinary
from cable_shape.warm_up import warm_up

_END = 0.2  # s, for threads that still hold the node, and for the middleware to say that it is gone
_AGAIN = 0.05  # s, between tries to shut down, and between looks for clients
#: Sleeps of _AGAIN within which a client that this process knows knows this process, too; longer where cores are busy.
_SETTLED = 100
#: s, three of the middleware's announcements: so long a client that ended meanwhile is waited for, or an end in order.
_LATEST = 10.0


def given() -> str:
    """The text that :class:`~cable_shape.ros.worker.WorkerProcess` gave this process."""
    with open(int(sys.argv[1]), encoding="utf-8") as file:
        file.seek(0)
        return file.read()


def news() -> int:
    """The descriptor of the mailbox."""
    return int(sys.argv[4])


@final
class Gate:
    """Shut until requests are served: after a process was started again, until this one is known.

    Those who asked the process before it come to know this one little by little, some only with the middleware's next
    announcement after three seconds; the node answers them until all do.
    """

    def __init__(self, shut: bool = False) -> None:
        self.shut = shut

    def check(self) -> None:
        """Raises InputError as long as it is shut."""
        if self.shut:
            raise InputError("the process that serves this has just been started again. Ask again in some seconds.")

    def open_when(self, known: Callable[[], bool]) -> None:
        """Opens, if it is shut not before `known` for a while, and tells the node that requests are served."""
        if self.shut:
            latest = time.monotonic() + _LATEST
            while not known() and time.monotonic() < latest:
                time.sleep(_AGAIN)
            for _ in range(_SETTLED):
                time.sleep(_AGAIN)
            self.shut = False
        serves = int(sys.argv[2])
        os.write(serves, b"1")
        os.close(serves)


def serve(setup: PlannerSetup | CalibratorSetup, make: Callable[[Node, Gate], str]) -> int:
    """Serves until the parent closes the pipe, or a signal comes.

    make: puts services and topics on the node, which ask the gate first, and says what it has put there.
    """
    be_ordinary()
    if setup.make_way:
        make_way()
    asking = int(sys.argv[3])
    serving = threading.Event()
    threading.Thread(target=_end_with_parent, args=(serving,), daemon=True).start()
    warm_up()
    serving.set()
    rclpy.init()
    try:
        node = Node(setup.name, namespace=setup.namespace, use_global_arguments=False, start_parameter_services=False)
    except (NotInitializedException, RuntimeError):  # rclpy's own, when the end comes while the node is made
        if ok():
            raise
        return 0
    executor = MultiThreadedExecutor(num_threads=MOST_GOALS + 4)
    try:
        executor.add_node(node)
        gate = Gate(shut=asking > 0)
        node.get_logger().info(make(node, gate))
        known = partial(_known, node, setup, asking)
        threading.Thread(target=gate.open_when, args=(known,), daemon=True).start()
        executor.spin()
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except RuntimeError:  # rclpy's own, when the end comes while something is created or sent
        if ok():
            raise
    finally:
        executor.shutdown(timeout_sec=_END)  # its threads hold the node
        node.destroy_node()
        shut_down()
    return 0


def _known(node: Node, setup: PlannerSetup | CalibratorSetup, asking: int) -> bool:
    """Whether this process knows as many clients as the node did; it ends while others still look."""
    try:
        return clients(node, setup) >= asking
    except RuntimeError:  # rclpy's own
        return not ok()


def make_way() -> None:
    """From now on all threads of this process run only where no other thread wants the core.

    A nice value does not do: who holds a core may keep it for some milliseconds, a whole cycle, when one that is less
    nice wakes up on it. With SCHED_IDLE it is given up at once.
    """
    for thread in os.listdir("/proc/self/task"):
        os.sched_setscheduler(int(thread), os.SCHED_IDLE, os.sched_param(0))


def leave(code: int) -> NoReturn:
    """Ends the process without waiting for work under way."""
    gc.collect()  # only then does the middleware tell the others that the node is gone
    time.sleep(_END)  # if it is let, and no thread holds the node any more
    gc.collect()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)


def _end_with_parent(serving: threading.Event) -> None:
    """Waits until standard input ends, then ends the process, which nobody knows of before it is `serving`."""
    while os.read(0, 1):
        pass
    if not serving.is_set():
        os._exit(0)
    latest = time.monotonic() + _LATEST
    while time.monotonic() < latest:  # it may just be starting
        shut_down()
        time.sleep(_AGAIN)
    os._exit(1)  # shutting down hangs, and nobody is left to end this process
