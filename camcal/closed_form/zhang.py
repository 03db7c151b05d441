"""Zhang's closed form: K from the homographies of planes, then their poses.

Z. Zhang, A flexible new technique for camera calibration, PAMI 22 (2000). The boards may lie in any plane of
their frame; nearly flat ones are projected onto their best plane. docs/closed-forms.md has the equations.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from camcal.closed_form import conic, pose, shape
from camcal.closed_form.base import ClosedForm, scaled
from camcal.errors import EstimationError
from camcal.geometry import homography
from camcal.types import Correspondences, Poses

Array = np.ndarray

#: A singular value below this part of the largest possible one counts as 0: what rounding leaves of it.
UNDETERMINED = 1e-8
#: A homography whose gap is below this is open: second moments keep half of the digits.
OPEN = 1e-6
#: A focal length with a larger relative standard deviation than this is not taken as determined.
UNCERTAIN = 0.2
#: Perspective is there when the vanishing lines of the planes, all views together, stand out of the noise by
#: this factor (1 is expected of planes parallel to the image).
VISIBLE = 3.0
#: Below this a view's pose has a second minimum nearly as good, and both are searched.
AMBIGUOUS = 10.0
#: The principal point of a plausible camera, from the image's centre, in half diagonals.
FAR_OUTSIDE = 2.0
#: Planes whose normals differ by less than this, degrees, count as parallel: the second adds nothing to the
#: first (Zhang 2000, section 4).
PARALLEL = 3.0
#: Noise of the image points where there are no more equations than unknowns to tell it, px.
UNKNOWN_NOISE = 0.1


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


@dataclass(frozen=True)
class Planes:
    """Homographies of all views from their own planes, with what is known of their errors.

    Attributes
    ----------
    h : (V, 3, 3) array
    covariances : (V, 9, 9) array
        Of the entries of h by rows, noise included.
    gap : float
        The smallest gap of the homographies' equations.
    perspective : (V,) array
        Root mean square over both axes of h3's slope against its standard deviation.
    """

    h: Array
    covariances: Array
    gap: float
    perspective: Array

    @property
    def visible(self) -> float:
        """The perspective of all views together."""
        return float(np.sqrt((self.perspective**2).mean()))


def estimate(correspondences: Correspondences, skew: bool = False) -> ClosedForm:
    """K and poses from views of planes.

    Where the views do not determine all of K, or noise leaves no real camera, assumptions are added one by
    one (skew 0, one focal length, principal point at the image's centre). `info` holds `assumptions`,
    `rejected` (why weaker assumptions were left), `condition` and `focal_uncertainty` of the equations that
    were solved, `perspective` (against its noise), `tilt_spread_deg` (the largest angle of a plane against
    the first), and `degenerate`: a sentence on why the data hardly determine the camera, or False.

    Raises
    ------
    DataError
        Where a view has too few points or all on a line.
    EstimationError
        Where a view's points are not on a plane, where too few views are asked for a skew, and where nothing
        is determined: all views parallel to the image.
    """
    form = shape.check(correspondences)
    views = correspondences.views
    if not form.planar.all():
        bad = views[int(np.flatnonzero(~form.planar)[0])].id
        raise EstimationError(
            f"view '{bad}' holds points in space; Zhang's closed form takes planes.",
            "Use the closed form 'dlt'.",
        )
    if skew:
        shape.require_determined(correspondences, ("fx", "fy", "cx", "cy", "skew"))
    planes = _planes(correspondences, form)
    k, info = _intrinsics(planes, correspondences, skew)
    poses = pose.from_plane(pose.from_homographies(k, planes.h), form.origins, form.axes)
    poses = _choose_minima(poses, np.flatnonzero(planes.perspective < AMBIGUOUS), k, correspondences)
    info["tilt_spread_deg"] = _tilt_spread(poses.rotations, form)
    if len(views) > 1 and info["tilt_spread_deg"] < PARALLEL:
        info["degenerate"] = (
            f"all {len(views)} planes are parallel to each other within "
            f"{info['tilt_spread_deg']:.1f} degrees: together they say no more than one view"
        )
    matrix = None
    if len(views) == 1:
        matrix = scaled(k @ np.c_[poses.rotations[0], poses.translations[0]])
    return ClosedForm("zhang", k, poses, matrix, info)


def _choose_minima(poses: Poses, weak: Array, k: Array, correspondences: Correspondences) -> Poses:
    """Search both minima of the poses of views with little perspective; homographies take either by noise."""
    if not len(weak):
        return poses
    views = tuple(correspondences.views[i] for i in weak)
    found = pose.poses_for(k, Correspondences(views))
    r, t = poses.rotations.copy(), poses.translations.copy()
    r[weak], t[weak] = found.rotations, found.translations
    return Poses(r, t)


def _planes(correspondences: Correspondences, form: shape.Shapes) -> Planes:
    """The homography of each view from the axes of its own plane."""
    views = correspondences.views
    count = len(views)
    h, covariances = np.zeros((count, 3, 3)), np.zeros((count, 9, 9))
    gap, cost, peak = np.zeros(count), np.zeros(count), 0.0
    for index, xyz, uv, w in shape.batches(views):
        local = (xyz - form.origins[index][:, None]) @ form.axes[index][..., :2]
        equations = homography.Equations.of(local, uv, w)
        h[index], gap[index], cost[index] = equations.solve(steps=1)
        poor = index[~(gap[index] > OPEN)]
        if len(poor):
            raise EstimationError(
                f"view '{views[poor[0]].id}': its points leave the homography open "
                "(4 points, no 3 of them on a line, are needed).",
                "Remove the view, or give it more points.",
            )
        _require_in_front([views[i].id for i in index], h[index], local)
        peak = max(peak, np.abs(uv).max())
        covariances[index] = equations.covariances(h[index])
    # what rounding leaves of exact data: 1e-10 of the coordinates, as measured with margin
    covariances *= max(_variance(correspondences, cost.sum()), (1e-10 * peak) ** 2)
    return Planes(h, covariances, float(gap.min()), _perspective(h, covariances))


def _variance(correspondences: Correspondences, cost: float) -> float:
    """The variance of unit weight, px², from the residuals of all homographies together."""
    surplus = 2 * correspondences.point_count - 8 * len(correspondences)
    if surplus > 0:
        return cost / surplus
    return UNKNOWN_NOISE**2 if correspondences.views[0].sigma is None else 1.0


def _tilt_spread(rotations: Array, form: shape.Shapes) -> float:
    """The largest angle between the normal of the first plane and another's, degrees."""
    normals = np.einsum("vij,vj->vi", rotations, form.axes[..., 2])
    normals = normals * np.where(normals[:, 2:] < 0, -1.0, 1.0)
    across = np.linalg.norm(np.cross(normals, normals[0]), axis=1)
    return float(np.degrees(np.arctan2(across, normals @ normals[0]).max()))


def _perspective(h: Array, covariances: Array) -> Array:
    """How far the planes' vanishing lines stand out of the noise; about 1 for fronto-parallel planes."""
    slope = h[:, 2, :2] / h[:, 2, 2:]
    jacobian = np.zeros((len(h), 2, 9))
    jacobian[:, 0, 6] = jacobian[:, 1, 7] = 1 / h[:, 2, 2]
    jacobian[:, :, 8] = -slope / h[:, 2, 2:]
    noise = jacobian @ covariances @ np.swapaxes(jacobian, 1, 2)
    squares = np.einsum("vi,vi->v", slope, np.linalg.solve(noise, slope[..., None])[..., 0])
    return np.sqrt(squares / 2)


def _require_in_front(ids: list[str], h: Array, local: Array) -> None:
    """Raise where a plane's points come to lie on both sides of the camera."""
    depth = np.einsum("vnk,vk->vn", local, h[:, 2, :2]) + h[:, 2, 2:]
    behind = (depth <= 0).sum(1)
    bad = np.flatnonzero(behind > shape.BEHIND * local.shape[1])
    if len(bad):
        raise shape.behind_camera(ids[bad[0]], int(behind[bad[0]]), local.shape[1])


def image_centre(correspondences: Correspondences) -> tuple[Array, float, str]:
    """The image's centre (2,) and half diagonal, px, and in words where they are from."""
    if correspondences.image_size is not None:
        size = np.array(correspondences.image_size, float)
        return (size - 1) / 2, float(np.hypot(*size) / 2), "the centre of the image"
    low = np.min([v.uv.min(0) for v in correspondences.views], axis=0)
    high = np.max([v.uv.max(0) for v in correspondences.views], axis=0)
    where = "the middle of all image points (no image size is known)"
    return (low + high) / 2, float(np.hypot(*(high - low)) / 2), where


def _intrinsics(planes: Planes, correspondences: Correspondences, skew: bool) -> tuple[Array, dict[str, Any]]:
    """K with the fewest assumptions that leave a real, plausible and determined camera."""
    count = len(planes.h)
    if planes.visible < VISIBLE:
        raise _fronto_parallel(
            count,
            f"their perspective is {planes.visible:.1f} times its noise, at least {VISIBLE:g} is needed",
        )
    centre, radius, where = image_centre(correspondences)
    to_unit = np.diag([1 / radius, 1 / radius, 1.0])
    to_unit[:2, 2] = -centre / radius
    # each homography scaled so that h1 and h2 have unit length on the average: equations of equal weight
    h = to_unit @ planes.h
    size = np.sqrt((h[..., :2] ** 2).sum((1, 2)) / 2)[:, None, None]
    h = h / size
    turn = np.kron(to_unit, np.eye(3))
    covariances = turn @ (planes.covariances / size**2) @ turn.T
    equations = conic.constraints(h)
    rejected: list[str] = []
    best: tuple[Array, dict[str, Any]] | None = None
    for rung in LADDER[0 if skew else 1 :]:
        said = [a.format(centre=where) for a in rung.assumptions]
        x, singular = conic.smallest(equations.reshape(-1, 6) @ rung.basis)
        b = rung.basis @ x
        k, reason = _plausible(b, singular, rung, count)
        if k is None:
            rejected.append(f"{', '.join(said) or 'nothing assumed'}: {reason}")
            continue
        sigma = conic.focal_uncertainty(b, rung.basis, h, covariances)
        info = {
            "assumptions": said,
            "rejected": rejected,
            "condition": float(singular[0] / singular[-2]),
            "focal_uncertainty": sigma,
            "homography_gap": planes.gap,
            "perspective": planes.visible,
            "mirrored": False,
            "degenerate": f"the focal length is uncertain by {sigma:.0%}" if sigma > UNCERTAIN else False,
        }
        if best is None or sigma < best[1]["focal_uncertainty"]:
            best = np.linalg.inv(to_unit) @ k, info
        if sigma <= UNCERTAIN:
            return best
        rejected.append(
            f"{', '.join(said) or 'nothing assumed'}: the focal length is uncertain by {sigma:.0%}"
        )
    if best is None:
        reason = rejected[-1].rsplit(": ", 1)[1]
        raise _fronto_parallel(count, f"even with one focal length and a fixed principal point {reason}")
    return best


def _plausible(b: Array, singular: Array, rung: Rung, count: int) -> tuple[Array | None, str]:
    """K of a conic where it is determined, real and has its principal point near the image; else why not."""
    if 2 * count < rung.unknowns:
        return None, f"{count} view{'s' * (count > 1)} leave{'s' * (count == 1)} it open"
    if singular[-2] < UNDETERMINED * np.sqrt(count):
        return None, "the views leave it open"
    k = conic.camera_matrix(b)
    if k is None:
        return None, "no real camera fits (the conic is not positive definite)"
    if np.abs(k[:2, 2]).max() > FAR_OUTSIDE:
        return None, "the principal point comes out far outside the image"
    return k, ""


def _fronto_parallel(count: int, found: str) -> EstimationError:
    views = "1 view of a plane leaves" if count == 1 else f"{count} views of planes leave"
    return EstimationError(
        f"{views} the focal length open; too nearly parallel to the image: {found}.",
        "Tilt the target against the camera by 20 to 45 degrees, in different directions.",
    )
