"""The start of a wand calibration: relative poses of pairs of cameras, scaled by the bar, chained over the rig.

An unknown focal length is the one for which the length of the bar varies least over all instants. This also determines
it if the optical axes meet, when fundamental matrices do not (`selfcalib`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from camcal.errors import EstimationError
from camcal.geometry import projective
from camcal.least_squares.scales import MAD
from camcal.model.camera import Camera
from camcal.model.pose import Array, Pose
from camcal.records import dataclass
from camcal.routes import epipolar
from camcal.routes.placed import PlacedCamera
from camcal.routes.straightness import undistorted
from camcal.routes.triangulate import linear, sorted_images, triangulate
from camcal.routes.wand_fit import Sightings, Wand

#: rad; pairs are ranked by matches times median angle of rays, limited to this
WIDE = np.radians(30)
#: least number of bars seen whole by both cameras to determine its scale
LEAST_BARS = 5
#: fraction of the bar's length; smaller spreads are not distinguished: markers are not measured that well
FINEST = 1e-4


@dataclass(frozen=True)
class Link:
    """Two cameras: matching markers, undistorted, and their fundamental matrix."""

    first: int
    second: int
    rows: Array  #: (M, 2) rows of the sightings
    uv: tuple[Array, Array]  #: pixels without distortion, (M, 2) each
    matrix: Array
    agree: Array  #: (M,) bool


@dataclass(frozen=True)
class Placed:
    """A link with its motion scaled by the bar: second from first."""

    link: Link
    motion: Pose
    spread: float  #: of the logarithm of the bar's length, robust
    weight: float


def links(seen: Sightings, cameras: Sequence[Camera], seed: int) -> list[Link]:
    """All pairs of cameras that share enough markers."""
    flat = [undistorted(c, seen.uv) for c in cameras]
    key = seen.instant.astype(np.int64) * len(seen.places) + seen.marker
    found = []
    for a, b in combinations(range(len(cameras)), 2):
        own = [
            {int(key[r]): r for r in np.flatnonzero((seen.camera == c) & np.isfinite(flat[c]).all(1))}
            for c in (a, b)
        ]
        rows = np.array([[own[0][k], own[1][k]] for k in sorted(own[0].keys() & own[1].keys())], int)
        if len(rows) < epipolar.LEAST_MATCHES:
            continue
        uv = flat[a][rows[:, 0]], flat[b][rows[:, 1]]
        made = epipolar.fundamental(*uv, seed)
        if made is not None:
            found.append(Link(a, b, rows, uv, *made))
    return found


def placed(link: Link, cameras: Sequence[Camera], seen: Sightings) -> Placed | None:
    """The motion of a link; None if its rays have no angle or no complete bar is seen."""
    ka, kb = cameras[link.first].matrix, cameras[link.second].matrix
    rays = [
        _unit(projective.homogeneous(uv) @ np.linalg.inv(k).T)
        for uv, k in zip(link.uv, (ka, kb), strict=True)
    ]
    good = [r[link.agree] for r in rays]
    options = [(m, *epipolar.two_view_points(m, *good)) for m in epipolar.motions(kb.T @ link.matrix @ ka)]
    motion, xyz, angle = max(options, key=lambda o: np.isfinite(o[1]).all(1).sum())
    xyz[angle < epipolar.LEAST_ANGLE] = np.nan
    rows = link.rows[link.agree, 0]
    lengths = _lengths(seen, rows, xyz)
    if len(lengths) < LEAST_BARS:
        return None
    middle = float(np.median(lengths))
    spread = MAD * float(np.median(np.abs(np.log(lengths / middle))))
    # the directions of both rays in one frame
    weight = float(np.isfinite(xyz).all(1).sum()) * min(float(np.nanmedian(angle)), WIDE)
    return Placed(link, Pose(motion.rotation, motion.translation / middle), spread, weight)


def _lengths(seen: Sightings, rows: Array, xyz: Array) -> Array:
    """The lengths of a unit of the bar (T,), of instants with two markers or more."""
    known = np.isfinite(xyz).all(1)
    _, points, directions = _bars(seen, rows[known], xyz[known], False)
    del points
    lengths = np.linalg.norm(directions, axis=1)
    return np.asarray(lengths[np.isfinite(lengths) & (lengths > 0)])


def _bars(seen: Sightings, rows: Array, xyz: Array, unit: bool) -> tuple[Array, Array, Array]:
    """Instants (T,), and the lines X + p d through the markers (T, 3) each, by least squares; NaN for one marker."""
    instants, group = np.unique(seen.instant[rows], return_inverse=True)
    p, count = seen.places[seen.marker[rows]], np.bincount(group)
    mean_p = np.bincount(group, p) / count
    mean_x = np.stack([np.bincount(group, c) for c in xyz.T], 1) / count[:, None]
    off = p - mean_p[group]
    squares = np.bincount(group, off**2)
    with np.errstate(invalid="ignore", divide="ignore"):
        d = np.stack([np.bincount(group, off * c) for c in xyz.T], 1) / squares[:, None]
        d[squares == 0] = np.nan
        if unit:
            d = d / np.linalg.norm(d, axis=1, keepdims=True)
    return instants, mean_x - mean_p[:, None] * d, d


def with_focal(cameras: Sequence[Camera], unknown: Sequence[bool], part: float) -> tuple[Camera, ...]:
    """The cameras; unknown focal lengths are set to this fraction of the longer side."""
    return tuple(
        replace(c, params=np.r_[2 * [part * max(c.image_size or (1, 1))], c.params[2:]]) if u else c
        for c, u in zip(cameras, unknown, strict=True)
    )


def focal_part(
    found: Sequence[Link], seen: Sightings, cameras: Sequence[Camera], unknown: Sequence[bool]
) -> float:
    """The focal length, in longer sides of the picture, at which the bar's length varies least."""
    best = (np.inf, 1.0)
    for part in epipolar.FOCAL:
        trial = with_focal(cameras, unknown, float(part))
        made = [placed(link, trial, seen) for link in found]
        spreads = [m.spread for m in made if m is not None]
        if spreads:
            best = min(best, (float(np.mean(np.log(np.array(spreads) + FINEST))), float(part)))
    return best[1]


