"""Work-precision diagrams: time against error of every model, cold and warm, beside solve_bvp."""

from __future__ import annotations

import math
from collections.abc import Sequence
from time import thread_time

import evidence_rivals
import matplotlib.pyplot as plt
import numpy as np
from clocks import Turns, timed
from evidence_pages import PAPER, Pages, Point, Series, figures, front, table
from problems import CABLE, END, GRASPS, START, motion, planar_motion
from rod_bvp import Collocation, same_guess, states
from tqdm import tqdm

import cable_shape as cs
from cable_shape.solve import cosserat
from cable_shape.solve.network import Network
from cable_shape.solve.problem import Problem

CLOSED = ("catenary", "gradient4", "gradient6")
TOLERANCES = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8)
DEFAULT = "tol 1e-05 L"
BVP = (1e-2, 1e-3, 1e-5, 1e-7)
#: Of the length: below, the reference's own error begins to count.
REFERENCE = 1e-10
#: Asked of the rod beside solve_bvp at its default tolerance of 1e-3.
FASTER = {"cold": 50.0, "M, warm": 100.0}
#: Marks and colours of the models.
STYLES = {
    "rod": ("o", "tab:blue"), "solve_bvp": ("x", "tab:red"), "catenary": ("s", "tab:green"),
    "gradient4": ("D", "tab:orange"), "gradient6": ("v", "tab:purple"), "MuJoCo cable": ("^", "tab:brown"),
    "PyElastica": ("*", "tab:pink"),
}  # fmt: skip


def off(positions: np.ndarray, exact: np.ndarray, length: float) -> float:
    """Mean distance at equal arc length / length."""
    return float(np.linalg.norm(positions - exact, axis=-1).mean()) / length


def tolerances(quick: bool) -> dict[str, float]:
    """Of the rod, as fractions of the length."""
    return {f"tol {tolerance:.0e} L": tolerance for tolerance in (TOLERANCES[::3] if quick else TOLERANCES)}


def cold(name: str, quick: bool) -> tuple[Series, float]:
    """All models on one grasp from nothing, and how far solve_bvp's finest is from the reference."""
    cable, start, end = GRASPS[name]
    length = cable.length
    seconds = 0.01 if quick else 0.1
    exact = cs.predict(cable, start, end, model="cosserat", tolerance=REFERENCE * length).positions
    found: Series = {}
    for model in CLOSED:
        shape = cs.predict(cable, start, end, model=model)
        if shape.status:
            spent = timed(lambda m=model: cs.predict(cable, start, end, model=m), seconds=seconds)
            found[model] = [Point(spent, off(shape.positions, exact, length), "")]
    found["rod"] = []
    for setting, tolerance in tolerances(quick).items():
        problem = Problem(cable, tolerance=tolerance * length).move(start, end)
        state = Network(problem)
        shape = cosserat.solve(problem, state)
        spent = timed(lambda p=problem: cosserat.solve(p, Network(p)), seconds=seconds)
        found["rod"].append(Point(spent, off(shape.positions, exact, length), setting, state.elements))
    other, guess = Collocation(cable), same_guess(cable, start, end)
    found["solve_bvp"] = []
    at = np.linspace(0.0, length, len(exact))
    for tol in BVP[:2] if quick else BVP:
        answer = other.solve(*guess, start, end, tol)
        if answer.status == 0:
            spent = timed(lambda t=tol: other.solve(*guess, start, end, t), least=1 if quick else 3, seconds=0.0)
            error = off(answer.sol(at)[:3].T, exact, length)
            found["solve_bvp"].append(Point(spent, error, f"tol {tol:.0e}", answer.x.size))
    return found, min((point.error for point in found["solve_bvp"]), default=math.nan)


def followed(model: str, poses: Sequence[cs.Pose], tolerance: float | None, rounds: int) -> tuple[float, np.ndarray]:
    """Median processor time [s] of a warm step, and positions of every step."""
    predictor = cs.Predictor(CABLE, model=model, tolerance=tolerance)
    turns = Turns(clock=thread_time)
    for _ in range(rounds):
        predictor.predict(START, poses[0])
        shapes = [turns.of(model, lambda p=pose: predictor.predict(START, p)) for pose in poses[1:]]
    return turns.medians[model], np.array([shape.positions for shape in shapes])


