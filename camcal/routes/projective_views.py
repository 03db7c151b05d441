"""A projective reconstruction: cameras P (3, 4) of several views and points X (4,), up to a homography of space.

R. Hartley & A. Zisserman, Multiple view geometry (2003): two cameras from F (result 9.14), points and further cameras
by linear equations (12.2, 7.1), which are weighted to distances in the picture and solved alternately.
"""

from __future__ import annotations

import numpy as np

from camcal.geometry import homography, rotations
from camcal.least_squares.scales import MAD
from camcal.model.pose import Array
from camcal.routes.bundle import Tracks
from camcal.routes.reconstruct import Pair

#: largest number of views used: a dozen determine the plane at infinity as well, and longer chains drift
MOST_VIEWS = 12
#: least number of points shared with a further view: six determine a camera, and as many verify it
LEAST = 12
#: samples of six: with three of ten images wrong, one is free of them in all but 1 of 2e5 views
SAMPLES = 100
#: rounds of solving alternately for all cameras and points
ROUNDS = 12
#: of the median depth: lower limit of the depth by which equations are divided, so that points near the plane of the
#: camera do not outweigh all others
LEAST_DEPTH = 1e-3
#: robust standard deviations within which images are inliers, and the least limit, px
FAR, LEAST_FAR = 3.5, 0.5


def of_pairs(known: list[Pair], tracks: Tracks, centre: Array, unit: float) -> Array | None:
    """Cameras (V, 3, 4) of pixels (uv - centre) / unit, up to a homography; None for fewer than three views.

    The reconstruction starts from the pair with most matches off any plane; tracks with view -1 are ignored.
    """
    q = np.c_[(tracks.uv - centre) / unit, np.ones(len(tracks))]
    begin = max(known, key=lambda p: _off_plane(p, tracks))
    state = _State(tracks, q, LEAST_FAR / unit, int(tracks.view.max()) + 1)
    state.begin(begin, _about(begin.matrix, centre, unit))
    while state.known.sum() < MOST_VIEWS and state.add():
        state.alternate(2)
    if state.known.sum() < 3:
        return None
    state.alternate(ROUNDS)
    return np.asarray(state.cameras[state.known])


def bounded_depths(depths: Array) -> Array:
    """Their absolute values (N,), at least `LEAST_DEPTH` of the median."""
    size = np.abs(depths)
    return np.asarray(np.maximum(size, LEAST_DEPTH * np.median(size)))


def _about(f: Array, centre: Array, unit: float) -> Array:
    to_px = np.array([[unit, 0, centre[0]], [0, unit, centre[1]], [0, 0, 1]])
    return np.asarray(to_px.T @ f @ to_px)


def _off_plane(pair: Pair, tracks: Tracks) -> float:
    """Matches that agree, times their median distance from a homography, px."""
    first, second = (tracks.uv[pair.matches[pair.agree, i]] for i in (0, 1))
    h = homography.homographies(first[None], second[None])
    across = np.linalg.norm(homography.transfer(h, first[None])[0] - second, axis=1)
    return float(len(first) * np.median(across))


