"""The Python code of docs/lenses.md runs, and does what the page says."""

import re
from pathlib import Path

import cv2
import numpy as np

PAGE = Path(__file__).resolve().parents[2] / "docs" / "lenses.md"


def test_in_python():
    first, second = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.S)
    names = {}
    exec(first, names)
    np.testing.assert_allclose(names["rays"] / names["rays"][:, 2:], [[0.1, -0.2, 1.0]], rtol=0, atol=1e-12)
    zero = np.zeros(3)
    seen = cv2.projectPoints(np.array([[0.1, -0.2, 1.0]]), zero, zero, names["K"], names["distortion"])[0]
    np.testing.assert_allclose(seen.reshape(1, 2), names["uv"], rtol=0, atol=1e-9)
    exec(second, names)
    np.testing.assert_allclose(names["same"].project(names["rays"]), names["uv"], rtol=0, atol=1e-9)
    assert names["same"].lens.name == "opencv8"
