"""The area of a picture."""

import numpy as np
import pytest

from camcal.geometry.picture import in_picture


@pytest.mark.parametrize(
    ("u", "v", "inside"),
    [
        (-0.5, -0.5, True),  # the outer corner of the first pixel
        (639.5, 479.5, True),
        (np.nextafter(-0.5, -1), 0, False),
        (np.nextafter(639.5, 640), 0, False),
        (0, np.nextafter(479.5, 480), False),
        (np.nan, 0, False),
        (np.inf, 0, False),
    ],
)
def test_the_border_belongs_to_the_picture(u, v, inside):
    assert in_picture(np.array([u, v]), (640, 480)) == inside


def test_a_margin_makes_the_area_smaller_and_a_negative_one_larger():
    uv = np.array([[9.4, 20], [9.5, 20], [-10.5, 20], [-10.6, 20]])
    assert in_picture(uv, (640, 480), 10.0).tolist() == [False, True, False, False]
    assert in_picture(uv, (640, 480), -10.0).tolist() == [True, True, True, False]
    assert in_picture(uv, (640, 480), np.array([9.9, 30.0])).tolist() == [False] * 4
