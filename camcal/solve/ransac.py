"""The points of a view that agree with one model: LO-RANSAC with a joint estimate of the noise (LMedS).

Fischler & Bolles 1981; the scale from the least median of squares (Rousseeuw & Leroy 1987, section 5.1),
because the noise is seldom known and residuals of a pinhole map contain the lens's distortion;
local optimisation of each new best model (Chum, Matas & Kittler 2003). Hypotheses are solved and scored in
batches.

The model of a view is a homography or a projection matrix if the camera is unknown, and a pose
(`p3p.py`) if it is known.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from camcal.data.observations import View
from camcal.geometry import dlt, homography, projective
from camcal.least_squares.scales import of_small_sample
from camcal.model.camera import Camera
from camcal.model.pose import Array, Poses
from camcal.records import dataclass
from camcal.solve import p3p
from camcal.solve.losses import RAYLEIGH_MEDIAN
from camcal.solve.poses import refine_poses

#: probability that at least one sample is free of outliers ...
CONFIDENCE = 0.999
#: ... if this share of the points is good. The median breaks down below one half.
LEAST_GOOD = 0.55
#: ... or this, if the noise is known
LEAST_GOOD_KNOWN = 1 / 3
#: hypotheses solved and scored at a time
_BATCH = 128
#: of a batch, this many best hypotheses are refitted if their score is at most this many times the lowest so far.
#: On 150 views of 54 points with 35 % outliers, more (6 within 3 times) lowers the scale found by .7 % and takes twice
#: as long; fewer (the best alone) raises it by .2 %
_OPTIMISED, _NEAR = 3, 1.5
#: largest number of refits of a hypothesis; they end when the score no longer decreases
_REFITS = 4
#: points that determine a hypothesis, by the number of their coordinates: of a homography, of a projection matrix
SAMPLE = {2: 4, 3: 6}
#: a point agrees up to this many σ: 1 % of Gaussian ones do not
_REACH = 3.03
#: σ below this, px, means that the data are exact
_FLOOR = 1e-6


class Model(Protocol):
    """The model interface of RANSAC; a hypothesis is a matrix (3, d + 1).

    Errors are lengths, px, those of points with given sigmas divided by sigma over the view's median sigma.
    """

    sample: int  #: number of points that determine it

    def __len__(self) -> int:
        """Number of points N."""
        ...

    def hypotheses(self, picks: Array) -> tuple[Array, Array]:
        """Matrices (H, 3, d + 1) from samples (H, n) of point indices, and errors (H, N)."""
        ...

    def fit(self, rows: Array, start: Array) -> tuple[Array, Array]:
        """The matrix (3, d + 1) fitted to the points `rows` (K,), and errors (N,)."""
        ...


@dataclass(frozen=True)
class Agreement:
    """The largest consistent subset of the points.

    Attributes
    ----------
    mask : (N,) bool array
    sigma : float
        Scatter of one coordinate about the model, px: noise and model errors; NaN if there are too few points.
    matrix : (3, d + 1) array or None
        The model; None if there are too few points.
    """

    mask: Array
    sigma: float
    matrix: Array | None


def samples_needed(size: int, confidence: float = CONFIDENCE, good: float = LEAST_GOOD) -> int:
    """Number of samples of `size` points such that one is free of outliers with this confidence."""
    return int(np.ceil(np.log1p(-confidence) / np.log1p(-(good**size))))


def agreeing(
    model: Model, rng: np.random.Generator, sigma: float | None = None, confidence: float = CONFIDENCE
) -> Agreement:
    """The points that agree with the best hypothesis.

    Parameters
    ----------
    model : Model
    rng : Generator
    sigma : float, optional
        The noise of a coordinate, px, if it is known. Hypotheses are then scored by squared errors
        truncated at the limit of that noise (MSAC, Torr & Zisserman 2000), and LEAST_GOOD_KNOWN of the points
        suffice; without it by the median error.
    confidence : float
        Probability of a sample without outliers, if the least share of the points is good.
    """
    n = len(model)
    nothing = Agreement(np.ones(n, bool), float("nan"), None)
    if n < 2 * model.sample:
        return nothing
    wanted = samples_needed(model.sample, confidence, LEAST_GOOD if sigma is None else LEAST_GOOD_KNOWN)
    best, least = nothing, np.inf
    for begin in range(0, wanted, _BATCH):
        picks = np.argsort(rng.random((min(_BATCH, wanted - begin), n)), axis=1)[:, : model.sample]
        matrices, errors = model.hypotheses(picks)
        scores = _scores(errors, sigma)
        for h in np.argsort(scores)[:_OPTIMISED]:
            if not scores[h] <= _NEAR * least:
                break
            found, score = _optimise(model, matrices[h], errors[h], sigma)
            if score < least:
                best, least = found, score
    return best


def _scores(errors: Array, sigma: float | None) -> Array:
    """The scores (H,), to be minimised, of errors (H, N)."""
    if sigma is None:
        return np.median(errors, axis=1)
    return np.square(np.minimum(errors, _REACH * sigma)).mean(1)


def _optimise(model: Model, matrix: Array, error: Array, sigma: float | None) -> tuple[Agreement, float]:
    """Refit to the points that agree with a hypothesis, a few times; return the last agreement and the lowest
    score.
    """
    n, least = len(model), np.inf
    best = Agreement(np.ones(n, bool), float("nan"), None)
    for _ in range(_REFITS):
        score = float(_scores(error[None], sigma)[0])
        if not score < least:
            break
        # Rousseeuw's scale with his correction for small samples
        scale = sigma or of_small_sample(n, model.sample) * score / RAYLEIGH_MEDIAN
        scale = max(scale, _FLOOR)
        best, least = Agreement(error <= _REACH * scale, scale, matrix), score
        if best.mask.sum() < model.sample:
            break
        matrix, error = model.fit(np.flatnonzero(best.mask), matrix)
    return best, least


def _relative(sigma: Array | None, count: int) -> Array:
    """Sigmas (N,) divided by their median; ones if there are none."""
    return np.ones(count) if sigma is None else sigma / np.median(sigma)


class Map:
    """A homography of points in a plane (N, 2), or a projection matrix of points in space (N, 3)."""

    def __init__(self, points: Array, uv: Array, sigma: Array | None = None):
        self.points, self.uv, self.relative = points, uv, _relative(sigma, len(uv))
        self.sample = SAMPLE[points.shape[1]]

    def __len__(self) -> int:
        """Number of points."""
        return len(self.points)

    def hypotheses(self, picks: Array) -> tuple[Array, Array]:
        """See `Model`."""
        matrices = self._solve(self.points[picks], self.uv[picks], self.relative[picks])
        return matrices, self._errors(matrices)

    def fit(self, rows: Array, start: Array) -> tuple[Array, Array]:
        """See `Model`; linear, without a starting value."""
        matrices, errors = self.hypotheses(rows[None])
        return matrices[0], errors[0]

    def _solve(self, points: Array, uv: Array, relative: Array) -> Array:
        with np.errstate(all="ignore"):
            if self.points.shape[1] == 2:
                matrices = homography.homographies(points, uv, relative**-2.0, steps=0)
            else:
                matrices = dlt.projection_matrices(points, uv, relative**-2.0)
        return np.nan_to_num(matrices, nan=0.0, posinf=0.0, neginf=0.0)

    def _errors(self, matrices: Array) -> Array:
        """Errors (H, N); inf at infinity."""
        with np.errstate(all="ignore"):
            q = projective.homogeneous(self.points) @ np.swapaxes(matrices, -1, -2)
            error = np.linalg.norm(q[..., :2] / q[..., 2:] - self.uv, axis=-1) / self.relative
        return np.where(np.isfinite(error), error, np.inf)


class PoseModel:
    """The pose of a view with respect to a known camera; its matrix is [R | t], cam_from_board."""

    sample = 3

    def __init__(self, camera: Camera, view: View):
        self.camera, self.view = camera, view
        self.relative = _relative(view.sigma, len(view))
        self.rays = camera.unproject(view.uv)

    def __len__(self) -> int:
        """Number of points."""
        return len(self.view)

    def hypotheses(self, picks: Array) -> tuple[Array, Array]:
        """See `Model`; of the up to four poses of a sample, the one with the lowest median error."""
        matrices = p3p.poses(self.view.xyz[picks], self.rays[picks])
        errors = self._errors(matrices.reshape(-1, 3, 4)).reshape(*matrices.shape[:2], -1)
        best = np.median(errors, axis=2).argmin(1)
        each = np.arange(len(picks))
        return matrices[each, best], errors[each, best]

    def fit(self, rows: Array, start: Array) -> tuple[Array, Array]:
        """See `Model`: the least-squares pose, from the start."""
        view = self.view.take(rows)
        poses, _, _ = refine_poses(self.camera, [view], Poses(start[None, :, :3], start[None, :, 3]))
        matrix = np.c_[poses.rotations[0], poses.translations[0]]
        return matrix, self._errors(matrix[None])[0]

    def _errors(self, matrices: Array) -> Array:
        """Errors (H, N); inf where a point does not project."""
        with np.errstate(all="ignore"):
            cam = self.view.xyz @ np.swapaxes(matrices[:, :, :3], 1, 2) + matrices[:, None, :, 3]
            error = np.linalg.norm(self.camera.project(cam) - self.view.uv, axis=-1) / self.relative
        return np.where(np.isfinite(error), error, np.inf)


def of_maps(views: Sequence[View], planar: Sequence[bool], seed: int = 0) -> list[Agreement]:
    """The points of each view that agree with one homography, or one projection matrix.

    Parameters
    ----------
    views : sequence of View
    planar : sequence of bool
        Which views hold points of a plane; these are used in the coordinates of their best plane.
    seed : int
        The same seed gives the same answer.
    """
    rng = np.random.default_rng(seed)
    found = []
    for view, flat in zip(views, planar, strict=True):
        points = view.xyz
        if flat:
            origin, axes, _ = projective.fit_plane(view.xyz)
            points = (view.xyz - origin) @ axes[:, :2]
        found.append(agreeing(Map(points, view.uv, view.sigma), rng))
    return found


def of_poses(
    views: Sequence[View], camera: Camera, seed: int = 0, sigma: float | None = None
) -> list[Agreement]:
    """The points of each view that agree with one pose with respect to a known camera (PnP).

    Parameters
    ----------
    views : sequence of View
    camera : Camera
    seed : int
        The same seed gives the same answer.
    sigma : float, optional
        The noise if it is known: px, or in units of the given sigmas.
    """
    rng = np.random.default_rng(seed)
    found = []
    for view in views:
        unit = 1.0 if view.sigma is None else float(np.median(view.sigma))
        noise = None if sigma is None else max(sigma * unit, _FLOOR)
        found.append(agreeing(PoseModel(camera, view), rng, noise))
    return found
