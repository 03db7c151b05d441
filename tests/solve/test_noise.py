"""Given sigmas: believed where they are right, a floor where the residuals speak against them."""

from dataclasses import replace

import numpy as np
import pytest

from camcal.assess.curvature import accuracy
from camcal.assess.figures import sigma_0
from camcal.plan.calibrate import calibrate
from camcal.solve.noise import NoiseModel, noise_model
from tests.solved import camera_of, grid, observe, tilted_poses


def data(seed, floor=0.0):
    """Twelve views with sigmas of .05 to 1 px, and what they leave out."""
    rng = np.random.default_rng(seed)
    found = observe(camera_of(), tilted_poses(grid(), 12, rng), grid(), 0.0, rng)
    sigma = np.exp(rng.uniform(np.log(0.05), 0.0, len(found.uv)))
    noise = rng.normal(size=found.uv.shape) * np.hypot(sigma, floor)[:, None]
    return replace(found, uv=found.uv + noise, sigma=sigma)


@pytest.mark.parametrize("seed", range(6))
def test_sigmas_that_are_right_are_believed(seed):
    found = calibrate(data(seed), model="opencv5", robust="auto", checks=False)
    model = found.fit.info["noise_model"]
    assert model["floor_px"] == 0.0 and found.used.all()
    # sigma_0 against the given sigmas: 648 points in two coordinates leave 2 % of scatter, four of these are allowed
    assert sigma_0(found) == pytest.approx(1.0, abs=0.09) == model["scale"]
    assert not [w for w in calibrate(data(seed), model="opencv5").warnings if w.severity != "note"]


def test_a_floor_is_found():
    found = calibrate(data(1, floor=0.3), model="opencv5", checks=False)
    assert found.fit.info["noise_model"]["floor_px"] == pytest.approx(0.3, abs=0.06)
    given = data(1, floor=0.3).sigma
    assert noise_model(found, given).floor == pytest.approx(0.3, abs=0.06)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("share", [0.2, 0.6, 1.0])
def test_points_without_any_error_say_nothing_about_the_sigmas(share):
    """Of exact data: where more than half of the residuals that count are 0, the given sigmas stay."""
    found = calibrate(data(0), model="opencv5", checks=False, crosscheck=False)
    residuals = found.residuals.copy()
    residuals[: int(share * len(residuals))] = 0.0
    model = noise_model(replace(found, residuals=residuals), data(0).sigma)
    assert (model == NoiseModel(1.0, 0.0)) == (share > 0.5) and np.isfinite(model.sigmas(data(0).sigma)).all()


def test_intervals_hold_the_truth_with_given_sigmas():
    """The quick version of benchmarks/coverage_study.py, arm `auto, given sigmas`."""
    truth, hits = camera_of("opencv4"), []
    for seed in range(40):
        rng = np.random.default_rng([7, seed])
        seen = observe(truth, tilted_poses(grid(), 10, rng), grid(), 0.0, rng)
        sigma = 0.2 * np.exp(rng.uniform(-np.log(4), np.log(4), seen.point_count))
        noisy = replace(seen, uv=seen.uv + rng.normal(size=seen.uv.shape) * sigma[:, None], sigma=sigma)
        found = calibrate(noisy, model="opencv4", robust="auto", checks=False)
        sigmas = np.array(list(accuracy(found).sigmas.values()))
        hits.append(np.abs(found.camera.params - truth.params) <= 1.96 * sigmas)
    share = np.array(hits).mean(1)
    # 8 parameters of a run are not independent: the standard error is that between the runs, three of which are allowed
    assert abs(share.mean() - 0.95) < 3 * share.std(ddof=1) / np.sqrt(len(share))
