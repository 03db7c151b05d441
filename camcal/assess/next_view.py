"""The next best view: the pose of the target that improves the camera most.

A view adds its information before it is taken: with S the reduced normal matrix of the views that are there and
S_c that of a candidate pose (`design.py` (1); only the Jacobian at the pose is needed, no observation),

    C_f = sigma_0² (S + S_c)⁻¹                                                                          (1)

and the projection uncertainty (`uncertainty.py`) with the candidate among the boards follows. Candidates are
spread over the picture, distances and tilts, the best of them are moved about a little; the best is that after
which the worst uncertainty over the picture is smallest (Rojtberg & Kuijper, Efficient Pose Selection for
Interactive Camera Calibration, ISMAR 2018, and Peng & Sturm, Calibration Wizard, ICCV 2019, choose poses in the
same spirit; the measure here is that of the report). Taking the best again and again tells how many pictures more
a requested uncertainty needs. Where the board's shape was estimated, it counts as known.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from itertools import islice

import numpy as np

from camcal.assess.candidate_views import Candidates
from camcal.assess.checks.facts import Facts
from camcal.assess.covariance import eliminate_poses
from camcal.assess.design import Design
from camcal.assess.difference import image_grid
from camcal.assess.uncertainty import projection_uncertainty, twists, worst_sigma
from camcal.geometry import rotations
from camcal.geometry.numbers import TINY
from camcal.model.pose import Pose, Poses
from camcal.records import dataclass
from camcal.solve.calibration import Calibration, NormalBlocks

Array = np.ndarray

CANDIDATES = 400  #: poses tried, of which the BEST are refined
#: The BEST poses are moved about in ROUNDS, each COPIES times, by DECAY as much as in the round before. Three rounds,
#: one pose, one copy or a decay of .3 leave the worst uncertainty larger by a quarter and more; twice as many of any
#: find no more than another seed does, and so does a decay of .95.
ROUNDS, BEST, COPIES, DECAY = 12, 12, 6, 0.75
#: after so many suggestions the best candidate is taken as it is: a pose matters less and less
MOVED = 10
#: columns of the map whose worst value counts
COLUMNS = 9
#: information added in directions that are undetermined, in parts of the columns' squares
_RIDGE = 1e-12


@dataclass(frozen=True)
class State:
    """The joint information of views: S (F, F), sums over the views of E B (6, F) and E A⁻¹ Eᵀ (6, 6).

    Also stacked, one along the first axis for each choice of a further view.
    """

    information: Array
    follow: Array
    own: Array
    views: int

    def __add__(self, other: State) -> State:
        return State(
            self.information + other.information,
            self.follow + other.follow,
            self.own + other.own,
            self.views + other.views,
        )

    def stacked_with(self, other: State) -> State:
        """The candidates of both, one set after the other."""
        own, others = ((s.information, s.follow, s.own) for s in (self, other))
        information, follow, own_part = (np.concatenate(pair) for pair in zip(own, others, strict=True))
        return State(information, follow, own_part, self.views)

    def __getitem__(self, index: Array | int) -> State:
        return State(self.information[index], self.follow[index], self.own[index], self.views)


@dataclass(frozen=True)
class Suggestion:
    """A suggested pose.

    Attributes
    ----------
    pose : Pose
        cam_from_board.
    worst, median : float
        The projection uncertainty over the picture with this view added, px.
    """

    pose: Pose
    worst: float
    median: float


class NextView:
    """The search for views that improve a solution.

    Parameters
    ----------
    solution : Calibration
    distance : float
        At which the uncertainty counts, unit of the data.
    candidates : int
    seed : int
        Of the candidate poses.

    Raises
    ------
    DataError
        If no pose shows the whole target.
    """

    def __init__(
        self, solution: Calibration, distance: float = np.inf, candidates: int = CANDIDATES, seed: int = 0
    ):
        self.solution, self.distance, self.seed = solution, distance, seed
        self.facts = Facts(solution)
        self.design = Design(solution)
        self.candidates = Candidates(solution, self.facts.planar)
        self.poses: Poses = self.candidates.spread(candidates, np.random.default_rng(seed))

    @cached_property
    def now(self) -> State:
        """The joint information of the existing views."""
        offsets = np.array([v.xyz.mean(0) for v in self.design.views])
        poses = self.solution.poses
        centres = poses.apply(offsets)
        reduced, turns = self.design.poses, twists(centres)
        return State(
            self.design.information.sum(0),
            (turns @ reduced.gain).sum(0),
            (turns @ reduced.inverse @ turns.transpose(0, 2, 1)).sum(0),
            len(self.design.views),
        )

    @cached_property
    def added(self) -> State:
        """The additional information of each candidate, stacked."""
        return self.of(self.poses)

    def of(self, poses: Poses) -> State:
        """The information of a view of the whole target in each pose, stacked."""
        camera, points = self.solution.camera, self.candidates.points
        offset, count = points.mean(0), len(poses)
        turned = np.einsum("kij,nj->kni", poses.rotations, points - offset)
        centres = poses.rotations @ offset + poses.translations
        cam = (turned + centres[:, None]).reshape(-1, 3)
        _, by_xyz, by_params, _ = camera.lens.jacobians(camera.params, cam)
        turn = -by_xyz @ rotations.skew(turned.reshape(-1, 3))
        free, pose = (
            rows.reshape(count, 2 * len(points), -1) / self._sigma
            for rows in (by_params @ self.design.transform, np.concatenate([turn, by_xyz], 2))
        )
        own, mixed, across = (a.transpose(0, 2, 1) @ b for a, b in ((free, free), (free, pose), (pose, pose)))
        reduced = eliminate_poses(NormalBlocks(own.sum(0), mixed, across))
        turns = twists(centres)
        return State(
            own - mixed @ reduced.gain,
            turns @ reduced.gain,
            turns @ reduced.inverse @ turns.transpose(0, 2, 1),
            1,
        )

    @cached_property
    def _sigma(self) -> float:
        """The sigma that a new point would be given; 1 without sigmas."""
        given = [v.sigma for v in self.design.views if v.sigma is not None]
        return float(np.median(np.concatenate(given))) if given else 1.0

    @cached_property
    def _jacobians(self) -> tuple[Array, Array]:
        pixels = image_grid(*self.facts.low_high, columns=COLUMNS)
        rays = self.solution.camera.unproject(pixels)
        rays = rays[np.isfinite(rays).all(1)]
        far = bool(np.isinf(self.distance))
        uncertainty = projection_uncertainty(self.solution, self.facts.covariance)
        by_params, by_frame = uncertainty.jacobians(rays if far else rays * self.distance, far)
        return by_params[:, :, : self.design.transform.shape[1]], by_frame

    def sigmas(self, state: State) -> Array:
        """Worst-direction sigmas (..., G) over the picture, px, for one state or several stacked."""
        by_params, by_frame = self._jacobians
        scale = 1 / np.sqrt(np.maximum(np.diag(self.design.normal.intrinsics), TINY))
        scaled = state.information * scale * scale[:, None] + _RIDGE * np.eye(len(scale))
        covariance = np.linalg.inv(scaled) * scale * scale[:, None]
        follow, own = state.follow / state.views, state.own / state.views**2
        moved = by_params - by_frame @ follow[..., None, :, :]
        found = moved @ covariance[..., None, :, :] @ np.swapaxes(moved, -1, -2)
        found = found + by_frame @ own[..., None, :, :] @ by_frame.transpose(0, 2, 1)
        flat = worst_sigma(found.reshape(-1, 2, 2)) * self.design.sigma_0
        return flat.reshape(found.shape[:-2])

    def best(self, count: int = 1) -> list[Suggestion]:
        """The best `count` views, each given those before it."""
        return list(islice(self.steps(), count))

    def steps(self) -> Iterator[Suggestion]:
        """The best view, the best after that, and so on without end."""
        rng = np.random.default_rng(self.seed + 1)
        state, taken = self.now, Poses.stack([])
        while True:
            new = self.candidates.unlike(self.poses, taken)
            poses, added = self.poses, self.added
            if new.any():  # otherwise all places were tried, and any may be repeated
                poses, added = poses[new], added[new]
            pose, view = self._moved(state, poses, added, taken, rng)
            state, taken = state + view, Poses.stack([*taken, pose])
            sigmas = self.sigmas(state)
            yield Suggestion(pose, float(sigmas.max()), float(np.median(sigmas)))

    def _moved(
        self, state: State, poses: Poses, added: State, taken: Poses, rng: np.random.Generator
    ) -> tuple[Pose, State]:
        """The best of the given poses and of perturbations of the best, with its information."""
        worst = self.sigmas(state + added).max(1)
        for i in range(ROUNDS if len(taken) < MOVED else 0):
            few = np.argsort(worst)[:BEST]
            near = self.candidates.around(poses[np.repeat(few, COPIES)], rng, DECAY**i)
            near = near[self.candidates.unlike(near, taken)]
            if not len(near):
                continue
            more = self.of(near)
            poses = Poses.stack([*poses[few], *near])
            added = added[few].stacked_with(more)
            worst = np.r_[worst[few], self.sigmas(state + more).max(1)]
        best = int(np.argmin(worst))
        return poses[best], added[best]

    def pictures_until(self, target: float, most: int = 100) -> int | None:
        """The number of further pictures until the worst uncertainty is `target` px; None if `most` are not
        enough.
        """
        if self.before[0] <= target:
            return 0
        found = (i for i, s in enumerate(islice(self.steps(), most), 1) if s.worst <= target)
        return next(found, None)

    @property
    def before(self) -> tuple[float, float]:
        """The current worst and median sigma over the picture, px."""
        sigmas = self.sigmas(self.now)
        return float(sigmas.max()), float(np.median(sigmas))
