"""The calibration of a rig as a document: `cameras` and `rig` instead of `camera`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from typing import Any

import numpy as np

from camcal.assess.covariance import Covariance, covariance
from camcal.assess.rig import baseline_sigma, board_sigmas, relative_sigmas
from camcal.data.boards import movable, names_of
from camcal.plan.solution import RigSolution
from camcal.report.camera import sigma_entry
from camcal.report.document import assembled, camera_of_fit, skipped_entry, used_view
from camcal.report.embedded import encode

Array = np.ndarray


def document(
    solution: RigSolution, *, command: Sequence[str] = (), options: Mapping[str, Any] | None = None
) -> dict[str, Any]:
    """Make the report of a rig, of plain Python types, in the order of the schema.

    Parameters
    ----------
    solution : RigSolution
    command : sequence of str
        The words after `camcal`, as typed.
    options : mapping, optional
        `{name: {value, from}}`; without it the solution's own options.
    """
    data = solution.observations
    accuracy = covariance(solution)
    views, places = _views(solution, accuracy)
    inputs = {
        "image_size": data.image_size,
        "image_sizes": dict(zip(data.cameras, data.image_sizes, strict=True)),
        "instants": list(data.view_ids),
        "views": len(views),
        "points": data.point_count,
        "files": list(data.files),
    }
    return assembled(
        solution,
        accuracy,
        command=command,
        options=options,
        inputs=inputs,
        subject={"cameras": _cameras(solution, accuracy), "rig": rig_section(solution, accuracy)},
        views=views,
        data=encode(replace(data, view=data.block_of_row), places),
    )


def compact_document(solution: RigSolution, command: Sequence[str] = ()) -> dict[str, Any]:
    """The rig, its error figures and the verdict alone: a camera file rather than a full report."""
    whole = document(solution, command=command)
    left_out = (
        "stages",
        "views",
        "data",
        "selection",
        "crosscheck",
        "uncertainty",
        "bias",
        "coverage",
        "grade",
    )
    return {key: value for key, value in whole.items() if key not in left_out}


def _cameras(solution: RigSolution, accuracy: Covariance) -> dict[str, Any]:
    sigmas, found, row = accuracy.sigmas, {}, 0
    for name, camera in solution.rig.cameras.items():
        own = {p: sigmas[f"{name}.{p}"] for p in camera.lens.names}
        free = solution.free[row : row + camera.lens.size]
        found[name] = camera_of_fit(camera, own, solution.start.cameras[name], free)
        row += camera.lens.size
    return found


def rig_section(solution: RigSolution, accuracy: Covariance) -> dict[str, Any]:
    """The poses of the cameras and their distances, with standard deviations if they were estimated."""
    rig, names = solution.rig, list(solution.rig.cameras)
    held = not solution.extrinsics
    poses, baselines = {}, {}
    for name in names[1:]:
        pose = rig.cam_from_rig[name]
        sigma = None if held else relative_sigmas(solution, accuracy, name)
        poses[name] = pose.entry() | sigma_entry(sigma)
    for a, b in combinations(names, 2):
        known = None if held else baseline_sigma(solution, accuracy, a, b)
        baselines[f"{a}-{b}"] = {"value": rig.baseline(a, b), "sigma": known}
    boards = _boards(solution, accuracy)
    return {"reference": rig.reference, "cam_from_rig": poses, "baselines": baselines} | (
        {"boards": boards} if boards else {}
    )


def _boards(solution: RigSolution, accuracy: Covariance) -> dict[str, Any]:
    """The poses of the boards that were estimated together with the cameras."""
    target = solution.observations.target or {}
    names, groups, found = names_of(target), target.get("board_groups") or (), {}
    for index, sigma in zip(movable(target), board_sigmas(solution, accuracy), strict=False):
        found[names[index]] = {
            "reference": names[groups.index(groups[index])],
            **target["board_poses"][index],
            **sigma_entry(sigma),
        }
    return found


def _views(solution: RigSolution, accuracy: Covariance) -> tuple[list[dict[str, Any]], list[int]]:
    """The entries of all pictures, camera by camera, and the index of each block's among them."""
    data, rig = solution.observations, solution.rig
    entries, at = [], []
    for block, (camera, view) in enumerate(zip(data.blocks.camera, data.blocks.view, strict=True)):
        pose = rig.cam_from_rig[data.cameras[camera]] @ solution.poses[view]
        entry = used_view(solution, block, data.picture(block), pose, None)
        entry = {
            "id": entry.pop("id"),
            "camera": data.cameras[camera],
            "instant": data.view_ids[view],
            **entry,
        }
        entry["rig_from_board"] = solution.poses[view].entry()
        quality = data.picture_quality.get(entry["id"])
        entries.append(entry | ({"quality": quality} if quality else {}))
        at.append(len(entries) - 1)
    for view in data.skipped:
        entry = skipped_entry(view)
        entries.append({"id": entry.pop("id"), "camera": view.camera, **entry})
    order = sorted(range(len(entries)), key=lambda i: data.cameras.index(entries[i]["camera"]))
    return [entries[i] for i in order], [order.index(i) for i in at]
