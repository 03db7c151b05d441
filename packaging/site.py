"""Hooks of the docs site (mkdocs.yml): pages of the repository that lie outside of docs/, and links to its files."""

from __future__ import annotations

import posixpath
import re
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files

ROOT = Path(__file__).resolve().parents[1]
#: page of the site -> file of the repository
PAGES = {
    "readme.md": "README.md",
    "changelog.md": "CHANGELOG.md",
    "contributing.md": "CONTRIBUTING.md",
    "reporting-vulnerabilities.md": "SECURITY.md",
}
_LINK = re.compile(r"\[([^\]]*)\]\(([^)#:\s]+)(#[^)]*)?\)")


def on_files(files: Files, config: Any) -> Files:
    """Add the pages of `PAGES`."""
    for page, source in PAGES.items():
        text = (ROOT / source).read_text(encoding="utf-8")
        files.append(File.generated(config, page, content=text))
    return files


def on_page_markdown(markdown: str, page: Any, config: Any, files: Files) -> str:
    """Lead links to pages of the site; name the file where there is none."""
    uri = page.file.src_uri
    origin = PAGES.get(uri, f"docs/{uri}")
    site = {source: target for target, source in PAGES.items()}

    def link(found: re.Match[str]) -> str:
        words, target, anchor = found[1], found[2], found[3] or ""
        path = posixpath.normpath(posixpath.join(posixpath.dirname(origin), target))
        inside = site.get(path) or (path.removeprefix("docs/") if path.startswith("docs/") else None)
        if inside is None:
            return f"{words} (`{path}`)" if path not in words else f"`{path}`"
        return f"[{words}]({posixpath.relpath(inside, posixpath.dirname(uri) or '.')}{anchor})"

    return _LINK.sub(link, markdown)
