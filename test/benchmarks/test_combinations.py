"""What goes together with what, cell by cell, and that docs/limits.md says so."""

from __future__ import annotations

import pytest
from bench_combinations import ASKED, BEGIN, END, ROOT, WHERE, cell, table

PAGE = (ROOT / "docs" / "limits.md").read_text(encoding="utf-8").partition(BEGIN)[2].partition(END)[0]
ROWS = {row.split(" | ")[0].removeprefix("| "): row.split(" | ")[1:] for row in PAGE.splitlines() if row[:1] == "|"}


@pytest.mark.parametrize("where", WHERE)
@pytest.mark.parametrize("what", ASKED)
def test_each_cell_is_as_the_page_says(what: str, where: str) -> None:
    told = ROWS[what][list(WHERE).index(where)].removesuffix(" |")
    found = cell(what, where)
    assert not found.startswith("NO"), found
    assert (told == "yes") is (found == "yes"), found
    assert found == "yes" or found in PAGE


def test_a_wrong_answer_is_no(monkeypatch: pytest.MonkeyPatch) -> None:
    def wrong(around: object) -> None:
        raise AssertionError("off by 0.1")

    monkeypatch.setitem(ASKED, "tube", wrong)  # type: ignore[arg-type]
    cells = {(what, where): "yes" for what in ASKED for where in WHERE} | {("tube", "plain"): cell("tube", "plain")}
    assert "| tube | no (1) | yes" in table(cells)
    assert "1. NO: off by 0.1" in table(cells)
