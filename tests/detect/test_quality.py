import cv2
import numpy as np
import pytest

from camcal.detect import motion_blur
from camcal.detect.motion_blur import blur_ellipse
from camcal.detect.quality import coverage, measure
from camcal.detect.targets.base import Detection
from camcal.detect.targets.checkerboard import Checkerboard
from tests.detect import drawing


def figures(gray):
    found = Checkerboard(6, 5).find(gray)
    assert isinstance(found, Detection), found
    return measure(gray, found)


def light(**look):
    h = drawing.homography((6, 5), (120, 100), square=24, turn=0.25, tilt=0.4, about=0.8)
    return drawing.light(h, (6, 5), (240, 200), **look)


def as_picture(values, noise=1.0):
    values = values + np.random.default_rng(0).normal(0, noise, values.shape)
    return np.clip(np.rint(values), 0, 255).astype(np.uint8)


def test_a_good_picture_gives_no_warning():
    found = figures(as_picture(light()))
    assert found["warnings"] == []
    # the pixel's own area blurs by 1 / sqrt(12) besides
    assert found["blur_px"] == pytest.approx(np.hypot(0.8, np.sqrt(1 / 12)), rel=0.05)
    assert found["contrast"] == pytest.approx((210 - 40) / 2, rel=0.03)
    assert found["residual"] == pytest.approx(1.0, rel=0.3)
    assert 0.15 < found["coverage"] < 0.4 and found["square_px"] == pytest.approx(23, abs=2)


@pytest.mark.parametrize("direction", [0.0, 20.0, 60.0, 90.0, 140.0, 160.0])
def test_motion_is_seen_with_its_direction(direction):
    length = 9
    kernel = np.zeros((length, length), np.float32)
    step = np.deg2rad(direction)
    for t in np.linspace(-length // 2 + 1, length // 2, 60):
        kernel[round(length // 2 + t * np.sin(step)), round(length // 2 + t * np.cos(step))] += 1
    values = cv2.filter2D(light(), -1, kernel / kernel.sum(), borderType=cv2.BORDER_REPLICATE)
    found = figures(as_picture(values))
    assert any(w.startswith("motion") for w in found["warnings"])
    off = abs((found["blur_direction_deg"] - direction + 90) % 180 - 90)
    # the kernel's own pixels are rounded: a line of 9 px is off by up to 1/9 rad = 6 degrees
    assert off < 6


@pytest.mark.parametrize("blur", [0.8, 1.6])
def test_one_step_finds_the_blur_that_iteration_finds(monkeypatch, blur):
    picture = as_picture(light(blur=blur))
    one = figures(picture)
    monkeypatch.setattr(motion_blur, "NEAR", 0.0)
    every = figures(picture)
    # a step of NEAR ends within NEAR² / 2 of the blur
    assert one["blur_ratio"] == pytest.approx(every["blur_ratio"], abs=0.01)


@pytest.mark.parametrize(
    ("word", "look"),
    [
        ("blurred", {"blur": 3.2}),
        ("overexposed", {"white": 330.0}),
        ("flat", {"black": 100.0, "white": 116.0}),
    ],
)
def test_faults_are_named(word, look):
    assert any(w.startswith(word) for w in figures(as_picture(light(**look), 0.5))["warnings"])


def test_ellipse_of_a_known_variance():
    directions = np.random.default_rng(3).uniform(0, np.pi, (20, 3, 2))
    s = np.array([[4.0, 1.0], [1.0, 2.0]])
    n = np.stack([np.cos(directions), np.sin(directions)], -1)
    ratio, direction = blur_ellipse(directions, np.einsum("kpi,ij,kpj->kp", n[..., 0, :], s, n[..., 1, :]))
    values, vectors = np.linalg.eigh(s)
    assert ratio == pytest.approx(np.sqrt(values[1] / values[0]))
    assert direction == pytest.approx(np.degrees(np.arctan2(vectors[1, 1], vectors[0, 1])) % 180)


def test_coverage():
    square = np.array([[0, 0], [50, 0], [50, 50], [0, 50], [20, 20]], float)
    assert coverage(square, (100, 100)) == pytest.approx(0.25)
    assert coverage(square[:2], (100, 100)) == 0.0 == coverage(np.c_[np.arange(5), np.arange(5)], (9, 9))
