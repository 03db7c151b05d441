"""Observations of several cameras: a table with a column `camera`, and single cameras put together and taken apart."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from camcal.data.labelled import Labelled, read_labelled
from camcal.data.observations import NO_ID, Observations
from camcal.errors import DataError

Array = np.ndarray


@dataclass(frozen=True)
class RigViews:
    """What each camera of a rig saw, and which of its views are of the same instant.

    Attributes
    ----------
    parts : mapping of camera -> Observations of that camera
    instants : mapping of camera -> mapping of view id -> instant
    order : tuple of str
        The instants, in their order.
    """

    parts: Mapping[str, Observations]
    instants: Mapping[str, Mapping[str, str]]
    order: tuple[str, ...]

    @classmethod
    def of(cls, data: Observations | Mapping[str, Observations] | RigViews, least: int = 2) -> RigViews:
        """Those of observations of several cameras, or of one each, in which the same view is the same instant.

        Raises
        ------
        DataError
            Where there are fewer than `least` cameras.
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
                "a rig has two or more cameras; there is one.", "Use camcal.calibrate for one camera."
            )
        same = {name: {v: v for v in part.view_ids} for name, part in parts.items()}
        return cls(parts, same, order)

    def ordered(self, first: str) -> RigViews:
        """The same with another camera first."""
        names = [first, *(n for n in self.parts if n != first)]
        return replace(self, parts={n: self.parts[n] for n in names})


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
        and id (or point). The same view is the same instant for all cameras.
    image_sizes : (width, height), or mapping of camera -> (width, height), optional
        In a mapping, that of "" is for all others.
    least : int
        How many cameras there have to be.

    Raises
    ------
    DataError
        Where the file cannot be read, a camera has a point of a view twice, or there is one camera only.
    """
    found = read_labelled(path, ("camera", "view"), (*"XYZ", "u", "v"), ("sigma", "point"))
    names = found.names["camera"]
    if len(names) < least:
        raise DataError(
            f"'{path}' holds the points of one camera, '{names[0]}'; a rig has two or more.",
            f"For a single camera: camcal estimate {path}",
        )
    order = np.lexsort((found.labels["view"], found.labels["camera"]))
    sizes = image_sizes if isinstance(image_sizes, Mapping) else dict.fromkeys(names, image_sizes)
    sigma = found.values.get("sigma")
    made = Observations(
        xyz=np.stack([found.values[c] for c in "XYZ"], 1)[order],
        uv=found.uv[order],
        view=found.labels["view"][order],
        view_ids=found.names["view"],
        camera=found.labels["camera"][order],
        cameras=names,
        point=None if "point" not in found.names else _point_ids(found)[order],
        sigma=None if sigma is None else sigma[order],
        image_sizes=tuple(sizes.get(n, sizes.get("")) for n in names),
        files=({"path": str(path), "sha256": hashlib.sha256(Path(path).read_bytes()).hexdigest()},),
    )
    _check_once(made, found, order)
    return made


def _point_ids(found: Labelled) -> Array:
    """The numbers of the points (N,): as they stand there, or counted where one is no whole number."""
    names = found.names["point"]
    try:
        numbers = np.array([int(n) for n in names])
    except ValueError:
        numbers = np.arange(len(names))
    return numbers[found.labels["point"]]


def _check_once(made: Observations, found: Labelled, order: Array) -> None:
    """Refuse a point that a picture has twice."""
    columns = made.xyz.T if made.point is None else made.point[None].astype(float)
    keys = np.column_stack([made.camera, made.view, *columns])
    _, first, count = np.unique(keys, axis=0, return_index=True, return_counts=True)
    if (count > 1).any():
        row = first[count > 1][0]
        camera, view = made.cameras[made.camera[row]], made.view_ids[made.view[row]]
        raise DataError(
            f"{found.path}:{found.rows[order[row]]}: camera '{camera}' has this point twice in view '{view}'.",
            "Remove one of the rows; points at one place need ids.",
        )


def of_camera(data: Observations, name: str) -> Observations:
    """The observations of one of the cameras: only the views that it saw."""
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
    """The observations of single cameras as those of a rig.

    Parameters
    ----------
    parts : mapping of camera -> Observations
        In the order in which the rig is to have them.
    instants : mapping of camera -> mapping of view id -> instant
        Which views are of the same instant.
    order : sequence of str
        The instants, in their order; those that no camera saw are left out.
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
    pictures = {
        (name, instants[name][v]): v
        for name, part in parts.items()
        for v in part.view_ids
        if v != instants[name][v]
    }
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
        pictures=pictures,
    )


def _files(parts: Sequence[Observations]) -> tuple[Mapping[str, str], ...]:
    """The files of all, each once."""
    return tuple({f["path"]: f for p in parts for f in p.files}.values())
