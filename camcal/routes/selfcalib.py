"""Self-calibration from tracks of unknown points: focal length from fundamental matrices, then bundle adjustment.

1. The fundamental matrix of every pair of views with enough matches.
2. The focal length with which all E = Kᵀ F K are most nearly essential matrices (Mendonça & Cipolla 1999), the
   principal point in the middle, pixels square.
3. The views put together one by one, then adjusted together with the focal length and the lens.

What the motion leaves undetermined (a critical motion: Sturm, Critical motion sequences for monocular self-calibration
and uncalibrated Euclidean reconstruction, 1997) shows in the standard deviation of the focal length after the
adjustment; two views are refused before that where their axes meet.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from camcal.errors import DataError, EstimationError
from camcal.model.camera import Camera
from camcal.model.lenses import make
from camcal.model.lenses.base import Lens
from camcal.model.lenses.regress import regress
from camcal.model.pose import Array
from camcal.routes import epipolar
from camcal.routes.bundle import Bundle, Tracks, adjust, camera_covariance
from camcal.routes.reconstruct import Pair, aligned, empty, first_pair, grow, pairs, usable, with_points
from camcal.solve.parameters import apply_fixed, free_matrix

#: Principal points of real cameras lie within this part of the picture's width of its middle. A single pair of views
#: whose axes miss one another by less is critical; a principal point whose sigma is larger is undetermined.
CENTRE = 0.05
#: relative standard deviation of the focal length from which a motion counts as critical
UNCERTAIN = 0.1
#: added to 1 - σ2 / σ1 before its logarithm: what noise leaves of it at the right focal length
SHARP = 1e-3
#: images farther than this many robust standard deviations from their points are left out, and no less than px
FAR, LEAST_FAR = 4.0, 0.5
ROUNDS = 4  #: of adjusting and leaving out images, at most
LEAST_VIEWS = 2  #: one view has no parallax


@dataclass(frozen=True)
class SelfCalibration:
    """The result of the self-calibration.

    Attributes
    ----------
    bundle : Bundle
        In the frame of the first view, the points' root mean square distance 1.
    covariance : (P, P) array
        Of the camera's parameters.
    start : Camera
        With the focal length from the fundamental matrices.
    fixed, assumed : tuples of str
        Parameters that were held, and those of them that the motion leaves undetermined.
    used : (N,) bool array
        Which images it rests on.
    pairs : tuple of Pair
    iterations : int
    converged : bool
    """

    bundle: Bundle
    covariance: Array
    start: Camera
    fixed: tuple[str, ...]
    assumed: tuple[str, ...]
    used: Array
    pairs: tuple[Pair, ...]
    iterations: int
    converged: bool


def estimate(
    tracks: Tracks,
    views: int,
    points: int,
    lens: Lens,
    image_size: tuple[int, int],
    fix: Mapping[str, float | None],
    seed: int = 0,
) -> SelfCalibration:
    """Estimate the camera from tracks.

    Raises
    ------
    DataError
        Fewer than two views that share sixteen points.
    EstimationError
        A critical motion.
    """
    known = pairs(tracks, views, seed)
    if views < LEAST_VIEWS or not known:
        raise DataError(
            f"no two of {views} views share 16 points or more.",
            "Give tracks of more points over several views.",
        )
    fix = {"aspect": None, **fix} if "fy" not in fix else dict(fix)
    focal = fix.get("fx") or _focal(known, image_size)
    pinhole = _pinhole(focal, image_size)
    bundle = _put_together(known, pinhole, tracks, views, points, "fx" in fix)
    return _calibrated(bundle, tracks, lens, pinhole, fix, known)


def _pinhole(focal: float, size: tuple[int, int]) -> Camera:
    lens = make("pinhole")
    return Camera(lens, lens.pinhole(focal, focal, (size[0] - 1) / 2, (size[1] - 1) / 2), size)


def _focal(known: list[Pair], size: tuple[int, int]) -> float:
    """The focal length that the fundamental matrices agree on, px."""
    centre, width = np.array([(size[0] - 1) / 2, (size[1] - 1) / 2]), float(max(size))
    matrices = np.stack([p.matrix for p in known])
    apart = max(epipolar.axes_apart(m, centre) for m in matrices)
    if len(known) == 1 and apart <= CENTRE * width:
        raise _critical(
            "the optical axes of the two views meet, or nearly so: the principal points miss the epipolar lines of "
            f"one another by {apart:.1f} px, and they are known to {CENTRE * width:.0f} px"
        )
    costs = epipolar.focal_costs(matrices, centre, width)
    # the logarithm lets the pairs that are sharp at one focal length decide, and wrong ones count little
    return float(epipolar.FOCAL[int(np.log(costs + SHARP).mean(0).argmin())] * width)


def _critical(what: str) -> EstimationError:
    return EstimationError(
        f"the motion is critical for the focal length: {what}.",
        "Take more views from other directions, with the camera also rolled and not all looking at one point; or give "
        "the focal length (--fix fx=VALUE).",
    )


def _put_together(
    known: list[Pair], camera: Camera, tracks: Tracks, views: int, points: int, held: bool
) -> Bundle:
    begin = first_pair(known, camera, tracks, empty(camera, views, points))
    if begin is None:
        raise _critical("the views differ by a rotation alone, or their rays meet at less than a degree")
    free = free_matrix(camera.lens, camera.params, {"cx": None, "cy": None, "aspect": None})
    none = free[:, :0]
    bundle = grow(with_points(begin[1], tracks), tracks, none)
    return bundle if held else grow(bundle, tracks, free)


def _calibrated(
    bundle: Bundle,
    tracks: Tracks,
    lens: Lens,
    start: Camera,
    fix: Mapping[str, float | None],
    known: list[Pair],
) -> SelfCalibration:
    """Joint adjustment: the focal length first, then the lens, then the principal point if it is determined."""
    size = start.image_size
    assert size is not None
    held = {**dict.fromkeys(lens.default_fixed), **fix}
    camera = _of_lens(lens, bundle.camera, held)
    bundle = replace(bundle, camera=camera)
    centre = {n: None for n in ("cx", "cy") if n not in held}
    bundle, _, _ = _adjusted(bundle, tracks, {**held, **centre})
    found = _result(bundle, tracks, {**held, **centre}, start, known)
    _require_focal(found)
    if centre:
        freed = _result(found.bundle, tracks, held, start, known)
        sigmas = np.sqrt(np.diagonal(freed.covariance))
        known_centre = all(sigmas[lens.index(n)] <= CENTRE * max(size) for n in centre)
        if known_centre and sigmas[0] <= UNCERTAIN * freed.bundle.camera.params[0]:
            return freed
        return replace(found, assumed=tuple(centre))
    return found


def _of_lens(lens: Lens, pinhole: Camera, fix: Mapping[str, float | None]) -> Camera:
    """The camera of a lens model nearest to a pinhole camera."""
    size = pinhole.image_size
    assert size is not None
    if lens.neutral_curve == "perspective" and not lens.shaped_by_data:
        return Camera(lens, apply_fixed(lens, lens.from_matrix(pinhole.matrix), dict(fix)), size)
    u, v = np.meshgrid(np.linspace(0, size[0] - 1, 31), np.linspace(0, size[1] - 1, 23))
    uv = np.c_[u.ravel(), v.ravel()]
    params = regress(lens, pinhole.unproject(uv), uv, size).params
    return Camera(lens, apply_fixed(lens, params, dict(fix)), size)


def _adjusted(
    bundle: Bundle, tracks: Tracks, fix: Mapping[str, float | None], rows: Array | None = None
) -> tuple[Bundle, Array, int]:
    """Alternate between adjusting and removing images until the choice is stable; return the used rows and the
    iterations.
    """
    free = free_matrix(bundle.camera.lens, bundle.camera.params, dict(fix))
    used = usable(bundle, tracks, _bound(bundle, tracks)) if rows is None else rows
    total = 0
    for _ in range(ROUNDS):
        fitted = adjust(bundle, tracks.take(used), free)
        if fitted is None:
            break
        bundle, total = with_points(fitted.state, tracks), total + fitted.iterations
        again = usable(bundle, tracks, _bound(bundle, tracks.take(used)))
        if np.array_equal(again, used):
            break
        used = again
    return bundle, used, total


def _bound(bundle: Bundle, tracks: Tracks) -> float:
    off = np.linalg.norm(bundle.residuals(tracks), axis=1)
    # the median of |r| for two coordinates of noise s is 1.177 s
    return max(FAR * float(np.nanmedian(off)) / 1.177, LEAST_FAR)


def _result(
    bundle: Bundle, tracks: Tracks, fix: Mapping[str, float | None], start: Camera, known: list[Pair]
) -> SelfCalibration:
    bundle, rows, iterations = _adjusted(bundle, tracks, fix)
    lens = bundle.camera.lens
    free = free_matrix(lens, bundle.camera.params, dict(fix))
    part = tracks.take(rows)
    fitted = adjust(bundle, part, free)
    if fitted is None:
        raise EstimationError("a point left the domain of the lens.", "Try another model (-m).")
    covariance = camera_covariance(fitted, part, free)
    used = np.zeros(len(tracks), bool)
    used[rows] = True
    fixed = tuple(n for n, row in zip(lens.names, free, strict=True) if not row.any())
    return SelfCalibration(
        aligned(fitted.state),
        covariance,
        start,
        fixed,
        (),
        used,
        tuple(known),
        iterations + fitted.iterations,
        fitted.converged,
    )


def _require_focal(found: SelfCalibration) -> None:
    if "fx" in found.fixed:
        return
    sigma, f = float(np.sqrt(found.covariance[0, 0])), float(found.bundle.camera.params[0])
    if not sigma <= UNCERTAIN * f:
        raise _critical(f"its standard deviation is {sigma / f:.0%} of it, {UNCERTAIN:.0%} is the most")
