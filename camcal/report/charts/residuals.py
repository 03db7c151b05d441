"""Charts of the residuals: over the picture, their distribution, by view, by radius."""

from __future__ import annotations

import numpy as np

from camcal.assess import figures
from camcal.assess.checks.facts import Facts
from camcal.plan.solution import Solution
from camcal.report.charts.base import Arrows, Bars, Chart, Line, Points, round_down

Array = np.ndarray

#: largest number of arrows or dots: more would overlap, and enlarge the page
MOST = 2500
#: fraction of the picture's width to which the 95th percentile of the arrows is enlarged
ARROW = 0.04
LEAST_OF_CELL = 4  #: points of a cell whose mean is drawn: it is then known to half the noise
LEAST_POINTS = 10  #: for a histogram, and of a ring
LEAST_RINGS = 3  #: least number that shows curvature
LEAST_LENGTH = 1e-12  #: px; residuals of exact data are not enlarged beyond what this gives
RINGS = 20  #: of equal counts: from 500 points on, the mean of each is known to a fifth of the noise


def thinned(count: int, most: int = MOST) -> Array:
    """At most `most` evenly spaced indices of `count` items."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).astype(int)) if count else np.zeros(0, int)


def picture_limits(facts: Facts) -> tuple[tuple[float, float], tuple[float, float]]:
    """The axes of a picture: its outermost pixels."""
    (left, top), (right, bottom) = facts.low_high
    return (float(left) - 0.5, float(right) + 0.5), (float(top) - 0.5, float(bottom) + 0.5)


def enlargement(lengths: Array, width: float) -> float:
    """The factor, of 1, 2, 5, 10, ..., by which arrows of these lengths, px, are enlarged."""
    usual = float(np.percentile(lengths, 95)) if len(lengths) else 1.0
    return round_down(ARROW * width / max(usual, LEAST_LENGTH))


def quiver(solution: Solution) -> Chart | None:
    """Residuals as arrows over the picture, thinned, and their mean in each cell of 12 columns."""
    facts = Facts(solution)
    uv, r = facts.image_points, solution.used_residuals
    good = np.isfinite(r).all(1)
    uv, r = uv[good], r[good]
    if not len(r):
        return None
    x, y = picture_limits(facts)
    scale = enlargement(np.linalg.norm(r, axis=1), 2 * (x[1] - x[0]))
    some = thinned(len(r))
    places, means = cell_means(uv, r, x, y)
    return Chart(
        "Residuals over the picture",
        f"Predicted minus observed points, {scale:g} times enlarged. Noise has all directions, so that its "
        "mean over a cell is short; arrows that agree with their neighbours show that the lens model or the shape of "
        "the board is wrong.",
        "u, px",
        "v, px",
        x,
        y,
        (
            Arrows(uv[some], scale * r[some], tone="faint", label="single points"),
            Arrows(places, scale * means, tone="accent", label="mean of a cell"),
        ),
        picture=True,
    )


def cell_means(
    uv: Array, r: Array, x: tuple[float, float], y: tuple[float, float], columns: int = 12
) -> tuple[Array, Array]:
    """Mean positions (C, 2) and mean residuals (C, 2) of the cells with at least `LEAST_OF_CELL` points."""
    side = (x[1] - x[0]) / columns
    index = np.floor((uv - [x[0], y[0]]) / side).astype(int)
    _, cell = np.unique(index, axis=0, return_inverse=True)
    cell = cell.reshape(-1)
    count = np.bincount(cell)
    enough = count >= LEAST_OF_CELL
    sums = [np.bincount(cell, column) for column in (*uv.T, *r.T)]
    means = np.array(sums)[:, enough] / count[enough]
    return means[:2].T, means[2:].T


def histogram(solution: Solution) -> Chart | None:
    """The coordinates of the residuals with the Gaussian of their estimated sigma."""
    r, sigma, unit = standardised(solution)
    if len(r) < LEAST_POINTS or not np.isfinite(sigma) or sigma <= 0:
        return None
    reach = 4.5 * sigma
    edges = np.linspace(-reach, reach, 46)
    counts = np.histogram(np.clip(r, -reach, reach), edges)[0]
    density = counts / counts.sum() / np.diff(edges)
    at = np.linspace(-reach, reach, 121)
    bell = np.exp(-0.5 * (at / sigma) ** 2) / (sigma * np.sqrt(2 * np.pi))
    return Chart(
        "Histogram of the residuals",
        f"Both coordinates together, with the Gaussian of their estimated sigma, {sigma:.3g} {unit}. Bars far "
        "out or much higher in the middle than the curve indicate points that do not fit.",
        "residual, px" if unit == "px" else "residual, in sigmas of its point",
        "density",
        (-reach, reach),
        (0.0, 1.08 * float(max(density.max(), bell.max()))),
        (
            Bars(density, edges=edges, label="residuals"),
            Line(np.c_[at, bell], tone="second", label="Gaussian"),
        ),
    )


def standardised(solution: Solution) -> tuple[Array, float, str]:
    """Coordinates (M,) of the used residuals, their estimated sigma, and the unit: px, or given sigmas."""
    sigma = solution.observations.sigma
    given = sigma is not None
    flat = solution.used_residuals
    if sigma is not None:
        flat = flat / np.where(np.isnan(sigma), 1.0, sigma)[solution.used, None]
    flat = flat.ravel()
    flat = flat[np.isfinite(flat)]
    return flat, figures.sigma_0(solution), "times those given with the points" if given else "px"


def views(solution: Solution) -> Chart | None:
    """The rms of each view."""
    names = [v.id for v in solution.observations.views]
    if len(names) < 2:
        return None
    rms = np.array([f.rms_point for f in figures.per_view(solution)])
    usual = float(np.nanmedian(rms))
    bad = rms > 2 * usual
    return Chart(
        "Reprojection error by view",
        f"rms of each view; the median is {usual:.3g} px. "
        + (f"Above twice that: {int(bad.sum())}." if bad.any() else "None is above twice that."),
        "view",
        "rms_point, px",
        (-0.6, len(names) - 0.4),
        (0.0, 1.08 * float(np.nanmax(rms)) or 1.0),
        (
            Bars(rms, names=names, bad=bad),
            Line(np.array([[-0.6, usual], [len(names) - 0.4, usual]]), tone="text", dashed=True),
        ),
    )


def by_radius(solution: Solution) -> Chart | None:
    """Radial residuals against the distance from the principal point, with the mean of each ring."""
    facts = Facts(solution)
    d = facts.image_points - facts.camera.params[2:4]
    r, radius = solution.used_residuals, np.linalg.norm(d, axis=1)
    good = np.isfinite(r).all(1) & (radius > 0)
    radius, along = radius[good], np.einsum("ij,ij->i", r[good], d[good]) / radius[good]
    sigma = float(np.std(along)) if len(along) else 0.0
    if len(along) < LEAST_POINTS * LEAST_RINGS or sigma == 0:
        return None
    order = np.argsort(radius)
    rings = np.array_split(order, min(RINGS, len(order) // LEAST_POINTS))
    middle = np.array([radius[g].mean() for g in rings])
    mean = np.array([along[g].mean() for g in rings])
    error = np.array([along[g].std() / np.sqrt(len(g)) for g in rings])
    band = np.r_[np.c_[middle, mean - 2 * error], np.c_[middle, mean + 2 * error][::-1]]
    some = thinned(len(along))
    reach = 3.5 * sigma
    return Chart(
        "Radial residuals by distance from the principal point",
        "The band is the mean of a ring with two standard errors. It should include zero everywhere: where it "
        "departs from zero, the radial terms of the model do not describe the lens.",
        "distance from the principal point, px",
        "residual outward, px",
        (0.0, 1.02 * float(radius.max())),
        (-reach, reach),
        (
            Points(np.c_[radius, along][some], tone="faint", radius=1.2, label="points"),
            Line(band, tone="accent", closed=True, filled=True),
            Line(np.c_[middle, mean], tone="accent", label="mean of a ring"),
            Line(np.array([[0, 0], [1.02 * radius.max(), 0]]), tone="text", dashed=True),
        ),
    )
