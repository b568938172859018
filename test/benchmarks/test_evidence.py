"""The evidence that `scripts/bench evidence` draws: its page, and who comes how near."""

from pathlib import Path

import bench_evidence
import evidence_work
import matplotlib.pyplot as plt
import pytest
from evidence_pages import BEGIN, END, NUMBERS, PAPER, Pages, Point, front, put


def test_the_page_is_written_with_its_ratios_and_pictures(tmp_path: Path) -> None:
    pages = Pages(tmp_path, quick=True)
    pages.ratio("c : d", 0.5)
    pages.ratio("a : b", 2.0, "why")
    pages.picture(plt.figure(), "nothing", "An empty picture")
    pages.write()
    text = (tmp_path / "performance.md").read_text()
    assert text.index("| a : b | 2.00 | why |") < text.index("| c : d | 0.500 |")
    assert "![An empty picture](images/nothing.png)" in text
    assert (tmp_path / "images" / "nothing.png").exists()


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
