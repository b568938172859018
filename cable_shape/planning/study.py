"""Studies: one question asked of many cables: :class:`Study`.

A study says what is held, what varies and what is measured. Its points are cut into chunks by the study alone, and
every point is solved by itself from its first instant on, each instant starting from the one before: however many
workers there are, wherever they are, the answer is the same to the bit.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, final

import numpy as np

from cable_shape import checks
from cable_shape.cable.cable import Cable
from cable_shape.cable.cable_file import CableFile
from cable_shape.cable.harness import Harness
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError, UnknownKeyError
from cable_shape.files.files import path_of
from cable_shape.planning.paths import EndsPath, GripPath
from cable_shape.planning.study_beside import Beside, beside_of
from cable_shape.planning.study_best import GRID, STARTS, Best, best
from cable_shape.planning.study_case import OPTION_KEYS, Cases, motion_of
from cable_shape.planning.study_chunk import Chunk, as_json, solve_chunk
from cable_shape.planning.study_measure import measures_of
from cable_shape.planning.study_result import StudyResult
from cable_shape.planning.study_run import run_study
from cable_shape.planning.study_spread import POINTS, Envelope, Shares, envelope, shares
from cable_shape.planning.study_vary import Axis, Sample, axis_of, get, points_of, sample_of
from cable_shape.planning.study_walk import Rows, walk
from cable_shape.pose import FreeEnd, Grip, Pose, pose_entry
from cable_shape.scene.scene import Scene
from cable_shape.shape import CableShape

AT = ("worst", "all")
HELD_KEYS = ("cable", "harness", "start", "end", "ends", "scene", "robot", "motion")
STUDY_KEYS = ("name", *HELD_KEYS, "vary", "sample", "measure", "at", "chunk", *OPTION_KEYS)
#: So many instants are in a chunk at least, if no number of points is asked for.
CHUNK_INSTANTS = 4000
#: What a study's files are made by: another number cannot go on with them.
FORMAT = 1


@final
class Study:
    """What is held, what varies, and what is measured.

    Parameters
    ----------
    cable : Cable, CableFile or mapping
        Or `harness` : Harness or mapping.
    start, end : Grip, Pose, FreeEnd or mapping
        How the ends are held, and where, if no motion tells. `end` None is a free end. Of a harness `ends`, a mapping.
    scene : Scene or mapping, optional
    motion : GripPath, EndsPath or mapping, optional
        Waypoints of ends, `start` and `end` or `ends`, or of the joints of a `robot`, as its keys; with `times` [s],
        and how many `instants` are taken of it. Default: one instant.
    robot : path of a robot's YAML file, optional
    vary : mapping of a place to what it takes
        A place is named by keys with dots between them, "cable.length" or "scene.clips.mid.position.z". It takes a list
        of numbers, {"from": a, "to": b, "step": c} or {.., "count": n}, {"normal": (mean, deviation)} or {"uniform":
        (a, b)}. Every combination of the lists is a point, with every point that is drawn from the distributions.
    sample : mapping, optional
        How these are drawn: `kind` "sobol" (default), "latin" or "random", `points` (256), `seed` (0).
    measure : sequence of names or mappings
        See :mod:`cable_shape.planning.study_measure`. A mapping has a `measure`, and a `limit` or what is `worst`.
        Default: bend radius, tension, clearance.
    functions : mapping of name to callable, optional
        Further measures: a function of a CableShape that returns a number. For several workers it must be one of a
        module that they can import.
    at : str
        "worst": of every point the worst instant; "all": every instant, too.
    chunk : int, optional
        Points that are solved together. Default: some 4000 instants.
    name, model, gravity, points, tolerance, distributed_load
        As of :func:`cable_shape.predict`.

    Raises
    ------
    ArgumentError
        Naming the value, the bound and the remedy.
    """

    def __init__(
        self,
        cable: Any = None,
        *,
        functions: Mapping[str, Callable[[CableShape], float]] | None = None,
        folder: str | Path = ".",
        **values: Any,
    ) -> None:
        if cable is not None:
            values["cable"] = cable
        checks.known_keys("study", values, STUDY_KEYS)
        self.folder = path_of(folder, "folder")
        self.functions = dict(functions or {})
        for name, function in self.functions.items():
            checks.word("functions", name)
            if not callable(function):
                raise ArgumentError.of(f"functions[{name!r}]", function, "it must be a function", "Give a function.")
        self.values = {key: _plain(key, value) for key, value in values.items() if value is not None}
        if ("cable" in self.values) == ("harness" in self.values):
            raise ArgumentError("a study needs a cable or a harness. Write cable: {length: .., linear_density: ..}.")
        self._read_files()
        self.name = str(self.values.get("name", "study"))
        given = checks.mapping("vary", self.values.get("vary"), self.values.get("vary") or (), "Write {place: values}.")
        self.axes: tuple[Axis, ...] = tuple(axis_of(str(name), told) for name, told in given.items())
        for axis in self.axes:
            if axis.name.partition(".")[0] not in (*HELD_KEYS, *OPTION_KEYS):
                bound = "this place is no part of a study"
                raise ArgumentError.of("vary", axis.name, bound, f"Begin with one of {', '.join(HELD_KEYS)}.")
            get(self.values, axis.name)
        self.sample: Sample = sample_of(self.values.get("sample"))
        self.at = checks.one_of("at", self.values.get("at", "worst"), AT)
        self.cases = Cases(self.values, self.axes, self.folder)
        self._check_keys()
        self.measures = self._measures()
        self._chunk = checks.integer("chunk", self.values.get("chunk", 0), at_least=0)

    def _read_files(self) -> None:
        """Puts what files of cable, harness and scene say in the place of their names, so that it may vary."""
        from cable_shape.files.yaml_files import load_yaml

        for key in ("cable", "harness"):
            if isinstance(self.values.get(key), str):
                self.values[key] = load_yaml(self.folder / path_of(self.values[key], key))
        told = self.values.get("scene")
        if isinstance(told, str):
            self.values["scene"] = Scene.from_yaml(self.folder / path_of(told, "scene")).as_dict()
        elif isinstance(told, Mapping):
            self.values["scene"] = Scene.from_mapping(told, folder=self.folder).as_dict()

    def _check_keys(self) -> None:
        """Refuses names that mean nothing; a point without a case, a clip beyond the end, is told when it is solved."""
        try:
            self.cases.at([axis.middle for axis in self.axes])
        except UnknownKeyError:
            raise
        except ArgumentError:
            return

    def _measures(self) -> Any:
        """What is measured, held against the bodies and clips that there are at the first point."""
        scene = Scene.from_mapping(self.values["scene"]) if "scene" in self.values else Scene()
        robot = self.cases.robot
        bodies = [body.name for body in (*scene.obstacles, *(() if robot is None else robot.link_geometry))]
        return measures_of(self.values.get("measure"), self.functions, bodies, scene)

    @classmethod
    def from_mapping(cls, values: Mapping[str, Any], where: str = "study", **more: Any) -> Study:
        """From a mapping whose keys are the keywords of Study; `more`: its functions and folder."""
        checks.known_keys(where, values, STUDY_KEYS)
        try:
            return cls(**{**values, **more})
        except ArgumentError as error:
            raise type(error)(f"{where}: {error}") from None

    @classmethod
    def from_yaml(cls, path: str | Path, **more: Any) -> Study:
        """From a YAML file whose keys are the keywords of Study; paths in it are taken from its folder."""
        from cable_shape.files.yaml_files import load_yaml

        file = path_of(path, "study")
        values = {"name": file.stem, **load_yaml(file, STUDY_KEYS)}
        return cls.from_mapping(values, str(path), folder=file.parent, **more)

    # -- its points

    @cached_property
    def points(self) -> Array:
        """(p, axes), a row a point."""
        return points_of(self.axes, self.sample)

    @cached_property
    def chunk(self) -> int:
        """Points that are solved together."""
        if self._chunk:
            return self._chunk
        instants = self.cases.instants_at(self.points[0])
        return max(1, math.ceil(CHUNK_INSTANTS / instants))

    @property
    def chunks(self) -> int:
        """How many chunks there are."""
        return math.ceil(len(self.points) / self.chunk)

    @cached_property
    def beside(self) -> Beside | None:
        """What solves its points from the one in their middle, where tolerances vary; None: each by itself."""
        middle = [axis.middle for axis in self.axes]
        try:
            return beside_of(self.cases.at(middle), self.cases.told(middle), self.axes)
        except ArgumentError:
            return None

    @cached_property
    def fingerprint(self) -> str:
        """The same for the same question."""
        told = {**self.values, "functions": sorted(self.functions), "format": FORMAT, "chunk": self.chunk}
        return hashlib.sha256(as_json(told).encode()).hexdigest()

    def solve(self, chunk: int) -> Chunk:
        """The points of a chunk, solved here and now."""
        rows = self.points[chunk * self.chunk : (chunk + 1) * self.chunk]
        return solve_chunk(self.cases, self.measures, rows, self.at == "all", self.beside)

    def rows(self, point: int | Sequence[float]) -> dict[str, Rows]:
        """All shapes of one point, by segment; of a cable under the name ""."""
        row = self.points[point].tolist() if isinstance(point, (int, np.integer)) else point
        return walk(self.cases.at(row))

    def run(
        self,
        out: str | Path | None = None,
        *,
        workers: int | None = None,
        scheduler: str | None = None,
        progress: Callable[[int, int], None] | None = None,
    ) -> StudyResult:
        """Solves all points.

        Parameters
        ----------
        out : path of a folder, optional
            Keeps every chunk that is done: the same study run again goes on from there.
        workers : int, optional
            Processes, threads where points are solved `beside` one; 1 solves here. Default: as many as there are cores
            to run on.
        scheduler : str, optional
            "local" for a Dask cluster on this machine, or the address of one, in place of processes.
        progress : callable, optional
            Told how many points are done, and how many there are.

        Raises
        ------
        ArgumentError
            If the folder has another study in it.
        FileError
            If it cannot be written to; what was done is kept.
        DependencyError
            If no cluster answers.
        """
        return run_study(self, out, workers, scheduler, progress)

    def best(self, *, precision: float = 1e-4, grid: int = GRID, starts: int = STARTS) -> Best:
        """The point that is furthest from its nearest limit, see :func:`cable_shape.planning.study_best.best`."""
        return best(self, precision=precision, grid=grid, starts=starts)

    def shares(self, points: int = POINTS, seed: int = 0) -> Shares:
        """What makes its measures unsure, see :func:`cable_shape.planning.study_spread.shares`."""
        return shares(self, points, seed)

    def envelope(self, confidence: float = 0.95, instant: int = 0) -> Envelope:
        """Where the cable is with a confidence, see :func:`cable_shape.planning.study_spread.envelope`."""
        return envelope(self, confidence, instant)

    def __getstate__(self) -> dict[str, Any]:
        return {"values": self.values, "functions": self.functions, "folder": self.folder}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__init__(**state["values"], functions=state["functions"], folder=state["folder"])

    def __repr__(self) -> str:
        varied = ", ".join(axis.name for axis in self.axes) or "nothing"
        told = ", ".join(measure.name for measure in self.measures)
        return f"Study({self.name}: {len(self.points)} points, {varied} varies, measures {told})"


def _plain(key: str, value: Any) -> Any:
    """An object as the mapping that makes it."""
    if isinstance(value, (Cable, CableFile, Harness, Scene)):
        return value.as_dict()
    if key == "motion" and isinstance(value, (GripPath, EndsPath)):
        return motion_of(value)
    if isinstance(value, (Pose, Grip, FreeEnd)):
        return _end_entry(value)
    if key in ("ends", "motion", "vary", "sample") and isinstance(value, Mapping):
        return {name: _plain("", one) for name, one in value.items()}
    return value


def _end_entry(end: Pose | Grip | FreeEnd) -> dict[str, Any]:
    if isinstance(end, FreeEnd):
        return {"mass": end.mass, "force": end.force.tolist(), "moment": end.moment.tolist()}
    if isinstance(end, Pose):
        return pose_entry(end)
    more = {"offset": pose_entry(end.offset), "curvature": end.curvature.tolist()}
    return {**pose_entry(end.pose), "kind": end.kind, **more}
