"""Nodes and programs forked from a process that has loaded all they need: as from nothing, without three seconds of it.

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
import tempfile
import threading
import types
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

NODES, PROGRAMS = "nodes", "programs"


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
    """Starts processes as `python` would: with `-m cable_shape.ros.node`, or with `-W error` and a program."""

    def __init__(self, kind: str) -> None:
        strict = ["-W", "error"] if kind == PROGRAMS else []
        command = [sys.executable, *strict, __file__, kind]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
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

    def start(
        self, arguments: Sequence[str], out: Path, error: Path, folder: Path, environment: Mapping[str, str]
    ) -> Forked:
        """A process in `folder` that writes to `out` and `error`, which may be one.

        arguments: as of a command line; of a program "-c", CODE or a path, ...
        """
        what: dict[str, Any] = {"arguments": list(arguments), "environment": dict(environment)}
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps({**what, "files": [str(out), str(error)], "folder": str(folder)}) + "\n")
        self._process.stdin.flush()
        with self._one_more:
            assert self._one_more.wait_for(lambda: self._begun, 120.0), "the nursery has started nothing"
            return self._begun.pop()

    def close(self) -> None:
        """Starts nothing any more."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait(120.0)


@functools.cache
def nursery(kind: str) -> Nursery:
    """The one of this process, which ends with it."""
    made = Nursery(kind)
    atexit.register(made.close)
    return made


def run_program(*arguments: str, folder: Path, timeout: float = 600.0) -> subprocess.CompletedProcess[str]:
    """A program that has ended, see :meth:`Nursery.start`."""
    with tempfile.TemporaryDirectory() as told:
        out, error = Path(told, "out"), Path(told, "error")
        program = nursery(PROGRAMS).start(arguments, out, error, folder, os.environ)
        try:
            code = program.wait(timeout)
        finally:
            program.kill()
        return subprocess.CompletedProcess(arguments, code, out.read_text(), error.read_text())


def _load(kind: str) -> None:
    """All that is needed, without a thread, a participant or a socket."""
    import tqdm

    import cable_shape

    tqdm.tqdm.monitor_interval = 0  # its thread
    if kind == NODES:
        from rclpy.utilities import get_rmw_implementation_identifier

        from cable_shape.ros import node  # noqa: F401

        get_rmw_implementation_identifier()  # loads it
    cable_shape.warm_up()
    gc.collect()
    gc.freeze()  # those that are forked collect what is theirs


def _be(kind: str, what: Mapping[str, Any]) -> None:
    """This process is another from now on."""
    signal.set_wakeup_fd(-1)
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    for number, (name, how) in enumerate(((os.devnull, "rb"), *((name, "ab") for name in what["files"]))):
        with open(name, how) as file:
            os.dup2(file.fileno(), number)
    os.chdir(what["folder"])
    os.environ.clear()
    os.environ.update(what["environment"])
    if kind == NODES:
        from cable_shape.ros import node

        sys.argv[1:] = what["arguments"]
        node.run()
    sys.argv[:] = what["arguments"]
    main_module = sys.modules["__main__"] = types.ModuleType("__main__")
    if sys.argv[0] == "-c":
        sys.path[0] = ""
        code = sys.argv.pop(1)
    else:
        sys.path[0] = str(Path(sys.argv[0]).parent)
        main_module.__file__ = sys.argv[0]
        code = Path(sys.argv[0]).read_text(encoding="utf-8")
    exec(compile(code, sys.argv[0], "exec"), main_module.__dict__)  # noqa: S102, as python does
    sys.exit()


def main() -> None:
    """Until standard input ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # of the terminal: it is for nodes and tests
    kind = sys.argv[1]
    _load(kind)
    ended, tells = os.pipe()
    for end in (ended, tells):
        os.set_blocking(end, False)
    signal.set_wakeup_fd(tells)
    signal.signal(signal.SIGCHLD, lambda *_: None)
    alive: set[int] = set()
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
                    for pid in alive:  # of tests that were broken off
                        os.kill(pid, signal.SIGTERM)
                    return
                *lines, rest = (rest + given).split(b"\n")
                for line in lines:
                    pid = os.fork()
                    if not pid:
                        _be(kind, json.loads(line))
                    alive.add(pid)
                    os.write(1, f"{pid}\n".encode())
            with contextlib.suppress(ChildProcessError):
                while (gone := os.waitpid(-1, os.WNOHANG))[0]:
                    alive.discard(gone[0])
                    os.write(1, f"{gone[0]} {os.waitstatus_to_exitcode(gone[1])}\n".encode())


if __name__ == "__main__":
    main()
