"""Calibration of several cameras with a wand: a bar of known length moved through the volume they see.

P. Theriault et al., A protocol and calibration method for accurate multi-camera field videography, Journal of
Experimental Biology 217 (2014), describes the practice of motion laboratories (easyWand). Here the bar's
length is exact: a bar has five unknowns at every instant (`wand_fit`), instead of six and an equation for its
length.

1. Relative poses of pairs of cameras, and the focal length if it is unknown (`wand_start`).
2. Joint least squares in px with a robust loss; then without outliers, freeing the lenses and finally the principal
   points.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from camcal.errors import DataError, EstimationError
from camcal.geometry import rotations
from camcal.least_squares.blocks import Fitted, bounded_inverse
from camcal.model.camera import Camera
from camcal.model.pose import Array
from camcal.records import dataclass
from camcal.routes import assumed_centre
from camcal.routes.bundle_outliers import LEAST_FAR, ROUNDS, reach
from camcal.routes.misfit import LARGE, misfit
from camcal.routes.reconstruct import loose_scale
from camcal.routes.selfcalib import UNCERTAIN
from camcal.routes.wand_fit import Sightings, Wand, adjust
from camcal.routes.wand_start import LEAST_BARS, chained, focal_part, links, placed, with_bars, with_focal
from camcal.solve.losses import RAYLEIGH_MEDIAN
from camcal.solve.parameters import apply_fixed, free_matrix

#: fraction of the picture's width; images farther than this from their bar are excluded from the first adjustment
ROUGH = 0.05
#: fraction of the noise variance that remains in the residuals of two cameras: 3 of the 8 coordinates of a bar
KEPT = 3 / 8
#: images for each camera: twelve coordinates, twice as many as its pose has numbers
LEAST_IMAGES = 6

Held = Mapping[str, float | None]


@dataclass(frozen=True)
class WandCalibration:
    """The result of a wand calibration.

    Attributes
    ----------
    wand : Wand
        In the frame of the first camera, in the unit of the bar.
    start : tuple of Camera
    frees : tuple of (P, F) arrays
        d parameters / d free parameters of each camera.
    covariance : (S, S) array
        Of the free parameters of all cameras, then the poses (rotation on the left, rad, translation) of all but the
        first.
    assumed : tuple of str
        `camera.parameter` that were held because the bar leaves them undetermined.
    used : (N,) bool array
        Mask of the images used.
    iterations : int
    converged : bool
    """

    wand: Wand
    start: tuple[Camera, ...]
    frees: tuple[Array, ...]
    covariance: Array
    assumed: tuple[str, ...]
    used: Array
    iterations: int
    converged: bool

    def camera_covariance(self, index: int) -> Array:
        """The covariance (P, P) of a camera's parameters."""
        begins = np.cumsum([0, *(f.shape[1] for f in self.frees)])
        own = slice(begins[index], begins[index + 1])
        return np.asarray(self.frees[index] @ self.covariance[own, own] @ self.frees[index].T)

    def with_bar_sigma(self, relative: float) -> WandCalibration:
        """The same with the bar's relative standard deviation in the covariance: all translations scale with it."""
        scaled = np.zeros(len(self.covariance))
        begin = sum(f.shape[1] for f in self.frees)
        for index, pose in enumerate(self.wand.poses[1:]):
            at = begin + 6 * index + 3
            scaled[at : at + 3] = pose.translation * relative
        return replace(self, covariance=self.covariance + np.outer(scaled, scaled))

    def baseline(self, first: int, second: int) -> tuple[float, float]:
        """The distance of two cameras and its standard deviation.

        The centre -Rᵀ t moves by -Rᵀ dt; a rotation exp(δ) on the left adds -Rᵀ [t] δ to first order.
        """
        centres, moves = [], []
        size = len(self.covariance)
        begin = sum(f.shape[1] for f in self.frees)
        for index in (first, second):
            pose = self.wand.poses[index]
            move = np.zeros((3, size))
            if index:
                at = begin + 6 * (index - 1)
                move[:, at : at + 3] = -pose.rotation.T @ rotations.skew(pose.translation)
                move[:, at + 3 : at + 6] = -pose.rotation.T
            centres.append(pose.centre)
            moves.append(move)
        apart = centres[1] - centres[0]
        length = float(np.linalg.norm(apart))
        slope = (moves[1] - moves[0]).T @ apart / max(length, 1e-300)
        return length, float(np.sqrt(max(slope @ self.covariance @ slope, 0.0)))


