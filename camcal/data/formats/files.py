"""Camera files of any format: recognition, reading and checks; writing, reading back and comparison."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from camcal.data.formats import FORMATS, format_of
from camcal.data.formats.base import CameraFile, ForeignCamera, Format, Written
from camcal.data.formats.checks import checked, damage, distinct
from camcal.data.formats.gaps import Gap, gap
from camcal.data.formats.source import Source
from camcal.errors import CamcalError, DataError, UsageError
from camcal.model.camera import Camera
from camcal.model.rectification import PERSPECTIVE, rectify
from camcal.registry import load, look_up
from camcal.system.text import listed

#: px; two cameras that a file should hold exactly may differ by the rounding of its numbers: 1e-12 of 1e4 px
EXACT = 1e-6


def formats() -> Iterator[Format]:
    """All formats, in the order in which they are tried on a file."""
    return (load(path) for path in FORMATS.values())


def named_format(name: str) -> Format:
    """A format by its name; UsageError with the closest name if it is unknown."""
    return look_up(FORMATS, name, "format")


def read(
    path: str | os.PathLike, name: str | None = None, image_size: tuple[int, int] | None = None
) -> CameraFile:
    """Read the cameras of a file.

    Parameters
    ----------
    path : path
        `FILE#NAME` stands for the camera NAME of FILE, where no file has that name.
    name : str, optional
        The format; found out from the content otherwise.
    image_size : (width, height), optional
        Of cameras whose file does not state it.

    Raises
    ------
    DataError
        If the file is missing, damaged, of no known format, or names a model that is not known.
    """
    file, chosen = split_name(path)
    source = Source(file, image_size=image_size)
    form = named_format(name) if name else recognised(source)
    found = parsed(form, source)
    found = found if chosen is None else select(found, chosen, str(file))
    return found if image_size is None else _filled(found, image_size)


def _filled(found: CameraFile, size: tuple[int, int]) -> CameraFile:
    """The cameras with the given image size where the file has none."""
    cameras = (
        c if c.camera.image_size is not None else replace(c, camera=replace(c.camera, image_size=size))
        for c in found.cameras
    )
    return replace(found, cameras=tuple(cameras))


def check_size(camera: Any, size: tuple[int, int] | None, source: str) -> None:
    """UsageError if the command line gives another image size than the file of a camera."""
    known = camera.image_size
    if size is not None and known is not None and tuple(known) != tuple(size):
        raise UsageError(
            f"--image-size {size[0]}x{size[1]}, but '{source}' says {known[0]}x{known[1]}.",
            "Leave --image-size out.",
        )


def split_name(path: str | os.PathLike) -> tuple[Path, str | None]:
    """FILE and NAME of `FILE#NAME`; NAME is None if there is none, or if a file has that whole name."""
    text = os.fspath(path)
    name, mark, camera = text.rpartition("#")
    if mark and camera and not Path(text).exists():
        return Path(name), camera
    return Path(text), None


def recognised(source: Source) -> Format:
    """The format of a file, recognised by its content.

    Raises
    ------
    DataError
        If no format is recognised.
    """
    for form in formats():
        with damage(source, form.title):
            if form.sniff(source):
                return form
    raise DataError(
        f"'{source.path}' holds no camera that camcal can read: no entry belongs to a known format.",
        "`camcal list formats` names them; a camcal report has 'schema: camcal-report/1'.",
    )


def parsed(form: Format, source: Source) -> CameraFile:
    """The checked cameras of a file of a known format."""
    # a quotient by a 0 of the file is damage like any other, not a warning of numpy's
    with damage(source, form.title), np.errstate(divide="raise", over="raise", invalid="raise"):
        found = form.read(source)
        if not found.cameras:
            raise DataError("it holds no camera.", "Is it the right file?")
        named = distinct(found.cameras)
        return replace(found, cameras=tuple(checked(c) for c in named))


def select(found: CameraFile, name: str, source: str) -> CameraFile:
    """The file reduced to one camera; DataError for a name that it does not contain."""
    chosen = tuple(c for c in found.cameras if c.name == name)
    if not chosen:
        raise DataError(f"'{source}' has no camera '{name}'.", f"It has: {', '.join(found.names[:20])}.")
    return replace(found, cameras=chosen)


def single(found: CameraFile, source: str) -> Camera:
    """The only camera of a file, or the one that all its entries share.

    Raises
    ------
    DataError
        If there are several, or where camcal has no exact counterpart of the lens.
    """
    cameras = [c.camera for c in found.cameras]
    first = exact(cameras[0])
    for other in cameras[1:]:
        if isinstance(other, ForeignCamera) or not _same(first, other):
            names = listed(found.names, 8)
            raise DataError(
                f"'{source}' holds {len(cameras)} cameras ({names}); one is needed.",
                f"Name it: '{source}#{found.names[0]}', or --camera {found.names[0]} with `camcal convert`.",
            )
    return first


def _same(a: Camera, b: Camera) -> bool:
    return a.lens == b.lens and a.image_size == b.image_size and np.array_equal(a.params, b.params)


def exact(camera: Any) -> Camera:
    """The camera if camcal has an exact counterpart of its lens; otherwise a DataError that names what is missing."""
    if isinstance(camera, ForeignCamera):
        lens = camera.lens
        raise DataError(
            f"{lens.name}: {lens.reason}.",
            "Refit it, with the error printed: camcal convert FILE OUT --to-model NAME.",
        )
    return camera


def target_format(path: str | os.PathLike, name: str | None) -> Format:
    """The format to write, by its name or from the file name extension.

    Raises
    ------
    UsageError
        If neither says it, or the format can only be read.
    """
    known = name or format_of(path)
    if known is None:
        suffix = Path(path).suffix or "no ending"
        raise UsageError(
            f"the extension of '{path}' ({suffix}) does not determine the format.",
            "Give --to FORMAT; `camcal list formats` names them.",
        )
    form = named_format(known)
    if form.write is None:
        raise UsageError(
            f"{form.title} can be read but not written.", "`camcal list formats` shows which can."
        )
    return form


def write(
    path: str | os.PathLike, cameras: CameraFile, name: str | None = None, force: bool = False
) -> dict[str, Gap]:
    """Write cameras and read them back; return the difference by the path of each file.

    Parameters
    ----------
    path : path
        With `{camera}` in its name, a file for each camera.
    name : str, optional
        The format; from the ending of the file's name otherwise.

    Raises
    ------
    UsageError
        If the format has no room for a term, for several cameras or for poses, or the file exists.
    """
    from camcal.data.writing import atomic_write, check_writable

    form = target_format(path, name)
    text = os.fspath(path)
    if form.rectified:
        cameras = with_rectification(cameras)
    parts = {text: cameras}
    if "{camera}" in text:
        parts = {text.replace("{camera}", c.name): replace(cameras, cameras=(c,)) for c in cameras.cameras}
    made: dict[str, str | bytes] = {}
    gaps = {}
    for target, part in parts.items():
        content = rendered(form, part, Path(target))
        gaps[target] = _read_back(form, part, Path(target), content)
        made[target] = content.content
        made |= {str(Path(target).with_name(n)): c for n, c in content.beside.items()}
    for target in made:
        check_writable(target, force)
    for target, data in made.items():
        atomic_write(target, data, force)
    return gaps


def with_rectification(cameras: CameraFile) -> CameraFile:
    """A pair of cameras with R and P of each if it can be rectified to perspective pictures; others unchanged."""
    if len(cameras.cameras) != 2 or not cameras.has_poses:
        return cameras
    first, second = cameras.cameras
    assert first.pose is not None and second.pose is not None
    pair = exact(first.camera), exact(second.camera), second.pose @ first.pose.inverse()
    try:
        found = rectify(*pair, alpha=0.0, projection=PERSPECTIVE)
    except CamcalError:  # one behind the other, or without an image size: the file is complete without it
        return cameras
    m = found.matrices()
    made = (replace(c, rectification=(m[f"R{i}"], m[f"P{i}"])) for i, c in enumerate((first, second), 1))
    return replace(cameras, cameras=tuple(made))


def rendered(form: Format, cameras: CameraFile, path: Path) -> Written:
    """The contents to write, for a format that can represent all of them."""
    assert form.write is not None
    if len(cameras.cameras) > 1 and not form.several:
        raise UsageError(
            f"{form.title} holds one camera per file; {len(cameras.cameras)} were given.",
            f"Choose one (--camera {cameras.names[0]}), or write a file for each camera: "
            f"{path.stem}-{{camera}}{path.suffix}",
        )
    for named in cameras.cameras:
        camera = exact(named.camera)
        if form.size and camera.image_size is None:
            raise UsageError(
                f"{form.title} needs the image size; the file of camera '{named.name}' does not state it.",
                "Give --image-size WxH.",
            )
    found = form.write(cameras, path.suffix.lower())
    return found if isinstance(found, Written) else Written(found)


def _read_back(form: Format, cameras: CameraFile, path: Path, content: Written) -> Gap:
    """Read back what the writer wrote; a difference is a bug, and nothing is written."""
    data = content.content
    source = Source(path, data.encode() if isinstance(data, str) else data)
    source.beside = content.beside
    source.image_size = cameras.cameras[0].camera.image_size
    again = parsed(form, source)
    found = gap(cameras, again)
    if not (found.max_px <= EXACT and found.rotation <= EXACT and found.shift <= EXACT):
        raise RuntimeError(f"{form.title}: what was written differs by {found} when it is read back")
    return found
