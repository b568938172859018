"""What the processes beside the node do alike, from their start to their end: :func:`serve`."""

from __future__ import annotations

import gc
import os
import sys
import threading
import time
from collections.abc import Callable
from typing import NoReturn

import rclpy
from rclpy.executors import ExternalShutdownException, MultiThreadedExecutor
from rclpy.node import Node
from rclpy.utilities import ok, try_shutdown

from cable_shape.warm_up import warm_up

MOST_GOALS = 4  # of an action under way at the same time, one of them being worked on
_AGAIN = 0.05  # s, between tries to shut down


def told() -> str:
    """The text that :class:`~cable_shape.ros.worker.WorkerProcess` gave this process."""
    with open(int(sys.argv[1]), encoding="utf-8") as file:
        file.seek(0)
        return file.read()


def serve(name: str, namespace: str, niceness: int, make: Callable[[Node], str]) -> int:
    """Serves until the parent closes the pipe, or a signal comes.

    make: puts services and topics on the node, and says what it has put there.
    """
    os.nice(niceness)
    serving = threading.Event()
    threading.Thread(target=_end_with_parent, args=(serving,), daemon=True).start()
    warm_up()
    serving.set()
    rclpy.init()
    node = Node(name, namespace=namespace, use_global_arguments=False, start_parameter_services=False)
    try:
        executor = MultiThreadedExecutor(num_threads=MOST_GOALS + 4)
        executor.add_node(node)
        node.get_logger().info(make(node))
        executor.spin()
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except RuntimeError:  # rclpy's own, when the end comes while something is created or sent
        if ok():
            raise
    finally:
        node.destroy_node()
        try_shutdown()
    return 0


def leave(code: int) -> NoReturn:
    """Ends the process without waiting for work under way."""
    gc.collect()  # only then does the middleware tell the others that the node is gone
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)


def _end_with_parent(serving: threading.Event) -> None:
    """Waits until standard input ends, then ends the process, which nobody knows of before it is `serving`."""
    while os.read(0, 1):
        pass
    if not serving.is_set():
        os._exit(0)
    while True:  # it may just be starting
        try_shutdown()
        time.sleep(_AGAIN)
