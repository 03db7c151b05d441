"""Explanations of rejected points and views, in words.

Points that were taken for others are named by `exchanged_points.py`. A rejected view whose points fit a plane of other
proportions shows another board; one that fits the mirrored points holds them in mirrored order; one that fits
as its own mirror image is of a picture that was mirrored.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from camcal.assess import exchanged_points, figures
from camcal.assess.causes import LEAST_VIEWS, Found
from camcal.assess.checks import fit, mirror
from camcal.assess.checks.facts import Facts
from camcal.assess.warning import CalibrationWarning, Severity
from camcal.data.observations import Observations, SkippedView, View
from camcal.data.shape import shapes
from camcal.geometry import homography, projective
from camcal.geometry.numbers import median
from camcal.least_squares.distributions import f_exceeded
from camcal.model.camera import Camera
from camcal.model.pose import Pose
from camcal.records import dataclass
from camcal.solve import ransac
from camcal.solve.calibration import Calibration
from camcal.solve.losses import RAYLEIGH_MEDIAN
from camcal.solve.outliers import LEAST_LEFT
from camcal.start.shape import LEAST_PLANAR

#: a plane of other proportions explains a view where it leaves no more than this many times the usual scatter
EXPLAINED = 4.0
#: a used view is suspected where its median residual exceeds that of the median view by this factor, and
#: another board is the reason where it explains as much
SUSPECT = 1.5
#: points whose residuals (median, at the best pose) exceed this part of the spacing are not those of the board
FAR_OFF = 0.5
#: proportions differ from those of the board if by more than this
SAME_PROPORTION = 0.003
#: a used view of proportions that are off by more than this is left out: prints stay below .002, and a real view
#: that was skewed (in motion, by a bent board) had .009
OTHER_PROPORTION = 0.02
#: ... and where a plane of the board's proportions would look like it with a probability below this
BY_CHANCE = 1e-6
#: numbers of a pose, and of a plane of any proportions and angle before a known camera
_POSE, _PLANE = 6, 8
#: cosine of the angle between a plane and that of x and y up to which they are one, as for boards
ALONG_Z = 0.999
#: degrees; the angle between the sides of a board, and how far a measured one may be off: a shear that moves the
#: points as far as `SAME_PROPORTION` is .17 degrees, and that is nearly doubled
RIGHT_ANGLE, SAME_ANGLE = 90.0, 0.3


_HINTS = {
    "rejected-view": "Check the picture: it must be sharp and show the same board, with its points in the same order.",
    "other-board": "Remove the picture, or give the correct size of that board.",
    "mirrored-views": "Its points are in mirrored order (or the picture is): correct or remove that view.",
    "rejected-mirror-image": "The picture seems to be mirrored: mirror it back, or remove it.",
    "mismatched-points": "They were not used; correct their order to use them.",
}


def foreign_views(solution: Calibration) -> set[int]:
    """Views that fit a pose well enough to be used but bias the camera: mirror images, or views of another board.

    None where too few views would be left.
    """
    facts = Facts(solution)
    if facts.blameless:
        return set()
    bad = {int(i) for i in mirror.mirrored_views(facts)}
    bad |= {s.index for s in _suspects(solution) if abs(s.ratio - 1) > OTHER_PROPORTION}
    return bad if len(solution.poses) - len(bad) >= LEAST_LEFT else set()


def named(
    solution: Calibration, given: Observations, robust: bool = True, found: Found | None = None
) -> tuple[Observations, tuple[CalibrationWarning, ...]]:
    """Warnings that explain each rejected view, and points mistaken for others.

    The observations come with residuals and reasons of the rejected views.

    Parameters
    ----------
    solution : Calibration
    given : Observations
        All views, those included that the solution rejected.
    robust : bool
        Whether outliers were treated: where they were not, they bend the camera, and with it what planes
        measure, and used views are not suspected.
    found : Found, optional
        What all views have in common: where that explains them, single views are not rejected.
    """
    facts = Facts(solution, found=found)
    data, views = solution.observations, {v.id: v for v in given.views}
    usual = _usual_scatter(solution)
    skipped: list[SkippedView] = []
    said: list[tuple[str, str, Severity]] = []
    # otherwise a view that fits badly is no evidence on its board
    follows = not facts.blameless and not any(fit.systematic(facts))
    for entry in data.skipped:
        view = views.get(entry.id)
        if entry.status != "rejected" or view is None or not len(view):
            skipped.append(entry)
            continue
        pose, rms = _best_pose(view, solution.camera, usual)
        code, what = _kind(view, solution.camera, pose, usual) if follows else ("rejected-view", "")
        if follows and rms is not None and _is_mirrored(view, solution.camera, rms, usual):
            code, what = "rejected-mirror-image", "it fits as a mirror image"
        reason = f"{entry.reason}; {what}" if what else entry.reason
        skipped.append(replace(entry, reason=reason, points=len(view), rms_point=rms))
        said.append((code, f"view '{entry.id}' was not used: {reason}.", "note"))
    if robust and not facts.blameless:
        said += [("other-board", s.words(data.views[s.index].id), "doubtful") for s in _suspects(solution)]
    used = {v.id: v for v in data.views}
    said += [
        ("mismatched-points", exchanged_points.describe(m, used[m.view]) + ".", "note")
        for m in exchanged_points.exchanged_points(solution)
    ]
    warnings = (CalibrationWarning(code, text, _HINTS[code], severity) for code, text, severity in said)
    return replace(data, skipped=tuple(skipped)), tuple(warnings)


@dataclass(frozen=True)
class _Suspect:
    """A used view that fits better as another board: sigma of a coordinate as that board and as the given one, px."""

    index: int
    ratio: float
    other: float
    own: float

    def words(self, name: str) -> str:
        return (
            f"view '{name}' fits better as another board, {self.ratio:.4g} times as long in y relative to x: "
            f"{self.other:.3g} px instead of {self.own:.3g} px (sigma of a coordinate)."
        )


def _suspects(solution: Calibration) -> list[_Suspect]:
    """Used views for which a plane of other proportions fits much better than the board.

    None where the model does not follow the lens: its errors look like other proportions.
    """
    data = solution.observations
    if any(fit.systematic(Facts(solution))):
        return []
    counts = data.per_block(data.used).astype(int)
    # of each coordinate, by what is left after a pose of six numbers
    own = figures.rms_of_views(solution) * np.sqrt(counts / np.maximum(2 * counts - _POSE, 1))
    used = data.split(data.used)
    found = []
    for i in np.flatnonzero(own > SUSPECT * median(own)):
        view, freedom = data.views[i].take(used[i]), 2 * int(counts[i]) - _PLANE
        if len(data.views) < LEAST_VIEWS or freedom <= 0 or not shapes([view]).planar[0]:
            continue
        measured = proportions(view, solution.camera, every=True)
        if measured is None or abs(measured.ratio - 1) <= SAME_PROPORTION:
            continue
        other = measured.rms * np.sqrt(counts[i] / freedom)
        more = (own[i] / other) ** 2 * (freedom + _PLANE - _POSE) - freedom
        by_chance = f_exceeded(max(more / (_PLANE - _POSE), 0.0), _PLANE - _POSE, freedom)
        if other < own[i] / SUSPECT and by_chance < BY_CHANCE:
            found.append(_Suspect(int(i), measured.ratio, float(other), float(own[i])))
    most = max((s.own / s.other for s in found), default=0.0)
    # one such view also bends the camera away from the others
    return [s for s in found if s.own / s.other > most / 2]


def _usual_scatter(solution: Calibration) -> float:
    """The median length of the residuals of the used points, px."""
    lengths = np.linalg.norm(solution.used_residuals, axis=1)
    return median(lengths)


def _best_pose(view: View, camera: Camera, usual: float) -> tuple[Pose | None, float | None]:
    """The pose with which most points agree, as in the other views, and the rms_point of all points there."""
    unit = 1.0 if view.sigma is None else float(np.median(view.sigma))
    agreed = ransac.of_poses([view], camera, sigma=usual / RAYLEIGH_MEDIAN / unit)[0]
    if agreed.matrix is None:
        return None, None
    pose = Pose(agreed.matrix[:, :3], agreed.matrix[:, 3])
    residual = camera.project(pose.apply(view.xyz)) - view.uv
    return pose, figures.rms_point(residual[np.isfinite(residual).all(1)])


def _is_mirrored(view: View, camera: Camera, rms: float, usual: float) -> bool:
    """Return whether a view of a plane, with this rms_point, fits much better as its own mirror image."""
    if camera.image_size is None or not shapes([view]).planar[0]:
        return False
    _, other = _best_pose(mirror.mirrored(view, camera.image_size[0]), camera, usual)
    return other is not None and other <= EXPLAINED * usual and other**2 * mirror.SQUARES < rms**2


def _kind(view: View, camera: Camera, pose: Pose | None, usual: float) -> tuple[str, str]:
    """The code and description of a rejected view."""
    if shapes([view]).planar[0]:
        found = proportions(view, camera)
        if found is not None and found.median <= EXPLAINED * usual:
            ratio, angle = found.ratio, found.angle
            if abs(ratio - 1) > SAME_PROPORTION or abs(angle - RIGHT_ANGLE) > SAME_ANGLE:
                return "other-board", (
                    f"its points are those of another board, {ratio:.4g} times as long in y relative to x"
                    + (f", its sides at {angle:.1f} degrees" if abs(angle - RIGHT_ANGLE) > SAME_ANGLE else "")
                )
    else:
        _, mirrored = _best_pose(replace(view, xyz=view.xyz * [1.0, 1.0, -1.0]), camera, usual)
        if mirrored is not None and mirrored <= 2 * EXPLAINED * usual:
            return "mirrored-views", "it fits only with one axis negated: its frame is mirrored"
    if pose is not None:
        residual = camera.project(pose.apply(view.xyz)) - view.uv
        lengths = np.linalg.norm(residual, axis=1)
        wrong = np.flatnonzero(lengths > 2 * EXPLAINED * usual)
        taken = exchanged_points.in_view(view, view.uv + residual, wrong)
        if taken.swapped or taken.shifted:
            return "mismatched-points", exchanged_points.describe(taken, view).split(": ", 1)[1]
        # a point that does not project is infinitely far off
        if np.median(np.nan_to_num(lengths, nan=np.inf)) > FAR_OFF * exchanged_points.spacing(view.uv):
            return "other-board", "no pose fits its points: another board, or points out of order"
    return "rejected-view", ""


@dataclass(frozen=True)
class Proportions:
    """The measured extent of a plane seen by a known camera, relative to the given points of the view.

    Attributes
    ----------
    ratio : float
        How much longer the plane is in y, against x, than the points say.
    angle : float
        Between its x and y, degrees.
    median, rms : float
        Of the residuals' lengths, px.
    """

    ratio: float
    angle: float
    median: float
    rms: float


def proportions(view: View, camera: Camera, every: bool = False) -> Proportions | None:
    """The proportions of a view's plane; None if there are too few points.

    The homography from the points' plane to the rays has columns h1, h2 of one length, at right angles, where
    the points are those of the plane that was seen (Zhang 2000, eqs. 3 and 4).

    Parameters
    ----------
    view : View
    camera : Camera
    every : bool
        Whether all points count, instead of those that agree.
    """
    rays = camera.unproject(view.uv)
    with np.errstate(invalid="ignore"):
        ahead = rays[:, 2] > projective.FLAT_RAY
    kept = view.take(ahead)
    if len(kept) < LEAST_PLANAR:
        return None
    ab = rays[ahead, :2] / rays[ahead, 2:]
    origin, axes, _ = projective.fit_plane(kept.xyz)
    # along the axes of the data where the plane is that of x and y, as for boards
    across = np.eye(3) if abs(axes[2, 2]) > ALONG_Z else axes
    points = (kept.xyz - origin) @ across[:, :2]
    if every:
        matrix: np.ndarray | None = homography.homographies(points[None], ab[None], np.ones((1, len(ab))))[0]
    else:
        matrix = ransac.agreeing(ransac.Map(points, ab, kept.sigma), np.random.default_rng(0)).matrix
    if matrix is None or not np.isfinite(matrix).all():
        return None
    h1, h2 = matrix[:, 0], matrix[:, 1]
    ratio = float(np.linalg.norm(h2) / np.linalg.norm(h1))
    cosine = h1 @ h2 / np.linalg.norm(h1) / np.linalg.norm(h2)
    rays_of = np.c_[points, np.ones(len(points))] @ matrix.T
    error = np.linalg.norm(camera.project(rays_of * np.sign(rays_of[:, 2:])) - kept.uv, axis=1)
    rms = float(np.sqrt(np.nanmean(error**2)))
    return Proportions(ratio, float(np.degrees(np.arccos(cosine))), float(np.nanmedian(error)), rms)
