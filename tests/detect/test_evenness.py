"""Grids that chance makes of text are told from boards by how evenly their points stand and how well corners fit."""

import importlib
from pathlib import Path

import numpy as np
import pytest

from camcal.detect.evenness import BLOCK, unevenness
from camcal.detect.targets.base import Detection, Miss
from camcal.detect.targets.checkerboard import UNEVEN, UNLIKE, Checkerboard, by_chance, find_any
from camcal.geometry import homography
from tests.detect import drawing

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"
PLANE = np.array([[30.0, 4, 100], [-3, 25, 80], [0.01, 0.02, 1]])


def grid(columns=5, rows=3):
    x = np.stack(np.meshgrid(np.arange(float(columns)), np.arange(float(rows))), -1).reshape(1, -1, 2)
    return homography.transfer(PLANE[None], x)[0].reshape(rows, columns, 2)


def test_the_picture_of_a_plane_is_even_also_with_gaps():
    assert unevenness(grid()) < 1e-6
    uv = grid()
    uv[1, 2] = np.nan
    assert unevenness(uv) < 1e-6
    uv[:, 1:] = np.nan
    assert unevenness(uv) == 0.0  # nothing to judge
    rough = np.random.default_rng(0).normal(0, 1, (9, 9, 2)) + grid(9, 9)
    for rows, known in ((BLOCK, True), (BLOCK - 1, False)):
        assert (unevenness(rough[:rows]) > 0) == (unevenness(rough[:, :rows]) > 0) == known


def test_a_board_of_two_rows_in_a_noisy_picture():
    h = drawing.homography((9, 2), (200, 100), 20)
    gray = drawing.light(h, (9, 2), (400, 200), blur=0.8) + np.random.default_rng(0).normal(0, 50, (200, 400))
    found = Checkerboard(9, 2).find(np.clip(gray, 0, 255).astype(np.uint8))
    assert not isinstance(found, Miss) and found.info["noise"] > UNLIKE * found.info["contrast"]


@pytest.mark.parametrize("share", [0.03, 0.15])
def test_unevenness_is_the_scatter_of_the_points_in_steps(share):
    rng = np.random.default_rng(0)
    uv = grid(12, 9)
    step = np.linalg.norm(np.diff(uv, axis=1), axis=-1).mean()
    found = unevenness(uv + rng.normal(0, share * step, uv.shape))
    assert 0.7 * share < found < 1.4 * share


@pytest.mark.parametrize(
    ("uneven", "unlike", "chance"), [(1.3, 1.2, True), (0.7, 1.2, False), (1.3, 0.8, False)]
)
def test_both_must_speak_for_chance(uneven, unlike, chance):
    rng = np.random.default_rng(1)
    uv = grid()
    noise = rng.normal(size=uv.shape)
    low, high = 0.0, 30.0
    for _ in range(40):  # the scale for which the grid is as uneven as wanted
        middle = 0.5 * (low + high)
        low, high = (middle, high) if unevenness(uv + middle * noise) < uneven * UNEVEN else (low, middle)
    info = {"noise": unlike * UNLIKE * 50.0, "contrast": 50.0}
    found = Detection(np.arange(15), (uv + low * noise).reshape(-1, 2), np.full(15, 0.1), info)
    assert by_chance(found, 5, 3) is chance


def test_a_page_of_small_text_is_no_board(monkeypatch):
    monkeypatch.syspath_prepend(BENCHMARKS)
    false_alarms = importlib.import_module("false_alarms")
    rng = np.random.default_rng(142)  # was a board of 5x3 corners, 7 px to a square
    gray = false_alarms.photographed(false_alarms.text(rng), rng)
    assert isinstance(find_any(gray), Miss)
    assert isinstance(Checkerboard(5, 3).find(gray), Miss)


def test_a_noisy_blurred_board_is_still_one():
    h = drawing.homography((5, 4), (160, 120), 30.0, 0.3, 0.6, 1.0)
    gray = drawing.picture(h, (5, 4), (320, 240), noise=45.0)
    assert isinstance(Checkerboard(5, 4).find(gray), Detection)
