"""What the doctor calls exact, and a codec's loss, each just below and just above."""

from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from camcal.report.doctor import installation
from tests.sides import LESS, MORE


@pytest.mark.parametrize(("share", "status"), [(LESS, "ok"), (MORE, "wrong")])
def test_residuals_of_exact_points(monkeypatch, share, status):
    solution = SimpleNamespace(residuals=[np.array([[0.0, -share * installation.EXACT_PX]])], crosscheck=[])
    monkeypatch.setattr("camcal.plan.calibrate.calibrate", lambda *_, **__: solution)
    (check,) = installation._calibration()
    assert check.status == status


@pytest.mark.parametrize(("off", "status"), [(installation.LOSSY - 1, "ok"), (installation.LOSSY, "note")])
def test_what_a_codec_may_lose(monkeypatch, off, status):
    gray = (np.add.outer(np.arange(32), np.arange(48)) * 3).astype(np.uint8)
    back = gray.copy()
    back[0, 0] = off
    monkeypatch.setattr(cv2, "imdecode", lambda *_: back)
    (check,) = installation._pictures()
    assert check.status == status
