"""Restricted maximum likelihood of three variances: of the image, of the robot's rotations, of its translations.

Eliminating the poses of the views from the linearised problem leaves, for view i,

    y_i = A_i β + e_i,   cov e_i = V_i = s² K_i + s_r² diag(I, 0) + s_t² diag(0, I),   K_i = J_i H_i⁻¹ J_iᵀ       (1)

with y_i the robot's residual at the pose from the picture alone, H_i the pictures' normal matrix of that pose, and
J_i the residual's derivative by it. With P = V⁻¹ − V⁻¹ A (Aᵀ V⁻¹ A)⁻¹ Aᵀ V⁻¹ the score of the variance k is
−½ (tr P V_k − yᵀ P V_k P y) and its information F_kl = ½ tr P V_k P V_l (Patterson & Thompson 1971;
Harville 1977, eq. 5.1).
The prior information on a jointly estimated camera (`joint.prior`) is added to Aᵀ V⁻¹ A. The residuals of the
pictures that no pose explains contribute a χ² term for s².
"""

from __future__ import annotations

import numpy as np
from scipy import stats

from camcal.model.pose import Array
from camcal.records import dataclass
from camcal.routes.hand_eye.joint import Linear, Noise, prior

#: Steps of the scoring; from any start within a factor of 1000 the variances are found to 1e-9 in about ten.
MOST_STEPS = 60
#: for the logarithms of the variances: the change that ends the steps (below all printed digits), the distance above
#: its lower bound at which a variance counts as inside, and the number of halvings of a step (to 1e-9 of it)
SETTLED, ROUNDING, HALVINGS = 1e-9, 1e-12, 30
NUMBERS = 6  #: of the residual of a pose: rotation and translation
#: Lower bound of a variance, relative to that caused by image noise in the same residuals: below it, no weight
#: changes by more than this.
FLOOR = 1e-4
#: The step below a bound is of first order, and a covariance must remain positive: a sigma in any direction keeps this
#: fraction. In 500 simulated robots without noise (8 poses) no sigma fell below .4 of that at the bound.
LEAST_PART = 0.25
#: largest factor by which variances may change in one step
FURTHEST = np.log(20.0)


@dataclass(frozen=True)
class Components:
    """The variances and the resulting estimate of the shared unknowns.

    Attributes
    ----------
    noise : Noise
    relative : (3,) array
        Relative standard deviation of each of the three; inf at the lower bound.
    step : (F,) array
        Generalised least squares β minus the linearised state.
    covariance : (F, F) array
        Of the shared unknowns.
    freedom : (F,) array
        Degrees of freedom of each variance (Satterthwaite 1946): 2 v² / var v.
    misfit : (V,) array
        |e_i|² in the metric of its own covariance, 6 on average.
    """

    noise: Noise
    relative: Array
    step: Array
    covariance: Array
    freedom: Array
    misfit: Array


def estimate(linear: Linear, start: Noise, freedom: float) -> Components:
    """Estimate the three variances by restricted maximum likelihood.

    Parameters
    ----------
    linear : Linear
    start : Noise
    freedom : float
        Degrees of freedom of the pictures' residuals if every view has its own pose: coordinates minus parameters.
    """
    model = _Model.of(linear, freedom)
    floors = model.floors(start)
    logs = np.maximum(np.log(np.square(start)), floors)
    here = model.at(logs)
    for _ in range(MOST_STEPS):
        active = (logs > floors) | (here.score > 0)
        step = np.zeros(3)
        f = here.information[np.ix_(active, active)]
        step[active] = np.clip(np.linalg.solve(f, here.score[active]), -FURTHEST, FURTHEST)
        logs, here, moved = model.uphill(logs, here, step, floors)
        if moved < SETTLED:
            break
    return _components(model, here, logs, logs > floors + ROUNDING)


def _components(model: _Model, here: _Point, logs: Array, inside: Array) -> Components:
    noise = Noise(*np.exp(logs / 2).tolist())
    relative = np.full(3, np.inf)
    inverse = np.zeros((3, 3))
    inverse[np.ix_(inside, inside)] = np.linalg.inv(here.information[np.ix_(inside, inside)])
    relative[inside] = np.sqrt(np.diagonal(inverse)[inside]) / 2
    m = here.covariance
    by_log = m @ here.inner @ m  # d covariance / d log variance, (3, F, F)
    variance, slopes = np.diagonal(m), np.einsum("kff->kf", by_log)
    spread = np.einsum("kf,kl,lf->f", slopes, inverse, slopes)
    with np.errstate(divide="ignore"):
        degrees = 2 * variance**2 / spread
    adjusted = _unbounded(m, here, by_log) + model.of_estimated_variances(logs, here, inverse)
    return Components(noise, relative, here.step, adjusted, degrees, model.misfit(here))


