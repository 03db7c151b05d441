from pathlib import Path

import pytest

from camcal.data.formats.page import MARK, page, refit_table

PAGE = Path(__file__).resolve().parents[3] / "docs" / "formats.md"


def measured():
    return PAGE.read_text(encoding="utf-8").split(MARK)[1].lstrip("\n")


def test_the_page_is_current():
    """Renew it with `python -m camcal.data.formats.page > docs/formats.md`."""
    assert PAGE.read_text(encoding="utf-8") == page(measured())


@pytest.mark.slow
def test_the_refits_are_current():
    """Within 20 %: the least squares end where rounding lets them."""
    for ours, theirs in zip(refit_table().splitlines(), measured().splitlines(), strict=True):
        for a, b in zip(ours.split("|"), theirs.split("|"), strict=True):
            try:
                assert abs(float(a) - float(b)) <= 0.2 * float(b)
            except ValueError:
                assert a == b
