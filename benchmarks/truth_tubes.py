"""How many markers of real cables the tubes hold, by kind of frame: at rest, slow, faster, and whole recordings.

One fit a cable and part, with inertial load, to calm frames ("quasi") of two thirds of the trajectories; judged on the
others' calm, slow and faster frames, predicted with the measured accelerations as a load and without any, and on the
two recordings of each cable, step by step as in a cell. How large an unknown load is taken for comes from no data;
which part of a given acceleration stands for the model's error was chosen on the faster frames here.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from figures import Figures, heading
from scipy.spatial.transform import Rotation
from tqdm import tqdm
from truth_data import CABLES, DATA, Frames, carried, distances, load
from truth_limits import line

import cable_shape as cs
from cable_shape.calibration.parameters import held
from cable_shape.replay.observations import from_bag
from cable_shape.uncertainty.tube_watch import TubeWatch, left_out

KINDS = ("quasi", "slow", "moderate")
PARTS = 3
G = 9.81
ONE = ("bending_stiffness",)
HELPS = ("bending_stiffness", "length", "start_tilt", "end_tilt", "start_offset", "end_offset")
PRIORS = {"length": 0.005, "start_tilt": 0.15, "end_tilt": 0.15, "start_offset": 0.005, "end_offset": 0.005}
#: Of steps of a recording, those that are judged.
EVERY = 5


def fitted(seen: list[cs.Observation], cable: cs.Cable) -> cs.Calibration:
    """All that helps, with inertial load."""
    return cs.calibrate(seen, cs.calibrate(seen, cable, ONE).cable, HELPS, priors=PRIORS)


def largest(seen: cs.Observation) -> float:
    """Largest load of the inertia along the cable as a fraction of its weight, from the measured accelerations.

    In a cell it is told by how the grips move, now and before; a frame by itself has no past.
    """
    assert seen.acceleration is not None
    return float(np.linalg.norm(seen.acceleration[:, :3], axis=1).max()) / G


def as_fitted(number: int, seen: list[cs.Observation]) -> list[cs.Observation]:
    """Frames of a recording with the roll of the single frames' grips: tilts and offsets were fitted in these."""
    with np.load(DATA / f"cable{number}_frames.npz", allow_pickle=False) as d:
        x = d["frames"].astype(np.float64)
    turned = []
    for side, like in (("start", x[:, 1] - x[:, 0]), ("end", x[:, -1] - x[:, -2])):
        grips = [getattr(one, side) for one in seen]
        axes = Rotation.from_quat([grip.pose.quaternion for grip in grips]).as_matrix()[:, :, 2]
        frames = zip(grips, carried(axes, like), strict=True)
        turned.append([cs.Grip(cs.Pose(grip.pose.position, turn), grip.kind) for grip, turn in frames])
    return [cs.Observation(*grips, one.points) for *grips, one in zip(*turned, seen, strict=True)]


def inside(tube: cs.Tube, points: np.ndarray) -> np.ndarray:
    """(m,), whether the tube holds each observed point."""
    apart = np.linalg.norm(points[:, None] - tube.shape.positions[None], axis=2)
    return np.asarray(distances(tube.shape, points) <= tube.radius[apart.argmin(axis=1)])


class Tubes:
    """Shapes of a calibrated cable with their tubes, each from the last."""

    def __init__(self, found: cs.Calibration) -> None:
        assert found.parameters is not None
        assert found.values is not None
        self._offsets = [found.parameters.offset(found.values, side) for side in ("start", "end")]
        self._rod = cs.Predictor(found.cable, model="cosserat", points=101)
        known = cs.Uncertainty.of(found)
        self._watch = TubeWatch(found.cable, known, found.parameters, found.values, points=101)

    def tube(self, seen: cs.Observation, inertia: float) -> cs.Tube | None:
        """Of one observation."""
        ends = [held(end, offset) for end, offset in zip((seen.start, seen.end), self._offsets, strict=True)]
        shape = self._rod.predict(ends[0], ends[1], acceleration=seen.acceleration)  # type: ignore[arg-type]
        return self._watch.tube(self._rod, shape, (seen.start, seen.end), None, seen.acceleration, inertia)


