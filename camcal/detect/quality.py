"""How good a picture is for calibration: sharpness, exposure, motion, and how much of it the board covers."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from camcal.detect.motion_blur import corner_blurs, smear
from camcal.detect.targets.base import Detection

Array = np.ndarray

SMEARED = 1.5  #: ratio of the blurs in two directions that speaks of motion
SMEARED_PX = 1.2  #: px; a smaller blur is the sensor's and the lens's own, and seldom round
SOFT = 0.2  #: blur as a share of a square's side from which on neighbouring edges run together
SOFT_PX = 2.5  #: px; blur from which on corners lose much on squares of any size
SATURATED = 0.25  #: share of the board's squares' pixels at full scale
FLAT = 20.0  #: grey levels of 255; least difference of black and white
ROUGH = 0.15  #: residual as a share of half that difference
SMALL = 0.02  #: share of the picture that the board covers


def measure(gray: Array, found: Detection) -> dict[str, Any]:
    """Figures on a picture with a target.

    Parameters
    ----------
    gray : (height, width) array
    found : Detection
        With `blur_px`, `square_px`, `contrast` and `noise` in its info, where its detector gives them.

    Returns
    -------
    dict
        `blur_px`: width (σ) of the edges; `blur_ratio` and `blur_direction_deg`: of the widest against the
        narrowest edges, and which way the picture is smeared (0 = along x, clockwise), where the corners
        tell; `saturated`, `black`: shares of pixels at full scale and at 0 around the board; `contrast`,
        `noise`: grey levels of 255; `square_px`; `coverage`: share of the picture that the points' hull
        covers; `warnings`: list of words.
    """
    info = found.info
    names = {"blur_px": "blur_px", "square_px": "square_px", "contrast": "contrast", "noise": "residual"}
    figures: dict[str, Any] = {new: round(float(info[k]), 3) for k, new in names.items() if k in info}
    figures |= _exposure(gray, found.uv)
    figures["coverage"] = round(coverage(found.uv, (gray.shape[1], gray.shape[0])), 4)
    if "fit" in info and "sides" in info and len(found):
        smeared = smear(*corner_blurs(gray, found.uv, info["fit"], info["sides"]))
        if smeared is not None:
            figures["blur_ratio"], figures["blur_direction_deg"] = round(smeared[0], 3), round(smeared[1], 1)
    figures["warnings"] = warnings(figures)
    return figures


def coverage(uv: Array, image_size: tuple[int, int]) -> float:
    """Share of the picture inside the convex hull of the points (N, 2)."""
    try:
        area = ConvexHull(uv).volume  # of a plane hull, `volume` is the area
    except (QhullError, ValueError):  # fewer than three points, or all on a line
        return 0.0
    return float(area / (image_size[0] * image_size[1]))


def _exposure(gray: Array, uv: Array) -> dict[str, float]:
    """Shares of pixels at full scale and at 0 in the box around the points."""
    (left, top), (right, bottom) = np.floor(uv.min(0)).astype(int), np.ceil(uv.max(0)).astype(int) + 1
    box = gray[max(top, 0) : bottom, max(left, 0) : right]
    stride = max(1, int(np.sqrt(box.size / 250_000)))
    box = box[::stride, ::stride]
    full = np.iinfo(gray.dtype).max
    return {
        "saturated": round(float((box >= full).mean()), 4) if box.size else 0.0,
        "black": round(float((box == 0).mean()), 4) if box.size else 0.0,
    }


def warnings(figures: Mapping[str, Any]) -> list[str]:
    """What the figures of `measure` give reason to say."""
    said = []
    blur, square = figures.get("blur_px"), figures.get("square_px")
    if blur is not None and square is not None and (blur > SOFT_PX or blur > SOFT * square):
        said.append(f"blurred: the edges are {blur:.1f} px wide (sigma) on squares of {square:.0f} px")
    ratio, direction = figures.get("blur_ratio", 1.0), figures.get("blur_direction_deg", 0.0)
    if blur is not None and blur > SMEARED_PX and ratio > SMEARED:
        said.append(f"motion: {ratio:.1f} times as blurred along {direction:.0f} degrees as across")
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