class _State:
    def __init__(self, tracks: Tracks, q: Array, least: float, views: int):
        self.view, self.point, self.q, self.least = tracks.view, tracks.point, q, least
        self.cameras = np.full((views, 3, 4), np.nan)
        self.points = np.full((int(tracks.point.max()) + 1, 4), np.nan)
        self.good = tracks.view >= 0
        self.refused = np.zeros(views, bool)

    @property
    def known(self) -> Array:
        return np.asarray(np.isfinite(self.cameras).all((1, 2)))

    def begin(self, pair: Pair, f: Array) -> None:
        e = np.linalg.svd(f)[0][:, 2]
        cross = rotations.skew(e)
        self.cameras[pair.first] = np.eye(3, 4)
        self.cameras[pair.second] = np.c_[cross @ f / np.linalg.norm(f), e]
        wrong = pair.matches[~pair.agree].ravel()
        self.good[wrong] = False
        self._place()

    def add(self) -> bool:
        """Add the view with most known points; return whether there was one."""
        known = np.isfinite(self.points).all(1)[self.point] & self.good & ~self.known[self.view.clip(0)]
        counts = np.bincount(self.view[known], minlength=len(self.cameras))
        counts[self.refused] = 0
        view = int(counts.argmax())
        if counts[view] < LEAST:
            return False
        rows = np.flatnonzero(known & (self.view == view))
        xyz, q = self.points[self.point[rows]], self.q[rows]
        rng = np.random.default_rng(view)
        samples = np.stack([rng.choice(len(rows), 6, replace=False) for _ in range(SAMPLES)])
        trials = _cameras(xyz[samples], q[samples], np.ones((SAMPLES, 6)))
        off = _distances(trials @ xyz.T, q)
        best = int(np.median(off, axis=1).argmin())
        inside = off[best] <= _bound(off[best], self.least)
        if inside.sum() < LEAST:
            self.refused[view] = True
            return True
        self.cameras[view] = _cameras(xyz[inside][None], q[inside][None], np.ones((1, int(inside.sum()))))[0]
        self.good[rows[~inside]] = False
        self._place()
        return True

    def alternate(self, rounds: int) -> None:
        """Solve alternately for cameras and points, without outlying images."""
        for _ in range(rounds):
            rows = np.flatnonzero(self._usable())
            weight = self._weights(rows)
            for view in np.flatnonzero(self.known):
                own = self.view[rows] == view
                if own.sum() >= LEAST:
                    xyz, q = self.points[self.point[rows[own]]], self.q[rows[own]]
                    self.cameras[view] = _cameras(xyz[None], q[None], weight[own][None])[0]
            self._place()
            off = np.full(len(self.q), np.inf)
            rows = np.flatnonzero(self._usable(everything=True))
            off[rows] = _distances(self._seen(rows).T[None], self.q[rows])[0]
            self.good = off <= _bound(off[rows], self.least)

    def _usable(self, everything: bool = False) -> Array:
        placed = (
            np.isfinite(self.points).all(1)[self.point] & self.known[self.view.clip(0)] & (self.view >= 0)
        )
        return np.asarray(placed if everything else placed & self.good)

    def _seen(self, rows: Array) -> Array:
        return np.einsum("nij,nj->ni", self.cameras[self.view[rows]], self.points[self.point[rows]])

    def _weights(self, rows: Array) -> Array:
        return 1 / bounded_depths(self._seen(rows)[:, 2])

    def _place(self) -> None:
        """The points that two known views see, by their linear equations, weighted in a second pass."""
        for again in (False, True):
            rows = np.flatnonzero(self.known[self.view.clip(0)] & self.good & (self.view >= 0))
            if again:
                rows = rows[np.isfinite(self.points[self.point[rows]]).all(1)]
            weight = self._weights(rows) if again else np.ones(len(rows))
            p, q = self.cameras[self.view[rows]], self.q[rows]
            lines = (q[:, :2, None] * p[:, 2:] - p[:, :2]) * weight[:, None, None]
            normal = np.zeros((len(self.points), 4, 4))
            np.add.at(normal, self.point[rows], np.swapaxes(lines, 1, 2) @ lines)
            count = np.bincount(self.point[rows], minlength=len(self.points))
            found = np.linalg.eigh(normal)[1][:, :, 0]
            self.points = np.where((count >= 2)[:, None], found, np.nan)


def _bound(off: Array, least: float) -> float:
    """The distance up to which images count as inliers, by the median distance of all."""
    return max(FAR * MAD * float(np.median(off)), least)


def _cameras(xyz: Array, q: Array, weight: Array) -> Array:
    """Cameras (H, 3, 4) of norm 1 from points (H, N, 4) and their images (H, N, 3)."""
    zero = np.zeros_like(xyz)
    rows = [
        np.concatenate([xyz, zero, -q[..., :1] * xyz], -1),
        np.concatenate([zero, xyz, -q[..., 1:2] * xyz], -1),
    ]
    a = np.concatenate([r * weight[..., None] for r in rows], -2)
    return np.linalg.svd(a, full_matrices=True)[2][..., 11, :].reshape(-1, 3, 4)


def _distances(seen: Array, q: Array) -> Array:
    """Distances (H, N) of images (H, 3, N) from those observed (N, 3)."""
    with np.errstate(divide="ignore", invalid="ignore"):
        off = seen[:, :2] / seen[:, 2:] - q[:, :2].T
    return np.asarray(np.nan_to_num(np.sqrt(np.square(off).sum(1)), nan=np.inf))
