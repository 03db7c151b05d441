"""How exact corners are: camcal's two passes beside OpenCV's refinements and the bound, on rendered boards.

    python benchmarks/corners.py [--pictures 60] [--seed 1] [--size 640x480] [--update docs/figures.md]

Boards of 9x6 corners at random poses (tilt to 65 degrees) through lenses with strong distortion, squares of
8 to 80 px, blur 0.5 to 2.5 px, noise 0 to 10 grey levels, uneven light. Every method is scored on the
corners of the pictures in which SB finds the board, matched to the nearest true corner; cornerSubPix starts
from SB's corners. camcal is compared with the best of cv2's methods in each picture, chosen with the truth at hand.

"bound" is the Cramér-Rao bound: the covariance of a corner's position when the seven parameters of the
noise-free picture of that corner are estimated from the pixels of camcal's own window, with the noise
known. The ratio is the median of error / bound over the corners,
divided by what that is for Gaussian errors of just this size.

The row of the bound holds errors drawn with its sigmas for the widest windows that show one corner each, whatever
their size in px: no fit of single corners has less.

To reach: the second pass a quarter of the median of cv2's best of each picture, and within 1.1 of the bound; 93 to
97 % of the errors inside the 95 % ellipses of the fits' own covariances.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from tables import markdown, show

from camcal.data.observations import View
from camcal.detect import edge_model, saddle
from camcal.detect.camera_pass import LARGEST as LARGEST_SECOND
from camcal.detect.camera_pass import refine_in_windows
from camcal.detect.targets.base import Detection
from camcal.detect.targets.checkerboard import Checkerboard
from camcal.detect.windows import LARGEST, cut, limited, straightened
from camcal.geometry import rotations
from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.model.pose import Pose
from camcal.study.render import Look, render

BOARD = Checkerboard(9, 6)
WINDOWS = (3, 4, 5, 7, 9, 11)  #: half-widths of cornerSubPix, px
HEADER = (
    "corners", "pictures", "number", "median px", "p95 px", "in the 95 % ellipse, %", "of cv2's best",
    "of the bound",
)  # fmt: skip
BEST = "cv2's best of each picture"  #: the method with the least median error, chosen with the truth at hand
#: errors drawn with the sigmas of the bound: what no fit of single corners goes below
WIDEST, UNLIMITED = 0.9, 1e3
FLOOR = f"the bound, windows of {WIDEST} of any size"
FIRST = 0.0  #: stands for the windows of the first pass, narrower at the rim of the board
IN_95 = 5.991  #: chi square of two degrees of freedom
MEDIAN = np.sqrt(2 * np.log(2))  #: of the length of a Gaussian error in the plane, in sigmas


@dataclass
class Scene:
    """A picture with its truth."""

    gray: np.ndarray
    uv: np.ndarray
    camera: Camera
    cam_from_board: Pose
    look: Look

    def board_from_pixel(self, px: np.ndarray) -> np.ndarray:
        back = self.cam_from_board.inverse()
        ray = self.camera.unproject(px) @ back.rotation.T
        return back.translation[:2] - back.translation[2] / ray[..., 2:] * ray[..., :2]


def scenes(rng: np.random.Generator, count: int, size: tuple[int, int]) -> Iterator[Scene]:
    while count:
        camera = random_camera(rng, size)
        placed = random_pose(rng, camera)
        if placed is None:
            continue
        look = Look(
            blur=rng.uniform(0.5, 2.5), noise=rng.uniform(0, 10), black=rng.uniform(20, 70),
            white=rng.uniform(150, 235), gradient=rng.uniform(0, 0.5), direction=rng.uniform(0, 6),
            vignetting=rng.uniform(0, 0.3),
        )  # fmt: skip
        pose, uv = placed
        yield Scene(render(BOARD.pattern(), camera, pose, look, rng), uv, camera, pose, look)
        count -= 1


def random_camera(rng: np.random.Generator, size: tuple[int, int]) -> Camera:
    lens = lenses.make("opencv5")
    width, height = size
    f, k1 = width * rng.uniform(0.7, 1.1), rng.uniform(-0.35, 0.05)
    values = {
        "fx": f, "fy": f, "cx": width / 2 + rng.normal(0, 5), "cy": height / 2 + rng.normal(0, 5),
        "k1": k1, "k2": rng.uniform(0, 0.12) if k1 < 0 else 0.0, "p1": rng.normal(0, 1e-3), "p2":
        rng.normal(0, 1e-3),
    }  # fmt: skip
    return Camera(lens, np.array([values.get(name, 0.0) for name in lens.names]), size)


def random_pose(rng: np.random.Generator, camera: Camera) -> tuple[Pose, np.ndarray] | None:
    """A pose that shows the whole board, and the true corners; None where many trials fail."""
    assert camera.image_size is not None
    size = np.array(camera.image_size)
    middle = BOARD.points.mean(0)
    for _ in range(2000):
        tilt, about = np.deg2rad(rng.uniform(0, 65)), rng.uniform(0, 2 * np.pi)
        rotation = rotations.exp(tilt * np.array([np.cos(about), np.sin(about), 0]))
        rotation = rotation @ rotations.exp(np.array([0, 0, rng.uniform(0, 2 * np.pi)]))
        square = np.exp(rng.uniform(np.log(8), np.log(80)))
        ray = camera.unproject(rng.uniform(0.15, 0.85, 2) * size)
        depth = camera.values["fx"] / square
        pose = Pose(rotation, ray / ray[2] * depth - rotation @ middle)
        xyz = pose.apply(BOARD.points)
        if xyz[:, 2].min() < 0.2 * depth:
            continue
        uv = camera.project(xyz)
        margin = 0.6 * square
        if not np.isfinite(uv).all() or (uv < margin).any() or (uv > size - 1 - margin).any():
            continue
        grid = uv.reshape(BOARD.rows, BOARD.columns, 2)
        if min(np.linalg.norm(np.diff(grid, axis=a), axis=-1).min() for a in (0, 1)) >= 7:
            return pose, uv
    return None


def matched(uv: np.ndarray, true: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Index of the nearest true corner of each found one, and the errors (N, 2)."""
    nearest = np.linalg.norm(uv[:, None] - true, axis=2).argmin(1)
    return nearest, uv - true[nearest]


