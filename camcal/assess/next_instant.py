"""Suggestion of board poses that best determine the baselines of a rig.

An instant adds its information before it is taken, as a view does to one camera (`next_view.py`): with C the covariance
of the variables of cameras and rig, and S_k what the reduced normal equations of a candidate are,

    C_k = sigma_0² (sigma_0² C⁻¹ + S_k)⁻¹                                                               (1)

and the best is that after which the largest relative standard deviation of a distance is smallest. Where the board's
shape was estimated, it counts as known.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from itertools import combinations

import numpy as np

from camcal.assess.candidate_views import Candidates, target_points
from camcal.assess.covariance import Covariance, covariance, eliminate_poses, reduce
from camcal.assess.rig import baseline_sigma
from camcal.data.observations import View
from camcal.errors import DataError, EstimationError
from camcal.geometry import rotations
from camcal.model.pose import Pose, Poses
from camcal.records import dataclass
from camcal.solve.calibration import RigCalibration
from camcal.solve.common_points import common_points
from camcal.solve.problem import Problem, Seen
from camcal.solve.rig_cameras import within

Array = np.ndarray

#: candidate instants before each camera; the best of 60 is within a few per cent of the best of 400
CANDIDATES = 60
#: rad; a rig among boards is turned by up to so much from where it was: beyond, cameras no longer see them
TURN = 0.5
#: points of the board that a camera has to see for a pose of its own: below, a detector finds no board
LEAST_POINTS = 8


@dataclass(frozen=True)
class Suggestion:
    """A suggested next instant.

    Attributes
    ----------
    pose : Pose
        rig_from_board.
    cameras : tuple of str
        Those that see the board.
    relative : mapping of (camera, camera) -> float
        Standard deviation of each distance, as a part of it, with this instant added.
    """

    pose: Pose
    cameras: tuple[str, ...]
    relative: Mapping[tuple[str, str], float]

    @property
    def worst(self) -> float:
        """The largest of them."""
        return max(self.relative.values())


#: of each two cameras
Relative = dict[tuple[str, str], float]


def suggest(solution: RigCalibration, count: int = 1, seed: int = 0) -> tuple[Relative, list[Suggestion]]:
    """The current relative standard deviations, and suggested instants, each given those before it.

    Raises
    ------
    DataError
        If nothing of the rig was estimated, or no pose shows the board to two cameras.
    EstimationError
        If the data do not determine the rig, so that nothing can be added up.
    """
    if not solution.extrinsics:
        raise DataError(
            "no parameter of this rig was estimated, so no picture can improve it.",
            "Give the report of `camcal rig`, not of `camcal evaluate`.",
        )
    accuracy = covariance(solution)
    if accuracy.null.size or not np.isfinite(accuracy.sigma_0):
        raise EstimationError(
            "the data do not determine the rig, so no next picture can be suggested.",
            "Fix parameters (--fix), or take pictures in which the board fills the image of every camera.",
        )
    rigid = solution.free.shape[1] - (0 if solution.board is None else solution.board.size)
    known = accuracy.free[:rigid, :rigid]
    information = accuracy.sigma_0**2 * np.linalg.inv(known)
    tried = _candidates(solution, seed)
    found: list[Suggestion] = []
    for _ in range(count):
        rated = [
            Suggestion(pose, cameras, _relative(solution, accuracy, information + add))
            for add, pose, cameras in tried
        ]
        best = min(range(len(rated)), key=lambda i: rated[i].worst)
        found.append(rated[best])
        information = information + tried[best][0]
    return _relative(solution, accuracy, accuracy.sigma_0**2 * np.linalg.inv(known)), found


def _relative(solution: RigCalibration, accuracy: Covariance, information: Array) -> Relative:
    """The relative standard deviation of each baseline, with an information (F, F)."""
    size = accuracy.free.shape[0]
    free = np.zeros((size, size))
    rigid = len(information)
    free[:rigid, :rigid] = accuracy.sigma_0**2 * np.linalg.inv(information)
    then = replace(accuracy, free=free)
    return {
        (a, b): baseline_sigma(solution, then, a, b) / solution.rig.baseline(a, b)
        for a, b in combinations(solution.rig.cameras, 2)
    }


def _candidates(solution: RigCalibration, seed: int) -> list[tuple[Array, Pose, tuple[str, ...]]]:
    """The information of instants (F, F), their boards and the cameras that see them; none if only one camera sees
    them.
    """
    rng, made = np.random.default_rng(seed), []
    several = solution.board is not None and solution.board.placed > 0
    for name in solution.rig.cameras:
        alone = within(solution, name)
        if alone.camera.image_size is None:
            raise DataError("the report has no image size.", "Calibrate with --image-size.")
        points = _all_points(solution) if several else target_points(alone)
        planar = bool(np.ptp(points[:, 2]) == 0)
        back = solution.rig.cam_from_rig[name].inverse()
        tried = (
            _turned(solution, rng) if several else back @ Candidates(alone, planar).spread(CANDIDATES, rng)
        )
        for pose in Poses.of(tried):
            added = _added(solution, pose, points)
            if added is not None:
                made.append((added[0], pose, added[1]))
    if not made:
        raise DataError(
            "no pose was found that shows the board to two cameras at once.",
            "The fields of view hardly overlap: use a larger board, or rotate the cameras towards each other.",
        )
    return made


def _all_points(solution: RigCalibration) -> Array:
    """The points (N, 3) of all boards."""
    common = common_points(solution.observations.kept().views)
    assert common is not None  # or the boards could not have been placed
    return common[0]


def _turned(solution: RigCalibration, rng: np.random.Generator) -> Poses:
    """Poses of rigidly connected boards: those of instants with the rig rotated within the allowed range.

    Boards on all sides of a rig fit before no camera as a whole, so that poses before one camera say nothing.
    """
    some = solution.poses[rng.integers(len(solution.poses), size=CANDIDATES)]
    turns = rotations.exp(rng.uniform(-TURN, TURN, (CANDIDATES, 3)))
    return Poses.of(Poses(turns, np.zeros((CANDIDATES, 3))) @ some)


def _added(solution: RigCalibration, pose: Pose, points: Array) -> tuple[Array, tuple[str, ...]] | None:
    """S_k of a board, and the cameras that see it; None if fewer than two do."""
    views, cameras = [], []
    for index, (name, camera) in enumerate(solution.rig.cameras.items()):
        uv = camera.project((solution.rig.cam_from_rig[name] @ pose).apply(points))
        with np.errstate(invalid="ignore"):
            seen = ((uv > 0) & (uv < np.array(camera.image_size) - 1)).all(1)
        if seen.sum() >= LEAST_POINTS:
            views.append(View(name, points[seen], uv[seen]))
            cameras.append(index)
    if len(cameras) < 2:
        return None
    problem = _problem(solution, views, Seen(np.array(cameras), np.zeros(len(cameras), int)))
    params = np.concatenate([c.params for c in solution.cameras])
    places = Poses.stack(list(solution.rig.cam_from_rig.values()))
    blocks = problem.linearise(problem.state(params, Poses.stack([pose]), places))
    if blocks is None:
        return None
    normal = blocks.normal()
    names = list(solution.rig.cameras)
    return reduce(normal, eliminate_poses(normal)), tuple(names[i] for i in cameras)


def _problem(solution: RigCalibration, views: list[View], seen: Seen) -> Problem:
    frees, row = [], 0
    for camera in solution.cameras:
        own = solution.free[row : row + camera.lens.size]
        frees.append(own[:, own.any(0)])
        row += camera.lens.size
    return Problem([c.lens for c in solution.cameras], views, frees, seen=seen)
