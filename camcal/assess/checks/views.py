"""The views: how many, how different, and from which side."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from camcal.assess.checks import parameters
from camcal.assess.checks.facts import Facts
from camcal.assess.warning import CalibrationWarning, Severity
from camcal.data.shape import sides
from camcal.geometry.neighbours import Neighbours
from camcal.geometry.numbers import distinct
from camcal.model.pose import Array
from camcal.system.text import listed

#: Views whose boards project to the same pixels within this root mean square, px, are one view taken
#: twice.
SAME_PX = 1.0
#: Share of repeated views above which they are reported: a repeated view only makes the sigmas too
#: small.
REPEATED = 0.2
#: If the normals of the boards agree within this angle (rms, degrees), only second-order effects determine the
#: focal length: at 5 degrees its sigma is 1 % with 12 views of .1 px, at 20 degrees .2 %.
PARALLEL_DEGREES = 5.0
#: Estimated parameters per view of a plane; each view determines two of the camera matrix and one of the distortion.
PARAMETERS_PER_VIEW = 3
#: Number of different views from which on the distortion needs no more: three determine a camera without (Zhang 2000,
#: section 3.1). With opencv4, .2 px and random tilts, one focal length in ten is off by 9 % and more with two views, by
#: .9 % with three, by .8 % with four and by .4 % with six (20 runs each).
LEAST_BENT = 4
#: share of views from behind above which the target is assumed to be visible from both sides; of two views, either may
#: be the mirrored one
MINORITY = 1 / 3

#: A plane is that of x and y if the cosine of its normal to z is above this: a bent board's plane is off by .001.
ALONG_Z = 0.99
#: Below this angle, degrees, perspective is second order in what noise and distortion leave: the focal length found is
#: not that of the camera (tilts of 0.6 degrees give 1569 +- .06 for 1000).
NOTHING_DEGREES = 2.0
#: A focal length with this relative standard deviation is usable, however few the views.
SURE_FOCAL = 0.01


def single_view(facts: Facts) -> Iterator[CalibrationWarning]:
    """One view of a plane, which gives only two equations for the camera matrix."""
    if facts.planar and len(facts.views) == 1:
        yield CalibrationWarning(
            "single-view",
            "there is one view, of a plane: it does not determine the focal length and the principal point.",
            "Take 10 or more views, the target tilted by 20 to 45 degrees in different directions.",
        )


def few_views(facts: Facts) -> Iterator[CalibrationWarning]:
    """Few different views of a plane for the number of parameters."""
    if not facts.planar or len(facts.views) < 2:
        return
    views, free = distinct_count(facts), len(facts.free_names)
    bent = bool(facts.groups("distortion"))
    if free > PARAMETERS_PER_VIEW * views or (views < LEAST_BENT and bent):
        yield CalibrationWarning(
            "few-views",
            f"{views} different view{'s' if views > 1 else ''} for {free} parameters of the camera: "
            "some of them are poorly determined.",
            "Take 10 or more views, or choose a model with fewer parameters (--model opencv4).",
            "note" if parameters.focal_sigma(facts) < SURE_FOCAL else "doubtful",
        )


def fronto_parallel(facts: Facts) -> Iterator[CalibrationWarning]:
    """All boards parallel to each other, in particular to the image."""
    if not facts.planar or len(facts.views) < 2:
        return
    tilt, spread = tilts(facts)
    if spread >= PARALLEL_DEGREES:
        return
    if tilt < PARALLEL_DEGREES:
        code = "fronto-parallel-views"
        what = f"the target is nearly parallel to the image in all views ({tilt:.1f} degrees)"
    else:
        code = "parallel-views"
        what = f"the target has the same orientation in all views (within {spread:.1f} degrees)"
    severity: Severity = "wrong" if spread < NOTHING_DEGREES else "doubtful"
    yield CalibrationWarning(
        code,
        f"{what}: focal length and distance can hardly be separated.",
        "Take views with the target tilted by 20 to 45 degrees, in different directions.",
        severity,
    )


def tilts(facts: Facts) -> tuple[float, float]:
    """Tilt of the boards relative to the image plane, and spread of their normals, both rms in degrees."""
    normals = _normals(facts)
    # 1 - the largest eigenvalue of the mean of n nᵀ is the mean squared sine about the common axis
    largest = np.linalg.eigvalsh(normals.T @ normals / len(normals))[-1]
    spread = np.arcsin(np.sqrt(np.clip(1 - largest, 0, 1)))
    return float(np.sqrt(np.mean(tilt_of_views(facts) ** 2))), float(np.degrees(spread))


def tilt_of_views(facts: Facts) -> Array:
    """Angle (V,) between each board's normal and the optical axis, degrees."""
    return np.degrees(np.arccos(np.clip(_normals(facts)[:, 2], -1, 1)))


