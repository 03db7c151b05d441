"""The calibration as a least squares problem: residuals, Jacobian blocks, retraction.

    minimise  ½ Σ_views Σ_points w |project(params, exp(δ) R x + t) − u|²                                 (1)

The Jacobian is never stored. Views are taken a few at a time; their derivatives are written as rows of an
array (views, parameters + 6 + 1, 2, points) that stays in the cache, the last row being the residual, and a
batched product of that array with its own transpose gives every normal matrix, gradient and cost at once.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from camcal.data.observations import View
from camcal.geometry import rotations
from camcal.model.lenses.base import Lens
from camcal.model.pose import Poses
from camcal.solve import local
from camcal.solve.calibration import NormalBlocks

Array = np.ndarray

#: numbers in the Jacobian rows of a group of views; as doubles they fill a second-level cache of 1 MB, and each
#: numpy call is long enough that its own cost hardly counts
_ROW_BUDGET = 120_000


@dataclass(frozen=True)
class State:
    """Where the iteration stands.

    Attributes
    ----------
    params : (P,) array
    rotations : (V, 3, 3) array
    centres : (V, 3) array
        The centroid of each view's points in the camera's frame.
    shape : (B,) array
        Coordinates of the board's shape, where that is estimated too.
    """

    params: Array
    rotations: Array
    centres: Array
    shape: Array = field(default_factory=lambda: np.zeros(0))


@dataclass(frozen=True)
class Step:
    """A step in the free parameters (F,), those of the board's shape last, and in the poses (V, 6) =
    (rotation on the left, translation).
    """

    intrinsics: Array
    poses: Array


@dataclass(frozen=True)
class Blocks:
    """The normal equations at a state, by blocks: `JᵀJ` and the gradient `Jᵀr` of half the cost's square.

    Attributes
    ----------
    cost : float
        ½ Σ w |r|².
    intrinsics : (F, F) array
    coupling : (V, F, 6) array
    poses : (V, 6, 6) array
    gradient : (F,) array
    pose_gradients : (V, 6) array
    view_costs : (V,) array
    """

    cost: float
    intrinsics: Array
    coupling: Array
    poses: Array
    gradient: Array
    pose_gradients: Array
    view_costs: Array

    def normal(self) -> NormalBlocks:
        """The part that a covariance needs."""
        return NormalBlocks(self.intrinsics, self.coupling, self.poses)


@dataclass(frozen=True)
class Group:
    """Views that are worked on together; shorter ones are filled up with points of weight 0."""

    members: Array  #: (G,) indices of the views
    xyz: Array  #: (G, 3, N) points relative to the view's centroid
    uv: Array  #: (G, 2, N)
    weights: Array | None  #: (G, 1, 1, N) square roots of the weights, None = 1
    ids: Array | None = None  #: (G, N) which point of the board each is, where that has a shape

    def alone(self, index: int) -> Group:
        """One of the views as a group."""
        at = slice(index, index + 1)
        return Group(
            self.members[at],
            self.xyz[at],
            self.uv[at],
            None if self.weights is None else self.weights[at],
            None if self.ids is None else self.ids[at],
        )


class Problem:
    """Correspondences and a lens model as a least squares problem.

    Parameters
    ----------
    lens : Lens
    views : sequence of View
    free : (P, F) array
        d params / d free parameters. A row of zeros fixes a parameter, several entries in a column tie them.
    weights : sequence of (N,) arrays, optional
        Weight of each point's squared residual; default 1 / sigma² where a view has sigmas, else 1.
    normalise : bool
        False to leave each view's points where they are, so that a rotation turns about the data's origin in
        place of the view's centroid, and to damp and solve without scaling the columns: for comparison.
    """

    def __init__(
        self,
        lens: Lens,
        views: Sequence[View],
        free: Array,
        weights: Sequence[Array] | None = None,
        normalise: bool = True,
    ):
        self.lens = lens
        self.views = tuple(views)
        self.free = np.asarray(free, float)
        self.weights = weights if weights is not None else _default_weights(self.views)
        self.normalise = normalise
        self.offsets = np.array([v.xyz.sum(0) / len(v) for v in self.views]).reshape(-1, 3)
        if not normalise:
            self.offsets[:] = 0.0
        self.rows = lens.size + 7
        self.groups = self._make_groups()
        self._largest = max((g.uv.size for g in self.groups), default=0) * self.rows
        scale = max((float(np.abs(g.uv).max()) for g in self.groups), default=1.0)
        #: a cost that rounding alone produces: a few units in the last place of each coordinate; of each view
        self.view_rounding = np.array([len(v) for v in self.views]) * (4 * np.finfo(float).eps * scale) ** 2
        self.rounding = float(self.view_rounding.sum())

    def reweighted(self, weights: Sequence[Array]) -> Problem:
        """The same problem with other weights."""
        return Problem(self.lens, self.views, self.free, weights, self.normalise)

    def normalised(self) -> Problem:
        """The same problem with `normalise`."""
        return Problem(self.lens, self.views, self.free, self.weights)

    @property
    def point_coordinates(self) -> Array | None:
        """Which coordinates of a board's points are free (B,), where these are the last of the variables; else None."""
        return None

    @property
    def variables(self) -> int:
        """Number of free parameters F, those of the board's shape included."""
        return self.free.shape[1]

    # ------------------------------------------------------------------ states
    def state(self, params: Array, poses: Poses) -> State:
        """Begin at these parameters and poses (cam_from_board)."""
        centres = np.einsum("vij,vj->vi", poses.rotations, self.offsets) + poses.translations
        return State(np.array(params, float), np.array(poses.rotations, float), centres)

    def poses(self, state: State) -> Poses:
        """The poses (cam_from_board) of a state."""
        shift = np.einsum("vij,vj->vi", state.rotations, self.offsets)
        return Poses(state.rotations, state.centres - shift)

    def retract(self, state: State, step: Step) -> State:
        """Move: params + T δ, exp(δ) R, t + δ."""
        own = self.free.shape[1]
        return State(
            state.params + self.free @ step.intrinsics[:own],
            rotations.exp(step.poses[:, :3]) @ state.rotations,
            state.centres + step.poses[:, 3:],
            state.shape + step.intrinsics[own:],
        )

    # ------------------------------------------------------------------ evaluation
    def linearise(self, state: State) -> Blocks | None:
        """The normal equations at a state; None where a point leaves the lens's domain."""
        if self.lens.local:
            sums = local.products(self.lens, state.params, state.rotations, state.centres, self._all_points)
            return None if sums is None else self._assembled(*sums, state)
        normal = self.view_normals(state)
        return None if normal is None else self.blocks(normal, state)

    @cached_property
    def _all_points(self) -> local.Points:
        xyz = [v.xyz - offset for v, offset in zip(self.views, self.offsets, strict=True)]
        return local.Points.of(xyz, [v.uv for v in self.views], self.weights)

    def view_normals(self, state: State) -> Array | None:
        """Products of the rows (parameters, rotation, translation, residual) of each view, (V, R, R).

        None where a point leaves the lens's domain.
        """
        normal = np.empty((len(self.views), self.rows, self.rows))
        scratch = self.scratch()
        with np.errstate(all="ignore"):
            for group in self.groups:
                block = self.fill(group, state, scratch)
                if block is None:
                    return None
                normal[group.members] = products(block)
        return normal

    def pose_normals(self, state: State, members: Array) -> Array:
        """Products of the rows (rotation, translation, residual) of some views (M,), (M, 7, 7).

        NaN for a view where a point leaves the lens's domain.
        """
        normal = np.full((len(self.views), 7, 7), np.nan)
        wanted = np.zeros(len(self.views), bool)
        wanted[members] = True
        scratch = self.scratch()
        with np.errstate(all="ignore"):
            for group in self.groups:
                if wanted[group.members].any():
                    for part, block in self._inside(group, state, scratch):
                        normal[part.members] = products(block[:, self.lens.size :])
        return normal[members]

    def _inside(self, group: Group, state: State, scratch: Array) -> Iterator[tuple[Group, Array]]:
        """The rows of a group; where a point leaves the lens's domain, those of each view that stays inside."""
        block = self.fill(group, state, scratch)
        if block is not None:
            yield group, block
            return
        for alone in map(group.alone, range(len(group.members))):
            block = self.fill(alone, state, scratch)
            if block is not None:
                yield alone, block

    def points(self, group: Group, state: State) -> Array:
        """Points (G, 3, N) of a group relative to their views' centroids."""
        return group.xyz

    def scratch(self) -> Array:
        """Memory for the rows of any one group, to be written by `fill`: one piece for a whole pass."""
        return np.empty(self._largest)

    def fill(self, group: Group, state: State, scratch: Array | None = None) -> Array | None:
        """The rows (G, P + 6 + 1, 2, N) of a group: parameters, rotation, translation, residual.

        None where a point leaves the lens's domain. The rows lie in `scratch` where that is given.
        """
        size, p = group.uv.shape, self.lens.size
        shape = size[0], self.rows, 2, size[2]
        block = np.empty(shape) if scratch is None else scratch[: math.prod(shape)].reshape(shape)
        turned = state.rotations[group.members] @ self.points(group, state)
        cam = turned + state.centres[group.members][:, :, None]
        x, y, z = (np.ascontiguousarray(cam[:, i]) for i in range(3))
        d_xyz = block[:, p + 3 : p + 6]
        if not self.lens.linearise(state.params, x, y, z, block[:, -1], d_xyz, block[:, :p]):
            return None
        block[:, -1] -= group.uv
        # x_cam moves by δ x (R x): the rotation's columns are (R x) x d_xyz
        tx, ty, tz = (turned[:, i, None] for i in range(3))
        dx, dy, dz = d_xyz[:, 0], d_xyz[:, 1], d_xyz[:, 2]
        np.subtract(ty * dz, tz * dy, out=block[:, p])
        np.subtract(tz * dx, tx * dz, out=block[:, p + 1])
        np.subtract(tx * dy, ty * dx, out=block[:, p + 2])
        if group.weights is not None:
            block *= group.weights
        return block

    def free_rows(self, group: Group, state: State) -> Array | None:
        """The rows (G, F + 6 + 1, 2 N) of a group: free parameters, rotation, translation, residual."""
        block = self.fill(group, state)
        if block is None:
            return None
        p = self.lens.size
        own = np.einsum("pf,gpdn->gfdn", self.free, block[:, :p])
        return np.concatenate([own, block[:, p:]], 1).reshape(len(block), own.shape[1] + 7, -1)

    def blocks(self, normal: Array, state: State) -> Blocks | None:
        """Add the views up and pass to the free parameters."""
        p = self.lens.size
        return self._assembled(normal[:, :p, :p].sum(0), normal[:, :p, p:], normal[:, p:, p:], state)

    def _assembled(self, intrinsics: Array, coupling: Array, poses: Array, state: State) -> Blocks | None:
        """From sums over the parameters (P, P), and by view with pose and residual (V, P, 7), (V, 7, 7)."""
        free = self.free
        view_costs = 0.5 * poses[:, -1, -1]
        cost, gradient = float(view_costs.sum()), coupling[:, :, -1].sum(0)
        prior = self.lens.prior(state.params)
        if prior is not None:
            r, j = prior
            cost += 0.5 * float(r @ r)
            intrinsics, gradient = intrinsics + j.T @ j, gradient + j.T @ r
        if not np.isfinite(cost):
            return None
        return Blocks(
            cost,
            free.T @ intrinsics @ free,
            free.T @ coupling[:, :, :6],
            poses[:, :6, :6],
            free.T @ gradient,
            poses[:, :6, -1],
            view_costs,
        )

    # ------------------------------------------------------------------ groups
    def _make_groups(self) -> list[Group]:
        order = np.argsort([len(v) for v in self.views], kind="stable")
        groups, begin = [], 0
        while begin < len(order):
            longest = len(self.views[order[begin]])
            end = begin + 1
            while end < len(order):
                longest = max(longest, len(self.views[order[end]]))
                if (end + 1 - begin) * longest * 2 * self.rows > _ROW_BUDGET:
                    break
                end += 1
            groups.append(self._group(order[begin:end]))
            begin = end
        return groups

    def _group(self, members: Array) -> Group:
        chosen = [self.views[i] for i in members]
        counts = np.array([len(v) for v in chosen])
        xyz = _stacked([v.xyz for v in chosen], counts)
        if self.weights is None and (counts == counts[0]).all():
            root = None
        else:
            given = (
                [np.ones(c) for c in counts] if self.weights is None else [self.weights[i] for i in members]
            )
            padded = np.zeros((len(members), counts.max()))
            for row, w in zip(padded, given, strict=True):
                row[: len(w)] = np.sqrt(w)
            root = None if (padded == 1.0).all() else padded[:, None, None, :]
        return Group(
            members,
            np.ascontiguousarray((xyz - self.offsets[members][:, None]).transpose(0, 2, 1)),
            np.ascontiguousarray(_stacked([v.uv for v in chosen], counts).transpose(0, 2, 1)),
            root,
        )


def products(block: Array) -> Array:
    """Products (G, R, R) of the rows (G, R, 2, N) of each view.

    The last row is left out on one side: a product of a matrix with its own transpose goes to BLAS's syrk, which
    for matrices as small as these takes twice the time of a general one.
    """
    flat = block.reshape(*block.shape[:2], -1)
    found = np.empty((len(flat), flat.shape[1], flat.shape[1]))
    np.matmul(flat[:, :-1], flat.transpose(0, 2, 1), out=found[:, :-1])
    found[:, -1, :-1] = found[:, :-1, -1]
    last = flat[:, -1]
    found[:, -1, -1] = (last[:, None] @ last[:, :, None])[:, 0, 0]
    return found


def _stacked(arrays: list[Array], counts: Array) -> Array:
    """Arrays (N, d) of views as one (G, max N, d), the shorter ones filled up with their first row."""
    if (counts == counts[0]).all():
        return np.stack(arrays)
    return np.stack([np.r_[a, np.repeat(a[:1], counts.max() - len(a), 0)] for a in arrays])


def _default_weights(views: Sequence[View]) -> list[Array] | None:
    if all(v.sigma is None for v in views):
        return None
    return [np.ones(len(v)) if v.sigma is None else v.sigma**-2.0 for v in views]
