"""Small rigs with their truth, for the tests of problems of several cameras."""

from dataclasses import dataclass

import numpy as np

from camcal.data.observations import View
from camcal.geometry import rotations
from camcal.model.pose import Pose, Poses
from camcal.solve.board import BoardProblem, make_board
from camcal.solve.parameters import free_matrix
from camcal.solve.problem import Problem, Seen
from camcal.solve.state import State
from tests import solved

MODELS = ("opencv5", "kb4", "brown:radial=2")


@dataclass(frozen=True)
class Rig:
    """A problem, its state at the truth and a state near it."""

    problem: Problem
    truth: State
    near: State


def cameras_of(models):
    made = []
    for model in models:
        known = solved.TRUTH if model.startswith(("opencv", "brown")) else {}
        camera = solved.camera_of(model, known)
        params = camera.params if known else camera.lens.examples()[0][0]
        made.append((camera.lens, np.array(params, float)))
    return made


def rig_of(
    cameras=3,
    instants=5,
    noise=0.1,
    missing=(),
    sigma=False,
    board=None,
    normalise=True,
    seed=0,
    models=MODELS,
):
    """Cameras side by side that look at one board; `missing` are pairs (camera, instant) without a view."""
    rng = np.random.default_rng(seed)
    made, xyz = cameras_of(models[:cameras]), solved.grid()
    rig_from_board = solved.tilted_poses(xyz, instants, rng)
    shift = np.arange(cameras)[:, None] * [0.8, 0.1, 0.05]
    turn = rotations.exp(np.arange(cameras)[:, None] * [0.02, -0.05, 0.03])
    cam_from_rig = Poses(turn, shift)
    views, camera_of, instant_of = [], [], []
    for c, (lens, params) in enumerate(made):
        for i in rng.permutation(instants):  # in any order
            if (c, i) in missing:
                continue
            rows = np.sort(rng.permutation(len(xyz))[: len(xyz) - 6 * c - i % 20])  # parts of the board
            pose = composite(cam_from_rig[c], rig_from_board[i])
            uv, valid = lens.project(params, pose.apply(xyz[rows]))
            assert valid.all()
            sigmas = rng.uniform(0.3, 2.0, len(rows)) if sigma else None
            views.append(View(f"{c}-{i}", xyz[rows], uv + rng.normal(0, noise, uv.shape), sigmas, rows))
            camera_of.append(c)
            instant_of.append(i)
    fix = {"cx": None} if cameras > 1 else {}
    frees = [free_matrix(lens, p, fix if c == 1 else {}) for c, (lens, p) in enumerate(made)]
    seen = Seen(np.array(camera_of), np.array(instant_of))
    given = [lens for lens, _ in made], views, frees
    if board:
        problem = BoardProblem(*given, make_board(views, board), normalise=normalise, seen=seen)
    else:
        problem = Problem(*given, normalise=normalise, seen=seen)
    truth = problem.state(np.concatenate([p for _, p in made]), rig_from_board, cam_from_rig)
    near = problem.retract(truth, step_of(problem, rng))
    return Rig(problem, truth, near)


def composite(cam_from_rig, rig_from_board):
    """cam_from_board."""
    rotation = cam_from_rig.rotation @ rig_from_board.rotation
    return Pose(rotation, cam_from_rig.rotation @ rig_from_board.translation + cam_from_rig.translation)


def units_of(problem):
    """A step of about a pixel in each variable, (F + 6 V,)."""
    pixels = np.array([p.group in ("focal", "principal", "skew") for p in problem.parameters])
    own = np.abs(problem.free).T @ np.where(pixels, 1.0, 1e-3)
    rigid = np.tile([1e-3] * 3 + [1e-2] * 3, len(problem.cameras) - 1 + problem.instants)
    count = 6 * (len(problem.cameras) - 1)
    shape = np.full(problem.variables - problem.rigid, 1e-3)
    return np.r_[own, rigid[:count], shape, rigid[count:]]


def step_of(problem, rng, size=1.0):
    from camcal.solve import tangent

    vector = rng.normal(size=problem.variables + 6 * problem.instants) * units_of(problem)
    return tangent.unflat(size * vector, problem.variables)


def residuals_of(problem, state):
    """Weighted residuals view by view, straight from projections by composite poses."""
    board = getattr(problem, "board", None)
    offsets = None if board is None else board.expand(state.shape)
    poses, found = problem.poses(state), []
    for k, (view, c, i) in enumerate(
        zip(problem.views, problem.seen.camera, problem.seen.instant, strict=True)
    ):
        xyz = view.xyz if offsets is None else view.xyz + offsets[board.ids[k]]
        pose = composite(state.rig[c], poses[i])
        uv, valid = problem.cameras[c].lens.project(problem.params(state)[c], pose.apply(xyz))
        assert valid.all()
        sigma = 1.0 if view.sigma is None else view.sigma[:, None]
        found.append((uv - view.uv) / sigma)
    return found
