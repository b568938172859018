"""How the viewer's window is laid out, and from where it looks at the scene. Imports rerun: see recording."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import numpy as np
import rerun.blueprint as rrb

from cable_shape.checks import Array
from cable_shape.safety.report import CycleReport
from cable_shape.scene.scene import HalfSpace, Scene
from cable_shape.viewer.bars import SEEN

BACKGROUND = (27, 30, 36, 255)
#: One plot names the lines of several cables, up to so many: a legend hides what is behind it, the mouse tells names.
MOST_NAMED = 5
ELEVATION = np.radians(24.0)  # of the line of sight above the horizon
ASIDE = np.radians(28.0)  # of the line of sight from square on to the cable, for depth


@final
@dataclass(frozen=True, slots=True)
class Eye:
    """Where the camera is and where it looks, (3,) [m], world."""

    position: Array
    target: Array


def eye(report: CycleReport, scene: Scene) -> Eye:
    """A camera that sees the cable broadside and, if there is a robot, from the side that the robot is not on."""
    cable = np.concatenate([shape.positions for shape in report.shapes.values()] or [np.zeros((1, 3))])
    cable = cable if np.isfinite(cable).all() else np.zeros((1, 3))
    centre = 0.5 * (cable.min(axis=0) + cable.max(axis=0))
    reach = max((shape.length for shape in report.shapes.values()), default=1.0)
    solid = [body.pose.position for body in scene.obstacles if not isinstance(body.solid, HalfSpace)]
    robot = np.array([pose.position for pose in (report.links or {}).values()]).reshape(-1, 3)
    around = np.concatenate((np.array(solid).reshape(-1, 3), robot))
    near = (cable, around[np.linalg.norm(around - centre, axis=1) < 2.0 * reach])
    places = np.concatenate(near)
    target = 0.5 * (places.min(axis=0) + places.max(axis=0))
    size = max(float(np.linalg.norm(np.ptp(places, axis=0))), 0.5 * reach)
    chord = _level(cable[-1] - cable[0], otherwise=(0.0, 1.0, 0.0))
    normal = np.array((chord[1], -chord[0], 0.0))
    if len(robot) and float(normal @ (centre - robot.mean(axis=0))) < 0.0:
        normal = -normal
    level = np.cos(ASIDE) * normal + np.sin(ASIDE) * chord
    sight = np.cos(ELEVATION) * level + np.sin(ELEVATION) * np.array((0.0, 0.0, 1.0))
    return Eye(position=target + max(0.9 * size, 1.05 * reach) * sight, target=target)


def _level(direction: Array, otherwise: tuple[float, float, float]) -> Array:
    """The horizontal part of a direction as a unit vector, or another one if it is upright."""
    flat = np.array((direction[0], direction[1], 0.0))
    length = float(np.linalg.norm(flat))
    return np.array(otherwise) if length < 1e-9 else flat / length


def blueprint(
    cables: Sequence[str],
    camera: Eye,
    timeline: str,
    *,
    bodies: bool,
    times: bool,
    live: bool,
    markers: bool = False,
) -> rrb.Blueprint:
    """The scene to the left; numbers over time to the right; words below.

    bodies, times, markers: whether there is clearance, time spent, and how far markers are, to plot. live: follow the
    newest report.
    """
    scene = rrb.Spatial3DView(
        origin="/world",
        name="scene",
        background=BACKGROUND,
        line_grid=rrb.LineGrid3D(visible=True, spacing=0.1, stroke_width=0.6, color=(255, 255, 255, 22)),
        eye_controls=rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital, position=camera.position, look_target=camera.target, eye_up=(0.0, 0.0, 1.0)
        ),
    )
    several = rrb.PlotLegend(corner=rrb.Corner2D.LeftTop, visible=1 < len(cables) <= MOST_NAMED)
    nobody, named = rrb.PlotLegend(visible=False), rrb.PlotLegend(corner=rrb.Corner2D.LeftTop)
    plots = [
        ("margins", "limits used (1: at the limit)", nobody, True),  # the bars name them
        ("clearance", "clearance [mm], warn (amber), error (red)", nobody, bodies),
        ("bend_radius", "smallest bend radius [mm]", nobody, True),
        ("tension", "largest tension [N]", several, True),
        ("time", "cycle time [ms], of it prediction (yellow)", nobody, times),
        ("markers", "markers to centreline [mm], inside the tube [%]", named, markers),
    ]
    numbers = [
        rrb.TimeSeriesView(origin=f"/plots/{plot}", name=title, plot_legend=legend)
        for plot, title, legend, shown in plots
        if shown
    ]
    bars = rrb.Spatial2DView(
        origin="/margins", name="limits used now", background=BACKGROUND,
        visual_bounds=rrb.VisualBounds2D(x_range=SEEN[0], y_range=SEEN[1]),
    )  # fmt: skip
    words = rrb.Horizontal(
        rrb.TextDocumentView(origin="/state", name="state"),
        rrb.TextLogView(
            origin="/warnings",
            name="warnings",
            columns=rrb.TextLogColumns(timeline_columns=[timeline], text_log_columns=["LogLevel", "Body"]),
        ),
        column_shares=[1.4, 1],
    )
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(scene, words, row_shares=[4, 1]),
            rrb.Vertical(bars, *numbers, row_shares=[1.7, 1.7, *[1.0] * (len(numbers) - 1)]),
            column_shares=[2.6, 1],
        ),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        rrb.TimePanel(
            state="collapsed",
            timeline=timeline,
            play_state="following" if live else "playing",
            loop_mode="off" if live else "all",
        ),
        auto_views=False,
        auto_layout=False,
    )