def bound(scene: Scene, ids: np.ndarray, half: float | np.ndarray, largest: float) -> np.ndarray:
    """Sigma of each corner by the Cramér-Rao bound, px; windows of `half` a square and at most `largest` px."""
    uv = scene.uv[ids]
    step = 0.5 * np.array([[1, 0], [-1, 0], [0, 1], [0, -1]], float)
    board = scene.board_from_pixel(uv[:, None] + step)
    sides = np.linalg.inv(np.stack([board[:, 0] - board[:, 1], board[:, 2] - board[:, 3]], -1)).transpose(
        0, 2, 1
    )
    blur = np.hypot(scene.look.blur, np.sqrt(1 / 12))
    share = np.clip(1 - saddle.CLEAR * blur / np.linalg.norm(sides, axis=2).min(1), saddle.LEAST_HALF, half)
    share = limited(share, sides, largest)
    windows = cut(scene.gray, uv, sides, share, saddle.SEEN * blur + 1, largest)
    windows = straightened(windows, sides, share, scene.board_from_pixel, blur)
    params = np.zeros((len(uv), edge_model.COUNT))
    params[:, edge_model.ANGLE1 : edge_model.ANGLE2 + 1] = saddle.edge_normals(sides)
    params[:, edge_model.CONTRAST] = (scene.look.white - scene.look.black) / 2
    params[:, edge_model.BLUR] = blur
    jacobian = edge_model.evaluate(windows.q, params)[1] * windows.counts[:, None]
    information = (jacobian @ jacobian.transpose(0, 2, 1)).astype(float)
    noise = np.hypot(scene.look.noise, np.sqrt(1 / 12))  # the rounding to whole grey levels
    covariance = np.linalg.inv(information)[:, :2, :2] * noise**2
    return np.sqrt(0.5 * np.trace(covariance, axis1=1, axis2=2))


class Score:
    """Errors of one method over all pictures."""

    def __init__(self) -> None:
        self.errors: list[np.ndarray] = []
        self.inside: list[np.ndarray] = []

    def add(self, error: np.ndarray, covariance: np.ndarray | None = None) -> None:
        self.errors.append(np.linalg.norm(error, axis=1))
        if covariance is not None:
            distance = np.einsum("ni,nij,nj->n", error, np.linalg.inv(covariance), error)
            self.inside.append(distance < IN_95)

    @property
    def median(self) -> float:
        return float(np.median(np.concatenate(self.errors))) if self.errors else np.inf

    def row(self, name: str) -> list[str]:
        every = np.concatenate(self.errors) if self.errors else np.array([np.nan])
        inside = f"{100 * np.concatenate(self.inside).mean():.1f}" if self.inside else ""
        p95 = np.percentile(every, 95)
        return [name, str(len(self.errors)), str(len(every)), f"{np.median(every):.4f}", f"{p95:.4f}", inside]


