"""Studies: what is told of many points, in pieces, interrupted, by several processes, and as tables."""

import csv
import errno
import os

import numpy as np
import pytest

import cable_shape as cs
from cable_shape.planning import study_chunk

ALONG = (0.5, 0.5, 0.5, 0.5)
FILE = {
    "cable": {"length": 1.2, "linear_density": 0.1, "bending_stiffness": 0.02, "diameter": 0.01,
              "min_bend_radius": 0.085},
    "start": {"position": [0, 0, 1], "quaternion": ALONG},
    "end": {"position": [0.8, 0, 1], "quaternion": ALONG},
    "scene": {
        "obstacles": [{"name": "ball", "sphere": 0.05, "position": [0.4, 0, 0.65]}],
        "clips": [{"name": "mid", "arc_length": 0.6, "position": [0.4, 0.02, 0.8]}],
    },
    "motion": {"instants": 15, "end": [{"position": [x, 0, 1], "quaternion": ALONG} for x in (0.7, 0.85, 0.8)]},
    "vary": {"cable.length": {"from": 1.2, "to": 1.4, "step": 0.05}, "scene.clips.mid.position.z": [0.75, 0.8, 0.85]},
    "measure": ["bend_radius", "tension", "clearance", "clearance:ball", "force:0.3", "moment:end", "clip:mid",
                "lowest"],
    "points": 60,
    "chunk": 4,
}  # fmt: skip


def study(**changes):
    return cs.Study.from_mapping({**FILE, **changes})


@pytest.fixture(scope="module")
def found():
    return study(at="all").run(workers=1)


def test_the_worst_instant_is_that_of_every_shape(found):
    one = found.study.cases.at(found.points[7].tolist())
    rows = found.study.rows(7)[""]
    shapes = [rows.shape(i) for i in range(15)]
    radius = np.array([shape.bend_radius.min() for shape in shapes])
    assert found.of("bend_radius")[7] == pytest.approx(radius.min())
    assert found.instant[7, 0] == radius.argmin()
    worst = shapes[radius.argmin()]
    assert found.place[7, 0] == pytest.approx(worst.arc_length[worst.bend_radius.argmin()])
    assert found.of("tension")[7] == pytest.approx(max(shape.tension.max() for shape in shapes))
    force = [np.linalg.norm([np.interp(0.3, shape.arc_length, part) for part in shape.force.T]) for shape in shapes]
    assert found.of("force:0.3")[7] == pytest.approx(max(force), rel=1e-6)
    assert found.of("moment:end")[7] == pytest.approx(max(np.linalg.norm(shape.moment[-1]) for shape in shapes))
    assert found.of("clip:mid")[7] == pytest.approx(max(np.linalg.norm(s.clips[0].force) for s in shapes))
    assert found.of("lowest")[7] == pytest.approx(min(shape.positions[:, 2].min() for shape in shapes))
    assert np.array_equal(found.of("clearance"), found.of("clearance:ball"))
    assert found.limit[7].tolist()[0] == 0.085
    assert one.scene.clips[0].pose.position[2] == found.points[7, 1]


def test_every_instant_is_kept_where_asked(found):
    assert found.over.shape == (15, 15, 8)
    assert np.allclose(np.nanmin(found.over[:, :, 0], axis=1), found.value[:, 0])
    assert study().run(workers=1).over.shape[1] == 0


def test_what_is_within_all_limits(found):
    good = (found.of("bend_radius") >= 0.085) & (found.of("clearance") >= 0.01)
    assert np.array_equal(found.within, good)
    assert 0 < good.sum() < len(good)
    assert np.array_equal(np.fmax.reduce(found.used, axis=1) <= 1.0, good)


def test_workers_and_chunks_change_no_bit(found):
    for other in (study(at="all").run(workers=2), study(at="all", chunk=7).run(workers=1)):
        for name in ("value", "instant", "place", "over"):
            assert np.array_equal(getattr(other, name), getattr(found, name), equal_nan=True)


def test_an_interrupted_study_goes_on(tmp_path, found):
    def stop(done, whole):
        if done >= 8:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        study(at="all").run(tmp_path / "out", workers=1, progress=stop)
    kept = {file: file.stat().st_mtime_ns for file in (tmp_path / "out/chunks").iterdir()}
    assert len(kept) == 2
    told = []
    again = study(at="all").run(tmp_path / "out", workers=1, progress=lambda done, whole: told.append(done))
    assert told[0] == 8
    assert told[-1] == 15
    assert {file: file.stat().st_mtime_ns for file in kept} == kept
    assert np.array_equal(again.value, found.value, equal_nan=True)


def test_half_a_chunk_is_solved_again(tmp_path, found):
    study(at="all").run(tmp_path / "out", workers=1)
    file = tmp_path / "out/chunks/000001.npz"
    file.write_bytes(file.read_bytes()[:300])
    assert np.array_equal(study(at="all").run(tmp_path / "out", workers=1).value, found.value, equal_nan=True)


