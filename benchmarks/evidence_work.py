"""Work-precision diagrams: time against error of every model, cold and warm, beside solve_bvp."""

from __future__ import annotations

import math
from collections.abc import Sequence
from time import thread_time

import evidence_rivals
import matplotlib.pyplot as plt
import numpy as np
from cosserat_order import compiled, solve_on
from cosserat_speed import CABLE, END, GRASPS, START, Collocation, in_turns, motion, planar_motion, same_guess, states
from evidence_front import PAPER, front
from evidence_pages import Pages, figures, table, timed
from evidence_points import Point, Series
from matplotlib.ticker import LogLocator, NullFormatter
from tqdm import tqdm

import cable_shape as cs
from cable_shape.kernels.network.newton import CONVERGED
from cable_shape.solve import cosserat
from cable_shape.solve.network import Network
from cable_shape.solve.problem import Problem

CLOSED = ("catenary", "gradient4", "gradient6")
TOLERANCES = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8)
DEFAULT = 1e-5
BVP = (1e-2, 1e-3, 1e-5, 1e-7)
MESHES = (10, 20, 40, 80, 160, 320)
#: Of the length: below, the reference's own error begins to count.
REFERENCE = 1e-10
MARKS = {"catenary": "s", "gradient4": "D", "gradient6": "v", "solve_bvp": "x", "MuJoCo cable": "^", "PyElastica": "*"}
COLOURS = {
    "rod": "tab:blue", "solve_bvp": "tab:red", "catenary": "tab:green",
    "gradient4": "tab:orange", "gradient6": "tab:purple", "MuJoCo cable": "tab:brown", "PyElastica": "tab:pink",
}  # fmt: skip


def off(positions: np.ndarray, exact: np.ndarray, length: float) -> float:
    """Mean distance at equal arc length / length."""
    return float(np.linalg.norm(positions - exact, axis=1).mean()) / length


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
    for tolerance in TOLERANCES[::3] if quick else TOLERANCES:
        problem = Problem(cable, tolerance=tolerance * length).move(start, end)
        state = Network(problem)
        shape = cosserat.solve(problem, state)
        spent = timed(lambda p=problem: cosserat.solve(p, Network(p)), seconds=seconds)
        error = off(shape.positions, exact, length)
        found["rod"].append(Point(spent, error, f"tol {tolerance:.0e} L", state.elements))
    other, guess = Collocation(cable), same_guess(cable, start, end)
    found["solve_bvp"] = []
    at = np.linspace(0.0, length, len(exact))
    for tol in BVP[:2] if quick else BVP:
        answer = other.solve(*guess, start, end, tol)
        if answer.status == 0:
            spent = timed(lambda t=tol: other.solve(*guess, start, end, t), least=1 if quick else 3, seconds=0.0)
            error = off(answer.sol(at)[:3].T, exact, length)
            found["solve_bvp"].append(Point(spent, error, f"tol {tol:.0e}", answer.x.size))
    finest = found["solve_bvp"][-1].error if found["solve_bvp"] else math.nan
    return found, finest


def followed(model: str, poses: Sequence[cs.Pose], tolerance: float | None, rounds: int) -> tuple[float, np.ndarray]:
    """Median processor time [s] of a warm step, and positions of every step."""
    predictor = cs.Predictor(CABLE, model=model, tolerance=tolerance)
    spent = []
    for _ in range(rounds):
        predictor.predict(START, poses[0])
        shapes = []
        for pose in poses[1:]:
            began = thread_time()
            shapes.append(predictor.predict(START, pose))
            spent.append(thread_time() - began)
    return float(np.median(spent)), np.array([shape.positions for shape in shapes])


def warm(poses: Sequence[cs.Pose], quick: bool) -> Series:
    """All models along a motion; the error is the mean over its steps."""
    length = CABLE.length
    if quick:
        poses = poses[:9]
    _, exact = followed("cosserat", poses, REFERENCE * length, 1)
    found: Series = {}

    def error(positions: np.ndarray) -> float:
        return float(np.linalg.norm(positions - exact, axis=2).mean()) / length

    rounds = 1 if quick else 3
    for model in CLOSED:
        spent, positions = followed(model, poses, None, rounds)
        found[model] = [Point(spent, error(positions), "")]
    found["rod"] = []
    for tolerance in TOLERANCES[::3] if quick else TOLERANCES:
        spent, positions = followed("cosserat", poses, tolerance * length, rounds)
        found["rod"].append(Point(spent, error(positions), f"tol {tolerance:.0e} L"))
    found["solve_bvp"] = []
    middle = len(poses) // 2
    few = slice(middle, middle + (2 if quick else 8))
    predictor = cs.Predictor(CABLE, model="cosserat", points=11)
    for pose in poses[: middle + 1]:
        begin = predictor.predict(START, pose)
    collocation = Collocation(CABLE)
    at = np.linspace(0.0, length, exact.shape[1])
    for tol in BVP[:2] if quick else BVP:
        x, Y = begin.arc_length.copy(), states(begin)
        spent, errors = [], []
        for pose, truth in zip(poses[1:][few], exact[few], strict=True):
            began = thread_time()
            answer = collocation.solve(x, Y, START, pose, tol)
            spent.append(thread_time() - began)
            errors.append(off(answer.sol(at)[:3].T, truth, length))
            x, Y = answer.x, answer.y
        found["solve_bvp"].append(Point(float(np.median(spent)), float(np.mean(errors)), f"tol {tol:.0e}", x.size))
    return found


