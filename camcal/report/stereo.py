"""Pairs of cameras of a rig and their pictures: rectification, and evaluation on arbitrary pictures."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from camcal.data.formats import files
from camcal.data.formats.camcal import rig_entry
from camcal.detect.decode import UnreadableError, as_gray
from camcal.detect.listing import list_pictures
from camcal.detect.matches import matches
from camcal.detect.resample import read_pictures
from camcal.errors import DataError, UsageError
from camcal.model.pose import Pose
from camcal.model.rectification import Rectification, rectify
from camcal.records import dataclass
from camcal.report.camera import camera_entry
from camcal.report.routes import document, warning
from camcal.routes.natural import Natural, judge, turn_of
from camcal.settings.rig import split_camera
from camcal.system.text import counted

Array = np.ndarray

#: below this number the median is itself uncertain: its sigma is 1.25 / sqrt(N) of that of a match, 18 % at 50
FEW = 50
#: the median vertical disparity is this many times that of noise: three quarters of its square are then errors of the
#: calibration
EXCESS = 2.0
#: px; below this it is negligible: block matching resolves 1/16 px along a row, and searches whole rows only
MATTERS = 0.1


@dataclass(frozen=True)
class Pair:
    """Two cameras of a rig, the one on the left (or on top) first, and their pictures, in pairs.

    Attributes
    ----------
    names : (str, str)
    geometry : Rectification
    pictures : tuple of (Path, Path)
    """

    names: tuple[str, str]
    geometry: Rectification
    pictures: tuple[tuple[Path, Path], ...]


def load_pair(path: str | os.PathLike, words: Sequence[str], **layout: Any) -> Pair:
    """Two cameras of a rig from arguments NAME=PICTURES; `layout` goes to `camcal.model.rectification.rectify`.

    Raises
    ------
    UsageError
        If the words are not two names of cameras with pictures.
    DataError
        If the file has no such cameras, no poses, or the pictures are not the same number of each.
    """
    given = _named(words)
    rig = files.read(path)
    poses = {}
    for name in given:
        named = next((c for c in rig.cameras if c.name == name), None)
        if named is None:
            raise DataError(f"'{path}' has no camera '{name}'.", f"It has: {', '.join(rig.names[:20])}.")
        if named.pose is None:
            raise DataError(f"'{path}' has no pose of the camera '{name}'.", "Give the file of a rig.")
        poses[name] = (files.exact(named.camera), named.pose)
    first, second = given
    pair = _laid_out(poses[first], poses[second], layout)
    if pair.shift > 0:  # the first camera is to the right of the other, or below
        first, second = second, first
        pair = _laid_out(poses[first], poses[second], layout)
    a, b = (list_pictures([p]) for p in (given[first], given[second]))
    if len(a) != len(b):
        raise DataError(
            f"'{first}' has {counted(len(a), 'picture')} and '{second}' {len(b)}; pairs are needed.",
            "Give one picture of each, or folders with the same number, in the same order.",
        )
    return Pair((first, second), pair, tuple(zip(a, b, strict=True)))


def _named(words: Sequence[str]) -> dict[str, str]:
    given = dict(pair for w in words if (pair := split_camera(w)) is not None)
    if len(given) != 2 or len(words) != 2:
        raise UsageError(
            f"pictures of two cameras are needed, NAME=PICTURES each; found: {' '.join(words) or 'none'}.",
            "Try: left=left.png right=right.png, with the names of the rig's cameras",
        )
    return given


def _laid_out(first: tuple[Any, Pose], second: tuple[Any, Pose], layout: Mapping[str, Any]) -> Rectification:
    return rectify(first[0], second[0], second[1] @ first[1].inverse(), **layout)


def read_pair(pair: Pair, index: int) -> tuple[Array, Array]:
    """Both pictures of a pair as they are stored.

    Raises
    ------
    DataError
        If one is unreadable or of another size than its camera's.
    """
    found = []
    for (path, picture), camera in zip(
        read_pictures(pair.pictures[index]), pair.geometry.cameras, strict=True
    ):
        if isinstance(picture, UnreadableError):
            raise DataError(f"{path}: {picture}.", "Give another picture.")
        if picture.shape[1::-1] != camera.image_size:
            size, own = ("x".join(map(str, s or ())) for s in (picture.shape[1::-1], camera.image_size))
            raise DataError(
                f"{path}: the picture is {size}, the camera was calibrated for {own}.",
                "Were the names of the cameras exchanged?",
            )
        found.append(picture)
    return found[0], found[1]


def section(pair: Pair, alpha: float) -> dict[str, Any]:
    """The document's `rectification`."""
    made = pair.geometry
    return {
        "cameras": list(pair.names),
        "direction": ("horizontal", "vertical")[made.axis],
        "projection": made.projection,
        "alpha": alpha,
        "image_size": made.image_size,
        "focal": made.focal,
        "centre": made.centre,
        "baseline": abs(made.shift),
        **made.matrices(),
    }


