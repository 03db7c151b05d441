"""Properties of projective geometry."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from camcal.geometry import projective, rotations

seeds = st.integers(0, 2**32 - 1)


def camera(seed):
    random = np.random.default_rng(seed)
    f = random.uniform(300, 3000, 2)
    k = np.array([[f[0], random.normal() * 5, 640], [0, f[1], 400], [0, 0, 1]])
    rotation = rotations.exp(random.normal(size=3))
    cam = random.uniform(-1, 1, (12, 3)) + [0, 0, 4]
    translation = random.uniform(-2, 2, 3)
    return k, rotation, translation, (cam - translation) @ rotation, cam


@given(seeds, st.sampled_from([1.0, -1.0, 1e-6, -1e6]))
def test_decompose_undoes_compose(seed, scale):
    k, rotation, translation, xyz, _ = camera(seed)
    m = scale * projective.compose(k, rotation, translation)
    found = projective.decompose(m, xyz)
    # relative to entries of up to 3000 px: a condition of some thousand on 1e-16
    np.testing.assert_allclose(found[0], k, atol=1e-8)
    np.testing.assert_allclose(found[1], rotation, atol=1e-11)
    np.testing.assert_allclose(found[2], translation, atol=1e-10)
    assert not found[3]


@given(seeds)
def test_a_left_handed_world_is_noticed(seed):
    k, rotation, translation, xyz, cam = camera(seed)
    mirror = np.diag([1.0, 1.0, -1.0])
    m = projective.compose(k, rotation @ mirror, translation)
    found_k, found_r, found_t, mirrored = projective.decompose(m, xyz @ mirror)
    assert mirrored
    assert np.linalg.det(found_r) == pytest.approx(1)
    np.testing.assert_allclose(found_k, k, atol=1e-8)
    behind = (xyz @ mirror) @ found_r.T + found_t
    np.testing.assert_allclose(behind, -cam, atol=1e-9)


@given(seeds)
def test_rq(seed):
    m = np.random.default_rng(seed).normal(size=(3, 3))
    k, r = projective.rq(m)
    np.testing.assert_allclose(k @ r, m, atol=1e-13)
    np.testing.assert_allclose(r @ r.T, np.eye(3), atol=1e-13)
    np.testing.assert_array_equal(np.tril(k, -1), 0)
    assert (np.diag(k) >= 0).all()


@given(seeds, st.integers(2, 3))
def test_normalisation(seed, dimensions):
    points = np.random.default_rng(seed).normal(size=(3, 20, dimensions)) * 50 + 1000
    t = projective.normalisation(points)
    x = projective.dehomogenise(projective.homogeneous(points) @ np.swapaxes(t, 1, 2))
    np.testing.assert_allclose(x.mean(1), 0, atol=1e-11)
    np.testing.assert_allclose(np.linalg.norm(x, axis=-1).mean(1), np.sqrt(dimensions), rtol=1e-11)


def test_normalisation_of_one_place():
    np.testing.assert_array_equal(projective.normalisation(np.ones((5, 2)))[:2, 2], [-1, -1])


@given(seeds, st.floats(-1e4, 1e4))
def test_fit_plane(seed, offset):
    random = np.random.default_rng(seed)
    rotation = rotations.exp(random.normal(size=(6, 3)))
    flat = random.uniform(-1, 1, (6, 15, 3)) * [3, 1, 0]
    origin, axes, spread = projective.fit_plane(flat @ np.swapaxes(rotation, 1, 2) + offset)
    # the normal is known up to the data's own rounding, offset * 1e-16 over extents of about 1
    across = np.cross(axes[..., 2], rotation[..., 2])
    np.testing.assert_allclose(across, 0, atol=1e-11)
    np.testing.assert_allclose(np.linalg.det(axes), 1, atol=1e-13)
    assert (spread[:, 2] < 1e-11).all() and (np.diff(spread) <= 0).all()
    np.testing.assert_allclose(
        origin.mean(-1),
        (flat.mean(1, keepdims=True) @ np.swapaxes(rotation, 1, 2)).mean((1, 2)) + offset,
        atol=1e-11,
    )


def test_fit_plane_of_a_board_is_its_own_plane():
    x, y = np.meshgrid(np.arange(9.0), np.arange(6.0))
    _, axes, spread = projective.fit_plane(np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], 1))
    np.testing.assert_array_equal(axes, np.eye(3))
    np.testing.assert_allclose(spread, [np.sqrt(80 / 12), np.sqrt(35 / 12), 0], rtol=1e-14)


def test_principal_spreads():
    points = np.random.default_rng(0).normal(size=(4, 30, 2)) * [5, 1]
    singular = np.linalg.svd(points - points.mean(1, keepdims=True), compute_uv=False)
    np.testing.assert_allclose(projective.principal_spreads(points), singular / np.sqrt(30), rtol=1e-10)
