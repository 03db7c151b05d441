"""K and poses from the projection matrices of views of points in space (the direct linear transformation)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from camcal.data.observations import Correspondences, View
from camcal.errors import EstimationError
from camcal.geometry import projective
from camcal.geometry.dlt import solve
from camcal.model.pose import Poses
from camcal.start import pose, shape
from camcal.start.base import ClosedForm, scaled

Array = np.ndarray

#: A singular value below this fraction of the largest counts as 0, because of rounding.
UNDETERMINED = 1e-10


def estimate(correspondences: Correspondences, skew: bool = False, normalise: bool = True) -> ClosedForm:
    """K and poses from the projection matrix of each view of points in space.

    With several such views, K is the median of its entries over them; poses of views of planes are computed from it.
    The skew of the matrices is kept in K, whatever `skew` is.

    Raises
    ------
    DataError
        If a view has too few points, or all are collinear.
    EstimationError
        If no view has points in space, the matrix is undetermined, or the points lie behind the camera.
    """
    form = shape.check(correspondences)
    views = correspondences.views
    spatial = np.flatnonzero(~form.planar)
    if not len(spatial):
        raise EstimationError(
            "the points of every view lie on a plane; a DLT needs points in space.",
            "Use the closed form 'zhang'.",
        )
    matrices, condition = _matrices([views[i] for i in spatial], normalise)
    parts = [projective.decompose(m, views[i].xyz) for m, i in zip(matrices, spatial, strict=True)]
    k = np.median([p[0] for p in parts], axis=0)
    mirrored = any(p[3] for p in parts)
    info: dict[str, Any] = {
        "assumptions": [],
        "condition": condition,
        "mirrored": mirrored,
        "degenerate": False,
    }
    if len(views) == 1:
        poses = Poses(parts[0][1][None], parts[0][2][None])
        return ClosedForm("dlt", k, poses, scaled(matrices[0]), info)
    if len(spatial) > 1:
        info["assumptions"] = [f"K is the median over {len(spatial)} views"]
    return ClosedForm("dlt", k, pose.poses_for(k, correspondences), None, info)


def _matrices(views: Sequence[View], normalise: bool = True) -> tuple[Array, float]:
    """Projection matrices (V, 3, 4) of views of points in space, and the largest condition number."""
    matrices, condition = np.zeros((len(views), 3, 4)), 0.0
    for index, xyz, uv, w in shape.batches(views):
        found, singular = solve(xyz, uv, w, normalise)
        poor = index[normalise & (singular[:, 10] <= UNDETERMINED * singular[:, 0])]
        if len(poor):
            raise EstimationError(
                f"view '{views[poor[0]].id}': its {xyz.shape[1]} points do not determine the projection matrix.",
                "Points in general position are needed: 6 different points, no 5 of them on a plane.",
            )
        depth = np.einsum("vnk,vk->vn", projective.homogeneous(xyz), found[:, 2])
        behind = np.minimum((depth <= 0).sum(1), (depth >= 0).sum(1))
        bad = np.flatnonzero(behind > shape.BEHIND * xyz.shape[1])
        if len(bad):
            raise shape.behind_camera(views[index[bad[0]]].id, int(behind[bad[0]]), xyz.shape[1])
        matrices[index] = found
        tiny = np.finfo(float).tiny
        condition = max(condition, float((singular[:, 0] / np.maximum(singular[:, 10], tiny)).max()))
    return matrices, condition
