"""Many calibrations of one camera each as the members of one batch of the least-squares loop.

A small calibration spends most of its time in the overhead of numpy's calls. Here the views of all members are
processed together, with the parameters of each view's own camera, and the equations of all members are solved together:
the formulas are those of `problem` and `schur`. The product of a view's rows, the factors of its pose and the system of
its camera are computed by themselves in a batch, so that a member's result does not depend on the others.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from camcal.geometry import rotations
from camcal.least_squares import Found, Trial
from camcal.records import dataclass
from camcal.solve.groups import ROW_BUDGET, Group, fill_rows, products, row_block
from camcal.solve.linear import WEAK
from camcal.solve.optimizers.base import Result, Sample
from camcal.solve.problem import Blocks, Problem, State
from camcal.solve.schur import back_substitution, eliminate

Array = np.ndarray
#: Numbers in the rows of a portion: twice those of `groups`, as numpy's calls cost more here than a larger cache. 50
#: cameras of 20 views of 54 points took 1.67 ms each, with half of it 1.82, with twice as many 1.73.
PORTION = 2 * ROW_BUDGET


def stackable(problem: Problem) -> bool:
    """Return whether a problem can be a member: one camera, whose lens has neither a prior nor local parameters, and a
    board as designed.
    """
    if type(problem) is not Problem or len(problem.cameras) != 1 or not problem.normalise:
        return False
    lens = problem.lens
    return not lens.local and lens.prior(lens.neutral) is None


def alike(problem: Problem) -> tuple[Any, ...]:
    """A key that the members of one stack have in common: the sizes of their equations."""
    return problem.lens, problem.free.shape, problem.instants


class States(NamedTuple):
    """The states of M members with V views each; see `State`."""

    member: Array  #: (M,)
    params: Array  #: (M, P)
    rotations: Array  #: (M, V, 3, 3)
    centres: Array  #: (M, V, 3)


class Equations(NamedTuple):
    """The normal equations of M members; see `Blocks`."""

    member: Array  #: (M,)
    cost: Array  #: (M,), inf where a point leaves the lens's domain
    intrinsics: Array  #: (M, F, F)
    coupling: Array  #: (M, V, F, 6)
    poses: Array  #: (M, V, 6, 6)
    gradient: Array  #: (M, F)
    pose_gradients: Array  #: (M, V, 6)
    view_costs: Array  #: (M, V)


class Steps(NamedTuple):
    """Steps of the free parameters (M, F) and of the poses (M, V, 6)."""

    own: Array
    poses: Array


@dataclass(frozen=True)
class Portion:
    """Views of several members that are processed together: `owner` (G,) is the index of each view's member."""

    owner: Array
    views: Array
    xyz: Array
    uv: Array
    weights: Array | None


