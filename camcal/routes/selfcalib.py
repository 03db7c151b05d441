"""Self-calibration from tracks of unknown points: focal length from fundamental matrices, then bundle adjustment.

1. The fundamental matrix of every pair of views with enough matches; for strong distortion the lifted one
   (`lifted`), after which pixels are undistorted.
2. The focal length of the absolute dual quadric of a projective reconstruction of three views or more
   (`dual_quadric`), and that for which all E = Kᵀ F K are closest to essential matrices (Mendonça & Cipolla 1999), with
   the principal point in the middle and square pixels.
3. Incremental reconstruction of the views, then joint adjustment with the focal length and the lens.

What the motion leaves undetermined (a critical motion: Sturm, Critical motion sequences for monocular self-calibration
and uncalibrated Euclidean reconstruction, 1997) appears in the standard deviation of the focal length after the
adjustment; two views whose axes meet are refused before.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from camcal.errors import DataError, EstimationError
from camcal.geometry import homography, projective
from camcal.model.camera import Camera
from camcal.model.lenses import make
from camcal.model.lenses.base import Lens
from camcal.model.lenses.regress import regress
from camcal.model.pose import Array
from camcal.records import dataclass
from camcal.routes import assumed_centre, dual_quadric, epipolar, lifted
from camcal.routes.bundle import Bundle, Tracks, adjust, camera_covariance
from camcal.routes.bundle_outliers import adjusted
from camcal.routes.focal_interval import focal_interval
from camcal.routes.reconstruct import Pair, aligned, empty, first_pair, grow, pairs, usable, with_points
from camcal.solve.parameters import apply_fixed, free_matrix

#: relative standard deviation of the focal length above which a motion is critical
UNCERTAIN = 0.1
#: ... and the part of it to either side that a 95 % interval may reach: 1.96 standard deviations. These are small where
#: f came out too small by chance, the interval is not
WIDEST = 0.2
#: added to 1 - σ2 / σ1 before its logarithm: what noise leaves of it at the right focal length
SHARP = 1e-3
#: least matches of a pair to determine the distortion: with fewer, a further parameter gains as much by chance
LEAST_BENT = 40
#: ratio of the distances of matches from a homography's predictions to those from epipolar lines: 2.5 for noise alone
#: (two coordinates in two pictures compared with one)
PARALLAX = 5.0
#: of log f: two starts closer than this reach the same minimum; 20 % are four steps of the focal lengths of pairs
SAME = 0.2


@dataclass(frozen=True)
class SelfCalibration:
    """The result of the self-calibration.

    Attributes
    ----------
    bundle : Bundle
        In the frame of the first view, scaled to an rms distance of the points of 1.
    covariance : (P, P) array
        Of the camera's parameters.
    start : Camera
        With the focal length from the fundamental matrices.
    fixed, assumed : tuples of str
        Parameters that were held, and those of them that the motion leaves undetermined.
    used : (N,) bool array
        Mask of the images used.
    pairs : tuple of Pair
    iterations : int
    converged : bool
    pixels : (N, 2) array, px
        Pixels to which the fundamental matrices apply: undistorted ones for strong distortion.
    rays : str
        Lens model behind the fundamental matrices: pinhole, division or rational.
    dual_quadric : float or None
        The focal length of the absolute dual quadric, px; None for two views, or if it is not real.
    interval : (float, float) or None
        The 95 % interval of the focal length, px; None if it was given.
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
    pixels: Array
    rays: str = "pinhole"
    dual_quadric: float | None = None
    interval: tuple[float, float] | None = None


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
        If no two views share sixteen points.
    EstimationError
        If the motion is critical.
    """
    known = pairs(tracks, views, seed)
    if not known:
        raise DataError(
            f"no two of {views} views share 16 points or more.",
            "Give tracks of more points over several views.",
        )
    fix = {"aspect": None, **fix} if "fy" not in fix else dict(fix)
    bent, pixels = _bent(known, tracks, lens, image_size, fix, seed), tracks.uv
    if bent is not None:
        flat = lifted.undistorted(bent, tracks.uv, image_size)
        seen = np.isfinite(flat).all(1)
        again = pairs(Tracks(np.where(seen, tracks.view, -1), tracks.point, flat), views, seed)
        if again and not _rotation_alone(again, flat):
            known, pixels = again, flat
        else:
            bent = None
    straight = Tracks(np.where(np.isfinite(pixels).all(1), tracks.view, -1), tracks.point, pixels)
    quadric = dual_quadric.focal(known, straight, image_size)
    given = fix.get("fx")
    focals = [given] if given else _focals(known, image_size, quadric)

    def put_together(focal: float) -> tuple[Camera, Bundle]:
        start = _pinhole(focal, image_size) if bent is None else lifted.as_camera(bent, focal, image_size)
        return start, _put_together(known, start, tracks, views, points, "fx" in fix)

    start, bundle = _best_start(focals, put_together, tracks)
    found = _calibrated(bundle, tracks, lens, start, fix, known)
    kind = "pinhole" if bent is None else bent.kind
    return replace(found, pixels=pixels, rays=kind, dual_quadric=quadric)


def _focals(known: list[Pair], size: tuple[int, int], quadric: float | None) -> list[float]:
    """The focal lengths to start from, px: of the dual quadric, and of the pairs."""
    pairwise = _focal(known, size)
    return [pairwise] if quadric is None else [quadric, pairwise]


def _best_start(
    focals: list[float], put_together: Callable[[float], tuple[Camera, Bundle]], tracks: Tracks
) -> tuple[Camera, Bundle]:
    """The start with the smallest residuals; a focal length equal to an earlier one is tried only if that one fails.

    Raises
    ------
    EstimationError
        That of the first start, if the reconstruction fails from all.
    """
    made: list[tuple[float, tuple[Camera, Bundle]]] = []
    failed: EstimationError | None = None
    for focal in focals:
        if made and np.isfinite(made[0][0]) and abs(np.log(focal / focals[0])) < SAME:
            continue
        try:
            start, bundle = put_together(focal)
        except EstimationError as error:
            failed = failed or error
        else:
            made.append((_misses(bundle, tracks), (start, bundle)))
    if not made:
        assert failed is not None
        raise failed
    return min(made, key=lambda m: m[0])[1]


def _misses(bundle: Bundle, tracks: Tracks) -> float:
    """The median distance of images from their projected points, px, infinite for points without a position."""
    off = np.linalg.norm(bundle.residuals(tracks), axis=1)
    return float(np.median(np.where(np.isfinite(off), off, np.inf)))


def _rotation_alone(known: list[Pair], uv: Array) -> bool:
    """Return whether homographies explain all pairs, so that F and the distortion are arbitrary."""
    for pair in known:
        rows = pair.matches[pair.agree]
        first, second = (uv[rows[:, i]] for i in (0, 1))
        h = homography.homographies(first[None], second[None])
        across = np.linalg.norm(homography.transfer(h, first[None])[0] - second, axis=1)
        a, b = projective.homogeneous(first), projective.homogeneous(second)
        along = np.abs(epipolar.sampson(pair.matrix[None], a, b)[0])
        if np.median(across) > PARALLAX * np.median(along):
            return False
    return True


def _bent(
    known: list[Pair],
    tracks: Tracks,
    lens: Lens,
    size: tuple[int, int],
    fix: Mapping[str, float | None],
    seed: int,
) -> lifted.Rational | None:
    """The rays of a lens whose distortion is too strong to start from a pinhole camera; None if it is not."""
    if all(n in fix or n in lens.default_fixed for n in lens.names[4:]):
        return None
    matches = [(tracks.uv[p.matches[:, 0]], tracks.uv[p.matches[:, 1]]) for p in known]
    matches = [m for m in matches if len(m[0]) >= LEAST_BENT]
    if not matches:
        return None
    found = lifted.of_matches(matches, size, seed)
    return None if found.kind == "pinhole" else found


def _pinhole(focal: float, size: tuple[int, int]) -> Camera:
    lens = make("pinhole")
    return Camera(lens, lens.pinhole(focal, focal, (size[0] - 1) / 2, (size[1] - 1) / 2), size)


def _focal(known: list[Pair], size: tuple[int, int]) -> float:
    """The focal length that the fundamental matrices agree on, px."""
    centre, width = np.array([(size[0] - 1) / 2, (size[1] - 1) / 2]), float(max(size))
    matrices = np.stack([p.matrix for p in known])
    apart = max(epipolar.axes_apart(m, centre) for m in matrices)
    if len(known) == 1 and apart <= assumed_centre.CENTRE * width:
        raise _critical(
            "the optical axes of the two views nearly intersect: the distance of the principal points "
            f"from each other's epipolar lines is {apart:.1f} px, and they are known only to "
            f"{assumed_centre.CENTRE * width:.0f} px"
        )
    costs = epipolar.focal_costs(matrices, centre, width)
    # with the logarithm, pairs with a sharp minimum dominate, and wrong ones have little weight
    return float(epipolar.FOCAL[int(np.log(costs + SHARP).mean(0).argmin())] * width)


def kruppa_focal(found: SelfCalibration) -> float | None:
    """The median of the focal lengths, px, from the pairs' Kruppa equations; None if there is none."""
    size = found.start.image_size
    assert size is not None
    centre, width = np.array([(size[0] - 1) / 2, (size[1] - 1) / 2]), float(max(size))
    each = epipolar.kruppa(np.stack([p.matrix for p in found.pairs]), centre, width)
    each = each[np.isfinite(each)]
    return float(np.median(each)) if len(each) else None


