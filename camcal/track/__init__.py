"""Time-varying projection matrices: estimators, gains and motions by name.

Adding an estimator or a gain = a file (or a class), a line in its table and a line in its summaries; the
contract tests follow. The tables import nothing, so that help and completion stay instant.
"""

from __future__ import annotations

ESTIMATORS = {
    "batch": "camcal.track.matrix_filters:Batch",
    "rls": "camcal.track.matrix_filters:RecursiveLeastSquares",
    "kalman": "camcal.track.matrix_filters:Kalman",
    "iekf": "camcal.track.iekf:IteratedKalman",
    "window": "camcal.track.window:Window",
    "smoother": "camcal.track.smoother:Smoother",
}

SUMMARIES = {
    "batch": "each frame separately: the theorem of Barranco & Medel on Central and Column",
    "rls": "recursive least squares with forgetting on Central and Column, in QR form",
    "kalman": "Kalman filter on the 11 numbers of M, random walk or constant velocity",
    "iekf": "iterated extended Kalman filter on K, R, t and distortion, noise per group",
    "window": "bundle adjustment over a sliding window of frames",
    "smoother": "Rauch-Tung-Striebel smoother on K, R, t and distortion, off-line",
}

GAINS = {
    "kalman": "camcal.track.gains:Gain",
    "forgetting": "camcal.track.gains:ForgettingGain",
    "fixed": "camcal.track.gains:FixedGain",
    "mean": "camcal.track.gains:MeanGain",
    "adaptive": "camcal.track.gains:AdaptiveGain",
}

GAIN_SUMMARIES = {
    "kalman": "the gain of minimum variance for the specified motion",
    "forgetting": "least squares in which a frame's weight falls by a factor with each later frame",
    "fixed": "a constant fraction of each frame's own correction",
    "mean": "the mean over all points so far, the expectation of Barranco & Medel's theorem",
    "adaptive": "the Kalman gain with a memory that shortens when the innovations are too large",
}

MOTION_SUMMARIES = {
    "fixed": "nothing moves",
    "thermal": "a fixed camera that warms up: focal length, principal point, a little rotation",
    "zoom": "the focal length changes freely, and the principal point with it",
    "pan": "the camera rotates on its mount",
    "free": "the camera rotates and translates",
}

#: kind of simulated sequence -> the motion that its camera walks by
SEQUENCES = {"static": "fixed", "thermal": "thermal", "knock": "fixed", "pan": "pan", "zoom": "zoom"}
