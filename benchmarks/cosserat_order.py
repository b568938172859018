"""The order of the Cosserat predictor: errors on meshes of N, 2N, 4N and 8N elements against the reference shapes.

The meshes are laid out here, all with the same share of elements in the boundary layers, and none is refined: what the
tolerance would ask for plays no part.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from cosserat_cases import error_of, load, reach
from figures import Figures, heading
from tqdm import tqdm

from cable_shape.kernels import rod_mesh
from cable_shape.kernels.network import drive
from cable_shape.kernels.network.newton import CONVERGED
from cable_shape.solve.network import Network

COARSEST, DOUBLINGS = 12, 3
#: One of each sort: soft, anisotropic, extensible, free end, plug, twisted, rest curvature, masses, ends turned,
#: weightless, taut, shearable, dead moment, helix, homoclinic.
SHOWN = (
    "grasp_02", "grasp_soft_04", "grasp_taut_01", "grasp_rotated_03", "grasp_twisted_05", "anisotropic_03",
    "extensible_03", "extensible_04", "rest_curvature_06", "no_gravity_05", "point_mass_04", "free_end_01",
    "free_end_08", "bend45_shear_GA5e6_P600", "cantilever_end_load_PL2_EI_10", "heavy_cantilever_wL3_EI_50",
    "elastica_clamped_clamped_D_0.4", "helix_clamped_c", "localised_buckling_mu_0.85", "postbuckled_cantilever_160_deg",
    "pure_bending_full_circle",
)  # fmt: skip
#: Below this the references' own digits and the rounding of 200 elements begin to count.
FLOOR = 5e-12


def compiled(state: Network, buffer: np.ndarray, history: int, guard: bool, most: int, far: float) -> int:
    """One compiled solve for the trial of a plain cable, see `drive.solve`."""
    return drive.solve(
        state.ints, state.floats, state.sols, state.work, buffer, state.info, np.empty((0, 7)), state.problem.points,
        history, False, False, guard, most, far,
    )  # fmt: skip


def solve_on(state: Network, elements: int) -> np.ndarray:
    """Positions of the equilibrium next to the last one on a mesh of so many elements, half of them in the layers."""
    problem, length = state.problem, state.problem.cable.length
    poses = state.poses.copy()
    x, density = np.empty(129), np.empty(129)
    layer = float(state.layers(poses)[0])
    rod_mesh.layered(length, min(max(layer, 1e-5 * length), length), x, density)
    state.lay_out([(x, density)], (elements,))
    state.unsettle()
    buffer = np.empty(17 * problem.points)
    for _ in range(3):  # each begins where the last one ended: until rounding is all that is left
        state.target[...] = poses
        code = compiled(state, buffer, 1, False, 60, math.inf)
        if code != CONVERGED:
            raise RuntimeError(f"no equilibrium on {elements} elements: {code}")
    return buffer[problem.points : 4 * problem.points].reshape(-1, 3)


def print_order(folder: Path, figures: Figures) -> None:
    """Errors and the order of each doubling for SHOWN; of all shapes the range of the orders above the floor."""
    meshes = [COARSEST * 2**k for k in range(DOUBLINGS + 1)]
    elements = ", ".join(map(str, meshes))
    heading(f"Order: mean error / L on {elements} elements, and the order of each doubling (asked 4, made for 6)")
    cases = load(folder / "public") + load(folder / "published")
    found: list[float] = []
    shown = fourth = 0
    for values in tqdm(cases, desc="order", unit="shape", leave=False, disable=None):
        _, state = reach(values)
        errors = np.array([error_of(solve_on(state, n + 2 * state.stops.size), values) for n in meshes])
        orders = np.log2(errors[:-1] / errors[1:])
        found.extend(orders[errors[1:] > FLOOR])
        fourth += bool((orders[errors[1:] > FLOOR] >= 4.0).all())
        if values["name"] in SHOWN:
            shown += 1
            cells = "  ".join(f"{error:.1e}" for error in errors)
            said = "  ".join(f"{o:4.1f}" if e > FLOOR else "   -" for o, e in zip(orders, errors[1:], strict=True))
            print(f"{values['name']:38} {cells}   {said}", flush=True)
    print(f"{shown} of {len(cases)} shapes shown; -: below {FLOOR:.0e}, where the digits of the reference end")
    figures.at_least("shapes of at least 4th order in every doubling", fourth, 6, "{:.0f}")
    figures.at_least(f"order of a doubling, median of {len(found)}", float(np.median(found)), 5.5)
