"""Published results, as far as the closed forms produce them."""

import csv

import numpy as np

from camcal.data.observations import Correspondences, View
from camcal.geometry import projective
from camcal.start import central, dlt
from tests.shared_data import DATA, needs_data

A = np.array([[657.3025, 0.2761, 302.7166], [0, 657.7439, 242.3339], [0, 0, 1]])


def single_view(path):
    with path.open(newline="") as handle:
        rows = list(csv.DictReader(line for line in handle if not line.startswith("#")))
    values = np.array([[float(row[k]) for k in "XYZuv"] for row in rows])
    return Correspondences.from_views((View("1", values[:, :3], values[:, 3:]),))


@needs_data
def test_barranco_medel_section_5():
    found = central.estimate(single_view(DATA / "barranco_medel" / "points.csv"), skew=True)
    # printed: 1e3 x (.4991 .0002 .2298 1.9177); half of the last printed digit is 0.05
    np.testing.assert_allclose(found.projection_matrix[0], [499.1, 0.2, 229.8, 1917.7], rtol=0, atol=0.05)
    # the A the points were made with; C's condition number of 2e6 costs 6 of the 16 digits
    np.testing.assert_allclose(found.matrix, A, rtol=0, atol=1e-7)
    assert 1.95e6 < found.info["condition"] < 2.05e6


@needs_data
def test_barranco_medel_image_points():
    """The image points of section 5 are those of whole-number points of the camera's frame."""
    view = single_view(DATA / "barranco_medel" / "points.csv").views[0]
    cam = np.array([[4, 4, 8], [4, 35, 6], [52, 57, 9], [25, 13, 11], [8, 24, 12], [4, 43, 8], [7, 3, 8.0]])
    uv = projective.project(np.c_[A, np.zeros(3)], cam)
    np.testing.assert_allclose(view.uv, uv, rtol=1e-14)
    # 5 printed decimals of t: half of the last digit
    np.testing.assert_allclose(view.xyz + [3.2360, 0, 1.31706], cam, rtol=0, atol=5e-5)


@needs_data
def test_course_matrix():
    found = dlt.estimate(single_view(DATA / "cs6476" / "pic_a_norm.csv"), skew=True)
    course = -np.array(
        [
            [-0.4583, 0.2947, 0.0139, -0.0040],
            [0.0509, 0.0546, 0.5410, 0.0524],
            [-0.1090, -0.1784, 0.0443, -0.5968],
        ]
    )
    m = found.projection_matrix / np.linalg.norm(found.projection_matrix)
    # one unit of the last printed digit: points clicked by hand, and the course's normalisation is unknown
    np.testing.assert_allclose(m, course, rtol=0, atol=1.0e-4)
