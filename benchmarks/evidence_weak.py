"""Where a rod is hard to find or to follow, counted anew in every run, each as a few lines that repeat it."""

from __future__ import annotations

from collections import Counter

import numpy as np
from cosserat_speed import CABLE, END, START
from evidence_maps import ALONG_X, STRIP, bowed, stiffness
from evidence_pages import Pages, table
from tqdm import tqdm

import cable_shape as cs
from cable_shape.shape import Status
from cable_shape.solve import cosserat
from cable_shape.solve.network import Network
from cable_shape.solve.problem import Problem

Row = tuple[str, str]


def counted(statuses: Counter[Status]) -> str:
    """Statuses in words."""
    return ", ".join(f"{status.name} {count}" for status, count in statuses.most_common())


def nearly_limp(count: int) -> Row:
    """Cables that are next to limp, from nothing: no guess is near enough, and a stiffer cable is softened."""
    statuses: Counter[Status] = Counter()
    direction = END.position / np.linalg.norm(END.position)
    for ratio in np.geomspace(1e-3, 5e-3, count):
        EI = stiffness(CABLE.length, ratio)
        cable = CABLE.replace(bending_stiffness=EI, twisting_stiffness=0.8 * EI)
        for chord in np.linspace(0.1, 0.9, count):
            end = cs.Pose(chord * CABLE.length * direction, END.quaternion)
            statuses[cs.predict(cable, START, end, model="cosserat", points=41).status] += 1
    what = "from nothing, grasp B, (EI/w)^(1/3) of 0.001 to 0.005 and chords of 0.1 to 0.9 lengths"
    return what, counted(statuses)


def followed(count: int) -> Row:
    """The same cables, their ends brought together from 0.97 lengths."""
    statuses: Counter[Status] = Counter()
    direction = END.position / np.linalg.norm(END.position)
    for ratio in np.geomspace(1e-3, 5e-3, count):
        EI = stiffness(CABLE.length, ratio)
        cable = CABLE.replace(bending_stiffness=EI, twisting_stiffness=0.8 * EI)
        predictor = cs.Predictor(cable, model="cosserat", points=41)
        for chord in np.linspace(0.97, 0.1, 40):
            statuses[predictor.predict(START, cs.Pose(chord * CABLE.length * direction, END.quaternion)).status] += 1
    return "the same cables with a `Predictor`, from 0.97 to 0.1 lengths in 40 steps", counted(statuses)


def weightless(count: int, weight: float) -> Row:
    """Ends in line without weight: any plane is as good as another, so that a mode is neutral."""
    cable, start = cs.Cable(1.0, weight, 0.01, 0.008), cs.Pose((0, 0, 0), ALONG_X.as_quat())
    statuses: Counter[Status] = Counter()
    for chord in np.linspace(0.3, 0.99, count):
        end = cs.Pose((chord, 0, 0), start.quaternion)
        statuses[cs.predict(cable, start, end, model="cosserat", points=41).status] += 1
    what = f"from nothing, ends in line, chords of 0.3 to 0.99 lengths, {weight:g} kg/m and EI = 0.01 N m²"
    return what, counted(statuses)


def small_snap(chord: float, count: int) -> Row:
    """The strip of the maps that snaps down from above: told or not."""
    x, y, _ = bowed(3).lines[0]
    critical = float(np.interp(chord, x[::-1], y[::-1]))
    weight = 0.981
    EI = weight * critical**3
    strip = cs.Cable(1.0, weight / 9.81, (EI, STRIP * EI), STRIP * EI)
    statuses: Counter[Status] = Counter()
    state: Network | None = None
    middle = []
    for k, D in enumerate((1.0 - chord) * np.geomspace(2.0, 0.5, count)):
        for pull in (20.0, 5.0, 1.0, 0.0, -9.81) if k == 0 else (None,):  # hung upwards, then let go
            if pull is not None:
                problem = Problem(strip, points=41, gravity=(0.0, 0.0, pull))
            problem = problem.move(cs.Pose((0, 0, 0), ALONG_X.as_quat()), cs.Pose((1.0 - D, 0, 0), ALONG_X.as_quat()))
            state = state or Network(problem)
            shape = cosserat.solve(problem, state)
        statuses[shape.status] += 1
        middle.append(float(shape.positions[20, 2]))
    jump = int(np.abs(np.diff(middle)).argmax())
    what = (
        f"strip bowed upwards, its ends drawn apart in {count} steps past a chord of {chord:g} lengths, where it snaps"
    )
    seen = (
        f"{counted(statuses)}; its middle from {1e3 * middle[jump]:.0f} to {1e3 * middle[jump + 1]:.0f} mm in one step"
    )
    return what, seen


def evidence(pages: Pages) -> None:
    """One table."""
    count = 3 if pages.quick else 12
    jobs = (
        lambda: nearly_limp(count),
        lambda: followed(count),
        *(lambda w=weight: weightless(6 * count, w) for weight in (0.0, 1e-6)),
        *(lambda c=chord: small_snap(c, 41) for chord in (0.9, 0.97, 0.99, 0.997)),
    )
    rows = [job() for job in tqdm(jobs, desc="hard cases", unit="case", leave=False, disable=None)]
    pages.add(
        "stability",
        "## Hard cases",
        "Counted anew in every run. NOT_CONVERGED and UNSTABLE say so themselves. A snap is told by frames that turn "
        "further than the ends' motion explains; one that turns them by less than 0.2 rad passes as a motion.",
        table(("what", "found"), rows),
    )
