"""Nodes forked from a process that has loaded all they need: nodes as from nothing, but for the three seconds of that.

The process is this module run as a program: it reads from standard input what to start, a JSON object a line, and
writes "PID" for each, and "PID CODE" for each that has ended.
"""

from __future__ import annotations

import atexit
import contextlib
import functools
import gc
import json
import os
import selectors
import signal
import subprocess
import sys
import threading
import traceback
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NoReturn


class Forked:
    """A process that somebody else waits for, as a Popen."""

    def __init__(self, pid: int) -> None:
        self.pid = pid
        self.returncode: int | None = None
        self._gone = threading.Event()

    def ended(self, code: int) -> None:
        """It has."""
        self.returncode = code
        self._gone.set()

    def poll(self) -> int | None:
        """Its exit code once it has ended, less than 0: a signal's."""
        return self.returncode

    def wait(self, timeout: float | None = None) -> int:
        """Its exit code, once it has ended; TimeoutExpired after `timeout` [s]."""
        if not self._gone.wait(timeout):
            assert timeout is not None
            raise subprocess.TimeoutExpired(f"process {self.pid}", timeout)
        assert self.returncode is not None
        return self.returncode

    def send_signal(self, number: int) -> None:
        """If it has not ended."""
        with contextlib.suppress(ProcessLookupError):
            os.kill(self.pid, number)

    def kill(self) -> None:
        """At once."""
        self.send_signal(signal.SIGKILL)


class Nursery:
    """Starts nodes, each as `python -m cable_shape.ros.node` would."""

    def __init__(self) -> None:
        self._process = subprocess.Popen(
            [sys.executable, __file__], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        self._begun: list[Forked] = []
        self._one_more = threading.Condition()
        threading.Thread(target=self._listen, daemon=True).start()

    def _listen(self) -> None:
        nodes: dict[int, Forked] = {}
        assert self._process.stdout is not None
        for line in self._process.stdout:
            pid, *code = map(int, line.split())
            if code:
                nodes.pop(pid).ended(code[0])
                continue
            nodes[pid] = Forked(pid)
            with self._one_more:
                self._begun.append(nodes[pid])
                self._one_more.notify()

    def start(self, arguments: Sequence[str], log: Path, folder: Path, environment: Mapping[str, str]) -> Forked:
        """A node in `folder` that writes to `log`."""
        what: dict[str, Any] = {"arguments": list(arguments), "log": str(log), "folder": str(folder)}
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps({**what, "environment": dict(environment)}) + "\n")
        self._process.stdin.flush()
        with self._one_more:
            assert self._one_more.wait_for(lambda: self._begun, 120.0), "the nursery has started no node"
            return self._begun.pop()

    def close(self) -> None:
        """Starts nothing any more."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait(120.0)


@functools.cache
def nursery() -> Nursery:
    """The one of this process, which ends with it."""
    made = Nursery()
    atexit.register(made.close)
    return made


def _load() -> None:
    """All that nodes need, without a thread, a participant or a socket."""
    import tqdm
    from rclpy.utilities import get_rmw_implementation_identifier

    from cable_shape import warm_up
    from cable_shape.ros import node  # noqa: F401

    tqdm.tqdm.monitor_interval = 0  # its thread
    get_rmw_implementation_identifier()  # loads it
    warm_up()
    gc.collect()
    gc.freeze()  # nodes collect what is theirs


def _be(what: Mapping[str, Any]) -> NoReturn:
    """This process is the node from now on."""
    from cable_shape.ros import node

    try:
        signal.set_wakeup_fd(-1)
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
        signal.signal(signal.SIGINT, signal.default_int_handler)
        with open(what["log"], "wb", buffering=0) as log, open(os.devnull, "rb") as nothing:
            for file, number in ((nothing, 0), (log, 1), (log, 2)):
                os.dup2(file.fileno(), number)
        os.chdir(what["folder"])
        os.environ.clear()
        os.environ.update(what["environment"])
        sys.argv[1:] = what["arguments"]
        node.run()
    except BaseException:  # noqa: BLE001, as Python itself ends
        traceback.print_exc()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(1)


def main() -> None:
    """Until standard input ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # of the terminal: it is for nodes and tests
    _load()
    ended, tells = os.pipe()
    for end in (ended, tells):
        os.set_blocking(end, False)
    signal.set_wakeup_fd(tells)
    signal.signal(signal.SIGCHLD, lambda *_: None)
    with selectors.DefaultSelector() as waiting:
        waiting.register(0, selectors.EVENT_READ)
        waiting.register(ended, selectors.EVENT_READ)
        rest = b""
        while True:
            for key, _ in waiting.select():
                given = os.read(key.fd, 1 << 16)
                if key.fd == ended:
                    continue
                if not given:
                    return
                *lines, rest = (rest + given).split(b"\n")
                for line in lines:
                    pid = os.fork()
                    if not pid:
                        _be(json.loads(line))
                    os.write(1, f"{pid}\n".encode())
            with contextlib.suppress(ChildProcessError):
                while (gone := os.waitpid(-1, os.WNOHANG))[0]:
                    os.write(1, f"{gone[0]} {os.waitstatus_to_exitcode(gone[1])}\n".encode())


if __name__ == "__main__":
    main()
