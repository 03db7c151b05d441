"""The table for people: everything that matters is there, within 80 columns."""

from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

from camcal.assess.warning import CalibrationWarning
from camcal.data.observations import SkippedView
from camcal.report.document import document
from camcal.report.table import number, summary, tables, with_sigma
from camcal.solve.calibration import Stage
from tests.solved import solved


def shown(*renderables, width=80):
    console = Console(width=width, no_color=True)
    with console.capture() as capture:
        for r in renderables:
            console.print(r)
    return capture.get()


@pytest.fixture(scope="module")
def report():
    s = solved(views=30, fix={"k3": 0.0})
    skipped = (
        SkippedView("a_long_name_of_a_picture_in_a_folder_20260101.jpg", "not_found", "a board of 8x6"),
    )
    entry = {
        "stage": "refine",
        "against": "cv2.calibrateCamera",
        "status": "not_applicable",
        "why": "cv2 has no skew " * 8,
    }
    return document(
        replace(
            s,
            observations=replace(s.observations, skipped=skipped),
            stages=(Stage("zhang", 1.25, s.camera.matrix, 0.001), Stage("central", 2.0, None, 0.001)),
            warnings=(CalibrationWarning("few-views", "three views [are] few " * 6, "take more"),),
            crosscheck=(entry, entry | {"status": "pass", "why": None}),
        ),
        failures=["rms_point too large"],
    )


def test_all_of_it_fits_into_80_columns(report):
    text = shown(tables(report), summary(report))
    assert max(map(len, text.splitlines())) <= 80


def test_what_matters_is_there(report):
    text = shown(tables(report), summary(report))
    for word in ("fx", "fixed", "sigma_hat", "zhang", "cv2.calibrateCamera", "not applicable", "few-views"):
        assert word in text
    assert "[are]" in text  # nothing is taken for markup
    assert "not found: a board of 8x6" in text and "30 of 31 used" in text
    assert "take more" in text and "FAIL" in text and "rms_point too large" in text


@pytest.mark.parametrize(
    ("value", "sigma", "shown"),
    [
        (536.0712, 0.2134, ("536.07", "0.21")),
        (-0.22860123, 0.00123, ("-0.2286", "0.0012")),
        (832.5, 12.3, ("832", "12")),
        (832.5, float("inf"), ("832.5", "undetermined")),
        (0.0, None, ("0", "")),
        (1e6, 1e7, ("1000000", "10000000")),
        (0.1, float("nan"), ("0.1", "-")),
    ],
)
def test_values_are_written_to_the_digits_they_have(value, sigma, shown):
    assert with_sigma(value, sigma) == shown


def test_numbers():
    assert [number(x) for x in (None, np.nan, 0.0, 0.29, 1234.5678, 1e-7)] == [
        "-",
        "-",
        "0",
        "0.2900",
        "1235",
        "1.000e-07",
    ]
