"""For mkdocs: README.md and CHANGELOG.md as pages of the site, and links that leave docs/ as what they are."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files

ROOT = Path(__file__).resolve().parent.parent
#: files of the root that are pages of the site
PAGES = {"README.md": "index.md", "CHANGELOG.md": "changelog.md"}
_LINK = re.compile(r"(!?)\[([^\]]*)\]\(([^)\s]+)\)")


def on_files(files: Files, config: Any) -> Files:
    """Adds the pages of the root."""
    for name, page in PAGES.items():
        files.append(File.generated(config, page, content=rewritten((ROOT / name).read_text(encoding="utf-8"), ROOT)))
    return files


def on_page_markdown(markdown: str, page: Any, config: Any, files: Files) -> str:
    """Rewrites the links of the pages of docs/."""
    return markdown if page.file.src_path in PAGES.values() else rewritten(markdown, ROOT / "docs")


def rewritten(text: str, folder: Path) -> str:
    """`text` of a file in `folder` with links as the site has them; a file that is no page is named, not linked."""

    def link(match: re.Match[str]) -> str:
        picture, words, target = match.groups()
        path, hash_mark, part = target.partition("#")
        if not path or "://" in path:
            return match[0]
        place = (folder / path).resolve().relative_to(ROOT)
        name = PAGES.get(place.as_posix())
        if name is None:
            if place.parts[0] != "docs":
                return f"`{place}`" if words.strip("`") == path else f"{words} (`{place}`)"
            name = place.relative_to("docs").as_posix()
        words = words.removeprefix("docs/") if words == path else words
        return f"{picture}[{words}]({name}{hash_mark}{part})"

    return _LINK.sub(link, text)