def _unbounded(m: Array, here: _Point, by_log: Array) -> Array:
    """The covariance (F, F) of the shared unknowns if the variances were not bounded.

    A variance of 0 is estimated above 0 in half of all samples, and at the bound in the others, so that bounded
    estimates, and the covariances computed from them, are too large on average. From the bound, one scoring step, I⁻¹
    times the score, leads to the unbounded estimate, which is unbiased; M changes by the derivatives `by_log` times
    this step. The score of variances above their bounds is 0. No sigma falls below `LEAST_PART` of that at the bound.
    """
    step = np.linalg.solve(here.information, here.score)
    change = np.einsum("k,kfg->fg", step, by_log)
    if not np.abs(change).max(initial=0.0) > 0:
        return m
    d = np.sqrt(np.diagonal(m))
    root = np.linalg.cholesky(m / np.outer(d, d)) * d[:, None]
    half = np.linalg.solve(root, change)
    values, vectors = np.linalg.eigh(np.linalg.solve(root, half.T))
    turned = root @ vectors
    return np.asarray((turned * np.maximum(1 + values, LEAST_PART**2)) @ turned.T)


@dataclass(frozen=True)
class _Point:
    """The likelihood at a point, its score and information by the logarithms of the variances, and the GLS there."""

    likelihood: float
    score: Array
    information: Array
    inner: Array  #: (3, F, F): Aᵀ V⁻¹ V_k V⁻¹ A
    covariance: Array
    step: Array
    weights: Array  #: (V, 6, 6): V⁻¹


@dataclass(frozen=True)
class _Model:
    y: Array
    a: Array
    k: Array  #: (V, 6, 6)
    left: float  #: Σ r² of the pictures, with the pose of each view fitted separately
    freedom: float
    known: Array  #: (F,): prior information on the shared unknowns
    pulled: Array  #: (F,): the gradient of its part of the cost

    @classmethod
    def of(cls, linear: Linear, freedom: float) -> _Model:
        h, g = linear.image[:, :6, :6], linear.image[:, :6, 6]
        d = np.sqrt(np.einsum("vii->vi", h))
        inverse = np.linalg.inv(h / (d[:, :, None] * d[:, None, :])) / (d[:, :, None] * d[:, None, :])
        own = np.einsum("vij,vj->vi", inverse, g)
        j = linear.by_pose
        y = linear.residual - np.einsum("vij,vj->vi", j, own)
        left = float((linear.image[:, 6, 6] - np.einsum("vi,vi->v", g, own)).sum())
        return cls(y, linear.by_shared, j @ inverse @ np.swapaxes(j, 1, 2), left, freedom, *prior(linear))

    def parts(self, logs: Array) -> Array:
        """s² K_i, s_r² diag(I, 0), s_t² diag(0, I): (3, V, 6, 6)."""
        s = np.exp(logs)
        turn, shift = (np.diag(np.repeat(on, 3)) for on in ([1.0, 0.0], [0.0, 1.0]))
        both = np.stack([s[1] * turn, s[2] * shift])[:, None]
        return np.concatenate([s[0] * self.k[None], np.broadcast_to(both, (2, *self.k.shape))])

    def floors(self, start: Noise) -> Array:
        """The lower bounds of the logarithms of the variances in the search."""
        typical = np.einsum("vii->vi", self.k).mean(0) * start.image**2
        image = max(self.left, np.finfo(float).tiny) / max(self.freedom, 1.0)
        return np.log([1e-6 * image, FLOOR * typical[:3].mean(), FLOOR * typical[3:].mean()])

    def at(self, logs: Array) -> _Point:
        parts = self.parts(logs)
        v = parts.sum(0)
        w = np.linalg.inv(v)
        wa = w @ self.a
        normal = np.einsum("vif,vig->fg", self.a, wa) + np.diag(self.known)
        d = np.sqrt(np.diagonal(normal))
        m = np.linalg.inv(normal / np.outer(d, d)) / np.outer(d, d)
        beta = -m @ (np.einsum("vif,vi->f", wa, self.y) + self.pulled)
        py = np.einsum("vij,vj->vi", w, self.y + self.a @ beta)
        wvw = w @ parts @ w  # (3, V, 6, 6)
        inner = (np.swapaxes(self.a, 1, 2) @ wvw @ self.a).sum(1)
        traces = np.einsum("kvii->k", w @ parts) - np.einsum("fg,kgf->k", m, inner)
        squares = (py * (parts @ py[..., None])[..., 0]).sum((1, 2))
        score, information = 0.5 * (squares - traces), self._information(parts, w, wvw, m, inner)
        s2 = np.exp(logs[0])
        score[0] += 0.5 * (self.left / s2 - self.freedom)
        information[0, 0] += self.freedom / 2
        likelihood = -0.5 * (
            np.linalg.slogdet(v)[1].sum()
            + np.linalg.slogdet(normal)[1]
            + np.einsum("vi,vi->", self.y + self.a @ beta, py)
            + np.square(self.pulled + self.known * beta).sum()
            + self.freedom * logs[0]
            + self.left / s2
        )
        return _Point(float(likelihood), score, information, inner, m, beta, w)

    def _information(self, parts: Array, w: Array, wvw: Array, m: Array, inner: Array) -> Array:
        """½ tr P V_k P V_l, (3, 3)."""
        flat = wvw.reshape(3, -1)
        first = flat @ np.swapaxes(parts, 2, 3).reshape(3, -1).T
        left = m @ np.swapaxes(self.a, 1, 2) @ wvw  # (3, V, F, 6)
        right = parts @ w @ self.a
        crossed = left.reshape(3, -1) @ np.swapaxes(right, 2, 3).reshape(3, -1).T
        both = m @ inner
        third = both.reshape(3, -1) @ np.swapaxes(both, 1, 2).reshape(3, -1).T
        return 0.5 * (first - 2 * crossed + third)

    def of_estimated_variances(self, logs: Array, here: _Point, of_variances: Array) -> Array:
        """The correction of the covariance (F, F) of the shared unknowns for estimated variances.

        2 M Σ_kl w_kl (Aᵀ V⁻¹ V_k V⁻¹ V_l V⁻¹ A − Aᵀ V⁻¹ V_k V⁻¹ A M Aᵀ V⁻¹ V_l V⁻¹ A) M with the covariance w of the
        variances (Kenward & Roger 1997, sec. 2). Without it, the sigmas of 8 poses are a tenth too small.
        """
        m, w, parts = here.covariance, here.weights, self.parts(logs)
        right = parts @ w @ self.a  # (3, V, 6, F)
        added = np.einsum("kl,kvif,vij,lvjg->fg", of_variances, right, w, right, optimize=True)
        added -= np.einsum("kl,kfh,hi,lig->fg", of_variances, here.inner, m, here.inner, optimize=True)
        return np.asarray(m @ (added + added.T) @ m)

    def uphill(self, logs: Array, here: _Point, step: Array, floors: Array) -> tuple[Array, _Point, float]:
        """Take a step, halved until the likelihood does not fall; return the step length too."""
        for _ in range(HALVINGS):
            trial = np.maximum(logs + step, floors)
            there = self.at(trial)
            if there.likelihood >= here.likelihood:
                return trial, there, float(np.abs(trial - logs).max())
            step = step / 2
        return logs, here, 0.0

    def misfit(self, here: _Point) -> Array:
        """Squared lengths (V,) of the residuals e_i in the metric of their covariance V_i − A_i M A_iᵀ."""
        e = self.y + self.a @ here.step
        cov = np.linalg.inv(here.weights) - self.a @ here.covariance @ np.swapaxes(self.a, 1, 2)
        return np.einsum("vi,vi->v", e, np.linalg.solve(cov, e[..., None])[..., 0])


