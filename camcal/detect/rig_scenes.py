"""Pictures of arbitrary scenes by the cameras of a rig, instant by instant, and the points that they share."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import combinations
from pathlib import Path

import numpy as np

from camcal.detect.decode import UnreadableError
from camcal.detect.frames import Film, is_film
from camcal.detect.listing import list_pictures, view_ids
from camcal.detect.matches import between, points_of
from camcal.detect.rig_images import NUMBER, match
from camcal.detect.sources import read_gray
from camcal.errors import DataError

Array = np.ndarray
#: (camera, camera) -> pixels (N, 2) of corresponding points in each
Shared = Mapping[tuple[str, str], tuple[Array, Array]]


def shared_points(
    folders: Mapping[str, Sequence[str | os.PathLike]],
    sizes: Mapping[str, tuple[int, int] | None],
    every: int | None = None,
    on_progress: Callable[[int, int], object] = lambda done, count: None,
) -> Iterator[tuple[str, Shared]]:
    """Yield (instant, matches of each pair of cameras) of pictures, or of one film per camera, in order of time.

    Parameters
    ----------
    folders : mapping of camera -> folders, files, patterns
        Pictures are grouped into instants by name as by `detect_rig`; films are read in parallel.
    sizes : mapping of camera -> (width, height) or None
        Required size of their pictures.
    every : int, optional
        Use every n-th frame of films, or instant of pictures.
    on_progress : callable
        Called with the number of instants done and their total, or 0 if films do not state it.

    Raises
    ------
    DataError
        If pictures cannot be read, have another size, or cannot be grouped into instants.
    """
    listed = {name: list_pictures(paths) for name, paths in folders.items()}
    films = {name: [p for p in own if is_film(p)] for name, own in listed.items()}
    if not any(films.values()):
        instants, count = _of_pictures(listed, every or 1), max(map(len, listed.values()))
    elif all(len(listed[n]) == len(own) == 1 for n, own in films.items()):
        instants, count = _of_films({n: own[0] for n, own in films.items()}, every or 1), 0
    else:
        raise DataError(
            "films and pictures of a rig cannot be mixed: each camera needs one film, or pictures.",
            "Try: left=left.mp4 right=right.mp4",
        )
    for done, (instant, pictures) in enumerate(instants, 1):
        on_progress(done, count)
        for name, picture in pictures.items():
            size = sizes.get(name)
            if size is not None and picture.shape[::-1] != tuple(size):
                raise DataError(
                    f"camera '{name}', {instant}: the picture is {picture.shape[1]}x{picture.shape[0]}, "
                    f"the camera was calibrated for {size[0]}x{size[1]}.",
                    "Were the names of the cameras exchanged?",
                )
        points = {name: points_of(picture) for name, picture in pictures.items()}
        yield (
            instant,
            {
                (a, b): between(pictures[a], pictures[b], points[a], points[b])
                for a, b in combinations(pictures, 2)
            },
        )


def _of_pictures(listed: Mapping[str, list[Path]], every: int) -> Iterator[tuple[str, Mapping[str, Array]]]:
    ids = {name: view_ids(own) for name, own in listed.items()}
    found = match(ids)
    at: dict[str, dict[str, Path]] = {}
    for name, own in listed.items():
        for view, path in zip(ids[name], own, strict=True):
            at.setdefault(found[name][view], {})[name] = path
    order = sorted(at, key=lambda i: ([int(n) for n in NUMBER.findall(i)], i))
    for instant in order[::every]:
        yield instant, {name: _read(path) for name, path in at[instant].items()}


def _read(path: Path) -> Array:
    try:
        return read_gray(path)[0]
    except UnreadableError as error:
        raise DataError(f"{path}: {error}.", "Leave the picture out.") from error


def _of_films(paths: Mapping[str, Path], every: int) -> Iterator[tuple[str, Mapping[str, Array]]]:
    """Frames of the same number, until one film ends."""
    films: dict[str, Film] = {}
    try:
        for name, path in paths.items():
            try:
                films[name] = Film(path)
            except UnreadableError as error:
                raise DataError(f"{path}: {error}.", "Give another film.") from error
        number = 0
        while all(film.walk(number) for film in films.values()):
            frames = {name: film.read() for name, film in films.items()}
            there = {name: frame for name, frame in frames.items() if frame is not None}
            if len(there) < len(frames):
                return
            yield str(number), there
            number += every
    finally:
        for film in films.values():
            film.close()
