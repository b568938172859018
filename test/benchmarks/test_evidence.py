"""The evidence that `scripts/bench evidence` draws: folds where theory has them, invariance, shortcuts that fire."""

from pathlib import Path

import bench_evidence
import evidence_maps
import evidence_profile
import evidence_skip
import evidence_walk
import evidence_work
import numpy as np
import pytest
from evidence_pages import BEGIN, END, NUMBERS, PAPER, Pages, Point, front, put

from cable_shape.shape import Status


def snaps(map_: evidence_maps.Map, x: float, y: np.ndarray) -> np.ndarray:
    """Where along a column the shape snaps."""
    return y[[s[0] == Status.SNAPPED.value for s in map_.column(x, y)]]


def test_the_pages_are_written_and_their_pictures_exist(tmp_path: Path) -> None:
    pages = Pages(tmp_path, quick=True)
    evidence_maps.MAPS, kept = evidence_maps.MAPS[:2], evidence_maps.MAPS
    try:
        evidence_maps.evidence(pages)
    finally:
        evidence_maps.MAPS = kept
    pages.ratio("a : b", 2.0, "why")
    pages.ratio("c : d", 0.5)
    pages.write()
    stability = (tmp_path / "stability.md").read_text()
    for name in ("map_twist", "map_bowed"):
        assert f"(images/{name}.png)" in stability
        assert (tmp_path / "images" / f"{name}.png").stat().st_size > 10_000
    performance = (tmp_path / "performance.md").read_text()
    assert performance.index("| a : b | 2.00 | why |") < performance.index("Where nothing is gained")
    assert performance.index("Where nothing is gained") < performance.index("| c : d | 0.500 |")


def test_a_file_to_compare_with_that_is_missing_is_told_before_the_work(tmp_path: Path) -> None:
    with pytest.raises(SystemExit):
        bench_evidence.main(["--compare", str(tmp_path / "none.json")])


def test_the_rod_is_nearer_to_its_reference_than_closed_forms_and_agrees_with_solve_bvp() -> None:
    series, finest = evidence_work.cold("A", quick=True)
    errors = [point.error for point in series["rod"]]
    assert errors == sorted(errors, reverse=True)
    assert errors[-1] < 1e-8
    assert finest < 1e-5
    assert min(series[model][0].error for model in evidence_work.CLOSED) > 1e-3


def test_the_front_page_gets_time_and_error_between_its_marks(tmp_path: Path) -> None:
    rod = [Point(1e-3, 1e-2, "tol 1e-02 L"), Point(2e-3, 1e-6, "tol 1e-05 L")]
    other = {
        "gradient4": [Point(1e-5, 0.02, "")],
        "solve_bvp": [Point(0.5, 1e-4, "tol 1e-03")],
    }
    links = {"PyElastica 1.0.0": [Point(0.1, 0.01, "", 10), Point(0.3, 0.002, "", 20)]}
    series = {f"{name}, cold": {"rod": rod, **other, **links} for name in "ABCD"} | {"M, warm": {"rod": rod, **other}}
    page = tmp_path / "page.md"
    page.write_text(f"before\n{BEGIN}\nold\n{END}\nafter\n")
    for _ in range(2):
        put(front(series, "tol 1e-05 L"), page)
    text = page.read_text()
    assert text.startswith("before\n")
    assert text.endswith("\nafter\n")
    assert "old" not in text
    assert "| `cosserat` | 2.0 ms, 1e-06 |" in text
    assert "| `catenary` | - |" in text
    assert "| PyElastica 1.0.0, 20 links | 300 ms, 2e-03 |" in text
    assert text.count(PAPER) == 1
    assert NUMBERS.read_text().count(BEGIN) == 1


def test_a_strip_bowed_upwards_snaps_where_the_elastica_says() -> None:
    map_ = evidence_maps.bowed(7)
    x, y, _ = map_.lines[0]
    for chord in (0.9, 0.97):  # at 0.97 no frame turns far enough for the snap to be told: the eigenvalue tells it
        exact = float(np.interp(chord, x[::-1], y[::-1]))
        ratios = exact * np.geomspace(1.6, 0.8, 41)
        eigenvalue = np.array([s[1] for s in map_.column(chord, ratios)])
        jump = int(np.diff(eigenvalue).argmax()) + 1
        assert eigenvalue[jump] > 20.0 * eigenvalue[jump - 1] > 0.0
        assert ratios[jump] == pytest.approx(exact, rel=0.03)  # shallow theory, and steps of 1.7 %
        assert list(snaps(map_, chord, ratios)) == ([ratios[jump]] if chord == 0.9 else [])


def test_a_twisted_cable_pops_into_a_loop_where_the_long_rod_does() -> None:
    map_ = evidence_maps.looping(7)
    x, y, _ = map_.lines[0]
    chord = 0.75
    exact = float(np.interp(chord, x[::-1], y[::-1]))
    found = snaps(map_, chord, np.linspace(0.0, 1.2 * exact, 25))
    assert len(found) == 1
    assert found[0] == pytest.approx(exact, rel=0.08)


def test_a_standing_strip_snaps_only_below_greenhills_stiffness() -> None:
    map_ = evidence_maps.column_tilt(7)
    critical = map_.lines[0][0][0]
    tilts = np.linspace(-20.0, 20.0, 21)
    assert len(snaps(map_, 0.95 * critical, tilts)) == 1
    assert len(snaps(map_, 1.01 * critical, tilts)) == 0


def test_a_walk_counts_every_step(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(evidence_walk, "STEPS_QUICK", 60)
    row = evidence_walk.walked("usual", quick=True)
    assert row[1] == "60"
    assert row[2] == "OK 60"
    assert row[3] == "0"
    assert float(row[5]) < 1.0
    assert float(row[7]) < 1e-5


SKIPS = [
    pytest.param(job, shortcut, id=f"{shortcut.name}, {job.name}")
    for job in evidence_skip.jobs(quick=True)[1:]
    for shortcut in evidence_skip.SHORTCUTS
    if evidence_skip.applies(job, shortcut)
]


@pytest.mark.parametrize(("job", "shortcut"), SKIPS)
def test_shortcuts_give_the_same_answer(job: evidence_skip.Job, shortcut: evidence_skip.Shortcut) -> None:
    assert evidence_skip.holds(shortcut, evidence_skip.compare(job, shortcut))


def test_each_shortcut_fires_somewhere() -> None:
    jobs = {job.name: job for job in evidence_skip.jobs(quick=True)}
    at = ("bench_cell.yaml, the demo's motion",) * 2 + ("no scene, motion M",)
    for name, shortcut in zip(at, evidence_skip.SHORTCUTS, strict=True):
        assert evidence_skip.compare(jobs[name], shortcut).fired > 0, shortcut.name


def test_phases_sum_to_the_whole() -> None:
    shares, seconds = evidence_profile.phases(evidence_skip.jobs(quick=True)[1])
    assert sum(shares.values()) == pytest.approx(1.0)
    assert min(shares.values()) >= 0.0
    assert seconds > 0.0


def test_starting_is_measured_in_a_process_of_its_own() -> None:
    times, memory = evidence_profile.startup(12, 1)
    assert times.shape == (4,)
    assert (times > 0.0).all()
    assert memory.shape == (7,)
    assert list(memory) == sorted(memory)