def _critical(what: str) -> EstimationError:
    return EstimationError(
        f"the motion is critical for the focal length: {what}.",
        "Take more views from other directions, some with the camera rolled, and not all aimed at one point; or give "
        "the focal length (--fix fx=VALUE).",
    )


def _put_together(
    known: list[Pair], camera: Camera, tracks: Tracks, views: int, points: int, held: bool
) -> Bundle:
    begin = first_pair(known, camera, tracks, empty(camera, views, points))
    if begin is None:
        raise _critical("the views differ by a rotation alone, or their rays intersect at less than a degree")
    rest = dict.fromkeys(n for n in camera.lens.names[4:] if n != "l1")
    free = free_matrix(camera.lens, camera.params, {"cx": None, "cy": None, "aspect": None, **rest})
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
    if not len(usable(bundle, tracks, np.inf)):
        raise _critical("no four points of two views could be triangulated")
    held = {**dict.fromkeys(lens.default_fixed), **fix}
    camera = _of_lens(lens, bundle.camera, held)
    bundle = replace(bundle, camera=camera)
    centre = {n: None for n in ("cx", "cy") if n not in held}
    bundle, _, _ = adjusted(bundle, tracks, {**held, **centre})
    found = _result(bundle, tracks, {**held, **centre}, start, known)
    _require_focal(found)
    if centre:
        freed = _result(found.bundle, tracks, held, start, known)
        sigmas, camera = np.sqrt(np.diagonal(freed.covariance)), freed.bundle.camera
        loose = assumed_centre.undetermined(camera, sigmas, tuple(centre))
        if not loose and sigmas[0] <= UNCERTAIN * camera.params[0]:
            return _with_interval(freed, tracks, held)
        found = replace(found, assumed=tuple(centre))
    return _with_centre(_with_interval(found, tracks, {**held, **centre}), tracks, {**held, **centre})


