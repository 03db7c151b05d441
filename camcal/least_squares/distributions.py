"""Distributions that tests of residuals follow, from scipy.special alone: scipy.stats takes longer to import than a
camera takes to calibrate.

With I the regularised incomplete beta function, P the incomplete gamma function (Abramowitz & Stegun, Handbook of
Mathematical Functions, 26.4 and 26.6):

    F(m, n):  P(X > x) = I_{n / (n + m x)}(n/2, m/2)                                                       (1)
    χ²(n):    P(X <= x) = P(n/2, x/2)                                                                      (2)
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.special import betaincinv, chdtrc, fdtrc, gammaincinv, ndtr

Array = np.ndarray


def f_exceeded(x: Any, m: Any, n: Any) -> Any:
    """Probability that F(m, n) exceeds x."""
    return fdtrc(m, n, x)


def f_bound(p: Any, m: Any, n: Any) -> Any:
    """The x that F(m, n) exceeds with probability p, by (1)."""
    share = betaincinv(np.asarray(n) / 2, np.asarray(m) / 2, p)
    return n * (1 / share - 1) / m


def chi2_quantile(p: Any, n: Any) -> Any:
    """The x that χ² with n degrees of freedom does not exceed with probability p, by (2)."""
    return 2 * gammaincinv(np.asarray(n) / 2, p)


def normal_exceeded(x: Any) -> Any:
    """Probability that a standard normal variable exceeds x."""
    return ndtr(-np.asarray(x))


def excess_kurtosis(x: Array) -> float:
    """m₄ / m₂² - 3 of a sample (N,)."""
    off = x - x.mean()
    return float(np.mean(off**4) / np.mean(off**2) ** 2 - 3)


def normality(x: Array) -> tuple[float, float]:
    """Statistic and probability of D'Agostino & Pearson's test of a sample (N,), N >= 20.

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
    return statistic, float(chdtrc(2, statistic))
