"""Poses alone, the camera held: every view is its own problem of six unknowns, all solved at once."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from camcal.data.observations import View
from camcal.geometry import rotations
from camcal.model.camera import Camera
from camcal.model.pose import Array, Poses
from camcal.solve.problem import Problem, State
from camcal.solve.schur import back_substitution, cholesky, forward_substitution

#: converged where no view's predicted decrease exceeds this part of its cost
_TOLERANCE = 1e-12


def refine_poses(
    camera: Camera,
    views: list[View] | tuple[View, ...],
    poses: Poses,
    weights: list[Array] | None = None,
    max_iterations: int = 100,
) -> tuple[Poses, Array, Array]:
    """Minimise each view's reprojection error over its pose, by Levenberg-Marquardt with a damping per view.

    Parameters
    ----------
    camera : Camera
    views : V views
    poses : Poses
        Starts, cam_from_board.
    weights : V arrays (N,), optional

    Returns
    -------
    poses : Poses
    costs : (V,) array
        ½ Σ w |r|² of each view; inf where a start leaves the lens's domain and no step mends it.
    converged : (V,) bool array
    """
    problem = Problem(camera.lens, views, np.zeros((camera.lens.size, 0)), weights)
    found = solve_poses(problem, problem.state(camera.params, poses), max_iterations)
    return problem.poses(found.state), found.costs, found.converged


@dataclass(frozen=True)
class Solved:
    """Poses at their minima, the rest of the state as it was; `passes` counts evaluations of all views."""

    state: State
    costs: Array
    converged: Array
    passes: int


def solve_poses(problem: Problem, state: State, max_iterations: int = 100) -> Solved:
    """Minimise over the poses of a state alone; costs are inf where a view leaves the lens's domain."""
    size = problem.lens.size
    normal = problem.view_normals(state, partly=True)
    assert normal is not None
    costs, damping = _costs(normal), np.full(len(problem.views), 1e-4)
    converged = np.zeros(len(problem.views), bool)
    passes = 1
    for _ in range(max_iterations):
        step, predicted = _steps(normal[:, size:, size:], damping)
        converged |= np.isfinite(costs) & (predicted <= _TOLERANCE * costs + problem.rounding)
        active = ~converged & np.isfinite(costs) & (damping < 1e12)
        if not active.any():
            break
        step[~active] = 0.0
        trial = replace(
            state,
            rotations=rotations.exp(step[:, :3]) @ state.rotations,
            centres=state.centres + step[:, 3:],
        )
        trial_normal = problem.view_normals(trial, partly=True)
        assert trial_normal is not None
        passes += 1
        trial_costs = _costs(trial_normal)
        better = active & (trial_costs < costs)
        # a full step that gains nothing although little is predicted: rounding
        converged |= active & ~better & (predicted <= 1e-9 * costs) & (damping <= 1e-3)
        damping = np.where(better, np.maximum(damping * 0.03, 1e-12), damping * np.where(active, 20.0, 1.0))
        pick = better[:, None]
        state = replace(
            state,
            rotations=np.where(pick[..., None], trial.rotations, state.rotations),
            centres=np.where(pick, trial.centres, state.centres),
        )
        normal = np.where(pick[..., None], trial_normal, normal)
        costs = np.where(better, trial_costs, costs)
    return Solved(state, costs, converged, passes)


def _costs(normal: Array) -> Array:
    costs = 0.5 * normal[:, -1, -1]
    return np.where(np.isfinite(costs), costs, np.inf)


def _steps(normal: Array, damping: Array) -> tuple[Array, Array]:
    """Damped steps (V, 6) and the predicted decreases (V,) from the products (V, 7, 7) of the pose rows."""
    blocks = np.nan_to_num(normal[:, :6, :6].transpose(1, 2, 0).copy())
    diagonal = np.arange(6)
    scale = blocks[diagonal, diagonal].copy()
    blocks[diagonal, diagonal] = scale * (1.0 + damping) + 1e-300
    factor = cholesky(blocks)
    if factor is None:  # a view whose points do not fix its pose: hold all the harder
        blocks[diagonal, diagonal] += 1e-9 * scale.max(0) + 1e-300
        factor = cholesky(blocks)
    if factor is None:
        return np.zeros((len(normal), 6)), np.full(len(normal), np.inf)
    gradient = np.nan_to_num(normal[:, :6, 6].T)
    step = -back_substitution(factor, forward_substitution(factor, gradient))
    predicted = 0.5 * ((damping * scale * step**2).sum(0) - (gradient * step).sum(0))
    return step.T.copy(), predicted