def outlying(misfit: Array, shared: int) -> Array:
    """Probabilities (V,) that noise alone makes a view's residual at least this large.

    Compared with the scatter of the others: F = (d / 6) / ((n − d) / (n − 6)) with n = 6 V − F degrees of freedom (an
    externally studentised residual; Cook & Weisberg 1982, sec. 2.2).
    """
    n = float(NUMBERS) * len(misfit) - shared
    if n <= NUMBERS:
        return np.ones(len(misfit))
    rest = np.maximum(n - misfit, np.finfo(float).tiny)
    with np.errstate(over="ignore"):  # a view with all of the scatter has probability 0
        ratio = misfit / NUMBERS / (rest / (n - NUMBERS))
    return np.asarray(stats.f.sf(ratio, NUMBERS, n - NUMBERS))


def weights(linear: Linear, noise: Noise, freedom: float) -> Array:
    """V⁻¹ (V, 6, 6) of the residuals with the poses of the views eliminated."""
    return np.asarray(_Model.of(linear, freedom).at(np.log(np.square(noise))).weights)


def misfit_of_new(linear: Linear, noise: Noise, covariance: Array) -> Array:
    """Squared lengths (V,) of residuals of unused poses, in the metric of V_i + A_i M A_iᵀ; see (1).

    Parameters
    ----------
    covariance : (F, F) array
        M, covariance of the first F shared unknowns.
    """
    model = _Model.of(linear, 1.0)
    a = model.a[:, :, : len(covariance)]
    spread = model.parts(np.log(np.square(noise))).sum(0) + a @ covariance @ np.swapaxes(a, 1, 2)
    return np.asarray(np.einsum("vi,vi->v", model.y, np.linalg.solve(spread, model.y[..., None])[..., 0]))
