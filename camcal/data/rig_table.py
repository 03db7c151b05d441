"""Observations of several cameras: tables with a column `camera`; joining and separating single cameras."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping, Sequence
from dataclasses import field, replace
from pathlib import Path
from typing import Any

import numpy as np

from camcal.data.boards import by_board, names_of, picture_name, view_name
from camcal.data.labelled import Labelled, read_labelled
from camcal.data.observations import NO_ID, Observations
from camcal.errors import DataError
from camcal.records import dataclass

Array = np.ndarray


@dataclass(frozen=True)
class RigViews:
    """The views of each camera of a rig, and which of them belong to the same instant.

    Attributes
    ----------
    parts : mapping of camera -> Observations of that camera
    instants : mapping of camera -> mapping of view id -> instant
    order : tuple of str
        The instants, in their order.
    boards : mapping of camera -> mapping of view id -> board
        Which of several boards a view shows, counted from 0; empty where there is one.
    """

    parts: Mapping[str, Observations]
    instants: Mapping[str, Mapping[str, str]]
    order: tuple[str, ...]
    boards: Mapping[str, Mapping[str, int]] = field(default_factory=dict)

    @classmethod
    def of(cls, data: Observations | Mapping[str, Observations] | RigViews, least: int = 2) -> RigViews:
        """Make the views from observations of several cameras, or of one each; the same view is the same instant.

        Raises
        ------
        DataError
            If there are fewer than `least` cameras.
        """
        if isinstance(data, RigViews):
            return data
        if isinstance(data, Observations):
            parts = {name: of_camera(data, name) for name in data.cameras}
            order = data.view_ids
        else:
            parts = dict(data)
            order = tuple(dict.fromkeys(v for p in parts.values() for v in p.view_ids))
        if all(v.lstrip("-").isdecimal() for v in order):  # frames, in the order of time
            order = tuple(sorted(order, key=int))
        if len(parts) < least:
            raise DataError(
                "a rig has two or more cameras; one was found.", "Use camcal.calibrate for one camera."
            )
        split = {name: by_board(part) for name, part in parts.items()}
        return cls(
            {name: data for name, (data, _, _) in split.items()},
            {name: instants for name, (_, instants, _) in split.items()},
            order,
            {name: boards for name, (_, _, boards) in split.items() if boards},
        )

    @property
    def usual_board_shape(self) -> str:
        """The default of `board_shape`: auto if all cameras saw a printed target, otherwise flat."""
        return "auto" if all(part.is_printed for part in self.parts.values()) else "flat"

    def ordered(self, first: str) -> RigViews:
        """Return the same views with another camera first."""
        names = [first, *(n for n in self.parts if n != first)]
        return replace(self, parts={n: self.parts[n] for n in names})

    def apart(self, groups: Sequence[int]) -> RigViews:
        """Return the same views with a separate instant for each group of rigidly connected boards.

        Parameters
        ----------
        groups : sequence of int
            The group of each board.
        """
        if len(set(groups)) < 2:
            return self
        names = names_of(next(iter(self.parts.values())).target)
        called = {g: names[groups.index(g)] for g in groups}  # by the first of its boards
        instants = {
            name: {
                v: view_name(i, called[groups[self.boards[name][v]]]) if v in self.boards[name] else i
                for v, i in own.items()  # pictures without a board have no view
            }
            for name, own in self.instants.items()
        }
        order = tuple(view_name(i, called[g]) for i in self.order for g in dict.fromkeys(groups))
        return replace(self, instants=instants, order=order)

    def shifted(self, lags: Mapping[str, int]) -> RigViews:
        """Correct lags: the k-th instant back takes the views of a camera that is k frames late."""
        place = {instant: i for i, instant in enumerate(self.order)}
        moved: dict[str, dict[str, int]] = {
            name: {v: place[i] - lags.get(name, 0) for v, i in own.items()}
            for name, own in self.instants.items()
        }
        used = [i for own in moved.values() for i in own.values()]
        # what lies before the first instant or after the last one gets a number of its own
        called = {i: self.order[i] if 0 <= i < len(self.order) else f"{i:+d}" for i in used}
        instants = {name: {v: called[i] for v, i in own.items()} for name, own in moved.items()}
        return replace(self, instants=instants, order=tuple(called[i] for i in sorted(called)))


def read_rig(
    path: str | os.PathLike,
    image_sizes: Mapping[str, tuple[int, int]] | tuple[int, int] | None = None,
    least: int = 2,
) -> Observations:
    """Read the points that several cameras saw.

    Parameters
    ----------
    path : path
        A table with a first row that names its columns: camera, view, X, Y, Z, u, v and, where there are any, sigma
        and id (or point), and board. The same view is the same instant for all cameras; X, Y, Z are in the frame of
        the row's board.
    image_sizes : (width, height), or mapping of camera -> (width, height), optional
        In a mapping, that of "" is for all others.
    least : int
        The minimum number of cameras.

    Returns
    -------
    Observations
        Rows sorted by camera, then view.

    Raises
    ------
    DataError
        If the file cannot be read, a camera has a point of a view twice, or there is one camera only.
    """
    found = read_labelled(path, ("camera", "view"), (*"XYZ", "u", "v"), ("sigma", "point", "board"))
    names = found.names["camera"]
    if len(names) < least:
        raise DataError(
            f"'{path}' holds the points of one camera, '{names[0]}'; a rig has two or more.",
            f"For a single camera: camcal estimate {path}",
        )
    order = np.lexsort((found.labels["view"], found.labels["camera"]))
    sizes = image_sizes if isinstance(image_sizes, Mapping) else dict.fromkeys(names, image_sizes)
    sigma = found.values.get("sigma")
    ids, target = _identified(found)
    made = Observations(
        xyz=np.stack([found.values[c] for c in "XYZ"], 1)[order],
        uv=found.uv[order],
        view=found.labels["view"][order],
        view_ids=found.names["view"],
        camera=found.labels["camera"][order],
        cameras=names,
        point=None if ids is None else ids[order],
        sigma=None if sigma is None else sigma[order],
        image_sizes=tuple(sizes.get(n, sizes.get("")) for n in names),
        target=target,
        files=({"path": str(path), "sha256": hashlib.sha256(Path(path).read_bytes()).hexdigest()},),
    )
    _check_once(made, found, order)
    return made


def _identified(found: Labelled) -> tuple[Array | None, dict[str, Any] | None]:
    """The ids of the points (N,), and the target's entries of its boards; None for what the table does not have.

    Points of several boards are counted: those of a board follow one another.
    """
    names = found.names.get("board", ())
    if len(names) < 2:
        return (_point_ids(found) if "point" in found.names else None), None
    board = found.labels["board"]
    own = (
        _point_ids(found)[:, None]
        if "point" in found.names
        else np.stack([found.values[c] for c in "XYZ"], 1)
    )
    keys, ids = np.unique(np.c_[board, own], axis=0, return_inverse=True)
    first = np.searchsorted(keys[:, 0], np.arange(len(names)))
    return ids.reshape(-1), {"boards": list(names), "first_ids": first.tolist()}


def _point_ids(found: Labelled) -> Array:
    """The ids of the points (N,): the table's, or counted if one is not a whole number."""
    names = found.names["point"]
    try:
        numbers = np.array([int(n) for n in names])
    except ValueError:
        numbers = np.arange(len(names))
    return numbers[found.labels["point"]]


