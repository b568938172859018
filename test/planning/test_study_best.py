"""The best point of a study, against a fine scan of all of them."""

import numpy as np
import pytest
from test_study import FILE, study

import cable_shape as cs

LIMITS = ["bend_radius", {"measure": "tension", "limit": 0.9}, {"measure": "lowest", "limit": 0.6}]


def test_the_best_length_is_that_of_a_fine_scan():
    asked = study(measure=LIMITS, vary={"cable.length": {"from": 1.21, "to": 1.4, "count": 2}})
    found = asked.best()
    scan = study(measure=LIMITS, vary={"cable.length": {"from": 1.21, "to": 1.4, "step": 0.0005}}).run(workers=1)
    used = np.where(scan.complete, np.fmax.reduce(scan.used, axis=1), np.inf)
    assert found.point[0] == pytest.approx(scan.points[used.argmin(), 0], abs=5e-4)
    assert found.used <= used.min() + 1e-6
    assert found.limiting
    assert found.shapes > 0
    assert found.exact == 1.0
    assert len(found.starts) == 3
    assert np.ptp(found.starts) < 1e-3  # wherever it begins
    assert found.solves < len(scan) / 4
    assert found.value[0] == pytest.approx(scan.value[used.argmin(), 0], rel=0.02)


def test_two_places_at_once():
    vary = {"cable.length": {"from": 1.22, "to": 1.38, "count": 2}, "scene.clips.mid.arc_length": [0.56, 0.66]}
    found = study(measure=LIMITS, vary=vary).best(grid=4, starts=2, precision=1e-3)
    finer = {
        "cable.length": {"from": 1.22, "to": 1.38, "count": 17},
        "scene.clips.mid.arc_length": {"from": 0.56, "to": 0.66, "count": 11},
    }
    scan = study(measure=LIMITS, vary=finer).run(workers=1)
    used = np.where(scan.complete, np.fmax.reduce(scan.used, axis=1), np.inf)
    assert found.used <= used.min() + 1e-4


def test_the_best_length_whatever_a_tolerance_does():
    lengths, drawn = {"from": 1.21, "to": 1.4, "count": 2}, {"uniform": [0.09, 0.11]}
    options = {"measure": LIMITS, "sample": {"kind": "latin", "points": 4}}
    motion = {**FILE["motion"], "instants": 5}
    vary = {"cable.length": lengths, "cable.linear_density": drawn}
    found = study(vary=vary, motion=motion, **options).best(grid=5)
    fine = {"cable.length": {"from": 1.21, "to": 1.4, "step": 0.001}, "cable.linear_density": drawn}
    scan = study(vary=fine, motion=motion, **options).run(workers=1)
    used = np.where(scan.complete, np.fmax.reduce(scan.used, axis=1), np.inf).reshape(-1, 4).max(axis=1)
    assert found.point[0] == pytest.approx(scan.points[4 * used.argmin(), 0], abs=1e-3)
    assert found.point[1] == pytest.approx(0.1)
    assert found.used <= used.min() + 1e-6
    assert found.used > study(vary={"cable.length": lengths}, motion=motion, **options).best(grid=5).used + 0.003
    assert found.solves % 4 == 0


def test_a_kind_of_clip_is_chosen():
    vary = {"scene.clips.mid.kind": ["ball", "fixed", "hinge"], "cable.length": {"from": 1.22, "to": 1.38, "count": 2}}
    found = study(measure=LIMITS, vary=vary).best(grid=5, starts=4)
    least = []
    for kind in ("ball", "fixed", "hinge"):
        clips = [{**FILE["scene"]["clips"][0], "kind": kind}]
        alone = study(
            measure=LIMITS, scene={**FILE["scene"], "clips": clips}, vary={"cable.length": vary["cable.length"]}
        )
        least.append(alone.best(grid=5, starts=4).used)
    assert found.used == pytest.approx(min(least), abs=1e-6)
    assert found.point[0] == int(np.argmin(least))
    assert np.ptp(least) > 0.01


def test_words_are_told_as_words(tmp_path):
    asked = study(vary={"scene.clips.mid.kind": ["ball", "fixed"], "start.kind": ["clamped", "pinned"]}, measure=LIMITS)
    found = asked.run(workers=1)
    assert found.columns()["scene.clips.mid.kind"].tolist() == ["ball", "ball", "fixed", "fixed"]
    assert found.columns()["start.kind"].tolist() == ["clamped", "pinned"] * 2
    assert len(np.unique(found.value[:, 0])) == 4
    assert "ball" in found.save(tmp_path / "table.csv").read_text()
    wrong = study(vary={"scene.clips.mid.kind": ["ball", "glued"]}, measure=LIMITS).run(workers=1)
    assert wrong.complete.tolist() == [True, False]
    assert "glued" in wrong.why(1)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"vary": {}}, "must have a range"),
        ({"vary": {"cable.length": [1.2]}}, "must have a range"),
        ({"vary": {"cable.length": {"normal": [1.2, 0.1]}}}, "must have a range"),
        ({"measure": ["energy"]}, "a measure with a limit"),
        ({"vary": {"cable.length": [0.1, 0.2]}}, "a measure with a limit"),
    ],
)
def test_what_has_no_best_point_is_refused(changes, words):
    with pytest.raises(cs.ArgumentError, match=words):
        cs.Study.from_mapping({**FILE, "measure": LIMITS, **changes}).best(grid=3)
