"""Undistortion maps for other programs: numpy archives, STMaps (EXR), ffmpeg's remap (PGM), GStreamer."""

from __future__ import annotations

import io
import struct
from pathlib import Path

import numpy as np

from camcal.data.formats.opencv import coefficients
from camcal.data.formats.terms import choose
from camcal.errors import UsageError
from camcal.geometry.picture import in_picture
from camcal.model.camera import Camera

Array = np.ndarray
Size = tuple[int, int]
ENDINGS = (".npz", ".exr", ".pgm", ".gst")
#: what GStreamer's cameraundistort takes: cv::initUndistortRectifyMap, without a skew and without cv::fisheye
GSTREAMER_MODELS = ("opencv4", "opencv5", "opencv8", "opencv12", "opencv14")
#: ffmpeg's remap fills what lies outside of the picture
OUTSIDE = 65535


def check_ending(path: Path) -> None:
    """UsageError if a file name extension is not one of the known ones."""
    if path.suffix.lower() not in ENDINGS:
        raise UsageError(
            f"'{path}': maps are written as .npz (numpy), .exr (STMap), .pgm (ffmpeg) or .gst (GStreamer).",
            "Try: maps.npz",
        )


def names(path: Path) -> list[Path]:
    """The files written for a path: for ffmpeg two, NAME-x.pgm and NAME-y.pgm."""
    if path.suffix.lower() != ".pgm":
        return [path]
    return [path.with_name(f"{path.stem}-{axis}{path.suffix}") for axis in "xy"]


def contents(
    path: Path, u: Array, v: Array, source: Size, camera: Camera | None = None, **more: Array
) -> dict[Path, bytes]:
    """The bytes of each file.

    Parameters
    ----------
    path : Path
        The ending says the form.
    u, v : (H, W) arrays, px
        Where in the old picture each pixel of the new one lies, (0, 0) the centre of the top-left pixel; -1
        where nowhere.
    source : (width, height)
        Of the old picture.
    camera : Camera, optional
        That took the old picture; a .gst holds it in place of the map.
    more : arrays
        Further entries of an .npz.
    """
    check_ending(path)
    suffix = path.suffix.lower()
    if suffix == ".npz":
        out = io.BytesIO()
        size = np.array(source)
        np.savez_compressed(out, u=u.astype(np.float32), v=v.astype(np.float32), source_size=size, **more)  # type: ignore[arg-type]
        return {path: out.getvalue()}
    if suffix == ".exr":
        return {path: stmap(u, v, source)}
    if suffix == ".gst":
        if camera is None:
            raise UsageError("a .gst holds a camera, not a map.", "Write .npz, .exr or .pgm.")
        return {path: gstreamer(camera)}
    return dict(zip(names(path), (pgm(u, u, v, source), pgm(v, u, v, source)), strict=True))


def _outside(u: Array, v: Array, source: Size) -> Array:
    return ~in_picture(np.stack([u, v], -1), source)


def pgm(values: Array, u: Array, v: Array, source: Size) -> bytes:
    """A map for ffmpeg's remap filter: 16-bit PGM of whole px, rounded; pixels outside are 65535."""
    if max(source) >= OUTSIDE:
        raise UsageError("ffmpeg's maps hold coordinates up to 65534 px.", "Write .npz or .exr.")
    whole = np.where(_outside(u, v, source), OUTSIDE, np.rint(np.nan_to_num(values, nan=-1.0)))
    height, width = values.shape
    return f"P5\n{width} {height}\n{OUTSIDE}\n".encode() + np.maximum(whole, 0).astype(">u2").tobytes()


def gstreamer(camera: Camera) -> bytes:
    """The `settings` of GStreamer's cameraundistort: matrix and coefficients as OpenCV's XML, on one line.

    The element makes its own map and its own new camera matrix, of `cv::getOptimalNewCameraMatrix` with its property
    `alpha`. Attributes are in single quotes, so that the text stands between double quotes in a `gst-launch-1.0` line.

    Raises
    ------
    UsageError
        If OpenCV's model has no room for a term of the camera, which it names.
    """
    spec, terms = choose(camera, GSTREAMER_MODELS, "GStreamer's cameraundistort")
    entries = {"cameraMatrix": terms.matrix, "distCoeffs": np.array([coefficients(spec, terms)])}
    parts = [
        f"<{name} type_id='opencv-matrix'><rows>{a.shape[0]}</rows><cols>{a.shape[1]}</cols><dt>d</dt>"
        f"<data>{' '.join(repr(float(x)) for x in a.ravel())}</data></{name}>"
        for name, a in entries.items()
    ]
    return f"<?xml version='1.0'?><opencv_storage>{''.join(parts)}</opencv_storage>".encode()