def run(count: int, seed: int, size: tuple[int, int]) -> str:
    """The table."""
    rng = np.random.default_rng(seed)
    names = ["SB", "SB accuracy", *(f"cornerSubPix {w}" for w in WINDOWS), BEST, "camcal, first pass"]
    scores = {name: Score() for name in names}
    halves = (0.5, 0.65, 0.8)
    scores |= {f"camcal, second pass {h}": Score() for h in halves} | {FLOOR: Score()}
    predicted: dict[float, list[np.ndarray]] = {h: [] for h in (FIRST, *halves)}
    alone = missed = 0
    for scene in scenes(rng, count, size):
        found = BOARD.find(scene.gray, seconds=30.0)
        sb = add_opencv(scene, scores)
        if not isinstance(found, Detection) or not sb:
            alone += isinstance(found, Detection)
            missed += sb
            continue
        add_camcal(scene, found, scores, predicted)
    print(f"{count} pictures; found by camcal alone {alone}, by SB alone {missed}")
    best = scores[BEST].median
    windows = {"camcal, first pass": FIRST} | {f"camcal, second pass {h}": h for h in halves}
    rows = []
    for name, score in scores.items():
        more = ["", ""]
        if name == FLOOR:
            more[0] = f"{score.median / best:.2f}"
        if name in windows:
            relative = np.concatenate(score.errors) / np.concatenate(predicted[windows[name]])
            more = [f"{score.median / best:.2f}", f"{np.median(relative) / MEDIAN:.2f}"]
        rows.append([*score.row(name), *more])
    return markdown(HEADER, rows)


def add_opencv(scene: Scene, scores: dict[str, Score]) -> bool:
    """Score cv2's corners; whether SB has found the board."""
    size = (BOARD.columns, BOARD.rows)
    kinds = {"SB": 0, "SB accuracy": cv2.CALIB_CB_ACCURACY}
    corners = {}
    for name, flags in kinds.items():
        found, uv = cv2.findChessboardCornersSB(scene.gray, size, flags=flags)
        if not found:
            return False
        corners[name] = uv.reshape(-1, 2)
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 50, 1e-3)
    for window in WINDOWS:
        start = corners["SB accuracy"].astype(np.float32).reshape(-1, 1, 2).copy()
        uv = cv2.cornerSubPix(scene.gray, start, (window, window), (-1, -1), criteria).reshape(-1, 2)
        corners[f"cornerSubPix {window}"] = uv
    errors = {name: matched(uv, scene.uv)[1] for name, uv in corners.items()}
    for name, error in errors.items():
        scores[name].add(error)
    scores[BEST].add(min(errors.values(), key=lambda e: float(np.median(np.linalg.norm(e, axis=1)))))
    return True


def add_camcal(
    scene: Scene, found: Detection, scores: dict[str, Score], predicted: dict[float, list[np.ndarray]]
) -> None:
    nearest, error = matched(found.uv, scene.uv)
    scores["camcal, first pass"].add(error, found.info["covariance"])
    view = View("", BOARD.points[nearest], found.uv, found.sigma, nearest)
    blur = found.info["blur_px"]
    wider = saddle.wider_halves(BOARD.columns, BOARD.rows)[nearest]
    predicted[FIRST].append(bound(scene, nearest, wider, LARGEST))
    halves = [half for half in predicted if half != FIRST]
    views = refine_in_windows(scene.gray, view, scene.board_from_pixel, 1.0, halves, blur)
    for half, second in zip(halves, views, strict=True):
        covariance = np.eye(2) * (second.sigma**2)[:, None, None]
        scores[f"camcal, second pass {half}"].add(second.uv - scene.uv[nearest], covariance)
        predicted[half].append(bound(scene, nearest, half, LARGEST_SECOND))
    floor = bound(scene, nearest, WIDEST, UNLIMITED)
    scores[FLOOR].add(np.random.default_rng(len(nearest)).normal(size=(len(nearest), 2)) * floor[:, None])


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--pictures", type=int, default=60)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--size", default="640x480")
    parser.add_argument("--update", type=Path, metavar="PAGE", help="a page whose table is to be renewed")
    told = parser.parse_args()
    width, height = map(int, told.size.split("x"))
    table = run(told.pictures, told.seed, (width, height))
    show(told.update, "corners", table)


if __name__ == "__main__":
    main()
