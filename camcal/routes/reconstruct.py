"""Incremental reconstruction: poses and points from tracks with a rough focal length, starting from one pair."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from camcal.data.observations import View
from camcal.errors import CamcalError
from camcal.geometry import rotations
from camcal.model.camera import Camera
from camcal.model.pose import Array, Pose
from camcal.records import dataclass
from camcal.routes import epipolar
from camcal.routes.bundle import Bundle, Tracks, adjust
from camcal.routes.placed import PlacedCamera
from camcal.routes.pose import find
from camcal.routes.triangulate import linear, sorted_images

#: least number of known points of a view that is added: twice those that determine its pose uniquely
LEAST_KNOWN = 8
#: rad; the first pair has the largest product of matches and median angle of rays, limited to this
WIDE = np.radians(20)
#: pairs tried as the first
PAIRS = 12
#: fraction of the picture's width; images farther from their points are excluded during the reconstruction, when poses
#: and focal length are still approximate
ROUGH = 0.02
#: views added between two adjustments of all, and as a fraction of those known: the adjustments of 100 views then take
#: as long as the last one three times, not ten times
EVERY, EVERY_SHARE = 4, 0.2
#: points of a view: three determine its pose, up to four solutions; the fourth decides
LEAST_SEEN = 4
#: medians of the residuals (1.7 σ each way), and px: residuals of exact images are rounding
LOOSE, LEAST_SCALE = 2.0, 1e-3


@dataclass(frozen=True)
class Pair:
    """Two views, their fundamental matrix, and the number of matches that agree with it."""

    first: int
    second: int
    matrix: Array
    matches: Array  #: (M, 2) rows of the tracks
    agree: Array  #: (M,) bool


def pairs(tracks: Tracks, views: int, seed: int = 0, most: int = 30) -> list[Pair]:
    """Fundamental matrices of the pairs of views that share points, those with the most matches first."""
    rows = [dict(zip(tracks.point[r].tolist(), r.tolist(), strict=True)) for r in _by_view(tracks, views)]
    shared = [(len(rows[a].keys() & rows[b].keys()), a, b) for a in range(views) for b in range(a + 1, views)]
    found = []
    for count, a, b in sorted(shared, reverse=True)[:most]:
        if count < epipolar.LEAST_MATCHES:
            break
        points = sorted(rows[a].keys() & rows[b].keys())
        matches = np.array([[rows[a][p], rows[b][p]] for p in points])
        made = epipolar.fundamental(tracks.uv[matches[:, 0]], tracks.uv[matches[:, 1]], seed)
        if made is not None:
            found.append(Pair(a, b, made[0], matches, made[1]))
    return found


def _by_view(tracks: Tracks, views: int) -> list[Array]:
    return [np.flatnonzero(tracks.view == v) for v in range(views)]


def first_pair(
    known: list[Pair], camera: Camera, tracks: Tracks, bundle: Bundle
) -> tuple[float, Bundle] | None:
    """The initial pair, chosen by matches and angle, with its points; None if no pair has an angle."""
    best: tuple[float, Bundle] | None = None
    for pair in known[:PAIRS]:
        made = _placed(pair, camera, tracks, bundle)
        if made is not None and (best is None or made[0] > best[0]):
            best = made
    return best


def _placed(pair: Pair, camera: Camera, tracks: Tracks, bundle: Bundle) -> tuple[float, Bundle] | None:
    matches = pair.matches[pair.agree]
    first, second = (camera.unproject(tracks.uv[matches[:, i]]) for i in (0, 1))
    k = camera.matrix
    options = []
    for motion in epipolar.motions(k.T @ pair.matrix @ k):
        points, angle = epipolar.two_view_points(motion, first, second)
        ahead = np.isfinite(points).all(1)
        options.append((int(ahead.sum()), motion, points, angle))
    count, motion, points, angle = max(options, key=lambda o: o[0])
    if count < epipolar.LEAST_MATCHES // 2:
        return None
    ahead = np.isfinite(points).all(1) & (angle > epipolar.LEAST_ANGLE)
    if ahead.sum() < LEAST_KNOWN:
        return None
    r, t, p = bundle.rotations.copy(), bundle.translations.copy(), bundle.points.copy()
    r[pair.first], t[pair.first] = np.eye(3), 0
    r[pair.second], t[pair.second] = motion.rotation, motion.translation
    p[tracks.point[matches[ahead, 0]]] = points[ahead]
    score = float(ahead.sum()) * min(float(np.median(angle[ahead])), WIDE)
    return score, replace(bundle, camera=camera, rotations=r, translations=t, points=p)


def empty(camera: Camera, views: int, points: int) -> Bundle:
    """A bundle in which nothing is known yet."""
    nothing = np.full((views, 3), np.nan)
    return Bundle(camera, np.tile(np.eye(3), (views, 1, 1)), nothing, np.full((points, 3), np.nan))


def grow(bundle: Bundle, tracks: Tracks, free: Array) -> Bundle:
    """Add views, always the one with most known points, and the points that they determine."""
    refused: set[int] = set()
    since = 0
    bundle = settled(bundle, tracks, free)
    while True:
        known = bundle.known_points[tracks.point] & ~bundle.known_views[tracks.view]
        counts = np.bincount(tracks.view[known], minlength=len(bundle.rotations))
        counts[list(refused)] = 0
        best = int(counts.argmax())
        if counts[best] < LEAST_KNOWN:
            return settled(bundle, tracks, free) if since else bundle
        pose = _pose(bundle, tracks, best)
        if pose is None:
            refused.add(best)
            continue
        r, t = bundle.rotations.copy(), bundle.translations.copy()
        r[best], t[best] = pose.rotation, pose.translation
        bundle = with_points(replace(bundle, rotations=r, translations=t), tracks)
        since += 1
        if _due(since, int(bundle.known_views.sum())):
            bundle, since = settled(bundle, tracks, free), 0


def _due(since: int, known: int) -> bool:
    """Return whether a joint adjustment is due, given the number of views since the last one."""
    return since >= max(EVERY, EVERY_SHARE * known) or known <= 2 * EVERY


def _pose(bundle: Bundle, tracks: Tracks, view: int) -> Pose | None:
    rows = np.flatnonzero((tracks.view == view) & bundle.known_points[tracks.point])
    try:
        found = find(bundle.camera, View(str(view), bundle.points[tracks.point[rows]], tracks.uv[rows]))
    except CamcalError:  # undetermined by the points known so far
        return None
    return found.solutions[0].pose if found.used.sum() >= LEAST_KNOWN else None


def with_points(bundle: Bundle, tracks: Tracks) -> Bundle:
    """Triangulate every point that two known views see at an angle, and remove those that fit badly."""
    rows = np.flatnonzero(bundle.known_views[tracks.view])
    part = tracks.take(rows)
    cameras = [
        PlacedCamera(str(v), bundle.camera, Pose(bundle.rotations[v], np.nan_to_num(bundle.translations[v])))
        for v in range(len(bundle.rotations))
    ]
    images, _ = sorted_images(part.view, part.point, part.uv)
    used = np.ones(len(images), bool)
    xyz, angle = linear(cameras, images, used, len(bundle.points))
    # the least eigenvalue of Σ (I - d dᵀ) is about sin²(angle) / 2 for two rays
    xyz[angle < np.sin(epipolar.LEAST_ANGLE) ** 2 / 2] = np.nan
    fresh = np.where(bundle.known_points[:, None], bundle.points, xyz)
    return replace(bundle, points=_without_bad(replace(bundle, points=fresh), part))


def _without_bad(bundle: Bundle, tracks: Tracks) -> Array:
    """Points (P, 3), NaN if no two images are near their projections."""
    off = np.linalg.norm(bundle.residuals(tracks), axis=1)
    good = off <= _rough(bundle, tracks)
    count = np.bincount(tracks.point[good], minlength=len(bundle.points))
    return np.where((count >= 2)[:, None], bundle.points, np.nan)


def _rough(bundle: Bundle, tracks: Tracks) -> float:
    size = bundle.camera.image_size
    return ROUGH * (max(size) if size is not None else float(np.ptp(tracks.uv, 0).max()))


def usable(bundle: Bundle, tracks: Tracks, bound: float | Array) -> Array:
    """The rows (M,) of images within a bound, px, for all or each, of points with two such images in known views."""
    off = np.linalg.norm(bundle.residuals(tracks), axis=1)
    good = off <= bound
    count = np.bincount(tracks.point[good], minlength=len(bundle.points))
    good &= count[tracks.point] >= 2
    seen = np.bincount(tracks.view[good], minlength=len(bundle.rotations))
    return np.flatnonzero(good & (seen[tracks.view] >= LEAST_SEEN))


def loose_scale(off: Array) -> float:
    """The length of a residual, px, above which it loses weight in a first adjustment: `LOOSE` times their median."""
    return max(LOOSE * float(np.median(off)), LEAST_SCALE)


def settled(bundle: Bundle, tracks: Tracks, free: Array, iterations: int = 15) -> Bundle:
    """A short robust adjustment of all known quantities, followed by a new triangulation."""
    rough = _rough(bundle, tracks)
    rows = usable(bundle, tracks, rough)
    if not len(rows):
        return bundle
    part = tracks.take(rows)
    off = np.linalg.norm(bundle.residuals(part), axis=1)
    scale = loose_scale(off)
    fitted = adjust(bundle, part, free, iterations, scale)
    return bundle if fitted is None else with_points(fitted.state, tracks)


def aligned(bundle: Bundle) -> Bundle:
    """The bundle in the frame of its first known view, scaled to an rms distance of the points of 1."""
    first = int(np.flatnonzero(bundle.known_views)[0])
    r0, t0 = bundle.rotations[first], bundle.translations[first]
    points = bundle.points @ r0.T + t0
    scale = 1 / float(np.sqrt(np.nanmean((points**2).sum(1))))
    r = bundle.rotations @ r0.T
    t = bundle.translations - np.einsum("vij,j->vi", r, t0)
    return replace(bundle, rotations=rotations.nearest(r), translations=t * scale, points=points * scale)