def _check_once(made: Observations, found: Labelled, order: Array) -> None:
    """Reject a point that a picture has twice."""
    columns = made.xyz.T if made.point is None else made.point[None].astype(float)
    keys = np.column_stack([made.camera, made.view, *columns])
    _, first, count = np.unique(keys, axis=0, return_index=True, return_counts=True)
    if (count > 1).any():
        row = first[count > 1][0]
        camera, view = made.cameras[made.camera[row]], made.view_ids[made.view[row]]
        raise DataError(
            f"{found.path}:{found.rows[order[row]]}: camera '{camera}' has this point twice in view '{view}'.",
            "Remove one of the rows; points at the same position need ids.",
        )


def of_camera(data: Observations, name: str) -> Observations:
    """The observations of one camera: only the views that it saw."""
    index = data.cameras.index(name)
    rows = data.camera == index
    alone = replace(
        data.where(rows),
        camera=np.zeros(int(rows.sum()), int),
        cameras=("camera",),
        image_sizes=(data.image_sizes[index],),
        skipped=tuple(replace(s, camera=None) for s in data.skipped if s.camera in (None, name)),
        pictures={},
    )
    return alone.of_views(np.unique(alone.view))


def joined(
    parts: Mapping[str, Observations], instants: Mapping[str, Mapping[str, str]], order: Sequence[str]
) -> Observations:
    """Join the observations of single cameras into those of a rig.

    Parameters
    ----------
    parts : mapping of camera -> Observations
        In the order in which the rig is to have them.
    instants : mapping of camera -> mapping of view id -> instant
        Which views are of the same instant.
    order : sequence of str
        The instants, in their order; those that no camera saw are omitted.
    """
    seen = {instants[name][v] for name, part in parts.items() for v in part.view_ids}
    ids = tuple(i for i in order if i in seen)
    place = {instant: i for i, instant in enumerate(ids)}
    rows, columns = [], []
    for part, name in ((p, n) for n, p in parts.items()):
        views = np.array([place[instants[name][v]] for v in part.view_ids], int)[part.view]
        rows.append(np.argsort(views, kind="stable"))
        columns.append(views)

    def stack(values: Sequence[Array]) -> Array:
        return np.concatenate([v[r] for v, r in zip(values, rows, strict=True)])

    def optional(field: str, default: float) -> Array | None:
        values = [getattr(p, field) for p in parts.values()]
        if all(v is None for v in values):
            return None
        counts = [p.point_count for p in parts.values()]
        return stack([np.full(n, default) if v is None else v for v, n in zip(values, counts, strict=True)])

    given = list(parts.values())
    return Observations(
        xyz=stack([p.xyz for p in given]),
        uv=stack([p.uv for p in given]),
        view=stack(columns),
        view_ids=ids,
        camera=np.repeat(np.arange(len(given)), [p.point_count for p in given]),
        cameras=tuple(parts),
        point=optional("point", NO_ID),
        sigma=optional("sigma", np.nan),
        weight=optional("weight", 1.0),
        used=stack([p.used for p in given]),
        reason=stack([p.reason for p in given]),
        image_sizes=tuple(p.image_size for p in given),
        target=given[0].target,
        skipped=tuple(replace(s, camera=name) for name, p in parts.items() for s in p.skipped),
        files=_files(given),
        picture_quality={k: v for p in given for k, v in p.picture_quality.items()},
        pictures=_pictures(parts, instants),
    )


def _pictures(
    parts: Mapping[str, Observations], instants: Mapping[str, Mapping[str, str]]
) -> dict[tuple[str, str], str]:
    """The name of each picture, by camera and instant, if it differs from the name of its instant."""
    found: dict[tuple[str, str], str] = {}
    for name, part in parts.items():
        for view in part.view_ids:
            key = name, instants[name][view]
            found[key] = picture_name(view) if key in found else view  # with two boards that were views
    return {key: view for key, view in found.items() if view != key[1]}


def _files(parts: Sequence[Observations]) -> tuple[Mapping[str, str], ...]:
    """The files of all cameras, each once."""
    return tuple({f["path"]: f for p in parts for f in p.files}.values())
