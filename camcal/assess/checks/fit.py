"""The fit: whether it converged, and its residuals."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from camcal.assess import figures
from camcal.assess.checks.facts import Facts
from camcal.assess.difference import difference
from camcal.assess.fold_difference import covered_grid
from camcal.assess.uncertainty import projection_uncertainty
from camcal.assess.warning import CalibrationWarning
from camcal.errors import CamcalError
from camcal.geometry.numbers import TINY, median
from camcal.model.pose import Array
from camcal.solve.calibration import Calibration
from camcal.solve.losses import RAYLEIGH_MEDIAN
from camcal.solve.optimizers.base import Options
from camcal.solve.refine import How, refine

#: A point is gross beyond this many robust standard deviations of a coordinate: one Gaussian point in 6e7.
GROSS = 6.0
#: Share of the sum of squares above which gross points dominate the fit.
GROSS_SHARE = 0.25
#: rms relative to the image's diagonal above which the model or the assignment of points is wrong.
LARGE = 0.005
#: In large pictures that would be tens of px, more than any manual error: there the limit is this many px, or this
#: fraction of the diagonal if that is more (7 px of 6000x4000: clicks in a reduced view).
MANY_PX, CLICKED = 5.0, 0.001
#: Systematic: share of the radial residuals' variance that their mean by radius explains, and the F statistic
#: of that (20 rings). Gaussian noise gives F = 1 and never 8; real boards that fit give a share below .05.
EXPLAINED, F_LEAST, RINGS = 0.1, 8.0, 20
#: least points of a ring: their mean is then known to a third of the noise
OF_A_RING = 10
#: least number of rings in which curvature can be distinguished from a slope
LEAST_RINGS = 3
#: Coordinates per unknown below which residuals indicate little about errors.
REDUNDANT = 1.5

#: below so many coordinates per unknown, the residuals indicate almost nothing about the noise
BARELY = 1.2
#: Outliers make a camera wrong if the fit without them projects differently, by more than this many of its sigmas
#: (one camera in 400 by chance) and by more than `SEVERAL_PX`.
SIGMAS = 3.0
#: a systematic error of so many px (rms) is not a detector's: the camera projects wrongly by as much
SEVERAL_PX = 1.0
#: steps of the fit without outliers
STEPS = 20


def not_converged(facts: Facts) -> Iterator[CalibrationWarning]:
    """The optimiser stopped before it reached its criterion."""
    fit = facts.solution.fit
    if not fit.converged:
        yield CalibrationWarning(
            "not-converged",
            f"the refinement stopped after {fit.iterations} iterations before it converged "
            f"({fit.stop_reason}).",
            "Choose a model with fewer parameters, or add views.",
        )


def little_redundancy(facts: Facts) -> Iterator[CalibrationWarning]:
    """Hardly more observations than unknowns: the rms is small regardless of the errors."""
    unknown = facts.solution.free_count
    observed = unknown + figures.redundancy(facts.solution)
    if observed < REDUNDANT * unknown:
        yield CalibrationWarning(
            "few-points",
            f"{observed} coordinates for {unknown} unknowns: the rms is hardly related to the error.",
            "Use more points or views.",
            "doubtful" if observed < BARELY * unknown else "note",
        )


def outliers(facts: Facts) -> Iterator[CalibrationWarning]:
    """A few points that contribute much of the sum of squares, in units of their sigmas if given."""
    squares = np.square(figures.standard_lengths(facts.solution))
    off = np.linalg.norm(facts.solution.used_residuals, axis=1)[np.isfinite(squares)]
    squares = squares[np.isfinite(squares)]
    if not len(squares) or squares.sum() == 0:
        return
    gross = squares > (GROSS / RAYLEIGH_MEDIAN) ** 2 * median(squares)
    share = squares[gross].sum() / squares.sum()
    if share > GROSS_SHARE:
        yield CalibrationWarning(
            "outliers",
            f"{gross.sum()} of {len(squares)} points, off by up to {off[gross].max():.3g} px, account "
            f"for {share:.0%} of the sum of squares.",
            "Remove or correct these points, or use a robust loss (--robust).",
            "wrong" if _bent_by(facts, gross) else "doubtful",
        )


def _bent_by(facts: Facts, gross: Array) -> bool:
    """Return whether the camera without some of the used points (a mask of the finite ones) projects significantly
    differently.
    """
    apart, noise = moved_without(facts, gross)
    return apart > max(SEVERAL_PX, SIGMAS * noise)


def moved_without(facts: Facts, gross: Array) -> tuple[float, float]:
    """The change in projection without some of the used points (a mask of the finite ones), and its noise.

    rms over the part of the picture that points cover, at infinity, px. 0 if the fit without them fails.
    """
    solution = facts.solution
    finite = solution.used & np.isfinite(solution.residuals).all(1)
    kept = finite.copy()
    kept[np.flatnonzero(finite)[gross]] = False
    try:
        rest = solution.observations.with_used(kept)
        other = refine(
            solution.camera, solution.poses, rest, How(solution.held, stopping=Options(max_iterations=STEPS))
        )
    except CamcalError:
        return 0.0, np.inf
    grid, covered = covered_grid(solution)
    pixels = grid[covered]
    apart = difference(other.camera, facts.camera, pixels).rms_px
    return apart, stated_px(other, pixels)


def stated_px(solution: Calibration, pixels: Array) -> float:
    """The rms projection uncertainty at pixels (N, 2) by the covariance, at infinity, px; infinite where it is
    undetermined.
    """
    variance = np.einsum("nii->n", projection_uncertainty(solution).at_pixels(pixels))
    known = variance[np.isfinite(variance)]
    return float(np.sqrt(np.mean(known))) if len(known) else np.inf


def large_residuals(facts: Facts) -> Iterator[CalibrationWarning]:
    """An rms that no detector and no lens explains."""
    rms = facts.solution.rms_point
    if not rms <= most_px(facts.diagonal):
        yield CalibrationWarning(
            "large-residuals",
            f"the rms of {rms:.3g} px is large for an image {facts.diagonal:.0f} px across.",
            "Check the order of the points; for a wide lens choose a wide-lens model.",
            "wrong",
        )


def most_px(diagonal: float) -> float:
    """The rms, px, above which a camera is wrong for that reason alone, for a picture with this diagonal."""
    return min(LARGE * diagonal, max(MANY_PX, CLICKED * diagonal))


def systematic(facts: Facts) -> Iterator[CalibrationWarning]:
    """Residuals that depend on the distance from the principal point: the model does not fit the lens."""
    share, f = facts.once(radial_structure)
    if share > EXPLAINED and f > F_LEAST:
        yield CalibrationWarning(
            "systematic-residuals",
            f"{share:.0%} of the radial residuals' variance follows the distance from the principal point: "
            "the model does not describe this lens.",
            "Choose a model with more radial terms, or one for wide lenses (camcal list models).",
            "wrong" if np.sqrt(share) * _radial_rms(facts) > SEVERAL_PX else "doubtful",
        )


def radial_structure(facts: Facts) -> tuple[float, float]:
    """The share of variance (adjusted) of the radial residuals that the mean by radius explains, and its F
    statistic.
    """
    d = facts.image_points - facts.camera.params[2:4]
    radius = np.linalg.norm(d, axis=1)
    residuals = facts.solution.used_residuals
    good = (radius > 0) & np.isfinite(residuals).all(1)
    along = np.einsum("ij,ij->i", residuals[good], d[good]) / radius[good]
    rings = min(RINGS, len(along) // OF_A_RING)
    if rings < LEAST_RINGS:
        return 0.0, 0.0
    return _explained(along, np.array_split(np.argsort(radius[good]), rings))


def _radial_rms(facts: Facts) -> float:
    """Root mean square of the radial parts of the residuals, px."""
    d = facts.image_points - facts.camera.params[2:4]
    with np.errstate(invalid="ignore", divide="ignore"):
        along = np.einsum("ij,ij->i", facts.solution.used_residuals, d) / np.linalg.norm(d, axis=1)
    return float(np.sqrt(np.nanmean(along**2)))


def _explained(values: Array, groups: list[Array]) -> tuple[float, float]:
    """One-way analysis of variance."""
    n, k = len(values), len(groups)
    total = float(np.square(values - values.mean()).sum())
    between = sum(len(g) * (values[g].mean() - values.mean()) ** 2 for g in groups)
    within = max(total - between, TINY)
    share = 1 - within / max(total, TINY) * (n - 1) / (n - k)
    return share, float(between / (k - 1) / (within / (n - k)))