def chained(made: Sequence[Placed], count: int, names: Sequence[str]) -> tuple[Pose, ...]:
    """cam_from_rig of all cameras, along the strongest links (Prim's algorithm).

    Raises
    ------
    EstimationError
        If a camera shares too few markers with the others.
    """
    poses: dict[int, Pose] = {0: Pose(np.eye(3), np.zeros(3))}
    while len(poses) < count:
        ways = [m for m in made if (m.link.first in poses) != (m.link.second in poses)]
        if not ways:
            lost = [names[i] for i in range(count) if i not in poses]
            raise EstimationError(
                f"camera{'s' * (len(lost) > 1)} {', '.join(lost)} cannot be placed: {epipolar.LEAST_MATCHES} markers "
                f"seen together with another camera, {LEAST_BARS} whole bars among them, and rays at an angle of a "
                "degree are needed.",
                "Move the bar through the volume that neighbouring cameras share.",
            )
        best = max(ways, key=lambda m: m.weight)
        if best.link.first in poses:
            poses[best.link.second] = best.motion @ poses[best.link.first]
        else:
            poses[best.link.first] = best.motion.inverse() @ poses[best.link.second]
    return tuple(poses[i] for i in range(count))


def with_bars(cameras: Sequence[Camera], poses: Sequence[Pose], seen: Sightings, instants: int) -> Wand:
    """The bars of all instants with two markers that two cameras see, without images that disagree (if three see
    them).
    """
    key = seen.instant.astype(np.int64) * len(seen.places) + seen.marker
    names, point = np.unique(key, return_inverse=True)
    known = [PlacedCamera(str(i), c, p) for i, (c, p) in enumerate(zip(cameras, poses, strict=True))]
    images, _ = sorted_images(seen.camera, point, seen.uv)
    found = triangulate(known, images, len(names))
    xyz, across = found.xyz, linear(known, images, found.used, len(names))[1]
    good = np.flatnonzero((across > np.sin(epipolar.LEAST_ANGLE) ** 2 / 2) & np.isfinite(xyz).all(1))
    first = np.full(len(names), -1)
    first[point[::-1]] = np.arange(len(seen))[::-1]
    at, points, directions = _bars(seen, first[good], xyz[good], True)
    all_points, all_directions = np.full((instants, 3), np.nan), np.full((instants, 3), np.nan)
    whole = np.isfinite(directions).all(1)
    all_points[at[whole]], all_directions[at[whole]] = points[whole], directions[whole]
    return Wand(tuple(cameras), tuple(poses), all_points, all_directions)


def _unit(d: Array) -> Array:
    return np.asarray(d / np.linalg.norm(d, axis=1, keepdims=True))
