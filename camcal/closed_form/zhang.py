"""Zhang's closed form: K from the homographies of planes, then their poses.

Z. Zhang, A flexible new technique for camera calibration, PAMI 22 (2000). The boards may lie in any plane of
their frame; nearly flat ones are projected onto their best plane.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from camcal.closed_form import pose, shape
from camcal.closed_form.base import ClosedForm, scaled
from camcal.errors import EstimationError
from camcal.geometry import homography
from camcal.types import Correspondences

Array = np.ndarray

#: A singular value of the constraints below this part of the largest possible one counts as 0.
UNDETERMINED = 1e-8


@dataclass(frozen=True)
class Rung:
    """A set of assumptions on K: which vectors b = (B11, B12, B22, B13, B23, B33) it allows.

    `basis` (6, k) spans them, in image coordinates whose origin is the image's centre.
    """

    basis: Array
    assumptions: tuple[str, ...]

    @property
    def unknowns(self) -> int:
        """How many entries of K it leaves free."""
        return self.basis.shape[1] - 1


def _basis(*groups: tuple[int, ...]) -> Array:
    basis = np.zeros((6, len(groups)))
    for column, entries in enumerate(groups):
        basis[list(entries), column] = 1
    return basis


_CENTRE, _SQUARE = "the principal point is {centre}", "one focal length, fx = fy"
#: From the fewest assumptions to the most.
LADDER = (
    Rung(_basis((0,), (1,), (2,), (3,), (4,), (5,)), ()),
    Rung(_basis((0,), (2,), (3,), (4,), (5,)), ("skew is 0",)),
    Rung(_basis((0, 2), (3,), (4,), (5,)), ("skew is 0", _SQUARE)),
    Rung(_basis((0,), (2,), (5,)), ("skew is 0", _CENTRE)),
    Rung(_basis((0, 2), (5,)), ("skew is 0", _CENTRE, _SQUARE)),
)


def constraints(h: Array) -> Array:
    """The two equations per homography on the image of the absolute conic B = K⁻ᵀ K⁻¹ (Zhang 2000, eqs. 3-8).

    The image of the plane's circular points, c = h1 + i h2, lies on the conic: cᵀ B c = 0. Its real part is
    h1ᵀBh1 - h2ᵀBh2, its imaginary part 2 h1ᵀBh2; taken together they do not depend on the axes in the plane.

    Parameters
    ----------
    h : (V, 3, 3) array

    Returns
    -------
    (V, 2, 6) array of coefficients of (B11, B12, B22, B13, B23, B33)
    """
    c0, c1, c2 = np.moveaxis(h[..., 0] + 1j * h[..., 1], -1, 0)
    q = np.stack([c0 * c0, 2 * c0 * c1, c1 * c1, 2 * c0 * c2, 2 * c1 * c2, c2 * c2], -1)
    return np.stack([q.real, q.imag], 1)


def camera_matrix(b: Array) -> Array | None:
    """K from (B11, B12, B22, B13, B23, B33), of any sign; None where B is not positive definite.

    B = λ K⁻ᵀ K⁻¹ is factored by Cholesky, which gives what Zhang's appendix B writes out.
    """
    conic = np.array([[b[0], b[1], b[3]], [b[1], b[2], b[4]], [b[3], b[4], b[5]]])
    try:
        lower = np.linalg.cholesky(conic * np.sign(conic[2, 2]))
    except np.linalg.LinAlgError:
        return None
    k = np.linalg.inv(lower.T)
    return k / k[2, 2]


def estimate(correspondences: Correspondences, skew: bool = False) -> ClosedForm:
    """K and poses from views of planes.

    Where the views do not determine all of K, or noise leaves no real camera, assumptions are added one by
    one (skew 0, one focal length, principal point at the image's centre); `info` names them and says why.

    Raises
    ------
    DataError
        Where a view has too few points or all on a line.
    EstimationError
        Where a view's points are not on a plane, where a single view is asked for a skew, and where nothing
        is determined: all views fronto-parallel.
    """
    form = shape.check(correspondences)
    views = correspondences.views
    if not form.planar.all():
        bad = views[int(np.flatnonzero(~form.planar)[0])].id
        raise EstimationError(
            f"view '{bad}' holds points in space; Zhang's closed form takes planes.", "Use 'dlt'."
        )
    if skew:
        shape.require_determined(correspondences, ("fx", "fy", "cx", "cy", "skew"))
    h, gap = _homographies(correspondences, form)
    k, info = intrinsics(h, correspondences, skew)
    poses = pose.from_plane(pose.from_homographies(k, h), form.origins, form.axes)
    matrix = k @ np.c_[poses[0].rotation, poses[0].translation] if len(views) == 1 else None
    info["homography_gap"] = float(gap.min())
    return ClosedForm("zhang", k, poses, None if matrix is None else scaled(matrix), info)


def _homographies(correspondences: Correspondences, form: shape.Shapes) -> tuple[Array, Array]:
    """Homographies (V, 3, 3) from each view's own plane, and their gaps (V,)."""
    count = len(correspondences)
    h, gap = np.zeros((count, 3, 3)), np.zeros(count)
    for index, xyz, uv, w in shape.batches(correspondences.views):
        local = (xyz - form.origins[index][:, None]) @ form.axes[index][..., :2]
        h[index], gap[index], _ = homography.solve(local, uv, w)
    open_ones = np.flatnonzero(~(gap > UNDETERMINED) | ~np.isfinite(h).all((1, 2)))
    if len(open_ones):
        raise EstimationError(
            f"view '{correspondences.views[open_ones[0]].id}': its points leave the homography open "
            "(4 points, no 3 of them on a line, are needed).",
            "Remove the view, or give it more points.",
        )
    return h, gap


def image_centre(correspondences: Correspondences) -> tuple[Array, float, str]:
    """The image's centre (2,) and half diagonal, px, and in words where they are from."""
    if correspondences.image_size is not None:
        size = np.array(correspondences.image_size, float)
        return (size - 1) / 2, float(np.hypot(*size) / 2), "the centre of the image"
    low = np.min([v.uv.min(0) for v in correspondences.views], axis=0)
    high = np.max([v.uv.max(0) for v in correspondences.views], axis=0)
    return (
        (low + high) / 2,
        float(np.hypot(*(high - low)) / 2),
        "the middle of all image points (no image size is known)",
    )


def intrinsics(h: Array, correspondences: Correspondences, skew: bool) -> tuple[Array, dict[str, Any]]:
    """K from homographies (V, 3, 3), with the fewest assumptions that leave a real, plausible camera."""
    centre, radius, where = image_centre(correspondences)
    to_unit = np.array(
        [[1 / radius, 0, -centre[0] / radius], [0, 1 / radius, -centre[1] / radius], [0, 0, 1]]
    )
    h = to_unit @ h
    size = np.sqrt((h[..., :2] ** 2).sum((1, 2)) / 2)
    equations = constraints(h / size[:, None, None]).reshape(-1, 6)
    why: list[str] = []
    for rung in LADDER[0 if skew else 1 :]:
        said = [a.format(centre=where) for a in rung.assumptions]
        label = ", ".join(said) or "nothing assumed"
        _, singular, vt = np.linalg.svd(equations @ rung.basis, full_matrices=True)
        if len(singular) < rung.unknowns or singular[rung.unknowns - 1] < UNDETERMINED * np.sqrt(len(h)):
            why.append(f"{label}: the views do not determine it")
            continue
        k = camera_matrix(rung.basis @ vt[-1])
        if k is None:
            why.append(f"{label}: the conic is not positive definite")
            continue
        if np.abs(k[:2, 2]).max() > 2:
            why.append(f"{label}: the principal point is far outside the image")
            continue
        condition = float(singular[0] / singular[rung.unknowns - 1])
        info = {
            "assumptions": said,
            "rejected": why,
            "condition": condition,
            "degenerate": False,
            "mirrored": False,
        }
        return np.linalg.inv(to_unit) @ k, info
    raise EstimationError(
        f"{len(h)} view{'s' * (len(h) > 1)} of a plane, parallel to the image, leave the focal length open.",
        "Tilt the target against the camera by 20 to 45 degrees, in different directions.",
    )
