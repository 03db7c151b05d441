"""The eleven DLT coefficients, one column per camera: DLTdv, Argus, easyWand, StereoMorph.

u = (L1 X + L2 Y + L3 Z + L4) / (L9 X + L10 Y + L11 Z + 1), v with L5 to L8 (Abdel-Aziz & Karara 1971). Each
camera is a pinhole with a skew, and its pose in the frame of the points: exactly the 11 numbers.
"""

from __future__ import annotations

import numpy as np

from camcal.data.dlt_table import dlt_text, looks_like_dlt, matrices
from camcal.data.formats.base import Array, CameraFile, Format, NamedCamera
from camcal.data.formats.source import Source
from camcal.data.formats.terms import choose, polynomial
from camcal.errors import UsageError
from camcal.geometry.projective import decompose
from camcal.model.pose import Pose

#: characters of a table of a thousand cameras
LONGEST = 1_000_000
MODELS = ("pinhole+skew",)
#: relative difference up to which numbers are those that were read: camera and pose of them are rounded by 1e-13
SAME = 1e-9


def _sniff(source: Source) -> bool:
    return source.kind == "text" and looks_like_dlt((source.text or "")[:LONGEST])


def _read(source: Source) -> CameraFile:
    return CameraFile(tuple(_camera(i, m) for i, m in enumerate(matrices(source.text or "", source.path), 1)))


def _camera(index: int, projection: Array) -> NamedCamera:
    k, rotation, translation, _ = decompose(projection)
    matrix = (k[0, 0], k[1, 1], k[0, 2], k[1, 2], k[0, 1])
    camera, pose = polynomial(matrix, None), Pose(rotation, translation)
    return NamedCamera(str(index), camera, pose, projection=projection)


def _write(cameras: CameraFile, suffix: str) -> str:
    projections = []
    for named in cameras.cameras:
        _, terms = choose(named.camera, MODELS, "a table of DLT coefficients")
        if named.pose is None:
            raise UsageError(
                "the DLT's numbers need the pose of the camera in the frame of the points.",
                "Convert the report of one view (camcal estimate, camcal pose), or a rig.",
            )
        made = terms.matrix @ named.pose.matrix[:3]
        known = named.projection
        projections.append(made if known is None or not _same(made, known) else known)
    return dlt_text(projections)


def _same(made: Array, known: Array) -> bool:
    """Return whether two projection matrices are equal up to scale and rounding, each column in its own unit."""
    off = np.abs(made / made[2, 3] - known / known[2, 3])
    return bool((off <= SAME * np.abs(known / known[2, 3]).max(0)).all())


FORMAT = Format(
    "dlt",
    "a table of DLT coefficients",
    (".csv", ".txt"),
    _sniff,
    _read,
    _write,
    MODELS,
    several=True,
    poses=True,
    size=False,
    centre="as in the program that digitised",
    order="L1 to L11, a column for each camera",
    traps=(
        "The pixel coordinates are those of the program that digitised: in DLTdv v increases upwards "
        "from the bottom.",
        "The file states neither the image size nor a distortion.",
    ),
    source="DLTdv, Argus, easyWand, StereoMorph; Abdel-Aziz & Karara (1971)",
)
