"""What a few more numbers would gain, by one step from the solution: all candidates from one pass over the data.

The rows of a view's points by the camera's free parameters, its pose, the fields of `camcal.solve.warp` and the
residual give a matrix of products; the pose is eliminated from it (Schur complement), which leaves R_v over (camera,
fields, residual). A candidate with numbers β and θ_v = D_v β then gains

    ½ bᵀ A⁻¹ b,   A = Σ_v [I 0; 0 D_v]ᵀ R_v [I 0; 0 D_v],  b its part against the residual                (1)

of the cost, exactly where the problem is linear.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from camcal.model.pose import Array
from camcal.solve.calibration import Calibration
from camcal.solve.groups import Group
from camcal.solve.warp import FIELDS, Warp, WarpedProblem

#: of the largest eigenvalue of (1), scaled: what the data do not determine gains nothing
_NULL = 1e-10


def problem_of(base: Calibration, warp: Warp) -> WarpedProblem:
    """The problem of a fit with a map on top."""
    data = base.observations.kept()
    weights = None if data.precision is None else data.split(data.precision)
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
        """Of all fields of a warp; None where a point leaves the lens's domain."""
        problem = problem_of(base, warp)
        lens, free, k = problem.cameras[0].lens, problem.free, len(warp.fields)
        p, f = lens.size, free.shape[1]
        state = problem.state(base.camera.params, base.poses)
        found = np.zeros((len(problem.views), f + 6 + k + 1, f + 6 + k + 1))

        def add(group: Group, block: Array) -> None:
            rows = block.reshape(*block.shape[:2], -1)
            fields = problem.fields(group, state).reshape(len(block), k, -1)
            own = np.einsum("pf,gpn->gfn", free, rows[:, :p])
            every = np.concatenate([own, rows[:, p:-1], fields, rows[:, -1:]], 1)
            found[group.members] = every @ every.transpose(0, 2, 1)

        if problem.assembled(state, add) is None:
            return None
        pose, rest = np.arange(f, f + 6), np.r_[0:f, f + 6 : f + 6 + k + 1]
        across = found[:, pose[:, None], rest]
        scale = np.sqrt(np.maximum(np.einsum("vii->vi", found[:, pose[:, None], pose]), 1e-300))
        inner = found[:, pose[:, None], pose] / scale[:, :, None] / scale[:, None, :]
        solved = np.linalg.pinv(inner, rcond=1e-12, hermitian=True) @ (across / scale[:, :, None])
        reduced = found[:, rest[:, None], rest] - (across / scale[:, :, None]).transpose(0, 2, 1) @ solved
        return cls(reduced, f, 0.5 * float(found[:, -1, -1].sum()))

    def gain(self, design: Array) -> float:
        """(1) of a design D (V, K, B)."""
        f, count = self.camera, design.shape[2]
        r, back = self.reduced, design.transpose(0, 2, 1)
        a, b = np.zeros((f + count, f + count)), np.zeros(f + count)
        a[:f, :f], b[:f] = r[:, :f, :f].sum(0), r[:, :f, -1].sum(0)
        a[:f, f:] = np.einsum("vfk,vkb->fb", r[:, :f, f:-1], design)
        a[f:, :f] = a[:f, f:].T
        a[f:, f:] = (back @ r[:, f:-1, f:-1] @ design).sum(0)
        b[f:] = (back @ r[:, f:-1, -1:]).sum(0)[:, 0]
        scale = np.sqrt(np.maximum(np.diag(a), 1e-300))
        values, vectors = np.linalg.eigh(a / np.outer(scale, scale))
        good = values > _NULL * values[-1]
        along = vectors[:, good].T @ (b / scale)
        return 0.5 * float((along**2 / values[good]).sum())

    def information(self, column: Array) -> Array:
        """How well each view (V,) determines one number along `column` (K,), the camera known."""
        f = self.camera
        return np.einsum("k,vkl,l->v", column, self.reduced[:, f:-1, f:-1], column)


def all_fields(base: Calibration) -> Warp:
    """Every field about the principal point, in units of the points' rms distance from it; its design is empty."""
    data = base.observations.kept()
    centre = np.array(base.camera.params[2:4])
    unit = float(np.sqrt(np.square(data.uv - centre).sum(1).mean()))
    return Warp(tuple(FIELDS), np.zeros((len(data.views), len(FIELDS), 0)), centre, unit)
