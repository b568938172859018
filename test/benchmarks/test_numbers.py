"""The page of numbers: all figures of all benches, what they stand beside, and what is not measured is told."""

import json
from pathlib import Path

import bench_all
import numbers_page
import pytest
from evidence_pages import BEGIN, END


def figure(measured: float, text: str, kind: str = "", holds: bool = True) -> dict[str, object]:
    return {
        "measured": measured,
        "asked": "at least 2" if not kind else "-",
        "text": text,
        "holds": holds,
        "kind": kind,
    }


KEPT = {
    "machine": "a machine",
    "quick": False,
    "load": "0.3",
    "front": "| a table |",
    "figures": {
        "gradient: least ratio to solve_bvp, warm": figure(701.0, "701"),
        "scene: usable": figure(1.0, "1", holds=False),
        "cell: 125 Hz: p50 of the node / of the echo": figure(1.14, "1.14"),
        "evidence: rod : PyElastica 9.8.7, grasp A cold": figure(628.0, "628", "ratio"),
        "evidence: rod : PyElastica 9.8.7, grasp B cold": figure(1378.0, "1.38e+03", "ratio"),
    },
}


def test_the_page_has_every_figure_with_its_peer() -> None:
    page = numbers_page.page(KEPT, ["cell", "scene"])
    assert f"{BEGIN}\n| a table |\n{END}" in page
    assert "with a name, one of them:" in " ".join(page.split())
    assert "| PyElastica, 20 elements | 9.8.7 | settling on the grasps A to D | 628 to 1378 |" in page
    assert "| MuJoCo's cable, 20 links | - |" in page
    assert "| usable | 1 | at least 2 | NO |" in page
    assert "| rod : PyElastica 9.8.7, grasp A cold | 628 |" in page
    assert page.count("Not measured in this run.") == len(numbers_page.BENCHES) - 4
    assert "quick run" not in page


def test_every_bench_has_its_place_on_the_page() -> None:
    assert numbers_page.BENCHES.keys() == {part.name for part in bench_all.PARTS}


def test_figures_that_were_kept_are_drawn_without_a_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    kept, page = tmp_path / "kept.json", tmp_path / "numbers.md"
    kept.write_text(json.dumps(KEPT))
    monkeypatch.setattr(numbers_page, "PAGE", page)
    monkeypatch.setattr(bench_all, "run", None)
    assert bench_all.main(["--draw", str(kept)]) == 0
    text = page.read_text(encoding="utf-8")
    assert "Written by `scripts/bench` on a machine." in text
    assert "`rivals`" in text
    with pytest.raises(SystemExit):
        bench_all.main(["--draw", str(tmp_path / "none.json")])
