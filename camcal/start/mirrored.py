"""Points that are in front of a camera only after a reflection, and the most likely of three causes.

Images whose v is counted upwards, exchanged u and v, and a left-handed frame of the points give the same equations.
They are distinguished by the usual orientation of cameras: v increases downwards, opposite to Y or Z of most frames.
"""

from __future__ import annotations

import numpy as np

from camcal.errors import DataError

Array = np.ndarray

#: cosine of the largest angle at which a direction counts as along an axis: 45 degrees
ALONG = 0.7
_NAMES = "XYZ"
_CAUSES = {
    "upwards": "v increases upwards: use v = height - 1 - v",
    "exchanged": "u and v are exchanged: u is the column, v the row",
    "left-handed": "the frame of the points is left-handed: negate one axis, or swap two",
}


def mirrored_error(rotation: Array) -> DataError:
    """The error for points that lie in front of the camera only after a reflection.

    Parameters
    ----------
    rotation : (3, 3) array
        cam_from_world of the camera with the scene behind it, from `projective.decompose`.
    """
    likely, why = which(-rotation)
    order = sorted(_CAUSES, key=lambda c: c != likely)
    hint = f"{why}, so most likely {_CAUSES[order[0]]}. Otherwise: " if likely else "One of: "
    rest = order[1:] if likely else order
    return DataError(
        "the points and their images are mirrored (v counted upwards, u and v exchanged, or a left-handed frame of the "
        "points): the scene lies in front of the camera only with a reflection.",
        hint + "; ".join(_CAUSES[c] for c in rest) + ".",
    )


def which(reflected: Array) -> tuple[str, str]:
    """The likely cause and the evidence for it; empty if there is none.

    Parameters
    ----------
    reflected : (3, 3) array
        cam_from_world of determinant -1: its first two rows are the directions in which u and v grow.
    """
    along_u, along_v = (int(np.abs(row).argmax()) for row in reflected[:2])
    u, v = reflected[0, along_u], reflected[1, along_v]
    if along_v and abs(v) > ALONG:
        grows = f"v {'grows' if v > 0 else 'falls'} with {_NAMES[along_v]}"
        return ("upwards" if v > 0 else "left-handed"), grows
    if along_u and along_v == 0 and min(abs(u), abs(v)) > ALONG:
        return "exchanged", f"v runs along X and u along {_NAMES[along_u]}"
    return "", ""
