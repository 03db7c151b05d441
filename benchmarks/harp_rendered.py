"""Lines of rendered harps: the distortion that is found, beside the true one.

Three pictures of dark strings (turned by 90, 0 and 45 degrees) through a known lens, exact but for blur and noise of
two grey levels (`camcal.study.render`). Straight lines determine the undistortion up to a homography: the field is the
difference of the pixels undistorted by the fit and by the true lens, after the best homography between them, px. Of the
part of the picture that strings cover (convex hull), seeds from 0.

Usage: python benchmarks/harp_rendered.py [--runs 10] [--kept FILE] [--update docs/routes.md]
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import cv2
import numpy as np
from tables import keep, kept, markdown, show

from camcal.detect.targets.base import Pattern
from camcal.geometry import homography, rotations
from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.model.pose import Pose
from camcal.routes import line_start
from camcal.routes.read_lines import read_lines
from camcal.routes.straightness import after, undistorted
from camcal.study.render import Look, render

SIZE, F = (1280, 960), 1000.0
BROWN = lenses.make("brown:radial=3")
#: what a wide-angle lens of a consumer camera has: 8 px of bending over the picture
TRUE = Camera(
    BROWN,
    BROWN.from_values(
        {
            "fx": F,
            "fy": F,
            "cx": 652.0,
            "cy": 469.0,
            "k1": -0.12,
            "k2": 0.04,
            "k3": -0.01,
            "p1": 3e-4,
            "p2": -2e-4,
        }
    ),
    SIZE,
)
DIVISION = lenses.make("division:1")
WIDE = Camera(DIVISION, DIVISION.from_values({"fx": F, "fy": F, "cx": 652.0, "cy": 469.0, "l1": -0.2}), SIZE)
CASES = (
    ("k1 k2 k3 p1 p2", TRUE, "brown:radial=3"),
    ("division -0.2", WIDE, "division:1"),
    ("k1 k2 k3 p1 p2", TRUE, "opencv8"),
    ("k1 k2 k3 p1 p2", TRUE, "spline"),
)
HEADER = (
    "lens",
    "model",
    "noise",
    "pictures",
    "strings",
    "straightness, px",
    "field rms, px",
    "field max, px",
)
STRINGS, WIDTH, REACH = 17, 0.004, 2.2  #: strings 4 px wide, .08 apart; long enough to cross the picture


def harp(camera, rng, noise):
    """Three pictures of strings."""
    across = (np.arange(STRINGS) - (STRINGS - 1) / 2) * 0.08
    corners = np.array([[-1, -REACH], [1, -REACH], [1, REACH], [-1, REACH]])
    strings = tuple(np.c_[x + corners[:, 0] * WIDTH / 2, corners[:, 1]] for x in across)
    sheet = Pattern(strings, np.zeros((0, 3)), (-3.0, -3.0, 3.0, 3.0))
    for angle in (90, 0, 45):
        turn = rotations.exp(np.array([0, 0, np.radians(angle)])) @ rotations.exp(rng.uniform(-0.15, 0.15, 3))
        where = Pose(turn, np.array([*rng.uniform(-0.03, 0.03, 2), 1.0]))
        yield render(sheet, camera, where, Look(noise=noise), rng)


def field(found, true, hull):
    """The rms and largest difference of two undistortions, a homography apart, px."""
    u, v = np.meshgrid(np.linspace(0, SIZE[0] - 1, 41), np.linspace(0, SIZE[1] - 1, 31))
    uv = np.c_[u.ravel(), v.ravel()]
    inside = [cv2.pointPolygonTest(hull, tuple(map(float, p)), False) >= 0 for p in uv]
    a, b = undistorted(found, uv[inside]), undistorted(true, uv[inside])
    h = homography.homographies(a[None], b[None])
    off = np.linalg.norm(homography.transfer(h, a[None])[0] - b, axis=1)
    return float(np.sqrt(np.mean(off**2))), float(off.max())


def measure(name, camera, model, noise, seed):
    """One run."""
    rng = np.random.default_rng(seed)
    with tempfile.TemporaryDirectory() as folder:
        for index, picture in enumerate(harp(camera, rng, noise)):
            cv2.imwrite(f"{folder}/{index}.png", picture)
        lines = read_lines([folder])[0]
    found = line_start.estimate(lines, lenses.make(model), {}, True)
    kept = lines.take(found.used)
    hull = cv2.convexHull(kept.uv.astype(np.float32))
    rms, most = field(found.camera, camera, hull)
    return {
        "row": [name, model, f"{noise:g}", 3],
        "strings": len(kept),
        "straight": after(found.camera, kept).rms,
        "rms": rms,
        "max": most,
    }


def table(rows):
    """The means over the seeds; of the fields also the largest."""
    made = {}
    for r in rows:
        made.setdefault(tuple(r["row"]), []).append(r)
    out = []
    for key, runs in made.items():
        mean = {k: np.mean([r[k] for r in runs]) for k in ("strings", "straight", "rms", "max")}
        worst = max(r["max"] for r in runs)
        out.append(
            [
                *key[:3],
                f"{len(runs)} x 3",
                f"{mean['strings']:.0f}",
                f"{mean['straight']:.3f}",
                f"{mean['rms']:.3f}",
                f"{mean['max']:.3f} (worst {worst:.3f})",
            ]
        )
    return markdown(HEADER, out)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--runs", type=int, default=10)
    parser.add_argument("--kept", type=Path, required=True)
    parser.add_argument("--update", type=Path)
    given = parser.parse_args()
    if not given.update:
        for seed in range(given.runs):
            for name, camera, model in CASES:
                for noise in (0.0, 2.0):
                    made = measure(name, camera, model, noise, seed)
                    print(made, flush=True)
                    keep(given.kept, made)
    show(given.update, "harp-rendered", table(kept(given.kept)))


if __name__ == "__main__":
    main()
