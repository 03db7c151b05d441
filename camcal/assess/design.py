"""The linearised problem at a solution, view by view: Jacobian rows, normal matrices, leverage.

With J_v = [F_v P_v] the rows of view v (camera's free parameters; pose), weighted, and U_v = F_vᵀF_v,
W_v = F_vᵀP_v, A_v = P_vᵀP_v, B_v = A_v⁻¹ W_vᵀ, the pose of a view is eliminated:

    S_v = U_v - W_v B_v,    g_v = F_vᵀ r_v - B_vᵀ P_vᵀ r_v,    S = Σ S_v                                 (1)

S_v is the information that the view holds on the camera, g_v the direction in which it pulls (Σ g_v = 0 at
the optimum). The residuals after the fit are the noise less what the fit took, cov(r) = sigma_0² (I - H) with

    H_v = (F_v - P_v B_v) S⁻¹ (F_v - P_v B_v)ᵀ + P_v A_v⁻¹ P_vᵀ                                         (2)

within a view. Where a board's shape was estimated, it counts as known here.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property

import numpy as np

from camcal.assess.covariance import eliminate_poses, invert_determined
from camcal.assess.figures import sigma_0
from camcal.geometry import rotations
from camcal.model.pose import Poses
from camcal.records import dataclass
from camcal.solve.calibration import Calibration, NormalBlocks
from camcal.solve.problem import Problem

Array = np.ndarray


@dataclass(frozen=True)
class Rows:
    """The rows of one view's used points, weighted by 1 / sigma and the square root of a robust weight.

    Attributes
    ----------
    view : int
    free : (N, 2, F) array
    pose : (N, 2, 6) array
    residuals : (N, 2) array
    roots : (N,) array
        The square roots of the weights, which the rows above have in them.
    """

    view: int
    free: Array
    pose: Array
    residuals: Array
    roots: Array


class Design:
    """The quantities of (1) and (2) for a solution; each is computed on first use."""

    def __init__(self, calibration: Calibration):
        self.calibration = calibration
        self.transform = calibration.free[:, calibration.free.any(0)]
        kept = calibration.observations.kept()
        self.views = kept.views
        weights = kept.precision_by_view
        self.problem = Problem(calibration.camera.lens, kept.views, self.transform, weights)
        self.state = self.problem.state(calibration.camera.params, calibration.poses)
        self.sigma_0 = sigma_0(calibration)

    def moved_poses(self, views: Array, steps: Array) -> Poses:
        """The poses of some views (K,) moved by steps (K, 6): exp(ω) R, and the centroid by the last three."""
        turned = rotations.exp(steps[:, :3]) @ self.state.rotations[views]
        centres = self.state.centres[views] + steps[:, 3:]
        return Poses(turned, centres - np.einsum("vij,vj->vi", turned, self.problem.offsets[views]))

    @cached_property
    def products(self) -> Array:
        """JᵀJ of each view with the residual as its last column, (V, F + 7, F + 7)."""
        normal = self.problem.view_normals(self.state)
        if normal is None:
            raise ValueError("a used point lies outside the lens's domain")
        p, f = self.problem.lens.size, self.transform.shape[1]
        wide = np.zeros((p + 7, f + 7))
        wide[:p, :f] = self.transform
        wide[p:, f:] = np.eye(7)
        return np.asarray(wide.T @ normal @ wide)

    @cached_property
    def normal(self) -> NormalBlocks:
        """The blocks of the conditional problem (the board's shape known)."""
        f = self.transform.shape[1]
        whole = self.products
        return NormalBlocks(whole[:, :f, :f].sum(0), whole[:, :f, f : f + 6], whole[:, f : f + 6, f : f + 6])

    @cached_property
    def poses(self):  # type: ignore[no-untyped-def]
        """A_v⁻¹ and B_v, see `covariance.ReducedPoses`."""
        return eliminate_poses(self.normal)

    @cached_property
    def information(self) -> Array:
        """S_v of (1), (V, F, F)."""
        f = self.transform.shape[1]
        own = self.products[:, :f, :f] - self.normal.coupling @ self.poses.gain
        return (own + own.transpose(0, 2, 1)) / 2

    @cached_property
    def pull(self) -> Array:
        """g_v of (1), (V, F)."""
        f = self.transform.shape[1]
        pose_gradient = self.products[:, f : f + 6, -1]
        return np.asarray(self.products[:, :f, -1] - np.einsum("vif,vi->vf", self.poses.gain, pose_gradient))

    @cached_property
    def inverse(self) -> Array:
        """S⁻¹ over the determined directions, (F, F), for unit weight."""
        total = self.information.sum(0)
        return invert_determined(total, np.diag(self.normal.intrinsics))[0]

    def rows(self) -> Iterator[Rows]:
        """The rows of each view, in the groups of the problem."""
        lens, f = self.problem.lens, self.transform
        for group in self.problem.groups:
            block = self.problem.fill(group, self.state)
            if block is None:
                raise ValueError("a used point lies outside the lens's domain")
            for place, member in enumerate(group.members):
                count = len(self.views[member])
                own = block[place][:, :, :count]
                yield Rows(
                    int(member),
                    np.einsum("pcn,pf->ncf", own[: lens.size], f),
                    own[lens.size : lens.size + 6].transpose(2, 1, 0).copy(),
                    own[-1].T.copy(),
                    np.ones(count) if group.weights is None else group.weights[place, 0, 0, :count],
                )

    def along(self, field: Array) -> tuple[Array, Array]:
        """Products of the rows with a displacement of the points.

        Parameters
        ----------
        field : (N, 2) array
            Of the points of `views`, one view after the other; px, without weights.

        Returns
        -------
        products : (V, F + 7) array
            Jᵀ o and rᵀ o, in the order of `products`, of the weighted displacements o.
        squares : (V,) array
            oᵀ o.
        """
        p, f = self.problem.lens.size, self.transform.shape[1]
        found, squares = np.empty((len(self.views), f + 7)), np.empty(len(self.views))
        lengths = np.array([len(v) for v in self.views])
        starts = lengths.cumsum() - lengths
        for group in self.problem.groups:
            block = self.problem.fill(group, self.state)
            if block is None:
                raise ValueError("a used point lies outside the lens's domain")
            number = np.arange(group.uv.shape[2])
            inside = number < lengths[group.members, None]
            place = np.where(inside, starts[group.members, None] + number, 0)
            off = np.where(inside[:, None], field[place].transpose(0, 2, 1), 0.0)
            if group.weights is not None:
                off *= group.weights[:, 0]
            off = off.reshape(len(off), -1)
            by_row = (block.reshape(*block.shape[:2], -1) @ off[..., None])[..., 0]
            found[group.members] = np.c_[by_row[:, :p] @ self.transform, by_row[:, p:]]
            squares[group.members] = np.square(off).sum(1)
        return found, squares

    def of_camera(self, rows: Rows) -> Array:
        """F_v - P_v B_v (N, 2, F): the effect of the camera once the pose has followed."""
        return np.asarray(rows.free - rows.pose @ self.poses.gain[rows.view])

    def hat(self, rows: Rows, first: Array | None = None, second: Array | None = None) -> Array:
        """Blocks (K, 2, 2) of H_v of (2) between points `first` and `second` (K,); by default the diagonal."""
        own = self.of_camera(rows)
        a, b = (slice(None) if i is None else i for i in (first, second))
        by_camera = own[a] @ self.inverse @ own[b].transpose(0, 2, 1)
        by_pose = rows.pose[a] @ self.poses.inverse[rows.view] @ rows.pose[b].transpose(0, 2, 1)
        return np.asarray(by_camera + by_pose)
