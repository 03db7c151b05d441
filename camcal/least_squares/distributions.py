"""Distributions that tests of residuals follow, without scipy.special, whose import takes as long
as ten calibrations.

With I the regularised incomplete beta function, P the incomplete gamma function (Abramowitz & Stegun, Handbook of
Mathematical Functions, 26.4, 26.6 and 26.7):

    F(m, n):  P(X > x) = I_{n / (n + m x)}(n/2, m/2)                                                       (1)
    χ²(n):    P(X <= x) = P(n/2, x/2)                                                                      (2)
    t(n):     P(|X| > t) = I_{n / (n + t²)}(n/2, 1/2)                                                      (3)
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from camcal.geometry.numbers import TINY

Array = np.ndarray

#: relative accuracy of (4); log Γ leaves 1e-11 for 1e5 degrees of freedom
_ACCURACY = 1e-15
#: terms of (4): of the order of the square root of the larger parameter are needed, 3,000 for 1e7 degrees of freedom
_TERMS = 100_000
#: `t_bound` ends with a step below this part of t, as the next would be its square; some ten steps are taken
_LAST, _NEWTON = 1e-8, 100


def beta_part(a: float, b: float, x: float, rest: float | None = None) -> float:
    """I_x(a, b), the regularised incomplete beta function; ``rest`` is 1 - x, where the caller knows it without the
    cancellation near x = 1.

    By the continued fraction DLMF 8.17.22,

        I_x(a, b) = x^a (1-x)^b / (a B(a, b)) · 1/(1 + d_1/(1 + d_2/(1 + ...)))                             (4)

    evaluated by Lentz's method; on the side where it converges fast, the other by symmetry.
    """
    if not (a > 0 and b > 0):
        return float("nan")
    rest = 1 - x if rest is None else rest
    if not (x > 0 and rest > 0):
        return 0.0 if x <= 0 else (1.0 if rest <= 0 else float("nan"))
    if x > (a + 1) / (a + b + 2):
        return 1.0 - beta_part(b, a, rest, x)
    far = math.log1p(-x) if x < rest else math.log(rest)
    front = math.lgamma(a + b) - math.lgamma(a) - math.lgamma(b) + a * math.log(x) + b * far
    c, d = 1.0, 1.0 / max(1 - (a + b) * x / (a + 1), TINY)
    total = d
    for m in range(1, _TERMS):
        before = total
        even = m * (b - m) * x / ((a + 2 * m - 1) * (a + 2 * m))
        odd = -(a + m) * (a + b + m) * x / ((a + 2 * m) * (a + 2 * m + 1))
        for term in (even, odd):
            d = 1 / _away_from_zero(1 + term * d)
            c = _away_from_zero(1 + term / c)
            total *= c * d
        if abs(total - before) <= _ACCURACY * abs(total):
            break
    return math.exp(front) * total / a


def _away_from_zero(x: float) -> float:
    return x if abs(x) > TINY else TINY


def f_exceeded(x: float, m: float, n: float) -> float:
    """Probability that F(m, n) exceeds x, by (1)."""
    over = m * float(x)
    return beta_part(n / 2, m / 2, n / (n + over), over / (n + over) if over < math.inf else 1.0)


def f_bound(p: Any, m: Any, n: Any) -> Any:
    """The x that F(m, n) exceeds with probability p, by (1); arrays are broadcast.

    I_y(n/2, 1) is y^(n/2), so that nothing has to be searched for m = 2, the two coordinates of a point.
    """
    if np.all(np.asarray(m) == 2):
        return n * np.expm1(-2 / np.asarray(n) * np.log(p)) / 2
    from scipy.special import betaincinv  # for choices among poses

    share = betaincinv(np.asarray(n) / 2, np.asarray(m) / 2, p)
    return n * (1 / share - 1) / m


def t_exceeded(t: float, n: float) -> float:
    """Probability that Student's distribution with n degrees of freedom exceeds t, by (3)."""
    over = float(t) ** 2
    tail = 0.5 * beta_part(n / 2, 0.5, n / (n + over), over / (n + over) if over < math.inf else 1.0)
    return tail if t > 0 else 1 - tail


def t_bound(p: float, n: float) -> float:
    """The t that Student's distribution with n degrees of freedom exceeds with probability p below 1/2.

    Newton's method on the logarithm of the probability.
    """
    front = math.lgamma((n + 1) / 2) - math.lgamma(n / 2) - 0.5 * math.log(math.pi * n)
    t = 0.0
    for _ in range(_NEWTON):
        above = t_exceeded(t, n)
        density = math.exp(front - (n + 1) / 2 * math.log1p(t * t / n))
        step = min(
            math.log(above / p) * above / density, max(t, 1.0)
        )  # further out there may be no digits left
        t += step
        if abs(step) <= _LAST * t:
            break
    return t


def chi2_quantile(p: Any, n: Any) -> Any:
    """The x that χ² with n degrees of freedom does not exceed with probability p, by (2)."""
    from scipy.special import gammaincinv  # for triangulation

    return 2 * gammaincinv(np.asarray(n) / 2, p)


def normal_exceeded(x: float) -> float:
    """Probability that a standard normal variable exceeds x."""
    return 0.5 * math.erfc(float(x) / math.sqrt(2))


def excess_kurtosis(x: Array) -> float:
    """m₄ / m₂² - 3 of a sample (N,)."""
    off = x - x.mean()
    return float(np.mean(off**4) / np.mean(off**2) ** 2 - 3)


def normality(x: Array) -> tuple[float, float]:
    """Return the statistic and probability of D'Agostino & Pearson's normality test of a sample (N,), N >= 20.

    Skewness by D'Agostino (1970), kurtosis by Anscombe & Glynn (1983), each made a standard normal variable; the
    sum of their squares follows χ²(2) (D'Agostino & Pearson, Tests for departure from normality, Biometrika 1973).
    """
    n = float(len(x))
    off = x - x.mean()
    variance = np.mean(off**2)
    skew, kurtosis = np.mean(off**3) / variance**1.5, np.mean(off**4) / variance**2
    y = skew * np.sqrt((n + 1) * (n + 3) / (6 * (n - 2)))
    beta = 3 * (n**2 + 27 * n - 70) * (n + 1) * (n + 3) / ((n - 2) * (n + 5) * (n + 7) * (n + 9))
    w2 = np.sqrt(2 * (beta - 1)) - 1
    of_skew = np.arcsinh(y * np.sqrt((w2 - 1) / 2)) / np.sqrt(0.5 * np.log(w2))
    spread = 24 * n * (n - 2) * (n - 3) / ((n + 1) ** 2 * (n + 3) * (n + 5))
    z = (kurtosis - 3 * (n - 1) / (n + 1)) / np.sqrt(spread)
    root = 6 * (n**2 - 5 * n + 2) / ((n + 7) * (n + 9))
    root = root * np.sqrt(6 * (n + 3) * (n + 5) / (n * (n - 2) * (n - 3)))
    a = 6 + 8 / root * (2 / root + np.sqrt(1 + 4 / root**2))
    ratio = (1 - 2 / a) / (1 + z * np.sqrt(2 / (a - 4)))
    of_kurtosis = (1 - 2 / (9 * a) - np.cbrt(ratio)) / np.sqrt(2 / (9 * a))
    statistic = float(of_skew**2 + of_kurtosis**2)
    return statistic, math.exp(-statistic / 2)  # of χ²(2)
