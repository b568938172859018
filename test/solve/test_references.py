"""The reference shapes of test/references: of the cases they are said to be of, in balance, and known otherwise."""

from __future__ import annotations

import json
import math
from itertools import pairwise
from types import SimpleNamespace

import collocation
import numpy as np
import pytest
import reference_cases
import second_variation
from references import OWN, label, references
from rods import integrated_residual

from cable_shape.command.reference_case import reference_case

CASES = {case["name"]: case for case in reference_cases.all_cases()}
BENT = [OWN / f"{name}.json" for name in ("grasp_taut", "extreme_bent", "rubber_shear", "ball_clips", "arch_load_8.5")]


def numbers(values) -> list:
    """All leaves of a case, in order."""
    if isinstance(values, dict):
        return [leaf for key in sorted(values) for leaf in numbers(values[key])]
    return [leaf for entry in values for leaf in numbers(entry)] if isinstance(values, list | tuple) else [values]


def test_each_case_has_its_file():
    assert sorted(CASES) == sorted(path.stem for path in OWN.glob("*.json"))


@pytest.mark.parametrize("name", CASES)
def test_a_file_is_of_its_case(name):
    values = json.loads((OWN / f"{name}.json").read_text())
    for key, asked in CASES[name].items():
        for there, here in zip(numbers(values[key]), numbers(asked), strict=True):
            assert there == (pytest.approx(here, abs=1e-14) if isinstance(here, float) else here), key


@pytest.mark.parametrize("path", BENT, ids=label)
def test_between_clips_a_reference_satisfies_the_rod_equations(path):
    """As integrated by rods.py, which has a frame of nine numbers and no unit."""
    values = json.loads(path.read_text())
    cable, solution = reference_case(values).cable, values["solution"]
    s, r, q, n, m = (np.array(solution[key]) for key in ("s", "r", "q_xyzw", "n", "m"))
    edges = [0.0, *sorted(event["s"] for event in solution["events"]), cable.length]
    weight = cable.linear_density * np.array(values["gravity"])
    for a, b in pairwise(edges):
        inside = (s >= a) & ((s < b) | (b == cable.length))
        part = SimpleNamespace(
            arc_length=s[inside], positions=r[inside], quaternions=q[inside], force=n[inside], moment=m[inside],
            points=int(inside.sum()),
        )  # fmt: skip
        assert integrated_residual(cable, part, weight) < 1e-8


@pytest.mark.parametrize("path", references("*clip*"), ids=label)
def test_clips_of_references_hold_what_they_say(path):
    values = json.loads(path.read_text())
    for clip, event in zip(values["clips"], values["solution"]["events"], strict=True):
        assert event["s"] == pytest.approx(clip["s"])
        if clip["type"] == "ball":
            assert event["moment_before"] == pytest.approx(event["moment_after"], abs=1e-10)
        assert event["force_before"] != pytest.approx(event["force_after"], rel=1e-3)


@pytest.mark.parametrize("thrust", [0.0, 0.5, 0.9])
def test_the_second_variation_of_a_column_goes_to_nothing_at_its_critical_load(thrust):
    """Clamped and free: (pi / 2)^2 EI / L^2 less the thrust (Euler)."""
    column = collocation.Rod(2.0, collocation.constant((3.0, 4.0, 5.0)), collocation.constant((0.0,) * 3), 0.0)
    critical = 3.0 * (0.25 * math.pi) ** 2
    straight = np.zeros((13, 80))
    straight[6], straight[12] = 1.0, -thrust * critical
    found = second_variation.smallest([column], [straight], ["frame", ""])
    assert found == pytest.approx((1.0 - thrust) * critical, rel=1e-3)
