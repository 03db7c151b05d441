"""The cameras of a problem, and how a rig's unknowns affect the view of each.

A point is mapped to camera c only through the composite pose cam_from_board = cam_from_rig · rig_from_board,

    R = R_c R_v,    m = R_c m_v + t_c        (m: the centroid of the points of instant v)                  (1)

and its Jacobian rows are derivatives by the composite's perturbation δ, exp(δ_R) R and m + δ_m. Perturbed likewise,
rig_from_board (δ_v, about m_v) and cam_from_rig (δ_c, about the camera's centre) give

    δ = [ R_c  0  ] δ_v + [  I         0 ] δ_c                                                             (2)
        [ 0   R_c ]       [ −[m − t_c]×  I ]

The first camera is the reference: its cam_from_rig is the identity, without unknowns and maps, so that a single camera
is a rig of one.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from camcal.geometry import rotations
from camcal.model.lenses.base import Lens
from camcal.records import dataclass
from camcal.solve.seen import Seen
from camcal.solve.state import Blocks, State

Array = np.ndarray


@dataclass(frozen=True)
class CameraPart:
    """One camera of a problem.

    Attributes
    ----------
    index : int
        0 = the reference.
    lens : Lens
    free : (P, F) array
        d params / d free parameters.
    params, columns : slice
        Positions of its parameters and of its free ones among those of all cameras.
    extrinsics : slice
        Position of its cam_from_rig among the variables; empty for the reference, and if it is held.
    views : (B,) int array
        Indices of its views among those of the problem.
    instants : (B,) int array, or slice
        Their instants; a slice if it sees every instant once, in order.
    """

    index: int
    lens: Lens
    free: Array
    params: slice
    columns: slice
    extrinsics: slice
    views: Array
    instants: Array | slice

    def placed(self, state: State, instants: Array | slice) -> tuple[Array, Array]:
        """Rotations and centres of (1) at the given instants."""
        turned, centres = state.rotations[instants], state.centres[instants]
        if self.index == 0:
            return turned, centres
        own, shift = state.rig.rotations[self.index], state.rig.translations[self.index]
        return own @ turned, centres @ own.T + shift

    def maps(self, state: State, instants: Array | slice) -> Maps | None:
        """The maps of (2) at the given instants; None for the reference."""
        if self.index == 0:
            return None
        own = state.rig.rotations[self.index]
        by_instant = np.zeros((6, 6))
        by_instant[:3, :3] = by_instant[3:, 3:] = own
        arms = state.centres[instants] @ own.T
        by_rig = np.tile(np.eye(6), (len(arms), 1, 1))
        by_rig[:, 3:, :3] = -rotations.skew(arms)
        return Maps(by_instant, by_rig[:, :, : self.extrinsics.stop - self.extrinsics.start])


class Maps(NamedTuple):
    """d (composite pose) / d (pose of the instant), (6, 6), and / d (cam_from_rig), (B, 6, 6 or 0)."""

    by_instant: Array
    by_rig: Array


class Assembly:
    """The normal equations, accumulated camera by camera."""

    def __init__(self, variables: int, instants: int, views: int):
        self.intrinsics, self.gradient = np.zeros((variables, variables)), np.zeros(variables)
        self.coupling = np.zeros((instants, variables, 6))
        self.poses, self.pose_gradients = np.zeros((instants, 6, 6)), np.zeros((instants, 6))
        self.view_costs, self.prior_cost = np.zeros(views), 0.0

    def add(self, camera: CameraPart, state: State, intrinsics: Array, coupling: Array, poses: Array) -> None:
        """Add a camera's sums of products.

        Parameters
        ----------
        intrinsics : (P, P) array
            Of the parameters, over all its views.
        coupling : (B, P, 7) array
            By view, of the parameters with the composite pose and the residual.
        poses : (B, 7, 7) array
            By view, of the composite pose and the residual.
        """
        free, at = camera.free, camera.instants
        self.view_costs[camera.views] = 0.5 * poses[:, -1, -1]
        gradient = coupling[:, :, -1].sum(0)
        prior = camera.lens.prior(state.params[camera.params])
        if prior is not None:
            r, j = prior
            self.prior_cost += 0.5 * float(r @ r)
            intrinsics, gradient = intrinsics + j.T @ j, gradient + j.T @ r
        self.intrinsics[camera.columns, camera.columns] = free.T @ intrinsics @ free
        self.gradient[camera.columns] = free.T @ gradient
        across, own, pull = free.T @ coupling[:, :, :6], poses[:, :6, :6], poses[:, :6, -1]
        maps = camera.maps(state, at)
        if maps is not None:
            across, own, pull = self._add_extrinsics(camera, maps, across, own, pull)
        self.coupling[at, camera.columns] = across
        self.poses[at] += own
        self.pose_gradients[at] += pull

    def _add_extrinsics(
        self, camera: CameraPart, maps: Maps, across: Array, own: Array, pull: Array
    ) -> tuple[Array, Array, Array]:
        """Add the contribution to cam_from_rig; return the remainder for the instants."""
        by_instant, by_rig = maps
        back, e = by_rig.transpose(0, 2, 1), camera.extrinsics
        mixed = (across @ by_rig).sum(0)
        self.intrinsics[camera.columns, e], self.intrinsics[e, camera.columns] = mixed, mixed.T
        self.intrinsics[e, e] = (back @ own @ by_rig).sum(0)
        self.gradient[e] = np.einsum("bij,bi->j", by_rig, pull)
        moved = own @ by_instant
        self.coupling[camera.instants, e] = back @ moved
        return across @ by_instant, by_instant.T @ moved, pull @ by_instant

    def blocks(self) -> Blocks | None:
        """Return the assembled blocks; None if the cost is not finite."""
        cost = float(self.view_costs.sum()) + self.prior_cost
        if not np.isfinite(cost):
            return None
        return Blocks(
            cost,
            self.intrinsics,
            self.coupling,
            self.poses,
            self.gradient,
            self.pose_gradients,
            self.view_costs,
        )


def camera_parts(
    lenses: Sequence[Lens], frees: Sequence[Array], seen: Seen, instants: int, each: int
) -> tuple[CameraPart, ...]:
    """The cameras of a problem, from their lenses and the matrices (P, F) of their free parameters; the second camera
    and those after it have `each` variables of the rig.
    """
    sizes, columns = (np.cumsum([0, *n]).tolist() for n in zip(*(f.shape for f in frees), strict=True))
    parts = []
    for index, (lens, free) in enumerate(zip(lenses, frees, strict=True)):
        views = np.flatnonzero(seen.camera == index)
        when = seen.instant[views]
        every = np.array_equal(when, np.arange(instants))
        outside = slice(*(columns[-1] + each * max(i, 0) for i in (index - 1, index)))
        parts.append(
            CameraPart(
                index=index,
                lens=lens,
                free=free,
                params=slice(sizes[index], sizes[index + 1]),
                columns=slice(columns[index], columns[index + 1]),
                extrinsics=outside,
                views=views,
                instants=slice(None) if every else when,
            )
        )
    return tuple(parts)


def diagonal(matrices: Sequence[Array]) -> Array:
    """The block-diagonal matrix."""
    ends = np.cumsum([m.shape for m in matrices], axis=0)
    found = np.zeros(ends[-1])
    for m, (row, column) in zip(matrices, ends, strict=True):
        found[row - m.shape[0] : row, column - m.shape[1] : column] = m
    return found
