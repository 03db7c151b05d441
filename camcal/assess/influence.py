"""The influence of each view on the camera, by block formulae instead of new solutions.

With S_v, g_v, S of `design.py`, leaving view v out moves the free parameters, to first order, by

    δ_v = (S - S_v)⁻¹ g_v                                                                              (1)

(Cook & Weisberg, Residuals and Influence in Regression, 1982, chapter 3, for a group of observations and with
the pose of the view eliminated). Under the model cov(δ_v) = sigma_0² ((S - S_v)⁻¹ - S⁻¹), so that

    t_v = δ_vᵀ cov(δ_v)⁻¹ δ_v / F                                                                       (2)

tests whether the view agrees with the others (F and about 2N - p degrees of freedom). The δ_v of all views
give the jackknife covariance (V-1)/V Σ δ_v δ_vᵀ (Efron 1982), the S_v and g_v the bootstrap over views in one
Newton step: neither assumes independent noise of neighbouring points, so that their ratio to the
covariance reveals correlated noise.
"""

from __future__ import annotations

import numpy as np

from camcal.assess.covariance import NULL
from camcal.assess.design import Design
from camcal.assess.figures import redundancy
from camcal.geometry.numbers import TINY
from camcal.least_squares.distributions import f_exceeded
from camcal.records import dataclass

Array = np.ndarray

#: eigenvalue against the largest below which a view has no effect in a direction: the spread is the difference of two
#: inverses, which leaves rounding there, 1e-16 times their condition
UNAFFECTED = 1e-8


@dataclass(frozen=True)
class Influence:
    """The effect of leaving out each view.

    Attributes
    ----------
    moves : (V, F) array
        δ_v of (1); NaN where the other views do not determine the camera.
    cook : (V,) array
        δ_vᵀ S δ_v / (F sigma_0²): Cook's distance, 1 = one standard deviation of all parameters together.
    p_values : (V,) array
        Of (2): how likely noise alone lets a view disagree as much with the others.
    share : (V,) array
        tr(S⁻¹ S_v) / F: the share of the information that the view holds; they add up to 1.
    """

    moves: Array
    cook: Array
    p_values: Array
    share: Array


def influence(design: Design) -> Influence:
    """The influence of each view on the camera."""
    total, count = design.information.sum(0), design.transform.shape[1]
    moves = np.full((len(design.views), count), np.nan)
    cook, p_values = np.full(len(moves), np.nan), np.full(len(moves), np.nan)
    share = np.einsum("ij,vji->v", design.inverse, design.information) / max(count, 1)
    scale = 1 / np.sqrt(np.where(np.diag(total) > 0, np.diag(total), 1.0))
    freedom = max(redundancy(design.calibration), 1)
    for v, (own, pull) in enumerate(zip(design.information, design.pull, strict=True)):
        rest = (total - own) * scale * scale[:, None]
        values, vectors = np.linalg.eigh(rest)
        if not count or values[0] <= NULL * max(values[-1], TINY):
            continue
        without = (vectors / values) @ vectors.T * scale * scale[:, None]
        moves[v] = without @ pull
        cook[v] = moves[v] @ total @ moves[v] / (count * design.sigma_0**2)
        spread = (without - design.inverse) * design.sigma_0**2
        p_values[v] = _p_value(moves[v], spread, freedom)
    return Influence(moves, cook, p_values, share)


def _p_value(move: Array, spread: Array, freedom: int) -> float:
    """The p-value of (2), over the directions that the view affects."""
    d = np.sqrt(np.maximum(np.diag(spread), TINY))
    values, vectors = np.linalg.eigh(spread / np.outer(d, d))
    good = values > UNAFFECTED * values[-1]
    along = vectors[:, good].T @ (move / d)
    statistic = float((along**2 / values[good]).sum()) / max(int(good.sum()), 1)
    return float(f_exceeded(statistic, int(good.sum()), freedom))


def jackknife(found: Influence) -> Array:
    """The jackknife covariance (F, F) of the free parameters over views; NaN if a view is indispensable."""
    count = len(found.moves)
    d = found.moves - found.moves.mean(0)
    return (count - 1) / count * d.T @ d


def bootstrap(design: Design, replicates: int = 200, seed: int = 0) -> Array:
    """The bootstrap covariance (F, F) of the free parameters over views, with one Newton step each."""
    rng = np.random.default_rng(seed)
    views, count = len(design.views), design.transform.shape[1]
    times = rng.multinomial(views, np.full(views, 1 / views), replicates).astype(float)
    total = np.einsum("rv,vij->rij", times, design.information)
    pull = np.einsum("rv,vi->ri", times, design.pull)
    scale = 1 / np.sqrt(np.maximum(np.diag(design.information.sum(0)), TINY))
    scaled = total * scale * scale[:, None]
    values, vectors = np.linalg.eigh(scaled)
    # a draw of few different views may leave the camera undetermined, and is left out
    good = values[:, 0] > NULL * values[:, -1]
    if not good.any():
        return np.full((count, count), np.nan)
    along = np.einsum("rij,ri->rj", vectors[good], pull[good] * scale)
    moves = -np.einsum("rij,rj->ri", vectors[good], along / values[good]) * scale
    return np.atleast_2d(np.cov(moves.T))
