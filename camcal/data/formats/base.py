"""The definition of a camera file format: recognition, reading, writing, and what it can represent."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import field
from typing import Any

import numpy as np

from camcal.data.formats.source import Source
from camcal.errors import DataError
from camcal.model.pose import Pose
from camcal.records import dataclass
from camcal.registry import suggestion

Array = np.ndarray


@dataclass(frozen=True)
class ForeignLens:
    """A lens without an exact counterpart in camcal; it can only be refitted (`--to-model`).

    Attributes
    ----------
    name : str
        The owner's name of the model.
    reason : str
        What of it has no counterpart.
    rays : callable
        Pixels (N, 2) to rays (N, 3) of unit length and the mask of pixels that have one.
    """

    name: str
    reason: str
    rays: Callable[[Array], tuple[Array, Array]]
    has_skew: bool = False

    def unproject(self, params: Any, uv: Array) -> tuple[Array, Array]:
        """Rays of pixels, in the form of `camcal.model.lenses.base.Lens.unproject`."""
        return self.rays(np.asarray(uv, float))


@dataclass(frozen=True)
class ForeignCamera:
    """A camera with a `ForeignLens`; `params` is empty."""

    lens: ForeignLens
    image_size: tuple[int, int] | None = None
    params: Array = field(default_factory=lambda: np.zeros(0))


@dataclass(frozen=True)
class NamedCamera:
    """A camera in a file.

    Attributes
    ----------
    name : str
    camera : Camera or ForeignCamera
    pose : Pose or None
        cam_from_rig: from the frame that all cameras of the file share, where the file has poses.
    rectification : (R (3, 3), P (3, 4)) or None
        Of a pair that is written: see `camcal.model.rectification`.
    projection : (3, 4) array or None
        As the file has it, of formats that hold nothing else: the same numbers are written again.
    """

    name: str
    camera: Any
    pose: Pose | None = None
    rectification: tuple[Array, Array] | None = None
    projection: Array | None = None


@dataclass(frozen=True)
class CameraFile:
    """The contents of a camera file.

    Attributes
    ----------
    cameras : tuple of NamedCamera
    notes : tuple of str
        What the file holds besides, or how it was understood, where a user should know.
    reference : str or None
        The camera whose frame the poses are in, where the file says it.
    of_pictures : bool
        Whether its entries are pictures, possibly of one camera, and no cameras of a rig.
    """

    cameras: tuple[NamedCamera, ...]
    notes: tuple[str, ...] = ()
    reference: str | None = None
    of_pictures: bool = False

    @classmethod
    def one(cls, camera: Any, name: str = "camera", *notes: str) -> CameraFile:
        """Make a file of a single camera."""
        return cls((NamedCamera(name, camera),), notes)

    @property
    def names(self) -> list[str]:
        """The names of the cameras, in the order of the file."""
        return [c.name for c in self.cameras]

    @property
    def has_poses(self) -> bool:
        """Whether every camera has a pose."""
        return all(c.pose is not None for c in self.cameras)


@dataclass(frozen=True)
class Written:
    """The contents of a file, and of accompanying files, by name."""

    content: str | bytes
    beside: Mapping[str, str | bytes] = field(default_factory=dict)


@dataclass(frozen=True)
class Format:
    """A format of camera files.

    Attributes
    ----------
    name : str
        Its name for `--to`.
    title : str
        What messages and docs call it.
    endings : tuple of str
        What the names of its files end in, the usual one first.
    sniff : callable
        Whether a `Source` is a file of this format; cheap, and never an error.
    read : callable
        The `CameraFile` of a `Source`. Any KeyError, ValueError and the like is reported as damage.
    write : callable or None
        The text or bytes, or `Written`, of a `CameraFile` and the suffix of the file's name.
    models : tuple of str
        Specs of the lens models that the format holds exactly; `spec+skew` where it has a skew, `spec+square`
        where fx = fy is needed.
    several : bool
        Whether one file holds several cameras.
    poses : bool
        Whether cameras have poses.
    rectified : bool
        Whether the files of a pair hold its rectification, R and P of each camera.
    size : bool
        Whether the file says how large the image is.
    centre : str
        Where the centre of the top-left pixel is.
    order : str
        The owner's order of the parameters, with units and axes.
    traps : tuple of str
        What is easily read wrongly.
    source : str
        Where the owner documents it.
    """

    name: str
    title: str
    endings: tuple[str, ...]
    sniff: Callable[[Source], bool]
    read: Callable[[Source], CameraFile]
    write: Callable[[CameraFile, str], str | bytes | Written] | None
    models: tuple[str, ...]
    several: bool = False
    poses: bool = False
    rectified: bool = False
    size: bool = True
    centre: str = "(0, 0)"
    order: str = ""
    traps: tuple[str, ...] = ()
    source: str = ""


def unknown(kind: str, name: object, known: Any) -> DataError:
    """The error for an unknown name in a file."""
    hint = suggestion(str(name), list(known)) or f"Known: {', '.join(known)}."
    return DataError(f"unknown {kind} '{one_line(str(name))[:80]}'.", hint)


def one_line(text: str) -> str:
    """Text of a file for messages and names: on one line, without terminal control characters."""
    return "".join(c if c.isprintable() else " " for c in text)


#: px to a side; no image of a camera is larger
WIDEST = 10**6


def image_size(width: Any, height: Any) -> tuple[int, int]:
    """(width, height) from numbers or their text; ValueError if they are not whole numbers of px."""
    found = float(width), float(height)
    if not all(n == round(n) and 0 < n < WIDEST for n in found):
        raise ValueError(f"an image of {width} x {height} px")
    return int(found[0]), int(found[1])


#: what camcal writes for itself, in a comment, into files of formats that know no px
SIZE_SAID = re.compile(r"image of (\d+)x(\d+) px")


def size_said(source: Source) -> tuple[int, int] | None:
    """The image size, for formats that do not store it: from the command line or camcal's own comment."""
    found = SIZE_SAID.search(source.text or "")
    return source.image_size or (image_size(found[1], found[2]) if found else None)


def size_needed(source: Source) -> tuple[int, int]:
    """The same, for formats whose lengths depend on it; DataError if it is not given."""
    size = size_said(source)
    if size is None:
        raise DataError(
            "the image size is missing.",
            "Give --image-size WxH, or in a command without that option first run: camcal convert FILE "
            "cam.yaml --image-size WxH",
        )
    return size


def floats(value: Any, count: int | tuple[int, ...] | None = None, what: str = "entry") -> Array:
    """A flat array of finite numbers; ValueError if there are not `count` of them."""
    found = np.asarray(value, float).ravel()
    counts = (count,) if isinstance(count, int) else count
    if counts is not None and len(found) not in counts:
        raise ValueError(f"{what} has {len(found)} numbers, {' or '.join(map(str, counts))} are needed")
    if not np.isfinite(found).all():
        raise ValueError(f"{what} holds a number that is not finite")
    return found


def matrix_values(k: Any) -> tuple[float, float, float, float, float]:
    """(fx, fy, cx, cy, skew) of a camera matrix of nine numbers, row by row."""
    m = floats(k, 9, "the camera matrix").reshape(3, 3)
    if m[2, 2] == 0 or m[1, 0] != 0 or m[2, 0] != 0 or m[2, 1] != 0:
        raise ValueError("the camera matrix is not upper triangular")
    m = m / m[2, 2]
    return m[0, 0], m[1, 1], m[0, 2], m[1, 2], m[0, 1]


def number(value: float) -> str:
    """A number with all its digits in a form that is always read as a float: 832.5, 3.0, 1e-05."""
    return repr(float(value))
