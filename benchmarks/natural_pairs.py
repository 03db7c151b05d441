"""Vertical disparity on natural pairs by camcal's calibration and by cv2.stereoCalibrate's from the same boards.

    python benchmarks/natural_pairs.py BOARDS_LEFT BOARDS_RIGHT SQUARE NATURAL

NATURAL is a folder of NAME_left.jpg and NAME_right.jpg. Each of the calibrations judges the same matches of a pair:
those that agree with each other (`camcal.routes.natural`), which no calibration decides. Printed are the median and the
root mean square of the vertical disparities below `TAIL` robust standard deviations, and of differences between
calibrations the standard error over tiles of the picture (a bootstrap of `TILES`, as what a lens is off is the same in
neighbouring matches).
"""

from __future__ import annotations

import sys
from pathlib import Path

import cv2
import numpy as np
from tables import markdown

import camcal
from camcal.data.observations import Observations
from camcal.detect import matches as detected
from camcal.detect.decode import as_gray
from camcal.detect.rig_images import detect_rig
from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.model.pose import Pose
from camcal.model.rectification import rectify
from camcal.routes.natural import judge
from camcal.system.processes import one_opencv_thread

K1K2 = "brown:radial=2,decentering=0"
#: robust standard deviations; wrong matches that happen to agree with the others
TAIL = 4.0
#: across and down
TILES = (8, 6)
DRAWS = 500
Pair = tuple[Camera, Camera, Pose]


def by_camcal(solution) -> Pair:
    """The pair of a solution."""
    return (*solution.rig.cameras.values(), solution.rig.relative("right", "left"))


def by_cv2(solution, data: Observations, flags: int, lens: str) -> Pair:
    """cv2.stereoCalibrate of the points of a solution, on the board as designed, from each camera alone."""
    points, views = [], ([], [])
    for view in range(len(data)):
        rows = [np.flatnonzero((data.view == view) & (data.camera == c)) for c in (0, 1)]
        _, i, j = np.intersect1d(data.point[rows[0]], data.point[rows[1]], return_indices=True)
        points.append(data.xyz[rows[0][i]].astype(np.float32))
        for own, r in zip(views, (rows[0][i], rows[1][j]), strict=True):
            own.append(data.uv[r].astype(np.float32))
    size = solution.rig.cameras["left"].image_size
    with one_opencv_thread():
        alone = [cv2.calibrateCamera(points, v, size, None, None, flags=flags)[1:3] for v in views]
        found = cv2.stereoCalibrate(
            points, *views, *alone[0], *alone[1], size, flags=flags | cv2.CALIB_USE_INTRINSIC_GUESS,
            criteria=(3, 500, 1e-12),
        )  # fmt: skip
    model, cameras = lenses.make(lens), []
    for k, d in ((found[1], found[2]), (found[3], found[4])):
        values = dict(zip(("k1", "k2", "p1", "p2", "k3"), np.ravel(d), strict=False))
        values |= {"fx": k[0, 0], "fy": k[1, 1], "cx": k[0, 2], "cy": k[1, 2]}
        cameras.append(Camera(model, model.from_values({n: values[n] for n in model.names}), size))
    return (*cameras, Pose(found[5], np.ravel(found[6])))


def vertical(pair: Pair, first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Vertical disparities, px of the pictures' scale."""
    return rectify(*pair).disparities(first, second)[1]


def figures(v: np.ndarray) -> tuple[float, float]:
    """Median and trimmed root mean square."""
    size = np.abs(v)
    return float(np.median(size)), float(np.sqrt(np.mean(v[size < TAIL * 1.4826 * np.median(size)] ** 2)))


def compared(a: np.ndarray, b: np.ndarray, first: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Differences of both figures and their standard errors, (2, 2)."""
    tile = (first / np.array(size) * TILES).astype(int).clip(0, np.array(TILES) - 1) @ [1, TILES[0]]
    groups = [np.flatnonzero(tile == t) for t in np.unique(tile)]
    rng, drawn = np.random.default_rng(0), []
    for _ in range(DRAWS):
        rows = np.concatenate([groups[g] for g in rng.integers(0, len(groups), len(groups))])
        drawn.append(np.subtract(figures(a[rows]), figures(b[rows])))
    return np.array([np.subtract(figures(a), figures(b)), np.std(drawn, 0)])


def main() -> None:
    """Print the tables."""
    left, right, square, natural = sys.argv[1:5]
    boards = detect_rig({"left": [left], "right": [right]}, square=square)
    shaped = {"board_shape": "auto", "robust": "auto", "refine_points": None}
    made = camcal.calibrate_rig(boards, model=K1K2, crosscheck=False, **shaped)
    default = camcal.calibrate_rig(boards, crosscheck=False, **shaped)
    given = camcal.calibrate_rig(boards, model=K1K2, board_shape="flat", checks=False, refine_points=None)
    data = given.observations
    flat = camcal.calibrate_rig(
        boards, board_shape="flat", checks=False, crosscheck=False, refine_points=None
    )
    fixed = cv2.CALIB_FIX_K3 | cv2.CALIB_ZERO_TANGENT_DIST
    pairs = {
        "camcal, k1 k2": by_camcal(made),
        "cv2, k1 k2": by_cv2(given, data, fixed, K1K2),
        "camcal, default": by_camcal(default),
        "cv2, default": by_cv2(given, data, 0, "opencv5"),
        "camcal, default, flat board": by_camcal(flat),
    }
    for name, solution in (("k1 k2", made), ("default", default), ("flat", flat), ("k1 k2, flat", given)):
        kind = solution.board.kind if solution.board else "flat"
        print(f"{name}: board {kind}, rms {solution.rms_point:.4f} px, rejected {(~solution.used).sum()}")
    rows: dict[tuple[str, int], list] = {}
    for path in sorted(Path(natural).glob("*_left.*")):
        pictures = [as_gray(cv2.imread(str(p))) for p in (path, Path(str(path).replace("_left", "_right")))]
        first, second = detected.matches(*pictures)
        good = judge(rectify(*pairs["camcal, k1 k2"]), first, second)
        first, second = good.first[good.good], good.second[good.good]
        found = {name: vertical(pair, first, second) for name, pair in pairs.items()}
        shown = np.all([np.isfinite(v) for v in found.values()], 0)
        found = {name: v[shown] for name, v in found.items()}
        size = pictures[0].shape[1::-1]
        for name, v in found.items():
            for k, value in enumerate(figures(v)):
                rows.setdefault((name, k), []).append(f"{value:.3f}")
        for a, b in (
            ("camcal, k1 k2", "cv2, k1 k2"),
            ("camcal, default", "cv2, default"),
            ("camcal, k1 k2", "cv2, default"),
        ):
            off, sigma = compared(found[a], found[b], first[shown], size)
            for k in (0, 1):
                rows.setdefault((f"{a} less {b}", k), []).append(f"{off[k]:+.3f} ± {sigma[k]:.3f}")
        rows.setdefault(("matches", 0), []).append(str(shown.sum()))
        print(path.name, flush=True)
    names = [p.name.split("_left")[0] for p in sorted(Path(natural).glob("*_left.*"))]
    for k, title in enumerate(("median", "trimmed rms")):
        print(markdown([title, *names], [[n, *v] for (n, kind), v in rows.items() if kind == k]))


if __name__ == "__main__":
    main()
