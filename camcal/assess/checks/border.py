"""Noise that varies over the picture although the estimate and its sigmas assume uniform noise.

With s_k the noise of ring k about the principal point and J_i the camera's rows of point i once the poses have
followed (`design.py`), the parameters of an estimate that weights all points alike scatter by

    C = S⁻¹ (Σ_i s_k(i)² J_iᵀ J_i) S⁻¹                                                                    (1)

instead of sigma_0² S⁻¹ (White, A heteroskedasticity-consistent covariance matrix estimator, Econometrica 48, 1980, with
the variance of the ring in the place of single squares).
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from camcal.assess.checks.facts import Facts
from camcal.assess.design import Design
from camcal.assess.warning import BY_CHANCE, CalibrationWarning
from camcal.least_squares.distributions import f_exceeded
from camcal.model.pose import Array

#: rings of equal numbers of points, and least points of each: its noise is then known to 16 %
RINGS, LEAST_POINTS = 6, 20
#: A sigma that is too small by this factor is reported: its 95 % interval contains the true value in 89 % ...
TOO_SMALL = 1.2
#: ... and by this it is doubtful: in 81 %
FAR_TOO_SMALL = 1.5


def noise_by_radius(facts: Facts) -> Iterator[CalibrationWarning]:
    """Noise that grows or shrinks towards the border without matching sigmas, where it affects the camera's
    sigmas.
    """
    data = facts.solution.observations
    if data.sigma is not None or data.weight is not None or facts.design is None:
        return
    ring = rings(facts)
    lengths = np.linalg.norm(facts.solution.used_residuals, axis=1)
    if ring is None or not _differ(lengths, ring):
        return
    noise = np.sqrt([np.square(lengths[ring == k]).mean() / 2 for k in range(RINGS)])
    ratios = too_small(facts.design, noise**2, ring)
    worst = int(np.argmax(ratios))
    if not ratios[worst] > TOO_SMALL:
        return
    trend = "grows" if noise[-1] > noise[0] else "shrinks"
    yield CalibrationWarning(
        "noise-by-radius",
        f"the noise {trend} towards the border, from {noise[0]:.2g} to {noise[-1]:.2g} px in a "
        f"coordinate, but the fit assumes uniform noise: sigmas are up to {ratios[worst]:.1f} times too "
        f"small ({_named(facts, worst)}).",
        "Give sigmas with the points (a column sigma), or use a smaller aperture or a better lens.",
        "doubtful" if ratios[worst] > FAR_TOO_SMALL else "note",
    )


def rings(facts: Facts) -> Array | None:
    """The ring (M,) of each used point, from the principal point outwards; None for too few points."""
    radius = np.linalg.norm(facts.image_points - facts.camera.params[2:4], axis=1)
    if len(radius) < RINGS * LEAST_POINTS:
        return None
    return np.argsort(np.argsort(radius)) * RINGS // len(radius)


def _differ(lengths: Array, ring: Array) -> bool:
    """Return whether the residuals' lengths (M,) differ between rings significantly, by an analysis of variance."""
    means = np.array([lengths[ring == k].mean() for k in range(RINGS)])
    counts = np.bincount(ring, minlength=RINGS)
    within = float(np.square(lengths - means[ring]).sum()) / (len(lengths) - RINGS)
    between = float((counts * np.square(means - lengths.mean())).sum()) / (RINGS - 1)
    return bool(within > 0 and f_exceeded(between / within, RINGS - 1, len(lengths) - RINGS) < BY_CHANCE)


def too_small(design: Design, variances: Array, ring: Array) -> Array:
    """The factor by which the sigma of each free parameter (F,) is too small: the root of (1) over the reported one.

    Parameters
    ----------
    design : Design
    variances : (K,) array
        Of a coordinate in each ring, px².
    ring : (M,) int array
        Of each used point, view by view.
    """
    starts = np.r_[0, np.cumsum([len(v) for v in design.views])]
    meat = np.zeros_like(design.inverse)
    for rows in design.rows():
        own = design.of_camera(rows)
        at = ring[starts[rows.view] : starts[rows.view + 1]]
        meat += np.einsum("ncf,n,ncg->fg", own, variances[at], own, optimize=True)
    real = np.diag(design.inverse @ meat @ design.inverse)
    stated = design.sigma_0**2 * np.diag(design.inverse)
    return np.sqrt(np.divide(real, stated, out=np.ones(len(real)), where=stated > 0))


def _named(facts: Facts, free: int) -> str:
    """The parameters that a free one changes."""
    design = facts.design
    assert design is not None
    moved = design.transform[:, free] != 0
    return ", ".join(n for n, m in zip(facts.camera.lens.names, moved, strict=True) if m)
