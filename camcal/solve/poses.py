"""Refinement of poses with the camera held: each view is a problem of six unknowns, solved as a batch."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from camcal.data.observations import Observations, View
from camcal.geometry import rotations
from camcal.least_squares import Normal, Options, Small, minimise
from camcal.model.camera import Camera
from camcal.model.pose import Array, Poses
from camcal.records import dataclass
from camcal.solve.calibration import Estimate, RigCalibration
from camcal.solve.problem import Problem, Seen, State

#: of a view's cost: leaves an error of 1e-5 standard deviations in a pose from 50 points
_TOLERANCE = 1e-12


def refine_poses(
    camera: Camera, views: list[View] | tuple[View, ...], poses: Poses, max_iterations: int = 100
) -> tuple[Poses, Array, Array]:
    """Minimise the reprojection error of each view over its pose, independently.

    Parameters
    ----------
    camera : Camera
    views : V views
    poses : Poses
        Starts, cam_from_board.

    Returns
    -------
    poses : Poses
    costs : (V,) array
        ½ Σ w |r|² of each view; inf if a start is outside the lens's domain and no step corrects it.
    converged : (V,) bool array
    """
    problem = Problem(camera.lens, views, np.zeros((camera.lens.size, 0)))
    found = solve_poses(problem, problem.state(camera.params, poses), max_iterations)
    return problem.poses(found.state), found.costs, found.converged


def poses_before(fit: Estimate, observations: Observations, poses: Poses) -> Poses:
    """The poses of views that were not in a fit, with its camera or rig held, from given starts."""
    frees = [np.zeros((c.lens.size, 0)) for c in fit.cameras]
    kept = observations.kept()
    weights = kept.precision_by_view
    seen = Seen(kept.blocks.camera, kept.blocks.view)
    problem = Problem([c.lens for c in fit.cameras], kept.views, frees, weights, seen=seen)
    rig = Poses.stack(list(fit.rig.cam_from_rig.values())) if isinstance(fit, RigCalibration) else None
    state = problem.state(np.concatenate([c.params for c in fit.cameras]), poses, rig)
    return problem.poses(solve_poses(problem, state).state)


@dataclass(frozen=True)
class Solved:
    """Poses at their minima, the rest of the state unchanged; `passes` counts evaluations of the longest view."""

    state: State
    costs: Array
    converged: Array
    passes: int


def solve_poses(problem: Problem, state: State, max_iterations: int = 100) -> Solved:
    """Minimise over the poses of a state alone; costs are inf where a view's start is outside the lens's domain."""
    start = _Placed(state.rotations, state.centres)
    found, normal, stats = minimise(_PosesAlone(problem, state), start, Options(_TOLERANCE, max_iterations))
    moved = replace(state, rotations=found.rotations, centres=found.centres)
    return Solved(moved, normal.cost, stats.converged, int(stats.evaluations.max(initial=1)))


class _Placed(NamedTuple):
    """Rotations (M, 3, 3) and centres (M, 3) of the given instants, as in `State`."""

    rotations: Array
    centres: Array


class _PosesAlone(Small):
    """The instants of a problem, each with its pose."""

    def __init__(self, problem: Problem, state: State):
        self.problem, self.rest = problem, state
        self.count, self.rounding = problem.instants, problem.instant_rounding

    def linearise(self, state: _Placed, members: Array) -> Normal:
        """The pose's part of the normal equations."""
        turned, centres = self.rest.rotations.copy(), self.rest.centres.copy()
        turned[members], centres[members] = state
        normal = self.problem.pose_normals(replace(self.rest, rotations=turned, centres=centres), members)
        cost = 0.5 * normal[:, 6, 6]
        return Normal(np.where(np.isfinite(cost), cost, np.inf), normal[:, :6, :6], normal[:, :6, 6])

    def retract(self, state: _Placed, step: Array) -> _Placed:
        """exp(δ) R, t + δ."""
        return _Placed(rotations.exp(step[:, :3]) @ state.rotations, state.centres + step[:, 3:])
