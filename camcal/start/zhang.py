"""Zhang's closed form: K from the homographies of planes, then their poses.

Z. Zhang, A flexible new technique for camera calibration, PAMI 22 (2000). The boards may lie in any plane of
their frame; nearly flat ones are projected onto their best plane. docs/closed-forms.md has the equations.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from camcal.data.observations import Correspondences
from camcal.errors import CamcalError, EstimationError, caught, only
from camcal.geometry import homography
from camcal.model.pose import Poses
from camcal.records import dataclass
from camcal.start import assumptions, pose, shape
from camcal.start.base import ClosedForm, scaled

Array = np.ndarray

#: A homography whose gap is below this is undetermined: second moments have half of the digits.
UNDETERMINED = 1e-6
#: Perspective is significant if the vanishing lines of the planes, over all views, exceed their noise by this
#: factor (1 is expected for planes parallel to the image).
VISIBLE = 3.0
#: Below this a view's pose has a second minimum nearly as good, and both are searched.
AMBIGUOUS = 10.0
#: Planes whose normals differ by less than this, degrees, count as parallel: the second adds nothing to the
#: first (Zhang 2000, section 4).
PARALLEL = 3.0
#: Assumed noise of the image points if there is no redundancy from which to estimate it, px.
UNKNOWN_NOISE = 0.1
#: of the largest coordinate: rounding error of exact data, as measured, with a margin
ROUNDING = 1e-10


@dataclass(frozen=True)
class Planes:
    """Homographies of all views from their own planes, with their estimated errors.

    Attributes
    ----------
    h : (V, 3, 3) array
    covariances : (V, 9, 9) array
        Of the entries of h by rows, noise included.
    gap : float
        The smallest gap of the homographies' equations.
    perspective : (V,) array
        Root mean square over both axes of h3's slope relative to its standard deviation.
    """

    h: Array
    covariances: Array
    gap: float
    perspective: Array

    @property
    def visible(self) -> float:
        """The combined perspective of all views."""
        return float(np.sqrt((self.perspective**2).mean()))


def estimate(correspondences: Correspondences, skew: bool = False, normalise: bool = True) -> ClosedForm:
    """K and poses from views of planes.

    If the views do not determine all of K, or no real camera exists because of noise, assumptions are added one by
    one (skew 0, one focal length, principal point at the image's centre).

    Returns
    -------
    ClosedForm
        Its `info` holds, besides `mirrored` and `condition` (of the equations that were solved):

        - `assumptions`, and `held`: the same as `--fix` names them, without the skew;
        - `rejected`: why weaker assumptions were rejected;
        - `focal_uncertainty`, relative; `perspective`, relative to its noise; `views_weighted`;
        - `tilt_spread_deg`: the largest angle between a plane and the first;
        - `degenerate`: a sentence on why the data hardly determine the camera, or False.

    Raises
    ------
    DataError
        If a view has too few points, or all are collinear.
    EstimationError
        If a view's points are not on a plane, there are too few views to estimate a skew, or nothing is determined
        because all views are parallel to the image.
    """
    return only(estimate_all([correspondences], skew, normalise))


def estimate_all(
    sets: Sequence[Correspondences], skew: bool = False, normalise: bool = True
) -> list[ClosedForm | CamcalError]:
    """`estimate` for many cameras, whose views are processed together; an error in place of a result."""
    found: dict[int, ClosedForm | CamcalError] = {}
    shaped: dict[int, tuple[Correspondences, shape.Shapes]] = {}
    for i, one in enumerate(sets):
        form = caught(_form, one, skew, normalise)
        if isinstance(form, CamcalError):
            found[i] = form
        else:
            shaped[i] = one, form
    begun: dict[int, _Begun] = {}
    for (i, (one, form)), planes in zip(
        shaped.items(), _planes(list(shaped.values()), normalise), strict=True
    ):
        if isinstance(planes, CamcalError):
            found[i] = planes
            continue
        known = caught(_intrinsics, planes, one, skew, normalise)
        if isinstance(known, CamcalError):
            found[i] = known
        else:
            begun[i] = _Begun(one, form, planes, *known)
    for (i, begin), poses in zip(begun.items(), _poses(list(begun.values())), strict=True):
        found[i] = _closed_form(begin, poses)
    return [found[i] for i in range(len(sets))]


class _Begun(NamedTuple):
    """A camera whose matrix is known."""

    correspondences: Correspondences
    form: shape.Shapes
    planes: Planes
    matrix: Array
    info: dict[str, Any]


def _form(correspondences: Correspondences, skew: bool, normalise: bool) -> shape.Shapes:
    """The planes of the views, after checking that there are only planes."""
    form = shape.check(correspondences)
    if not form.planar.all():
        bad = correspondences.views[int(np.flatnonzero(~form.planar)[0])].id
        raise EstimationError(
            f"view '{bad}' holds points in space; Zhang's closed form takes planes.",
            "Use the closed form 'dlt'.",
        )
    if skew:
        shape.require_determined(correspondences, ("fx", "fy", "cx", "cy", "skew"))
    if normalise:
        return form
    normals = form.axes[..., 2]  # the planes and the origins in them remain unchanged
    return replace(form, origins=np.einsum("vi,vi->v", normals, form.origins)[:, None] * normals)


def _closed_form(begun: _Begun, of_planes: Poses) -> ClosedForm:
    form, k, info = begun.form, begun.matrix, begun.info
    poses = pose.from_plane(of_planes, form.origins, form.axes)
    count = len(of_planes)
    info["tilt_spread_deg"] = _tilt_spread(poses.rotations, form)
    if count > 1 and info["tilt_spread_deg"] < PARALLEL:
        info["degenerate"] = (
            f"all {count} planes are parallel to each other to within "
            f"{info['tilt_spread_deg']:.1f} degrees, which makes them equivalent to one view"
        )
    matrix = None
    if count == 1:
        matrix = scaled(k @ np.c_[poses.rotations[0], poses.translations[0]])
    return ClosedForm("zhang", k, poses, matrix, info)


def _poses(begun: Sequence[_Begun]) -> list[Poses]:
    """The poses of the planes of many cameras from their homographies.

    Both minima of planes with little perspective are searched, as noise decides which one the homography yields.
    """
    if not begun:
        return []
    ends = np.cumsum([len(b.planes.h) for b in begun]).tolist()
    owner = np.repeat(np.arange(len(begun)), np.diff(ends, prepend=0))
    inverse = np.linalg.inv([b.matrix for b in begun])
    poses = pose.from_normalised(inverse[owner] @ np.concatenate([b.planes.h for b in begun]))
    weak = np.flatnonzero(np.concatenate([b.planes.perspective for b in begun]) < AMBIGUOUS)
    views = [v for b in begun for v in b.correspondences.views]
    origins, axes = (np.concatenate([getattr(b.form, n) for b in begun]) for n in ("origins", "axes"))
    r, t = poses.rotations.copy(), poses.translations.copy()
    for index, xyz, uv, w in shape.batches([views[i] for i in weak]):
        which = weak[index]
        local = (xyz - origins[which][:, None]) @ axes[which]
        back = inverse[owner[which]]
        ab = uv @ back[:, :2, :2].transpose(0, 2, 1) + back[:, None, :2, 2]
        best = pose.lower_minimum(poses[which], local, ab, w)
        r[which], t[which] = best.rotations, best.translations
    return [
        Poses(r[end - len(b.planes.h) : end], t[end - len(b.planes.h) : end])
        for b, end in zip(begun, ends, strict=True)
    ]


def _planes(
    sets: Sequence[tuple[Correspondences, shape.Shapes]], normalise: bool = True
) -> list[Planes | CamcalError]:
    """The homography of each view from the axes of its own plane."""
    if not sets:
        return []
    views = [v for one, _ in sets for v in one.views]
    ends = np.cumsum([len(one.views) for one, _ in sets]).tolist()
    owner = np.repeat(np.arange(len(sets)), np.diff(ends, prepend=0))
    origins, axes = (np.concatenate([getattr(form, n) for _, form in sets]) for n in ("origins", "axes"))
    count = len(views)
    h, covariances = np.zeros((count, 3, 3)), np.zeros((count, 9, 9))
    gap, cost, peak = np.zeros((3, count))
    failed: dict[int, CamcalError] = {}
    for index, xyz, uv, w in shape.batches(views):
        local = (xyz - origins[index][:, None]) @ axes[index][..., :2]
        equations = homography.Equations.of(local, uv, w, normalise)
        h[index], gap[index], cost[index] = equations.solve(steps=1)
        for i in index[normalise & ~(gap[index] > UNDETERMINED)].tolist():
            failed.setdefault(owner[i], _undetermined(views[i].id))
        for i, behind in _behind(h[index], local):
            failed.setdefault(
                owner[index[i]], shape.behind_camera(views[index[i]].id, behind, local.shape[1])
            )
        peak[index] = np.abs(uv).max((1, 2))
        with np.errstate(all="ignore"):  # those that failed
            covariances[index] = equations.covariances(h[index])
    found: list[Planes | CamcalError] = []
    for i, (one, _) in enumerate(sets):
        rows = slice(ends[i] - len(one.views), ends[i])
        if i in failed:
            found.append(failed[i])
            continue
        noise = max(_variance(one, cost[rows].sum()), (ROUNDING * peak[rows].max()) ** 2)
        own = covariances[rows] * noise
        found.append(Planes(h[rows], own, float(gap[rows].min()), _perspective(h[rows], own)))
    return found


def _undetermined(view: str) -> EstimationError:
    return EstimationError(
        f"view '{view}': its points do not determine the homography "
        "(4 points, no 3 of them on a line, are needed).",
        "Remove the view, or give it more points.",
    )


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
    # the tangent of half the angle is the ratio of the lengths of difference and sum
    apart, together = normals - normals[0], normals + normals[0]
    ratios = np.einsum("vi,vi->v", apart, apart) / np.einsum("vi,vi->v", together, together)
    return float(np.degrees(2 * np.arctan(np.sqrt(ratios.max()))))


def _perspective(h: Array, covariances: Array) -> Array:
    """The significance of the planes' vanishing lines above the noise; about 1 for fronto-parallel planes."""
    slope = h[:, 2, :2] / h[:, 2, 2:]
    jacobian = np.zeros((len(h), 2, 9))
    jacobian[:, 0, 6] = jacobian[:, 1, 7] = 1 / h[:, 2, 2]
    jacobian[:, :, 8] = -slope / h[:, 2, 2:]
    (p, q), (_, r) = (jacobian @ covariances @ np.swapaxes(jacobian, 1, 2)).transpose(1, 2, 0)
    x, y = slope.T
    squares = (r * x * x - 2 * q * x * y + p * y * y) / (p * r - q * q)  # slopeᵀ noise⁻¹ slope
    return np.sqrt(squares / 2)


def _behind(h: Array, local: Array) -> list[tuple[int, int]]:
    """The planes whose points end up on both sides of the camera, and how many are behind it."""
    depth = np.einsum("vnk,vk->vn", local, h[:, 2, :2]) + h[:, 2, 2:]
    behind = (depth <= 0).sum(1)
    return [(int(i), int(behind[i])) for i in np.flatnonzero(behind > shape.BEHIND * local.shape[1])]


def _intrinsics(
    planes: Planes, correspondences: Correspondences, skew: bool, normalise: bool = True
) -> tuple[Array, dict[str, Any]]:
    """K with the fewest assumptions that give a real, plausible and determined camera, and its figures."""
    count = len(planes.h)
    if planes.visible < VISIBLE:
        found = f"their perspective is {planes.visible:.1f} times its noise; at least {VISIBLE:g} is needed"
        raise _fronto_parallel(count, found)
    to_unit, where = assumptions.unit_coordinates(correspondences)
    # each homography scaled so that h1 and h2 have unit length on the average: equations of equal weight
    h = to_unit @ planes.h
    size = np.sqrt((h[..., :2] ** 2).sum((1, 2)) / 2)[:, None, None]
    h = h / size
    turn = np.kron(to_unit, np.eye(3))
    covariances = turn @ (planes.covariances / size**2) @ turn.T
    unit = to_unit[0, 0] if normalise else 1.0
    best, weighted = assumptions.climb(h, covariances, skew, where, to_unit[0, 0] / unit), False
    if best.uncertainty > assumptions.UNCERTAIN and count > 1:
        other = assumptions.climb_weighted(h, covariances, skew, where)
        if other.uncertainty < best.uncertainty:
            best, weighted = other, True
    if best.matrix is None:
        reason = best.rejected[-1].rsplit(": ", 1)[1]
        raise _fronto_parallel(count, f"even with one focal length and a fixed principal point {reason}")
    uncertain = f"the focal length is uncertain by {best.uncertainty:.0%}"
    return np.linalg.inv(to_unit) @ best.matrix, {
        "assumptions": list(best.assumptions),
        "held": list(best.held),
        "rejected": list(best.rejected),
        "condition": best.condition,
        "focal_uncertainty": best.uncertainty,
        "views_weighted": weighted,
        "homography_gap": planes.gap,
        "perspective": planes.visible,
        "mirrored": False,
        "degenerate": uncertain if best.uncertainty > assumptions.UNCERTAIN else False,
    }


def _fronto_parallel(count: int, found: str) -> EstimationError:
    views = "1 view of a plane leaves" if count == 1 else f"{count} views of planes leave"
    return EstimationError(
        f"{views} the focal length undetermined; they are too nearly parallel to the image: {found}.",
        "Tilt the target by 20 to 45 degrees relative to the image plane, in different directions.",
    )
