"""Points that are matched and points of a detection: numbers just below and just above."""

import cv2
import numpy as np
import pytest

from camcal.detect import matches
from camcal.detect.targets import base
from tests.detect import drawing
from tests.detect.scenes import make


def spots(contrasts):
    """Spots of a picture, of these contrasts in parts of 255 grey levels."""
    v, u = np.mgrid[:120, : 80 * len(contrasts)]
    gray = np.full(u.shape, 100.0)
    for i, contrast in enumerate(contrasts):
        gray += 255 * contrast * np.exp(-np.square([u - 40 - 80 * i, v - 60]).sum(0) / (2 * 4.0**2))
    return gray.round().astype(np.uint8)


def test_the_contrast_of_points():
    """The default is that of cv2's SIFT: the same points are found, and with half of it weaker ones too."""
    picture = spots((0.05, 0.1, 0.2, 0.4))
    theirs = cv2.SIFT_create(enable_precise_upscale=True).detect(picture, None)
    ours = matches.points_of(picture).uv
    assert {tuple(uv) for uv in ours.round(3)} == {tuple(np.round(k.pt, 3)) for k in theirs}
    faint = [len(matches.points_of(picture, contrast=f * matches.LEAST_CONTRAST).uv) for f in (0.5, 1.0, 2.0)]
    assert faint[0] > faint[1] > faint[2] > 0


def test_descriptors_that_are_compared_at_a_time(monkeypatch):
    """Only memory depends on it."""
    a, b = np.random.default_rng(0).integers(0, 256, (2, 300, 128)).astype(np.float32)
    b[::3] = a[::3]
    usual = matches._nearest(a, b)
    assert (usual >= 0).sum() >= 100
    for count in (1, 7, 10**6):
        monkeypatch.setattr(matches, "AT_A_TIME", count)
        np.testing.assert_array_equal(matches._nearest(a, b), usual)


@pytest.mark.parametrize(("more", "found"), [(0, True), (-1, False)])
def test_the_least_points_of_a_detection(monkeypatch, more, found):
    """Of a board of markers of which so many corners are seen, not on a line."""
    target = make("charuco:8x6:1mm:0.5mm:4X4_50")
    h = drawing.homography((7, 5), (80, 60), 16)
    gray = drawing.light(h, (7, 5), (160, 120), blur=0.7).astype(np.uint8)
    uv = drawing.corners((7, 5), h)
    known = np.array([0, 1, 7, 8])[: base.LEAST_POINTS + more]
    jacobian = np.repeat(16 * np.eye(2)[None], len(known), 0)
    monkeypatch.setattr("camcal.detect.targets.tag_board.ROUNDS", 1)
    made = target.grown(gray, known, uv[known], jacobian, {})
    assert isinstance(made, base.Miss) != found
