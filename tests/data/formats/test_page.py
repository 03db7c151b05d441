from pathlib import Path

from camcal.data.formats.page import page

ROOT = Path(__file__).resolve().parents[3]


def test_the_page_is_current():
    """Renew it with `python -m camcal.data.formats.page > docs/formats.md`."""
    assert (ROOT / "docs" / "formats.md").read_text(encoding="utf-8") == page()
