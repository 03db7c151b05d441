from pathlib import Path

import pytest

from camcal.data.formats import files
from camcal.data.formats.page import FIGURES, MARK, page, refit_table
from camcal.data.point_files import POINT_FILES

PAGE = Path(__file__).resolve().parents[3] / "docs" / "formats.md"


def measured():
    return PAGE.read_text(encoding="utf-8").split(MARK)[1].lstrip("\n")


def test_the_page_is_current():
    """Renew it with `python -m camcal.data.formats.page > docs/formats.md`."""
    assert PAGE.read_text(encoding="utf-8") == page(measured())


@pytest.mark.parametrize("name", ["conversions", "damaged-files"])
def test_the_measured_tables_have_every_format(name):
    """A new format is measured: `python -m benchmarks.NAME > docs/figures/NAME.txt`."""
    text = (FIGURES / f"{name}.txt").read_text(encoding="utf-8")
    found = {line.split("`")[1].partition(".")[0] for line in text.splitlines() if line.startswith("| `")}
    assert found == {f.name for f in files.formats() if f.write is not None or name == "conversions"}
    if name == "damaged-files":
        points = {line.split("`")[1] for line in text.splitlines() if line.startswith("| points")}
        assert points == set(POINT_FILES)


def test_nothing_let_another_error_out():
    rows = (FIGURES / "damaged-files.txt").read_text(encoding="utf-8").splitlines()[2:]
    assert {row.split("|")[5].strip() for row in rows} == {"0"}
    assert {row.split("|")[2].strip() for row in rows} == {"10,000"}


@pytest.mark.slow
def test_the_refits_are_current():
    """Within 20 %: the least squares end where rounding lets them."""
    for ours, theirs in zip(refit_table().splitlines(), measured().splitlines(), strict=True):
        for a, b in zip(ours.split("|"), theirs.split("|"), strict=True):
            try:
                assert abs(float(a) - float(b)) <= 0.2 * float(b)
            except ValueError:
                assert a == b
