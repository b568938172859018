"""How many grasps a second `predict_batch` answers."""

from __future__ import annotations

from time import process_time

import numpy as np
from clocks import clocked
from figures import Figures, heading
from scipy.spatial.transform import Rotation

import cable_shape as cs

CABLE = cs.Cable(
    length=1.2,
    linear_density=0.1,
    bending_stiffness=0.01,
    twisting_stiffness=0.008,
    min_bend_radius=0.03,
    max_tension=20.0,
)
TOLERANCE = 1e-4 * CABLE.length
ALONG_X = Rotation.from_quat((0.5, 0.5, 0.5, 0.5))
TURNED = Rotation.from_euler("z", 45, degrees=True) * ALONG_X
#: name, half width of the spread of either grip: position [m], rotation vector [rad]; rows
SPREADS = (("5 cm, 10 deg", 0.05, 0.17), ("10 cm, 20 deg", 0.1, 0.35), ("25 cm, 45 deg", 0.25, 0.8))
ONE_CORE, SCATTERED, TWO_CORES, WITH_CLEARANCE = 45_000.0, 12_000.0, 1.7, 10_000.0
UNKNOWN = cs.Uncertainty(start=(0.001, 0.01), end=(0.001, 0.01))  # m and rad, of either grip
_TOLD = 2  # repeats where nothing is asked


def grasps(rows: int, reach: float, turn: float, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Random grasps (rows, 7) around one: starts and ends."""
    random = np.random.default_rng(seed)
    poses = []
    for place, frame in (((0.0, 0.0, 0.5), ALONG_X), ((0.7, 0.3, 0.4), TURNED)):
        turns = Rotation.from_rotvec(random.uniform(-turn, turn, (rows, 3)))
        positions = place + random.uniform(-reach, reach, (rows, 3))
        poses.append(np.hstack((positions, (turns * frame).as_quat())))
    return poses[0], poses[1]


def bodies(count: int = 20, seed: int = 1) -> tuple[cs.Obstacle, ...]:
    """Boxes, spheres, cylinders and capsules below and beside the cable, near and far."""
    random = np.random.default_rng(seed)
    solids = (cs.Box((0.08, 0.1, 0.12)), cs.Sphere(0.05), cs.Cylinder(0.03, 0.2), cs.Capsule(0.02, 0.2))
    found = []
    for i in range(count):
        place = random.uniform((-0.3, -0.4, -0.5), (1.0, 0.6, 0.9))
        pose = cs.Pose(place, Rotation.random(random_state=i).as_quat())
        found.append(cs.Obstacle(f"body_{i}", solids[i % len(solids)], pose))
    return tuple(found)


def rate(
    rows: int, threads: int, around: cs.Scene | cs.Uncertainty | None, repeats: int, spread: tuple[float, float]
) -> tuple[float, float]:
    """Best rows a second of wall time, and of processor time; with a scene around, or a tube for what is not known."""
    starts, ends = grasps(rows, *spread)
    options = {"model": "cosserat", "tolerance": TOLERANCE, "threads": threads}
    options["uncertainty" if isinstance(around, cs.Uncertainty) else "scene"] = around
    cs.predict_batch(CABLE, starts[:100], ends[:100], **options)
    wall, processor = [], []
    for _ in range(repeats):
        used = process_time()
        wall.append(clocked(lambda: cs.predict_batch(CABLE, starts, ends, **options))[0])
        processor.append(process_time() - used)
    return rows / min(wall), rows / min(processor)


def cold_rate(rows: int, spread: tuple[float, float]) -> float:
    """Predictions from nothing a second, of the same grasps one by one."""
    starts, ends = grasps(rows, *spread)
    predictor = cs.Predictor(CABLE, model="cosserat", tolerance=TOLERANCE)
    poses = [(cs.Pose(a[:3], a[3:]), cs.Pose(b[:3], b[3:])) for a, b in zip(starts, ends, strict=True)]

    def all_of_them() -> None:
        for pair in poses:
            predictor.reset()
            predictor.predict(*pair)

    return rows / min(clocked(all_of_them)[0] for _ in range(_TOLD))


def print_rates(figures: Figures, rows: int, repeats: int) -> None:
    """Shapes a second; those of near grasps are measured `repeats` times."""
    heading(f"predict_batch: {rows} random grasps, error within 1e-4 of the length, 150 points, best of {repeats};")
    print(f"   where nothing is asked, of {_TOLD}")
    print(f"{'':34s} {'wall':>9s} {'processor':>9s}  [rows/s]")
    rates = {}
    scene = cs.Scene(obstacles=bodies())
    for name, *spread in SPREADS:
        for threads, around, said in ((1, None, ""), (2, None, "s"), (1, scene, ", 20 bodies"), (1, UNKNOWN, ", tube")):
            key = f"{name}, {threads} thread{said}"
            times = repeats if name == SPREADS[0][0] else _TOLD
            rates[key] = rate(rows, threads, around, times, (spread[0], spread[1]))
            print(f"{key:42s} {rates[key][0]:9.0f} {rates[key][1]:9.0f}")
    near, (wide, *far) = SPREADS[0][0], SPREADS[-1]
    one, two, clear = (rates[f"{near}, {key}"][0] for key in ("1 thread", "2 threads", "1 thread, 20 bodies"))
    scattered, cold = rates[f"{wide}, 1 thread"][0], cold_rate(rows // 5, (far[0], far[1]))
    figures.at_least(f"predict_batch, {near}, one core", one, ONE_CORE, "{:.0f}", "/s")
    figures.at_least(f"predict_batch, {near}, two cores: times one", two / one, TWO_CORES, "{:.2f}")
    figures.at_least(f"predict_batch, {near}, with 20 bodies", clear, WITH_CLEARANCE, "{:.0f}", "/s")
    figures.at_least(f"predict_batch, {wide}, one core", scattered, SCATTERED, "{:.0f}", "/s")
    figures.at_least(f"predict_batch, {wide}: beside the same one by one from nothing", scattered, cold, "{:.0f}", "/s")
