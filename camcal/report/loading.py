"""Reports and camera files read back: a `Solution`, or a `Camera` alone."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np

from camcal.assess.warning import CalibrationWarning
from camcal.data.formats.camcal import camera_of_entry
from camcal.data.formats.files import read, single
from camcal.data.observations import Observations, SkippedView
from camcal.errors import CamcalError, DataError
from camcal.geometry import rotations
from camcal.model.camera import Camera
from camcal.model.pose import Poses
from camcal.plan.solution import Solution
from camcal.report.embedded import decode
from camcal.report.yaml import read_document
from camcal.schema import Report, check, structure
from camcal.solve.board import KINDS, Board, BoardProblem, common_points, make_board
from camcal.solve.calibration import Fit, NormalBlocks, ShapedBoard, Stage
from camcal.solve.problem import Problem
from camcal.solve.refine import on_board, residuals

Array = np.ndarray


def load(path: str | os.PathLike) -> Solution:
    """Read a report back.

    Camera, observations and masks are those that were written, to the last bit; residuals and normal blocks
    are computed from them.

    Raises
    ------
    DataError
        Where the file is missing, no camcal report, of a newer schema, or damaged.
    """
    found = read_document(path)
    check(found, str(path))
    return from_document(found, str(path))


def from_document(found: Mapping[str, Any], source: str = "report") -> Solution:
    """The solution of a document that `document` made."""
    if "track" in found:
        raise DataError(
            f"'{source}' is a report of `camcal track`: it holds a camera, but no views that could be judged.",
            "Give it where a camera is asked for (evaluate, compare, convert, undistort, track --camera).",
        )
    structure(Report, found, source)
    with _damage(source):
        camera = camera_of_entry(found["camera"])
        start, free = _start_and_free(found["camera"], camera)
        entries = found["views"]
        seen, places = decode(found["data"], [e["id"] for e in entries])
        poses = _poses([entries[i] for i in places])
        data = _with_inputs(seen, found, entries)
        board = _board(found["target"], data)
        normal = _normal(camera, free, poses, data, board)
        return Solution(
            camera=camera,
            poses=poses,
            observations=data,
            residuals=residuals(camera, poses, data),
            start=start,
            free=np.c_[free, np.zeros((len(free), len(normal.intrinsics) - free.shape[1]))],
            normal=normal,
            fit=_fit(found["fit"]),
            stages=tuple(_stage(s) for s in found["stages"]),
            warnings=tuple(CalibrationWarning(w["code"], w["message"], w["hint"]) for w in found["warnings"]),
            options=found["options"],
            crosscheck=tuple(found["crosscheck"]),
            holdout=found["holdout"],
            board=board,
        )


def load_camera(path: str | os.PathLike) -> Camera:
    """Read one camera from a camera file of any format; `FILE#NAME` is the camera NAME of a file with several.

    Raises
    ------
    DataError
        Where the file holds no camera, several, or one that camcal has no lens model for.
    """
    return single(read(path), os.fspath(path))


@contextmanager
def _damage(source: str) -> Any:
    """Say of any missing or misshapen entry that the file is damaged."""
    try:
        yield
    except CamcalError:
        raise
    except (KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
        what = f"'{error.args[0]}' is missing" if isinstance(error, KeyError) else str(error)
        raise DataError(f"'{source}' is damaged: {what}.", "Make the report again.") from error


def _start_and_free(entry: Mapping[str, Any], camera: Camera) -> tuple[Camera, Array]:
    given = [entry["parameters"][name] for name in camera.lens.names]
    start = np.array([p["start"] for p in given], float)
    free = np.eye(len(given))[:, [not p["fixed"] for p in given]]
    if "free_directions" in entry:
        free = np.array(entry["free_directions"], float).reshape(len(given), -1)
    return Camera(camera.lens, start, camera.image_size), free


def _poses(entries: Sequence[Mapping[str, Any]]) -> Poses:
    given = [e["cam_from_board"] for e in entries]
    vectors = np.array([g["rotation_vector"] for g in given], float).reshape(-1, 3)
    return Poses(rotations.exp(vectors), np.array([g["translation"] for g in given], float).reshape(-1, 3))


def _with_inputs(seen: Observations, found: Mapping[str, Any], entries: list) -> Observations:
    inputs, size = found["inputs"], found["inputs"]["image_size"]
    return replace(
        seen,
        image_sizes=(None if size is None else (int(size[0]), int(size[1])),),
        target=found["target"],
        skipped=tuple(
            SkippedView(e["id"], e["status"], e["reason"], e["points"], e["rms_point"])
            for e in entries
            if e["status"] != "used"
        ),
        files=tuple(inputs["files"]),
        picture_quality={e["id"]: e["quality"] for e in entries if "quality" in e},
    )


def _board(target: Mapping[str, Any] | None, seen: Observations) -> ShapedBoard | None:
    """The estimated shape of the board, where the report has one; a given shape is part of the points."""
    shape = (target or {}).get("shape") or {}
    if shape.get("kind") not in KINDS:
        return None
    square = float((target or {}).get("square") or 1.0)
    points, ideal = (np.array(shape[k], float) * square for k in ("points", "ideal"))
    # what a shape may do follows from the ideal board, so that it is the same as in the calibration
    flat = on_board(seen.kept(), points, ideal)
    board = make_board(flat.views, shape["kind"])
    return ShapedBoard(shape["kind"], ideal, points, board.size, board.basis)


def _normal(
    camera: Camera, free: Array, poses: Poses, seen: Observations, board: ShapedBoard | None
) -> NormalBlocks:
    """The normal equations at the solution; with a board's shape, in offsets from the shape found."""
    used = seen.kept()
    kept, weights = used.views, None if used.precision is None else used.split(used.precision)
    if board is None:
        problem = Problem(camera.lens, kept, free, weights)
    else:
        assert board.basis is not None
        common = common_points(kept)
        assert common is not None  # or `_board` would have said so
        problem = BoardProblem(camera.lens, kept, free, Board(*common, board.kind, board.basis), weights)
    blocks = problem.linearise(problem.state(camera.params, poses))
    if blocks is None:
        raise DataError("a used point lies outside the lens's domain.", "The report is damaged.")
    return blocks.normal()


def _fit(entry: Mapping[str, Any]) -> Fit:
    return Fit(
        entry["optimizer"],
        entry["loss"],
        entry["iterations"],
        entry["evaluations"],
        entry["converged"],
        entry["stop_reason"],
        entry["cost"],
        entry["seconds"],
        info=entry["info"] or {},
    )


def _stage(entry: Mapping[str, Any]) -> Stage:
    def array(value: Any) -> Array | None:
        return None if value is None else np.array(value, float)

    return Stage(
        entry["name"],
        float("nan") if entry["rms_point"] is None else entry["rms_point"],
        array(entry["matrix"]),
        entry["seconds"],
        array(entry.get("projection_matrix")),
        info=entry.get("info", {}),
    )
