"""The quality of a picture for calibration: sharpness, exposure, motion, and the part covered by the board."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import cv2
import numpy as np

from camcal.detect.motion_blur import blur_ellipse, corner_blurs
from camcal.detect.targets.base import Detection

Array = np.ndarray

MOTION_RATIO = (
    1.5  #: ratio of the blurs in two directions above which it is motion: lenses reach 1.2 near the border
)
MOTION_PX = 1.2  #: px; a smaller blur is that of the sensor and the lens, and seldom isotropic
SOFT = 0.2  #: blur as a share of a square's side above which neighbouring edges overlap: 2.5 sigma each
SOFT_PX = 2.5  #: px; blur at which the sigma of a corner is twice that at a blur of 0.6 px
SATURATED = 0.25  #: share of pixels at full scale: half of the white squares
FLAT = 20.0  #: grey levels of 255; difference of black and white of which rounding is 1.5 %
ROUGH = 0.15  #: residual relative to half that difference: noise of 9 levels at a typical contrast of 60
SAMPLES = 250_000  #: pixels sampled; the standard deviation of a share is 0.1 %
SMALL = 0.02  #: share of the picture; a smaller board is at most 1/7 as wide, and shows no distortion


def measure(gray: Array, found: Detection) -> dict[str, Any]:
    """Quality figures of a picture with a target.

    Parameters
    ----------
    gray : (height, width) array
    found : Detection
        With `blur_px`, `square_px`, `contrast` and `noise` in its info, if its detector provides them.

    Returns
    -------
    dict
        `blur_px`: width (σ) of the edges; `blur_ratio` and `blur_direction_deg`: ratio of the largest to the smallest
        blur, and direction of motion (0 = along x, clockwise), if the corners show them; `saturated`,
        `black`: shares of pixels at full scale and at 0 around the board; `contrast`, `noise`: grey levels of 255;
        `square_px`; `coverage`: share of the picture inside the points' convex hull; `warnings`: list of texts.
    """
    info = found.info
    names = {"blur_px": "blur_px", "square_px": "square_px", "contrast": "contrast", "noise": "residual"}
    figures: dict[str, Any] = {new: round(float(info[k]), 3) for k, new in names.items() if k in info}
    figures |= _exposure(gray, found.uv)
    figures["coverage"] = round(coverage(found.uv, (gray.shape[1], gray.shape[0])), 4)
    if "fit" in info and "sides" in info and len(found):
        ellipse = blur_ellipse(*corner_blurs(gray, found.uv, info["fit"], info["sides"]))
        if ellipse is not None:
            figures["blur_ratio"], figures["blur_direction_deg"] = round(ellipse[0], 3), round(ellipse[1], 1)
    figures["warnings"] = warnings(figures)
    return figures


def coverage(uv: Array, image_size: tuple[int, int]) -> float:
    """Share of the picture inside the convex hull of the points (N, 2)."""
    area = cv2.contourArea(cv2.convexHull(uv.astype(np.float32))) if len(uv) else 0.0
    return float(area) / (image_size[0] * image_size[1])


def _exposure(gray: Array, uv: Array) -> dict[str, float]:
    """The fractions of pixels at full scale and at 0 in the bounding box of the points."""
    (left, top), (right, bottom) = np.floor(uv.min(0)).astype(int), np.ceil(uv.max(0)).astype(int) + 1
    box = gray[max(top, 0) : bottom, max(left, 0) : right]
    stride = max(1, int(np.sqrt(box.size / SAMPLES)))
    box = box[::stride, ::stride]
    full = np.iinfo(gray.dtype).max
    return {
        "saturated": round(np.count_nonzero(box >= full) / box.size, 4) if box.size else 0.0,
        "black": round(np.count_nonzero(box == 0) / box.size, 4) if box.size else 0.0,
    }


def warnings(figures: Mapping[str, Any]) -> list[str]:
    """The warnings that follow from the figures of `measure`."""
    said = []
    blur, square = figures.get("blur_px"), figures.get("square_px")
    if blur is not None and square is not None and (blur > SOFT_PX or blur > SOFT * square):
        said.append(f"blurred: the edges are {blur:.1f} px wide (sigma) on squares of {square:.0f} px")
    ratio, direction = figures.get("blur_ratio", 1.0), figures.get("blur_direction_deg", 0.0)
    if blur is not None and blur > MOTION_PX and ratio > MOTION_RATIO:
        said.append(
            f"motion: {ratio:.1f} times as blurred along {direction:.0f} degrees as perpendicular to it"
        )
    if figures["saturated"] > SATURATED:
        said.append(f"overexposed: {figures['saturated']:.0%} of the board is at full scale")
    contrast = figures.get("contrast")
    if contrast is not None and 2 * contrast < FLAT:
        said.append(f"flat: black and white differ by {2 * contrast:.0f} grey levels of 255")
    residual = figures.get("residual")
    if residual is not None and contrast and residual > ROUGH * contrast:
        said.append(f"rough: residuals of {residual:.1f} grey levels against a contrast of {contrast:.0f}")
    if figures["coverage"] < SMALL:
        said.append(f"small: the board covers {figures['coverage']:.1%} of the picture")
    return said
