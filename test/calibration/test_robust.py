"""Errors of fits where points that were seen together share what the model does not know."""

import numpy as np
import pytest

from cable_shape.calibration.robust import Fit, Robust

SIZE, POINTS = 6, 30


def fit(rng: np.random.Generator, groups: int, shared: float) -> Fit:
    """A linear model whose numbers are 0, and in each group of points others by `shared`."""
    design = rng.normal(size=(groups * POINTS, 3, SIZE))
    own = np.repeat(np.arange(groups), POINTS)
    off = np.einsum("nij,nj->ni", design, shared * rng.normal(size=(groups, SIZE))[own])
    seen = off + 1e-3 * rng.normal(size=off.shape)

    def misses(v: np.ndarray) -> np.ndarray:
        return seen - design @ v

    return Robust(
        misses, lambda v, r: -design, misses, np.full(len(own), 3), own, np.full(SIZE, 10.0), np.zeros((SIZE, SIZE))
    ).run(np.full(SIZE, 0.02))


@pytest.mark.parametrize(("groups", "clustered"), [(4, False), (8, False), (24, True)])
def test_few_groups_tell_how_much_points_hang_together(groups: int, clustered: bool) -> None:
    """Mean square of the answer in terms of its covariance: 1 where the errors are told as they are."""
    rng = np.random.default_rng(1)
    fits = [fit(rng, groups, 5e-4) for _ in range(100)]
    assert all(one.converged and one.clustered == clustered for one in fits)
    square = np.mean([one.values @ np.linalg.solve(one.covariance, one.values) / SIZE for one in fits])
    # few groups tell a mean over all directions, many one in each, whose inverse is larger by (G - 1) / (G - 2 - k)
    assert 0.7 < square < 1.9
    assert all(one.freedom <= max((groups - 1) * SIZE, groups - 1) for one in fits)


def test_points_that_do_not_hang_together_are_judged_by_themselves() -> None:
    rng = np.random.default_rng(2)
    fits = [fit(rng, 8, 0.0) for _ in range(100)]
    square = np.mean([one.values @ np.linalg.solve(one.covariance, one.values) / SIZE for one in fits])
    assert 0.7 < square < 1.2


def test_one_group_tells_nothing_of_others() -> None:
    rng = np.random.default_rng(3)
    square = np.mean([one.values @ np.linalg.solve(one.covariance, one.values) / SIZE
                      for one in (fit(rng, 1, 5e-4) for _ in range(30))])  # fmt: skip
    assert square > 5.0


def test_where_nothing_is_predicted_from_nothing_a_fit_ends_and_says_that_it_did_not_converge() -> None:
    """Its numbers are those where the branch that it followed led."""
    rng = np.random.default_rng(5)
    design = rng.normal(size=(40, 3, 2))
    seen = 1e-3 * rng.normal(size=(40, 3))

    def misses(v: np.ndarray) -> np.ndarray:
        return seen - design @ v

    def afresh(v: np.ndarray) -> np.ndarray:
        return misses(v) if np.abs(v).max() > 0.015 else np.full(seen.shape, np.nan)

    own = np.arange(40)
    whole = Robust(misses, lambda v, r: -design, afresh, np.full(40, 3), own, np.full(2, 10.0), np.zeros((2, 2)))
    found = whole.run(np.full(2, 0.02))
    assert not found.converged
    assert np.abs(found.values).max() < 1e-3
    assert np.isfinite(found.misses).all()
    assert np.isfinite(found.covariance).all()


def test_a_number_that_is_nothing_does_not_keep_the_others_from_their_answer() -> None:
    """Its logarithm is fitted and has no least loss: a step that is cut to its largest would leave all where it was."""
    rng = np.random.default_rng(6)
    design, drawn = rng.normal(size=(400, 3, 3)), rng.normal(size=(400, 3)) ** 2
    truth = np.array((4.0, -7.0, 2.0))
    seen = design @ truth - 0.01 * drawn + 1e-3 * rng.normal(size=drawn.shape)  # below nothing is best

    def misses(v: np.ndarray) -> np.ndarray:
        return np.asarray(design @ v[:3] + np.exp(v[3]) * drawn - seen)

    def derivative(v: np.ndarray, r: np.ndarray) -> np.ndarray:
        return np.concatenate((design, (np.exp(v[3]) * drawn)[:, :, None]), axis=2)

    most = np.array((20.0, 20.0, 20.0, 1.0))
    fit = Robust(misses, derivative, misses, np.full(400, 3), np.arange(400), most, np.zeros((4, 4)))
    found = fit.run(np.array((0.0, 0.0, 0.0, -12.0)))
    assert found.values[:3] == pytest.approx(truth, abs=3e-3)
    assert found.iterations < 15
