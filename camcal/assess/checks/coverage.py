"""Coverage of the image by the points."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from camcal.assess.checks.facts import Facts
from camcal.assess.warning import CalibrationWarning
from camcal.geometry import hull
from camcal.geometry.picture import in_picture

Array = np.ndarray

#: Share of the image inside the convex hull of all points below which distortion at its border is
#: extrapolated over more than the covered part: at .12 the points reach less than half the way to the
#: corners.
LEAST_AREA = 0.12
#: Points may lie this far outside, px: sub-pixel corners at the very border.
MARGIN_PX = 1.0

#: Ratio of the principal point's coordinates to those of the picture's centre, in both directions, with all points
#: within twice its coordinates: principal points lie within a tenth of the centre, and in a picture of half the size at
#: half of it.
OFF_CENTRE = 0.75
#: largest difference of the two directions: a wrong size keeps the picture's proportions, cropping does not
SAME_RATIO = 0.1

#: below this share of the picture even a lens without distortion is extrapolated over most of it
SMALL_AREA = 0.05
#: single points outside are detector outliers; a tenth of all points shows that the size or the axes are
#: wrong
MANY_OUTSIDE = 0.1


def poor(facts: Facts) -> Iterator[CalibrationWarning]:
    """Points in only a small part of the image."""
    if facts.image_size is None:
        return
    share = hull.area(facts.image_points) / float(np.prod(facts.image_size))
    if share < LEAST_AREA:
        yield CalibrationWarning(
            "poor-coverage",
            f"the points cover only {share:.0%} of the image; elsewhere the lens model is extrapolated.",
            "Bring the target close and into every corner of the picture.",
            "note" if share > SMALL_AREA else "doubtful",
        )


def outside_image(facts: Facts) -> Iterator[CalibrationWarning]:
    """Points outside the picture: a wrong image size, or u and v exchanged."""
    if facts.image_size is not None:
        yield from outside(facts.image_points, facts.image_size)


def outside(uv: Array, image_size: tuple[int, int]) -> Iterator[CalibrationWarning]:
    """The warning about image points (N, 2) outside the picture."""
    out = int((~in_picture(uv, image_size, -MARGIN_PX)).sum())
    if out:
        width, height = image_size
        u, v = uv.max(0)
        yield CalibrationWarning(
            "points-outside-image",
            f"{out} of {len(uv)} points lie outside the {width}x{height} image (u to {u:.0f}, v to {v:.0f}).",
            "Check --image-size, and that u is the column and v the row.",
            "wrong" if out > MANY_OUTSIDE * len(uv) else "doubtful",
        )


def image_size(facts: Facts) -> Iterator[CalibrationWarning]:
    """A principal point and points that fit a smaller picture."""
    size = facts.image_size
    if size is None or not facts.groups("principal"):
        return
    ratio = (2 * facts.camera.params[2:4] + 1) / size
    # points extend to twice the principal point, where the picture in which they were measured ends
    inside = (facts.image_points < 2 * facts.camera.params[2:4] + 1 + ratio * MARGIN_PX).all(1).mean()
    if (ratio < OFF_CENTRE).all() and abs(ratio[0] - ratio[1]) < SAME_RATIO and inside > 1 - MANY_OUTSIDE:
        u, v = facts.camera.params[2:4].tolist()
        width, height = (round(2 * x + 1) for x in (u, v))
        yield CalibrationWarning(
            "image-size",
            f"the principal point ({u:.0f}, {v:.0f}) and the points fit a picture of about {width}x{height}, "
            f"not of {size[0]}x{size[1]}.",
            "Check --image-size: it must be the size of the pictures in which the points were measured.",
            "doubtful",
        )
