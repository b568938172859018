"""Compiles kernels on all cores before anybody calls them: each once all that it calls is in the cache.

Processes share nothing but the cache on disk: whoever compiles a kernel loads those that it calls from there.
"""

from __future__ import annotations

import heapq
import os
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from multiprocessing import get_context
from threading import Thread
from time import sleep
from types import ModuleType
from typing import Any

from cable_shape.warm_up.kernel_list import Entry, all_kernels
from cable_shape.warm_up.signatures import types_of

MOST = 8  # processes, of up to a gigabyte each


def compile_one(entry: Entry) -> bool:
    """Compiles a kernel for its types, or loads it; False if there is no such thing any more."""
    try:
        types = types_of(entry.types)
        kernel = entry.kernel
    except (AttributeError, ImportError, ValueError):
        return False
    try:
        kernel.compile(types)
    except Exception:  # noqa: BLE001, numba raises what it likes where a kernel no longer takes these types
        return False
    return True


def _end_with(parent: int) -> None:
    """Ends this process when its parent has ended, however that was."""

    def watch() -> None:
        while os.getppid() == parent:
            sleep(1.0)
        os._exit(1)

    Thread(target=watch, daemon=True).start()


def called_by(entries: Sequence[Entry]) -> list[set[int]]:
    """For each entry the indices of entries above it that it may call: all of the kernels that its code names."""
    kernels = all_kernels()
    names = {id(kernel): name for name, kernel in kernels.items()}
    above: dict[tuple[str, str], list[int]] = {}
    calls: dict[tuple[str, str], set[tuple[str, str]]] = {}
    out = []
    for k, entry in enumerate(entries):
        own = entry.module, entry.name
        if own not in calls:
            function = kernels[own].py_func if own in kernels else None
            calls[own] = {names[id(one)] for one in _named(function) if id(one) in names} - {own}
        out.append({i for other in calls[own] for i in above.get(other, ())})
        if entry.called:
            above.setdefault(own, []).append(k)
    return out


def _named(function: Any) -> Iterator[Any]:
    """What a function's code names among the globals of its module, and in modules that it names."""
    if function is None:
        return
    names, inside = function.__code__.co_names, function.__globals__
    for name in names:
        one = inside.get(name)
        if isinstance(one, ModuleType):
            yield from (vars(one).get(other) for other in names)
        yield one


def work_of(entries: Sequence[Entry]) -> list[float]:
    """How long compiling each takes beside the others, about: by its own code, what it calls is compiled apart."""
    kernels = all_kernels()
    return [_length(kernels.get((entry.module, entry.name))) for entry in entries]


def _length(kernel: Any) -> float:
    return 1.0 if kernel is None else float(len(kernel.py_func.__code__.co_code))


def compile_all(entries: Sequence[Entry], cores: int | None = None) -> Iterator[tuple[Entry, float]]:
    """Compiles entries on so many processes ; yields each as it is done, and which part of all then is.

    What they call and is not among them has to be in the cache. Of those that can be compiled the next is that behind
    which most work of its stage waits, stage by stage.

    Raises
    ------
    BrokenProcessPool
        If the system ends one of the processes.
    """
    above = called_by(entries)
    work = work_of(entries)
    below: list[list[int]] = [[] for _ in entries]
    for k, direct in enumerate(above):
        for i in direct:
            below[i].append(k)
    behind = work.copy()
    for k in reversed(range(len(entries))):
        behind[k] += max((behind[i] for i in below[k] if entries[i].stage == entries[k].stage), default=0.0)
    stages = {stage: n for n, stage in enumerate(dict.fromkeys(entry.stage for entry in entries))}
    left = [len(direct) for direct in above]
    ready = [(stages[entry.stage], -behind[k], k) for k, entry in enumerate(entries) if not left[k]]
    heapq.heapify(ready)
    processes, whole, done = cores or min(len(os.sched_getaffinity(0)), MOST), sum(work), 0.0
    if not entries:
        return
    compile_one(entries[0])  # what numba makes ready at its first compilation goes to all that are forked
    with ProcessPoolExecutor(processes, get_context("fork"), _end_with, (os.getpid(),)) as pool:
        running: dict[Future[bool], int] = {}
        while ready or running:
            while ready and len(running) < processes:
                k = heapq.heappop(ready)[2]
                running[pool.submit(compile_one, entries[k])] = k
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                future.result()
                k = running.pop(future)
                done += work[k]
                for i in below[k]:
                    left[i] -= 1
                    if not left[i]:
                        heapq.heappush(ready, (stages[entries[i].stage], -behind[i], i))
                yield entries[k], done / whole