def on_meshes(name: str, meshes: Sequence[int]) -> list[Point]:
    """A grasp on fixed meshes: error, and the time of a warm step of a thousandth of the length."""
    cable, start, end = GRASPS[name]
    problem = Problem(cable).move(start, end)
    state = Network(problem)
    cosserat.solve(problem, state)
    exact = solve_on(state, 2 * MESHES[-1])
    points = []
    for n in meshes:
        error = off(solve_on(state, n), exact, cable.length)
        ends = state.poses.copy()
        beside = ends.copy()
        beside[-1, 0] -= 1e-3 * cable.length
        buffer = np.empty(17 * problem.points)

        def there_and_back(ends: np.ndarray = ends, beside: np.ndarray = beside, buffer: np.ndarray = buffer) -> None:
            for target in (beside, ends):
                state.target[...] = target
                code = compiled(state, buffer, 1, False, 60, math.inf)
                if code != CONVERGED:
                    raise RuntimeError(f"no equilibrium on {state.elements} elements: {code}")

        points.append(Point(0.5 * timed(there_and_back, seconds=0.02), error, f"{state.elements} elements", n))
    return points


def beside_rivals(results: list[tuple[str, Series]], pages: Pages) -> None:
    """Adds the simulators' lines to those of the cold grasps, and their ratios to the pages."""
    for name, found in evidence_rivals.measured(pages.quick).items():
        series = dict(results)[f"{name}, cold"]
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
    return next((p for p in series["rod"] if p.setting == f"tol {DEFAULT:.0e} L"), series["rod"][0])


def draw(axes: plt.Axes, series: Series, title: str) -> None:
    """Time against error; the default tolerance is ringed."""
    for name, points in series.items():
        if not points:
            continue
        x, y = [1e3 * p.time for p in points], [max(p.error, 1e-13) for p in points]
        kind = next((k for k in COLOURS if k == name), next((k for k in COLOURS if name.startswith(f"{k} ")), ""))
        style = {"label": name, "color": COLOURS.get(kind), "markersize": 5, "linewidth": 1.2}
        axes.loglog(x, y, MARKS.get(kind, "o") + "-", **style)
        for p, a, b in zip(points, x, y, strict=True):
            if p.setting == f"tol {DEFAULT:.0e} L":
                axes.loglog(a, b, "o", markersize=11, markerfacecolor="none", color="black")
    axes.set_title(title, fontsize=10)
    axes.grid(True, which="major", alpha=0.3)
    axes.set_ylim(3e-13, 1.0)


def rows_of(name: str, series: Series) -> list[tuple[str, ...]]:
    """Of a table: problem, model, setting, mesh, time relative to the rod's at the default tolerance, error."""
    unit = at_default(series).time
    return [
        (name, model, p.setting or "-", str(p.size or "-"), figures(p.time / unit), figures(p.error))
        for model, points in series.items()
        for p in points
    ]


def evidence(pages: Pages) -> None:
    """Diagrams and tables."""
    quick = pages.quick
    results: list[tuple[str, Series]] = []
    agree = []
    bar = tqdm(total=7, desc="work-precision", unit="problem", leave=False, disable=None)
    for name in GRASPS:
        series, finest = cold(name, quick)
        results.append((f"{name}, cold", series))
        agree.append(finest)
        bar.update()
    for name, poses in (("M, warm", [END, *motion()]), ("planar motion, warm", planar_motion())):
        results.append((name, warm(poses, quick)))
        bar.update()
    meshes = MESHES[:3] if quick else MESHES
    fixed = {name: on_meshes(name, meshes) for name in GRASPS}
    bar.update()
    bar.close()
    ratios(pages, results, quick)
    beside_rivals(results, pages)
    pages.front = front(dict(results), f"tol {DEFAULT:.0e} L")

    figure, axes = plt.subplots(2, 3, figsize=(13, 8), sharex=True, sharey=True, layout="constrained")
    for ax, (name, series) in zip(axes.flat, results, strict=True):
        draw(ax, series, name)
    for ax in axes[-1]:
        ax.set_xlabel("time [ms]")
    for ax in axes[:, 0]:
        ax.set_ylabel("mean error / length")
    handles = {line.get_label(): line for ax in axes.flat for line in ax.get_lines() if line.get_label()[0] != "_"}
    figure.legend(handles.values(), handles.keys(), loc="outside lower center", ncols=6)
    pages.add(
        "performance",
        "## Work and precision",
        "Time of one shape of 150 points against its mean distance at equal arc length from the reference, the rod at "
        f"a tolerance of {REFERENCE:.0e} of the length. solve_bvp, which knows nothing of the rod's code, is at its "
        f"finest {figures(max(agree))} of the length or less from it on the grasps. Lines of the rod: tolerances "
        f"{TOLERANCES[0]:.0e} to {TOLERANCES[-1]:.0e} of the length, the default ringed; of solve_bvp (analytic "
        "Jacobian, mesh reused when warm, the rod's own first guess when cold): tol "
        + ", ".join(f"{t:.0e}" for t in BVP)
        + ". Closed forms have one time and one error, which is what they leave out. Times are processor "
        "times of the one thread that works, which other load on the machine changes little.",
    )
    rivals = (
        evidence_rivals.METHOD
        if evidence_rivals.python()
        else f"MuJoCo's cable and PyElastica: {evidence_rivals.MISSING}"
    )
    spent = figures(1e3 * dict(results)["B, cold"]["gradient4"][0].time)
    paper = f"The paper of the gradient cable prints {PAPER} for 150 points in space, on a machine of its time."
    pages.add("performance", rivals, f"{paper} gradient4 takes {spent} ms here on grasp B.")
    pages.picture("performance", figure, "work_precision", "Time against error of six problems, of all models")
    head = ("problem", "model", "setting", "elements or links", "time / rod at 1e-05 L", "mean error / L")
    pages.add("performance", table(head, [row for name, series in results for row in rows_of(name, series)]))
    draw_meshes(pages, fixed, meshes)


