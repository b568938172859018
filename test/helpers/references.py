"""Reference shapes: those of test/references, and those of ../shared/cases where the repository lies beside them."""

from __future__ import annotations

from pathlib import Path

OWN = Path(__file__).parents[1] / "references"
SHARED = Path(__file__).parents[3] / "shared" / "cases"


def references(pattern: str, folder: str = "public") -> list[Path]:
    """Files whose names match the pattern, of this repository and of a folder of the shared ones."""
    return [*sorted(OWN.glob(f"{pattern}.json")), *sorted((SHARED / folder).glob(f"{pattern}.json"))]


def named(*names: str) -> list[Path]:
    """Of these files, FOLDER/NAME, those that are here: all of folder references, and others as in ../shared/cases."""
    return [
        path
        for name in names
        if (path := (OWN.parent if name.startswith("references/") else SHARED) / f"{name}.json").exists()
    ]


def label(path: Path) -> str:
    return f"{path.parent.name}/{path.stem}"
