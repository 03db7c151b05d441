"""The modified DLT of Hatze: the projection matrix with m34 = 1 whose pixel axes are orthogonal.

H. Hatze, High-precision three-dimensional photogrammetric calibration and object space reconstruction using a
modified DLT approach, Journal of Biomechanics 21 (1988). Eleven coefficients describe a camera with a skew; a
camera without one has ten unknowns, so that the coefficients satisfy one condition, with m1, m2, m3 the rows of
the left 3 x 3 part:

    g(M) = (m1 x m3) · (m2 x m3) = 0                                                                    (1)

Hatze eliminates one coefficient by (1) and iterates; here the same constrained minimum of Σ |r|², r in px, is
found by Gauss-Newton steps with a Lagrange multiplier, from the linear solution.
"""

from __future__ import annotations

import numpy as np

from camcal.data.observations import Correspondences, View
from camcal.errors import EstimationError
from camcal.geometry import projective
from camcal.geometry.dlt import solve
from camcal.model.pose import Poses
from camcal.start import leave_one_out, shape
from camcal.start.base import ClosedForm, scaled

Array = np.ndarray

STEPS = 50  #: limit of iterations: data that need more do not determine the matrix
#: iterations end when the coefficients, in normalised coordinates, change by less than this
SETTLED = 1e-12
#: halvings of a step that increases cost and condition; from the DLT, full steps have always been accepted
HALVINGS = 10


def estimate(correspondences: Correspondences, skew: bool = False, normalise: bool = True) -> ClosedForm:
    """K without skew and the pose of a single view of points in space.

    `info` holds `leave_one_out`, the rms_point of every point predicted by the others, px.

    Raises
    ------
    DataError
        If the view has too few points, or all are collinear.
    EstimationError
        For several views, for points on a plane, and if the iteration does not converge.
    """
    view = shape.view_in_space(correspondences, "the closed form 'mdlt'")
    m, steps, left_out, condition = constrained(view)
    k, rotation, translation, mirrored = projective.decompose(m, view.xyz)
    info = {
        "assumptions": ["the pixel axes are orthogonal"],
        "iterations": steps,
        "leave_one_out": left_out,
        "condition": condition,
        "mirrored": mirrored,
        "degenerate": False,
    }
    k[0, 1] = 0.0  # the residual of the condition is rounding
    return ClosedForm("mdlt", k, Poses(rotation[None], translation[None]), scaled(m), info)


def constrained(view: View) -> tuple[Array, int, float, float]:
    """The projection matrix (3, 4) that minimises Σ |r|² / sigma² under (1).

    Returns
    -------
    matrix, steps taken, leave-one-out rms_point (px), condition number of the linear system
    """
    roots = view.root_weights
    to_xyz, to_uv = projective.normalisation(view.xyz[None])[0], projective.normalisation(view.uv[None])[0]
    x = projective.homogeneous(view.xyz) @ to_xyz.T
    y = (projective.homogeneous(view.uv) @ to_uv.T)[:, :2]
    linear, singular = solve(view.xyz[None], view.uv[None], roots[None] ** 2)
    m = to_uv @ linear[0] @ np.linalg.inv(to_xyz)
    m = m / np.linalg.norm(m)
    for count in range(1, STEPS + 1):  # noqa: B007
        residual, jacobian = _equations(m, x, y, roots)
        value, gradient = _condition(m)
        # the scale of M is free: its own direction is held
        system = np.zeros((14, 14))
        system[:12, :12] = jacobian.T @ jacobian
        system[:12, 12] = system[12, :12] = gradient.ravel()
        system[:12, 13] = system[13, :12] = m.ravel()
        right = -np.r_[jacobian.T @ residual, value, 0.0]
        step = np.linalg.lstsq(system, right, rcond=1e-15)[0][:12].reshape(3, 4)
        m = _taken(m, step, x, y, roots)
        if np.abs(step).max() < SETTLED:
            break
    else:
        raise EstimationError(
            f"view '{view.id}': the modified DLT did not converge after {STEPS} steps.",
            "Use the closed form 'dlt'; the points may leave the matrix undetermined.",
        )
    left_out = _leave_one_out(m, x, y, roots) / float(to_uv[0, 0])
    condition = float(singular[0, 0] / max(singular[0, 10], np.finfo(float).tiny))
    return np.linalg.inv(to_uv) @ m @ to_xyz, count, left_out, condition


def _taken(m: Array, step: Array, x: Array, y: Array, roots: Array) -> Array:
    """M after the step, which is shortened while both the cost and the constraint get worse."""

    def figures(n: Array) -> tuple[float, float]:
        r, _ = _equations(n, x, y, roots)
        return float(r @ r), abs(_condition(n)[0])

    before = figures(m)
    for _ in range(HALVINGS):
        trial = (m + step) / np.linalg.norm(m + step)
        cost, off = figures(trial)
        if not (cost > before[0] and off > before[1]):
            return trial
        step = step / 2
    return trial


def _equations(m: Array, x: Array, y: Array, roots: Array) -> tuple[Array, Array]:
    """Residuals (2N,) in normalised px and their Jacobian (2N, 12) by M."""
    q = x @ m.T
    uv = q[:, :2] / q[:, 2:]
    jacobian = np.zeros((len(x), 2, 3, 4))
    jacobian[:, 0, 0] = jacobian[:, 1, 1] = x / q[:, 2:]
    jacobian[:, :, 2] = -uv[:, :, None] * (x / q[:, 2:])[:, None]
    jacobian *= roots[:, None, None, None]
    return ((uv - y) * roots[:, None]).ravel(), jacobian.reshape(-1, 12)


def _condition(m: Array) -> tuple[float, Array]:
    """g of (1) and its gradient (3, 4).

    g = 0 is invariant under similarities of the points' coordinates and isotropic scaling of the pixels.
    """
    m1, m2, m3 = m[:, :3]
    a, b = np.cross(m1, m3), np.cross(m2, m3)
    gradient = np.zeros((3, 4))
    gradient[0, :3], gradient[1, :3] = np.cross(m3, b), np.cross(m3, a)
    gradient[2, :3] = np.cross(b, m1) + np.cross(a, m2)
    return float(a @ b), gradient


def _leave_one_out(m: Array, x: Array, y: Array, roots: Array) -> float:
    """rms_point with each point predicted without it, normalised px, along the changes that (1) and the scale
    allow.
    """
    residual, jacobian = _equations(m, x, y, roots)
    held = np.stack([_condition(m)[1].ravel(), m.ravel()])
    return leave_one_out.rms_point(residual, jacobian @ np.linalg.svd(held)[2][2:].T, roots)
