#!/usr/bin/env python
"""Cables that swing: what a step and its derivatives cost, how fast what it loses falls, and random whips, with the
steps that are lost.

    scripts/bench motion [--quick] [--save FILE] [--compare FILE]
    scripts/bench motion --data FOLDER [--train FOLDER] [--cables K ...] [--all] [--save FILE]

Times are medians of steps of 10 ms of a cable whose grips move. Whips throw both grips about in all directions, with
0.1 m and up to 2.5 Hz, for 2 s, cables from stiff to limp.

--data judges predictions of real cables instead: the recordings of FOLDER, cableK_motion.npz, in DEFORM's measure, each
by a fit of eight numbers (--all: of all that helps) to those recordings of --train (../shared/data/motion) that are not
among those judged; recordings that are in both are held back by halves. Some minutes a cable.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import sys
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from time import perf_counter, process_time
from typing import NamedTuple

import numpy as np
from clocks import Turns
from figures import Figures, bench_options, bench_parser, finish, heading, machine
from motion_real import TRAIN, measure_real
from problems import GRASPS
from problems import motion as planned
from tqdm import tqdm

import cable_shape as cs

ALONG = (0.5, 0.5, 0.5, 0.5)
START, END = np.zeros(3), np.array((0.7, 0.0, 0.0))
CABLE = cs.Cable(length=1.0, linear_density=0.1, bending_stiffness=0.01)
DT = 0.01  # s
#: Bending stiffness [N m^2] of the cables that are whipped: 0.01 to 1e-5 weight * length^2.
WHIPPED = (1e-2, 1e-3, 1e-4, 1e-5)


def smooth(t: float, whole: float) -> float:
    """From 0 to 1 in the time `whole`."""
    x = min(t / whole, 1.0)
    return x**4 * (35.0 - 84.0 * x + 70.0 * x**2 - 20.0 * x**3)


def ends(first: np.ndarray, second: np.ndarray) -> tuple[cs.Pose, cs.Pose]:
    """Both grips, moved by so much."""
    return cs.Pose(START + first, ALONG), cs.Pose(END + second, ALONG)


def measure_steps(figures: Figures, steps: int) -> None:
    """Times of a step, through Python and compiled."""
    heading("A step of 10 ms [us], median: through Python with a shape of 150 points, and compiled without one")
    from cable_shape.kernels.network import swinging

    for elements in (12, 20, 40):
        motion = cs.Motion(CABLE.replace(retardation_time=0.02, drag=0.02), elements=elements)
        motion.begin(*ends(np.zeros(3), np.zeros(3)))
        whole, compiled, iterations = [], [], []
        for k in range(1, steps + 1):
            way = 0.05 * np.sin(0.06 * k * np.array((1.0, 1.3, 0.7)))
            shape = motion.step(*ends(way, 0.5 * way), DT)
            whole.append(shape.solve_time)
            iterations.append(shape.iterations)
        swing, state = motion._swing, motion._state
        assert swing is not None
        assert state is not None
        for k in range(steps + 1, 2 * steps + 1):
            way = 0.05 * np.sin(0.06 * k * np.array((1.0, 1.3, 0.7)))
            poses = state.aim(*(cs.Grip(pose) for pose in ends(way, 0.5 * way)))
            began = perf_counter()
            swinging.step(
                swing.ints, swing.floats, swing.sols, swing.work, swing.moving, swing.remembered, poses, DT, swing.kept,
                swing.info, swing._scratch,
            )  # fmt: skip
            compiled.append(perf_counter() - began)
        python, alone = (1e6 * float(np.median(times[10:])) for times in (whole, compiled))
        print(f"N = {elements:3}: {python:7.1f} {alone:7.1f}   {np.mean(iterations):.2f} iterations")
        if elements == 20:
            figures.at_most("a step of 20 elements, compiled", alone, 25.0, "{:.0f}", " us")
            figures.at_most("a step of 20 elements, through Python", python, 100.0, "{:.0f}", " us")


def measure_touching(figures: Figures, steps: int) -> None:
    """Times of a step of a cable that is swept over a table, compiled."""
    heading("A step of 10 ms of 20 elements swept over a table [us], compiled, median")
    from cable_shape.kernels.contact import swung

    table = cs.Scene(obstacles=[cs.Obstacle("table", cs.HalfSpace(), cs.Pose((0.0, 0.0, -0.15)))], contact="solve")
    for friction in (0.0, 0.3):
        made = {"bending_stiffness": 3e-3, "diameter": 0.01, "friction": friction}
        motion = cs.Motion(CABLE.replace(retardation_time=0.02, drag=0.02, **made), table, elements=20)
        motion.begin(*ends(np.zeros(3), np.zeros(3)))
        swing, state = motion._swing, motion._state
        assert swing is not None
        assert state is not None
        assert swing.among is not None
        spent, iterations, touched = [], [], []
        for k in range(1, steps + 1):
            way = 0.05 * np.sin(0.06 * k * np.array((1.0, 1.3, 0.7))) * np.array((1.0, 1.0, 0.2))
            poses = state.aim(*(cs.Grip(pose) for pose in ends(way, 0.5 * way)))
            began = perf_counter()
            swung.step(
                swing.ints, swing.floats, swing.sols, swing.work, swing.moving, swing.remembered, poses, DT, swing.kept,
                swing.info, swing._scratch, swing.among.kernel, swing.among.skin,
            )  # fmt: skip
            spent.append(perf_counter() - began)
            iterations.append(swing.info[0])
            touched.append(len(swing.touches()))
        compiled, name = 1e6 * float(np.median(spent[10:])), f"friction {friction}"
        print(f"{name}: {compiled:.1f}   {np.median(iterations):.0f} iterations, {np.mean(touched):.1f} contacts")
        figures.at_most(f"a step of 20 elements on a table, {name}, compiled", compiled, 75.0, "{:.0f}", " us")


def measure_harness(figures: Figures, steps: int) -> None:
    """Times of a step of a harness, beside those of a cable, in turns."""
    heading("A step of 10 ms of a harness of three arms, 3 x 20 elements, and of a cable of 20 [us], processor time")
    arm = CABLE.replace(length=0.5, retardation_time=0.02, drag=0.02)
    ends_of_arms = ("a.end", "b.start", "c.start")
    motion = cs.Motion(cs.Harness({"a": arm, "b": arm, "c": arm}, [cs.Junction("j", ends_of_arms)]))
    one = cs.Motion(CABLE.replace(retardation_time=0.02, drag=0.02), elements=20)
    seconds: tuple[list[float], list[float]] = [], []
    for k in range(steps + 1):
        y = 0.05 * np.sin(0.06 * k)
        first, last = cs.Pose((0.0, y, 0.0), ALONG), cs.Pose((0.7, 0.5 * y, 0.0), ALONG)
        held = {"a.start": first, "b.end": cs.Pose((0.8, 0.5 * y, 0.1), ALONG), "c.end": cs.Pose((0.5, 0.4 + y, 0.1))}
        if k == 0:
            motion.begin(held)
            one.begin(first, last)
            continue
        began = process_time()
        motion.step(held, DT)
        between = process_time()
        one.step(first, last, DT)
        seconds[0].append(between - began)
        seconds[1].append(process_time() - between)
    arms, cable = (1e6 * float(np.median(times[10:])) for times in seconds)
    print(f"three arms {arms:.0f}, a cable {cable:.0f}")
    figures.at_most("a step of three arms, through Python", arms, 150.0, "{:.0f}", " us")


def measure_cycles(figures: Figures, steps: int) -> None:
    """Cycles with what swings and with what is at rest, in turns, beside bodies and in contact."""
    heading("A cycle, median: as it swings, in times of a cycle at rest")
    cable, start, _ = GRASPS["B"]
    cable = cable.replace(diameter=0.008, drag=0.02, retardation_time=0.05)
    box = cs.Obstacle("box", cs.Box((0.1, 0.1, 0.1)), cs.Pose((0.4, 0.4, -0.3)))
    for name, depth, contact in (("beside bodies", 0.6, "warn"), ("on a table", 0.22, "solve")):
        table = cs.Obstacle("table", cs.HalfSpace(), cs.Pose((0.0, 0.0, -depth)))
        scene = cs.Scene(obstacles=[table, box] if contact == "warn" else [table], contact=contact)
        cycles = {way: cs.Cycle(cable, scene=scene, model="cosserat", motion=way) for way in ("quasistatic", "dynamic")}
        turns = Turns(*cycles)
        for k, end in enumerate(planned(steps)):
            for way, cycle in cycles.items():
                report = turns.of(way, lambda c=cycle, e=end, k=k: c.step({"cable": (start, e)}, 10_000_000 * k))
                assert all(shape.usable for shape in report.shapes.values())
        rest, swung = (1e6 * turns.medians[way] for way in cycles)
        print(f"{name}: {rest:.0f} us at rest, {swung:.0f} us as it swings")
        figures.at_most(f"cycle as it swings : at rest, {name}", swung / rest, 1.5, "{:.2f}")


def measure_derivatives(figures: Figures, steps: int) -> None:
    """Times of derivatives carried along, beside those of differences, in turns on one motion."""
    heading("Derivatives of a motion by 18 numbers, N = 20, steps of 10 ms: processor time beside differences")
    cable = CABLE.replace(twisting_stiffness=0.008, retardation_time=0.02, drag=0.02)
    by = ("length", "linear_density", "bending_stiffness", "twisting_stiffness", "retardation_time", "drag")
    times = np.arange(1, steps + 1)[:, None] * 0.06 * np.array((1.0, 1.3, 0.7))
    ways = 0.05 * np.sin(times)
    first, last = (np.hstack((x, np.tile(ALONG, (steps, 1)))) for x in (START + ways, END + 0.5 * ways))
    seconds: dict[bool, list[float]] = {True: [], False: []}
    for _ in range(5):
        for derived in (True, False):
            motion = cs.Motion(cable, elements=20)
            motion.begin(*ends(np.zeros(3), np.zeros(3)), by=(*by, "start", "end") if derived else ())
            began = process_time()
            found = motion.run(first, last, np.full(steps, DT))
            seconds[derived].append(process_time() - began)
            assert found.lost == 0
    carried, plain = (1e6 * float(np.median(seconds[derived])) / steps for derived in (True, False))
    print(f"{plain:.1f} us a step; with 18 derivatives {carried:.0f} us; by differences {37.0 * plain:.0f} us")
    figures.at_most("a step and its derivatives, of that by differences", carried / (37.0 * plain), 0.5, "{:.2f}")


class Swung(NamedTuple):
    """Where the cable is at the end, the most kinetic energy on the way [J], and what was lost [J]."""

    place: np.ndarray
    most: float
    lost: float


def swung(dt: float, elements: int) -> Swung:
    """A second of a swing: both grips 0.1 m sideways in 0.4 s."""
    motion = cs.Motion(CABLE, points=41, elements=elements)
    shape = motion.begin(*ends(np.zeros(3), np.zeros(3)))
    most = lost = 0.0
    for k in range(1, round(1.0 / dt) + 1):
        way = np.array((0.0, 0.1 * smooth(k * dt, 0.4), 0.0))
        shape = motion.step(*ends(way, 0.5 * way), dt)
        most, lost = max(most, shape.kinetic_energy), lost + shape.lost
    return Swung(shape.positions, most, lost)


def measure_order(figures: Figures, quick: bool) -> None:
    """Differences and losses as steps become shorter."""
    heading("A swing of 1 s without damping: change by half the step [mm], and lost of the most kinetic energy")
    steps = [1e-2, 5e-3, 2.5e-3, 1.25e-3] if quick else [1e-2, 5e-3, 2.5e-3, 1.25e-3, 6.25e-4, 3.125e-4]
    found = [swung(dt, 20) for dt in steps]
    changes = [float(np.abs(a.place - b.place).max()) for a, b in pairwise(found)]
    for dt, one, change in zip(steps, found, [*changes, np.nan], strict=True):
        print(f"dt {1e3 * dt:7.4f} ms: {1e3 * change:9.4f} mm, lost {one.lost / one.most:.2e}")
    figures.at_least("order in time", float(np.log2(changes[-2] / changes[-1])), 1.8, "{:.2f}")
    losses = [abs(one.lost / one.most) for one in found]
    figures.at_least("lost energy, order in time", float(np.log2(losses[-2] / losses[-1])), 1.8, "{:.2f}")


def whip(rng: np.random.Generator, stiffness: float) -> Iterator[tuple[bool, float, float]]:
    """Of every step: whether it was taken, by how much the energy is above what was put in, and the most so far [J]."""
    cable = CABLE.replace(bending_stiffness=stiffness, twisting_stiffness=stiffness / 1.3)  # as a solid one's
    motion = cs.Motion(cable, points=12)
    rates, phases = rng.uniform(2.0, 16.0, (2, 3)), rng.uniform(0.0, 2.0 * np.pi, (2, 3))
    first = motion.begin(*ends(np.zeros(3), np.zeros(3)))
    given, most = 0.0, 1e-12
    for k in range(1, 201):
        t = k * DT
        ways = 0.1 * smooth(t, 0.3) * np.sin(rates * t + phases)
        shape = motion.step(*ends(*ways), DT)
        given += shape.work
        now = shape.energy + shape.kinetic_energy - first.energy
        most = max(most, abs(now), abs(given))
        yield bool(shape.usable), now - given, most


def measure_whips(figures: Figures, tries: int) -> None:
    """Random motions of grips."""
    heading("Whips without damping: steps that were lost, and energy beyond the work of the grips")
    rng = np.random.default_rng(22)
    for stiffness in WHIPPED:
        rows = [list(whip(rng, stiffness)) for _ in tqdm(range(tries), leave=False, disable=None)]
        lost = sum(not taken for row in rows for taken, _, _ in row)
        above = max(excess / row[-1][2] for row in rows for _, excess, _ in row)
        early = max(excess / most for row in rows for _, excess, most in row)
        print(
            f"EI {stiffness:7.0e}: {lost} of {sum(map(len, rows))} steps lost, energy above what was put in by at most"
        )
        print(f"            {above:.1e} of the most in the whole whip, {early:.1e} of the most until then")
        figures.at_most(f"whips, EI {stiffness:.0e}: steps lost", lost, 0, "{:.0f}")
        figures.at_most(f"whips, EI {stiffness:.0e}: energy from nowhere", above, 1e-6)


class Thrown(NamedTuple):
    """A random motion among bodies: steps, those lost, and energy beyond what was put in, of the most."""

    steps: int
    lost: int
    above: float


def thrown(rng: np.random.Generator, stiffness: float, seconds: float = 1.0) -> Thrown:
    """A cable without damping, thrown at a table: lowered and shaken by both grips, by one, or caught again on the way.

    Nothing but friction, in half of them, and impacts takes energy.
    """
    friction = float(rng.choice([0.0, 0.3]))
    cable = CABLE.replace(
        bending_stiffness=stiffness, twisting_stiffness=stiffness / 1.3, diameter=0.01, friction=friction
    )
    table = cs.Scene(obstacles=[cs.Obstacle("table", cs.HalfSpace())], contact="solve")
    motion = cs.Motion(cable, table, points=41)
    kind = rng.integers(3)  # lowered and shaken, with one end free, caught again
    height, low = 0.45 + 0.2 * rng.random() + (0.6 if kind == 1 else 0.0), rng.uniform(0.05, 0.2)
    rates, phases = rng.uniform(2.0, 16.0, (2, 3)), rng.uniform(0.0, 2.0 * np.pi, (2, 3))
    lift = np.array((0.0, 0.0, height))
    start, end = ends(lift, lift)
    first = motion.begin(start, None if kind == 1 else end)
    assert first.usable, first.detail
    lost, above, given, most = 0, 0.0, 0.0, 1e-12
    steps = round(seconds / DT)
    for k in range(1, steps + 1):
        t = k * DT
        back = smooth(max(t - 0.4, 0.0), 0.4) if kind == 2 else 0.0
        down = (height - low) * (smooth(t, 0.4) - back) * (0.9 if kind == 1 else 1.0)
        ways = 0.08 * smooth(t, 0.3) * np.sin(rates * t + phases) * np.array((1.0, 1.0, 0.3))
        start, end = ends(*(way + lift - np.array((0.0, 0.0, down)) for way in ways))
        shape = motion.step(start, None if kind == 1 else end, DT)
        lost += not shape.usable
        given += shape.work
        if shape.usable:
            now = shape.energy + shape.kinetic_energy - first.energy
            most, above = max(most, abs(now), abs(given)), max(above, now - given)
    return Thrown(steps, lost, above / most)


def measure_drops(figures: Figures, tries: int) -> None:
    """Random motions that end on a table."""
    heading("Thrown on a table without damping: steps that were lost, and energy beyond the work of the grips")
    rng = np.random.default_rng(7)
    for stiffness in WHIPPED:
        rows = [thrown(rng, stiffness) for _ in tqdm(range(tries), leave=False, disable=None)]
        lost, steps = sum(row.lost for row in rows), sum(row.steps for row in rows)
        beyond = sum(row.above > 1e-6 for row in rows)
        print(f"EI {stiffness:7.0e}: {lost} of {steps} steps lost, {beyond} of {tries} with energy from nowhere")
        print(f"            at most {max(row.above for row in rows):.1e} of the most")
        figures.at_most(f"thrown on a table, EI {stiffness:.0e}: steps lost", lost, 0, "{:.0f}")
        figures.at_most(f"thrown on a table, EI {stiffness:.0e}: energy from nowhere in so many", beyond, 0, "{:.0f}")


def went_through(p: np.ndarray, p_now: np.ndarray, r: np.ndarray, r_now: np.ndarray) -> int:
    """How often two lines (n, 3) have gone through each other for good.

    What goes through and back again on the straight way has turned in the step, and not gone through at all.
    """
    return abs(crossings(p, p_now, r, r_now, 33)) if crossings(p, p_now, r, r_now, 9, apart=False) else 0


def crossings(
    p: np.ndarray, p_now: np.ndarray, r: np.ndarray, r_now: np.ndarray, looks: int, apart: bool = True
) -> int:  # fmt: skip
    """How often pieces of two lines (n, 3) go through each other on the straight way, by looks at volumes.

    Of pieces that are near enough for that: in a plane, and along each other, volumes tell nothing. apart: those from
    one side less those from the other.
    """
    count, before, then = 0, None, None
    for x in np.linspace(0.0, 1.0, looks):
        a, b = p + x * (p_now - p), r + x * (r_now - r)
        e, f, w = np.diff(a, axis=0)[:, None], np.diff(b, axis=0)[None], b[None, :-1] - a[:-1, None]
        n = np.cross(e, f)
        size = (n * n).sum(-1) + 1e-300
        now = np.array([(n * w).sum(-1), (np.cross(w, f) * n).sum(-1) / size, (np.cross(w, e) * n).sum(-1) / size])
        if before is not None:
            share = np.abs(before[0]) / (np.abs(before[0]) + np.abs(now[0]) + 1e-300)
            at = before[1:] + share * (now[1:] - before[1:])
            long = np.linalg.norm(e, axis=-1) + np.linalg.norm(f, axis=-1) + np.linalg.norm(w - then, axis=-1)
            hit = (now[0] * before[0] < 0.0) & ((at >= 0.0) & (at < 1.0)).all(axis=0)
            hit &= np.linalg.norm(w, axis=-1) < 1.1 * long
            count += int((hit * (np.sign(now[0]) if apart else 1.0)).sum())
        before, then = now, w
    return count


def meeting(rng: np.random.Generator, scene: cs.Scene | None, steps: int = 200) -> tuple[int, int, float, float]:
    """Two cables that hang by one end each, which are shaken: steps lost and in which they touched, passes, and energy
    beyond what was put in, of the most."""
    stiffness, thick = 10.0 ** rng.uniform(-3.5, -2.0), rng.uniform(0.004, 0.012)
    cable = cs.Cable(0.5, linear_density=0.05, bending_stiffness=stiffness, diameter=thick, drag=0.02)
    rate, phase = rng.uniform(0.5, 2.5, (2, 3)), rng.uniform(0.0, 2.0 * np.pi, (2, 3))
    size, aside = rng.uniform(0.03, 0.12, (2, 3)), np.array((0.15, 0.0, 0.0))
    motion = cs.Motion(cs.Harness({"a": cable, "b": cable}, []), scene, points=101)

    def held(t: float) -> dict[str, cs.Pose]:
        ways = size * (np.sin(2.0 * np.pi * rate * t + phase) - np.sin(phase))
        return {"a.start": cs.Pose(ways[0], ALONG), "b.start": cs.Pose(ways[1] + aside, ALONG)}

    last = first = motion.begin(held(0.0))
    lost = touched = passes = 0
    above, given, most = 0.0, 0.0, 1e-12
    for k in range(1, steps + 1):
        shape = motion.step(held(DT * k), DT)
        if not shape.usable:
            lost += 1
            continue
        one, other = ([s.segments[name].positions for s in (last, shape)] for name in "ab")
        passes += went_through(*one, *other)
        touched += bool(shape.segments["a"].contacts)
        given += shape.work
        now = shape.energy + shape.kinetic_energy - first.energy
        most, above, last = max(most, abs(now), abs(given)), max(above, now - given), shape
    return lost, touched, passes, above / most


def measure_meetings(figures: Figures, tries: int) -> None:
    """Two cables thrown at each other."""
    heading("Two cables thrown at each other: steps that were lost, and how often they went through each other")
    for name, scene in (("kept out of each other", cs.Scene(contact="solve")), ("not", None)):
        rng = np.random.default_rng(11)
        rows = [meeting(rng, scene) for _ in tqdm(range(tries), leave=False, disable=None)]
        lost, touched, passes = (sum(row[i] for row in rows) for i in range(3))
        beyond = sum(row[3] > 1e-6 for row in rows)
        print(f"{name:23}: {lost} of {200 * tries} steps lost, {passes} passes, {touched} steps with contact,")
        print(
            f"{'':23}  {beyond} of {tries} with energy from nowhere, "
            f"at most {max(row[3] for row in rows):.1e} of the most"
        )
        if scene is not None:
            figures.at_most("thrown at each other: steps lost", lost, 0, "{:.0f}")
            figures.at_most("thrown at each other: passes", passes, 0, "{:.0f}")
            figures.at_most("thrown at each other: energy from nowhere in so many", beyond, 0, "{:.0f}")


def main() -> int:
    """All tables."""
    parser = bench_parser(__doc__, "few steps and whips")
    parser.add_argument("--data", type=Path, metavar="FOLDER", help="recordings to judge predictions by")
    parser.add_argument("--train", type=Path, default=TRAIN, metavar="FOLDER", help="recordings to fit to")
    parser.add_argument("--cables", type=int, nargs="+", choices=range(1, 6), default=range(1, 6), metavar="K")
    parser.add_argument("--all", action="store_true", help="fit all that helps, not eight numbers")
    parser.add_argument("--finer", action="store_true", help="fit and judge again on a mesh twice as fine")
    options = bench_options(parser)
    figures = Figures()
    print(machine())
    if options.data is not None:
        measure_real(figures, options.data, options.train, list(options.cables), options.all, options.finer)
        return finish(figures, options)
    measure_steps(figures, 200 if options.quick else 1000)
    measure_touching(figures, 200 if options.quick else 1000)
    measure_harness(figures, 200 if options.quick else 1000)
    measure_cycles(figures, 200 if options.quick else 1000)
    measure_derivatives(figures, 100 if options.quick else 500)
    measure_order(figures, options.quick)
    measure_whips(figures, 3 if options.quick else 50)
    measure_drops(figures, 3 if options.quick else 50)
    measure_meetings(figures, 3 if options.quick else 60)
    return finish(figures, options)


if __name__ == "__main__":
    sys.exit(main())