def estimate(
    seen: Sightings,
    cameras: Sequence[Camera],
    known: Sequence[bool],
    fix: Held,
    names: Sequence[str],
    seed: int = 0,
) -> WandCalibration:
    """Estimate the cameras of a rig and their relative poses.

    Parameters
    ----------
    cameras : sequence of Camera
        Known cameras, which are held, and unknown ones, given by their lens with the principal point in the middle.
    known : sequence of bool
    fix : mapping
        Further held parameters of the unknown ones.

    Raises
    ------
    DataError
        If no two cameras see enough markers together.
    EstimationError
        If cameras cannot be placed, the bar leaves a focal length undetermined, or the tracks do not fit.
    """
    unknown = [not k and "fx" not in fix for k in known]
    found = links(seen, cameras, seed)
    if not found:
        raise DataError(
            "no two cameras see 16 markers at the same instants.",
            "Give the tracks of a bar that two or more cameras see at the same time.",
        )
    begun = tuple(cameras)
    if any(unknown):
        begun = with_focal(cameras, unknown, focal_part(found, seen, cameras, unknown))
    made = [p for p in (placed(link, begun, seen) for link in found) if p is not None]
    poses = chained(made, len(cameras), names)
    instants = int(seen.instant.max()) + 1
    wand = with_bars(begun, poses, seen, instants)
    if wand.known.sum() < LEAST_BARS:
        raise DataError(
            f"{int(wand.known.sum())} instants show the whole bar to two cameras; {LEAST_BARS} are needed.",
            "Move the bar through the volume for a longer time.",
        )
    fixes = [dict(fix) if not k else None for k in known]
    calibrated = _calibrated(wand, begun, seen, fixes, names)
    _require_fit(calibrated, seen)
    return _with_centre(calibrated, seen, names)


def _calibrated(
    wand: Wand, start: tuple[Camera, ...], seen: Sightings, fixes: Sequence[Held | None], names: Sequence[str]
) -> WandCalibration:
    """Joint adjustment: the focal lengths, then the lenses, then the principal points that are determined."""
    lenses = [_held(c, f, centre=False) for c, f in zip(start, fixes, strict=True)]
    only_focal = [
        h if f is None else {**h, **{p.name: None for p in c.lens.parameters if p.group == "distortion"}}
        for c, f, h in zip(start, fixes, lenses, strict=True)
    ]
    wand = _settled(wand, seen, only_focal)
    found = _result(wand, start, seen, lenses, names)
    _require_focal(found, names)
    whole = [_held(c, f, centre=True) for c, f in zip(start, fixes, strict=True)]
    if whole == lenses:
        return found
    try:
        freed = _result(found.wand, start, seen, whole, names)
    except EstimationError:
        freed = None
    loose = _loose(freed, fixes, names)
    if freed is None or (loose and all(f is None or n in loose for n, f in zip(names, fixes, strict=True))):
        return replace(found, assumed=_assumed(names, lenses, whole))
    if not loose:
        return freed
    mixed = [own if n in loose else w for n, own, w in zip(names, lenses, whole, strict=True)]
    return replace(_result(found.wand, start, seen, mixed, names), assumed=_assumed(names, mixed, whole))


def _with_centre(found: WandCalibration, seen: Sightings, names: Sequence[str]) -> WandCalibration:
    """The covariance including the uncertainty of assumed principal points."""
    covariance, part = found.covariance.copy(), seen.take(found.used)
    for assumed in found.assumed:
        owner, name = assumed.rsplit(".", 1)
        index, cameras = names.index(owner), list(found.wand.cameras)
        cameras[index] = assumed_centre.moved(cameras[index], name)
        fitted = adjust(replace(found.wand, cameras=tuple(cameras)), part, found.frees)
        if fitted is not None:
            slope = _change(found, fitted.state) / assumed_centre.LINEAR
            covariance += np.outer(slope, slope)
    return replace(found, covariance=covariance)