def test_a_folder_of_something_else_is_refused(tmp_path):
    study().run(tmp_path / "out", workers=1)
    with pytest.raises(cs.ArgumentError, match="another study is in this folder"):
        study(measure=["tension"]).run(tmp_path / "out", workers=1)
    (tmp_path / "full").mkdir()
    (tmp_path / "full/notes.txt").write_text("mine")
    with pytest.raises(cs.ArgumentError, match="Name a new folder"):
        study().run(tmp_path / "full", workers=1)


def test_a_full_disk_loses_nothing(tmp_path, monkeypatch, found):
    keep, count = os.replace, iter(range(100))

    def full(a, b):
        if next(count) >= 3:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        keep(a, b)

    with monkeypatch.context() as patched:
        patched.setattr(study_chunk.os, "replace", full)
        with pytest.raises(cs.FileError, match=r"No space left on device\. What was done is kept"):
            study(at="all").run(tmp_path / "out", workers=1)
    assert sorted(file.name for file in (tmp_path / "out/chunks").iterdir()) == ["000000.npz", "000001.npz"]
    assert np.array_equal(study(at="all").run(tmp_path / "out", workers=1).value, found.value, equal_nan=True)


def test_tables_are_read_back(tmp_path, found):
    from pyarrow import parquet

    with found.save(tmp_path / "a.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [float(row["cable.length"]) for row in rows] == found.points[:, 0].tolist()
    assert [float(row["tension"]) for row in rows] == found.of("tension").tolist()
    table = parquet.read_table(found.save(tmp_path / "b.parquet", instants=True))
    assert table.num_rows == 225
    assert np.array_equal(table["tension"].to_numpy(), found.over[:, :, 1].ravel(), equal_nan=True)
    assert table["instant"].to_pylist()[:16] == [*range(15), 0]
    with pytest.raises(cs.ArgumentError, match=r"\.csv or \.parquet"):
        found.save(tmp_path / "a.txt")
    with pytest.raises(cs.ArgumentError, match="at='all'"):
        study(vary={"cable.length": [1.2]}).run(workers=1).all_instants()


def test_points_without_a_shape_are_counted_and_placed():
    some = study(vary={"cable.length": [0.5, 1.08, 1.2]}).run(workers=1)
    assert some.complete.tolist() == [False, False, True]
    assert "arc_length" in some.why(0)
    assert "OVERSTRETCHED at instant" in some.why(1)
    assert some.usable.tolist()[0] == 0
    assert 0 < some.usable[1] < 15
    assert np.isfinite(some.of("tension")[1])
    assert some.why(2) == ""


def mean_height(shape):
    return float(shape.positions[:, 2].mean())


def test_a_function_of_the_users():
    told = [{"measure": "height", "worst": "least", "limit": 0.88}, "tension"]
    mine = cs.Study.from_mapping({**FILE, "measure": told}, functions={"height": mean_height})
    result = mine.run(workers=2)
    rows = mine.rows(3)[""]
    heights = [mean_height(rows.shape(i)) for i in range(15)]
    assert result.of("height")[3] == min(heights)
    assert (result.within == (result.of("height") >= 0.88)).all()


def test_objects_say_the_same_as_a_file(found):
    values = {key: FILE[key] for key in ("vary", "measure", "points", "chunk")}
    ends = np.array([(x, 0.0, 1.0, *ALONG) for x in (0.7, 0.85, 0.8)])
    starts = np.tile((0.0, 0.0, 1.0, *ALONG), (3, 1))
    made = cs.Study(
        cs.Cable.from_mapping(FILE["cable"]),
        start=cs.Pose(FILE["start"]["position"], ALONG),
        end=cs.Grip(cs.Pose(FILE["end"]["position"], ALONG)),
        scene=cs.Scene.from_mapping(FILE["scene"]),
        motion={"instants": 15, "start": starts, "end": ends},
        **values,
    )
    assert np.allclose(made.run(workers=1).value, found.value, rtol=1e-9)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"varry": {}}, "Did you mean 'vary'"),
        ({"vary": {"cabel.length": [1]}}, "no part of a study"),
        ({"vary": {"scene.clips.mod.arc_length": [1]}}, "Did you mean 'mid'"),
        ({"vary": {"cable.length": []}}, "at least one"),
        ({"measure": ["bendradius"]}, "it must be one of"),
        ({"measure": ["clearance:bal"]}, "it must be one of ball"),
        ({"measure": ["clip:clip0"]}, "it must be one of mid"),
        ({"measure": ["force:middle"]}, "an arc length in m, start or end"),
        ({"measure": ["tension", "tension"]}, "named twice"),
        ({"at": "best"}, "one of worst, all"),
        ({"chunk": -1}, "at least 0"),
        ({"motion": {"instants": 0}}, "at least 1"),
        ({"motion": {"joints": {}}}, "whose joints"),
        ({"sample": {"kind": "halton"}}, "sobol, latin, random"),
        ({"cable": None}, "needs a cable or a harness"),
    ],
)
def test_what_is_wrong_is_told_with_its_remedy(changes, words):
    with pytest.raises(cs.ArgumentError, match=words):
        study(**changes).rows(0)


def test_a_key_that_no_cable_has_is_told_at_once():
    with pytest.raises(cs.ArgumentError, match="Did you mean 'length'"):
        study(vary={"cable.lenght": [1.0]}).run(workers=1)
