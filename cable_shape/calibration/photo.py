"""A calibration from points clicked in a photograph of a cable that hangs in a plane: :func:`calibrate_photo`.

The plane of the cable is vertical. Pixels become metres in it by what else is clicked: four or more points whose places
in the plane are known (a homography: the camera may look from anywhere), two or three (a similarity: it looks straight
at the plane), or the two grips whose distance is known, with a plumb line.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import final

import numpy as np
from numpy.typing import ArrayLike

from cable_shape import checks
from cable_shape.cable.cable import Cable
from cable_shape.cable.cable_file import AS_GIVEN
from cable_shape.calibration.fit import calibrate
from cable_shape.calibration.observation import Observation
from cable_shape.calibration.result import Calibration, correlation_of, estimates_of
from cable_shape.calibration.tables import head_of, number_in, rows_of
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError, FileError
from cable_shape.files.files import path_of
from cable_shape.pose import FreeEnd, Grip, Pose
from cable_shape.solve.problem import GRAVITY

#: What may be clicked: the least and the largest number of each.
KINDS = {
    "start": (1, 1), "start_along": (0, 1), "end": (0, 1), "end_along": (0, 1), "point": (3, 100_000),
    "known": (0, 1000), "plumb": (0, 2),
}  # fmt: skip
COLUMNS = ("what", "u", "v", "x", "y", "arc_length")
#: [px], standard error of a click.
CLICK_ERROR = 2.0
#: So many known points make a homography, and so many a similarity.
_HOMOGRAPHY, _SIMILARITY = 4, 2
#: The error of a number is said to come from the clicks if they make more than this part of its variance.
_MOSTLY = 0.5


@final
@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Clicks:
    """What was clicked: pixels (n, 2), u to the right and v down, of each of `KINDS`.

    places : (n, 2) [m], of `known` in the plane: x to the right, y up, unless a plumb line says what is up.
    arc_length : (n,) [m], of `point`; NaN where not known.
    """

    pixels: Mapping[str, Array]
    places: Array
    arc_length: Array

    def moved(self, kind: str, row: int, axis: int, by: float) -> Clicks:
        """The same with one click off by so many pixels."""
        changed = {name: a.copy() for name, a in self.pixels.items()}
        changed[kind][row, axis] += by
        return dataclasses.replace(self, pixels=changed)


@final
@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class PhotoCalibration:
    """A calibration, and where its picture is: `to_plane` (3, 3) makes homogeneous pixels metres in the plane."""

    found: Calibration
    clicks: Clicks
    to_plane: Array


def is_photo(path: str | Path) -> bool:
    """Whether a table is one of clicks, by its first line."""
    return {"u", "v"} <= set(head_of(path))


def load_clicks(path: str | Path) -> Clicks:
    """A CSV with the columns what, u, v, of known points also x, y [m], of points also arc_length [m] if it is known.

    Raises
    ------
    ArgumentError
    """
    file = path_of(path)
    rows: dict[str, list[list[float]]] = {kind: [] for kind in KINDS}
    for line, row in rows_of(file, COLUMNS[:3], COLUMNS):
        where = f"{file}, line {line}"
        kind = row["what"].strip()
        try:
            checks.one_of("what", kind, KINDS)
            own = ("u", "v", "x", "y") if kind == "known" else ("u", "v")
            numbers = [checks.number(key, number_in(row, key, where), unit="px" if key in "uv" else "m") for key in own]
            arc = number_in(row, "arc_length", where) if row.get("arc_length") else math.nan
            rows[kind].append([*numbers, arc])
        except FileError:
            raise
        except ArgumentError as error:
            raise ArgumentError(f"{where}: {error}") from None
    for kind, (least, most) in KINDS.items():
        if not least <= len(rows[kind]) <= most:
            bound = f"there must be {least}" + ("" if most == least else f" to {most}")
            raise ArgumentError.of(f"{file}: {kind}", f"{len(rows[kind])} clicks", bound, "Click again.")
    pixels = {kind: np.array([row[:2] for row in found]).reshape(-1, 2) for kind, found in rows.items()}
    places = np.array([row[2:4] for row in rows["known"]]).reshape(-1, 2)
    return Clicks(pixels, places, np.array([row[-1] for row in rows["point"]]))


def calibrate_photo(
    clicks: Clicks | str | Path,
    cable: Cable,
    fit: str | Sequence[str] = ("bending_stiffness",),
    *,
    chord: float | None = None,
    click_error: float = CLICK_ERROR,
    priors: Mapping[str, float] | None = None,
    gravity: ArrayLike = GRAVITY,
) -> PhotoCalibration:
    """The cable whose predicted shape comes nearest to points clicked on it.

    A grip is clamped where its direction was clicked (`start_along`, `end_along`: any second point in the direction in
    which the cable runs there), else pinned; without `end` that end hangs free. The error bars hold the scatter of the
    points and what a click on anything else does to the result.

    Parameters
    ----------
    clicks : Clicks or path of a table
    cable, fit, priors, gravity
        As for :func:`cable_shape.calibrate`; gravity has to be downwards.
    chord : float, optional
        [m], distance of the two grips, where no known points were clicked.
    click_error : float
        [px], standard error of a click.

    Raises
    ------
    ArgumentError
        If the clicks do not make a plane, and as :func:`cable_shape.calibrate`.
    """
    given = clicks if isinstance(clicks, Clicks) else load_clicks(clicks)
    error = checks.number("click_error", click_error, at_least=0.0, unit="px")
    if chord is not None:
        checks.number("chord", chord, above=0.0, unit="m")

    def found_with(these: Clicks) -> Calibration:
        return calibrate([observation_of(these, chord)], cable, fit, priors=priors, gravity=gravity)

    # what holds the cable in a picture is not what will hold it in a cell
    found = dataclasses.replace(found_with(given), grips=(AS_GIVEN, AS_GIVEN))
    return PhotoCalibration(_with_clicks(found, given, found_with, error), given, plane_of(given, chord))


def observation_of(clicks: Clicks, chord: float | None = None) -> Observation:
    """The clicked points in the world: the plane is that of x and z."""
    plane = plane_of(clicks, chord)
    places = {kind: mapped(plane, pixels) for kind, pixels in clicks.pixels.items()}
    points = np.insert(places["point"], 1, 0.0, axis=1)
    end = _grip(places, "end") if len(places["end"]) else FreeEnd()
    return Observation(_grip(places, "start"), end, points, clicks.arc_length, planar=True)


def plane_of(clicks: Clicks, chord: float | None = None) -> Array:
    """(3, 3), from homogeneous pixels to homogeneous metres in the plane, x to the right and y up.

    Raises
    ------
    ArgumentError
    """
    pixels, plumb = clicks.pixels["known"], clicks.pixels["plumb"]
    if len(plumb) == 1:
        raise ArgumentError.of("plumb", "1 click", "a direction needs two", "Click its upper point, then its lower.")
    if len(pixels) >= _HOMOGRAPHY:
        plane = homography(pixels, clicks.places)
    elif len(pixels) >= _SIMILARITY:
        plane = similarity(pixels, clicks.places)
    else:
        both = np.concatenate((clicks.pixels["start"], clicks.pixels["end"]))
        if chord is None or len(both) < 2 or len(plumb) < 2:
            raise ArgumentError.of(
                "known", f"{len(pixels)} clicks", "pixels have no scale",
                "Click two points (better four or more) whose x and y are known, or start, end and a plumb line, and "
                "give the chord.",
            )  # fmt: skip
        plane = similarity(both, np.array(((0.0, 0.0), (chord, 0.0))))
    if len(plumb):
        top, bottom = mapped(plane, plumb)
        down = (bottom - top) / np.linalg.norm(bottom - top)
        turn = np.array(((-down[1], down[0], 0.0), (-down[0], -down[1], 0.0), (0.0, 0.0, 1.0)))  # onto (0, -1)
        plane = turn @ plane
    return plane


def mapped(plane: Array, pixels: Array) -> Array:
    """(n, 2) of (n, 2), by a homography (3, 3)."""
    out = np.column_stack((pixels, np.ones(len(pixels)))) @ plane.T
    return np.asarray(out[:, :2] / out[:, 2:])


def to_pixels(plane: Array, places: Array) -> Array:
    """(n, 2) [px] of (n, 2) [m]."""
    return mapped(np.asarray(np.linalg.inv(plane), dtype=np.float64), places)


def similarity(pixels: Array, places: Array) -> Array:
    """(3, 3), the one that mirrors (v is down, y up) and comes nearest to (n, 2) of (n, 2), n >= 2."""
    z, w = pixels[:, 0] - 1j * pixels[:, 1], places[:, 0] + 1j * places[:, 1]
    away = z - z.mean()
    size = float((np.abs(away) ** 2).sum())
    if size == 0.0:
        raise ArgumentError.of("known", pixels.tolist(), "they must be apart", "Click points far from each other.")
    a = (np.conj(away) * (w - w.mean())).sum() / size
    b = w.mean() - a * z.mean()
    return np.array(((a.real, a.imag, b.real), (a.imag, -a.real, b.imag), (0.0, 0.0, 1.0)))


def homography(pixels: Array, places: Array) -> Array:
    """(3, 3), from (n, 2) to (n, 2), n >= 4: the direct linear one in normalised coordinates (Hartley)."""
    scaled, into = _normalised(pixels)
    wanted, out_of = _normalised(places)
    rows = []
    for (u, v), (x, y) in zip(scaled.tolist(), wanted.tolist(), strict=True):
        rows.append((u, v, 1.0, 0.0, 0.0, 0.0, -x * u, -x * v, -x))
        rows.append((0.0, 0.0, 0.0, u, v, 1.0, -y * u, -y * v, -y))
    _, sizes, vectors = np.linalg.svd(np.array(rows))
    if sizes[7] < 1e-6 * sizes[0]:
        remedy = "Click points spread over the picture, no three of four on a line."
        raise ArgumentError.of("known", f"{len(pixels)} clicks", "they do not fix the plane", remedy)
    plane = np.linalg.inv(out_of) @ vectors[8].reshape(3, 3) @ into
    return np.asarray(plane / np.linalg.norm(plane[2]))


def _normalised(a: Array) -> tuple[Array, Array]:
    """Points about 0 at a mean distance of sqrt(2), and the matrix that brings them there."""
    middle = a.mean(axis=0)
    far = float(np.linalg.norm(a - middle, axis=1).mean())
    if far == 0.0:
        raise ArgumentError.of("known", a.tolist(), "they must be apart", "Click points far from each other.")
    s = math.sqrt(2.0) / far
    return s * (a - middle), np.array(((s, 0.0, -s * middle[0]), (0.0, s, -s * middle[1]), (0.0, 0.0, 1.0)))


def _grip(places: Mapping[str, Array], side: str) -> Grip:
    """A grip in the plane; all have the same d2 across it, so that nothing twists the cable."""
    x, y = places[side][0]
    along = places[f"{side}_along"]
    dx, dy = (along[0] - places[side][0]) if len(along) else (1.0, 0.0)
    half = 0.5 * math.atan2(dx, dy)  # d3 is z turned about y
    kind = "clamped" if len(along) else "pinned"
    return Grip(Pose((x, 0.0, y), (0.0, math.sin(half), 0.0, math.cos(half))), kind)


def _with_clicks(
    found: Calibration, clicks: Clicks, again: Callable[[Clicks], Calibration], error: float
) -> Calibration:
    """The calibration with the errors of all clicks but those on the cable, each moved and all fitted again."""
    if found.values is None or found.covariance is None or found.parameters is None or error == 0.0:
        return found
    extra = np.zeros_like(found.covariance)
    for kind, pixels in clicks.pixels.items():
        for row, axis in np.ndindex(*pixels.shape):
            if kind != "point":
                values = again(clicks.moved(kind, row, axis, error)).values
                assert values is not None
                extra += np.outer(values - found.values, values - found.values)
    covariance = found.covariance + extra
    remarks = list(found.remarks)
    with np.errstate(invalid="ignore"):
        parts = np.diag(extra) / np.diag(covariance)
    for parameter, part in zip(found.parameters.each, parts.tolist(), strict=True):
        if part > _MOSTLY:
            remarks.append(
                f"{100.0 * part:.0f} % of the variance of {parameter.name} come from the clicks on grips and known "
                "points: click them more closely, or use more known points."
            )
    return dataclasses.replace(
        found,
        covariance=covariance,
        correlation=correlation_of(covariance),
        estimates=estimates_of(found.parameters.each, found.values, covariance, found.freedom),
        remarks=tuple(remarks),
    )
