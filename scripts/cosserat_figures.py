"""The figures of a bench beside what was asked of them, for the table at its end."""

from __future__ import annotations


def heading(text: str) -> None:
    """A line above a table."""
    print(f"\n## {text}", flush=True)


class Figures:
    """Rows of the last table: figure, asked, measured, and whether it holds."""

    def __init__(self) -> None:
        self.rows: list[tuple[str, str, str, bool]] = []

    def at_most(self, figure: str, measured: float, bound: float, form: str = "{:.1e}", unit: str = "") -> None:
        """Asks for `measured <= bound`; prints both and keeps them."""
        self._add(figure, measured <= bound, "at most " + form.format(bound) + unit, form.format(measured) + unit)

    def at_least(self, figure: str, measured: float, bound: float, form: str = "{:.1f}", unit: str = "") -> None:
        """Asks for `measured >= bound`; prints both and keeps them."""
        self._add(figure, measured >= bound, "at least " + form.format(bound) + unit, form.format(measured) + unit)

    def _add(self, figure: str, holds: bool, asked: str, measured: str) -> None:
        print(f"{figure}: {measured} (asked {asked})", flush=True)
        self.rows.append((figure, asked, measured, holds))

    def print_summary(self) -> None:
        """The last table."""
        heading("Summary")
        print(f"{'figure':66} {'asked':18} {'measured':16} holds?")
        for figure, asked, measured, holds in self.rows:
            print(f"{figure:66} {asked:18} {measured:16} {'yes' if holds else 'NO'}")
