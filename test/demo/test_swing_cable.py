"""The demo of a cable that is moved fast, as usual and shaped, and its recording."""

from __future__ import annotations

from pathlib import Path

import pytest
import swing_cable
from reports import columns


def test_the_shaped_way_hardly_swings_and_the_other_is_warned_of_before_it_stops(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "new" / "swing.rrd"
    assert swing_cable.main(["--swing", str(out)]) == 0
    said = capsys.readouterr().out
    assert "trapezoid: swings on when the grips stop" in said
    assert float(said.split("after ")[1].split(" s")[0]) < swing_cable.DURATION
    held = columns(out)
    for name in ("trapezoid", "shaped"):
        assert len(held[f"/world/cables/{name}/trail:LineStrips3D:strips"]) > 100