def natural(
    path: str | os.PathLike,
    words: Sequence[str],
    max_rms: float | None,
    command: Sequence[str],
    fail_on: str = "wrong",
) -> dict[str, Any]:
    """The report of a rig evaluated on arbitrary pictures.

    The verdict is fail where `max_rms`, px, is exceeded, or with `fail_on` doubtful where points lie off their rows.

    Raises
    ------
    DataError
        If a picture cannot be read, or a pair shares too few points.
    """
    pair = load_pair(path, words)  # at the scale of the pictures
    found = []
    for index, (a, b) in enumerate(pair.pictures):
        first, second = (as_gray(p) for p in read_pair(pair, index))
        found.append(judge(pair.geometry, *matches(first, second), f"{a.name} and {b.name}"))
    off = np.concatenate([f.vertical[f.good] for f in found])
    noise = np.concatenate([f.noise[f.good] for f in found])
    made = {
        "cameras": list(pair.names),
        **_figures(off, noise),
        "found": sum(len(f.good) for f in found),
        "pairs": [_entry(pair, i, f) for i, f in enumerate(found)],
    }
    turn = turn_of(
        pair.geometry,
        np.concatenate([f.first[f.good] for f in found]),
        np.concatenate([f.second[f.good] for f in found]),
    )
    made["turn"] = {
        "camera": pair.names[1],
        "rotation_vector_deg": np.degrees(turn.vector),
        "sigma_deg": np.degrees(turn.sigma),
        "median_after": turn.left,
    }
    rms = made["vertical_disparity"]["rms"]
    failed = max_rms is not None and rms > max_rms
    failures = [f"vertical disparity {rms:.4g} px rms exceeds {max_rms:g}"] if failed else []
    warnings = _warnings(made)
    if fail_on == "doubtful":
        failures += [w["message"].rstrip(".") for w in warnings if w["severity"] == "doubtful"]
    rig = files.read(path)
    sections = {
        "cameras": {c.name: camera_entry(c.camera, fixed=list(c.camera.lens.names)) for c in rig.cameras},
        "rig": rig_entry(rig),
        "natural": made,
    }
    return document(command, None, sections, warnings=warnings, failures=failures)


def _figures(off: Array, noise: Array) -> dict[str, Any]:
    size = np.abs(off)
    return {
        "matches": len(off),
        "vertical_disparity": {
            "median": float(np.median(size)),
            "p95": float(np.quantile(size, 0.95)),
            "rms": float(np.sqrt(np.mean(off**2))),
            "mean": float(off.mean()),
        },
        "noise": {"median": float(np.median(np.abs(noise))), "rms": float(np.sqrt(np.mean(noise**2)))},
    }


def _entry(pair: Pair, index: int, found: Natural) -> dict[str, Any]:
    good = found.good
    disparity = found.disparity[good]
    return {
        **dict(zip(pair.names, (p.name for p in pair.pictures[index]), strict=True)),
        **_figures(found.vertical[good], found.noise[good]),
        "found": len(good),
        "disparity": {"least": float(disparity.min()), "most": float(disparity.max())},
    }


def _warnings(made: Mapping[str, Any]) -> list[dict[str, str]]:
    found = []
    if made["matches"] < FEW:
        found.append(
            warning(
                "few-matches",
                f"{made['matches']} matches: too few for a reliable figure.",
                "Take pictures with more texture, or give several pairs.",
                "note",
            )
        )
    median, noise = made["vertical_disparity"]["median"], made["noise"]["median"]
    if median > max(EXCESS * noise, MATTERS):
        found.append(
            warning(
                "vertical-disparity",
                f"the points lie {median:.3g} px off their rows (median); noise explains {noise:.3g} px.",
                "The cameras have moved relative to each other, or the rig was calibrated poorly: calibrate it again. "
                + _turned(made["turn"]),
            )
        )
    return found


def _turned(turn: Mapping[str, Any]) -> str:
    size, sigma = (float(np.linalg.norm(turn[k])) for k in ("rotation_vector_deg", "sigma_deg"))
    return f"Rotating {turn['camera']} by {size:.3g} ± {sigma:.1g} degrees would leave {turn['median_after']:.3g} px."


def natural_table(made: Mapping[str, Any]) -> Any:
    """A table with a row for each pair of pictures, and one for all together."""
    from rich.console import Group
    from rich.table import Table

    rows = Table("pictures", "matches", "median, px", "p95, px", "noise, px", box=None, pad_edge=False)
    named = [(f"{p[made['cameras'][0]]}, {p[made['cameras'][1]]}", p) for p in made["pairs"]]
    for name, figures in [*named, ("all", made)] if len(named) > 1 else named:
        off, noise = figures["vertical_disparity"], figures["noise"]
        cells = (off["median"], off["p95"], noise["median"])
        rows.add_row(name, str(figures["matches"]), *(f"{x:.3g}" for x in cells))
    return Group("vertical disparity of matches that agree with each other", rows)
