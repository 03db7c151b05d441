"""A closed form for all lenses, including wide-angle ones, from the radial alignment constraint, without initial
values.

A lens that is symmetric about its axis moves image points only along lines through the distortion centre: the
direction from there to an image point is the direction of (x, y) in the camera's frame, whatever the lens.
R. Tsai (1987), section II; R. Hartley & S. B. Kang (2007), section 2; D. Scaramuzza et al. (2006), section
III. This yields, by linear equations:

1. per view, the first two rows of the pose, without the depth (`partial_pose`);
2. the distortion centre, as the point about which 1. holds best (`distortion_centre`);
3. jointly over the views, the depth t3 of each and the lens as a polynomial, z / r = f(ρ) / ρ (`depths`).

Square pixels are assumed. The lens may be of any width.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from camcal.data.observations import Correspondences
from camcal.errors import DataError, EstimationError
from camcal.geometry import rotations
from camcal.geometry.numbers import TINY
from camcal.model.camera import Camera
from camcal.model.lenses import make
from camcal.model.pose import Poses
from camcal.records import dataclass
from camcal.start import assumptions, pose, shape

Array = np.ndarray

#: points that determine the unknowns of a view: 5 for a plane (6 up to scale), 7 in space (8 up to scale)
LEAST_PLANAR, LEAST_3D = 5, 7
#: exponents of f(ρ), the most terms first; fewer are used if the polynomial folds back within the data
SERIES = ((0, 2, 3, 4), (0, 2, 4), (0, 2))
#: standard deviation of the distortion centre about the image's centre, relative to the half diagonal: a lens
#: without distortion carries no information on its centre
CENTRE_SPREAD = 0.05
#: a focal length with a larger relative uncertainty is undetermined; real boards give .001 to .005,
#: boards that face the camera squarely, whose tilt is then noise, .08 and more
UNCERTAIN = 0.05
#: of the largest product of the lengths of a point and of its ray: below it the angle between the two is rounding, as
#: of a point in the camera's centre, and the point has no part in the equations
LEAST_LENGTH = 1e-12
#: rounds of solving alternately for f and the depths: limit, and number of those after the first that update the
#: weights
ROUNDS, LEAST_ROUNDS = 20, 3


@dataclass(frozen=True)
class RadialStart:
    """A camera symmetric about its axis, and the poses.

    Attributes
    ----------
    camera : Camera
        Of the model `scaramuzza`.
    poses : Poses
        cam_from_board of each view.
    info : mapping
        `centre` (px), `tangential_rms` (px, how well the constraint holds), `half_field` (degrees, of the
        widest ray), `exponents` of the polynomial, `focal_uncertainty` (relative).
    """

    camera: Camera
    poses: Poses
    info: dict[str, Any]


@dataclass(frozen=True)
class _View:
    """Points (N, 2 or 3) of unit spread about their centroid, pixels (N, 2) from the image's centre in half
    diagonals, the products (3m, 3m) of the terms of the constraint, and 1 / sigma (N,) about 1.
    """

    points: Array
    uv: Array
    products: Array
    roots: Array


@dataclass(frozen=True)
class _Lens:
    """f(ρ) = Σ a ρ^e, ρ in half diagonals, with the other results of `depths`."""

    exponents: tuple[int, ...]
    coefficients: Array
    t3: Array
    signs: Array
    uncertainty: float
    condition: float = np.inf


def estimate(correspondences: Correspondences) -> RadialStart:
    """Camera and poses from views of planes or of points in space, for lenses of any width.

    Raises
    ------
    DataError
        If a view has too few points.
    EstimationError
        If all views are fronto-parallel, so that the focal length is undetermined.
    """
    form = shape.check(correspondences)
    unit, _ = assumptions.unit_coordinates(correspondences)
    half_diagonal = 1 / unit[0, 0]
    centre = -unit[:2, 2] * half_diagonal
    views, scales = prepared(correspondences, form, centre, half_diagonal)
    offset = distortion_centre(views, half_diagonal)
    partial = [partial_pose(v, offset) for v in views]
    lens, camera = _monotone(views, partial, offset, centre, half_diagonal, correspondences)
    rotation = np.stack([turned(r, s) for (r, _), s in zip(partial, lens.signs, strict=True)])
    translation = np.c_[np.stack([t for _, t in partial]), lens.t3] * scales[:, None]
    poses = pose.from_plane(Poses(rotation, translation), form.origins, form.axes)
    rays = camera.unproject(np.concatenate([v.uv for v in correspondences.views]))
    widest = np.nanmin(rays[:, 2]) if np.isfinite(rays).any() else np.nan
    info = {
        "centre": (centre + offset * half_diagonal).tolist(),
        "tangential_rms": float(_tangential_rms(views, offset) * half_diagonal),
        "half_field": float(np.degrees(np.arccos(widest))),
        "exponents": list(lens.exponents),
        "focal_uncertainty": lens.uncertainty,
    }
    return RadialStart(camera, poses, info)


def prepared(
    correspondences: Correspondences, form: shape.Shapes, centre: Array, half_diagonal: float
) -> tuple[list[_View], Array]:
    """Views in their own coordinates, and the scale (V,) of each.

    Raises
    ------
    DataError
        If a view has too few points.
    """
    views, scales = [], np.empty(len(correspondences))
    for i, view in enumerate(correspondences.views):
        planar = bool(form.planar[i])
        least = LEAST_PLANAR if planar else LEAST_3D
        if len(view) < least:
            raise DataError(
                f"view '{view.id}' holds {len(view)} points; the radial alignment constraint needs {least}.",
                "Remove the view, or give it more points.",
            )
        local = (view.xyz - form.origins[i]) @ form.axes[i]
        scales[i] = np.sqrt((local**2).sum(1).mean())
        points = local[:, : 2 if planar else 3] / scales[i]
        uv = (view.uv - centre) / half_diagonal
        h = np.c_[points, np.ones(len(points))]
        terms = np.concatenate([uv[:, 1:] * h, uv[:, :1] * h, h], 1)
        roots = view.root_weights
        roots = roots / np.sqrt((roots**2).mean())
        terms = terms * roots[:, None]
        views.append(_View(points, uv, terms.T @ terms, roots))
    return views, scales


# ---------------------------------------------------------------------------------------------- rows 1 and 2
def _alignments(products: Array, counts: Array, offset: Array) -> tuple[Array, Array]:
    """The radial alignment error of views about a centre, and the first two rows of their poses.

    Parameters
    ----------
    products : (V, 3m, 3m) array
    counts : (V,) array
    offset : (2,) array

    Returns
    -------
    (V,) array, the least sum of ((v - cv) g1·h - (u - cu) g2·h)² over the mean of |g1·h|² + |g2·h|²
    (V, 2, m) array, (g1, g2) up to scale
    """
    m = products.shape[1] // 3
    one, zero = np.eye(m), np.zeros((m, m))
    shift = np.block([[one, zero], [zero, -one], [-offset[1] * one, offset[0] * one]])
    values, vectors = np.linalg.eigh(shift.T @ products @ shift)
    rows = vectors[:, :, 0].reshape(-1, 2, m)
    size = np.einsum("vij,vjk,vik->v", rows, products[:, 2 * m :, 2 * m :], rows)
    return np.maximum(values[:, 0], 0.0) * counts / np.maximum(size, TINY), rows


def _groups(views: Sequence[_View]) -> list[tuple[Array, Array]]:
    """The products and counts of the views of planes, and of those of points in space."""
    kinds = [[v for v in views if v.points.shape[1] == d] for d in (2, 3)]
    return [
        (np.stack([v.products for v in kind]), np.array([len(v.points) for v in kind]))
        for kind in kinds
        if kind
    ]


def _tangential_rms(views: Sequence[_View], offset: Array) -> float:
    """The rms distance of the image points from their radial lines, half diagonals."""
    total = sum(_alignments(*group, offset)[0].sum() for group in _groups(views))
    return float(np.sqrt(total / sum(len(v.points) for v in views)))


def distortion_centre(views: Sequence[_View], half_diagonal: float) -> Array:
    """The point (2,), from the image centre in half diagonals, about which the points align best.

    The sum of squared distances from the radial lines, in px, and the distance from the image's centre in
    standard deviations (`CENTRE_SPREAD`), by Nelder & Mead from the image's centre.
    """
    groups = _groups(views)

    def cost(c: Array) -> float:
        aligned = sum(_alignments(*group, c)[0].sum() for group in groups)
        return float(aligned * half_diagonal**2 + (c @ c) / CENTRE_SPREAD**2)

    from scipy.optimize import (
        minimize,
    )  # for wide-angle lenses only: its import takes longer than a usual calibration

    found = minimize(
        cost,
        np.zeros(2),
        method="Nelder-Mead",
        options={
            "initial_simplex": np.array([[0.0, 0.0], [0.02, 0.0], [0.0, 0.02]]),
            "xatol": 1e-4,
            "fatol": 1e-3,
            "maxiter": 100,
        },
    )
    return np.asarray(found.x)


def partial_pose(view: _View, offset: Array) -> tuple[Array, Array]:
    """The rotation (3, 3) and t1, t2 of a view; for a plane, up to the sign of the first entries of the third row.

    The homogeneous equations v (g1·h) = u (g2·h) about the centre give (g1, g2) up to scale. For a plane,
    the first two columns of the rotation are completed to orthonormal ones (Scaramuzza et al. 2006, eqs. 9 to
    11).
    """
    rows = _alignments(view.products[None], np.array([len(view.points)]), offset)[1][0]
    h = np.c_[view.points, np.ones(len(view.points))]
    along = (view.uv - offset) * (h @ rows.T)
    if along.sum() < 0:  # the point is on the same side of the axis as its image
        rows = -rows
    left = rows[:, :-1]
    if left.shape[1] == 3:
        size = np.sqrt((left**2).sum() / 2)
        return rotations.nearest(np.r_[left, [np.cross(*left) / size]] / size), rows[:, -1] / size
    a, b, c = left[:, 0] @ left[:, 0], left[:, 1] @ left[:, 1], left[:, 0] @ left[:, 1]
    root = np.hypot(a - b, 2 * c)
    x, y = np.sqrt(max(root - a + b, 0.0) / 2), np.sqrt(max(root + a - b, 0.0) / 2)
    third = np.array([x, -y if c > 0 else y])
    size = np.sqrt(a + x * x)
    columns = np.r_[left, [third]] / size
    return rotations.nearest(np.c_[columns, np.cross(*columns.T)]), rows[:, -1] / size


def turned(rotation: Array, sign: float) -> Array:
    """The rotation with opposite signs of r31, r32 if sign is -1: diag(1, 1, -1) R diag(1, 1, -1)."""
    return rotation if sign > 0 else rotation * np.outer([1, 1, -1], [1, 1, -1])


# --------------------------------------------------------------------------------------------- depth and lens
def depths(
    views: Sequence[_View], partial: Sequence[tuple[Array, Array]], offset: Array, exponents: tuple[int, ...]
) -> _Lens:
    """Solve f(ρ) r - ρ t3 = ± ρ (r31 X + r32 Y + r33 Z) for f and the t3 of each view.

    The signs are those of views of planes, whose solutions are mirror images: initially each view uses the one with
    f(0) > 0, then the one that fits the common f, until none changes. Equations are
    weighted so that their errors are angles.
    """
    signs = np.array([_own_sign(v, p, offset) for v, p in zip(views, partial, strict=True)])
    free = np.array([v.points.shape[1] == 2 for v in views])
    coefficients, t3 = np.zeros(len(exponents)), np.zeros(len(views))
    uncertainty = np.inf
    for turn in range(ROUNDS):
        systems = [
            _system(v, p, offset, exponents, coefficients if turn else None, s * t)
            for v, p, s, t in zip(views, partial, signs, t3, strict=True)
        ]
        normal = sum(b.T @ b for b, *_ in systems)
        right = sum(s * (b.T @ w) for s, (b, w, *_) in zip(signs, systems, strict=True))
        # LAPACK may not return if the matrix contains infinite numbers
        if not (np.isfinite(normal).all() and np.isfinite(right).all()):
            return _Lens(exponents, np.full(len(exponents), np.nan), t3, signs, np.inf)
        coefficients = np.linalg.lstsq(normal, right, rcond=1e-13)[0]
        agree = np.array([np.sign((b @ coefficients) @ w) or 1.0 for b, w, *_ in systems])
        changed = free & (agree != signs)
        signs = np.where(changed, agree, signs)
        t3 = np.array([d @ coefficients - s * e for s, (*_, d, e) in zip(signs, systems, strict=True)])
        uncertainty = _uncertainty(systems, signs, coefficients, normal)
        if turn >= LEAST_ROUNDS and not changed.any():
            break
    if coefficients[0] < 0 and free.all():
        coefficients, t3, signs = -coefficients, -t3, -signs
    return _Lens(exponents, coefficients, t3, signs, uncertainty, float(np.sqrt(np.linalg.cond(normal))))


def _system(
    view: _View,
    partial: tuple[Array, Array],
    offset: Array,
    exponents: tuple[int, ...],
    coefficients: Array | None,
    t3: float,
) -> tuple[Array, Array, Array, float]:
    """The equations of a view with t3 eliminated: B a = ± w, and t3 = d a - (± e)."""
    rotation, shift = partial
    xyz = view.points @ rotation[:, : view.points.shape[1]].T
    r = np.hypot(xyz[:, 0] + shift[0], xyz[:, 1] + shift[1])
    rho = np.hypot(*(view.uv - offset).T)
    if coefficients is None:
        weight = np.full(len(r), 1 / max(r.mean(), TINY))
    else:
        f = rho[:, None] ** np.array(exponents) @ coefficients
        lengths = np.hypot(r, xyz[:, 2] + t3) * np.hypot(rho, f)
        known = lengths > LEAST_LENGTH * lengths.max()
        weight = np.divide(1.0, lengths, out=np.zeros(len(r)), where=known)
    weight = weight * view.roots
    b = (weight * r)[:, None] * rho[:, None] ** np.array(exponents)
    q, w = weight * rho, weight * rho * xyz[:, 2]
    q2 = max(float(q @ q), TINY)
    d, e = q @ b / q2, float(q @ w) / q2
    return b - np.outer(q, d), w - q * e, d, e


def _own_sign(view: _View, partial: tuple[Array, Array], offset: Array) -> float:
    b, w, *_ = _system(view, partial, offset, (0, 2), None, 0.0)
    if view.points.shape[1] == 3:
        return 1.0
    focal = np.linalg.lstsq(b, w, rcond=None)[0][0]
    return 1.0 if focal >= 0 else -1.0


def _uncertainty(
    systems: Sequence[tuple[Array, Array, Array, float]], signs: Array, coefficients: Array, normal: Array
) -> float:
    """The relative standard deviation of f(0)."""
    rest = sum(
        float(((b @ coefficients - s * w) ** 2).sum()) for s, (b, w, *_) in zip(signs, systems, strict=True)
    )
    count = sum(len(w) for _, w, *_ in systems) - len(coefficients) - len(systems)
    variance = rest / max(count, 1) * np.linalg.pinv(normal, hermitian=True)[0, 0]
    if not variance >= 0:  # the equations contain only rounding errors
        return float("inf")
    return float(np.sqrt(variance) / max(abs(coefficients[0]), TINY))


def _monotone(
    views: Sequence[_View],
    partial: Sequence[tuple[Array, Array]],
    offset: Array,
    centre: Array,
    half_diagonal: float,
    correspondences: Correspondences,
) -> tuple[_Lens, Camera]:
    """The lens with the most terms that does not fold back among the data."""
    rim = max(float(np.hypot(*(v.uv - offset).T).max()) for v in views)
    model = make("scaramuzza")
    for exponents in SERIES:
        lens = depths(views, partial, offset, exponents)
        a = lens.coefficients
        if not (np.isfinite(a).all() and a[0] > 0 and lens.uncertainty < UNCERTAIN):
            continue
        focal = a[0] * half_diagonal
        values = {f"c{e}": c * a[0] ** (e - 1) for e, c in zip(exponents, a, strict=True) if e}
        values |= {"fx": focal, "fy": focal}
        values |= dict(zip(("cx", "cy"), (centre + offset * half_diagonal).tolist(), strict=True))
        params = model.from_values(values)
        edge = params[2:4] + [rim * half_diagonal, 0.0]
        if model.unproject(params, edge)[1]:
            return lens, Camera(model, params, correspondences.image_size)
    raise EstimationError(
        "the radial alignment constraint does not determine the focal length: the targets are parallel to "
        "the image, or the points are too few or too noisy.",
        "Tilt the target by 20 to 45 degrees relative to the image plane, in different directions.",
    )