def warm(poses: Sequence[cs.Pose], quick: bool) -> Series:
    """All models along a motion; the error is the mean over its steps."""
    length, rounds = CABLE.length, 1 if quick else 3
    if quick:
        poses = poses[:9]
    _, exact = followed("cosserat", poses, REFERENCE * length, 1)
    found: Series = {}
    jobs = [(model, model, "", None) for model in CLOSED]
    jobs += [("rod", "cosserat", setting, tol * length) for setting, tol in tolerances(quick).items()]
    for name, model, setting, tolerance in jobs:
        spent, positions = followed(model, poses, tolerance, rounds)
        found.setdefault(name, []).append(Point(spent, off(positions, exact, length), setting))
    found["solve_bvp"] = []
    middle = len(poses) // 2
    few = slice(middle, middle + (2 if quick else 8))
    predictor = cs.Predictor(CABLE, model="cosserat", points=11)
    for pose in poses[: middle + 1]:
        begin = predictor.predict(START, pose)
    collocation, at = Collocation(CABLE), np.linspace(0.0, length, exact.shape[1])
    for tol in BVP[:2] if quick else BVP:
        x, Y = begin.arc_length.copy(), states(begin)
        turns, errors = Turns(clock=thread_time), []
        for pose, truth in zip(poses[1:][few], exact[few], strict=True):
            answer = turns.of("bvp", lambda p=pose, x=x, Y=Y, t=tol: collocation.solve(x, Y, START, p, t))
            errors.append(off(answer.sol(at)[:3].T, truth, length))
            x, Y = answer.x, answer.y
        found["solve_bvp"].append(Point(turns.medians["bvp"], float(np.mean(errors)), f"tol {tol:.0e}", x.size))
    return found


def beside_rivals(results: dict[str, Series], pages: Pages) -> None:
    """Adds the simulators' lines to those of the cold grasps, and their ratios to the pages."""
    for name, found in evidence_rivals.measured(pages.quick).items():
        series = results[f"{name}, cold"]
        rod = at_default(series)
        for simulator, line in found.items():
            series[simulator] = [
                Point(s.seconds, s.error, f"{s.steps} steps, " + told(s.job.setting), s.job.joints) for s in line
            ]
            for s in line[1:2]:
                note = f"{s.job.joints} links, {figures(100 * s.error)} % of the length off; the rod {rod.error:.0e}"
                pages.ratio(f"rod : {simulator}, grasp {name} cold", s.seconds / rod.time, note)


def told(setting: dict[str, float]) -> str:
    """A simulator's setting in words."""
    return ", ".join(f"{name} {value:g}" for name, value in setting.items())


def at_default(series: Series) -> Point:
    """The rod at its default tolerance; in a quick run at its coarsest."""
    return next((p for p in series["rod"] if p.setting == DEFAULT), series["rod"][0])


def ratios(pages: Pages, results: dict[str, Series]) -> None:
    """Beside solve_bvp at its tol 1e-3, and on its line where it is as accurate as the default; closed forms beside."""
    for name, series in results.items():
        ours = at_default(series)
        for theirs in series["solve_bvp"]:
            bound = FASTER["cold"] if name.endswith("cold") else FASTER.get(name)
            if theirs.setting == "tol 1e-03":
                pages.ratio(f"rod : solve_bvp at tol 1e-3, {name}", theirs.time / ours.time)
                if bound is not None:
                    text = f"{name}: times faster than solve_bvp at tol 1e-3"
                    pages.figures.at_least(text, theirs.time / ours.time, bound, "{:.0f}")
        line = sorted(series["solve_bvp"], key=lambda p: p.error)
        if line and line[0].error <= ours.error:
            logs = np.log([(p.error, p.time) for p in line])
            spent = math.exp(np.interp(math.log(ours.error), logs[:, 0], logs[:, 1]))
            note = f"at {figures(ours.error)} of the length; solve_bvp's time read off its line"
            pages.ratio(f"rod : solve_bvp as accurate, {name}", spent / ours.time, note)
        for model in CLOSED:
            for point in series.get(model, ()):
                note = f"{figures(100 * point.error)} % of the length off"
                pages.ratio(f"{model} : rod, {name}", ours.time / point.time, note)


