"""The predicted gain of additional parameters, by one step from the solution: all candidates from one pass over
the data.

The rows of a view's points by the camera's free parameters, its pose, the fields of `camcal.solve.warp` and the
residual give a matrix of products; the pose is eliminated from it (Schur complement), which leaves R_v over (camera,
fields, residual). A candidate with parameters β and θ_v = D_v β then reduces the cost by

    ½ bᵀ A⁻¹ b,   A = Σ_v [I 0; 0 D_v]ᵀ R_v [I 0; 0 D_v],  b its products with the residual               (1)

which is exact for linear problems.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from camcal.geometry.numbers import TINY
from camcal.model.pose import Array
from camcal.records import dataclass
from camcal.solve.calibration import Calibration
from camcal.solve.groups import Group
from camcal.solve.warp import FIELDS, Warp, WarpedProblem

#: least eigenvalue in (1), with the diagonal scaled to 1: undetermined directions gain nothing
_NULL = 1e-10


def problem_of(base: Calibration, warp: Warp) -> WarpedProblem:
    """The problem of a fit with an additional image deformation."""
    data = base.observations.kept()
    weights = data.precision_by_view
    return WarpedProblem(base.camera.lens, data.views, base.free[:, base.free.any(0)], warp, weights)


@dataclass(frozen=True)
class Linear:
    """The reduced products R_v (V, F + K + 1, F + K + 1) of all fields at a solution.

    Attributes
    ----------
    reduced : array
    camera : int
        F, the camera's free parameters.
    cost : float
        Of the solution: ½ Σ w |r|².
    """

    reduced: Array
    camera: int
    cost: float

    @classmethod
    def of(cls, base: Calibration, warp: Warp) -> Linear | None:
        """Of all fields of a warp; None if a point leaves the lens's domain."""
        problem = problem_of(base, warp)
        lens, free, k = problem.cameras[0].lens, problem.free, len(warp.fields)
        p, f = lens.size, free.shape[1]
        state = problem.state(base.camera.params, base.poses)
        found = np.zeros((len(problem.views), f + 6 + k + 1, f + 6 + k + 1))

        def add(group: Group, block: Array) -> None:
            rows = block.reshape(*block.shape[:2], -1)
            fields = problem.fields().reshape(len(block), k, -1)
            own = np.einsum("pf,gpn->gfn", free, rows[:, :p])
            every = np.concatenate([own, rows[:, p:-1], fields, rows[:, -1:]], 1)
            found[group.members] = every @ every.transpose(0, 2, 1)

        if problem.assembled(state, add) is None:
            return None
        pose, rest = np.arange(f, f + 6), np.r_[0:f, f + 6 : f + 6 + k + 1]
        across = found[:, pose[:, None], rest]
        scale = np.sqrt(np.maximum(np.einsum("vii->vi", found[:, pose[:, None], pose]), TINY))
        inner = found[:, pose[:, None], pose] / scale[:, :, None] / scale[:, None, :]
        solved = np.linalg.pinv(inner, rcond=1e-12, hermitian=True) @ (across / scale[:, :, None])
        reduced = found[:, rest[:, None], rest] - (across / scale[:, :, None]).transpose(0, 2, 1) @ solved
        return cls(reduced, f, 0.5 * float(found[:, -1, -1].sum()))

    @cached_property
    def _known(self) -> tuple[Array, float]:
        """W with W Wᵀ the inverse of the camera's own equations, and the gain of these alone."""
        f = self.camera
        values, vectors, scale = _scaled(self.reduced[:, :f, :f].sum(0))
        half = vectors * np.where(values > 0, 1 / np.sqrt(np.where(values > 0, values, 1.0)), 0.0)
        half = half / scale[:, None]
        along = half.T @ self.reduced[:, :f, -1].sum(0)
        return half, 0.5 * float(along @ along)

    def gain(self, design: Array) -> float:
        """The gain (1) of a design D (V, K, B)."""
        f, r, back = self.camera, self.reduced, design.transpose(0, 2, 1)
        own = (back @ r[:, f:-1, f:-1] @ design).sum(0)
        across = np.einsum("vfk,vkb->fb", r[:, :f, f:-1], design)
        return float(self._gains(own[None], across[None], (back @ r[:, f:-1, -1:]).sum(0).T)[0])

    def gains_of_parts(self, columns: Array, parts: Array) -> Array:
        """The gain (1) for each of several parts of the views (P, V) that share numbers for columns (K, M)."""
        own, across, pull = self._of_each(columns)
        weights = parts.astype(float)

        def summed(each: Array) -> Array:
            return (weights @ each.reshape(len(each), -1)).reshape(-1, *each.shape[1:])

        return self._gains(summed(own), summed(across), summed(pull))

    def gains_of_views(self, columns: Array, sets: Array) -> Array:
        """The gain (1) for each of several sets (P, T) of views, each view with its own numbers for columns (K,
        M).
        """
        own, across, pull = self._of_each(columns)
        count, size, m = *sets.shape, columns.shape[1]
        each = np.zeros((count, size, m, size, m))
        for i in range(size):
            each[:, i, :, i] = own[sets[:, i]]
        side = across[sets].transpose(0, 2, 1, 3).reshape(count, self.camera, -1)
        return self._gains(each.reshape(count, size * m, -1), side, pull[sets].reshape(count, -1))

    def _of_each(self, columns: Array) -> tuple[Array, Array, Array]:
        """Each view's equations for numbers of columns (K, M): (V, M, M), with the camera (V, F, M), gradient (V,
        M).
        """
        f, r = self.camera, self.reduced
        return columns.T @ r[:, f:-1, f:-1] @ columns, r[:, :f, f:-1] @ columns, r[:, f:-1, -1] @ columns

    def _gains(self, own: Array, across: Array, pull: Array) -> Array:
        """The gain (1) of several candidates: own (P, B, B), with the camera (P, F, B), gradient (P, B); the
        camera eliminated.
        """
        half, alone = self._known
        side = half.T @ across
        reduced = own - side.transpose(0, 2, 1) @ side
        left = (
            pull
            - (side.transpose(0, 2, 1) @ (half.T @ self.reduced[:, : self.camera, -1].sum(0))[:, None])[
                ..., 0
            ]
        )
        values, vectors, scale = _scaled(reduced, own)
        along = (vectors.transpose(0, 2, 1) @ (left / scale)[..., None])[..., 0]
        squares = np.where(values > 0, along**2 / np.where(values > 0, values, 1.0), 0.0)
        return np.asarray(alone + 0.5 * squares.sum(-1))

    def information(self, column: Array) -> Array:
        """The information of each view (V,) about one number along `column` (K,), with the camera known."""
        f = self.camera
        return np.einsum("k,vkl,l->v", column, self.reduced[:, f:-1, f:-1], column)


def _scaled(matrices: Array, like: Array | None = None) -> tuple[Array, Array, Array]:
    """Eigenvalues (..., n), 0 where negligible, vectors, and the scale that makes the diagonal 1.

    The diagonal is that of `like`, where given.
    """
    diagonal = np.einsum("...ii->...i", matrices if like is None else like)
    scale = np.sqrt(np.maximum(diagonal, TINY))
    values, vectors = np.linalg.eigh(matrices / (scale[..., :, None] * scale[..., None, :]))
    return np.where(values > _NULL, values, 0.0), vectors, scale


def all_fields(base: Calibration) -> Warp:
    """Every field about the principal point, in units of the points' rms distance from it; its design is empty."""
    data = base.observations.kept()
    centre = np.array(base.camera.params[2:4])
    unit = float(np.sqrt(np.square(data.uv - centre).sum(1).mean()))
    return Warp(tuple(FIELDS), np.zeros((len(data.views), len(FIELDS), 0)), centre, unit)
