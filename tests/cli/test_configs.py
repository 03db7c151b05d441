"""The ready configurations load, and hold only what their commands know."""

from pathlib import Path

import pytest

FOLDER = Path(__file__).resolve().parents[2] / "configs"
FILES = sorted(FOLDER.glob("*.yaml"))


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_loads(resolved, path):
    assert any(entry["from"] == "file" for entry in resolved("--config", path).values())


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_is_documented(path):
    docs = FOLDER.parent / "docs"
    pages = [FOLDER.parent / "README.md", *docs.glob("*.md")]
    assert any(f"configs/{path.name}" in page.read_text(encoding="utf-8") for page in pages)


def test_values_of_the_gate(resolved):
    found = resolved("--config", FOLDER / "ci-gate.yaml")
    assert found["max_rms"]["from"] == "file"
    assert found["crosscheck"] == {"value": "full", "from": "file"}
