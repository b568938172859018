"""A picture of a calibration: predicted centrelines with the observed points, and how far these are off."""

from __future__ import annotations

import io
import warnings
from pathlib import Path
from typing import Any

import numpy as np

from cable_shape.calibration.photo import PhotoCalibration, to_pixels
from cable_shape.calibration.result import Calibration
from cable_shape.checks import Array
from cable_shape.errors import ArgumentError, FileError
from cable_shape.files.files import read_bounded

#: Larger pictures are refused.
IMAGE_BYTES = 64 * 1024 * 1024

_BLUE, _RED, _GREY = "#2563a8", "#c0392b", "#666666"
_SHOWN = 5


def draw(found: Calibration, path: Path) -> None:
    """Writes the picture; without a screen."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    if not found.centrelines:
        raise ArgumentError("A picture needs observed points; there are none in a sag. Write the report as .txt.")
    figure = Figure(figsize=(12.0, 5.6), dpi=110)
    FigureCanvasAgg(figure)
    axes = figure.subplots(2, 3)
    usable = [i for i, line in enumerate(found.centrelines) if np.isfinite(line).all()]
    means = [_mean(found, i) for i in usable]
    order = [usable[i] for i in np.argsort(means)]
    chosen = [order[k] for k in np.unique(np.linspace(0, len(order) - 1, _SHOWN).round().astype(int))]
    for axis, i in zip(axes.flat, chosen, strict=False):
        side_view(axis, found.centrelines[i], found.points[i])
        axis.set_title(f"observation {i}: mean miss {1e3 * _mean(found, i):.1f} mm", fontsize=9)
    for axis in list(axes.flat)[len(chosen) : _SHOWN]:
        axis.set_axis_off()
    last = axes.flat[_SHOWN]
    last.hist(1e3 * found.distances[np.isfinite(found.distances)], bins=40, color=_BLUE)
    last.set(title="all points", xlabel="miss [mm]", ylabel="points")
    figure.tight_layout()
    figure.savefig(path, metadata={"Software": None})


def draw_photo(photo: PhotoCalibration, path: Path, image: Path | None = None) -> None:
    """Writes the picture of a calibration from a photograph: clicks and prediction in pixels, over the image if there
    is one, and how far each point is off along the cable."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    found, clicks = photo.found, photo.clicks
    figure = Figure(figsize=(12.0, 5.6), dpi=110)
    FigureCanvasAgg(figure)
    left, right = figure.subplots(1, 2, width_ratios=(1.6, 1.0))
    if image is not None:
        left.imshow(_image(image))
    else:
        left.set_aspect("equal", adjustable="datalim")
        left.invert_yaxis()
    line = to_pixels(photo.to_plane, found.centrelines[0][:, [0, 2]])
    left.plot(*line.T, color=_BLUE, lw=1.5, label="predicted")
    left.plot(*clicks.pixels["point"].T, "o", color=_RED, ms=3.5, label="clicked on the cable")
    others = np.concatenate([clicks.pixels[kind] for kind in ("start", "end", "known")])
    left.plot(*others.T, "s", color=_GREY, ms=4, label="grips and known points")
    left.legend(fontsize=8)
    left.set(xlabel="u [px]", ylabel="v [px]")
    misses = found.distances[np.isfinite(found.distances)]
    right.plot(1e3 * misses, "o", color=_BLUE, ms=4)
    right.set(xlabel="point", ylabel="miss [mm]", title=f"mean {1e3 * misses.mean():.2g} mm", ylim=(0.0, None))
    figure.tight_layout()
    figure.savefig(path, metadata={"Software": None})


def _image(path: Path) -> Any:
    """What matplotlib reads of an image."""
    from matplotlib.image import imread
    from PIL.Image import DecompressionBombError, DecompressionBombWarning

    content = io.BytesIO(read_bounded(path, IMAGE_BYTES, "image"))
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", DecompressionBombWarning)
            return imread(content, format=path.suffix[1:].lower())
    except (OSError, SyntaxError, ValueError, DecompressionBombError, DecompressionBombWarning) as error:
        raise FileError(f"{path}: cannot be read as an image ({error}). Give a PNG or JPEG.") from None


def side_view(axis: Any, line: Array, points: Array) -> None:
    """A centreline (n, 3) and points (m, 3), seen across the vertical plane through the ends."""
    across = line[-1, :2] - line[0, :2]
    across = across / max(float(np.linalg.norm(across)), 1e-12)
    axis.plot((line[:, :2] - line[0, :2]) @ across, line[:, 2], color=_BLUE, lw=1.5, label="predicted")
    axis.plot((points[:, :2] - line[0, :2]) @ across, points[:, 2], "o", color=_RED, ms=3.5, label="observed")
    axis.plot(
        [0.0, (line[-1, :2] - line[0, :2]) @ across], line[[0, -1], 2], "s", color=_GREY, ms=4, label="ends as fitted"
    )
    axis.set_aspect("equal", adjustable="datalim")
    axis.tick_params(labelsize=8)


def _mean(found: Calibration, i: int) -> float:
    first = sum(len(points) for points in found.points[:i])
    return float(found.distances[first : first + len(found.points[i])].mean())