def _with_interval(
    found: SelfCalibration, tracks: Tracks, held: Mapping[str, float | None]
) -> SelfCalibration:
    """The 95 % interval of the focal length by the noise."""
    if "fx" in found.fixed:
        return found
    camera = found.bundle.camera
    free = free_matrix(camera.lens, camera.params, dict(held))
    f, sigma = float(camera.params[0]), float(np.sqrt(found.covariance[0, 0]))
    low, high = focal_interval(found.bundle, tracks.take(found.used), free, sigma)
    if not max(f - low, high - f) <= WIDEST * f:
        raise _critical(
            f"its 95 % interval is {low:.4g} to {high:.4g} px, {WIDEST:.0%} to a side is the most"
        )
    return replace(found, interval=(low, high))


def _with_centre(found: SelfCalibration, tracks: Tracks, held: Mapping[str, float | None]) -> SelfCalibration:
    """The covariance including the uncertainty of an assumed principal point."""
    part, camera = tracks.take(found.used), found.bundle.camera
    free = free_matrix(camera.lens, camera.params, dict(held))

    def refitted(moved: Camera, _: str) -> Array | None:
        fitted = adjust(replace(found.bundle, camera=moved), part, free)
        return None if fitted is None else fitted.state.camera.params

    more = assumed_centre.doubt(camera, found.assumed, refitted)
    interval = found.interval
    if interval is not None and more[0, 0] > 0:
        f, wider = float(camera.params[0]), float(np.sqrt(1 + more[0, 0] / found.covariance[0, 0]))
        interval = f + wider * (interval[0] - f), f + wider * (interval[1] - f)
    return replace(found, covariance=found.covariance + more, interval=interval)


def _of_lens(lens: Lens, pinhole: Camera, fix: Mapping[str, float | None]) -> Camera:
    """The camera of a lens model nearest to a pinhole camera."""
    size = pinhole.image_size
    assert size is not None
    plain = len(pinhole.params) == len(make("pinhole").names)
    if plain and lens.neutral_curve == "perspective" and not lens.shaped_by_data:
        return Camera(lens, apply_fixed(lens, lens.from_matrix(pinhole.matrix), dict(fix)), size)
    u, v = np.meshgrid(np.linspace(0, size[0] - 1, 31), np.linspace(0, size[1] - 1, 23))
    uv = np.c_[u.ravel(), v.ravel()]
    rays = pinhole.unproject(uv)
    seen = np.isfinite(rays).all(1)
    params = regress(lens, rays[seen], uv[seen], size).params
    return Camera(lens, apply_fixed(lens, params, dict(fix)), size)


def _result(
    bundle: Bundle, tracks: Tracks, fix: Mapping[str, float | None], start: Camera, known: list[Pair]
) -> SelfCalibration:
    bundle, rows, iterations = adjusted(bundle, tracks, fix)
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
        tracks.uv,
    )


def _require_focal(found: SelfCalibration) -> None:
    if "fx" in found.fixed:
        return
    sigma, f = float(np.sqrt(found.covariance[0, 0])), float(found.bundle.camera.params[0])
    if not sigma <= UNCERTAIN * f:
        raise _critical(
            f"its standard deviation is {sigma / f:.0%} of it; at most {UNCERTAIN:.0%} is accepted"
        )
