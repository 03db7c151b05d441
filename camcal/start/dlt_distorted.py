"""The DLT with distortion as used in biomechanics laboratories: 12, 14 or 16 coefficients.

Y. Abdel-Aziz, H. Karara, Direct linear transformation from comparator coordinates into object space coordinates
in close-range photogrammetry (1971), with the distortion terms of Karara & Abdel-Aziz, Accuracy aspects of
non-metric imageries (1974). With R = L9 X + L10 Y + L11 Z + 1, and (ξ, η) the pixel from the principal point, r²
= ξ² + η²,

    u - Δu = (L1 X + L2 Y + L3 Z + L4) / R,    v - Δv = (L5 X + L6 Y + L7 Z + L8) / R                    (1)
    Δu = ξ (L12 r² + L13 r⁴ + L14 r⁶) + L15 (r² + 2 ξ²) + L16 ξ η                                        (2)
    Δv = η (L12 r² + L13 r⁴ + L14 r⁶) + L15 ξ η + L16 (r² + 2 η²)

Eleven coefficients are the closed form `dlt` or `central`, twelve add L12, fourteen the radial terms, sixteen all; the
eleven under the condition of orthogonal pixel axes are `mdlt`. (1) times R is linear in all of them for given R and
principal point, which depend on L1 to L11. These are taken from the previous round, so that the sum of squares in px is
minimised (Marzan & Karara 1975).
"""

from __future__ import annotations

import numpy as np

from camcal.data.observations import Observations, View
from camcal.errors import DataError, EstimationError
from camcal.geometry import projective
from camcal.geometry.dlt import solve
from camcal.model.pose import Poses
from camcal.start import leave_one_out, shape
from camcal.start.base import ClosedForm, scaled
from camcal.start.of_rays import camera_of

Array = np.ndarray

ROUNDS = 200  #: limit of iterations: data that need more do not determine the coefficients
#: iterations end when the coefficients, in normalised coordinates, change by less than this
SETTLED = 1e-11
#: fraction of the largest singular value below which the coefficients are undetermined: points on a plane, or of one
#: depth
UNDETERMINED = 1e-9


def estimate12(correspondences: Observations, skew: bool = False, normalise: bool = True) -> ClosedForm:
    """Twelve coefficients; see `estimate16`."""
    return _estimate(correspondences, 12)


def estimate14(correspondences: Observations, skew: bool = False, normalise: bool = True) -> ClosedForm:
    """Fourteen coefficients; see `estimate16`."""
    return _estimate(correspondences, 14)


def estimate16(correspondences: Observations, skew: bool = False, normalise: bool = True) -> ClosedForm:
    """K with its skew, the pose and the distortion of a single view of points in space.

    `info` holds `coefficients` (L1 to L16, px) and `leave_one_out`, the rms_point of every point predicted by the
    others, px.

    Raises
    ------
    DataError
        If there are too few points, or all are collinear.
    EstimationError
        For several views, for points on a plane, and if the iteration does not converge.
    """
    return _estimate(correspondences, 16)


def _estimate(data: Observations, count: int) -> ClosedForm:
    view = shape.view_in_space(data, f"the closed form 'dlt{count}'")
    if 2 * len(view) <= count:
        raise DataError(
            f"view '{view.id}' holds {len(view)} points; {count} coefficients need {count // 2 + 1}.",
            "Add points, or use 'dlt'.",
        )
    m, centre, terms, left_out, condition = _solved(view, count)
    k, rotation, translation, mirrored = projective.decompose(m, view.xyz)
    radial = np.zeros(5)
    radial[: len(terms)] = terms
    flat = view.uv - _basis(view.uv - centre, 5) @ radial
    camera = camera_of(projective.homogeneous(flat) @ np.linalg.inv(k).T, view.uv, data.image_size)
    matrix = scaled(m)
    info = {
        "assumptions": [],
        "coefficients": [*matrix.ravel()[:11].tolist(), *terms.tolist()],
        "leave_one_out": left_out,
        "condition": condition,
        "mirrored": mirrored,
        "degenerate": False,
    }
    return ClosedForm(f"dlt{count}", k, Poses(rotation[None], translation[None]), matrix, info, camera)


def _solved(view: View, count: int) -> tuple[Array, Array, Array, float, float]:
    """M (3, 4), the principal point (2,), L12 and above, the leave-one-out rms_point (px), the condition number."""
    roots = view.root_weights
    to_xyz, to_uv = projective.normalisation(view.xyz[None])[0], projective.normalisation(view.uv[None])[0]
    x = projective.homogeneous(view.xyz) @ to_xyz.T
    q = (projective.homogeneous(view.uv) @ to_uv.T)[:, :2]
    first, _ = solve(view.xyz[None], view.uv[None], roots[None] ** 2)
    m = to_uv @ first[0] @ np.linalg.inv(to_xyz)
    coefficients = np.r_[(m / m[2, 3]).ravel()[:11], np.zeros(count - 11)]
    for _ in range(ROUNDS):
        rows, right, centre = _equations(coefficients, x, q, roots)
        before = coefficients
        coefficients, _, _, singular = np.linalg.lstsq(rows, right, rcond=UNDETERMINED)
        if not singular[-1] > UNDETERMINED * singular[0]:
            raise EstimationError(
                f"view '{view.id}': its {len(view)} points leave the {count} coefficients undetermined.",
                "Use points spread over a volume, or 'dlt'.",
            )
        if np.abs(coefficients - before).max() < SETTLED * max(1.0, np.abs(coefficients).max()):
            break
    else:
        raise EstimationError(
            f"view '{view.id}': the {count} coefficients did not converge after {ROUNDS} rounds.",
            "Use fewer ('dlt12', 'dlt'): the points hardly determine the principal point or the distortion.",
        )
    scale = float(to_uv[0, 0])
    left_out = leave_one_out.rms_point(rows @ coefficients - right, rows, roots) / scale
    m = np.linalg.inv(to_uv) @ np.r_[coefficients[:11], 1.0].reshape(3, 4) @ to_xyz
    powers = scale ** np.array([2, 4, 6, 1, 1])[: count - 11]
    at = (centre - to_uv[:2, 2]) / scale
    return m, at, coefficients[11:] * powers, left_out, float(singular[0] / singular[-1])


def _equations(coefficients: Array, x: Array, q: Array, roots: Array) -> tuple[Array, Array, Array]:
    """(1) as rows (2N, C) and right sides (2N,) in normalised px, with R and the principal point (2,) given."""
    m = np.r_[coefficients[:11], 1.0].reshape(3, 4)
    depth = x @ m[2]
    centre = m[:2, :3] @ m[2, :3] / (m[2, :3] @ m[2, :3])
    weight = roots / depth
    rows = np.zeros((len(x), 2, len(coefficients)))
    rows[:, 0, :4] = rows[:, 1, 4:8] = x * weight[:, None]
    rows[:, :, 8:11] = -q[:, :, None] * (x[:, :3] * weight[:, None])[:, None]
    rows[:, :, 11:] = _basis(q - centre, len(coefficients) - 11) * roots[:, None, None]
    right = q * weight[:, None]
    return rows.reshape(len(x) * 2, -1), right.ravel(), centre


def _basis(at: Array, count: int) -> Array:
    """(2) as (N, 2, count)."""
    xi, eta = at.T
    r2 = (at**2).sum(1)
    radial = [at * (r2**i)[:, None] for i in (1, 2, 3)]
    decentering = [
        np.stack([r2 + 2 * xi**2, xi * eta], 1),
        np.stack([xi * eta, r2 + 2 * eta**2], 1),
    ]
    return np.stack([*radial, *decentering][:count], 2)
