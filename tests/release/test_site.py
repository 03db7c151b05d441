"""The docs site: every page is in its navigation, and mkdocs builds it without a warning."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[2]


def pages(nav):
    for entry in nav:
        for value in entry.values() if isinstance(entry, dict) else [entry]:
            yield from pages(value) if isinstance(value, list) else [value]


def test_every_page_is_in_the_navigation():
    listed = list(pages(yaml.safe_load((ROOT / "mkdocs.yml").read_text(encoding="utf-8"))["nav"]))
    docs = {p.relative_to(ROOT / "docs").as_posix() for p in (ROOT / "docs").rglob("*.md")}
    assert len(listed) == len(set(listed))
    assert docs <= set(listed), docs - set(listed)
    assert set(listed) - docs == {
        "readme.md",
        "changelog.md",
        "contributing.md",
        "reporting-vulnerabilities.md",
    }


@pytest.mark.slow
def test_the_site_is_built_without_a_warning(tmp_path):
    pytest.importorskip("mkdocs")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "-d", str(tmp_path / "site")]
    env = {**os.environ, "NO_MKDOCS_2_WARNING": "1"}  # the theme's word on its successor
    done = subprocess.run(command, cwd=ROOT, env=env, capture_output=True, text=True)
    assert done.returncode == 0 and "WARNING" not in done.stderr, done.stderr
    text = (tmp_path / "site" / "readme" / "index.html").read_text(encoding="utf-8")
    assert 'href="../configuration/"' in text  # a link of the README leads to a page of the site
    assert (tmp_path / "site" / "tutorials" / "stereo" / "index.html").exists()
