"""Each test that a corner must pass, from both sides of its limit."""

import numpy as np
import pytest

from camcal.detect import corners
from camcal.detect import edge_model as model
from camcal.detect.corners import edge_normals
from camcal.detect.fit import Fits
from camcal.detect.windows import Windows
from tests.sides import LESS, MORE

COUNT, SIDE, HALF = 9, 20.0, 0.4


def reason(change):
    """What is said of the last of nine corners once `change(params, covariance, noise, converged, inside)` is made."""
    sides = np.broadcast_to(SIDE * np.eye(2), (COUNT, 2, 2))
    params = np.zeros((COUNT, model.COUNT))
    params[:, model.ANGLE1 : model.ANGLE2 + 1] = edge_normals(sides)
    params[:, [model.OFFSET, model.CONTRAST, model.BLUR]] = 120, 60, 1
    covariance = np.broadcast_to(1e-4 * np.eye(2), (COUNT, 2, 2)).copy()
    noise, converged, inside = np.full(COUNT, 0.1), np.ones(COUNT, bool), np.ones(COUNT)
    change(params, covariance, noise, converged, inside)
    windows = Windows(np.zeros((COUNT, 2)), *(np.zeros((COUNT, 1)) for _ in range(3)), inside)
    found = corners.tested(windows, Fits(params, covariance, noise, converged), sides, HALF, 255.0)
    assert not any(found.reasons[:-1])
    return found.reasons[-1]


def sets(which, column, value):
    def change(*arrays):
        arrays[which][-1, column] = value

    return change


def turned(angle):
    def change(params, *_):
        params[-1, model.ANGLE1] += angle

    return change


def scaled(which, value):
    def change(*arrays):
        arrays[which][-1] = value

    return change


@pytest.mark.parametrize(
    ("word", "inside", "outside"),
    [
        ("border", scaled(4, MORE * corners.LEAST_INSIDE), scaled(4, LESS * corners.LEAST_INSIDE)),
        (
            "contrast",
            sets(0, model.CONTRAST, -MORE * corners.LEAST_CONTRAST),
            sets(0, model.CONTRAST, -LESS * corners.LEAST_CONTRAST),
        ),
        (
            "blurred",
            sets(0, model.BLUR, LESS * corners.MOST_BLUR * SIDE),
            sets(0, model.BLUR, MORE * corners.MOST_BLUR * SIDE),
        ),
        (
            "neighbours",
            sets(0, model.DX, LESS * corners.MOST_SHIFT * HALF * SIDE),
            sets(0, model.DX, MORE * corners.MOST_SHIFT * HALF * SIDE),
        ),
        (
            "follow",
            turned(LESS * corners.MOST_TURN),
            turned(MORE * corners.MOST_TURN),
        ),
        (
            "like a corner",
            scaled(2, 60 * LESS * corners.MOST_MISFIT),
            scaled(2, 60 * MORE * corners.MOST_MISFIT),
        ),
        (
            "uncertain",
            scaled(1, (LESS * corners.MOST_SIGMA) ** 2 * np.eye(2)),
            scaled(1, (MORE * corners.MOST_SIGMA) ** 2 * np.eye(2)),
        ),
        ("uncertain", lambda *_: None, scaled(3, False)),
        ("uncertain", lambda *_: None, scaled(1, np.nan)),
    ],
)
def test_limits(word, inside, outside):
    assert reason(inside) == "" and word in reason(outside)


def test_a_noisy_picture_is_judged_by_its_own_noise():
    def noisy(last):
        def change(params, covariance, noise, *_):
            noise[:] = 20.0
            noise[-1] = last

        return change

    assert reason(noisy(20 * LESS * corners.RARE)) == ""
    assert "like a corner" in reason(noisy(20 * MORE * corners.RARE))


def test_small_windows_may_move_by_a_pixel_and_a_half():
    sides = np.broadcast_to(4.0 * np.eye(2), (1, 2, 2))
    for shift, good in ((LESS * corners.START_ERROR, True), (MORE * corners.START_ERROR, False)):
        params = np.array([[shift, 0, *edge_normals(sides)[0], 120, 60, 0.5]])
        windows = Windows(np.zeros((1, 2)), *(np.zeros((1, 1)) for _ in range(3)), np.ones(1))
        fits = Fits(params, 1e-4 * np.eye(2)[None], np.ones(1), np.ones(1, bool))
        assert corners.tested(windows, fits, sides, HALF, 255.0).good[0] == good