def _normals(facts: Facts) -> Array:
    """The boards' normals (V, 3) in the camera's frame, pointing away from the camera."""
    normals = np.einsum("vij,vj->vi", facts.solution.poses.rotations, facts.shapes.axes[:, :, 2])
    return np.asarray(normals * np.where(normals[:, 2:] < 0, -1.0, 1.0))


def duplicates(facts: Facts) -> Iterator[CalibrationWarning]:
    """Views that repeat another: they add no information, but reduce every sigma."""
    count, views = distinct_count(facts), len(facts.views)
    if views - count > REPEATED * views:
        yield CalibrationWarning(
            "duplicate-views",
            f"{views} views show only {count} different pose{'s' if count > 1 else ''} of the target.",
            "Move and tilt the target between pictures; remove the repetitions.",
            "doubtful" if views > 2 * count else "note",
        )


def repeated(facts: Facts) -> Iterator[CalibrationWarning]:
    """Single views that repeat another, if they are too few for `duplicates`."""
    pairs = facts.once(_repeats)
    if not len(pairs) or len(facts.views) - distinct_count(facts) > REPEATED * len(facts.views):
        return
    named = listed([f"{facts.views[j].id} ({facts.views[i].id})" for i, j in pairs])
    yield CalibrationWarning(
        "repeated-view",
        f"the target has the same pose as in another view: {named}.",
        "The repetition adds no information but reduces the sigmas; remove it.",
        "note",
    )


def distinct_count(facts: Facts) -> int:
    """Number of views after those with the same image of the same points are counted once."""
    return len(facts.views) - len(distinct(facts.once(_repeats)[:, 1]))


def _repeats(facts: Facts) -> Array:
    """Pairs (K, 2) of views i < j with the same image of the same points."""
    if len(facts.views) < 2:
        return np.zeros((0, 2), int)
    corners = _seen_corners(facts)
    good = np.flatnonzero(np.isfinite(corners).all(1))
    pairs = Neighbours(corners[good]).pairs(SAME_PX * np.sqrt(corners.shape[1] / 2))
    return np.sort(good[pairs.reshape(-1, 2)], axis=1)


def _seen_corners(facts: Facts) -> Array:
    """The pixels of the corners of the bounding box of all points in each pose, (V, 2 K), px."""
    xyz = np.concatenate([v.xyz for v in facts.views])
    low, high = xyz.min(0), xyz.max(0)
    box = distinct(np.array(np.meshgrid(*np.c_[low, high])).reshape(3, -1).T, axis=0)
    poses = facts.solution.poses
    cam = np.einsum("vij,kj->vki", poses.rotations, box) + poses.translations[:, None]
    return facts.camera.project(cam).reshape(len(poses), -1)


def mirrored(facts: Facts) -> Iterator[CalibrationWarning]:
    """Views in which the camera is behind the printed side of a target, or on another side of it than in most views."""
    if not facts.planar:
        return
    data = facts.solution.observations
    behind = data.is_printed and 2 * _from_behind(facts).sum() > len(facts.views)
    if behind:
        yield CalibrationWarning(
            "mirrored-picture",
            "the views show the printed target from behind: v is counted upwards, u and v are exchanged, or the "
            "pictures are mirrored. The principal point and all asymmetric parameters of the lens are those of the "
            "mirror image.",
            "Use v = height - 1 - v, or exchange u and v. If the table's z axis points towards the camera (y upwards), "
            "no correction is needed.",
            "wrong" if "kind" in (data.target or {}) else "doubtful",
        )
        return
    minority = np.flatnonzero(sides(facts.shapes, facts.solution.poses))
    if not len(minority) or len(minority) > MINORITY * len(facts.views):
        return  # a target that is seen from both sides
    names = listed([facts.views[i].id for i in minority])
    yield CalibrationWarning(
        "mirrored-views",
        f"{len(minority)} of {len(facts.views)} views show the target from behind: {names}.",
        "Their points are in mirrored order (or the picture is): correct or remove these views.",
        "doubtful",
    )


def _from_behind(facts: Facts) -> Array:
    """The views (V,) of a target in the plane z = 0 whose camera lies where z > 0, behind what is printed."""
    poses = facts.solution.poses
    centres = -np.einsum("vji,vj->vi", poses.rotations, poses.translations)
    flat = np.abs(facts.shapes.axes[:, 2, 2]) > ALONG_Z
    return np.asarray(flat & (centres[:, 2] > 0))
