"""Scales of the normal and the uniform distribution."""

from __future__ import annotations

import math

#: standard deviation of a uniform distribution of width 1: of what rounding to whole numbers leaves
UNIFORM = 1 / math.sqrt(12)
#: median of |x| of the normal distribution, in σ: the 75 % quantile
NORMAL_MEDIAN = 0.6744897501960817
#: σ within which 95 % of the normal distribution lie: the 97.5 % quantile
NORMAL_95 = 1.959963984540054
#: σ over the median absolute deviation (P. Rousseeuw & C. Croux, Alternatives to the median absolute deviation, 1993)
MAD = 1 / NORMAL_MEDIAN
#: where the weights of Tukey's biweight reach 0: 95 % efficiency on normal noise (A. Beaton & J. Tukey, The fitting of
#: power series, 1974)
TUKEY = 4.685


def of_small_sample(count: int, parameters: int) -> float:
    """The factor of σ from the least median of `count` residuals, as a small sample fits its own median too well.

    1 + 5 / (n - p): P. Rousseeuw & A. Leroy, Robust regression and outlier detection (1987), p. 202.
    """
    return 1 + 5 / max(count - parameters, 1)
