"""The pictures of the cameras of a rig: listing, search for one target, and grouping into instants."""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from itertools import combinations
from typing import Any

from camcal.data.boards import by_board
from camcal.data.observations import Observations
from camcal.data.rig_table import RigViews
from camcal.detect.images import detect_images
from camcal.detect.listing import list_pictures, view_ids
from camcal.errors import CamcalError, DataError

OnEvent = Callable[[str, Mapping[str, Any]], None]
#: splits a name into text and integers
NUMBER = re.compile(r"\d+")
#: two cameras that share more than this fraction of their pictures have copies; single ones may be black in both
SAME = 0.5


def detect_rig(
    folders: Mapping[str, Sequence[str | os.PathLike]], on_event: OnEvent | None = None, **options: Any
) -> RigViews:
    """Find the target in the pictures of several cameras.

    Parameters
    ----------
    folders : mapping of camera -> folders, files, patterns
    on_event : callable, optional
        As for `detect_images`.
    **options
        Those of `detect_images`. Without a target, the one in the pictures of the first camera is used for all.

    Raises
    ------
    DataError
        As `detect_images`, naming the camera; if it cannot be determined which pictures of different cameras are of
        the same instant.
    """
    listed = {name: _listed(name, paths) for name, paths in folders.items()}
    spec: list[str] = []

    def listen(event: str, details: Mapping[str, Any]) -> None:
        if event == "target":
            spec.append(details["spec"])
        if on_event is not None:
            on_event(event, details)

    parts: dict[str, Observations] = {}
    for name, paths in folders.items():
        if spec:  # the target of the first camera
            options = {**options, "target": spec[0], "board": None, "square": None}
        try:
            parts[name] = detect_images(paths, **options, on_event=listen)
        except CamcalError as error:
            raise type(error)(f"camera '{name}': {error.message}", error.hint) from error
    _check_own_pictures(parts)
    split = {name: by_board(part) for name, part in parts.items()}
    shown = {name: list(dict.fromkeys(pictures.values())) for name, (_, pictures, _) in split.items()}
    found = match({name: _searched(listed[name], shown[name], part) for name, part in parts.items()})
    instants = {
        name: {**found[name], **{v: found[name][p] for v, p in pictures.items()}}
        for name, (_, pictures, _) in split.items()
    }
    boards = {name: own for name, (_, _, own) in split.items() if own}
    return RigViews({n: data for n, (data, _, _) in split.items()}, instants, _order(found), boards)


def _check_own_pictures(parts: Mapping[str, Observations]) -> None:
    """Raise a DataError if two cameras were given pictures of the same content."""
    contents = {name: {f["sha256"] for f in part.files} for name, part in parts.items()}
    for a, b in combinations(contents, 2):
        same = len(contents[a] & contents[b])
        if same > SAME * min(len(contents[a]), len(contents[b])):
            raise DataError(
                f"cameras '{a}' and '{b}' were given the same pictures: {same} of {len(contents[a])} and "
                f"{len(contents[b])}.",
                "Give each camera its own pictures.",
            )


def _searched(listed: Sequence[str], shown: Sequence[str], part: Observations) -> list[str]:
    """The searched pictures, in the order of the list; frames of films, which are not in it, by number."""
    found = [*shown, *(s.id for s in part.skipped)]
    if set(found) <= set(listed):
        return [n for n in listed if n in set(found)]
    return sorted(found, key=lambda n: ([int(k) for k in NUMBER.findall(n)], n))


def _listed(name: str, paths: Sequence[str | os.PathLike]) -> list[str]:
    try:
        return view_ids(list_pictures(paths))
    except CamcalError as error:
        raise type(error)(f"camera '{name}': {error.message}", error.hint) from error


def match(pictures: Mapping[str, Sequence[str]]) -> dict[str, dict[str, str]]:
    """The instant of each picture, by camera and name.

    Pictures are of the same instant if their names are equal; otherwise if the numbers that vary within the names of
    each camera are equal; otherwise by their order, if all cameras have the same number of pictures.

    Raises
    ------
    DataError
        If none of these applies.
    """
    for key in (_by_name, _by_numbers):
        keys = {camera: key(names) for camera, names in pictures.items()}
        if all(len(set(k)) == len(k) for k in keys.values()) and _overlap(list(keys.values())):
            return {c: dict(zip(pictures[c], keys[c], strict=True)) for c in pictures}
    counts = {c: len(names) for c, names in pictures.items()}
    if len(set(counts.values())) == 1:
        return {c: {n: str(i + 1) for i, n in enumerate(names)} for c, names in pictures.items()}
    said = ", ".join(f"{c} {n}" for c, n in counts.items())
    raise DataError(
        f"the pictures cannot be grouped into instants: their names do not agree, and their numbers differ ({said}).",
        "Give pictures of the same instant the same number: left01.jpg and right01.jpg.",
    )


def _by_name(names: Sequence[str]) -> list[str]:
    return [n.rpartition(".")[0] or n for n in names]


def _by_numbers(names: Sequence[str]) -> list[str]:
    """The numbers in each name that vary among the names of the camera."""
    found = [[str(int(n)) for n in NUMBER.findall(name)] for name in names]
    if len({len(f) for f in found}) != 1 or not found[0]:
        return ["" for _ in names]
    varies = [i for i in range(len(found[0])) if len({f[i] for f in found}) > 1] or [len(found[0]) - 1]
    return ["-".join(f[i] for i in varies) for f in found]


def _overlap(keys: Sequence[Sequence[str]]) -> bool:
    """Return whether each camera shares instants with another one."""
    count = Counter(k for own in keys for k in set(own))
    return all(any(count[k] > 1 for k in own) for own in keys)


def _order(instants: Mapping[str, Mapping[str, str]]) -> tuple[str, ...]:
    """The instants in numerical order, otherwise in the order given."""
    found = dict.fromkeys(i for own in instants.values() for i in own.values())
    numbers = {i: [int(n) for n in NUMBER.findall(i)] for i in found}
    return tuple(sorted(found, key=lambda i: (numbers[i], i)))
