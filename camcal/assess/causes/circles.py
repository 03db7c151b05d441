"""Circles whose centroids in the image were used as the images of their centres.

The image of a disc of radius r about a point X of a plane is not centred on the image of X. Its centroid is displaced
by

    b r² + O(r⁴),    b = ¼ (½ tr g'' + g' ∇ ln|det g'|)                                                   (1)

with g the map from the plane to the image (Heikkilä, Geometric camera calibration using circular control points, PAMI
22, 2000, gives it in closed form for a pinhole). r² is one number that all views share. With r_i the residuals and H
the hat matrix of the solution, a least squares step gives

    r² = -bᵀ r / bᵀ (I - H) b,    its variance sigma_0² / bᵀ (I - H) b                                    (2)

as the residuals of a solution are orthogonal to the columns of the camera and the poses.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from camcal.assess.design import Design
from camcal.geometry.neighbours import Neighbours
from camcal.model.camera import Camera
from camcal.model.pose import Array, Poses
from camcal.records import dataclass
from camcal.solve.calibration import Calibration

#: Points on an outline, and its radius in parts of the spacing: small enough for (1), large enough for rounding.
OUTLINE, RADIUS = 12, 0.1
TOGETHER = 1000  #: points whose outlines are projected at a time, half a megabyte


@dataclass(frozen=True)
class Circles:
    """The estimate of (2).

    Attributes
    ----------
    radius : float
        r relative to the points' spacing; 0 if r² is negative.
    deviations : float
        r² in standard deviations.
    gain : float
        Decrease of the cost ½ Σ w |r|² by the step.
    params : (P,) array
        Of the camera with circles of that size.
    """

    radius: float
    deviations: float
    gain: float
    params: Array


def circles(solution: Calibration, design: Design | None = None) -> Circles | None:
    """Test the points of a solution for circles; None if the target is known, not planar, or has no neighbours."""
    data = solution.observations
    if (
        (data.target or {}).get("kind") is not None
        or solution.board is not None
        or not data.shapes.planar.all()
    ):
        return None
    design, camera = design or Design(solution), solution.camera
    spacing = _spacing(design.views[0].xyz)
    if not spacing > 0:
        return None
    boards = [v.xyz for v in design.views]
    offsets = np.concatenate(
        list(_centroid_offsets(camera, solution.poses, boards, data.shapes.axes, spacing))
    )
    if not np.isfinite(offsets).all():
        return None
    products, squares = design.along(offsets)
    f = design.transform.shape[1]
    by_pose = products[:, f : f + 6]
    # what the poses take of the displacements
    followed = np.einsum("vij,vj->vi", design.poses.inverse, by_pose)
    pull = (products[:, :f] - np.einsum("vif,vi->vf", design.poses.gain, by_pose)).sum(0)
    along = float(products[:, -1].sum())
    square = float(squares.sum() - (by_pose * followed).sum() - pull @ design.inverse @ pull)
    if not square > 0 or not design.sigma_0 > 0:
        return None
    r2 = -along / square
    # residual + J δ + b r² = 0: the camera's part of δ
    step = -design.inverse @ pull * r2
    return Circles(
        radius=float(np.sqrt(max(r2, 0.0))),
        deviations=r2 * float(np.sqrt(square)) / design.sigma_0,
        gain=0.5 * along**2 / square,
        params=camera.params + design.transform @ step,
    )


def _spacing(xyz: Array) -> float:
    """The median distance of a point from its nearest neighbour; 0 for a single point."""
    return float(np.median(Neighbours(xyz).query(xyz, 2)[0][:, 1])) if len(xyz) > 1 else 0.0


def _centroid_offsets(
    camera: Camera, poses: Poses, views: Sequence[Array], axes: Array, spacing: float
) -> Iterator[Array]:
    """b of (1) (N, 2) of the points of some views at a time, px for a radius of one spacing: the centroid of a small
    outline's image minus its centre's image.

    Parameters
    ----------
    views : sequence of (N, 3) arrays
        Points of the board.
    axes : (V, 3, 3) array
        Of the boards' planes, as columns.
    """
    around = np.arange(OUTLINE) * (2 * np.pi / OUTLINE)
    circle = RADIUS * spacing * np.c_[np.cos(around), np.sin(around)]
    # the second moment of a regular polygon is that of its circle times this
    moment = (2 + np.cos(2 * np.pi / OUTLINE)) / 3
    rims = circle @ (poses.rotations @ axes[:, :, :2]).transpose(0, 2, 1)
    together = max(1, TOGETHER // max(map(len, views), default=1))
    for begin in range(0, len(views), together):
        block = range(begin, min(begin + together, len(views)))
        lengths = [len(views[v]) for v in block]
        view = np.repeat(block, lengths)
        centres = np.concatenate([views[v] @ poses.rotations[v].T + poses.translations[v] for v in block])
        points = np.concatenate([centres[:, None] + rims[view], centres[:, None]], 1)
        seen = camera.project(points.reshape(-1, 3)).reshape(len(centres), -1, 2)
        outline = seen[:, :-1] - seen[:, -1:]
        following = np.roll(outline, -1, 1)
        cross = outline[..., 0] * following[..., 1] - outline[..., 1] * following[..., 0]
        off = ((outline + following) * cross[..., None]).sum(1) / (3 * cross.sum(1))[:, None]
        yield off / (RADIUS**2 * moment)
