"""The report of `camcal wand`."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from camcal.data.formats import files
from camcal.data.labelled import Labelled, read_labelled
from camcal.errors import DataError, UsageError
from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.model.pose import Pose
from camcal.peers.triangulate_points import against_cv2
from camcal.report.camera import camera_entry, sigma_entry
from camcal.report.routes import (
    bundle_entry,
    document,
    outside_picture,
    principal_point_assumed,
    warning,
)
from camcal.routes.placed import PlacedCamera
from camcal.routes.triangulate import sorted_images, triangulate
from camcal.routes.wand import WandCalibration, estimate
from camcal.routes.wand_fit import Sightings
from camcal.settings.rig import check_names
from camcal.solve.parameters import nominal

Array = np.ndarray

_FRAME = re.compile(r"\d+:(.+)")  # a point of DLTdv's table, whose instant is part of its name


def report(
    path: Path,
    bar: Sequence[float],
    cameras: Mapping[str, Any],
    model: str,
    fix: Mapping[str, float | None],
    image_size: Mapping[str, tuple[int, int]],
    seed: int,
    crosscheck: bool,
    command: Sequence[str],
    bar_sigma: float | None = None,
) -> dict[str, Any]:
    """Calibrate from the tracks of a bar's markers.

    Raises
    ------
    DataError
        A table without two cameras, markers other than those of the bar, a camera file that cannot be read.
    UsageError
        If a camera has neither a file nor an image size.
    """
    table = read_labelled(path, ("camera", "view", "point"))
    seen, twice = _sightings(table, bar)
    names = table.names["camera"]
    check_names(cameras, names, "--cameras")
    check_names(image_size, names, "--image-size")
    given = [_given(n, i, cameras, model, fix, image_size) for i, n in enumerate(names)]
    found = estimate(seen, [c for c, _ in given], [k for _, k in given], fix, names, seed)
    if bar_sigma is not None:
        found = found.with_bar_sigma(bar_sigma / float(np.ptp(seen.places)))
    views = table.names["view"]
    lengths = _lengths(found, seen)
    sections = {
        "cameras": {n: _camera(i, found) for i, n in enumerate(names)},
        "rig": _rig(found, names),
        "fit": bundle_entry(found.iterations, found.converged, found.wand.residuals(seen), found.used),
        "wand": {
            "bar": [float(p) for p in seen.places],
            "bar_sigma": bar_sigma,
            "instants": len(views),
            "instants_used": len(np.unique(seen.instant[found.used])),
            "length": {
                "given": float(np.ptp(seen.places)),
                "mean": float(lengths.mean()) if len(lengths) else None,
                "std": float(lengths.std(ddof=1)) if len(lengths) > 1 else None,
            },
            "left_out": _left_out(found, seen, names, views, table.names["point"]),
        },
    }
    checks = _checks(found, seen) if crosscheck else []
    return document(command, None, sections, checks, _warnings(found, seen, views, twice))


def _sightings(table: Labelled, bar: Sequence[float]) -> tuple[Sightings, int]:
    """The images, sorted by instant, and the number of duplicates removed."""
    if len(table.names["camera"]) < 2:
        raise DataError(
            f"'{table.path}' holds one camera; two or more are needed.", "Give tracks of all cameras."
        )
    plain = [_marker(n) for n in table.names["point"]]
    markers = sorted(set(plain), key=_natural)
    places = [0.0, bar[0]] if len(bar) == 1 else list(bar)
    if len(markers) != len(places):
        raise DataError(
            f"'{table.path}' holds {len(markers)} markers ({', '.join(markers[:5])}); the bar has {len(places)}.",
            "Give --bar LENGTH for two markers, or the position of each along the bar: --bar 0,0.2,0.5.",
        )
    marker = np.array([markers.index(p) for p in plain])[table.labels["point"]]
    camera, instant = table.labels["camera"], table.labels["view"]
    key = np.stack([instant, camera, marker])
    first = np.unique(key, axis=1, return_index=True)[1]  # sorted by instant
    seen = Sightings(camera[first], instant[first], marker[first], table.uv[first], np.array(places))
    return seen, len(table) - len(first)


def _marker(name: str) -> str:
    found = _FRAME.fullmatch(name)
    return found[1] if found else name


def _natural(name: str) -> list[tuple[int, str]]:
    """A sort key by the numbers inside, so that pt10 comes after pt2."""
    return [(int(p), "") if p.isdigit() else (-1, p) for p in re.split(r"(\d+)", name) if p]


def _given(
    name: str,
    index: int,
    cameras: Mapping[str, Any],
    model: str,
    fix: Mapping[str, float | None],
    sizes: Mapping[str, tuple[int, int]],
) -> tuple[Camera, bool]:
    """A camera, and whether it is known."""
    if name in cameras:
        known = files.read(Path(cameras[name])).cameras
        if len(known) != 1:
            raise DataError(
                f"'{cameras[name]}' holds {len(known)} cameras; one is needed.", "Give one camera."
            )
        return files.exact(known[0].camera), True
    size = sizes.get(name, sizes.get(""))
    if size is None:
        raise UsageError(
            f"neither the camera '{name}' nor the size of its pictures is given.",
            f"Give --cameras {name}=CAMERA, or --image-size WxH.",
        )
    return nominal(lenses.make(model), size, fix), False


def _camera(index: int, found: WandCalibration) -> dict[str, Any]:
    camera, free = found.wand.cameras[index], found.frees[index]
    sigma = np.sqrt(np.maximum(np.diagonal(found.camera_covariance(index)), 0)).tolist()
    fixed = [n for n, row in zip(camera.lens.names, free, strict=True) if not row.any()]
    return camera_entry(
        camera, dict(zip(camera.lens.names, sigma, strict=True)), found.start[index].values, fixed
    )


def _rig(found: WandCalibration, names: Sequence[str]) -> dict[str, Any]:
    sigma = np.sqrt(np.maximum(np.diagonal(found.covariance), 0))
    begin = sum(f.shape[1] for f in found.frees)
    poses = {}
    for index, name in enumerate(names[1:], 1):
        own = sigma[begin + 6 * (index - 1) :][:6]
        poses[name] = found.wand.poses[index].entry() | sigma_entry(own)
    baselines = {}
    for a, b in combinations(range(len(names)), 2):
        length, spread = found.baseline(a, b)
        baselines[f"{names[a]}-{names[b]}"] = {"value": length, "sigma": spread}
    # the middle of the volume for the origin: DLT coefficients need one that lies before every camera
    middle = np.nanmean(found.wand.points, axis=0)
    world = Pose(np.eye(3), middle).entry()
    return {"reference": names[0], "cam_from_rig": poses, "baselines": baselines, "rig_from_world": world}


def _placed(found: WandCalibration) -> list[PlacedCamera]:
    pairs = zip(found.wand.cameras, found.wand.poses, strict=True)
    return [PlacedCamera(str(i), c, p) for i, (c, p) in enumerate(pairs)]


def _lengths(found: WandCalibration, seen: Sightings) -> Array:
    """The distances (T,) of the outer markers, each triangulated separately, which the fit does not constrain."""
    part = seen.take(found.used)
    outer = np.array([part.places.argmin(), part.places.argmax()])
    part = part.take(np.isin(part.marker, outer))
    key = part.instant * 2 + (part.marker == outer[1])
    names, point = np.unique(key, return_inverse=True)
    images, _ = sorted_images(part.camera, point, part.uv)
    xyz = triangulate(_placed(found), images, len(names)).xyz
    at = {int(k): i for i, k in enumerate(names)}
    pairs = [
        (at[2 * t], at[2 * t + 1])
        for t in np.unique(part.instant).tolist()
        if {2 * t, 2 * t + 1} <= at.keys()
    ]
    made = np.array([np.linalg.norm(xyz[a] - xyz[b]) for a, b in pairs])
    return made[np.isfinite(made)]


def _left_out(
    found: WandCalibration, seen: Sightings, names: Sequence[str], views: Sequence[str], points: Sequence[str]
) -> list[dict[str, Any]]:
    markers = sorted({_marker(p) for p in points}, key=_natural)
    off = np.linalg.norm(found.wand.residuals(seen), axis=1)
    return [
        {
            "camera": names[seen.camera[row]],
            "view": views[seen.instant[row]],
            "point": markers[seen.marker[row]],
            "residual": float(off[row]) if np.isfinite(off[row]) else None,
        }
        for row in np.flatnonzero(~found.used)
    ]


def _checks(found: WandCalibration, seen: Sightings) -> list[dict[str, Any]]:
    """cv2.triangulatePoints compared with camcal on the two cameras that share the most markers."""
    key = seen.instant * len(seen.places) + seen.marker
    rows = [
        {int(key[r]): r for r in np.flatnonzero((seen.camera == c) & found.used)}
        for c in range(len(found.wand.cameras))
    ]
    a, b = max(combinations(range(len(rows)), 2), key=lambda p: len(rows[p[0]].keys() & rows[p[1]].keys()))
    shared = sorted(rows[a].keys() & rows[b].keys())
    if not shared:
        return []
    uv = [seen.uv[[rows[c][k] for k in shared]] for c in (a, b)]
    order = np.arange(len(shared))
    images, _ = sorted_images(np.repeat([0, 1], len(shared)), np.r_[order, order], np.concatenate(uv))
    pair = [_placed(found)[c] for c in (a, b)]
    again = triangulate(pair, images, len(shared))
    sides = [(c.camera, c.pose, own) for c, own in zip(pair, uv, strict=True)]
    return [against_cv2(sides[0], sides[1], again.xyz)]


def _warnings(
    found: WandCalibration, seen: Sightings, views: Sequence[str], twice: int
) -> list[dict[str, str]]:
    made = []
    for index, camera in enumerate(found.wand.cameras):
        made += outside_picture(seen.uv[found.used & (seen.camera == index)], camera.image_size)
    if found.assumed:
        made.append(
            principal_point_assumed(
                "the bar leaves",
                found.assumed,
                "Move the bar through the whole picture, or give the camera (--cameras NAME=CAMERA).",
            )
        )
    lost = len(views) - len(np.unique(seen.instant[found.used]))
    if lost:
        made.append(
            warning(
                "instants-left-out",
                f"{lost} of {len(views)} instants are not used: too few cameras see their markers, or these disagree.",
                "`wand.left_out` names the images.",
                "note",
            )
        )
    if twice:
        made.append(
            warning(
                "points-twice",
                f"{twice} images are of a marker that the camera already has.",
                "The first of them is used.",
                "note",
            )
        )
    return made
