"""Stiffness along a cable found again, and names that cross validation takes or leaves."""

import math
from pathlib import Path

import numpy as np
import pytest
from test_calibration import TRUE, grips, rough
from test_supports import seen_of
from truth_synthetic import recovered_stiffness

import cable_shape as cs
from cable_shape.calibration.parameters import Parameters, pieces, supports_in
from cable_shape.errors import ArgumentError

ALONG = "bending_stiffness_along"
STIFF = TRUE.mean_bending_stiffness
#: Half as stiff in its first half, three times as stiff in the last third.
PROFILE = STIFF * np.array((0.5, 0.5, 0.5, 1.0, 3.0, 3.0))


def made_of(profile: np.ndarray) -> cs.Cable:
    """The cable with this stiffness [N m^2] on pieces of one length."""
    edges = np.linspace(0.0, TRUE.length, len(profile) + 1).tolist()
    parts = [
        cs.Section(low, high, bending_stiffness=x, twisting_stiffness=x / 1.3)
        for low, high, x in zip(edges, edges[1:], profile.tolist(), strict=False)
    ]
    return TRUE.replace(sections=parts)


def test_a_stiffness_on_nine_pieces_is_in_its_intervals() -> None:
    inside = np.concatenate([recovered_stiffness(seed) for seed in range(6)])
    # of 6 * 9 intervals of 95 %, which go together within a cable
    assert len(inside) == 54
    assert inside.sum() >= 46


def test_a_profile_comes_back_and_goes_into_the_file(tmp_path: Path) -> None:
    found = cs.calibrate(seen_of(made_of(PROFILE), 9), rough(TRUE), ALONG, supports=6)
    assert found.converged
    for name, true in zip(pieces(6), PROFILE, strict=True):
        assert abs(math.log(found[name].value / true)) < 3.0 * found[name].relative
        assert found[name].relative < 0.25
    cable = cs.CableFile.from_yaml(found.save(tmp_path / "cable.yaml")).cable
    assert [x.properties["bending_stiffness"][0] for x in cable.sections] == pytest.approx(
        [found[name].value for name in pieces(6)]
    )
    start, end = grips(np.random.default_rng(9), 1.0)
    true = cs.predict(made_of(PROFILE), start, end).positions
    assert np.abs(cs.predict(cable, start, end).positions - true).max() < 5e-3
    assert np.abs(cs.predict(TRUE, start, end).positions - true).max() > 2e-2  # what one stiffness makes of it


def test_its_covariance_makes_a_tube(tmp_path: Path) -> None:
    found = cs.calibrate(seen_of(made_of(PROFILE), 9), rough(TRUE), ("length", ALONG), supports=6)
    known = cs.Uncertainty.from_yaml(cs.Uncertainty.of(found).save(tmp_path / "known.yaml"))
    start, end = grips(np.random.default_rng(9), 1.0)
    tube = cs.predict_tube(found, start, end)
    report = cs.Cycle(found.cable, uncertainty=known).step({"cable": (start, end)}, stamp=0)
    np.testing.assert_allclose(report.tubes["cable"].radius[75], tube.radius[50], rtol=0.05)
    true = cs.predict(made_of(PROFILE), start, end, points=101).positions
    assert (np.linalg.norm(true - tube.shape.positions, axis=1) <= tube.radius).mean() > 0.9


def test_cross_validation_takes_it_where_the_stiffness_varies_and_leaves_it_where_not() -> None:
    names, quiet = ("bending_stiffness", "length"), {"noise": 5e-5}
    fits = [
        cs.calibrate(seen_of(one, 9, **quiet), rough(TRUE, 1.2), names, optional=ALONG, priors={ALONG: 1.0})
        for one in (made_of(PROFILE), TRUE)
    ]
    for found, taken in zip(fits, (True, False), strict=True):
        assert found.parameters is not None
        assert found.parameters.names == (("length", ALONG) if taken else names)
        said = f"{ALONG} is {'fitted' if taken else 'left out'} by cross validation"
        assert sum(remark.startswith(said) for remark in found.remarks) == 1
    same = cs.calibrate(seen_of(TRUE, 9, **quiet), rough(TRUE, 1.2), names)
    assert fits[1]["length"].value == same["length"].value


def test_sections_keep_what_else_they_have() -> None:
    own = TRUE.replace(sections=[cs.Section(0.4, 0.5, bending_stiffness=2.0 * STIFF, linear_density=0.1)])
    parameters = Parameters(own, ("length", ALONG), supports=4)
    np.testing.assert_allclose(np.exp(parameters.start[1:]), STIFF)  # in the middles of the pieces
    made = parameters.make_cable(parameters.start + np.array((0.1, 0.0, math.log(2.0), 0.0, 0.0)))
    told = [(x.start, x.end, x.properties["bending_stiffness"][0] / STIFF) for x in made.sections]
    np.testing.assert_allclose(
        told, [(0, 0.275, 1), (0.275, 0.44, 2), (0.44, 0.55, 4), (0.55, 0.825, 1), (0.825, 1.1, 1)], rtol=1e-9
    )
    assert made.sections[2].properties["linear_density"] == 0.1
    again = Parameters(made, ("length", ALONG), supports=4)
    one = again.make_cable(again.start)
    assert [x.as_dict() for x in one.sections] == [x.as_dict() for x in made.sections]


def test_names_say_how_many_pieces_there_are() -> None:
    assert pieces(4) == tuple(f"bending_stiffness_at_{x}" for x in ("12.5", "37.5", "62.5", "87.5"))
    assert supports_in((ALONG, "length"), 8) == 7
    assert supports_in((ALONG, "rest_curvature_along"), 27) == 9
    assert supports_in((ALONG, "rest_curvature_along"), 28) == 0


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"fit": ("bending_stiffness", ALONG)}, "bending_stiffness is a part of"),
        ({"fit": "length", "optional": "weight"}, "weight"),
        ({"fit": "length", "optional": ALONG, "priors": {"roll": 1.0}}, "roll"),
        ({"fit": "length", "optional": 3}, "optional"),
    ],
)
def test_what_cannot_be_is_named(options: dict[str, object], words: str) -> None:
    with pytest.raises(ArgumentError, match=words):
        cs.calibrate(seen_of(TRUE, 2), TRUE, **options)  # type: ignore[call-overload]


def test_cross_validation_needs_two_groups() -> None:
    with pytest.raises(ArgumentError, match=r"optional.*two groups"):
        cs.calibrate(seen_of(TRUE, 2, groups=1), TRUE, "length", optional=ALONG)