def stmap(u: Array, v: Array, source: Size) -> bytes:
    """An STMap: red and green are the position in the old picture, 0 to 1 from its lower left corner.

    As Nuke and its kin take it: the centre of the lower left pixel is (0.5 / width, 0.5 / height). What lies
    outside is -1.
    """
    width, height = source
    outside = _outside(u, v, source)
    red = np.where(outside, -1.0, (u + 0.5) / width)
    green = np.where(outside, -1.0, 1 - (v + 0.5) / height)
    return exr({"R": red, "G": green, "B": np.zeros_like(red)})


def exr(channels: dict[str, Array]) -> bytes:
    """An OpenEXR file of float channels (H, W), uncompressed scan lines (OpenEXR file layout)."""
    ordered = sorted(channels)
    planes = np.stack([channels[n] for n in ordered]).astype("<f4")
    _, height, width = planes.shape
    listed = b"".join(n.encode() + b"\0" + struct.pack("<iB3xii", 2, 0, 1, 1) for n in ordered) + b"\0"
    box = struct.pack("<4i", 0, 0, width - 1, height - 1)
    attributes = [
        (b"channels", b"chlist", listed),
        (b"compression", b"compression", b"\0"),
        (b"dataWindow", b"box2i", box),
        (b"displayWindow", b"box2i", box),
        (b"lineOrder", b"lineOrder", b"\0"),
        (b"pixelAspectRatio", b"float", struct.pack("<f", 1)),
        (b"screenWindowCenter", b"v2f", struct.pack("<2f", 0, 0)),
        (b"screenWindowWidth", b"float", struct.pack("<f", 1)),
    ]
    head = struct.pack("<ii", 20000630, 2)  # magic number, version
    head += b"".join(n + b"\0" + t + b"\0" + struct.pack("<i", len(d)) + d for n, t, d in attributes) + b"\0"
    line = 8 + 4 * len(ordered) * width
    first = len(head) + 8 * height
    offsets = (first + line * np.arange(height, dtype="<u8")).tobytes()
    rows = planes.transpose(1, 0, 2).reshape(height, -1)
    body = b"".join(struct.pack("<ii", y, line - 8) + rows[y].tobytes() for y in range(height))
    return head + offsets + body


def crop_box(u: Array, v: Array, source: Size) -> tuple[int, int, int, int] | None:
    """A rectangle of the new picture without black pixels: x, y, width, height; None if there is none.

    From the whole picture, the side with the largest part of black is moved in by one pixel until no side has any;
    for pictures of lenses, whose black lies along the borders, the rectangle cannot then grow on any side.
    """
    black = np.pad(np.cumsum(np.cumsum(_outside(u, v, source), 0), 1), ((1, 0), (1, 0)))

    def count(x0: int, y0: int, x1: int, y1: int) -> int:
        return int(black[y1, x1] - black[y0, x1] - black[y1, x0] + black[y0, x0])

    height, width = u.shape
    x0, y0, x1, y1 = 0, 0, width, height
    while x0 < x1 and y0 < y1 and count(x0, y0, x1, y1):
        sides = (
            count(x0, y0, x0 + 1, y1) / (y1 - y0),
            count(x0, y0, x1, y0 + 1) / (x1 - x0),
            count(x1 - 1, y0, x1, y1) / (y1 - y0),
            count(x0, y1 - 1, x1, y1) / (x1 - x0),
        )
        worst = max(range(4), key=sides.__getitem__)
        if not sides[worst]:
            return None  # black inside alone: a rectangle would leave out most of the picture
        x0, y0, x1, y1 = x0 + (worst == 0), y0 + (worst == 1), x1 - (worst == 2), y1 - (worst == 3)
    return (x0, y0, x1 - x0, y1 - y0) if x0 < x1 and y0 < y1 else None
