"""Noise that grows towards the border: said where sigmas suffer, by how much, and silent elsewhere."""

from dataclasses import replace

import numpy as np
import pytest

from camcal.assess.checks import border
from camcal.assess.checks.facts import Facts
from camcal.assess.design import Design
from camcal.plan.calibrate import calibrate
from tests.solved import camera_of, grid, observe, tilted_poses


def growing(growth, seed=0, views=15, given=False):
    """Noise of .1 px in the centre that has grown by `growth` at the corners, with or without sigmas that say so."""
    rng = np.random.default_rng(seed)
    truth = camera_of("opencv5")
    poses = tilted_poses(grid(), views, np.random.default_rng(views), distance=(8.0, 11.0))
    data = observe(truth, poses, grid(), 0.0, rng)
    radius = np.linalg.norm(data.uv - truth.params[2:4], axis=1) / 400
    sigma = 0.1 * (1 + growth * radius**2)
    noisy = data.uv + sigma[:, None] * rng.normal(size=data.uv.shape)
    data = replace(data, uv=noisy, sigma=sigma if given else None)
    return calibrate(data, "opencv5", checks=False, crosscheck=False, robust="none")


@pytest.mark.parametrize("seed", range(3))
def test_growing_noise_is_said_and_even_noise_is_not(seed):
    (said,) = border.noise_by_radius(Facts(growing(15, seed)))
    assert said.code == "noise-by-radius" and "grows" in said.message
    assert not list(border.noise_by_radius(Facts(growing(0, seed))))


def test_given_sigmas_say_it_already():
    assert not list(border.noise_by_radius(Facts(growing(15, given=True))))


@pytest.mark.parametrize(
    ("ratio", "severity"), [(1.19, None), (1.21, "note"), (1.49, "note"), (1.51, "doubtful")]
)
def test_the_severity_follows_how_much_too_small_sigmas_are(monkeypatch, ratio, severity):
    monkeypatch.setattr(border, "too_small", lambda *_: np.full(9, ratio))
    assert [w.severity for w in border.noise_by_radius(Facts(growing(15)))] == [severity] * (
        severity is not None
    )


def test_the_covariance_of_uneven_noise_is_that_of_many_draws():
    """The scatter of k3 over 60 calibrations, known to 9 %, against (1) of one of them and against what is stated."""
    fits = [growing(15, seed, views=8) for seed in range(60)]
    found = np.std([f.camera.params[-1] for f in fits])
    facts = [Facts(f) for f in fits[:10]]
    real, stated = [], []
    for f in facts:
        ring = border.rings(f)
        lengths = np.linalg.norm(f.solution.used_residuals, axis=1)
        variances = np.array([np.square(lengths[ring == k]).mean() / 2 for k in range(border.RINGS)])
        sigma = f.covariance.sigmas["k3"]
        stated.append(sigma)
        real.append(sigma * border.too_small(f.design, variances, ring)[-1])
    assert np.median(real) == pytest.approx(found, rel=0.3)  # three standard errors of the scatter of 60
    assert np.median(real) > 1.1 * np.median(stated)


def test_a_camera_that_is_known_has_no_design():
    facts = Facts(calibrate(growing(0).observations, "opencv5", checks=False, crosscheck=False))
    assert isinstance(facts.design, Design)
    known = dict(zip(facts.camera.lens.names, facts.camera.params.tolist(), strict=True))
    assert Facts(calibrate(facts.solution.observations, "opencv5", fix=known, checks=False)).design is None
