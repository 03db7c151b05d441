"""A sheet as PNG: each pixel's grey is its black fraction; the resolution is in the file's metadata."""

from __future__ import annotations

import struct
import zlib

import cv2
import numpy as np

from camcal.detect.black_area import BlackArea, RectangleIntegral, is_rectangle
from camcal.detect.targets.base import Pattern
from camcal.detect.targets.printing.sheet import LINE, NUMBER, Sheet
from camcal.errors import UsageError

Array = np.ndarray

MOST_PIXELS = 2e8  #: A0 at 300 dpi has 1.4e8; more is a wrong --dpi
LETTERS = 22  #: px; height of the font's capital letters at scale 1
BAND = 64  #: rows drawn at a time


def write(sheet: Sheet, dpi: float = 300.0) -> bytes:
    """The PNG file at `dpi` pixels per inch.

    Raises
    ------
    UsageError
        If the picture would be larger than 200 megapixels.
    """
    picture = draw(sheet, dpi)
    done, data = cv2.imencode(".png", picture)
    assert done, "cv2 writes PNG"
    per_metre = round(dpi / 0.0254)
    chunk = b"pHYs" + struct.pack(">IIB", per_metre, per_metre, 1)
    resolution = struct.pack(">I", 9) + chunk + struct.pack(">I", zlib.crc32(chunk))
    raw, after_header = data.tobytes(), 8 + 25  # the signature, then the IHDR chunk
    return raw[:after_header] + resolution + raw[after_header:]


def draw(sheet: Sheet, dpi: float) -> Array:
    """The picture (rows, columns) uint8; a pixel covers a square of 25.4 / dpi mm."""
    size = 25.4 / dpi
    columns, rows = round(sheet.width / size), round(sheet.height / size)
    if columns * rows > MOST_PIXELS:
        raise UsageError(
            f"the sheet at {dpi:g} dpi has {columns * rows / 1e6:.0f} megapixels; at most 200 can be drawn.",
            "Use a lower --dpi, or write an SVG or a PDF.",
        )
    shapes = [RectangleIntegral([p for p in sheet.polygons if is_rectangle(p)])] if sheet.polygons else []
    shapes += [RectangleIntegral([_thick(line)]) for line in sheet.lines]  # its ticks overlap it: separately
    black = np.zeros((rows, columns), np.float32)
    x, y = np.arange(columns + 1) * size, np.arange(rows + 1) * size
    for start in range(0, rows, BAND):
        band = y[start : start + BAND + 1]
        black[start : start + BAND] = sum(shape.on_grid(x, band) for shape in shapes)
    for disc in sheet.circles:
        _add_disc(black, disc, size)
    assert all(map(is_rectangle, sheet.polygons)), "only rectangles and discs can be drawn"
    picture = np.rint(255 * (1 - np.clip(black, 0, 1))).astype(np.uint8)
    for text, left, base in sheet.numbers:
        _write(picture, text, (left / size, base / size), NUMBER / size)
    left, base = sheet.caption_at
    _write(picture, sheet.caption, (left / size, base / size), 3 / size)
    return picture


def _write(picture: Array, text: str, at: tuple[float, float], height: float) -> None:
    """Write a line of text; `at` is the left end of its baseline, px."""
    place = round(at[0]), round(at[1])
    cv2.putText(picture, text, place, cv2.FONT_HERSHEY_SIMPLEX, height / LETTERS, 0, 1, cv2.LINE_AA)


def _thick(line: tuple[float, float, float, float]) -> Array:
    """A line along an axis as a rectangle."""
    a, b, c, d = line
    h = LINE / 2
    return np.array([[a - h, b - h], [c + h, b - h], [c + h, d + h], [a - h, d + h]])


def _add_disc(black: Array, disc: Array, size: float) -> None:
    x, y, r = disc
    i0, i1 = (int(np.clip(np.floor(v / size), 0, black.shape[1])) for v in (x - r - size, x + r + 2 * size))
    j0, j1 = (int(np.clip(np.floor(v / size), 0, black.shape[0])) for v in (y - r - size, y + r + 2 * size))
    at = np.stack(np.meshgrid((np.arange(i0, i1) + 0.5) * size, (np.arange(j0, j1) + 0.5) * size), -1)
    black[j0:j1, i0:i1] += BlackArea(Pattern((), disc[None], (0.0, 0.0, 0.0, 0.0))).mean(
        at, np.full_like(at, size)
    )
