"""Clean captures, and the ways in which a calibration goes wrong without a word, each under its right name.

The first group was measured with OpenCV's wheels 4.13 to 5.0 (true fx 1000, 0.1 px of noise): each of
these gave a camera that is wrong, sometimes by a factor of two, with a small rms and small sigmas. Two of its kind
are no fault here and are `HARMLESS`: a board's frame far from the origin, and a wide lens with a model for it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from camcal.assess.comparison import Side, compare
from camcal.assess.uncertainty import worst_sigma
from camcal.data.observations import Correspondences, View
from camcal.errors import CamcalError
from camcal.geometry import rotations
from camcal.model.camera import Camera
from camcal.model.lenses import make
from camcal.model.pose import Array
from camcal.plan.calibrate import calibrate
from camcal.plan.solution import Solution

SIZE = (1280, 960)
#: of its stated uncertainty a camera is off by more than this once in 400 honest calibrations
SIGMAS = 3.0
GLANCING = np.cos(np.deg2rad(70))
#: the cameras that took the views of the run under way, noted by `seen` for `codes`
_TAKEN_BY: list[Camera] = []
CLEAN_MODELS = ("pinhole", "opencv4", "opencv5", "opencv5", "kb4", "brown:radial=2")


def grid(columns: int = 9, rows: int = 6, square: float = 0.03) -> Array:
    x, y = np.meshgrid(np.arange(columns), np.arange(rows))
    return np.c_[x.ravel(), y.ravel(), 0 * x.ravel()] * square


def camera(model: str = "opencv5", rng: np.random.Generator | None = None, **other: float) -> Camera:
    """A usual lens of the model; with `rng` its parameters are scattered by a few per cent."""
    lens = make(model)
    values = {"fx": 1000.0, "fy": 1000.0, "cx": 639.5, "cy": 479.5}
    if lens.neutral_curve == "perspective" and "k1" in lens.names:
        values |= {"k1": -0.12, "k2": 0.05}
    if rng is not None:
        values = {n: v * rng.uniform(0.95, 1.05) for n, v in values.items()}
    return Camera(lens, lens.from_values(values | other), SIZE)


def seen(
    truth: Camera,
    rng: np.random.Generator,
    count: int,
    board: Array | None = None,
    tilt: tuple[float, float] = (10.0, 40.0),
    fill: tuple[float, float] = (0.35, 0.75),
    noise: float = 0.1,
    spread: float = 1.0,
    turn: Array | None = None,
) -> Correspondences:
    """Views of a board, tilted by `tilt` degrees in all directions, that fills so much of the picture."""
    _TAKEN_BY.append(truth)
    board = grid() if board is None else board
    views: list[View] = []
    centre, extent = board.mean(0), np.ptp(board, axis=0).max()
    for _ in range(400 * count):
        if len(views) == count:
            break
        around, angle = rng.uniform(0, 2 * np.pi), np.deg2rad(rng.uniform(*tilt))
        rotation = rotations.exp(angle * np.array([np.cos(around), np.sin(around), 0.0]))
        rotation = rotation @ rotations.exp(np.array([0, 0, rng.uniform(-0.3, 0.3)]))
        if turn is not None:
            rotation = rotations.exp(turn)
        depth = truth.params[0] * extent / (rng.uniform(*fill) * SIZE[0])
        pixel = (np.array(SIZE) - 1) * (0.5 + spread * (rng.random(2) - 0.5))
        where = truth.unproject(pixel)
        # no board is found that is seen at a glancing angle, or from behind
        if not np.isfinite(where).all() or where[2] < 0.2 or rotation[:, 2] @ where < GLANCING:
            continue
        uv = truth.project((board - centre) @ rotation.T + where / where[2] * depth)
        if np.isfinite(uv).all() and (uv > 2).all() and (uv < np.subtract(SIZE, 3)).all():
            observed = uv + noise * rng.normal(size=uv.shape)
            views.append(View(f"v{len(views)}", board, observed, None, np.arange(len(board))))
    if len(views) < count:
        raise RuntimeError("no pose fits")
    return Correspondences.from_views(tuple(views), SIZE)


def clean(seed: int) -> set[str]:
    """What is said of clean data: models, boards, 10 to 30 views, noise, outlier treatment, size known or not."""
    rng = np.random.default_rng(seed)
    model = str(rng.choice(CLEAN_MODELS))
    board = grid(*((9, 6), (7, 5), (12, 9))[rng.integers(3)])
    data = seen(
        camera(model, rng), rng, int(rng.integers(10, 31)), board, noise=float(rng.uniform(0.05, 0.5))
    )
    if rng.random() < 0.2:
        data = replace(data, image_sizes=(None,))
    return codes(data, model=model, robust=str(rng.choice(["none", "auto"])))


class Said(set):
    """Codes of warnings, with the grade; an error is `wrong`.

    `off` is how far the camera projects from those that took the views, px (of several the farthest), and `stated` its
    own uncertainty; both rms over the part of the picture that points cover. NaN where there is no camera.
    """

    grade: str = "wrong"
    off: float = float("nan")
    stated: float = float("nan")

    @property
    def wrong(self) -> bool:
        """Whether the camera is off by more than three times its stated uncertainty; a missing one is."""
        return not self.off <= SIGMAS * self.stated

    @property
    def passed(self) -> bool:
        """Whether a camera that is off by more than that and by more than 1 px is graded good."""
        return self.grade == "good" and self.off > max(1.0, SIGMAS * self.stated)


def codes(data: Correspondences, **options: Any) -> Said:
    """Codes of the warnings, or what the error says."""
    cameras = list(_TAKEN_BY)
    _TAKEN_BY.clear()
    try:
        found = calibrate(data, **{"model": "opencv5", "crosscheck": False, **options})
    except CamcalError as error:
        return Said({f"error: {error}"})
    said = Said(w.code for w in found.warnings)
    said.grade = found.grade
    errors = [_error(found, c) for c in cameras]
    if errors:  # else the same views once more, with other options
        said.off, said.stated = max(errors, key=lambda e: np.nan_to_num(e[0], nan=np.inf))
    return said


def _error(found: Solution, truth: Camera) -> tuple[float, float]:
    """How far a solution projects from the true camera, and by its own statement, rms over the covered part, px."""
    own = Side.of("found", found)
    bounds = np.zeros(2), np.subtract(SIZE, 1.0)
    apart = compare(own, Side("truth", truth), bounds)
    if own.uncertainty is None:
        return apart.inside.rms_px, 0.0
    sigmas = worst_sigma(own.uncertainty.at_pixels(apart.difference.pixels[apart.supported]))
    # infinite somewhere is infinite: nothing was claimed
    return apart.inside.rms_px, float(np.sqrt(np.mean(np.square(sigmas)))) if len(sigmas) else float("inf")


# ------------------------------------------------------------------ clean data of many kinds
def _fisheye(focal: float) -> Camera:
    lens = make("kb4")
    values = {"fx": focal, "fy": focal, "cx": 645.0, "cy": 472.0, "k1": 0.02, "k2": -0.005}
    return Camera(lens, lens.from_values(values), SIZE)


def _sigmas(rng: np.random.Generator) -> Correspondences:
    """Points of very different quality, whose sigmas are given and true."""
    data = seen(camera(), rng, 15, noise=0.0)

    def noisy(view: View) -> View:
        sigma = rng.uniform(0.05, 1.0, len(view))
        return replace(view, uv=view.uv + sigma[:, None] * rng.normal(size=view.uv.shape), sigma=sigma)

    return each(data, noisy)


def _board_of(columns: int, rows: int, count: int) -> Callable[[np.random.Generator], Correspondences]:
    return lambda rng: seen(camera(), rng, count, grid(columns, rows, 0.24 / (columns - 1)))


CLEAN_KINDS: dict[str, tuple[Callable[[np.random.Generator], Correspondences], str]] = {
    "3x3 points, 25 views": (_board_of(3, 3, 25), "opencv5"),
    "4x3 points, 20 views": (_board_of(4, 3, 20), "opencv5"),
    "6x4 points, 15 views": (_board_of(6, 4, 15), "opencv5"),
    "14x10 points, 10 views": (_board_of(14, 10, 10), "opencv5"),
    "30x20 points, 8 views": (_board_of(30, 20, 8), "opencv5"),
    "6 views": (lambda r: seen(camera(), r, 6), "opencv5"),
    "5 views, pinhole": (lambda r: seen(camera("pinhole"), r, 5), "pinhole"),
    "4 views, pinhole": (lambda r: seen(camera("pinhole"), r, 4), "pinhole"),
    "40 views": (lambda r: seen(camera(), r, 40), "opencv5"),
    "lens of 8 degrees": (
        lambda r: seen(camera("pinhole", fx=9000.0, fy=9000.0), r, 15, tilt=(25.0, 50.0), fill=(0.5, 0.8)), "pinhole"),
    "lens of 20 degrees": (lambda r: seen(camera(fx=3600.0, fy=3600.0), r, 20, tilt=(20.0, 45.0)), "opencv4"),
    "lens of 40 degrees": (lambda r: seen(camera(fx=1760.0, fy=1760.0), r, 15), "opencv4"),
    "lens of 90 degrees": (lambda r: seen(camera(fx=640.0, fy=640.0), r, 20), "opencv5"),
    "lens of 120 degrees": (lambda r: seen(_fisheye(600.0), r, 20, fill=(0.2, 0.45)), "kb4"),
    "lens of 150 degrees": (lambda r: seen(_fisheye(470.0), r, 20, fill=(0.2, 0.45)), "kb4"),
    "lens of 170 degrees": (lambda r: seen(_fisheye(420.0), r, 25, fill=(0.2, 0.45)), "kb4"),
    "pixels 10 % taller than wide": (lambda r: seen(camera(fy=1100.0), r, 15), "opencv5"),
    "principal point 80, 60 px off": (lambda r: seen(camera(cx=720.0, cy=420.0), r, 15), "opencv5"),
    "given true sigmas of .05 to 1 px": (_sigmas, "opencv5"),
    "noise of .02 px": (lambda r: seen(camera(), r, 15, noise=0.02), "opencv5"),
    "noise of 1 px": (lambda r: seen(camera(), r, 20, noise=1.0), "opencv5"),
}  # fmt: skip


def clean_kind(task: tuple[str, int]) -> tuple[str, Said]:
    """What is said of clean data of a kind, with outliers looked for as by default."""
    name, seed = task
    make_data, model = CLEAN_KINDS[name]
    return name, codes(make_data(np.random.default_rng(seed)), model=model, robust="auto")


# ------------------------------------------------------------------ changes to clean data
def changed(data: Correspondences, index: int, uv: Array) -> Correspondences:
    views = list(data.views)
    views[index] = replace(views[index], uv=uv)
    return data.with_views(tuple(views))


def each(data: Correspondences, change: Callable[[View], View]) -> Correspondences:
    return data.with_views(tuple(change(v) for v in data.views))


def repeated(data: Correspondences, times: int, rng: np.random.Generator) -> Correspondences:
    """Every view so many times, each with noise of its own."""
    views = [
        replace(v, id=f"{v.id}.{i}", uv=v.uv + rng.normal(0, 0.1, v.uv.shape))
        for i in range(times)
        for v in data.views
    ]
    return data.with_views(tuple(views))


def _one_pose(rng):
    return codes(repeated(seen(camera(), rng, 1, noise=0.0), 10, rng))


def _wide(rng, **options):
    lens = make("kb4")
    truth = Camera(lens, lens.from_values({"fx": 420.0, "fy": 420.0, "cx": 639.5, "cy": 479.5}), SIZE)
    return codes(seen(truth, rng, 20, fill=(0.2, 0.45)), robust="none", **options)


def _two_outliers(rng):
    data = seen(camera(), rng, 12)
    uv = data.views[3].uv.copy()
    uv[rng.choice(len(uv), 2, replace=False)] += rng.choice([-40, 40], (2, 2))
    return codes(changed(data, 3, uv), robust="none")


def _one_view(rng, order, **options):
    """One view whose points are in another order: `order` of their (6, 9, 2) array."""
    data = seen(camera(), rng, 12)
    return codes(changed(data, 4, order(data.views[4].uv.reshape(6, 9, 2)).reshape(-1, 2)), **options)


def _swapped(uv):
    flat = uv.reshape(-1, 2).copy()
    flat[[8, 30]] = flat[[30, 8]]
    return flat


def _shifted_row(uv):
    moved = uv.copy()
    moved[2] = np.roll(uv[2], 1, axis=0)
    return moved


def _another_board(rng):
    data = seen(camera(), rng, 11)
    other = seen(camera(), rng, 1, grid() * [1.0, 1.15, 1.0]).views[0]
    return codes(data.with_views((*data.views, replace(other, id="other", xyz=grid()))), robust="auto")


def _many_outliers(rng):
    data = seen(camera(), rng, 12)

    def wrong(view):
        uv = view.uv.copy()
        some = rng.choice(len(uv), 4, replace=False)
        uv[some] += rng.uniform(8, 40, (4, 2)) * rng.choice([-1, 1], (4, 2))
        return replace(view, uv=uv)

    return codes(each(data, wrong), robust="auto")


def _mixed_points(rng):
    data = seen(camera(), rng, 12)
    return codes(each(data, lambda v: replace(v, uv=v.uv[rng.permutation(len(v))])), robust="none")


def _bowed(rng):
    board = grid()
    x = 2 * board[:, 0] / np.ptp(board[:, 0]) - 1
    data = seen(camera(), rng, 15, board + np.c_[0 * x, 0 * x, 0.004 * (1 - x**2)])
    return codes(each(data, lambda v: replace(v, xyz=board)))


def _badly_printed(rng):
    board = grid()
    printed = board + np.c_[rng.normal(0, 3e-4, (len(board), 2)), 0 * board[:, 0]]
    return codes(each(seen(camera(), rng, 15, printed), lambda v: replace(v, xyz=board)))


def _heavy_tails(rng):
    data = seen(camera(), rng, 15, noise=0.0)
    return codes(
        each(data, lambda v: replace(v, uv=v.uv + 0.1 * rng.standard_t(3, v.uv.shape))), robust="none"
    )


def _far_away(rng):
    data = seen(camera(), rng, 12)
    return codes(each(data, lambda v: replace(v, xyz=v.xyz + [5e4, 3e4, 0.0])))


#: what a fault of the whole set must not be taken for
BLAME = {"other-board", "mirrored-views", "mirrored-picture", "rejected-mirror-image"}


# ------------------------------------------------------------------ faults that all views have in common
def _mapped(data: Correspondences, some: Array, move: Callable[[Array], Array]) -> Correspondences:
    """The image points of some views (a mask) moved."""
    views = [replace(v, uv=move(v.uv)) if s else v for v, s in zip(data.views, some, strict=True)]
    return data.with_views(tuple(views))


def _later(count: int, rng) -> Array:
    """Views from somewhere in the middle on."""
    return np.arange(count) >= rng.integers(count // 3, count - count // 3 + 1)


def _any_half(count: int, rng) -> Array:
    return rng.permutation(count) < count // 2


def _two(rng, some: Callable, **other):
    """Some of 15 views by a camera of other parameters; the lens off the centre, as lenses are."""
    first = camera(cx=652.0, cy=471.0)
    values = dict(zip(first.lens.names, first.params, strict=True))
    values |= {n: v * values[n] if n[0] == "f" or n[0] == "k" else v + values[n] for n, v in other.items()}
    second = Camera(first.lens, first.lens.from_values(values), SIZE)
    a, b = seen(first, rng, 15), seen(second, rng, 15)
    mask = some(15, rng)
    views = [replace(w if m else v, id=v.id) for v, w, m in zip(a.views, b.views, mask, strict=True)]
    return a.with_views(tuple(views))


def _rolling(rng):
    """Each view displaced in proportion to its row, 4 px (rms) over the picture."""
    data = seen(camera(), rng, 15)
    speed = iter(rng.normal(0, 4 / SIZE[1], (15, 2)))
    return each(data, lambda v: replace(v, uv=v.uv + np.outer(v.uv[:, 1] - SIZE[1] / 2, next(speed))))


def _stabilised(rng):
    data = seen(camera(), rng, 15)
    shift = iter(rng.normal(0, 12, (15, 2)))
    return each(data, lambda v: replace(v, uv=v.uv + next(shift)))


def _printed(rng, matrix):
    board = grid()
    data = seen(camera(), rng, 15, board @ np.array(matrix).T)
    return each(data, lambda v: replace(v, xyz=board))


def _part(rng, some, move):
    return _mapped(seen(camera(cx=652.0, cy=471.0), rng, 15), some(15, rng), move)


def _wrong_count(rng):
    return each(seen(camera(), rng, 12), lambda v: replace(v, xyz=grid(6, 9)))


def _too_large(rng):
    return replace(seen(camera(cx=652.0, cy=471.0), rng, 12), image_sizes=((2560, 1920),))


def _turned(uv):
    return np.subtract(SIZE, 1) - uv


def _mirrored(uv):
    return np.c_[SIZE[0] - 1 - uv[:, 0], uv[:, 1]]


def _everywhere(rng, move):
    """All views, of a lens off the centre, moved alike."""
    return each(seen(camera(cx=652.0, cy=471.0), rng, 15), lambda v: replace(v, uv=move(v.uv)))


def _pole(rng):
    """One view of five poles of five points, 1 px of noise: a hand took one of them for a mark 15 px beside it."""
    poles = np.array([[-0.2, 0.0], [-0.1, 0.15], [0.0, -0.1], [0.1, 0.2], [0.2, 0.05]])
    board = np.concatenate(
        [np.c_[np.full(5, x), np.linspace(-0.12, 0.12, 5), np.full(5, z)] for x, z in poles]
    )
    data = seen(camera("opencv4", cx=652.0, cy=471.0, k2=0.0), rng, 1, board, fill=(0.6, 0.75), noise=1.0)
    uv = data.views[0].uv.copy()
    uv[np.arange(25) // 5 == rng.integers(5)] += [15 * rng.choice([-1, 1]), 4]
    return codes(changed(data, 0, uv), model="opencv4", robust="auto")


def _ellipses(rng):
    """Circles of a radius of 0.4 squares, each given by the centroid of its image with the noise of discs, 0.02 px."""
    truth, board = camera(cx=652.0, cy=471.0), grid()
    around = np.linspace(0, 2 * np.pi, 90, endpoint=False)
    outlines = board[:, None] + 0.012 * np.c_[np.cos(around), np.sin(around), 0 * around]
    data = seen(truth, rng, 15, np.concatenate([board, outlines.reshape(-1, 3)]), noise=0.0)

    def centroids(view: View) -> View:
        outline = view.uv[len(board) :].reshape(len(board), -1, 2)
        following = np.roll(outline, -1, 1)
        cross = outline[..., 0] * following[..., 1] - outline[..., 1] * following[..., 0]
        centre = ((outline + following) * cross[..., None]).sum(1) / (3 * cross.sum(1))[:, None]
        return View(view.id, board, centre + rng.normal(0, 0.02, centre.shape), None, np.arange(len(board)))

    return each(data, centroids)


TWO = ("several-cameras", "zoom-or-refocus")
MIRRORED = ("mirrored-views", "mirrored-picture", "rejected-mirror-image", "points-outside-image")
GRAVE, ANY = ("wrong",), ("wrong", "doubtful")
COMMON_FAULTS = {
    "zoom by 2 % at some view": (lambda r: _two(r, _later, fx=1.02, fy=1.02), TWO, GRAVE),
    "zoom by 0.5 %": (lambda r: _two(r, _later, fx=1.005, fy=1.005), TWO, ANY),
    "refocused: f 1 % longer, k1 10 % larger": (lambda r: _two(r, _later, fx=1.01, fy=1.01, k1=1.1), TWO, GRAVE),
    "two cameras in any order, f 5 % apart": (
        lambda r: _two(r, _any_half, fx=1.05, fy=1.05, k1=0.5, cx=8.0), TWO, GRAVE),
    "two cameras, f 43 % apart": (lambda r: _two(r, _any_half, fx=1.43, fy=1.43), TWO, GRAVE),
    "half of the pictures halved": (
        lambda r: _part(r, _later, lambda uv: (uv + 0.5) / 2 - 0.5), ("resized-pictures",), GRAVE),
    "any half of the pictures at 3/4": (
        lambda r: _part(r, _any_half, lambda uv: (uv + 0.5) * 0.75 - 0.5), ("resized-pictures",), GRAVE),
    "a part cropped by 60, 40 px": (
        lambda r: _part(r, _later, lambda uv: uv - [60, 40]), ("cropped-pictures", "several-cameras"), ANY),
    "any half turned by 180 degrees": (lambda r: _part(r, _any_half, _turned), ("turned-pictures",), ANY),
    "rolling shutter, 4 px": (_rolling, ("rolling-shutter",), ANY),
    "stabiliser, 12 px": (_stabilised, ("principal-point-moves",), ANY),
    "print 2 % longer in y": (lambda r: _printed(r, np.diag([1, 1.02, 1])), ("board-not-flat",), ANY),
    "print sheared by 1 degree": (
        lambda r: _printed(r, [[1, 0.0175, 0], [0, 1, 0], [0, 0, 1]]), ("board-not-flat",), ANY),
    "9x6 numbered as 6x9": (_wrong_count, ("error: numbered",), GRAVE),
    "picture size twice as large": (_too_large, ("image-size",), ANY),
    "any third of the pictures mirrored": (
        lambda r: _part(r, lambda n, g: g.permutation(n) < n // 3, _mirrored), MIRRORED, ANY),
    "any half of the pictures mirrored": (lambda r: _part(r, _any_half, _mirrored), MIRRORED, ANY),
    "u and v exchanged in all": (lambda r: _everywhere(r, lambda uv: uv[:, ::-1]), MIRRORED, ANY),
    "circles given by the centroids of their images": (_ellipses, ("circle-centres",), ANY),
}  # fmt: skip


def _common(run):
    def made(rng):
        data = run(rng)
        return codes(data, robust="auto")

    return made


PARALLEL = ("fronto-parallel-views", "parallel-views", "error: parallel")
POINTS = ("large-residuals", "error: behind", "error: order")


@dataclass(frozen=True)
class Case:
    """A fault, a run of it from a random generator, the names that are right for it, and the grades."""

    name: str
    run: Callable[[np.random.Generator], set[str]]
    right: tuple[str, ...]
    grades: tuple[str, ...] = ()

    def named(self, found: set[str]) -> bool:
        """Whether one of the right names is among what was found, the grade is right, and nobody is blamed for it."""
        if self.grades and (
            getattr(found, "grade", "") not in self.grades or found & BLAME - set(self.right)
        ):
            return False
        for wanted in self.right:
            kind, _, word = wanted.partition(": ")
            if wanted in found or (word and any(f.startswith(kind) and word in f for f in found)):
                return True
        return False


SILENT = [
    Case("12 views parallel to the image", lambda r: codes(seen(camera(), r, 12, tilt=(0, 0))), PARALLEL),
    Case("tilts of 0.6 degrees", lambda r: codes(seen(camera(), r, 12, tilt=(0.5, 0.7))), PARALLEL),
    Case("parallel to the image, no distortion",
         lambda r: codes(seen(camera("pinhole"), r, 12, tilt=(0, 0)), model="pinhole"), PARALLEL),
    Case("one pose 10 times", _one_pose, ("duplicate-views",)),
    Case("one view", lambda r: codes(seen(camera(), r, 1)), ("single-view",)),
    Case("three views, 14 coefficients", lambda r: codes(seen(camera(), r, 3), model="opencv14"), ("few-views",)),
    Case("board only in the centre",
         lambda r: codes(seen(camera(), r, 12, fill=(0.15, 0.2), spread=0.1)), ("poor-coverage",)),
    Case("14 coefficients on a mild lens, 6 views",
         lambda r: codes(seen(camera(k1=-0.02, k2=0.0), r, 6, fill=(0.25, 0.4), spread=0.4), model="opencv14"),
         ("undetermined-parameters", "fold-in-image")),
    Case("lens of 80 degrees, 5 coefficients", _wide, ("systematic-residuals", "fold-in-image", "large-residuals")),
    Case("two outliers, not looked for", _two_outliers, ("outliers",)),
    Case("one view mirrored", lambda r: _one_view(r, lambda a: a[:, ::-1], robust="none"), ("mirrored-views",)),
]  # fmt: skip
OTHERS = [
    Case("every pose twice", lambda r: codes(repeated(seen(camera(), r, 6, noise=0.0), 2, r)), ("duplicate-views",)),
    Case("all boards turned alike, by 31 degrees",
         lambda r: codes(seen(camera(), r, 12, turn=np.array([0.5, 0.2, 0.0]))), ("parallel-views",)),
    Case("two views, 5 coefficients", lambda r: codes(seen(camera(), r, 2)), ("few-views",)),
    Case("four corners of six boards",
         lambda r: codes(seen(camera("pinhole"), r, 6, grid()[[0, 8, 45, 53]]), model="pinhole"), ("few-points",)),
    Case("points in any order", _mixed_points, POINTS),
    Case("wrong picture size",
         lambda r: codes(replace(seen(camera(), r, 12), image_sizes=((640, 480),))), ("points-outside-image",)),
    Case("board bowed by 1.7 % of its length", _bowed, ("views-disagree", "board-not-flat")),
    Case("corners printed off by 1 % of a square", _badly_printed, ("views-disagree", "board-not-flat")),
    Case("coordinates in whole pixels",
         lambda r: codes(each(seen(camera(), r, 12), lambda v: replace(v, uv=np.round(v.uv)))),
         ("rounded-coordinates",)),
    Case("noise with heavy tails (Student, 3)", _heavy_tails, ("heavy-tailed-residuals", "outliers")),
    Case("4 of 54 points wrong in every view", _many_outliers, ("rejected-points",)),
    Case("two points swapped", lambda r: _one_view(r, _swapped, robust="auto"), ("mismatched-points",)),
    Case("a row shifted by one", lambda r: _one_view(r, _shifted_row, robust="auto"), ("mismatched-points",)),
    Case("one picture of another board", _another_board, ("other-board",)),
    Case("one of five poles of a single view off by 15 px", _pole,
         ("rejected-points", "outliers", "mismatched-points", "shifted-group")),
]  # fmt: skip
COMMON = [Case(name, _common(run), right, grades) for name, (run, right, grades) in COMMON_FAULTS.items()]
HARMLESS = [
    Case("a frame 58 km away", _far_away, ()),
    Case("lens of 80 degrees, kb4", lambda r: _wide(r, model="kb4"), ()),
]
