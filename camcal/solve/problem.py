"""The calibration as a least-squares problem: residuals, Jacobian blocks, retraction.

    minimise  ½ Σ_views Σ_points w |project(params, exp(δ) R x + t) − u|²                                 (1)

of one camera or of a rig, whose unknowns act only through the composite pose (R, t) of each view
(camcal.solve.cameras). The Jacobian is never stored. A few views are processed at a time: their derivatives are rows of
an array (views, parameters + 6 + 1, 2, points) that stays in the cache, with the residual as the last row, and a
batched product of this array with its transpose gives all normal matrices, gradients and costs.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property, partial

import numpy as np

from camcal.data.observations import View
from camcal.geometry import rotations
from camcal.model.lenses.base import Lens
from camcal.model.lenses.parameters import Parameter
from camcal.model.pose import Poses
from camcal.solve import local
from camcal.solve.cameras import Assembly, CameraPart, camera_parts, diagonal
from camcal.solve.groups import Group, fill_rows, make_groups, products, row_block
from camcal.solve.seen import Seen
from camcal.solve.state import Blocks, State, Step

__all__ = ["Blocks", "Group", "Problem", "Seen", "State", "Step", "products"]

Array = np.ndarray
#: called with a group and its rows, which are overwritten by those of the next group
OnRows = Callable[[Group, Array], None]


class Problem:
    """Correspondences and one or more lens models as a least-squares problem.

    A single camera is a rig of one, without separate code. A rig solver makes

        problem = Problem([left, right], views, [free_left, free_right], seen=Seen(camera, instant))
        state = problem.state(np.concatenate([params_left, params_right]), rig_from_board, cam_from_rig)
        result = optimizers.make("lm")(problem, state)
        problem.params(result.state), problem.poses(result.state), result.state.rig     # cameras, instants, rig

    and finds the variables of `result.blocks` in the order of `Step`; `camera.columns` and `camera.extrinsics` of
    `problem.cameras` locate those of a camera.

    Parameters
    ----------
    lens : Lens, or sequence of C
    views : sequence of B View
    free : (P, F) array, or sequence of C
        d params / d free parameters. A row of zeros fixes a parameter; several entries in a column couple parameters.
    weights : sequence of (N,) arrays, optional
        Weight of each point's squared residual; by default 1 / sigma² if a view has sigmas, otherwise 1.
    normalise : bool
        False, for comparison, leaves each view's points unchanged, so that rotations are about the data's origin
        instead of the instant's centroid, and damps and solves without scaling the columns.
    seen : Seen, optional
        By default one camera took all views, each at its own instant.
    hold_rig : bool
        Whether the poses cam_from_rig are held.
    """

    def __init__(
        self,
        lens: Lens | Sequence[Lens],
        views: Sequence[View],
        free: Array | Sequence[Array],
        weights: Sequence[Array] | None = None,
        normalise: bool = True,
        seen: Seen | None = None,
        hold_rig: bool = False,
    ):
        lenses = [lens] if isinstance(lens, Lens) else list(lens)
        frees = [np.asarray(f, float) for f in ([free] if isinstance(lens, Lens) else free)]
        self.views, self.normalise, self.hold_rig = tuple(views), normalise, hold_rig
        self.seen = Seen.alone(len(self.views)) if seen is None else seen
        self.instants = int(self.seen.instant.max(initial=-1)) + 1
        self.weights = weights if weights is not None else _default_weights(self.views)
        self.free = frees[0] if len(frees) == 1 else diagonal(frees)
        self.cameras = camera_parts(lenses, frees, self.seen, self.instants, 0 if hold_rig else 6)
        self._places = np.empty(len(self.views), int)  # of each view among those of its camera
        for camera in self.cameras:
            self._places[camera.views] = np.arange(len(camera.views))
        self.offsets = self._centroids()
        if not normalise:
            self.offsets[:] = 0.0
        shifts = self.offsets[self.seen.instant]
        self.groups = [
            group
            for camera in self.cameras
            for group in make_groups(
                camera.index, camera.views, camera.lens.size + 7, self.views, shifts, self.weights
            )
        ]
        self._largest = max(
            (g.uv.size * (self.cameras[g.camera].lens.size + 7) for g in self.groups), default=0
        )
        scale = max((float(np.abs(g.uv).max()) for g in self.groups), default=1.0)
        rounding = np.array([len(v.uv) for v in self.views]) * (4 * np.finfo(float).eps * scale) ** 2
        #: a cost that rounding alone produces: a few units in the last place of each coordinate; of each instant
        self.instant_rounding = np.bincount(self.seen.instant, rounding, self.instants)
        self.rounding = float(rounding.sum())

    def _centroids(self) -> Array:
        """The centroid (V, 3) of each instant's points, of all cameras."""
        sums, counts = np.zeros((self.instants, 3)), np.zeros((self.instants, 1))
        sizes = np.array([len(v.xyz) for v in self.views], int)
        if sizes.all() and len(sizes):  # the usual case: one sum over all points instead of one per view
            points = np.concatenate([v.xyz for v in self.views])
            of_views = np.add.reduceat(points, np.cumsum(sizes) - sizes, axis=0)
        else:
            of_views = np.array([v.xyz.sum(0) for v in self.views]).reshape(-1, 3)
        np.add.at(sums, self.seen.instant, of_views)
        np.add.at(counts[:, 0], self.seen.instant, sizes)
        return sums / counts

    def normalised(self) -> Problem:
        """Return the same problem with `normalise`."""
        lenses, frees = [c.lens for c in self.cameras], [c.free for c in self.cameras]
        return Problem(lenses, self.views, frees, self.weights, True, self.seen, self.hold_rig)

    @property
    def lens(self) -> Lens:
        """The lens of the only camera; ValueError for a rig, whose lenses are in `cameras`."""
        (only,) = self.cameras
        return only.lens

    @property
    def parameters(self) -> list[Parameter]:
        """The names of the parameters of all cameras."""
        return [p for camera in self.cameras for p in camera.lens.parameters]

    @property
    def point_coordinates(self) -> Array | None:
        """The indices of a board's free coordinates (B,) if these are the last of the variables; otherwise None."""
        return None

    @property
    def rigid(self) -> int:
        """Number of variables of cameras and rig."""
        return self.free.shape[1] + (0 if self.hold_rig else 6 * (len(self.cameras) - 1))

    @property
    def variables(self) -> int:
        """Number F of variables, including those of the board's shape and excluding those of the instants' poses."""
        return self.rigid

    # ------------------------------------------------------------------ states
    def state(self, params: Array, poses: Poses, rig: Poses | None = None) -> State:
        """The state at the parameters of all cameras, the poses rig_from_board of the instants and cam_from_rig."""
        centres = np.einsum("vij,vj->vi", poses.rotations, self.offsets) + poses.translations
        begin = State(np.array(params, float), np.array(poses.rotations, float), centres)
        return begin if rig is None else replace(begin, rig=rig)

    def poses(self, state: State) -> Poses:
        """The poses of a state's instants: rig_from_board, for a single camera cam_from_board."""
        shift = np.einsum("vij,vj->vi", state.rotations, self.offsets)
        return Poses(state.rotations, state.centres - shift)

    def params(self, state: State) -> list[Array]:
        """The parameters of each camera."""
        return [state.params[c.params] for c in self.cameras]

    def retract(self, state: State, step: Step) -> State:
        """Apply a step: params + T δ, exp(δ) R, t + δ."""
        own = self.free.shape[1]
        rig = state.rig
        if self.rigid > own:
            by_camera = np.r_[np.zeros(6), step.intrinsics[own : self.rigid]].reshape(-1, 6)
            turn, shift = by_camera[:, :3], by_camera[:, 3:]
            rig = Poses(rotations.exp(turn) @ rig.rotations, rig.translations + shift)
        return State(
            state.params + self.free @ step.intrinsics[:own],
            rotations.exp(step.poses[:, :3]) @ state.rotations,
            state.centres + step.poses[:, 3:],
            state.shape + step.intrinsics[self.rigid :],
            rig,
        )

    # ------------------------------------------------------------------ evaluation
    def linearise(self, state: State) -> Blocks | None:
        """The normal equations at a state; None if a point leaves a lens's domain."""
        found = self.assembled(state)
        return None if found is None else found.blocks()

    def assembled(self, state: State, each: OnRows | None = None) -> Assembly | None:
        """The accumulated normal equations; `each` receives the rows of every group during accumulation."""
        assembly = Assembly(self.variables, self.instants, len(self.views))
        scratch = self.scratch()
        for camera in self.cameras:
            sparse = camera.lens.local and each is None
            sums = self._local_sums(camera, state) if sparse else self._sums(camera, state, scratch, each)
            if sums is None:
                return None
            assembly.add(camera, state, *sums)
        return assembly

    def _sums(
        self, camera: CameraPart, state: State, scratch: Array, each: OnRows | None
    ) -> tuple[Array, Array, Array] | None:
        """The input of `Assembly.add` from the rows of the camera's views."""
        normal, p = self._normals(camera, state, scratch, each), camera.lens.size
        return None if normal is None else (normal[:, :p, :p].sum(0), normal[:, :p, p:], normal[:, p:, p:])

    def _local_sums(self, camera: CameraPart, state: State) -> tuple[Array, Array, Array] | None:
        """The same for a lens whose parameters act locally."""
        placed = camera.placed(state, camera.instants)
        return local.products(camera.lens, state.params[camera.params], *placed, self._points[camera.index])

    @cached_property
    def _points(self) -> list[local.Points]:
        found = []
        for camera in self.cameras:
            views = [self.views[i] for i in camera.views]
            xyz = [self.views[i].xyz - self.offsets[self.seen.instant[i]] for i in camera.views]
            weights = None if self.weights is None else [self.weights[i] for i in camera.views]
            found.append(local.Points.of(xyz, [v.uv for v in views], weights))
        return found

    def _normals(
        self, camera: CameraPart, state: State, scratch: Array, each: OnRows | None = None
    ) -> Array | None:
        """Products of the rows of each of a camera's views, (B, R, R); None outside the lens's domain."""
        rows = camera.lens.size + 7
        normal = np.empty((len(camera.views), rows, rows))
        with np.errstate(all="ignore"):
            for group in self.groups:
                if group.camera == camera.index:
                    block = self.fill(group, state, scratch)
                    if block is None:
                        return None
                    if each is not None:
                        each(group, block)
                    normal[self._places[group.members]] = products(block)
        return normal

    def view_normals(self, state: State) -> Array | None:
        """Products of the rows of each view of the only camera, (V, R, R): parameters, rotation, translation, residual.

        None where a point leaves the lens's domain.
        """
        (only,) = self.cameras
        return self._normals(only, state, self.scratch())

    def pose_normals(self, state: State, members: Array) -> Array:
        """Products of the rows (rotation, translation, residual) of the given instants (M,), (M, 7, 7).

        NaN for an instant at which a point leaves a lens's domain.
        """
        normal = np.zeros((self.instants, 7, 7))
        wanted = np.zeros(self.instants, bool)
        wanted[members] = True
        scratch = self.scratch()
        with np.errstate(all="ignore"):
            for group in self.groups:
                if wanted[self.seen.instant[group.members]].any():
                    normal[self.seen.instant[group.members]] += self._by_instant(group, state, scratch)
        return normal[members]

    def _by_instant(self, group: Group, state: State, scratch: Array) -> Array:
        """Products (G, 7, 7) of the pose's and the residual's rows of a group's views, with respect to the
        instants' poses.
        """
        camera, found = self.cameras[group.camera], np.full((len(group.members), 7, 7), np.nan)
        block = self.fill(group, state, scratch)
        if block is not None:
            found = products(block[:, camera.lens.size :])
        elif len(group.members) > 1:  # the views that remain in the domain
            for index in range(len(group.members)):
                found[index] = self._by_instant(group.alone(index), state, scratch)[0]
            return found
        maps = camera.maps(state, self.seen.instant[group.members])
        if maps is not None:
            chain = np.eye(7)
            chain[:6, :6] = maps.by_instant
            found = chain.T @ found @ chain
        return found

    def points(self, group: Group, state: State) -> Array:
        """Points (G, 3, N) of a group relative to their instants' centroids."""
        return group.xyz

    def scratch(self) -> Array:
        """A buffer for the rows of any one group, to be written by `fill`; one buffer serves a whole pass."""
        return np.empty(self._largest)

    def fill(self, group: Group, state: State, scratch: Array | None = None) -> Array | None:
        """The rows (G, P + 6 + 1, 2, N) of a group: the camera's parameters, its composite pose, residual.

        None where a point leaves the lens's domain. The rows lie in `scratch` where that is given.
        """
        camera = self.cameras[group.camera]
        block = row_block(group.uv, camera.lens.size, scratch)
        placed = camera.placed(state, self.seen.instant[group.members])
        project = partial(camera.lens.linearise, state.params[camera.params])
        inside = fill_rows(block, project, *placed, self.points(group, state), group.uv, group.weights)
        return block if inside else None

    def free_rows(self, group: Group, state: State) -> Array | None:
        """The rows (G, F + 6 + 1, 2 N) of a group: all variables, pose of the instant, residual."""
        block = self.fill(group, state)
        if block is None:
            return None
        camera, p = self.cameras[group.camera], self.cameras[group.camera].lens.size
        rows = np.zeros((len(block), self.rigid + 7, *block.shape[2:]))
        rows[:, camera.columns] = np.einsum("pf,gpdn->gfdn", camera.free, block[:, :p])
        rows[:, self.rigid :] = block[:, p:]
        maps = camera.maps(state, self.seen.instant[group.members])
        if maps is not None:
            pose = block[:, p : p + 6]
            rows[:, camera.extrinsics] = np.einsum("gij,gidn->gjdn", maps.by_rig, pose)
            rows[:, self.rigid : self.rigid + 6] = np.einsum("ij,gidn->gjdn", maps.by_instant, pose)
        return rows.reshape(len(block), self.rigid + 7, -1)

    def prior(self, state: State) -> tuple[Array, Array] | None:
        """Residuals (K,) of the lenses' priors and their derivatives (K, F) by the variables; None if there are
        none.
        """
        found = [(c, c.lens.prior(state.params[c.params])) for c in self.cameras]
        parts = [(c, *prior) for c, prior in found if prior is not None]
        if not parts:
            return None
        rows = [np.zeros((len(r), self.variables)) for _, r, _ in parts]
        for row, (camera, _, j) in zip(rows, parts, strict=True):
            row[:, camera.columns] = j @ camera.free
        return np.concatenate([r for _, r, _ in parts]), np.concatenate(rows)


def _default_weights(views: Sequence[View]) -> list[Array] | None:
    if all(v.sigma is None for v in views):
        return None
    return [np.ones(len(v)) if v.sigma is None else v.sigma**-2.0 for v in views]
