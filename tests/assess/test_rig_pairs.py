"""Epipolar lines and points from two cameras: against differences of the geometry itself, and against scatter."""

from dataclasses import replace

import numpy as np
import pytest

from camcal import calibrate_rig
from camcal.assess.covariance import covariance
from camcal.assess.rig_pairs import _derivatives, board_distance, epipolar_residuals, pair_uncertainty
from camcal.geometry import rotations
from camcal.model.pose import Pose
from camcal.model.rig import Rig
from tests.rigs import LENS, observed, truth

NOISE = 0.2


@pytest.fixture(scope="module")
def solution():
    return calibrate_rig(observed(truth("ab"), noise=NOISE)[0], model=LENS, checks=False)


def stepped(solution, index, size):
    """The rig with one variable moved."""
    step = np.zeros(solution.free.shape[1])
    step[index] = size
    cameras, poses, row = {}, dict(solution.rig.cam_from_rig), 0
    for name, camera in solution.rig.cameras.items():
        change = (solution.free @ step)[row : row + camera.lens.size]
        cameras[name] = replace(camera, params=camera.params + change)
        row += camera.lens.size
    for name, at in solution.extrinsics.items():
        pose, d = poses[name], step[at]
        poses[name] = Pose(rotations.exp(d[:3]) @ pose.rotation, pose.translation + d[3:])
    return Rig(cameras, poses, solution.rig.reference)


@pytest.mark.parametrize("name", ["a", "b"])
def test_derivatives_are_those_of_the_projection(solution, name):
    xyz = np.array([[20.0, -30.0, 900.0], [-60.0, 50.0, 800.0]])
    by_xyz, by_variables = _derivatives(solution, name, xyz)

    def seen(rig, points):
        return rig.cameras[name].project(rig.cam_from_rig[name].apply(points))

    for k in range(3):
        d = np.zeros(3)
        d[k] = 1e-3
        numeric = (seen(solution.rig, xyz + d) - seen(solution.rig, xyz - d)) / 2e-3
        np.testing.assert_allclose(by_xyz[..., k], numeric, rtol=1e-6, atol=1e-8)
    for index in range(solution.free.shape[1]):
        up, down = (seen(stepped(solution, index, s), xyz) for s in (1e-6, -1e-6))
        np.testing.assert_allclose(by_variables[..., index], (up - down) / 2e-6, rtol=1e-4, atol=1e-4)


def test_residuals_across_the_lines_are_noise(solution):
    """The distance of two noisy points: √2 times the noise of a coordinate, with cameras of one focal length.

    540 distances know their rms to 3 %; three of that, and the few per cent that the fit takes up.
    """
    off = epipolar_residuals(solution, "a", "b")
    assert len(off) > 400
    assert np.sqrt(np.square(off).mean()) == pytest.approx(NOISE * np.sqrt(2), rel=0.12)


def test_a_point_is_uncertain_along_the_ray(solution):
    """Far of the baseline: z² / (b f) √2 σ, less a little as the cameras turn to each other."""
    distance = board_distance(solution, "a")
    accuracy = covariance(solution)
    found = pair_uncertainty(solution, accuracy, "a", "b", distance, NOISE)
    exact = replace(accuracy, free=0 * accuracy.free)
    noise = pair_uncertainty(solution, exact, "a", "b", distance, NOISE)
    expected = distance**2 / (200 * 600) * np.sqrt(2) * NOISE
    assert np.median(noise.point) == pytest.approx(expected, rel=0.25)
    assert (noise.of_calibration == 0).all() and (found.point > noise.point).all()


def test_epipolar_sigmas_are_those_of_the_scatter():
    """20 rigs: the error of the epipolar line at the boards, against its sigma; to three errors of a scatter of 20."""
    rig, ratios = truth("ab"), []
    for seed in range(20):
        made = calibrate_rig(observed(rig, seed)[0], model=LENS, checks=False)
        accuracy = covariance(made)
        found = pair_uncertainty(made, accuracy, "a", "b", 875.0, NOISE)
        near = found.pixels[np.linalg.norm(found.pixels - [320, 240], axis=1) < 120]
        same = np.isin(found.pixels, near).all(1)
        true = rig.cam_from_rig["b"].apply(rig.cameras["a"].unproject(found.pixels[same]) * 875.0)
        off = epipolar_offset(made.rig, found.pixels[same], rig.cameras["b"].project(true))
        ratios.append(np.square(off / found.epipolar[same]).mean())
    assert np.sqrt(np.mean(ratios)) == pytest.approx(1, abs=3 / np.sqrt(2 * 20))


def epipolar_offset(rig, pixels, seen):
    """How far points seen in b lie from the epipolar lines of pixels of a."""
    rays = rig.cameras["a"].unproject(pixels)
    near, far = (rig.cameras["b"].project(rig.cam_from_rig["b"].apply(rays * d)) for d in (874.0, 876.0))
    along = (far - near) / np.linalg.norm(far - near, axis=1, keepdims=True)
    off = seen - (near + far) / 2
    return off[:, 1] * along[:, 0] - off[:, 0] * along[:, 1]
