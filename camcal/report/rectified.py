"""The files of a rectification: pictures, a side-by-side view with rows drawn, maps, matrices under OpenCV's
names.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from camcal.data.formats.opencv import as_yaml
from camcal.data.writing import atomic_write, check_writable
from camcal.detect.resample import resample, write_picture, written_name
from camcal.errors import UsageError
from camcal.report.head import head
from camcal.report.plain import plain
from camcal.report.stereo import Pair, read_pair, section

Array = np.ndarray

#: rows, or columns, that are drawn
LINES = 24
LINE_PART = 600  #: of the side: lines of one pixel are invisible when a large picture is scaled to a screen
MAPS, MATRICES = "maps.npz", "rectification.yaml"


class Writer:
    """Writes a pair's pictures to a folder, one pair after the other, then maps and matrices.

    Raises
    ------
    UsageError
        If the folder is a file, two pictures would have the same name, or a file exists and `force` is not given.
    """

    def __init__(self, pair: Pair, folder: Path, interpolation: str, force: bool):
        self.pair, self.folder, self.interpolation, self.force = pair, folder, interpolation, force
        if folder.exists() and not folder.is_dir():
            raise UsageError(f"'{folder}' is a file; a folder is needed.", "Try: -o rectified")
        self.names = [_names(pair, i) for i in range(len(pair.pictures))]
        every = [n for names in self.names for n in names] + [MAPS, MATRICES]
        twice = next((n for n in every if every.count(n) > 1), None)
        if twice is not None:
            raise UsageError(
                f"two of the pictures would be called '{twice}'.", "Rectify one folder at a time."
            )
        for name in every if folder.exists() else ():
            check_writable(folder / name, force)
        self.maps = [pair.geometry.maps(side) for side in (0, 1)]

    def write(self, index: int) -> None:
        """Rectify a pair of pictures and write both, and the two side by side."""
        self.folder.mkdir(parents=True, exist_ok=True)
        made = [
            resample(picture, *maps, self.interpolation)
            for picture, maps in zip(read_pair(self.pair, index), self.maps, strict=True)
        ]
        *own, rows = self.names[index]
        for name, picture in zip(own, made, strict=True):
            write_picture(self.folder / name, picture, self.force)
        write_picture(self.folder / rows, _with_rows(made, self.pair.geometry.axis), self.force)

    def finish(self, rig: Path, alpha: float, command: Sequence[str]) -> dict[str, Any]:
        """Write maps and matrices; return the document of the rectification."""
        geometry = self.pair.geometry
        arrays = {
            f"{name}_{axis}": m
            for name, maps in zip(self.pair.names, self.maps, strict=True)
            for axis, m in zip("uv", maps, strict=True)
        }
        out = io.BytesIO()
        np.savez_compressed(out, **arrays)  # type: ignore[arg-type]
        atomic_write(self.folder / MAPS, out.getvalue(), self.force)
        shown = [(m[0] >= -0.5) | (m[1] >= -0.5) for m in self.maps]  # -1 where a pixel shows nothing
        made = section(self.pair, alpha) | {
            "black": {n: float(1 - s.mean()) for n, s in zip(self.pair.names, shown, strict=True)},
            "overlap": float((shown[0] & shown[1]).mean()),
            "from": str(rig),
            "files": [n for names in self.names for n in names] + [MAPS, MATRICES],
        }
        width, height = geometry.image_size
        entries: dict[str, Any] = {
            "image_width": width,
            "image_height": height,
            "first": self.pair.names[0],
            "second": self.pair.names[1],
            "projection": geometry.projection,
            "alpha": alpha,
            **geometry.matrices(),
        }
        if "Q" not in entries:  # for equation (2) of camcal.model.rectification
            entries |= {"focal": geometry.focal, "cx": geometry.centre[0], "cy": geometry.centre[1]}
            entries |= {"baseline": abs(geometry.shift)}
        atomic_write(self.folder / MATRICES, as_yaml(entries), self.force)
        return plain(head(command) | {"rectification": made})


def _names(pair: Pair, index: int) -> tuple[str, str, str]:
    """The names of both rectified pictures, which contain those of their cameras, and of the side-by-side view."""
    found, rest = [], ""
    for camera, path in zip(pair.names, pair.pictures[index], strict=True):
        name = written_name(path)
        found.append(name if camera in name else f"{camera}-{name}")
        rest = rest or Path(name).stem.replace(camera, "").strip("-_. ")
    return found[0], found[1], f"rows-{rest or index + 1}.png"


def _with_rows(pictures: Sequence[Array], axis: int) -> Array:
    """Both pictures side by side or one above the other, with lines on which a point lies in both."""
    made = np.concatenate([_colour(p) for p in pictures], 1 - axis)
    height, width = made.shape[:2]
    side = (height, width)[axis]
    thickness = max(1, side // LINE_PART)
    for i, at in enumerate(np.linspace(0, side, LINES + 2)[1:-1].astype(int).tolist()):
        begin, end = ((0, at), (width - 1, at)) if axis == 0 else ((at, 0), (at, height - 1))
        cv2.line(made, begin, end, ((80, 200, 80), (80, 160, 255))[i % 2], thickness)
    return made


def _colour(picture: Array) -> Array:
    if picture.dtype != np.uint8:
        scaled = cv2.normalize(picture.astype(np.float32), np.zeros(1), 0, 255, cv2.NORM_MINMAX)
        picture = np.asarray(scaled).astype(np.uint8)
    if picture.ndim == 2:
        return np.asarray(cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR))
    return np.ascontiguousarray(picture[..., :3])


def table(found: dict[str, Any]) -> Any:
    """The table of the document for the terminal."""
    made = found["rectification"]
    rows = [
        ("pair", f"{made['direction']}, {made['cameras'][0]} first; {made['projection']}"),
        ("baseline", f"{made['baseline']:.6g}"),
        ("scale", f"{made['focal']:.6g} px" + ("" if "Q" in made else " per rad")),
        ("both show", f"{made['overlap']:.1%} of the picture"),
        *((f"black, {n}", f"{share:.1%}") for n, share in made["black"].items()),
    ]
    from rich.table import Table

    out = Table(box=None, pad_edge=False, show_header=False)
    for row in rows:
        out.add_row(*row)
    return out