class Stack:
    """Problems with the same key `alike` as one problem for the loop.

    Attributes
    ----------
    alone : (B,) bool array
        Members whose start cannot be projected, or whose equations have to be solved by other means.
    """

    def __init__(self, problems: Sequence[Problem]):
        self.problems, self.count = problems, len(problems)
        self.lens, self.views = problems[0].lens, problems[0].instants
        self.rounding = np.array([p.rounding for p in problems])
        self.free = np.array([p.free for p in problems])
        self.alone = np.zeros(self.count, bool)
        self._arrange(np.arange(self.count))
        self._begin = time.perf_counter()
        self._samples: list[list[Sample]] = [[] for _ in problems]

    # ------------------------------------------------------------------ states
    def state(self, states: Sequence[State]) -> States:
        """The states of all members as one."""
        names = ("params", "rotations", "centres")
        return States(np.arange(self.count), *(np.array([getattr(s, n) for s in states]) for n in names))

    def retract(self, state: States, step: Steps) -> States:
        """Apply steps: params + T δ, exp(δ) R, t + δ."""
        moved = np.matmul(self.free[state.member], step.own[..., None])[..., 0]
        turned = rotations.exp(step.poses[..., :3]) @ state.rotations
        return States(state.member, state.params + moved, turned, state.centres + step.poses[..., 3:])

    # ------------------------------------------------------------------ evaluation
    def linearise(self, state: States, members: Array) -> Equations:
        """The normal equations of some members."""
        p = self.lens.size
        normal, inside = self._normals(state, members)
        free = self.free[members]
        back = free.transpose(0, 2, 1)
        coupling, poses = normal[..., :p, p:], normal[..., p:, p:]
        view_costs = 0.5 * poses[..., -1, -1]
        cost = view_costs.sum(1)
        found = Equations(
            members,
            np.where(inside & np.isfinite(cost), cost, np.inf),
            back @ normal[..., :p, :p].sum(1) @ free,
            back[:, None] @ coupling[..., :6],
            np.ascontiguousarray(poses[..., :6, :6]),
            (back @ coupling[..., -1].sum(1)[..., None])[..., 0],
            np.ascontiguousarray(poses[..., :6, -1]),
            view_costs,
        )
        if not self._samples[0]:
            self.alone |= np.isinf(found.cost)  # a start that cannot be projected
            for samples, own in zip(self._samples, found.cost.tolist(), strict=True):
                samples.append(Sample(0, own, 1, 0.0))
        return found

    def _normals(self, state: States, members: Array) -> tuple[Array, Array]:
        """Products (M, V, R, R) of the rows of each view, and which members (M,) stay in the lens's domain."""
        if len(members) != len(self._left):
            self._arrange(members)
        rows = self.lens.size + 7
        normal = np.empty((len(members), self.views, rows, rows))
        inside = np.ones(len(members), bool)
        with np.errstate(all="ignore"):
            for portion in self._portions:
                at = portion.owner, portion.views
                block = row_block(portion.uv, self.lens.size, self._scratch)
                placed = state.rotations[at], state.centres[at]
                project = self._projection(state.params, portion.owner)
                seen = fill_rows(block, project, *placed, portion.xyz, portion.uv, portion.weights)
                normal[at] = products(block)
                inside[portion.owner[~np.ravel(seen)]] = False
        return normal, inside

    def _arrange(self, members: Array) -> None:
        """Make the portions of the members that are left."""
        rows = self.lens.size + 7
        self._left = members
        self._portions = portions([self.problems[i] for i in members], rows)
        self._scratch = np.empty(max(p.uv.size for p in self._portions) * rows)

    def _projection(self, params: Array, owner: Array) -> Any:
        """`Lens.linearise` with the parameters of each view's owner; camera by camera if the lens requires it."""
        if self.lens.stackable:
            stacked = np.ascontiguousarray(params[owner].T)[..., None]
            return lambda *points: self.lens.linearise(stacked, *points)
        ends = np.flatnonzero(np.diff(owner, append=-1)) + 1

        def one_by_one(*points: Array) -> Array:
            inside, begin = np.empty(len(owner), bool), 0
            for end in ends.tolist():
                own = params[owner[begin]]
                inside[begin:end] = self.lens.linearise(own, *(a[begin:end] for a in points))
                begin = end
            return inside

        return one_by_one

    # ------------------------------------------------------------------ steps
    def solve(self, state: States, equations: Equations, damping: Array) -> tuple[Steps, Array]:
        """The damped steps as in `schur.Reduced`; NaN for members that are noted as `alone`."""
        with np.errstate(all="ignore"):
            step, predicted, weakest = _solved(equations, damping)
        failed = ~(np.isfinite(predicted) & (weakest > WEAK))
        if failed.any():
            self.alone[equations.member[failed]] = True
            predicted[failed] = np.nan
        return step, predicted

    def tried(self, trial: Trial) -> None:
        """Record the accepted steps."""
        seconds = (time.perf_counter() - self._begin) / self.count
        for member, cost in zip(
            trial.members[trial.accepted].tolist(), trial.after.cost[trial.accepted].tolist(), strict=True
        ):
            self._samples[member].append(Sample(trial.iteration, cost, trial.evaluations, seconds))

    def result(self, found: Found, member: int) -> Result:
        """The result of a member, as of a problem of its own."""
        state, equations, stats = found
        reached = State(state.params[member], state.rotations[member], state.centres[member])
        blocks = Blocks(float(equations.cost[member]), *(a[member] for a in equations[2:]))
        return Result(
            reached,
            blocks,
            bool(stats.converged[member]),
            str(stats.reasons[member]),
            int(stats.iterations[member]),
            int(stats.evaluations[member]),
            tuple(self._samples[member]),
            {"variables": "camera and poses"},
        )


def portions(problems: Sequence[Problem], rows: int) -> list[Portion]:
    """The groups of all problems, those of equal length together, in portions whose rows stay in the cache.

    A view is padded as in its own problem, to the length of its own group.
    """
    groups = [(owner, g) for owner, p in enumerate(problems) for g in p.groups]
    by_shape: dict[tuple[int, bool], list[tuple[int, Group]]] = {}
    for owner, g in groups:
        by_shape.setdefault((g.uv.shape[2], g.weights is None), []).append((owner, g))
    found = []
    for (length, _), some in by_shape.items():
        most, begin, size = PORTION // (2 * rows * max(length, 1)), 0, 0
        for end, (_, g) in enumerate(some):
            if size and size + len(g.members) > most:
                found.append(_portion(some[begin:end]))
                begin, size = end, 0
            size += len(g.members)
        found.append(_portion(some[begin:]))
    return found


