"""The page of numbers: every figure of every bench, what it is compared with, and what the others can do beside it."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Callable, Mapping
from importlib import metadata
from pathlib import Path
from typing import Any, NamedTuple

import scipy
from evidence_pages import BEGIN, END, PAPER, figures, table

PAGE = Path(__file__).resolve().parents[1] / "docs" / "numbers.md"

INTRODUCTION = """\
Everything that is measured, on one page: `scripts/bench` runs all benches, says whether each figure holds, and
writes it (`--quick`, `--save FILE`, `--compare FILE`; `--draw FILE` writes it of figures that were kept); with
a name, one of them: {names}. `certify` judges random shapes that say OK by a check of its own in numpy,
`evidence` redraws [performance](performance.md) and the first table below. MuJoCo
and PyElastica are measured after `scripts/bench rivals --install`, a set-up from nothing by `scripts/bench
setup` alone."""

MACHINE = """\
Times are those of one machine, and of what else it does: {load} processes wanted one of its cores when this
began. What is compared was measured in turns, in the same run, so that other work meets both; a ratio moves
less than either time. A figure that does not hold is told as such."""

SHAPES = """\
## One shape, beside others

Four grasps from nothing (A level and slack, B turned in space, C taut, D a stiff arch) and a motion M of 200
steps, each from the step before. Processor times of one thread; errors against the rod at 1e-10 of the length,
with which solve_bvp agrees. It solves the same equations with an analytic Jacobian, when warm from its last
answer. The simulators start from the rod's own first guess and are told, at no cost, when they have come to
rest, at settings searched for each grasp."""

MORE = "Ratios, and a diagram of time against error: [performance](performance.md)."


class Peer(NamedTuple):
    """Who is compared with; `measured` finds the figures that say so many times as fast."""

    name: str
    version: Callable[[Mapping[str, Any]], str]
    compared: str
    measured: str
    can: str


def _named(pattern: str) -> Callable[[Mapping[str, Any]], str]:
    """The version that stands in the name of a figure."""

    def version(found: Mapping[str, Any]) -> str:
        hits = [hit[1] for name in found if (hit := re.search(pattern + r" ([\d.]+\d)", name))]
        return hits[0] if hits else "-"

    return version


def _installed(package: str) -> Callable[[Mapping[str, Any]], str]:
    def version(_: Mapping[str, Any]) -> str:
        try:
            return metadata.version(package)
        except metadata.PackageNotFoundError:
            return "-"

    return version


PEERS = (
    Peer("solve_bvp of scipy", lambda _: str(scipy.__version__), "the rod's own equations, as accurate",
         r"^evidence: rod : solve_bvp as accurate",
         "any equations with conditions at two ends, with unknown parameters and singular terms"),
    Peer("solve_bvp of scipy", lambda _: str(scipy.__version__), "the gradient cable's equations, tension unknown",
         r"^gradient: least ratio to solve_bvp", "the same"),
    Peer("MuJoCo's cable, 20 links", _named("MuJoCo cable"), "settling on the grasps A to D",
         r"^evidence: rod : MuJoCo",
         "motion with inertia, friction, contact between many things, robots, sensors and actuators in one simulation"),
    Peer("PyElastica, 20 elements", _named("PyElastica"), "settling on the grasps A to D",
         r"^evidence: rod : PyElastica",
         "motion with inertia, drag, friction on a plane, muscles, joints between many rods"),
    Peer("the gradient cable of its paper", lambda _: "-",
         f"a shape of 150 points in space: {PAPER} as printed, on a machine of its time", "",
         "nothing known: `gradient4` is its equations"),
    Peer("a node in Python that only answers", _installed("ros-rclpy"),
         "time from the second pose to the shape, over DDS: the node's median / its median",
         r"^cell: .* p50 .* echo", "nothing: it is what rclpy and DDS take by themselves"),
    Peer("the rod whose figures come with the recordings of five cables", lambda _: "-",
         "how near to real cables: [beside another rod](accuracy.md#beside-another-rod)", "", "not told"),
)  # fmt: skip


class Told(NamedTuple):
    """What a bench is about, and what its figures stand beside."""

    title: str
    beside: str


BENCHES = {
    "gradient": Told("The closed forms", "scipy's solve_bvp on the same equations, and the rod"),
    "cosserat": Told("The rod", "shapes of the literature, and itself a thousand times finer"),
    "combinations": Told("What goes together", "no peer; [what does](limits.md#what-goes-together)"),
    "scene": Told("Clips, clearance, margins and contact", "finer meshes, and a certificate in numpy"),
    "contact": Told("Cables that are routed", "no peer; a certificate in numpy, and a bound on length"),
    "harness": Told("Harnesses", "no peer; the balance of forces at every junction"),
    "motion": Told("Cables that swing", "no peer; itself in shorter steps"),
    "seen": Told("Cables that are seen", "coherent point drift, with terms of TrackDLO; servoing open loop"),
    "planner": Told("For planners", "single predictions, a check 100 times finer, an echo as large"),
    "studies": Told("Studies", "a scan of all lengths, one worker, processes without a cluster"),
    "cell": Told("The node over DDS", "a node in Python that only answers"),
    "evidence": Told("Time against error", "solve_bvp, MuJoCo, PyElastica"),
    "truth": Told("Real cables", "motion capture of five cables, and random cables whose numbers are known"),
    "certify": Told("Certificates", "a check in numpy that shares no formula with the kernels"),
}


def page(kept: Mapping[str, Any], benches: list[str]) -> str:
    """The page as markdown; `kept` is what `scripts/bench --save` writes, `benches` the names that there are."""
    found: Mapping[str, Any] = kept["figures"]
    names = ", ".join(f"`{name}`" for name in benches)
    introduction = textwrap.fill(INTRODUCTION.format(names=names), 120, break_on_hyphens=False)
    parts = ["# Numbers", introduction, f"Written by `scripts/bench` on {kept['machine']}."]
    parts.append(MACHINE.format(load=kept["load"]))
    if kept["quick"]:
        parts.append("A quick run: few points and repetitions.")
    parts += [SHAPES, f"{BEGIN}\n{kept['front']}\n{END}", MORE]
    head = ("peer", "version", "compared", "this / it", "what it can do that this cannot")
    rows = [(p.name, p.version(found), p.compared, _range(found, p.measured), p.can) for p in PEERS]
    parts += [
        "## The peers",
        "This / it: so many times as fast; of the node, so many times its median.",
        table(head, rows),
    ]
    for name, told in BENCHES.items():
        parts += _bench(name, told, found)
    return "\n\n".join(parts) + "\n"


def _range(found: Mapping[str, Any], pattern: str) -> str:
    """Least and greatest of the figures of a name."""
    values = [row["measured"] for name, row in found.items() if pattern and re.search(pattern, name)]
    values = [value for value in values if value is not None]
    if not values:
        return "-"
    least, most = figures(min(values)), figures(max(values))
    return least if least == most else f"{least} to {most}"


def _bench(name: str, told: Told, found: Mapping[str, Any]) -> list[str]:
    """The part of a bench."""
    own = {key.removeprefix(f"{name}: "): row for key, row in found.items() if key.startswith(f"{name}: ")}
    parts = [f"## {told.title}", f"`scripts/bench {name}`. Beside: {told.beside}."]
    if not own:
        return [*parts, "Not measured in this run."]
    asked = [
        (key, row["text"], row["asked"], "yes" if row["holds"] else "NO") for key, row in own.items() if not row["kind"]
    ]
    if asked:
        parts.append(table(("figure", "measured", "asked", "holds"), asked))
    rows = [(key, row["text"]) for key, row in own.items() if row["kind"] == "ratio"]
    if rows:
        parts.append(table(("a : b", "a is so many times as fast"), rows))
    return parts
