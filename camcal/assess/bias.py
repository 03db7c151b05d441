"""Tests of the residuals for departures from white noise, which reveal systematic errors.

Residuals are standardised by their own variance after the fit, sigma_0² (I - H) (`design.py`). Each test
addresses one question and gives a p-value; the p-values are corrected for multiple testing (Holm 1979). With
thousands of points, tests also detect irrelevant effects, so that each states the size of its effect.

The bias ratio follows Hagemann, Knorr, Janssen & Stiller (Inferring Bias and Uncertainty in Camera
Calibration, IJCV 2022): the target is divided into pieces of a few points, each with its own pose. The residuals
of the pieces contain only the noise of the detector, because the lens model and the board need to hold only within
a piece. With RSS the sum of squares of the calibration (2N - p degrees of freedom) and RSS' that of
the pieces (ν'),

    ratio = 1 - (2N - p) RSS' / (ν' RSS)                                                                (1)

is the share of the mean square that is not noise. Except for the lens parameters, the calibration is
nested in the model of the pieces, so that an F test applies to the ratio.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np

from camcal.assess.design import Design, Rows
from camcal.assess.figures import ranked, redundancy
from camcal.geometry.numbers import TINY, distinct
from camcal.least_squares.distributions import excess_kurtosis, f_exceeded, normal_exceeded, normality
from camcal.records import dataclass

Array = np.ndarray

#: of equal counts, at least 10 points each; 12 resolve a radial curve with several bends
RINGS, SECTORS = 12, 12
OF_A_RING = 10
#: points up to which all distances are computed, 96 MB of differences; for more points, adjacent ones in the list are
#: used as neighbours
ALL_DISTANCES = 2000
#: least number of pairs of neighbours for the mean of their products to be normally distributed
LEAST_PAIRS = 10
#: least number of values for the approximation of the kurtosis test (Anscombe & Glynn 1983)
LEAST_VALUES = 20
#: least degrees of freedom within the pieces: the noise variance is then known to sqrt(2 / 10) = 45 %
LEAST_FREEDOM = 10
#: points of a piece of the target for the bias ratio: at least so many, at most twice
PIECE = 6
#: least share of a point's noise in its residual: the residual of a point that the fit follows exactly is rounding
LEAST_LEFT = 1e-3


@dataclass(frozen=True)
class ResidualTest:
    """A test: its question, its p-value alone and after Holm's correction, and the size of the effect.

    `effect` is the share of the residuals' variance that the effect explains, or as stated by `unit`.
    """

    name: str
    question: str
    statistic: float
    p_value: float
    effect: float
    unit: str = "share of variance"
    p_corrected: float = float("nan")


@dataclass(frozen=True)
class BiasRatio:
    """Equation (1): the ratio, the noise of the detector (sigma of a coordinate), and the p-value."""

    ratio: float
    detector_sigma: float
    p_value: float
    pieces: int


@dataclass(frozen=True)
class Standardised:
    """Standardised residuals of all used points.

    Attributes
    ----------
    z : (M, 2) array
        Of variance 1 and uncorrelated in each point, if the model holds and the noise is white.
    on_board : (M, 2) array
        The same along the axes of the board.
    offset : (M, 2) array
        From the principal point, px.
    view, point : (M,) int arrays
        Indices; `point` numbers the points of the target by their coordinates.
    neighbours : (M',) float array
        z_i · z_j of each point and its nearest neighbour in the view, minus the expectation after the fit.
    """

    z: Array
    on_board: Array
    offset: Array
    view: Array
    point: Array
    neighbours: Array


def standardise(design: Design) -> Standardised:
    """The standardised residuals of a solution."""
    solution = design.calibration
    parts: list[tuple] = []
    by_point: dict[bytes, int] = {}
    of_boards: dict[bytes, tuple[Array, Array, Array]] = {}  # views of one board are alike
    for rows in design.rows():
        view = design.views[rows.view]
        z, roots = _whitened(design, rows)
        turn = _board_axes(design, rows.view)
        offset = view.uv - solution.camera.params[2:4]
        board = view.xyz.tobytes()
        if board not in of_boards:
            rounded = np.round(view.xyz, 9) + 0.0
            ids = np.array([by_point.setdefault(r.tobytes(), len(by_point)) for r in rounded])
            of_boards[board] = (ids, *_pairs(view.xyz))
        ids, first, second = of_boards[board]
        cross = roots[first] @ -design.hat(rows, first, second) @ roots[second].transpose(0, 2, 1)
        pairs = np.einsum("ni,ni->n", z[first], z[second]) - np.einsum("nii->n", cross)
        parts.append((z, np.einsum("nij,nj->ni", turn, z), offset, np.full(len(z), rows.view), ids, pairs))
    joined = [np.concatenate(a) for a in zip(*parts, strict=True)]
    return Standardised(*joined)


def _whitened(design: Design, rows: Rows) -> tuple[Array, Array]:
    """Residuals over the root of their own covariance, and the inverse roots (N, 2, 2) of I - H."""
    left = np.eye(2) - design.hat(rows)
    values, vectors = np.linalg.eigh((left + left.transpose(0, 2, 1)) / 2)
    roots = (vectors / np.sqrt(np.maximum(values, LEAST_LEFT))[:, None, :]) @ vectors.transpose(0, 2, 1)
    return np.einsum("nij,nj->ni", roots, rows.residuals) / design.sigma_0, roots


def _board_axes(design: Design, index: int) -> Array:
    """Rotations or reflections (N, 2, 2) from the image axes to the board's x and y at each point."""
    view, pose = design.views[index], design.calibration.poses[index]
    camera = design.calibration.camera
    by_xyz = camera.lens.jacobians(camera.params, pose.apply(view.xyz))[1]
    u, _, vt = np.linalg.svd(by_xyz @ pose.rotation[:, :2])
    return np.asarray((u @ vt).transpose(0, 2, 1))


def _pairs(xyz: Array) -> tuple[Array, Array]:
    """Pairs of each point and its nearest neighbour, each pair once."""
    if len(xyz) < 2:
        return np.zeros(0, int), np.zeros(0, int)
    if len(xyz) > ALL_DISTANCES:
        return np.arange(len(xyz) - 1), np.arange(1, len(xyz))
    gaps = np.linalg.norm(xyz[:, None] - xyz[None], axis=2)
    gaps[np.diag_indices(len(xyz))] = np.inf
    nearest = gaps.argmin(1)
    pairs = distinct(np.sort(np.c_[np.arange(len(xyz)), nearest], axis=1), axis=0)
    return pairs[:, 0], pairs[:, 1]


# ------------------------------------------------------------------ tests
def residual_tests(found: Standardised) -> list[ResidualTest]:
    """All tests with corrected p-values, in a fixed order."""
    radius = np.linalg.norm(found.offset, axis=1)
    outward = found.offset / np.maximum(radius, TINY)[:, None]
    across = np.c_[-outward[:, 1], outward[:, 0]]
    radial, tangential = (np.einsum("ni,ni->n", found.z, d) for d in (outward, across))
    length = np.linalg.norm(found.z, axis=1)
    sector = np.floor((np.arctan2(*found.offset.T[::-1]) / (2 * np.pi) + 0.5) * SECTORS).astype(int) % SECTORS
    made = [
        _means("radius", "Do residuals point outward or inward at some distances from the centre?",
               radial[:, None], _rings(radius)),
        _means("angle", "Do residuals turn or point outward in some directions from the centre?",
               np.c_[radial, tangential], sector),
        _means("board-position", "Are some points of the board displaced in the same way in all views?",
               found.on_board, found.point),
        _means("view", "Are some views noisier than others?", length[:, None], found.view, "share of spread"),
        _means("noise-by-radius", "Does the noise grow or shrink towards the border?",
               length[:, None], _rings(radius), "share of spread"),
        _correlation(found),
        _gaussian(found),
    ]  # fmt: skip
    return holm(made)


def _rings(radius: Array) -> Array:
    """The index of the ring of each radius; the rings hold equal counts."""
    rings = max(2, min(RINGS, len(radius) // OF_A_RING))
    return np.argsort(np.argsort(radius)) * rings // max(len(radius), 1)


def _means(
    name: str, question: str, values: Array, group: Array, unit: str = "share of variance"
) -> ResidualTest:
    """One-way analysis of variance of values (M, K), all columns together; only groups of at least two."""
    _, label, count = np.unique(group, return_inverse=True, return_counts=True)
    keep = count[label] >= 2
    values, label = values[keep], np.unique(label[keep], return_inverse=True)[1].reshape(-1)
    n, k, columns = len(values), int(label.max(initial=-1)) + 1, values.shape[1]
    if k < 2 or n - k < 2:
        return ResidualTest(name, question, float("nan"), 1.0, 0.0, unit)
    count = np.bincount(label)
    centred = values - values.mean(0)
    sums = np.stack([np.bincount(label, c, k) for c in centred.T], 1)
    between = float((sums**2 / count[:, None]).sum())
    total = float((centred**2).sum())
    within = max(total - between, TINY)
    free, rest = columns * (k - 1), columns * (n - k)
    statistic = between / free / (within / rest)
    share = 1 - within / rest / max(total / (columns * (n - 1)), TINY)
    return ResidualTest(
        name, question, statistic, float(f_exceeded(statistic, free, rest)), max(share, 0.0), unit
    )


def _correlation(found: Standardised) -> ResidualTest:
    """Neighbouring points: the mean of z_i · z_j / 2, which is 0 for white noise."""
    question = "Do neighbouring points have errors in the same direction?"
    pairs = found.neighbours / 2
    if len(pairs) < LEAST_PAIRS:
        return ResidualTest("neighbours", question, float("nan"), 1.0, 0.0, "correlation")
    mean = float(pairs.mean())
    # of two products of independent standard normals: variance 1, halved sum 1/2
    statistic = mean / np.sqrt(0.5 / len(pairs))
    return ResidualTest(
        "neighbours", question, statistic, float(normal_exceeded(statistic)), mean, "correlation"
    )


def _gaussian(found: Standardised) -> ResidualTest:
    """D'Agostino & Pearson's test of skewness and kurtosis; the effect is the excess kurtosis."""
    question = "Do the residuals follow a Gaussian?"
    flat = found.z.ravel()
    if len(flat) < LEAST_VALUES:
        return ResidualTest("gaussian", question, float("nan"), 1.0, 0.0, "excess kurtosis")
    statistic, p = normality(flat)
    return ResidualTest("gaussian", question, statistic, p, excess_kurtosis(flat), "excess kurtosis")


def holm(found: list[ResidualTest]) -> list[ResidualTest]:
    """Holm's correction: p-values that are valid for all tests together."""
    order = sorted(range(len(found)), key=lambda i: ranked(found[i].p_value))
    corrected, worst = [0.0] * len(found), 0.0
    for rank, i in enumerate(order):
        worst = max(worst, min(1.0, (len(found) - rank) * found[i].p_value))
        corrected[i] = worst
    return [replace(t, p_corrected=p) for t, p in zip(found, corrected, strict=True)]


# ------------------------------------------------------------------ bias ratio
def bias_ratio(design: Design) -> BiasRatio | None:
    """Equation (1); None if no view can be divided into pieces."""
    square, freedom, pieces, covered, points = 0.0, 0, 0, 0.0, 0
    of_boards: dict[bytes, list[Array]] = {}
    for rows in design.rows():
        covered += float((rows.residuals**2).sum())
        points += len(rows.residuals)
        xyz = design.views[rows.view].xyz
        board = xyz.tobytes()
        if board not in of_boards:
            of_boards[board] = _by_size(cut(xyz))
        for same in of_boards[board]:
            left, spare = _without_poses(rows, same)
            square, freedom, pieces = square + left, freedom + spare, pieces + len(same)
    own = redundancy(design.calibration)
    if not pieces or freedom < LEAST_FREEDOM or own <= freedom or covered <= 0:
        return None
    noise = square / freedom
    statistic = max(covered - square, 0.0) / (own - freedom) / noise
    ratio = 1 - own * noise / covered
    p_value = float(f_exceeded(statistic, own - freedom, freedom))
    return BiasRatio(ratio, float(np.sqrt(noise)), p_value, pieces)


def cut(xyz: Array, least: int = PIECE) -> Iterator[Array]:
    """Indices of neighbouring points, `least` to twice as many, by repeatedly halving the longer side."""
    stack = [np.arange(len(xyz))]
    while stack:
        index = stack.pop()
        if len(index) < 2 * least:
            yield index
            continue
        axis = int(np.ptp(xyz[index], axis=0).argmax())
        order = index[np.argsort(xyz[index, axis], kind="stable")]
        stack += [order[: len(order) // 2], order[len(order) // 2 :]]


def _by_size(pieces: Iterable[Array]) -> list[Array]:
    """Pieces (N,) of the same number of points as (K, N), for each number."""
    found: dict[int, list[Array]] = {}
    for piece in pieces:
        found.setdefault(len(piece), []).append(piece)
    return [np.stack(same) for same in found.values()]


def _without_poses(rows: Rows, pieces: Array) -> tuple[float, int]:
    """The sum of squares of pieces (K, N) after fitting a pose to each, and their degrees of freedom."""
    scaled = rows.pose / np.linalg.norm(rows.pose.reshape(-1, 6), axis=0)
    basis, _ = np.linalg.qr(scaled[pieces].reshape(len(pieces), -1, 6))
    r = rows.residuals[pieces].reshape(len(pieces), -1)
    taken = np.einsum("kni,kn->ki", basis, r)
    return float(np.square(r).sum() - np.square(taken).sum()), r.size - 6 * len(pieces)
