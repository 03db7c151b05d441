"""Pix4D: calibrated_camera_parameters.txt, one block per picture, m = K [R | -R t] X."""

from __future__ import annotations

import re

import numpy as np

from camcal.data.formats.base import (
    CameraFile,
    Format,
    NamedCamera,
    floats,
    image_size,
    matrix_values,
    number,
)
from camcal.data.formats.source import Source
from camcal.data.formats.terms import choose, polynomial
from camcal.model.pose import Pose

HEAD = (
    "fileName imageWidth imageHeight \ncamera matrix K [3x3]\nradial distortion [3x1]\ntangential distortion [2x1]\n"
    "camera position t [3x1]\ncamera rotation R [3x3]\ncamera model m = K [R|-Rt] X\n\n"
)
MODELS = ("opencv5+skew",)
#: characters in which the line of the camera model is looked for: it is the first one after the version
BEGINNING = 1000
#: lines of a camera at most: K, radial, tangential, t and R
LINES = 3 + 1 + 1 + 1 + 3
_START = re.compile(r"(\S.*?)\s+(\d+)\s+(\d+)\s*")


def _sniff(source: Source) -> bool:
    return source.kind == "text" and "camera model m = K [R|-Rt] X" in (source.text or "")[:BEGINNING]


def _read(source: Source) -> CameraFile:
    lines = (source.text or "").splitlines()
    at = next(i for i, line in enumerate(lines) if line.startswith("camera model m")) + 1
    found = []
    while at < len(lines):
        start = _START.fullmatch(lines[at])
        if not start:
            at += 1
            continue
        rows: list[list[float]] = []
        for line in lines[at + 1 : at + 1 + LINES]:
            words = line.split()
            if not words or (_START.fullmatch(line) and len(rows) in (5, 6, 9) and not _is_numbers(line)):
                break
            rows.append([float(w) for w in words])
        found.append(_block(start, rows))
        at += 1 + len(rows)
    return CameraFile(tuple(found), of_pictures=True)


def _is_numbers(line: str) -> bool:
    try:
        return bool([float(w) for w in line.split()])
    except ValueError:
        return False


def _block(start: re.Match[str], rows: list[list[float]]) -> NamedCamera:
    size = image_size(start[2], start[3])
    k, radial, tangential = matrix_values(rows[:3]), floats(rows[3], 3), floats(rows[4], 2)
    camera = polynomial(k, size, radial.tolist(), tangential.tolist())
    pose = None
    if len(rows) >= 9:
        r = floats(rows[6:9], 9, "R").reshape(3, 3)
        pose = Pose(r, -r @ floats(rows[5], 3, "t"))
    return NamedCamera(start[1], camera, pose)


def _write(cameras: CameraFile, suffix: str) -> str:
    out = HEAD
    for named in cameras.cameras:
        _, terms = choose(named.camera, MODELS, "a Pix4D file")
        width, height = named.camera.image_size
        pose = named.pose or Pose.identity()
        rows = [
            *terms.matrix.tolist(),
            terms.get("k1", "k2", "k3"),
            terms.get("p1", "p2"),
            pose.centre.tolist(),
        ]
        rows += np.asarray(pose.rotation).tolist()
        name = named.name if named.name != "camera" else "image.jpg"  # the entry is a picture's
        out += f"{name} {width} {height}\n" + "".join(" ".join(map(number, r)) + "\n" for r in rows)
    return out


FORMAT = Format(
    "pix4d",
    "a Pix4D file",
    (".txt",),
    _sniff,
    _read,
    _write,
    MODELS,
    several=True,
    poses=True,
    centre="(0, 0), not stated in the program's documentation",
    order="K row by row; radial R1 R2 R3; tangential T1 T2 as OpenCV's p1 p2; position t and R, x_cam = R (x - t)",
    traps=(
        "t is the position of the camera, not the translation of the pose.",
        "There is a block for each picture; pictures of one camera have the same numbers.",
    ),
    source="Pix4D, how the parameters of the camera are defined",
)
