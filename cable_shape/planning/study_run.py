"""Who solves a study's chunks: this process, others beside it, or a cluster; and what is kept of them: `run_study`."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor, wait
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from cable_shape import checks
from cable_shape.errors import ArgumentError, DependencyError
from cable_shape.files.files import path_of
from cable_shape.planning.study_chunk import Chunk, load_chunk, write
from cable_shape.planning.study_result import Question, StudyResult

MOST_WORKERS = 256
#: Chunks that are given to each worker in advance.
AHEAD = 4
#: [s], so long a cluster may take to answer.
PATIENCE = 10.0
_STUDY = "study.json"
_own: Any = None  # the study of a worker process


def run_study(
    study: Question,
    out: str | Path | None,
    workers: int | None,
    scheduler: str | None,
    progress: Callable[[int, int], None] | None,
) -> StudyResult:
    """See :meth:`Study.run`."""
    if workers is not None:
        checks.integer("workers", workers, at_least=1, at_most=MOST_WORKERS)
    folder = None if out is None else _begun(study, path_of(out, "out"))
    found: dict[int, Chunk] = {}
    for i in range(study.chunks) if folder is not None else ():
        assert folder is not None
        kept = load_chunk(folder / f"{i:06d}.npz")
        if kept is not None:
            found[i] = kept
    left = [i for i in range(study.chunks) if i not in found]
    done = sum(len(chunk.value) for chunk in found.values())
    if progress is not None:
        progress(done, len(study.points))
    for i, chunk in _solved(study, left, workers, scheduler):
        if folder is not None:
            chunk.save(folder / f"{i:06d}.npz")
        found[i] = chunk
        done += len(chunk.value)
        if progress is not None:
            progress(done, len(study.points))
    return StudyResult(study, [found[i] for i in range(study.chunks)])


def _begun(study: Question, place: Path) -> Path:
    """The folder of chunks; a new one says whose they are."""
    told = place / _STUDY
    if told.exists():
        try:
            whose = json.loads(told.read_text(encoding="utf-8")).get("fingerprint")
        except (OSError, ValueError, AttributeError):
            whose = None
        if whose != study.fingerprint:
            bound = "another study is in this folder, or this one as it was before"
            raise ArgumentError.of("out", str(place), bound, "Name another folder, or remove this one.")
    elif place.exists() and (not place.is_dir() or any(place.iterdir())):
        bound = "something else is there already"
        raise ArgumentError.of("out", str(place), bound, "Name a new folder.")
    (place / "chunks").mkdir(parents=True, exist_ok=True)
    if not told.exists():
        text = {"fingerprint": study.fingerprint, "name": study.name, "points": len(study.points)}
        write(told, json.dumps(text).encode())
    return place / "chunks"


def _solved(
    study: Question, left: list[int], workers: int | None, scheduler: str | None
) -> Iterator[tuple[int, Chunk]]:
    """Chunks as they come."""
    if scheduler is not None:
        yield from _on_cluster(study, left, workers, scheduler)
        return
    count = min(workers or len(os.sched_getaffinity(0)), len(left))
    if count <= 1:
        for i in left:
            yield i, study.solve(i)
        return
    solve: Callable[[int], Chunk] = _solve
    pool: Executor
    if study.beside is None:
        pool = ProcessPoolExecutor(count, get_context("spawn"), initializer=_begin, initargs=(study,))
    else:  # compiled code all along, which threads run side by side
        pool, solve = ThreadPoolExecutor(count), study.solve
    with pool:
        waiting: dict[Future[Chunk], int] = {}
        todo = iter(left)
        try:
            while True:
                for i in todo:
                    waiting[pool.submit(solve, i)] = i
                    if len(waiting) >= AHEAD * count:
                        break
                if not waiting:
                    return
                ready, _ = wait(waiting, return_when=FIRST_COMPLETED)
                for one in ready:
                    yield waiting.pop(one), one.result()
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


def _begin(study: Question) -> None:
    """What a worker process begins with."""
    global _own
    _own = study


def _solve(chunk: int) -> Chunk:
    found: Chunk = _own.solve(chunk)
    return found


# -- a cluster


_known: dict[str, Any] = {}  # studies of a worker of a cluster, by fingerprint: one at a time


def solve_there(study: Question, fingerprint: str, chunk: int) -> Chunk:
    """A chunk, on a worker of a cluster; the same study is made ready once."""
    if fingerprint not in _known:
        _known.clear()
        _known[fingerprint] = study
    found: Chunk = _known[fingerprint].solve(chunk)
    return found


def _on_cluster(study: Question, left: list[int], workers: int | None, scheduler: str) -> Iterator[tuple[int, Chunk]]:
    """Chunks as a Dask cluster solves them; those of a worker that dies are solved again by others."""
    import distributed

    dask: Any = distributed
    cluster: Any = None
    if scheduler == "local":
        count = workers or len(os.sched_getaffinity(0))
        cluster = dask.LocalCluster(n_workers=count, threads_per_worker=1, dashboard_address=None)
    try:
        with dask.Client(scheduler if cluster is None else cluster, timeout=PATIENCE) as client:
            there = client.scatter(study, broadcast=True, hash=False)
            most = AHEAD * max(1, sum(client.nthreads().values()))
            todo = iter(left)

            def more(n: int) -> list[Any]:
                return [
                    client.submit(solve_there, there, study.fingerprint, i, key=f"{study.fingerprint}-{i}", retries=3)
                    for _, i in zip(range(n), todo, strict=False)
                ]

            running = dask.as_completed(more(most))
            for future in running:
                i = int(future.key.rpartition("-")[2])
                chunk = future.result()
                future.release()
                for new in more(1):
                    running.add(new)
                yield i, chunk
    except (OSError, ValueError) as error:
        if isinstance(error, ArgumentError):
            raise
        remedy = "Start one with `dask scheduler` and `dask worker`, or write --scheduler local."
        raise DependencyError(f"--scheduler {scheduler}: no cluster answers there ({error}). {remedy}") from None
    finally:
        if cluster is not None:
            cluster.close()
