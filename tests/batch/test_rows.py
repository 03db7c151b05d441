"""Rows as they are kept."""

import numpy as np
import pytest

from camcal.batch.rows import Rows, packed, unpacked

DONE = {"name": "a", "status": "done", "focal": 800.25, "parts": {"left": {"cx": None}}, "views": 3}
FAILED = {"name": "ä", "status": "failed", "reason": "no such file"}


def test_a_row_comes_back_as_it_was():
    for row in (DONE, FAILED, {**DONE, "focal": float("inf")}):
        assert unpacked(packed(row)) == row and list(unpacked(packed(row))) == list(row)
    assert np.isnan(unpacked(packed({"rms_point": float("nan")}))["rms_point"])
    assert unpacked(packed({"focal": np.float64(0.1)})) == {"focal": 0.1}


def test_rows_are_a_sequence():
    rows = Rows.of(iter([DONE, FAILED, DONE]))
    assert len(rows) == 3 and rows[1] == FAILED and rows[-1]["name"] == "a"
    assert list(rows[:2]) == [DONE, FAILED] and rows == [DONE, FAILED, DONE] and rows != [DONE]


def test_a_row_is_small():
    """A dict with as many values has 2 kB."""
    row = {f"column{i}": 0.1 * i for i in range(20)} | {"name": "c000001", "digest": 16 * "0"}
    assert len(packed(row)) == pytest.approx(220, abs=20)
