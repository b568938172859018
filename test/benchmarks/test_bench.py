"""The benches' one roof: figures kept and compared, parts run and judged; and how simulators are settled and tuned."""

import json
import math
import os
from pathlib import Path

import bench_all
import bench_rivals
import evidence_rivals
import numpy as np
import pytest
import rivals_common
import rivals_laid
import rivals_swing
import rivals_tune
from figures import Figures, bench_options, bench_parser, finish
from problems import GRASPS

PART = """
from figures import Figures, bench_options, bench_parser, finish
figures = Figures()
figures.at_most("error", {error}, 1e-3)
figures.ratio("a : b", {ratio})
print("a table")
raise SystemExit(finish(figures, bench_options(bench_parser("", ""))))
"""


def collected(ratio: float, error: float = 1e-4) -> Figures:
    """Figures of each kind."""
    figures = Figures()
    figures.ratio("a : b", ratio)
    figures.at_most("error", error, 1e-3)
    figures.at_least("share", 97.0, 90.0, "{:.1f}", " %")
    figures.at_most("share", 97.0, 99.0, "{:.1f}", " %")
    figures.check("same answer", True)
    return figures


@pytest.mark.parametrize(
    ("ratio", "error", "code"),
    [(2.0, 1e-4, 0), (1.6, 9e-4, 0), (1.5, 1e-4, 1), (2.0, 2e-3, 1)],
)
def test_the_exit_status_tells_what_does_not_hold_or_has_become_worse(
    ratio: float, error: float, code: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    parser = bench_parser("", "")
    assert finish(collected(2.0), bench_options(parser, ["--save", str(tmp_path / "kept.json")])) == 0
    kept = json.loads((tmp_path / "kept.json").read_text())
    assert kept["figures"]["error"] == {
        "measured": 1e-4, "asked": "at most 1.0e-03", "text": "1.0e-04", "holds": True, "kind": ""
    }  # fmt: skip
    assert {"share", "share, at most 99.0 %"} <= kept["figures"].keys()
    capsys.readouterr()
    now = bench_options(parser, ["--compare", str(tmp_path / "kept.json")])
    assert finish(collected(ratio, error), now) == code
    said = capsys.readouterr().out
    assert ("WORSE" in said or "NO" in said) == bool(code)


def test_figures_come_and_go_between_two_runs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before, now = collected(2.0), Figures()
    now.ratio("new : old", 3.0)
    assert now.compare(before.as_json()) == []
    said = capsys.readouterr().out
    assert "not measured now" in said
    assert "new : old" in said


def test_a_file_to_compare_with_that_is_missing_is_told_before_the_work(tmp_path: Path) -> None:
    with pytest.raises(SystemExit):
        bench_options(bench_parser("", ""), ["--compare", str(tmp_path / "none.json")])


def test_all_parts_run_each_in_its_process_and_are_judged_together(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join((str(bench_all.HERE), os.environ.get("PYTHONPATH", ""))))
    for name, error in (("good", 1e-4), ("bad", 1e-2)):
        (tmp_path / f"bench_{name}.py").write_text(PART.format(error=error, ratio=2.0))
    (tmp_path / "bench_silent.py").write_text("raise SystemExit(0)")
    (tmp_path / "bench_broken.py").write_text("raise ValueError('no')")
    parts = [bench_all.Part("good", steady=True), bench_all.Part("bad"), bench_all.Part("broken")]
    monkeypatch.setattr(bench_all, "HERE", tmp_path)
    monkeypatch.setattr(bench_all, "PARTS", (*parts, bench_all.Part("silent", figures=False, steady=True)))
    options = ["--quick", "--logs", str(tmp_path / "logs"), "--save", str(tmp_path / "all.json")]
    assert bench_all.main([*options, "--only", "good", "silent"]) == 0
    kept = json.loads((tmp_path / "all.json").read_text())
    assert kept["figures"].keys() == {"good: error", "good: a : b", "silent: ran to its end and holds"}
    assert kept["seconds"].keys() == {"good", "silent"}
    assert "a table" in (tmp_path / "logs" / "good.log").read_text()
    assert bench_all.main([*options, "--only", "bad"]) == 1
    assert bench_all.main([*options, "--only", "broken"]) == 1
    assert "exit status 1" in capsys.readouterr().out


def test_every_bench_is_a_part_or_makes_an_installation_of_its_own() -> None:
    parts = {part.name for part in bench_all.PARTS}
    benches = {file.stem.removeprefix("bench_") for file in bench_all.HERE.glob("bench_*.py")}
    assert benches - parts == {"all", "rivals", "setup"}
    assert parts <= benches


class Decaying:
    """A simulation whose joint goes to 0.1 m from where it belongs, exponentially in steps."""

    def __init__(self, rate: float) -> None:
        self.rate, self.steps = rate, 0

    def step(self, count: int) -> None:
        self.steps += count

    def joints(self) -> np.ndarray:
        return np.array([[0.1 + math.exp(-self.rate * self.steps), 0.0, 0.0]])


def test_settled_is_from_when_on_the_error_stays_near_its_last() -> None:
    found = rivals_common.settle(lambda: Decaying(0.05), lambda r: float(abs(r[0, 0])), 400, 1, 2)
    assert found is not None
    assert found.error == pytest.approx(0.1)
    assert found.steps == math.ceil(math.log(1.0 / 0.01) / 0.05)
    assert found.seconds > 0.0
    assert rivals_common.settle(lambda: Decaying(0.001), lambda r: float(abs(r[0, 0])), 400, 1, 2) is None
    assert rivals_common.settle(lambda: Decaying(-0.1), lambda r: float(abs(r[0, 0])), 400, 1, 2) is None


def test_of_the_settings_near_the_least_error_the_one_with_the_fewest_steps_is_taken() -> None:
    found = [
        None
        if error is None
        else evidence_rivals.Settling(evidence_rivals.Job("A", 10, {"step": k}), error, steps, 1.0)
        for k, (error, steps) in enumerate(((1.0, 50), (1.2, 20), (2.0, 5), (None, 1), (1.1, 30)))
    ]
    assert [settling.job.setting["step"] for settling in rivals_tune.ranked(found)] == [1, 4, 0]


def test_settings_are_kept_for_every_grasp_and_mesh() -> None:
    kept = evidence_rivals.settings()
    assert kept.keys() == evidence_rivals.JOINTS.keys() == evidence_rivals.WORKERS.keys()
    for simulator, meshes in evidence_rivals.JOINTS.items():
        for problem in GRASPS:
            by_joints = kept[simulator][problem]
            assert list(by_joints) == [str(joints) for joints in meshes]
            assert all(setting.keys() == rivals_tune.GRIDS[simulator].keys() for setting in by_joints.values())


def test_the_rivals_come_near_the_rod_or_are_told_to_be_missing(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    if evidence_rivals.python() is not None:
        found = evidence_rivals.measured(quick=True)
        assert found.keys() == GRASPS.keys()
        assert all(settling.error < 0.02 for series in found.values() for line in series.values() for settling in line)
        assert {len(series) for series in found.values()} == {2}
        figures = Figures()
        rivals_swing.print_swings(figures, quick=True)
        assert len(figures.rows) == 2
        rivals_laid.print_laid(figures, quick=True)
        assert figures.hold
    monkeypatch.setattr(evidence_rivals, "VENV", tmp_path)
    assert bench_rivals.main(["--quick"]) == 0
    assert "scripts/bench rivals --install" in capsys.readouterr().out


@pytest.mark.parametrize("name", rivals_laid.SCENES)
def test_cables_that_a_simulator_lays_beside_the_rod_touch_bodies_with_friction(name: str) -> None:
    scene = rivals_laid.SCENES[name]()
    _, last, _, lost = rivals_laid.rod(scene)
    assert lost == 0
    assert len({contact.body for contact in last.contacts}) == min(2, len(scene.bodies))
    assert any(contact.tangential_force.any() for contact in last.contacts)
    assert not last.frictionless
