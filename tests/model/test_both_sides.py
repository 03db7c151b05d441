"""Numbers that decide something about boards, cameras and conversions, each just below and just above."""

import numpy as np
import pytest

from camcal.errors import EstimationError
from camcal.model import board, camera, lenses
from camcal.model.camera import Camera
from camcal.model.lenses import conversion


def test_a_board_that_is_flat():
    xyz = np.array([[x, y, 0.0] for y in range(4) for x in range(4)])
    signs = np.where((xyz[:, 0] + xyz[:, 1]) % 2, 1.0, -1.0)
    extent = np.linalg.norm(np.ptp(xyz, axis=0))
    for share, planar in ((0.98, True), (1.02, False)):
        bent = xyz + np.outer(signs * share * board.PLANAR * extent, [0, 0, 1])
        assert board.Board(bent).planar == planar


def test_parameters_in_a_line():
    for name, rest in (("opencv8", False), ("opencv12", True)):
        lens = lenses.make(name)
        assert (lens.size > camera.SHOWN) == rest
        assert ("more" in repr(Camera(lens, lens.examples()[0][0]))) == rest


def test_coefficients_for_cv2():
    """cv2 takes 4, 5, 8, 12 or 14."""
    for name, count in (("pinhole", 4), ("opencv4", 4), ("opencv5", 5)):
        lens = lenses.make(name)
        assert len(Camera(lens, lens.examples()[0][0]).opencv()[1]) == count


def test_pixels_that_have_a_ray(monkeypatch):
    lens = lenses.make("pinhole")
    one = Camera(lens, np.array([500.0, 500, 320, 240]), (640, 480))
    unproject = type(lens).unproject
    for count, converted in ((conversion.LEAST_PIXELS, True), (conversion.LEAST_PIXELS - 1, False)):

        def few(self, params, pixels, n=count):
            rays, valid = unproject(self, params, pixels)
            chosen = np.zeros(len(valid), bool)
            chosen[np.linspace(0, len(valid) - 1, n).astype(int)] = True
            return rays, valid & chosen

        monkeypatch.setattr(type(lens), "unproject", few)
        if converted:
            assert conversion.convert(one, lens).camera.params == pytest.approx(one.params)
        else:
            with pytest.raises(EstimationError, match="have a ray"):
                conversion.convert(one, lens)
