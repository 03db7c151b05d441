"""Which target it is, from rendered pictures of each kind and from the real ones."""

import cv2
import numpy as np
import pytest

from camcal.detect import targets
from camcal.detect.recognise import recognise
from tests.detect.scenes import make, picture, random_view
from tests.shared_data import DATA, needs_data

#: what is shown, and what must be said of it: no picture tells a length
SHOWN = {
    "checkerboard:9x6:25mm": "checkerboard:9x6",
    "charuco:9x7:40mm:20mm:4X4_100": "charuco:9x7:1:0.5:4X4_50",  # its 31 markers are in the smaller one, too
    "charuco:6x8:30mm:24mm:5X5_250:legacy": "charuco:6x8:1:0.8:5X5_50:legacy",
    "charuco:5x7:30mm:22.5mm:APRILTAG_36h11": "charuco:5x7:1:0.75:APRILTAG_36h11",
    "aprilgrid:6x6:22mm:0.3": "aprilgrid:6x6:1:0.3",
    "aprilgrid:4x5:30mm:0.25:family=t25h9:border=1": "aprilgrid:4x5:1:0.25:family=APRILTAG_25h9:border=1",
    "circles:10x8:2.5mm": "circles:10x8",
    "asymmetric-circles:4x11:20mm": "asymmetric-circles:4x11",
}


@pytest.mark.parametrize("shown", SHOWN)
def test_rendered(shown):
    target, rng = make(shown), np.random.default_rng(1)

    def pictures():
        for _ in range(3):
            seen_by, pose = random_view(target, rng, size=(1000, 750), tilt=(5.0, 30.0))
            yield picture(target, seen_by, pose, rng, blur=0.7, noise=1.5, gradient=0.2)

    said = recognise(pictures())
    assert said == SHOWN[shown]
    made = targets.make(said)
    assert (made.kind, made.columns, made.rows) == (target.kind, target.columns, target.rows)


def test_nothing():
    rng = np.random.default_rng(0)
    assert recognise([]) is None
    assert recognise([rng.integers(0, 256, (200, 300), np.uint8), np.zeros((100, 100), np.uint8)]) is None


REAL = {
    "charuco/*.jpg": "charuco:9x7:1:0.5:4X4_50",
    "aprilgrid/*.jpg": "aprilgrid:6x6:1:0.3",
    "circles/*.jpg": "circles:10x8",
    "circles_asymmetric/acircles[123].png": "asymmetric-circles:7x13",
    "opencv_left/*.jpg": "checkerboard:9x6",
    "stereo/*": "checkerboard:6x4",
    "no_board/*": None,
}


@needs_data
@pytest.mark.parametrize("place", REAL)
def test_real(place):
    paths = [p for p in sorted(DATA.glob(place)) if p.suffix in (".jpg", ".png", ".tif")]
    assert paths
    assert recognise(cv2.imread(str(p), cv2.IMREAD_GRAYSCALE) for p in paths) == REAL[place]
