"""The information that views carry about a camera before it is calibrated, for the selection of frames.

The criterion is that of `camcal next` (the information of a view with its pose eliminated,
`assess/next_view.py`), for a camera with an ordinary field of view, as there is no calibration yet. Views are
chosen one by one, each maximising the determinant of the total information (D-optimal design; Fedorov, Theory of
Optimal Experiments, 1972).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from camcal.geometry import homography, rotations

Array = np.ndarray

FOCAL = 1.0  #: of the longer side; ordinary lenses have fields of view of 45 to 65 degrees
#: prior relative standard deviation of each parameter: virtually unknown
PRIOR = 1.0
LEAST_POINTS = 6  #: of a view; with fewer, the pose (six numbers) takes up more than half of the coordinates


def information(points: Array, uv: Array, sigma: float, size: tuple[int, int]) -> Array:
    """Information (5, 5) of a view about fx, fy, cx, cy (in focal lengths) and k1, with its pose eliminated.

    Parameters
    ----------
    points : (N, 2) array
        On the board.
    uv : (N, 2) array
        px.
    sigma : float
        Standard deviation of `uv`, px.
    size : (width, height)
        px.

    Returns
    -------
    (5, 5) array
        Zero if the points do not determine a pose.
    """
    focal, centre = FOCAL * max(size), (np.array(size) - 1) / 2
    h, gap, _ = homography.solve(points[None], ((uv - centre) / focal)[None], steps=1)
    scale = 0.5 * (np.linalg.norm(h[0, :, 0]) + np.linalg.norm(h[0, :, 1]))
    if len(points) < LEAST_POINTS or not np.isfinite(h).all() or scale == 0 or gap[0] <= 0:
        return np.zeros((5, 5))
    columns = h[0] / (scale if h[0, 2, 2] > 0 else -scale)
    rotation = rotations.nearest(np.c_[columns[:, :2], np.cross(columns[:, 0], columns[:, 1])])
    x = np.c_[points, np.zeros(len(points))] @ rotation.T + columns[:, 2]
    (a, b), z = x[:, :2].T / x[:, 2], x[:, 2]
    zero, one, square = np.zeros_like(a), np.ones_like(a), a**2 + b**2
    camera = np.stack([[a, zero, one, zero, a * square], [zero, b, zero, one, b * square]]).transpose(2, 0, 1)
    image = np.stack([[1 / z, zero, -a / z], [zero, 1 / z, -b / z]]).transpose(2, 0, 1)
    turn = np.cross(np.eye(3), x[:, None])  # d (w x p) / d w, rows by the axis of w
    pose = np.concatenate([image @ turn.transpose(0, 2, 1), image], 2)
    jc, jp = camera.reshape(-1, 5), pose.reshape(-1, 6)
    found = jc.T @ jc - jc.T @ jp @ np.linalg.pinv(jp.T @ jp) @ jp.T @ jc
    return found * (focal / sigma) ** 2


def chosen_views(
    gains: Sequence[Array], count: int, same: Callable[[int, int], bool]
) -> tuple[list[int], dict[int, int]]:
    """The views that together determine a camera best.

    Parameters
    ----------
    gains : sequence of (P, P) arrays
        Information of each view.
    count : int
        Largest number of views to choose.
    same : callable
        Returns whether two views show the same, so that the second is not needed.

    Returns
    -------
    chosen : list of int
        The most informative first.
    repeated : dict
        Omitted view -> the chosen one that shows the same.
    """
    if not len(gains):
        return [], {}
    total = np.eye(len(gains[0])) / PRIOR**2
    left = set(range(len(gains)))
    chosen: list[int] = []
    repeated: dict[int, int] = {}
    stacked = np.array(gains)
    while left and len(chosen) < count:
        rows = sorted(left)
        best = rows[int(np.linalg.slogdet(total + stacked[rows])[1].argmax())]
        chosen.append(best)
        left.discard(best)
        total = total + stacked[best]
        again = [i for i in left if same(best, i)]
        repeated |= dict.fromkeys(again, best)
        left -= set(again)
    return chosen, repeated
