"""The output table: one row per frame, as CSV or JSON lines.

`COLUMNS` says what each column is; docs/tracking.md is made from it.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import numpy as np

from camcal.data.dlt_table import NO_DEPTH
from camcal.geometry import rotations
from camcal.track import decompose
from camcal.track.decompose import Cameras
from camcal.track.estimator import TrackState
from camcal.track.model import Model

Array = np.ndarray

MATRIX = tuple(f"m{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3, 4))
PARAMETERS = ("fx", "fy", "skew", "cx", "cy", "rx", "ry", "rz", "tx", "ty", "tz")
TESTS = ("innovation", "nis", "gain", "changed")
MORE = ("nis_dof", "score", "cusum", "effective", "noise", "points", "used", "status")

COLUMNS = {
    "frame": "number of the frame",
    "m11 ... m34": "projection matrix, with m34 = 1 (of unit norm if the depth of the world origin is 0)",
    "fx, fy, skew, cx, cy": "intrinsics, px",
    "rx, ry, rz": "rotation vector of cam_from_world, rad",
    "tx, ty, tz": "translation of cam_from_world, in the unit of the points",
    "innovation": "root mean square distance between the points and their predictions, px",
    "nis": "normalised innovation squared, of the part that a change of the camera can explain",
    "gain": "fraction of the frame's own correction that was applied",
    "changed": "1 if the change test raised an alarm, else 0",
    "nis_dof": "degrees of freedom of nis",
    "score": "nis as a standard normal deviate: 0 on average while nothing changes",
    "cusum": "cumulative sum of the scores beyond 1/2",
    "effective": "the number of frames like this one to which the estimate is equivalent",
    "noise": "standard deviation of the image points, px (a factor if they have sigmas)",
    "points, used": "points in the frame, and those that passed the gate",
    "status": "waiting, started, updated, predicted (too few points), rejected (no camera fits), restarted",
    "k1 ...": "distortion of the lens, if it has any",
    "sigma_...": "standard deviation of each of m11 ... m34, fx ... tz, k1 ...",
}


#: estimates of the covariance in this order: the physical coordinates of camcal.track.decompose
COVARIANCE = ("fx", "fy", "skew", "cx", "cy", "dx", "dy", "dz", "tx", "ty", "tz")


class Table:
    """Turns states into rows.

    Parameters
    ----------
    model : Model
        Of the estimator that made the states.
    covariance : bool
        With the covariance of the physical coordinates (`cov_fx_fx`, ...), upper triangle; there dx, dy,
        dz turn the camera about its own axes and tx, ty, tz move it along them.

    Attributes
    ----------
    names : tuple of str
        The columns.
    """

    def __init__(self, model: Model, covariance: bool = False):
        self.model, self.extra = model, model.extra_names
        estimates = (*MATRIX, *PARAMETERS, *self.extra)
        self._estimates = len(estimates)
        sigmas = tuple(f"sigma_{n}" for n in estimates)
        order = (*COVARIANCE, *self.extra) if covariance else ()
        self._upper = np.triu_indices(len(order))
        covariances = tuple(f"cov_{order[i]}_{order[j]}" for i, j in zip(*self._upper, strict=True))
        self.names = (
            "frame", *MATRIX, *PARAMETERS, *TESTS, *MORE, *self.extra, *sigmas, *covariances
        )  # fmt: skip
        self._csv = ",".join("%s" if n in _AS_TEXT else "%.12g" for n in self.names)

    def values(self, states: Sequence[TrackState]) -> Array:
        """Estimates, sigmas and covariances (F, 2 (23 + E) + C) of the states; NaN without an estimate."""
        known = [i for i, s in enumerate(states) if s.estimate is not None]
        out = np.full((len(states), 2 * self._estimates + len(self._upper[0])), np.nan)
        if known:
            chosen = [states[i] for i in known]
            factors = [s.factor for s in chosen if s.factor is not None]
            cameras = self.model.describe([s.estimate for s in chosen], factors)
            out[known] = self._numbers(cameras)
        return out

    def _numbers(self, cameras: Cameras) -> Array:
        matrix, d_matrix = _scaled(cameras)
        parameters, d_parameters = _parameters(cameras)
        physical = cameras.factor[:, : decompose.PHYSICAL]
        sigmas = [
            np.linalg.norm(d_matrix @ physical, axis=-1),
            np.linalg.norm(d_parameters @ physical, axis=-1),
            np.linalg.norm(cameras.factor[:, decompose.PHYSICAL :], axis=-1),
        ]
        rows = [matrix, parameters, cameras.extra, *sigmas]
        if len(self._upper[0]):
            covariance = cameras.factor @ np.swapaxes(cameras.factor, 1, 2)
            rows.append(covariance[:, self._upper[0], self._upper[1]])
        return np.concatenate(rows, 1)

    def rows(self, states: Sequence[TrackState]) -> list[list[Any]]:
        """The rows, in the order of `names`."""
        out = []
        head, extras = len(MATRIX) + len(PARAMETERS), len(self.extra)
        for state, numbers in zip(states, self.values(states).tolist(), strict=True):
            s = state
            row: list[Any] = [s.frame, *numbers[:head]]
            row += [s.innovation, s.nis, s.gain, int(s.changed)]
            row += [s.nis_dof, s.score, s.cusum, s.effective, s.noise, s.points, s.used, s.status]
            row += numbers[head : head + extras] + numbers[head + extras :]
            out.append(row)
        return out

    @property
    def header(self) -> str:
        """The first line of the CSV form."""
        return ",".join(self.names) + "\n"

    def csv(self, states: Sequence[TrackState]) -> str:
        """Rows as CSV with 12 significant digits; an empty field is a number that does not exist."""
        lines = [self._csv % tuple(row) for row in self.rows(states)]
        return "".join(line.replace("nan", "") + "\n" for line in lines)

    def jsonl(self, states: Sequence[TrackState]) -> str:
        """Rows as JSON, one object per line, with all digits; null is a number that does not exist."""
        lines = []
        for row in self.rows(states):
            row = [None if isinstance(x, float) and x != x else x for x in row]
            lines.append(json.dumps(dict(zip(self.names, row, strict=True))) + "\n")
        return "".join(lines)


#: rad; below it the first term of the series is exact: the next one is angle² / 60 of it, 2e-10
SERIES = 1e-4
_AS_TEXT = frozenset(("frame", "changed", "nis_dof", "points", "used", "status"))


def _scaled(cameras: Cameras) -> tuple[Array, Array]:
    """M (F, 12) with m34 = 1 if possible, and its derivative (F, 12, 11)."""
    matrix = cameras.matrix.reshape(-1, 12)
    derivative = decompose.tangent(cameras.k, cameras.pose)
    last, size = matrix[:, 11], np.linalg.norm(matrix, axis=1)
    by_last = np.abs(last) > NO_DEPTH * np.abs(matrix).max(1)
    scale = np.where(by_last, last, size)[:, None]
    unit = matrix / scale
    d_last = derivative[:, 11]
    d_size = np.einsum("fm,fmp->fp", matrix, derivative) / size[:, None]
    d_scale = np.where(by_last[:, None], d_last, d_size)
    return unit, (derivative - unit[..., None] * d_scale[:, None]) / scale[..., None]


def _parameters(cameras: Cameras) -> tuple[Array, Array]:
    """fx ... tz (F, 11) and their derivative with respect to the physical coordinates (F, 11, 11)."""
    k, t = cameras.k, cameras.translation
    vector = rotations.log(cameras.rotation)
    values = np.concatenate(
        [np.stack([k[:, 0, 0], k[:, 1, 1], k[:, 0, 1], k[:, 0, 2], k[:, 1, 2]], 1), vector, t], 1
    )
    derivative = np.broadcast_to(np.eye(11), (len(k), 11, 11)).copy()
    derivative[:, 5:8, 5:8] = inverse_left_jacobian(vector)
    derivative[:, 8:, 5:8] = -rotations.skew(t)
    return values, derivative


def inverse_left_jacobian(vector: Array) -> Array:
    """d log(exp(δ) exp(v)) / dδ (F, 3, 3) at δ = 0 of rotation vectors v (F, 3).

    Chirikjian, Stochastic Models, Information Theory, and Lie Groups, vol. 2 (2012), eq. 10.86.
    """
    angle = np.linalg.norm(vector, axis=-1)
    small = angle < SERIES
    safe = np.where(small, 1.0, angle)
    c = np.where(small, 1 / 12, (1 - 0.5 * safe / np.tan(0.5 * safe)) / safe**2)
    cross = rotations.skew(vector)
    return np.eye(3) - 0.5 * cross + c[:, None, None] * (cross @ cross)
