"""A rig followed through time without a board: from points that its pictures share."""

from __future__ import annotations

import os
from collections.abc import Iterable
from itertools import combinations

import numpy as np

from camcal.assess.rig import pose_rows
from camcal.data.labelled import read_labelled
from camcal.detect.rig_scenes import Shared
from camcal.errors import DataError
from camcal.plan.rig_drift import Followed, require_cameras, tested
from camcal.plan.solution import RigSolution
from camcal.routes.epipolar import agreeing
from camcal.routes.natural import NEAR, local_scatter
from camcal.routes.picture_tracks import LEAST_MATCHES
from camcal.settings.tracking import FALSE_ALARM
from camcal.track.rig_matches import MAD, Matched, PairMatches, instant_of_matches, rays_of

Array = np.ndarray


def follow_scenes(
    rig: RigSolution, instants: Iterable[tuple[str, Shared]], false_alarm: float = FALSE_ALARM
) -> Followed:
    """Test at each instant whether the cameras are where the calibration of the rig says, from matches.

    Which matches count is decided without the places of the cameras under test (`camcal.routes.natural`). A change has
    to move points by more than the calibration's rms_point, and by more than lenses are off: what is left of the
    matches and is the same in neighbouring ones, after the cameras are moved to where the matches fit best.

    Parameters
    ----------
    rig : RigSolution
        With its data: the uncertainty of the calibration takes part in the test.
    instants : iterable of (name, matches of each two cameras)
    false_alarm : float
        Per instant.

    Raises
    ------
    DataError
        If a camera is not one of the rig's, or no instant has two pictures that share enough points.
    """
    sides = _Sides(rig)
    made: list[Matched] = []
    smooth: list[float] = []
    alone: list[str] = []
    points = 0
    for name, shared in instants:
        require_cameras(rig, [n for pair in shared for n in pair])
        pairs, pixels = sides.pairs(shared)
        if not pairs:
            alone.append(name)
            continue
        found = instant_of_matches(name, pairs, list(rig.rig.cam_from_rig.values()), sides.by_rig)
        made.append(found)
        smooth += [_smooth(*uv, left) for uv, left in zip(pixels, found.left, strict=True)]
        points += sum(map(len, pairs))
    if not made:
        raise DataError(
            f"no two pictures of the same instant share {LEAST_MATCHES} points.",
            "Take pictures of a textured scene, at the same instant, and check which camera took which.",
        )
    least = max(rig.rms_point, float(np.median(smooth)))
    return tested(rig, [m.instant for m in made], [], least, false_alarm, tuple(alone), points)


class _Sides:
    """The cameras of a rig as the epipolar residuals need them."""

    def __init__(self, rig: RigSolution):
        self.rig, self.names = rig.rig, list(rig.rig.cameras)
        self.by_rig = np.array([pose_rows(rig, n) for n in self.names])
        row, self.free = 0, {}
        for name, camera in rig.rig.cameras.items():
            self.free[name] = rig.free[row : row + camera.lens.size]
            row += camera.lens.size

    def pairs(self, shared: Shared) -> tuple[list[PairMatches], list[tuple[Array, Array]]]:
        """The matches that agree with each other, and their pixels."""
        pairs, pixels = [], []
        for (a, b), uv in shared.items():
            if len(uv[0]) < LEAST_MATCHES:
                continue
            if not self.rig.baseline(a, b):
                raise DataError(
                    f"cameras '{a}' and '{b}' have the same position: without a baseline, matches do not "
                    f"determine their poses.",
                    "Give pictures of a board instead.",
                )
            rays = [rays_of(self.rig.cameras[n], p, self.free[n]) for n, p in zip((a, b), uv, strict=True)]
            shown = np.isfinite(rays[0].direction).all(1) & np.isfinite(rays[1].direction).all(1)
            if shown.sum() < LEAST_MATCHES:
                continue
            one, two = (r.where(shown) for r in rays)
            px = float(np.median(np.linalg.norm(two.by_pixel, axis=(1, 2)))) / np.sqrt(2)  # rad
            good = agreeing(one.direction, two.direction, NEAR * px, axes=3)[1]
            if good.sum() < LEAST_MATCHES:
                continue
            at = [self.names.index(n) for n in (a, b)]
            pairs.append(PairMatches(at[0], at[1], (one.where(good), two.where(good))))
            pixels.append((uv[0][shown][good], uv[1][shown][good]))
        return pairs, pixels


def _smooth(first: Array, second: Array, left: Array) -> float:
    """The part of residuals that neighbouring matches have in common, px: errors of the lenses."""
    apart = np.linalg.norm(second - first, axis=1)
    noise = local_scatter(np.c_[first, apart], left)
    whole, random = (MAD * float(np.median(np.abs(v))) for v in (left, noise))
    return float(np.sqrt(max(whole**2 - random**2, 0.0)))


def read_shared(path: str | os.PathLike) -> list[tuple[str, Shared]]:
    """(instant, matches of each two cameras) from a table `view,camera,point,u,v`, in the order of its rows.

    Raises
    ------
    DataError
        If the table cannot be read, or has a point twice in one picture.
    """
    table = read_labelled(path, ("view", "camera", "point"))
    cameras = table.names["camera"]
    found: list[tuple[str, Shared]] = []
    pictures = table.labels["view"] * len(cameras) + table.labels["camera"]
    order = np.argsort(pictures, kind="stable")
    bounds = np.searchsorted(pictures[order], np.arange(len(table.names["view"]) * len(cameras) + 1))
    for index, view in enumerate(table.names["view"]):
        seen = {}
        for k, name in enumerate(cameras):
            own = index * len(cameras) + k
            rows = order[bounds[own] : bounds[own + 1]]
            points = table.labels["point"][rows]
            if len(np.unique(points)) < len(points):
                raise DataError(
                    f"'{path}': view {view} of camera {name} lists a point twice.", "Keep one row per point."
                )
            seen[name] = points, table.uv[rows]
        shared = {}
        for a, b in combinations(seen, 2):
            _, i, j = np.intersect1d(seen[a][0], seen[b][0], return_indices=True)
            shared[a, b] = seen[a][1][i], seen[b][1][j]
        found.append((view, shared))
    return found