def _portion(some: Sequence[tuple[int, Group]]) -> Portion:
    groups = [g for _, g in some]
    owner = np.repeat([owner for owner, _ in some], [len(g.members) for g in groups])
    views, xyz, uv = (np.concatenate([getattr(g, n) for g in groups]) for n in ("members", "xyz", "uv"))
    weights = [g.weights for g in groups if g.weights is not None]
    return Portion(owner, views, xyz, uv, np.concatenate(weights) if weights else None)


def _solved(equations: Equations, damping: Array) -> tuple[Steps, Array, Array]:
    """Steps, predicted decreases and the smallest squared pivots (M,) of all members: (1) and (2) of `schur`."""
    count, views, own, _ = equations.coupling.shape
    diagonal = np.arange(6)
    bordered = np.empty((6, 6 + own + 1, count, views))
    bordered[:, :6] = equations.poses.transpose(2, 3, 0, 1)
    bordered[:, 6:-1] = equations.coupling.transpose(3, 2, 0, 1)
    bordered[:, -1] = equations.pose_gradients.transpose(2, 0, 1)
    of_poses = bordered[diagonal, diagonal]
    of_cameras = np.ascontiguousarray(np.einsum("mii->mi", equations.intrinsics))
    bordered[diagonal, diagonal] += damping[:, None] * of_poses
    flat = bordered.reshape(6, 6 + own + 1, -1)
    eliminate(flat)
    half = bordered[:, 6:]
    rows = np.ascontiguousarray(half.transpose(2, 1, 0, 3).reshape(count, own + 1, -1))
    product = rows @ rows.transpose(0, 2, 1)
    matrix = equations.intrinsics - product[:, :own, :own]
    np.einsum("mii->mi", matrix)[:] += damping[:, None] * of_cameras
    step, pivots = _solved_scaled(matrix, product[:, :own, own] - equations.gradient)
    factors = np.concatenate([-step, np.full((count, 1), -1.0)], 1)
    # in one piece as alone: with up to three views the last bits depend on the distance of the rows in memory
    right = np.matmul(factors[:, None], np.ascontiguousarray(half.transpose(0, 2, 1, 3)))[:, :, 0]
    poses = back_substitution(flat[:, :6], right.reshape(6, -1)).reshape(6, count, views)
    moved = np.ascontiguousarray(poses.transpose(1, 2, 0))
    slope = _dot(equations.gradient, step) + _dot(equations.pose_gradients, moved)
    damp = _dot(of_cameras, step * step) + (of_poses * poses * poses).sum(-1).sum(0)
    of_factors = bordered[diagonal, diagonal] ** 2 / of_poses
    weakest = np.minimum(of_factors.min((0, 2)), (pivots / of_cameras).min(1, initial=np.inf))
    return Steps(step, moved), 0.5 * (damping * damp - slope), weakest / (1.0 + damping)


def _dot(a: Array, b: Array) -> Array:
    """The products (M,) of the members' vectors."""
    return np.matmul(a.reshape(len(a), 1, -1), b.reshape(len(b), -1, 1))[:, 0, 0]


def _solved_scaled(matrix: Array, right: Array) -> tuple[Array, Array]:
    """Solutions (M, F) of systems scaled to unit diagonal, and their squared pivots; NaN for matrices that are not
    positive definite.
    """
    scale = 1.0 / np.sqrt(np.einsum("mii->mi", matrix))
    scaled = matrix * scale[:, None] * scale[..., None]
    bad = ~np.isfinite(scaled).all((1, 2))
    scaled[bad] = np.eye(matrix.shape[1])
    factors, solved = _factored(scaled, (right * scale)[..., None])
    pivots = (np.einsum("mii->mi", factors) / scale) ** 2
    solved[bad], pivots[bad] = np.nan, np.nan
    return scale * solved[..., 0], pivots


def _factored(matrices: Array, right: Array) -> tuple[Array, Array]:
    """Cholesky factors (M, F, F), and solutions (M, F, 1); NaN for matrices that are not positive definite."""
    try:
        return np.linalg.cholesky(matrices), np.linalg.solve(matrices, right)
    except np.linalg.LinAlgError:
        if len(matrices) == 1:
            return np.full_like(matrices, np.nan), np.full_like(right, np.nan)
        each = [_factored(m[None], r[None]) for m, r in zip(matrices, right, strict=True)]
        factors, solved = zip(*each, strict=True)
        return np.concatenate(factors), np.concatenate(solved)
