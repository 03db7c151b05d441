"""A calibration in which each view has a small image deformation: zoom, resizing, motion during readout.

The prediction p of a point of view v becomes

    T_v(p) = p + Σ_k θ_vk B_k(p),    θ_vk = D_k[v] · β                                                        (1)

with a few fixed fields B_k (`FIELDS`) in pixels and unknowns β that all views share through D: one value for all views
from some view on, for each group of views, or for each view. β replaces the board's shape in `State`; (1) is linear in
it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from camcal.data.observations import View
from camcal.model.lenses.base import Lens
from camcal.model.pose import Array, Poses
from camcal.records import dataclass
from camcal.solve.cameras import Assembly
from camcal.solve.groups import Group
from camcal.solve.problem import Problem
from camcal.solve.state import Blocks, State

#: values (..., 2, N) of a field at q (..., 2, N), and its derivative (..., 2, 2, N), d B_i / d q_j
Field = Callable[[Array], tuple[Array, Array]]


def _affine(linear: Sequence[Sequence[float]], shift: Sequence[float] = (0.0, 0.0)) -> Field:
    m, t = np.array(linear, float), np.array(shift, float)[:, None]

    def field(q: Array) -> tuple[Array, Array]:
        return m @ q + t, np.broadcast_to(m[:, :, None], (*q.shape[:-2], 2, 2, q.shape[-1]))

    return field


def _radial(q: Array) -> tuple[Array, Array]:
    """q |q|²: a change of the radial distortion."""
    square = np.square(q).sum(-2)[..., None, :]
    slope = 2 * q[..., :, None, :] * q[..., None, :, :]
    return q * square, slope + np.eye(2)[:, :, None] * square[..., None, :, :]


#: name -> field, in units of `Warp.unit` about `Warp.centre`
FIELDS: dict[str, Field] = {
    "scale": _affine([[1, 0], [0, 1]]),
    "radial": _radial,
    "shift-u": _affine([[0, 0], [0, 0]], (1, 0)),
    "shift-v": _affine([[0, 0], [0, 0]], (0, 1)),
    "lean": _affine([[0, 1], [0, 0]]),  # u increases with the row
    "stretch": _affine([[0, 0], [0, 1]]),  # v increases with the row
}


@dataclass(frozen=True)
class Warp:
    """The map of equation (1).

    Attributes
    ----------
    fields : tuple of str
        Keys of `FIELDS`, K of them.
    design : (V, K, B) array
        D.
    centre : (2,) array
        Point at which all fields except shifts vanish, px.
    unit : float
        Length of q = 1, px; a field's value of 1 is as long.
    """

    fields: tuple[str, ...]
    design: Array
    centre: Array
    unit: float

    def values(self, beta: Array) -> Array:
        """θ (V, K)."""
        return np.asarray(self.design @ beta)

    def field(self, points: Array) -> tuple[Array, Array]:
        """B_k at points (..., 2, N), px, as (..., K, 2, N), and derivatives (..., K, 2, 2, N)."""
        q = (points - self.centre[:, None]) / self.unit
        values, slopes = zip(*(FIELDS[name](q) for name in self.fields), strict=True)
        along = [np.broadcast_to(v, q.shape) * self.unit for v in values]
        return np.stack(along, -3), np.stack(slopes, -4)

    def moved(self, view: int, beta: Array, points: Array) -> Array:
        """T_v of points (N, 2), px."""
        values, _ = self.field(points.T)
        return np.asarray(points + np.einsum("k,kdn->nd", self.values(beta)[view], values))


class WarpedProblem(Problem):
    """A calibration with the map (1); see `Problem`."""

    def __init__(
        self,
        lens: Lens,
        views: Sequence[View],
        free: Array,
        warp: Warp,
        weights: Sequence[Array] | None = None,
    ):
        super().__init__(lens, views, free, weights)
        self.warp = warp
        self._filled: Array | None = None

    @property
    def variables(self) -> int:
        """The variables of the camera, and β."""
        return self.rigid + self.warp.design.shape[2]

    def state(self, params: Array, poses: Poses, rig: Poses | None = None) -> State:
        """Start without a deformation."""
        return replace(super().state(params, poses, rig), shape=np.zeros(self.warp.design.shape[2]))

    def fill(self, group: Group, state: State, scratch: Array | None = None) -> Array | None:
        """Rows of the deformed prediction; see `Problem.fill`."""
        block = super().fill(group, state, scratch)
        if block is None:
            return None
        theta = self.warp.values(state.shape)[group.members]
        values, slopes = self.warp.field(self._predicted(group, block))
        linear = np.einsum("gk,gkijn->gijn", theta, slopes)
        self._filled = values if group.weights is None else values * group.weights
        own = block[:, :-1]
        own += np.einsum("gijn,gpjn->gpin", linear, own)
        block[:, -1] += np.einsum("gk,gkdn->gdn", theta, self._filled)
        return block

    def _predicted(self, group: Group, block: Array) -> Array:
        """Predictions (G, 2, N) before the deformation, px, from the rows of the undeformed problem."""
        residual = block[:, -1]
        if group.weights is not None:
            root = group.weights[:, 0]
            residual = residual / np.where(root > 0, root, 1.0)
        return residual + group.uv

    def fields(self) -> Array:
        """Derivatives (G, K, 2, N) of the residuals by θ, weighted, of the group whose rows were filled last."""
        assert self._filled is not None
        return self._filled

    def linearise(self, state: State) -> Blocks | None:
        """The normal equations of camera, β and poses; None if a point leaves the lens's domain."""
        p, rigid, design = self.cameras[0].lens.size, self.rigid, self.warp.design
        views, k = len(self.views), len(self.warp.fields)
        cross, own = np.zeros((views, k, p + 7)), np.zeros((views, k, k))

        def add(group: Group, block: Array) -> None:
            e = self.fields().reshape(len(block), k, -1)
            rows = block.reshape(*block.shape[:2], -1)
            cross[group.members] = e @ rows.transpose(0, 2, 1)
            own[group.members] = e @ e.transpose(0, 2, 1)

        found: Assembly | None = self.assembled(state, add)
        if found is None:
            return None
        back, shape = design.transpose(0, 2, 1), slice(rigid, None)
        mixed = self.free.T @ np.einsum("vkp,vkb->pb", cross[:, :, :p], design)
        found.intrinsics[:rigid, shape], found.intrinsics[shape, :rigid] = mixed, mixed.T
        found.intrinsics[shape, shape] = (back @ own @ design).sum(0)
        found.coupling[:, shape] = back @ cross[:, :, p : p + 6]
        found.gradient[shape] = (back @ cross[:, :, -1:]).sum(0)[:, 0]
        return found.blocks()

    def free_rows(self, group: Group, state: State) -> Array | None:
        """Rows of all variables, β before the pose; see `Problem.free_rows`."""
        rows = super().free_rows(group, state)
        if rows is None:
            return None
        e = self.fields().reshape(len(rows), len(self.warp.fields), -1)
        beta = self.warp.design[group.members].transpose(0, 2, 1) @ e
        return np.concatenate([rows[:, : self.rigid], beta, rows[:, self.rigid :]], 1)
