"""Tsai's two stages and Fitzgibbon's joint closed form through lenses with distortion."""

import numpy as np
import pytest

from camcal.data.observations import Observations, View
from camcal.errors import EstimationError
from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.start import fitzgibbon, tsai
from tests.start import scenes

SIZE = (1280, 960)
CENTRE = (639.5, 479.5)
WIDE = Camera(lenses.make("division:1"), np.array([500.0, 500, *CENTRE, -0.25]), SIZE)


def views(camera, turns, noise=0.0, points=None, seed=0, distance=0.25):
    rng = np.random.default_rng(seed)
    xyz = scenes.board() if points is None else points
    middle = xyz.mean(0)
    made = []
    for i, turn in enumerate(turns):
        rotation = scenes.rotations.exp(np.array(turn, float))
        cam = (xyz - middle) @ rotation.T + [*rng.uniform(-0.04, 0.04, 2), distance]
        uv = camera.project(cam)
        made.append(View(str(i), xyz, uv + rng.normal(0, noise, uv.shape)))
    return Observations.from_views(made, SIZE)


@pytest.mark.parametrize("form", [tsai, fitzgibbon])
@pytest.mark.parametrize("points", [None, scenes.rig(40)])
def test_exact_points_through_a_division_lens(form, points):
    turns = [[0.3, -0.4, 0.2]] if points is not None else scenes.tilts(6)
    found = form.estimate(views(WIDE, turns, points=points, distance=0.25 if points is None else 0.5))
    np.testing.assert_allclose(found.camera.params, WIDE.params, rtol=1e-6)
    np.testing.assert_allclose(found.matrix[:2], WIDE.matrix[:2], rtol=1e-6, atol=1e-4)


@pytest.mark.parametrize("form, most", [(tsai, 0.02), (fitzgibbon, 0.02)])
def test_noise_of_half_a_pixel(form, most):
    for seed in range(3):
        found = form.estimate(views(WIDE, scenes.tilts(10), 0.5, seed=seed))
        assert abs(found.matrix[0, 0] / 500 - 1) < most
        assert abs(found.camera.params[4] + 0.25) < 0.05


def test_planes_parallel_to_the_picture_are_refused_and_tilted_ones_taken():
    plane = views(WIDE, [[0, 0, 0.1]], 0.1)
    with pytest.raises(EstimationError, match="fronto-parallel"):
        tsai.estimate(plane)
    assert abs(tsai.estimate(views(WIDE, [[0.5, 0, 0.1]], 0.1)).matrix[0, 0] / 500 - 1) < 0.1


def test_one_distortion_is_agreed_on_by_most_views():
    data = views(WIDE, scenes.tilts(7), 0.2)
    uv = [v.uv.copy() for v in data.views]
    uv[2] = WIDE.params[2:4] + (uv[2] - WIDE.params[2:4]) * (
        1 + 4e-7 * ((uv[2] - 600) ** 2).sum(1, keepdims=True)
    )
    spoilt = Observations.from_views(
        [View(v.id, v.xyz, w) for v, w in zip(data.views, uv, strict=True)], SIZE
    )
    assert abs(fitzgibbon.estimate(spoilt).camera.params[4] + 0.25) < 0.15