def _change(found: WandCalibration, other: Wand) -> Array:
    """The change (S,) of the quantities of the covariance from the result to another fit."""
    wand = found.wand
    cameras = [
        np.linalg.pinv(f) @ (b.params - a.params)
        for f, a, b in zip(found.frees, wand.cameras, other.cameras, strict=True)
    ]
    poses = [a.step_to(b) for a, b in zip(wand.poses[1:], other.poses[1:], strict=True)]
    return np.concatenate([*cameras, *poses])


def _held(camera: Camera, fix: Held | None, centre: bool) -> dict[str, float | None]:
    """The held parameters of a camera: all of a known one; fy = fx unless it is given; the principal point at
    first.
    """
    if fix is None:
        return dict.fromkeys(camera.lens.names)
    more: dict[str, float | None] = dict.fromkeys(camera.lens.default_fixed)
    if "fy" not in fix:
        more["aspect"] = None
    if not centre:
        more |= {"cx": None, "cy": None}
    return {**more, **fix}


def _assumed(names: Sequence[str], held: Sequence[Held], wanted: Sequence[Held]) -> tuple[str, ...]:
    return tuple(
        f"{n}.{p}"
        for n, h, w in zip(names, held, wanted, strict=True)
        for p in ("cx", "cy")
        if p in h and p not in w
    )


def _loose(freed: WandCalibration | None, fixes: Sequence[Held | None], names: Sequence[str]) -> list[str]:
    """The cameras whose principal point or focal length is undetermined when both are free."""
    if freed is None:
        return list(names)
    found = []
    for index, (camera, fix) in enumerate(zip(freed.wand.cameras, fixes, strict=True)):
        sigma = np.sqrt(np.diagonal(freed.camera_covariance(index)))
        far = assumed_centre.undetermined(camera, sigma, assumed_centre.PIXELS)
        known = not far and sigma[0] <= UNCERTAIN * camera.params[0]
        if fix is not None and not known:
            found.append(names[index])
    return found


def _frees(cameras: Sequence[Camera], held: Sequence[Held]) -> tuple[Array, ...]:
    return tuple(free_matrix(c.lens, c.params, dict(h)) for c, h in zip(cameras, held, strict=True))


def _settled(wand: Wand, seen: Sightings, held: Sequence[Held]) -> Wand:
    """A first robust adjustment."""
    frees = _frees(wand.cameras, held)
    for _ in range(ROUNDS):
        off = np.linalg.norm(wand.residuals(seen), axis=1)
        bound = ROUGH * max(max(c.image_size or (1, 1)) for c in wand.cameras)
        rows = _usable(seen, off, bound)
        if len(rows) < LEAST_IMAGES * len(wand.cameras):
            break
        scale = loose_scale(off[rows])
        fitted = adjust(wand, seen.take(rows), frees, scale, 20)
        if fitted is None:
            break
        wand = _placed_again(fitted.state, seen, rows)
        if fitted.converged:
            break
    return wand


def _usable(seen: Sightings, off: Array, bound: float) -> Array:
    """The rows (M,) of images within a bound, px, of markers that two cameras see, of bars with two such markers.

    A marker seen by one camera only fits any image: the bar's length places the marker on its ray.
    """
    good = off <= bound
    key = seen.instant * len(seen.places) + seen.marker
    images = np.bincount(key[good], minlength=int(key.max(initial=0)) + 1)
    good &= images[key] >= 2
    whole = np.unique(key[good]) // len(seen.places)
    markers = np.bincount(whole, minlength=int(seen.instant.max(initial=0)) + 1)
    return np.flatnonzero(good & (markers[seen.instant] >= 2))


