"""Self-calibration of many views: time, and the focal length beside its truth.

`--tracks N`: N views around simulated points, each of which 10 or so neighbouring views see, 0.3 px of noise.
`--pictures N`: N rendered pictures of a corner of a room (three planes of random texture, noise of two grey levels),
whose SIFT points are matched. f is 700 px of 640x480 in both; seed 0. Times are processor time.

Usage: python benchmarks/selfcalib_views.py [--tracks 100] [--pictures 100] [--update docs/routes.md]
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

import cv2
import numpy as np
from routes_common import looking
from tables import markdown, show

from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.routes import selfcalib
from camcal.routes.bundle import Tracks
from camcal.routes.picture_tracks import of_pictures

SIZE, F = (640, 480), 700.0
HEADER = ("pictures used", "images", "points", "f, px", "principal point, px", "matching", "calibration")
CAMERA = Camera(lenses.make("pinhole"), np.array([F, F, 319.5, 239.5]), SIZE)


def walk(count, radius, spread, rng):
    """Views from a quarter of a circle, rolled, that look at changing places."""
    turn = np.linspace(0.25, np.pi / 2 - 0.25, count)
    places = radius * np.stack([np.cos(turn), np.sin(turn), 0.45 + 0.1 * np.sin(9 * turn)], 1)
    places += rng.uniform(-0.3, 0.3, (count, 3))
    targets = rng.uniform(-spread, spread, (count, 3)) + [0.6, 0.6, 0.6]
    return [looking(p, t, r) for p, t, r in zip(places, targets, rng.uniform(-0.8, 0.8, count), strict=True)]


def simulated(count, rng):
    """Tracks of points of which each view sees a part."""
    world, poses = rng.uniform(-1.5, 1.5, (20 * count, 3)), walk(count, 5.0, 0.8, rng)
    view, point, uv = [], [], []
    for v, pose in enumerate(poses):
        seen = CAMERA.project(pose.apply(world))
        inside = ((seen > 0) & (seen < np.array(SIZE))).all(1)
        # a feature is found in a tenth of the views, those near to its own
        near = np.abs(v - np.arange(len(world)) / 20) < count / 20 + 2
        rows = np.flatnonzero(inside & near)
        view.append(np.full(len(rows), v))
        point.append(rows)
        uv.append(seen[rows] + rng.normal(0, 0.3, (len(rows), 2)))
    return Tracks(*map(np.concatenate, (view, point, uv))), len(world)


def pictures(folder, count, rng):
    """Rendered pictures of three textured planes."""
    textures = []
    for _ in range(3):
        noise = sum(
            cv2.resize(rng.normal(0, 1, (s, s)), (1000, 1000), interpolation=cv2.INTER_CUBIC)
            for s in (40, 100, 250)
        )
        textures.append(np.clip(128 + 40 * noise, 0, 255).astype(np.uint8))
    side = 2.0
    axes = [np.eye(3)[[0, 1]], np.eye(3)[[1, 2]], np.eye(3)[[2, 0]]]
    k = CAMERA.matrix
    for v, pose in enumerate(walk(count, 3.5, 0.4, rng)):
        shown = np.full(SIZE[::-1], 30, np.uint8)
        for texture, plane in zip(textures, axes, strict=True):
            # from pixels of the texture to the plane's two coordinates, to the picture
            to_plane = np.diag([side / 1000, side / 1000, 1.0])
            h = k @ np.c_[pose.rotation @ plane.T, pose.translation] @ to_plane
            covered = cv2.warpPerspective(np.full_like(texture, 255), h, SIZE)
            drawn = cv2.warpPerspective(texture, h, SIZE, flags=cv2.INTER_AREA)
            shown = np.where(covered > 128, drawn, shown)
        shown = np.clip(shown + rng.normal(0, 2, shown.shape), 0, 255).astype(np.uint8)
        cv2.imwrite(str(folder / f"{v:03d}.png"), shown)


def line(what, tracks, views, points, begin):
    """Calibrate and print; return the row of the table."""
    matched = time.process_time()
    found = selfcalib.estimate(tracks, views, points, lenses.make("pinhole"), SIZE, {})
    f, sigma = found.bundle.camera.params[0], float(np.sqrt(found.covariance[0, 0]))
    done = time.process_time()
    cx, cy = found.bundle.camera.params[2:4]
    print(
        f"{what}: {views} views, {len(tracks)} images of {points} points, {int(found.bundle.known_views.sum())} views "
        f"used, f {f:.2f} ± {sigma:.2f} (true {F:g}); start {found.start.params[0]:.1f}, dual quadric "
        f"{found.dual_quadric and round(found.dual_quadric, 1)}; matching {matched - begin:.0f} s, calibration "
        f"{done - matched:.0f} s",
        flush=True,
    )
    used = f"{int(found.bundle.known_views.sum())} of {views}"
    times = [f"{t:.0f} s" for t in (matched - begin, done - matched)]
    return [used, len(tracks), points, f"{f:.2f} ± {sigma:.2f}", f"{cx:.2f} {cy:.2f}", *times]


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--tracks", type=int, nargs="*", default=[])
    parser.add_argument("--pictures", type=int, nargs="*", default=[])
    parser.add_argument("--update", type=Path, help="the page with the table of pictures")
    given = parser.parse_args()
    for count in given.tracks:
        tracks, points = simulated(count, np.random.default_rng(0))
        line("simulated", tracks, count, points, time.process_time())
    rows = []
    for count in given.pictures:
        with tempfile.TemporaryDirectory() as folder:
            pictures(Path(folder), count, np.random.default_rng(0))
            begin = time.process_time()
            tracks, names, points, _ = of_pictures([Path(folder)])
            rows.append(line("pictures", tracks, len(names), points, begin))
    if rows:
        show(given.update, "selfcalib-pictures", markdown(HEADER, rows))


if __name__ == "__main__":
    main()
