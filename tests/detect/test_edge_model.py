import cv2
import numpy as np
import pytest

from camcal.detect import edge_model as model


def grid(half=7.0, step=0.5):
    axis = np.arange(-half, half + step / 2, step)
    x, y = np.meshgrid(axis, axis)
    return np.stack([x.ravel(), y.ravel()])[None].astype(np.float32)


@pytest.mark.parametrize("angle", [np.pi / 2, 1.2, 2.2])
def test_derivatives(angle):
    q = grid()
    params = np.array([[0.3, -0.2, 0.4, 0.4 + angle, 110.0, 70.0, 1.1]])
    _, jacobian = model.evaluate(q, params)
    for i, step in enumerate([1e-2, 1e-2, 3e-3, 3e-3, 1.0, 1.0, 1e-2]):
        ahead, behind = params.copy(), params.copy()
        ahead[:, i] += step
        behind[:, i] -= step
        numeric = (model.evaluate(q, ahead)[0] - model.evaluate(q, behind)[0]) / (2 * step)
        size = np.abs(numeric).max()
        # the derivative leaves out that of the higher terms for edges that are not at right angles
        exact = abs(angle - np.pi / 2) < 1e-9
        tolerance = 5e-3 if exact else 0.15  # float32 differences
        assert np.abs(numeric - jacobian[:, i]).max() < tolerance * size, i


def test_step_is_the_error_function():
    from scipy.special import erf

    u = np.linspace(-8, 8, 401, dtype=np.float32)[None]
    edge, slope = model.step(u, np.array([1.3]))
    assert np.abs(edge - erf(u / (np.sqrt(2) * 1.3))).max() < 2.6e-5  # as the approximation states
    assert np.abs(np.gradient(edge[0], u[0]) - slope[0]).max() < 1e-3  # second order of the grid


@pytest.mark.parametrize("angle", [90, 70, 55, 130])
def test_oblique_corner_is_the_blurred_product_of_signs(angle):
    """A numerically blurred corner: the product alone is off by several per cent at 55 degrees."""
    blur, fine = 1.5, 20
    axis = (np.arange(-12 * fine, 12 * fine + 1)) / fine
    x, y = np.meshgrid(axis, axis)
    second = np.deg2rad(angle)
    sign = np.sign(x) * np.sign(np.round(np.cos(second) * x + np.sin(second) * y, 12))
    blurred = cv2.GaussianBlur(sign, (0, 0), blur * fine)
    keep = np.s_[5 * fine : -5 * fine : fine]
    q = np.stack([x[keep, keep].ravel(), y[keep, keep].ravel()])[None].astype(np.float32)
    value, _ = model.evaluate(q, np.array([[0, 0, 0, second, 0, 1, blur]]))
    # 0.012: the terms left out, |r|^4 / 4! and higher, at 55 degrees, and the steps of the grid
    assert np.abs(value[0] - blurred[keep, keep].ravel()).max() < 0.012
