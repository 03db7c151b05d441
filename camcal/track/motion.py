"""Models of camera motion between frames: process noise in the parameters with a physical meaning.

Figures are standard deviations per square root of a frame (of a random walk), or of the change of velocity
where the velocity is tracked:

| group       | unit                                        |
|-------------|---------------------------------------------|
| focal       | fraction of the focal length, fx and fy together |
| aspect      | fraction, fy alone                          |
| principal   | px, each coordinate                         |
| skew        | px                                          |
| rotation    | degrees, about each axis, about the camera's centre |
| translation | fraction of the distance to the points, along each axis |
| distortion  | the coefficient's own unit                  |
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from camcal.errors import UsageError
from camcal.registry import suggestion

GROUPS = ("focal", "aspect", "principal", "skew", "rotation", "translation", "distortion")

#: the figures of a filter that knows no motion
NONE = dict.fromkeys(GROUPS, 0.0)

#: per square root of a frame; the walks below are those of 30 frames a second. No source states such figures; they are
#: set by what is to be followed. A walk that is a tenth of the true one raises alarms; one that is ten times it only
#: widens the sigmas.
#: thermal: the focal length by 1e-3 and the principal point by 2 px in half an hour. Of plastic (7e-5 per K) that is a
#: warming by 15 K.
#: zoom: the focal length by 1.6 % in a second, and the principal point by 1 px, as lens groups are not centred.
#: pan: .5 degrees in a second; the camera's inside walks a fifth as far as with `thermal`.
#: free: as pan, and by 1.6 % of the distance in a second.
MOTIONS: dict[str, dict[str, float]] = {
    "fixed": {},
    "thermal": {"focal": 5e-6, "principal": 0.01, "rotation": 1e-4, "translation": 1e-6},
    "zoom": {"focal": 3e-3, "principal": 0.2, "rotation": 1e-3, "translation": 1e-5},
    "pan": {"focal": 1e-6, "principal": 0.002, "rotation": 0.1, "translation": 1e-4},
    "free": {"focal": 1e-6, "principal": 0.002, "rotation": 0.1, "translation": 3e-3},
}

#: how far a camera may be after a change of which nothing is known. It is beyond what one frame determines, so that it
#: keeps the numbers finite and states nothing: three times as much leads to the same camera
RESET = {
    "focal": 0.2,
    "aspect": 0.01,
    "principal": 100.0,
    "skew": 10.0,
    "rotation": 20.0,
    "translation": 0.3,
    "distortion": 0.1,
}


def figures(motion: str, drift: Mapping[str, float]) -> dict[str, float]:
    """The noise of each group: the motion's, overridden by given values.

    Raises
    ------
    UsageError
        If the motion or a group is unknown, or a figure negative.
    """
    if motion not in MOTIONS:
        raise UsageError(
            f"unknown motion '{motion}'.", suggestion(motion, MOTIONS) or "Known: " + ", ".join(MOTIONS) + "."
        )
    for group, value in drift.items():
        if group not in GROUPS:
            hint = suggestion(group, GROUPS) or "Known: " + ", ".join(GROUPS) + "."
            raise UsageError(f"unknown group of parameters '{group}' in the drift.", hint)
        if not value >= 0:
            raise UsageError(f"the drift {group}={value} is negative.", "Figures are standard deviations.")
    return {**NONE, **MOTIONS[motion], **drift}


def scaled(noise: Mapping[str, float], focal: float, distance: float) -> dict[str, float]:
    """The figures in the units of the parameters: px, radians, the unit of the points."""
    return {
        "focal": noise["focal"] * focal,
        "aspect": noise["aspect"] * focal,
        "principal": noise["principal"],
        "skew": noise["skew"],
        "rotation": float(np.deg2rad(noise["rotation"])),
        "translation": noise["translation"] * distance,
        "distortion": noise["distortion"],
    }
