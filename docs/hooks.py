"""For mkdocs: pages of the root, links that leave docs/ as what they are, roles as links."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files

ROOT = Path(__file__).resolve().parents[1]
sys.path.append(str(ROOT))
from cable_shape import _MODULES  # noqa: E402

#: files of the root that are pages of the site
PAGES = {"README.md": "index.md", "CHANGELOG.md": "changelog.md", "CONTRIBUTING.md": "contributing.md"}
EXAMPLE = re.compile(r"\(\.\./examples/(\w+\.py)\)")
_LINK = re.compile(r"(!?)\[([^\]]*)\]\(([^)\s]+)\)")
#: :class:`cable_shape.Cable` of a docstring, as the page has it
_ROLE = re.compile(r":(?:mod|class|func|meth|attr):<code>~?([\w.]+)</code>")
_CELL = re.compile(r"<td>.*?</td>", flags=re.DOTALL)


def on_files(files: Files, config: Any) -> Files:
    """Adds the pages of the root."""
    for name, page in PAGES.items():
        files.append(File.generated(config, page, content=rewritten((ROOT / name).read_text(encoding="utf-8"), ROOT)))
    return files


def on_page_markdown(markdown: str, page: Any, config: Any, files: Files) -> str:
    """Rewrites the links of the pages of docs/; the page of examples gets their text."""
    if page.file.src_path in PAGES.values():
        return markdown
    programs = EXAMPLE.findall(markdown) if page.file.src_path == "examples.md" else []
    texts = [f"\n## {name}\n\n```python\n{(ROOT / 'examples' / name).read_text('utf-8')}```\n" for name in programs]
    return rewritten(markdown, ROOT / "docs") + "".join(texts)


def on_page_content(html: str, page: Any, config: Any, files: Files) -> str:
    """Makes links of the roles in docstrings; no number in a table is broken at its exponent."""

    def link(match: re.Match[str]) -> str:
        name = match[1]
        package, _, export = name.rpartition(".")
        module = _MODULES.get(export) if package == "cable_shape" else None
        where = f"cable_shape.{module}.{export}" if module else name
        return f'<autoref optional identifier="{where}"><code>{export}</code></autoref>'

    html = _ROLE.sub(link, html)
    return _CELL.sub(lambda cell: re.sub(r"(\de)-(\d)", "\\1\u2011\\2", cell[0]), html)


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
                return f"`{place}`" if words.strip("`") in (path, place.as_posix()) else f"{words} (`{place}`)"
            name = place.relative_to("docs").as_posix()
        words = place.stem if words == path else words
        return f"{picture}[{words}]({name}{hash_mark}{part})"

    return _LINK.sub(link, text)