def rows_of(name: str, series: Series) -> list[tuple[str, ...]]:
    """Of a table: problem, model, setting, mesh, time relative to the rod's at the default tolerance, error."""
    unit = at_default(series).time
    return [
        (name, model, p.setting or "-", str(p.size or "-"), figures(p.time / unit), figures(p.error))
        for model, points in series.items()
        for p in points
    ]


def drawn(results: dict[str, Series]) -> plt.Figure:
    """Time against error of each problem; the default tolerance is ringed."""
    figure, axes = plt.subplots(2, 3, figsize=(13, 8), sharex=True, sharey=True, layout="constrained")
    for ax, (title, series) in zip(axes.flat, results.items(), strict=True):
        for name, points in series.items():
            mark, colour = next((style for kind, style in STYLES.items() if name.startswith(kind)), ("o", None))
            x, y = [1e3 * p.time for p in points], [max(p.error, 1e-13) for p in points]
            ax.loglog(x, y, mark + "-", label=name, color=colour, markersize=5, linewidth=1.2)
            for point in (p for p in points if p.setting == DEFAULT):
                ax.loglog(1e3 * point.time, point.error, "o", ms=11, mfc="none", color="black")
        ax.set_title(title, fontsize=10)
        ax.grid(True, which="major", alpha=0.3)
        ax.set_ylim(3e-13, 1.0)
    for ax in axes[-1]:
        ax.set_xlabel("time [ms]")
    for ax in axes[:, 0]:
        ax.set_ylabel("mean error / length")
    handles = {line.get_label(): line for ax in axes.flat for line in ax.get_lines() if line.get_label()[0] != "_"}
    figure.legend(handles.values(), handles.keys(), loc="outside lower center", ncols=6)
    return figure


def evidence(pages: Pages) -> None:
    """Diagrams and tables."""
    results: dict[str, Series] = {}
    agree = []
    for name in tqdm(GRASPS, desc="work-precision, cold", unit="grasp", leave=False, disable=None):
        results[f"{name}, cold"], finest = cold(name, pages.quick)
        agree.append(finest)
    for name, poses in (("M, warm", [END, *motion()]), ("planar motion, warm", planar_motion())):
        results[name] = warm(poses, pages.quick)
    ratios(pages, results)
    beside_rivals(results, pages)
    pages.front = front(results, DEFAULT)
    pages.figures.at_most("solve_bvp at its finest: mean distance / L to the rod, cold", max(agree), 1e-4)
    pages.figures.at_most("M, warm: mean error / L", at_default(results["M, warm"]).error, 1e-5)
    pages.add(
        "## Work and precision",
        "Time of one shape of 150 points against its mean distance at equal arc length from the reference, the rod at "
        f"a tolerance of {REFERENCE:.0e} of the length. solve_bvp, which knows nothing of the rod's code, is at its "
        f"finest {figures(max(agree))} of the length or less from it on the grasps. Lines of the rod: tolerances "
        f"{TOLERANCES[0]:.0e} to {TOLERANCES[-1]:.0e} of the length, the default ringed; of solve_bvp (analytic "
        "Jacobian, mesh reused when warm, the rod's own first guess when cold): tol "
        + ", ".join(f"{t:.0e}" for t in BVP)
        + ". Closed forms have one time and one error, which is what they leave out. Times are processor "
        "times of the one thread that works, which other load on the machine changes little.",
        evidence_rivals.METHOD
        if evidence_rivals.python()
        else f"MuJoCo's cable and PyElastica: {evidence_rivals.MISSING}",
        f"The paper of the gradient cable prints {PAPER} for 150 points in space, on a machine of its time. "
        f"gradient4 takes {figures(1e3 * results['B, cold']['gradient4'][0].time)} ms here on grasp B.",
    )
    alt = "Time against error of six problems, of all models"
    pages.picture(drawn(results), "work_precision", alt)
    head = ("problem", "model", "setting", "elements or links", "time / rod at 1e-05 L", "mean error / L")
    pages.add(table(head, [row for name, series in results.items() for row in rows_of(name, series)]))
