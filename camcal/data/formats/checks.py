"""Checks of cameras that a file contains; errors that name the file."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import numpy as np

from camcal.data.formats.base import WIDEST, NamedCamera, one_line
from camcal.data.formats.source import Source
from camcal.errors import CamcalError, DataError
from camcal.model.camera import Camera
from camcal.model.pose import Pose

#: how far a matrix of a file may be from a rotation: files with four digits are read
ROTATION = 1e-3
#: ... and up to which its entries are left as they are: the rounding of a product of two of them
ROUNDING = 1e-15


@contextmanager
def damage(source: Source, title: str) -> Iterator[None]:
    """Convert any error of a reader into one that names the file; missing entries mean that it is damaged."""
    try:
        yield
    except CamcalError as error:
        where = "" if str(source.path) in error.message else f"{source.path}: "
        raise type(error)(one_line(where + error.message), error.hint) from None
    except (KeyError, StopIteration) as error:
        what = repr(error.args[0]) if error.args else "an entry"
        raise DataError(f"{source.path}: {what} is missing ({title}).", "Is the file complete?") from None
    except (
        ValueError,
        TypeError,
        struct.error,
        IndexError,
        AttributeError,
        ArithmeticError,
        RecursionError,
        MemoryError,
    ) as error:
        text = one_line(str(error)).rstrip(".") or type(error).__name__
        raise DataError(
            f"{source.path}: not readable as {title}: {text[:200]}.", "Is the file damaged?"
        ) from None


def distinct(cameras: tuple[NamedCamera, ...]) -> list[NamedCamera]:
    """The cameras with unique names: the second `left` becomes `left-2`."""
    seen: dict[str, int] = {}
    found = []
    for camera in cameras:
        name = one_line(str(camera.name)).strip() or "camera"
        seen[name] = seen.get(name, 0) + 1
        found.append(replace(camera, name=name if seen[name] == 1 else f"{name}-{seen[name]}"))
    return found


def checked(named: NamedCamera) -> NamedCamera:
    """A camera after checking its values: finite, focal lengths above 0, within the bounds of its lens."""
    camera, pose = named.camera, named.pose
    size = camera.image_size
    if size is not None and not all(0 < n < WIDEST for n in size):
        raise DataError(f"camera '{named.name}': an image of {size[0]}x{size[1]} px.", "Is the file damaged?")
    if isinstance(camera, Camera):
        if not np.isfinite(camera.params).all():
            raise DataError(f"camera '{named.name}': a parameter is not finite.", "Is the file damaged?")
        for parameter, value in zip(camera.lens.parameters, camera.params.tolist(), strict=True):
            least = np.nextafter(0, 1) if parameter.group == "focal" else parameter.lower
            if not least <= value <= parameter.upper:
                raise DataError(
                    f"camera '{named.name}': {parameter.name} = {value:g} is outside the range of the "
                    f"model '{camera.lens.name}'.",
                    "Is the file damaged?",
                )
    return named if pose is None else replace(named, pose=rigid(pose, named.name))


def rigid(pose: Pose, name: str) -> Pose:
    """A pose with an exactly orthonormal rotation; DataError if the matrix is not a rotation."""
    r, t = np.asarray(pose.rotation, float).reshape(3, 3), np.asarray(pose.translation, float).reshape(3)
    if not (np.isfinite(r).all() and np.isfinite(t).all()):
        raise DataError(f"camera '{name}': its pose is not finite.", "Is the file damaged?")
    away = float(np.abs(r @ r.T - np.eye(3)).max())
    if away > ROTATION or np.linalg.det(r) < 0:
        raise DataError(
            f"camera '{name}': its rotation matrix is not a rotation.", "Is it transposed or mirrored?"
        )
    if away > ROUNDING:
        u, _, vt = np.linalg.svd(r)
        r = u @ vt
    return Pose(r, t)
