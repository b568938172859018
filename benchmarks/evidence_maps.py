"""Maps of status and smallest eigenvalue over two parameters, with what theory says drawn in."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator
from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from evidence_pages import Pages
from matplotlib.colors import BoundaryNorm, ListedColormap
from scipy.spatial.transform import Rotation
from tqdm import tqdm

import cable_shape as cs
from cable_shape.shape import CableShape, Status
from cable_shape.solve import cosserat
from cable_shape.solve.network import Network
from cable_shape.solve.problem import Problem

ALONG_X = Rotation.from_quat((0.5, 0.5, 0.5, 0.5))
STATUS_COLOURS = ("#d9e8d9", "#f2c14e", "#d1495b", "#8d99ae", "#30638e", "#000000", "#7b2d8b")
#: Times the stiffness in the plane: that of a strip which stays in it.
STRIP = 100.0
#: Heavy column, clamped-free: w L^3 / EI (Greenhill 1881).
GREENHILL = 7.837347438943483
#: First root of tan(k/2) = k/2: the antisymmetric mode of a clamped column, P = k^2 EI / L^2.
ANTISYMMETRIC = 8.986818915818128
POINTS = 41
#: Of the end, from one solve to the next.
MOST_TURNS = 0.16

#: status, smallest eigenvalue / (stiffness / length^2)
Sample = tuple[float, float]
Line = tuple[np.ndarray, np.ndarray, str]


class Map(NamedTuple):
    """One map: what was asked, its axes, and how to walk over it column by column."""

    name: str
    title: str
    text: str
    x: np.ndarray
    y: np.ndarray
    labels: tuple[str, str]
    column: Callable[[float, np.ndarray], Iterator[Sample]]
    lines: list[Line]
    log: bool = False  # of y


def sample(shape: CableShape, state: Network) -> Sample:
    """What is drawn of one shape."""
    cable = state.problem.cable
    eigenvalue = math.nan
    if shape.status and state.history:
        unit = min(*cable.bending_stiffness, cable.twisting_stiffness) / cable.length**2
        eigenvalue = cosserat.smallest_eigenvalue(state.copied()) / unit
    return shape.status.value, eigenvalue


def looping(count: int) -> Map:
    """Nearly weightless cable, ends in line, twisted: its localised shape pops into a loop where that folds back.

    Of a long rod with the homoclinic shape: M = 2 sqrt(EI T) cos(psi), shortening D = 4 sqrt(EI/T) sin(psi), so that
    the turn R = M L / GJ + 4 psi of its ends at a given D is largest where cos(2 psi) = -GJ D / (2 EI L).
    """
    EI, GJ, L = 0.01, 0.008, 1.0
    cable = cs.Cable(L, EI / (9.81 * L**3), EI, GJ)
    start, q = cs.Pose((0, 0, 0), ALONG_X.as_quat()), ALONG_X.as_quat()

    def column(chord: float, twists: np.ndarray) -> Iterator[Sample]:
        problem = Problem(cable, points=POINTS)
        state = Network(problem.move(start, cs.Pose((0.97 * L, 0, 0), q)))
        for near in np.arange(0.97, chord, -0.02):
            cosserat.solve(problem.move(start, cs.Pose((near * L, 0, 0), q)), state)
        before = 0.0
        for twist in twists:
            snapped = False
            for part in (
                np.linspace(before, twist, 1 + math.ceil((twist - before) / MOST_TURNS))[1:] if twist else (0.0,)
            ):
                turned = (ALONG_X * Rotation.from_euler("z", 2.0 * math.pi * part)).as_quat()
                shape = cosserat.solve(problem.move(start, cs.Pose((chord * L, 0, 0), turned)), state)
                snapped |= shape.status is Status.SNAPPED
            values = sample(shape, state)
            yield (Status.SNAPPED.value, values[1]) if snapped and shape.status else values
            before = twist

    D = np.linspace(0.03, 0.98, 200)
    double = np.arccos(np.clip(-GJ * D / (2 * EI * L), -1.0, 1.0))
    turn = (4 * EI * L / (GJ * D) * np.sin(double) + 2 * double) / (2 * math.pi)
    return Map(
        "map_twist", "chord x twist",
        "A nearly weightless cable, w L^3/EI = 1, ends in line, GJ = 0.8 EI, twisted up from 0 at each chord. Line: "
        "where the end rotation of the homoclinic, localised shape of a long rod folds back and the cable pops into a "
        "loop (Coyne 1990, van der Heijden et al. 2003); exact only where the loop is short beside the length, on the "
        "right. Further lines of snaps are further loops; the cable may pass through itself here.",
        np.linspace(0.3, 0.97, count), np.linspace(0.0, 6.0, count), ("chord / length", "turns of the end"), column,
        [(1.0 - D, turn, "looping (long rod)")],
    )  # fmt: skip


def bowed(count: int) -> Map:
    """A flat strip bowed upwards, its weight growing until it snaps through: the shallow elastica has a closed form.

    EI v'''' + P v'' = -w with clamped ends, v' antisymmetric and the shortening D given. The symmetric branch ends
    where P reaches the antisymmetric Euler load, tan(k/2) = k/2, where w L^3 / EI = k^2 sqrt(48 D / 5).
    """
    EI, L, weight = 0.01, 1.0, 0.981
    strip = cs.Cable(L, weight / 9.81, (EI, STRIP * EI), STRIP * EI)

    def column(chord: float, ratios: np.ndarray) -> Iterator[Sample]:
        start, end = cs.Pose((0, 0, 0), ALONG_X.as_quat()), cs.Pose((chord * L, 0, 0), ALONG_X.as_quat())
        state: Network | None = None
        for pull in (20.0, 5.0, 1.0, 0.0):  # hung upwards, then let go
            gravity = (0.0, 0.0, 9.81 * pull * EI / (weight * L**3))
            problem = Problem(strip, points=POINTS, gravity=gravity).move(start, end)
            state = state or Network(problem)
            cosserat.solve(problem, state)
        for ratio in ratios:
            gravity = (0.0, 0.0, -9.81 * EI / (weight * (ratio * L) ** 3))
            problem = Problem(strip, points=POINTS, gravity=gravity).move(start, end)
            yield sample(cosserat.solve(problem, state), state)

    D = np.geomspace(1e-4, 0.5, 200)
    critical = (ANTISYMMETRIC**2 * np.sqrt(48.0 * D / 5.0)) ** (-1.0 / 3.0)
    return Map(
        "map_bowed", "chord x stiffness length, bowed upwards",
        "A flat strip, level ends, bowed upwards; its weight grows (downwards in the picture) until it snaps through. "
        "Line: where the symmetric branch of the shallow elastica ends, w L^3/EI = k^2 sqrt(48 D/5), tan(k/2) = k/2, "
        "D = 1 - chord / length; exact on the right. A snap that turns the frames by some 0.7 rad or "
        "less may pass as a motion and be graded OK, as at the right edge; the eigenvalue shows it.",
        np.linspace(0.6, 0.999, count), np.geomspace(1.5, 0.08, count),
        ("chord / length", "(EI/w)^(1/3) / length"), column,
        [(1.0 - D, critical, "elastica: end of the symmetric branch")], True,
    )  # fmt: skip


def column_tilt(count: int) -> Map:
    """A strip standing on its clamped end, gravity swung from one side to the other: past Greenhill's load it snaps."""
    EI, L, weight = 0.01, 1.0, 0.981
    strip = cs.Cable(L, weight / 9.81, (EI, STRIP * EI), STRIP * EI)

    def column(ratio: float, tilts: np.ndarray) -> Iterator[Sample]:
        strength = 9.81 * EI / (weight * (ratio * L) ** 3)
        state: Network | None = None

        def problem(tilt: float, part: float = 1.0) -> Problem:
            g = part * strength * np.array((0.0, math.sin(tilt), -math.cos(tilt)))
            return Problem(strip, points=POINTS, gravity=g).move(cs.Pose(), None)

        for part in np.linspace(0.1, 1.0, 10):
            first = problem(math.radians(tilts[0]), part)
            state = state or Network(first)
            cosserat.solve(first, state)
        for tilt in tilts:
            yield sample(cosserat.solve(problem(math.radians(tilt)), state), state)

    line = GREENHILL ** (-1.0 / 3.0)
    return Map(
        "map_column", "gravity tilt x stiffness length of a standing strip",
        "A strip on its clamped lower end, gravity swung from -40 to 40 degrees off its axis. Stiffer than Greenhill's "
        "heavy column, w L^3/EI = 7.837, it follows; softer it leans the old way until that branch ends and snaps. The "
        "cusp, at tilt 0, is to lie on the line.",
        np.linspace(0.35, 0.65, count), np.linspace(-40.0, 40.0, count),
        ("(EI/w)^(1/3) / length", "tilt of gravity [°]"), column,
        [(np.array((line, line)), np.array((-40.0, 40.0)), "Greenhill 1881")],
    )  # fmt: skip


MAPS = (looping, bowed, column_tilt)


def samples(map_: Map) -> np.ndarray:
    """(2, y, x) of a map."""
    columns = tqdm(map_.x, desc=map_.name, unit="column", leave=False, disable=None)
    return np.array([list(map_.column(float(x), map_.y)) for x in columns], dtype=np.float64).transpose(2, 1, 0)


def draw(map_: Map, values: np.ndarray) -> plt.Figure:
    """Two panels."""
    figure, axes = plt.subplots(1, 2, figsize=(10, 4.4), sharex=True, sharey=True, layout="constrained")
    status, eigenvalue = values
    steps = BoundaryNorm(np.arange(-0.5, len(STATUS_COLOURS)), len(STATUS_COLOURS))
    mesh = axes[0].pcolormesh(map_.x, map_.y, status, cmap=ListedColormap(STATUS_COLOURS), norm=steps)
    ticks = figure.colorbar(mesh, ax=axes[0], ticks=range(len(STATUS_COLOURS)))
    ticks.ax.set_yticklabels([s.name.replace("_", "\n").lower() for s in Status], fontsize=7)
    scale = np.sign(eigenvalue) * np.log10(1.0 + np.abs(eigenvalue))
    most = max(float(np.nanpercentile(np.abs(scale), 99)), 0.1)
    mesh = axes[1].pcolormesh(map_.x, map_.y, scale, cmap="RdBu", vmin=-most, vmax=most)
    figure.colorbar(mesh, ax=axes[1])
    for ax, title in zip(axes, ("status", "eigenvalue: sign x log10(1 + |µ|)"), strict=True):
        ax.set_title(title, fontsize=10)
        for x, y, label in map_.lines:
            ax.plot(x, y, "k--", linewidth=1.4, label=label)
        ax.set_xlabel(map_.labels[0])
        if map_.log:
            ax.set_yscale("log")
        ax.set_xlim(map_.x.min(), map_.x.max())
        ax.set_ylim(map_.y.min(), map_.y.max())
    axes[0].set_ylabel(map_.labels[1])
    axes[0].legend(loc="best", fontsize=8)
    return figure


def evidence(pages: Pages) -> None:
    """All maps."""
    count = 7 if pages.quick else 41
    pages.add(
        "stability",
        "## Maps",
        f"{count} x {count} shapes each. µ is the smallest eigenvalue of the second variation in units of "
        "the smallest stiffness / length². White: no shape, so nothing to tell. A snap is shown as SNAPPED "
        "in the step in which it happens; the shape after it is followed on. Bounds of colours are each picture's own.",
    )
    for make in MAPS:
        map_ = make(count)
        values = samples(map_)
        counts = Counter(Status(int(code)).name for code in values[0].ravel())
        said = ", ".join(f"{name} {number}" for name, number in counts.most_common())
        pages.add("stability", f"### {map_.title[0].upper()}{map_.title[1:]}", map_.text)
        alt = f"Status and smallest eigenvalue over {map_.title}"
        pages.picture("stability", draw(map_, values), map_.name, alt)
        pages.add("stability", f"{said}.")