def _placed_again(wand: Wand, seen: Sightings, rows: Array) -> Wand:
    """Re-estimate the bars of unused instants with the current cameras."""
    lost = np.bincount(seen.instant[rows], minlength=len(wand.points)) == 0
    fresh = with_bars(wand.cameras, wand.poses, seen, len(wand.points))
    lost &= fresh.known
    points, directions = wand.points.copy(), wand.directions.copy()
    points[lost], directions[lost] = fresh.points[lost], fresh.directions[lost]
    return replace(wand, points=points, directions=directions)


def _result(
    wand: Wand, start: tuple[Camera, ...], seen: Sightings, held: Sequence[Held], names: Sequence[str]
) -> WandCalibration:
    """Alternate between adjusting and removing images until the choice is stable."""
    cameras = tuple(
        replace(c, params=apply_fixed(c.lens, c.params, dict(h)))
        for c, h in zip(wand.cameras, held, strict=True)
    )
    wand, frees = replace(wand, cameras=cameras), _frees(cameras, held)
    total, rows, fitted = 0, np.zeros(0, int), None
    for _ in range(ROUNDS + 1):
        off = np.linalg.norm(wand.residuals(seen), axis=1)
        if fitted is None:
            sigma, left = float(np.nanmedian(off)) / RAYLEIGH_MEDIAN / np.sqrt(KEPT), np.inf
        else:
            left = _freedom(fitted, len(rows))
            sigma = float(np.sqrt(2 * fitted.normal.cost / max(left, 1)))
        again = _usable(seen, off, max(reach(len(seen), sigma, max(left, 1)), LEAST_FAR))
        if fitted is not None and np.array_equal(again, rows):
            break
        rows = again
        now = adjust(wand, seen.take(rows), frees)
        if now is None:
            raise EstimationError("a marker left the domain of the lens.", "Try another model (-m).")
        fitted, total = now, total + now.iterations
        wand = _placed_again(now.state, seen, rows)
    assert fitted is not None
    used = np.zeros(len(seen), bool)
    used[rows] = True
    covariance = _covariance(fitted, seen.take(rows), names)
    return WandCalibration(wand, start, frees, covariance, (), used, total, fitted.converged)


def _freedom(fitted: Fitted[Wand], images: int) -> int:
    return 2 * images - len(fitted.normal.gradient) - 5 * len(fitted.normal.blocks)


def _covariance(fitted: Fitted[Wand], seen: Sightings, names: Sequence[str]) -> Array:
    """(S, S), scaled by the residuals."""
    reduced, freedom = fitted.normal.reduced(), _freedom(fitted, len(seen))
    if freedom < 1:
        raise EstimationError(
            f"{len(seen)} images of {len(fitted.normal.blocks)} bars are too few for {len(reduced)} "
            f"unknowns for {len(names)} cameras.",
            "Move the bar through the volume for a longer time.",
        )
    return np.asarray(bounded_inverse(reduced) * (2 * fitted.normal.cost / freedom))


def _require_fit(found: WandCalibration, seen: Sightings) -> None:
    part = seen.take(found.used)
    share = misfit(found.wand.residuals(part), part.uv, part.camera)
    if not share <= LARGE:
        raise EstimationError(
            f"the tracks are not those of a bar: the residuals are {share:.0%} of the spread of the "
            f"image points; detection noise explains at most {LARGE:.0%}.",
            "Check that a view is the same instant in all cameras, which camera is which, and the image "
            "size of the known cameras.",
        )


def _require_focal(found: WandCalibration, names: Sequence[str]) -> None:
    for index, (name, camera, free) in enumerate(zip(names, found.wand.cameras, found.frees, strict=True)):
        if not free[0].any():
            continue
        sigma, f = float(np.sqrt(found.camera_covariance(index)[0, 0])), float(camera.params[0])
        if not sigma <= UNCERTAIN * f:
            raise EstimationError(
                f"the bar leaves the focal length of camera '{name}' undetermined: its standard deviation is "
                f"{sigma / f:.0%} of it; at most {UNCERTAIN:.0%} is accepted.",
                "Move the bar in depth and in all directions, through the whole picture; or give the camera "
                "(--cameras NAME=CAMERA).",
            )
