"""`cable-shape study`: a study's file to tables, a report and recordings of its worst instants."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from cable_shape.command.study_file import add_function, read_study
from cable_shape.command.study_words import summary
from cable_shape.planning.study import Study
from cable_shape.planning.study_result import StudyResult

FORMATS = ("csv", "parquet")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Its options."""
    parser.add_argument("file", type=Path, metavar="STUDY.yaml", help="what is held, varies and is measured")
    parser.add_argument("-o", "--out", type=Path, required=True, metavar="OUT", help="a folder; begun once, it goes on")
    parser.add_argument("--workers", type=int, metavar="N", help="processes (as many as there are cores)")
    parser.add_argument("--scheduler", metavar="ADDRESS", help="of a Dask cluster, tcp://host:8786; or: local")
    parser.add_argument("--format", choices=FORMATS, default="csv", help="of the tables (csv)")
    parser.add_argument("--no-report", action="store_true", help="write the tables only")
    parser.add_argument("--no-rrd", action="store_true", help="write no recordings of worst points")
    add_function(parser)


def run(arguments: argparse.Namespace) -> int:
    """Solves what is left, writes everything, and says what was found."""
    study = read_study(arguments.file, arguments.function)
    with _Progress(study) as progress:
        try:
            found = study.run(
                arguments.out, workers=arguments.workers, scheduler=arguments.scheduler, progress=progress
            )
        except KeyboardInterrupt:
            text = f"{progress.done} of {progress.whole} points are in {arguments.out}; the same command goes on"
            print(f"cable-shape: {text}", file=sys.stderr)
            raise
    written = tables(found, arguments.out, arguments.format)
    if not arguments.no_report:
        from cable_shape.command.study_report import write_report

        written += write_report(found, arguments.out, recordings=not arguments.no_rrd)
    for line in summary(found):
        print(line)
    print("written:", ", ".join(str(path) for path in written))
    return 0


def tables(found: StudyResult, out: Path, kind: str) -> list[Path]:
    """The tables of worst instants, and of all where they are kept."""
    written = [found.save(out / f"results.{kind}")]
    if found.study.at == "all":
        written.append(found.save(out / f"instants.{kind}", instants=True))
    return written


class _Progress:
    """A bar on stderr, if that is a terminal, with the time that is left."""

    def __init__(self, study: Study) -> None:
        from tqdm import tqdm

        self.done, self.whole = 0, len(study.points)
        self._bar: Any = tqdm(total=self.whole, unit=" points", disable=None, leave=False, file=sys.stderr)

    def __call__(self, done: int, whole: int) -> None:
        if not self.done:
            self._bar.initial = self._bar.n = done
        self._bar.update(done - self._bar.n)
        self.done = done

    def __enter__(self) -> _Progress:
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.close()
