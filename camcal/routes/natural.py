"""Evaluation of a pair of cameras on arbitrary pictures: the vertical disparities of matches.

Vertical disparity needs no board, so that errors of a board do not affect it. Inliers are selected without the relative
pose under test: a fundamental matrix is fitted to the matches themselves (after removing lens distortion), and matches
that agree with it are kept. It may express any rotation, translation, focal length and principal point, so that a
calibration with errors in these keeps its matches and shows the full error. The inlier limit grows with the scatter of
the matches, so that errors of the distortion do not remove matches either.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from camcal.errors import DataError
from camcal.geometry import rotations
from camcal.geometry.neighbours import Neighbours
from camcal.least_squares.scales import MAD, TUKEY
from camcal.model.pose import Array
from camcal.model.rectification import PERSPECTIVE, Rectification
from camcal.records import dataclass
from camcal.routes.epipolar import LEAST, agreeing, fundamental

#: px; matches nearer than this to their own epipolar line always count: five times the scatter of the points of
#: `camcal.detect.matches`; of wrong matches, which may be anywhere in the picture, fewer than 1 in 100 are as near
NEAR = 1.0
#: neighbours whose mean estimates the systematic part; with 50 matches they extend over a fifth of the picture
NEIGHBOURS = 8
#: steps of the rotation, which converge quadratically from some degrees; finite-difference step, rad: cube root of eps
TURN_STEPS, TURN_STEP = 8, 1e-5


@dataclass(frozen=True)
class Natural:
    """Matches of a pair of pictures.

    Attributes
    ----------
    first, second : (N, 2) arrays, px
        In the original pictures.
    vertical, disparity : (N,) arrays, px of the rectified pictures
        Across the baseline and along it, first minus second.
    good : (N,) bool array
        Those that agree with each other.
    noise : (N,) array, px of the rectified pictures
        Difference of each `vertical` from the mean of its neighbours in picture and depth, scaled to the scatter of a
        single one: the random part, as calibration errors vary slowly. NaN where `good` is False.
    """

    first: Array
    second: Array
    vertical: Array
    disparity: Array
    good: Array
    noise: Array


def judge(pair: Rectification, first: Array, second: Array, name: str = "the pair") -> Natural:
    """Vertical disparities of matches (N, 2) between the original pictures.

    Raises
    ------
    DataError
        If fewer than eight matches lie in both rectified pictures or agree with each other.
    """
    disparity, vertical = pair.disparities(first, second)
    shown = np.isfinite(vertical)
    if shown.sum() < LEAST:
        raise _too_few(name, int(shown.sum()))
    first, second, vertical, disparity = first[shown], second[shown], vertical[shown], disparity[shown]
    good = _agreeing(pair, first, second)
    if good.sum() < LEAST:
        raise _too_few(name, int(good.sum()))
    noise = np.full(len(good), np.nan)
    noise[good] = local_scatter(np.c_[first[good], disparity[good]], vertical[good])
    return Natural(first, second, vertical, disparity, good, noise)


@dataclass(frozen=True)
class Turn:
    """The rotation error of the second camera that would explain the vertical disparities.

    Attributes
    ----------
    vector, sigma : (3,) arrays, rad
        now_from_calibrated of the second camera, in its frame; sigma from the scatter of the matches.
    left : float
        Median size of the vertical disparities after it, px of the rectified pictures.
    """

    vector: Array
    sigma: Array
    left: float


def turn_of(pair: Rectification, first: Array, second: Array) -> Turn:
    """The rotation of the second camera that minimises the vertical disparities of matches (N, 2).

    Gauss-Newton steps on the vertical disparities v, with finite differences and the weights of Tukey
    (`scales.TUKEY`). Its sigmas are those of the matches alone, not of the calibration.
    """
    total, weight = np.zeros(3), np.ones(len(first))
    for _ in range(TURN_STEPS):
        v, j = _vertical_and_slopes(pair, first, second, total)
        scale = max(MAD * float(np.median(np.abs(v))), np.finfo(float).tiny)
        weight = np.clip(1 - np.square(v / (TUKEY * scale)), 0, None) ** 2
        normal = j.T @ (weight[:, None] * j)
        total = rotations.log(
            rotations.exp(-np.linalg.solve(normal, j.T @ (weight * v))) @ rotations.exp(total)
        )
    v, j = _vertical_and_slopes(pair, first, second, total)
    spread = np.linalg.inv(j.T @ (weight[:, None] * j)) * float(
        (weight * v**2).sum() / max(weight.sum() - len(total), 1)
    )
    back = pair.turns[1].T
    sigma = np.sqrt(np.maximum(np.diag(back @ spread @ back.T), 0.0))
    return Turn(-back @ total, sigma, float(np.median(np.abs(v))))


def _vertical_and_slopes(
    pair: Rectification, first: Array, second: Array, turn: Array
) -> tuple[Array, Array]:
    """Vertical disparities (N,) after rotating the second camera's rays in the rectified frame, and slopes (N, 3)."""

    def vertical(extra: Array) -> Array:
        turned = rotations.exp(extra) @ rotations.exp(turn) @ pair.turns[1]
        return replace(pair, turns=np.stack([pair.turns[0], turned])).disparities(first, second)[1]

    ways = [(vertical(TURN_STEP * e) - vertical(-TURN_STEP * e)) / (2 * TURN_STEP) for e in np.eye(3)]
    v, j = vertical(np.zeros(3)), np.stack(ways, 1)
    good = np.isfinite(v) & np.isfinite(j).all(1)  # a rotation may move a point out of the rectified picture
    return np.where(good, v, 0.0), np.where(good[:, None], j, 0.0)


def _agreeing(pair: Rectification, first: Array, second: Array) -> Array:
    """The matches that agree: with a fundamental matrix for perspective pictures, with the same relation between
    unit rays for wide-angle ones.
    """
    if pair.projection == PERSPECTIVE:
        found = fundamental(pair.rectified(0, first), pair.rectified(1, second), least=NEAR)
        assert found is not None  # there are eight
        return found[1]
    a, b = (c.unproject(uv) for c, uv in zip(pair.cameras, (first, second), strict=True))
    return agreeing(a, b, NEAR / pair.focal, axes=3)[1]


def local_scatter(places: Array, values: Array) -> Array:
    """Each value minus the mean of its nearest points, over √(1 + 1/k): for pure noise, this has the noise's
    variance.

    `places` (N, 3) are pixels and disparities, each column in units of its spread: the effect of a wrong translation
    depends on depth.
    """
    places = places / np.maximum(places.std(0), 1e-12)
    count = min(NEIGHBOURS, len(places) - 1)
    _, nearest = Neighbours(places).query(places, count + 1)
    return np.asarray((values - values[nearest[:, 1:]].mean(1)) / np.sqrt(1 + 1 / count))


def _too_few(name: str, count: int) -> DataError:
    return DataError(
        f"{name}: {count} points were found in both pictures; {LEAST} are needed.",
        "Take pictures of a textured scene, both at the same instant, and check which camera took which.",
    )
