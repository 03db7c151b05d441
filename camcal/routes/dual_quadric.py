"""The focal length from the absolute dual quadric of three or more views with constant intrinsics.

For the cameras P of a projective reconstruction the dual image of the absolute conic is ω* = K Kᵀ ~ P Q Pᵀ, where Q
(4, 4) has rank 3 and is the same for all views (B. Triggs, Autocalibration and the absolute quadric, CVPR 1997). Square
pixels and a principal point in the middle give four linear equations in Q per view (M. Pollefeys et al.,
Self-calibration and metric reconstruction in spite of varying and unknown internal camera parameters, IJCV 1999). Then
f and the plane at infinity are estimated with one f in all views: all ω* agree with diag(f², f², 1).

If all optical axes meet, fundamental matrices do not determine f, but Q does from three views on.
"""

from __future__ import annotations

import numpy as np

from camcal.least_squares import Differences, Options, minimise
from camcal.model.pose import Array
from camcal.routes.bundle import Tracks
from camcal.routes.epipolar import FOCAL
from camcal.routes.projective_views import bounded_depths, of_pairs
from camcal.routes.reconstruct import Pair

#: expected deviation of ω*, in units of the picture's width, from that of f = 1 (Pollefeys et al., Visual modeling
#: with a hand-held camera, IJCV 2004, (14)): f is known to a factor of three, the aspect to .1, the skew to .01 and
#: the principal point to .1
DOUBTS = np.array([9.0, 9.0, 0.2, 0.01, 0.1, 0.1])
ENTRIES = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))  #: of ω*
WEIGHTINGS = 4  #: solutions, each with the equations scaled by the last ω*33
#: of the least-squares fit: limit of evaluations; finite-difference step of log f and the plane, a hundred times the
#: root of the rounding error; relative decrease of the sum of squares at which it ends
ITERATIONS, STEP, SETTLED = 30, 1e-6, 1e-8


def focal(known: list[Pair], tracks: Tracks, size: tuple[int, int]) -> float | None:
    """The focal length, px, of three or more views; None if there is no real one, or the views are degenerate."""
    centre, width = np.array([(size[0] - 1) / 2, (size[1] - 1) / 2]), float(max(size))
    try:
        with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
            cameras = of_pairs(known, tracks, centre, width)
            found = None if cameras is None else constant(cameras)
    except np.linalg.LinAlgError:  # cameras without a finite position, such as those of a picture given twice
        return None
    return None if found is None else width * found


def constant(cameras: Array) -> float | None:
    """f of cameras (V, 3, 4) about their principal point, in the unit of their pixels; None if f² < 0."""
    quadric = linear(cameras)
    cones = cameras @ quadric @ np.swapaxes(cameras, 1, 2)
    with np.errstate(divide="ignore", invalid="ignore"):
        squares = (cones[:, 0, 0] + cones[:, 1, 1]) / (2 * cones[:, 2, 2])
    f2 = float(np.median(squares[np.isfinite(squares)])) if np.isfinite(squares).any() else np.nan
    if not f2 > 0:
        return None
    # Q = [[ω*, -ω* p], [-pᵀ ω*, pᵀ ω* p]] if the first camera is [I | 0]
    to_first = _to_identity(cameras[0])
    moved = cameras @ to_first
    back = np.linalg.inv(to_first)
    q = back @ quadric @ back.T
    plane = -q[:3, 3] / q[2, 2] / [f2, f2, 1.0]
    f = float(np.exp(_agreed(moved, np.r_[np.log(f2) / 2, plane])[0]))
    return f if FOCAL[0] <= f <= FOCAL[-1] else None


def linear(cameras: Array) -> Array:
    """Q (4, 4) of rank 3, positive semidefinite if possible, by the weighted linear equations."""
    upper = np.triu_indices(4)
    scale = np.ones(len(cameras))
    quadric = np.zeros((4, 4))
    for _ in range(WEIGHTINGS):
        form = {ij: _products(cameras[:, ij[0]], cameras[:, ij[1]]) for ij in ENTRIES}
        each = [
            form[0, 0] - form[2, 2],
            form[1, 1] - form[2, 2],
            form[0, 0] - form[1, 1],
            form[0, 1],
            form[0, 2],
            form[1, 2],
        ]
        rows = np.concatenate([e / d / scale[:, None] for e, d in zip(each, DOUBTS, strict=True)])
        solution = np.linalg.svd(rows)[2][-1]
        quadric = np.zeros((4, 4))
        quadric[upper] = solution
        quadric = quadric + np.triu(quadric, 1).T
        values, vectors = np.linalg.eigh(quadric)
        values[np.abs(values).argmin()] = 0
        quadric = (vectors * values) @ vectors.T
        third = np.einsum("vi,ij,vj->v", cameras[:, 2], quadric, cameras[:, 2])
        quadric = quadric * np.sign(np.median(third))
        scale = bounded_depths(third)
    return quadric


def _products(a: Array, b: Array) -> Array:
    """Coefficients (V, 10) of aᵀ Q b in the upper triangle of Q."""
    outer = a[:, :, None] * b[:, None]
    both = outer + np.swapaxes(outer, 1, 2)
    both[:, range(4), range(4)] /= 2
    i, j = np.triu_indices(4)
    return np.asarray(both[:, i, j])


def _to_identity(camera: Array) -> Array:
    """H (4, 4) with P H = [I | 0]."""
    u, s, vt = np.linalg.svd(camera)
    inverse = vt[:3].T @ np.diag(1 / s) @ u.T
    return np.c_[inverse, vt[3]]


def _agreed(cameras: Array, start: Array) -> Array:
    """(log f, plane) at which the ω* of all views are closest to diag(f², f², 1), both with norm 1."""

    def off(x: Array) -> Array:
        k = np.diag([np.exp(2 * x[0]), np.exp(2 * x[0]), 1.0])
        side = -k @ x[1:]
        q = np.block([[k, side[:, None]], [side[None], np.array([[x[1:] @ k @ x[1:]]])]])
        cones = cameras @ q @ np.swapaxes(cameras, 1, 2)
        cones = cones / np.linalg.norm(cones, axis=(1, 2), keepdims=True)
        return np.asarray((cones - k / np.linalg.norm(k)).ravel())

    return np.asarray(minimise(Differences(off, STEP), start[None], Options(SETTLED, ITERATIONS)).state[0])