def draw_meshes(pages: Pages, fixed: dict[str, list[Point]], meshes: Sequence[int]) -> None:
    """Error against elements and time of the grasps on fixed meshes."""
    figure, axes = plt.subplots(1, 2, figsize=(11, 4.2), sharey=True, layout="constrained")
    for name, points in fixed.items():
        axes[0].loglog([p.size for p in points], [max(p.error, 1e-15) for p in points], "o-", label=name)
        axes[1].loglog([1e6 * p.time for p in points], [max(p.error, 1e-15) for p in points], "o-", label=name)
    n = np.array((meshes[0], meshes[-1]), dtype=float)
    for order, style in ((4, ":"), (6, "--")):
        axes[0].loglog(n, 1e-4 * (n / n[0]) ** -order, style, color="grey", label=f"order {order}")
    axes[0].set(xlabel="elements", ylabel="mean error / length", ylim=(3e-16, 1e-2))
    axes[1].set_xlabel("time of a warm step [µs]")
    axes[0].legend()
    for ax in axes:
        ax.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        ax.xaxis.set_major_formatter("{x:g}")
        ax.xaxis.set_minor_formatter(NullFormatter())
        ax.grid(True, alpha=0.3)
    pages.add(
        "performance",
        "## Fixed meshes",
        "The grasps on meshes of given size, half of the nodes in the boundary layers: error, and the time of a warm "
        "compiled step of a thousandth of the length; the reference has "
        f"{2 * MESHES[-1]} elements.",
    )
    pages.picture("performance", figure, "work_precision_meshes", "Error against elements and time on fixed meshes")


def ratios(pages: Pages, results: list[tuple[str, Series]], quick: bool) -> None:
    """Beside solve_bvp in turns (cold), at its tol 1e-3, and on its line where it is as accurate as the default."""
    rounds = 1 if quick else 5
    for name, (cable, start, end) in GRASPS.items():
        other, guess = Collocation(cable), same_guess(cable, start, end)
        a, b = in_turns(
            lambda c=cable, s=start, e=end: cs.predict(c, s, e, model="cosserat"),
            lambda o=other, g=guess, s=start, e=end: o.solve(*g, s, e),
            rounds,
        )
        pages.ratio(f"rod : solve_bvp at tol 1e-3, grasp {name} cold", b / a)
        for model in CLOSED:
            c, d = in_turns(
                lambda c=cable, s=start, e=end, m=model: cs.predict(c, s, e, model=m),
                lambda c=cable, s=start, e=end: cs.predict(c, s, e, model="cosserat"),
                4 * rounds,
            )
            shape = cs.predict(cable, start, end, model=model)
            if shape.status:
                error = dict(results)[f"{name}, cold"][model][0].error
                pages.ratio(f"{model} : rod, grasp {name} cold", d / c, f"{figures(100 * error)} % of the length off")
    for name, series in results:
        ours = min(series["rod"], key=lambda p: abs(math.log(p.error / 1e-5) if p.error else math.inf))
        ours = next((p for p in series["rod"] if p.setting == f"tol {DEFAULT:.0e} L"), ours)
        theirs = sorted(series["solve_bvp"], key=lambda p: p.error)
        if theirs and theirs[0].error <= ours.error:
            logs = np.log([(p.error, p.time) for p in theirs])
            spent = math.exp(np.interp(math.log(ours.error), logs[:, 0], logs[:, 1]))
            note = f"at {figures(ours.error)} of the length; solve_bvp's time read off its line"
            pages.ratio(f"rod : solve_bvp as accurate, {name}", spent / ours.time, note)
        if "warm" in name:
            for model in CLOSED:
                point = series[model][0]
                note = f"{figures(100 * point.error)} % of the length off"
                pages.ratio(f"{model} : rod, {name}", ours.time / point.time, note)
