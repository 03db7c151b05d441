"""Small problems with their truth, for the tests of the refinement."""

from dataclasses import replace

import numpy as np

from camcal.data.observations import View
from camcal.geometry import rotations
from camcal.solve.board import BoardProblem, make_board
from camcal.solve.parameters import free_matrix
from camcal.solve.problem import Problem, Step
from tests import solved


def views_of(camera, count=5, noise=0.2, seed=0, ragged=False, sigma=False, xyz=None):
    """Views of a 9x6 board, or of `xyz`; with `ragged` each holds another number of points."""
    rng = np.random.default_rng(seed)
    xyz = solved.grid() if xyz is None else xyz
    poses = solved.tilted_poses(xyz, count, rng)
    data = solved.observe(camera, poses, xyz, noise, rng)
    made = []
    for i, view in enumerate(data.views):
        if ragged:
            view = view.take(rng.permutation(len(view))[: len(view) - 7 * i])
        if sigma:
            view = replace(view, sigma=rng.uniform(0.3, 2.0, len(view)))
        made.append(view)
    return tuple(made), poses


def problem_of(model="opencv5", fix=None, skew=False, board=None, normalise=True, offset=0.0, **more):
    """A problem and a state near its minimum, but not at it."""
    values = solved.TRUTH if model.startswith(("opencv", "brown", "pinhole")) else {}
    camera = solved.camera_of(model, values, skew)
    if not values:
        camera = replace(camera, params=camera.lens.examples()[0][0])
    views, poses = views_of(camera, **more)
    if offset:
        views = tuple(replace(v, xyz=v.xyz + offset) for v in views)
        poses = replace(poses, translation=poses.translations - offset * poses.rotations.sum(2))
    params = camera.params * 1.003
    free = free_matrix(camera.lens, params, fix or {})
    if board:
        problem = BoardProblem(camera.lens, views, free, make_board(views, board), normalise=normalise)
    else:
        problem = Problem(camera.lens, views, free, normalise=normalise)
    rng = np.random.default_rng(9)
    state = problem.state(params, poses)
    turned = rotations.exp(rng.normal(0, 0.003, (len(views), 3))) @ state.rotations
    return problem, replace(state, rotations=turned)


def step_of(problem, rng, size=1.0):
    """A random step, each unknown in a unit that suits it."""
    params = rng.normal(size=problem.variables)
    own = problem.free.shape[1]
    unit = np.abs(problem.free).T @ np.select(
        [[p.group in ("focal", "principal", "skew") for p in problem.lens.parameters]], [1.0], 1e-3
    )
    params[:own] *= unit
    params[own:] *= 1e-3
    poses = rng.normal(size=(len(problem.views), 6)) * np.r_[1e-3, 1e-3, 1e-3, 1e-2, 1e-2, 1e-2]
    return Step(size * params, size * poses)


def cost_of(problem, state):
    """½ Σ w |r|² by the lens's own projection, one view at a time."""
    total = 0.0
    poses = problem.poses(state)
    shape = getattr(problem, "board", None)
    offsets = None if shape is None else shape.expand(state.shape)
    for i, (view, pose) in enumerate(zip(problem.views, poses, strict=True)):
        xyz = view.xyz if offsets is None else view.xyz + offsets[shape.ids[i]]
        uv, valid = problem.lens.project(state.params, pose.apply(xyz))
        assert valid.all()
        w = np.ones(len(view)) if problem.weights is None else problem.weights[i]
        total += 0.5 * float((w[:, None] * (uv - view.uv) ** 2).sum())
    return total


def rig_views(camera, count=4, seed=3):
    """Views of points in space, each of another rig."""
    made, poses = [], None
    rng = np.random.default_rng(seed)
    xyz = solved.rig(seed)
    poses = solved.tilted_poses(xyz, count, rng)
    for i, pose in enumerate(poses):
        made.append(View(f"rig{i}", xyz, camera.project(pose.apply(xyz)) + rng.normal(0, 0.1, (len(xyz), 2))))
    return tuple(made), poses
