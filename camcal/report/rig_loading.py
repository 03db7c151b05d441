"""Reading of rig reports: a `RigSolution` with its data."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from camcal.data.formats.camcal import camera_of_entry, pose_of_entry
from camcal.data.observations import Observations
from camcal.errors import DataError
from camcal.model.pose import Poses
from camcal.model.rig import Rig
from camcal.plan.rig_cameras import solution_within
from camcal.plan.solution import RigSolution, Solution
from camcal.report.embedded import decode
from camcal.report.loading import damage, inputs_of, judged, start_and_free
from camcal.report.loading import from_document as solution_of_document
from camcal.report.yaml import read_document
from camcal.schema import Report, check, structure
from camcal.schema.kinds import UNSET


def load_rig(path: str | os.PathLike) -> RigSolution:
    """Read the report of a rig, with its data.

    Raises
    ------
    DataError
        If the file is missing, not a report of a rig with its data, or damaged.
    """
    found = read_document(path)
    check(found, str(path))
    return from_document(found, str(path))


def load_solution(path: str | os.PathLike) -> Solution | RigSolution:
    """Read the report of a camera or a rig; `FILE#NAME` is one camera of a rig, at the joint estimate.

    Raises
    ------
    DataError
        If the file is missing, not a report, or damaged, or has no such camera.
    """
    name, mark, camera = os.fspath(path).rpartition("#")
    file = name if mark and not Path(path).exists() else os.fspath(path)
    found = read_document(file)
    check(found, file)
    if not is_rig_report(found):
        return solution_of_document(found, file)
    rig = from_document(found, file)
    if file == os.fspath(path):
        return rig
    if camera not in rig.rig.cameras:
        raise DataError(f"'{file}' has no camera '{camera}'.", f"It has: {', '.join(rig.rig.cameras)}.")
    return solution_within(rig, camera)


def is_rig_report(found: Mapping[str, Any]) -> bool:
    """Return whether a document is a report of `camcal rig`."""
    return "cameras" in found and "rig" in found and "data" in found


def from_document(found: Mapping[str, Any], source: str = "report") -> RigSolution:
    """The solution of a document that `camcal.report.rig.document` made."""
    if not is_rig_report(found):
        raise DataError(
            f"'{source}' is not a report of a rig with its data.", "Give a report of `camcal rig`."
        )
    report = structure(Report, found, source)
    assert report.cameras is not UNSET and report.rig is not UNSET  # type: ignore[comparison-overlap]
    with damage(source):
        cameras = {n: camera_of_entry(e, source, f"cameras.{n}") for n, e in found["cameras"].items()}
        sections: Mapping[str, Any] = report.cameras  # type: ignore[assignment]
        begun = {n: start_and_free(sections[n], c) for n, c in cameras.items()}
        places = {n: pose_of_entry(e) for n, e in found["rig"]["cam_from_rig"].items()}
        rig = Rig(cameras, places, found["rig"]["reference"])
        data, poses = _data(report, found)
        return RigSolution(
            rig=rig,
            start=replace(rig, cameras={n: c for n, (c, _) in begun.items()}),
            **judged(report, found, rig, [f for _, f in begun.values()], poses, data),
        )


def _data(report: Report, found: Mapping[str, Any]) -> tuple[Observations, Poses]:
    """The observations, and rig_from_board of their instants."""
    seen, places = decode(report.data, [v.id for v in report.views])
    names = list(found["cameras"])
    views = [found["views"][i] for i in places]
    instants = list(
        dict.fromkeys(v["instant"] for v in sorted(views, key=lambda v: _rank(found, v["instant"])))
    )
    at = {instant: i for i, instant in enumerate(instants)}
    boards = {v["instant"]: pose_of_entry(v["rig_from_board"]) for v in views}
    data = replace(
        seen,
        view=np.array([at[v["instant"]] for v in views], int)[seen.view],
        view_ids=tuple(instants),
        camera=np.array([names.index(v["camera"]) for v in views], int)[seen.view],
        cameras=tuple(names),
        image_sizes=tuple(
            tuple(c["image_size"]) if c["image_size"] else None for c in found["cameras"].values()
        ),
        **inputs_of(report, found),
        pictures={(v["camera"], v["instant"]): v["id"] for v in views if v["id"] != v["instant"]},
    )
    return data, Poses.stack([boards[i] for i in instants])


def _rank(found: Mapping[str, Any], instant: str) -> int:
    """The rank of an instant among all that the report names."""
    order = found["inputs"].get("instants") or []
    return order.index(instant) if instant in order else len(order)
