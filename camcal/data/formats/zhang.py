"""Z. Zhang's calibration result: alpha gamma beta u0 v0, then k1 k2, then R and t of each view."""

from __future__ import annotations

from camcal.data.formats.base import CameraFile, Format, floats, number
from camcal.data.formats.source import Source
from camcal.data.formats.terms import choose, polynomial

#: lines that are read: those of the camera and of a thousand views, of four lines each. A longer text is recognised by
#: its first ones
MOST_ROWS = 2 + 4 * 1000
MODELS = ("opencv4+skew", "brown:radial=2,decentering=0+skew")


def _numbers(source: Source) -> list[list[float]]:
    """The numbers line by line; none if the text contains anything else."""
    if source.kind != "text":
        return []
    lines = [line.split() for line in (source.text or "").splitlines() if line.strip()]
    try:
        return [[float(w) for w in line] for line in lines[:MOST_ROWS]]
    except ValueError:
        return []


def _sniff(source: Source) -> bool:
    rows = _numbers(source)
    return len(rows) >= 2 and len(rows[0]) == 5 and len(rows[1]) == 2 and (len(rows) - 2) % 4 == 0


def _read(source: Source) -> CameraFile:
    first, second = _numbers(source)[:2]
    alpha, gamma, beta, u0, v0 = floats(first, 5)
    return CameraFile.one(polynomial((alpha, beta, u0, v0, gamma), None, floats(second, 2).tolist()))


def _write(cameras: CameraFile, suffix: str) -> str:
    _, terms = choose(cameras.cameras[0].camera, MODELS[1:], "Zhang's text")
    rows = [[terms.fx, terms.skew, terms.fy, terms.cx, terms.cy], terms.get("k1", "k2")]
    return "\n\n".join(" ".join(map(number, r)) for r in rows) + "\n"


FORMAT = Format(
    "zhang",
    "Zhang's text",
    (".txt",),
    _sniff,
    _read,
    _write,
    MODELS[1:],
    size=False,
    order="alpha gamma beta u0 v0; k1 k2",
    traps=(
        "The second number, gamma, is the skew.",
        "The file does not contain the size of the image.",
        "The poses of the views are omitted.",
    ),
    source="Z. Zhang, camera calibration, completed calibration of the example data",
)