#: Of frames: what is told, observations, and the load that the prediction leaves out.
ROWS: tuple[tuple[str, str, Callable[[cs.Calibration, cs.Observation], float]], ...] = (
    ("inertial load", "moving", lambda found, seen: left_out(found, seen.acceleration)),  # type: ignore[arg-type]
    ("static, as if at rest", "static", lambda found, seen: 0.0),
    ("static, largest load told", "static", lambda found, seen: largest(seen)),
)
#: What a tube that knows nothing of the motion would hold: nothing is asked of it.
UNTOLD = "as if at rest"


def put(rows: dict[str, list[np.ndarray]], row: str, tube: cs.Tube | None, points: np.ndarray) -> None:
    """Keeps which of the points a tube holds; all NaN where there is none, or one that says that it does not hold."""
    said = tube is not None and tube.holds
    rows.setdefault(row, []).append(inside(tube, points).astype(float) if said else np.full(len(points), math.nan))


def of_frames(frames: Frames, part: int, rows: dict[str, list[np.ndarray]]) -> None:
    """Puts whether single frames' markers are held into rows: of one part, fitted to the others."""
    found = fitted([frames.moving[i] for i in frames.where(("quasi",), part, False)], frames.cable)
    for kind in KINDS:
        for row, of, tell in ROWS:
            seen, made = getattr(frames, of), Tubes(found)
            for i in frames.where((kind,), part, True):
                put(rows, f"{kind}: {row}", made.tube(seen[i], tell(found, frames.moving[i])), seen[i].points)


def of_recordings(number: int, frames: Frames, rows: dict[str, list[np.ndarray]]) -> None:
    """The same of whole recordings, predicted as in a cell, fitted to frames of other trajectories."""
    for which, traj in enumerate(frames.recorded):
        learn = np.flatnonzero((frames.kind == "quasi") & (frames.traj != traj))
        found = fitted([frames.moving[i] for i in learn], frames.cable)
        assert found.parameters is not None
        assert found.values is not None
        near, far = (found.parameters.offset(found.values, side) for side in ("start", "end"))
        seen = as_fitted(number, from_bag(DATA / f"cable{number}_recording{which}", frames=500))
        cycle = cs.Cycle(found.cable, model="cosserat", points=101, uncertainty=cs.Uncertainty.of(found))
        for k, one in enumerate(seen):
            tube = cycle.step({"cable": (held(one.start, near), held(one.end, far))}, 10_000_000 * k).tubes.get("cable")
            if k % EVERY == 0:
                put(rows, f"recording {which}: static, told by the grips", tube, one.points)


def tubes(figures: Figures, quick: bool) -> dict[str, Any]:
    """The table."""
    heading("Real cables: held-back markers inside the 95 % tube, %, fitted with inertial load to calm frames")
    done: dict[int, dict[str, list[np.ndarray]]] = {}
    for number in tqdm(CABLES, desc="tubes", unit="cable"):
        frames, rows = load(number, PARTS), done.setdefault(number, {})
        for part in range(1 if quick else PARTS):
            of_frames(frames, part, rows)
        of_recordings(number, frames, rows)
    print(f"{'':52}" + "".join(f"{f'cable{n}':>14}" for n in CABLES))
    shares: dict[str, list[float]] = {}
    for row in next(iter(done.values())):
        all_of = [np.concatenate(done[n][row]) for n in CABLES]
        kept = [values[~np.isnan(values)] for values in all_of]
        shares[row] = [100.0 * float(values.mean()) if len(values) else math.nan for values in kept]
        line(row, shares[row], digits=1)
        without = [100.0 * (1.0 - len(some) / len(values)) for some, values in zip(kept, all_of, strict=True)]
        if any(without):
            line("  of which the tube says that it does not hold", without, digits=1)
        for n, share in zip(CABLES, shares[row], strict=True):
            if not row.endswith(UNTOLD) and not math.isnan(share):
                figures.at_least(f"cable{n}: {row}, in the 95 % tube", share, 90.0, "{:.1f}", " %")
                figures.at_most(f"cable{n}: {row}, in the 95 % tube", share, 99.0, "{:.1f}", " %")
    return shares
