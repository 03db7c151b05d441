"""Reading of reports and camera files: a `Solution`, or a `Camera` alone."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np

from camcal.assess.known import Promise
from camcal.assess.warning import CalibrationWarning
from camcal.data.boards import frames, names_of
from camcal.data.formats.camcal import camera_of_entry
from camcal.data.formats.files import read, single
from camcal.data.observations import Observations, SkippedView
from camcal.errors import CamcalError, DataError
from camcal.geometry import rotations
from camcal.model.camera import Camera
from camcal.model.pose import Poses
from camcal.model.rig import Rig
from camcal.plan.solution import Solution
from camcal.report.embedded import decode
from camcal.report.yaml import read_document
from camcal.schema import Report, check, structure
from camcal.schema import report as schema
from camcal.schema.camera import Camera as Section
from camcal.schema.kinds import UNSET
from camcal.schema.views import BoardShape, Shape, Target, View
from camcal.solve.board import KINDS, Board, BoardProblem, make_board
from camcal.solve.board_points import by_number, on_board, shaped_board
from camcal.solve.calibration import Fit, NormalBlocks, ShapedBoard, Stage
from camcal.solve.common_points import common_points
from camcal.solve.problem import Problem, Seen
from camcal.solve.refine import placed_boards, residuals
from camcal.solve.several_boards import Several
from camcal.solve.subject import cameras_of, rig_poses

Array = np.ndarray


def load(path: str | os.PathLike) -> Solution:
    """Read a report.

    Camera, observations and masks are those that were written, to the last bit; residuals and normal blocks
    are computed from them.

    Raises
    ------
    DataError
        If the file is missing, not a camcal report, of a newer schema, or damaged.
    """
    found = read_document(path)
    check(found, str(path))
    return from_document(found, str(path))


def from_document(found: Mapping[str, Any], source: str = "report") -> Solution:
    """The solution of a document that `document` made."""
    if "track" in found:
        raise DataError(
            f"'{source}' is a report of `camcal track`: it has a camera, but no views to evaluate.",
            "Use it where a camera is expected (evaluate, compare, convert, undistort, track --camera).",
        )
    if "cameras" in found and "rig" in found:
        raise DataError(
            f"'{source}' is the report of a rig; that of one camera is needed.",
            f"Its cameras: {', '.join(f'{source}#{name}' for name in found['cameras'])}.",
        )
    report = structure(Report, found, source)
    if not isinstance(report.camera, Section):
        raise DataError(f"'{source}' is damaged: 'camera' is missing.", "Create the report again.")
    with damage(source):
        camera = camera_of_entry(found["camera"], source)
        start, free = start_and_free(report.camera, camera)
        seen, places = decode(report.data, [v.id for v in report.views])
        poses = _poses([report.views[i] for i in places])
        data = replace(seen, image_sizes=(report.inputs.image_size,), **inputs_of(report, found))
        return Solution(camera=camera, start=start, **judged(report, found, camera, [free], poses, data))


def judged(
    report: Report,
    found: Mapping[str, Any],
    subject: Camera | Rig,
    frees: Sequence[Array],
    poses: Poses,
    data: Observations,
) -> dict[str, Any]:
    """The fields that solutions of a camera and of a rig share.

    Parameters
    ----------
    report, found : Report, mapping
        The document, as its schema reads it and plain.
    subject : Camera or Rig
    frees : sequence of (P, F) arrays
        d params / d free parameters of each camera.
    poses : Poses
    data : Observations
    """
    board = board_of(report.target, data) or placed_boards(data)
    normal = normal_at(subject, frees, poses, data, board)
    return {
        "poses": poses,
        "observations": data,
        "residuals": residuals(subject, poses, data),
        "free": _all_free(frees, len(normal.intrinsics)),
        "normal": normal,
        "fit": fit_of(report.fit),
        "stages": tuple(stage_of(s) for s in report.stages),
        "warnings": tuple(warning_of(w) for w in report.warnings),
        "options": found["options"],
        "crosscheck": tuple(found["crosscheck"]),
        "holdout": found["holdout"],
        "board": board,
    }


def _all_free(frees: Sequence[Array], variables: int) -> Array:
    """d params / d variables of all cameras, with columns of zeros for the rig and the board."""
    made = np.zeros((sum(f.shape[0] for f in frees), variables))
    row = column = 0
    for free in frees:
        made[row : row + free.shape[0], column : column + free.shape[1]] = free
        row, column = row + free.shape[0], column + free.shape[1]
    return made


def load_camera(path: str | os.PathLike, image_size: tuple[int, int] | None = None) -> Camera:
    """Read one camera from a camera file of any format; `FILE#NAME` selects the camera NAME of a file with several.

    `image_size` is of a camera whose file does not say it.

    Raises
    ------
    DataError
        If the file holds no camera, several, or one that camcal has no lens model for.
    """
    return single(read(path, image_size=image_size), os.fspath(path))


def promise_of(path: str | os.PathLike) -> Promise | None:
    """The residuals that the report of a camera predicts; None for a camera file that is not a report."""
    try:
        found = read_document(path)
    except CamcalError:
        return None
    fit = found.get("fit") if isinstance(found, Mapping) else None
    median = fit.get("median") if isinstance(fit, Mapping) else None
    return Promise(float(median)) if isinstance(median, int | float) else None


@contextmanager
def damage(source: str) -> Any:
    """Convert any error about a missing or malformed entry into one that says the file is damaged."""
    try:
        yield
    except CamcalError:
        raise
    except (KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
        what = f"'{error.args[0]}' is missing" if isinstance(error, KeyError) else str(error)
        raise DataError(f"'{source}' is damaged: {what}.", "Create the report again.") from error


def start_and_free(section: Section, camera: Camera) -> tuple[Camera, Array]:
    """The start of the search for a camera, and d params / d free parameters (P, F)."""
    given = [section.parameters[name] for name in camera.lens.names]
    start = np.array([p.value if p.start is UNSET else p.start for p in given], float)
    free = np.eye(len(given))[:, [not p.fixed for p in given]]
    if section.free_directions is not UNSET:
        free = np.array(section.free_directions, float).reshape(len(given), -1)
    return Camera(camera.lens, start, camera.image_size), free


def _poses(views: Sequence[View]) -> Poses:
    given = [v.cam_from_board for v in views if v.cam_from_board is not None]
    if len(given) < len(views):
        name = next(v.id for v in views if v.cam_from_board is None)
        raise DataError(
            f"the view '{name}' has points that were used, but no pose.", "Create the report again."
        )
    vectors = np.array([g.rotation_vector for g in given]).reshape(-1, 3)
    return Poses(rotations.exp(vectors), np.array([g.translation for g in given]).reshape(-1, 3))


def inputs_of(report: Report, found: Mapping[str, Any]) -> dict[str, Any]:
    """The fields of observations that do not depend on the number of cameras."""
    return {
        "target": found["target"],
        "skipped": tuple(
            SkippedView(
                v.id, v.status, v.reason or "", v.points, v.rms_point, None if v.camera is UNSET else v.camera
            )
            for v in report.views
            if v.status != "used"
        ),
        "files": tuple(found["inputs"]["files"]),
        "picture_quality": {v.id: v.quality for v in report.views if isinstance(v.quality, dict)},
    }


def board_of(target: Target | None, seen: Observations) -> ShapedBoard | None:
    """The estimated shape of the board, if the report has one; a given shape is part of the points."""
    shape = UNSET if target is None else target.shape
    if not isinstance(shape, Shape) or not set(shape.kind.split("+")) & set(KINDS):
        return None
    square = target.square if target is not None and isinstance(target.square, float) else 1.0
    if shape.boards is not UNSET:
        return _boards_of(shape.kind, shape.boards, square, seen)
    points, ideal = (np.array(p, float).reshape(-1, 3) * square for p in (shape.points, shape.ideal))
    # what a shape may do follows from the ideal board, so that it is the same as in the calibration
    flat = on_board(seen.kept(), points, ideal)
    board = make_board(flat.views, shape.kind)
    return ShapedBoard(shape.kind, ideal, points, board.size, board.basis)


def _boards_of(kind: str, found: Mapping[str, BoardShape], square: float, seen: Observations) -> ShapedBoard:
    """The estimated shapes of several boards."""
    kept, target = seen.kept(), seen.target or {}
    order = np.argsort(np.concatenate([b.numbers for b in found.values()]))
    numbers = np.concatenate([b.numbers for b in found.values()])[order]
    poses = dict(zip(names_of(target), frames(target), strict=True))
    ideal, points = (
        np.concatenate([poses[n].apply(square * np.array(p(b), float)) for n, b in found.items()])[order]
        for p in (lambda b: b.ideal, lambda b: b.points)
    )
    flat = by_number(kept, numbers, ideal)
    board = make_board(flat.views, kind, Several.of(flat))
    assert board.numbers is not None
    there = board.points.copy()
    there[np.searchsorted(board.numbers, numbers)] = points
    return shaped_board(board, there)


def normal_at(
    subject: Camera | Rig, frees: Sequence[Array], poses: Poses, seen: Observations, board: ShapedBoard | None
) -> NormalBlocks:
    """The normal equations at the solution; a board's shape is relative to the estimated one."""
    used, cameras = seen.kept(), cameras_of(subject)
    kept, weights = used.views, used.precision_by_view
    lenses, instants = [c.lens for c in cameras], Seen(used.blocks.camera, used.blocks.view)
    if board is None:
        problem = Problem(lenses, kept, frees, weights, seen=instants)
    else:
        assert board.basis is not None
        common = common_points(kept)
        assert common is not None  # or `board_of` would have said so
        shape = Board(*common, board.kind, board.basis, label=board.label, numbers=board.numbers)
        problem = BoardProblem(lenses, kept, frees, shape, weights, seen=instants)
    params = np.concatenate([c.params for c in cameras])
    blocks = problem.linearise(problem.state(params, poses, rig_poses(subject)))
    if blocks is None:
        raise DataError("a used point lies outside the lens's domain.", "The report is damaged.")
    return blocks.normal()


def warning_of(section: schema.Warning_) -> CalibrationWarning:
    """A warning."""
    # reports made before severities were graded have none
    severity = "doubtful" if section.severity is UNSET else section.severity
    return CalibrationWarning(section.code, section.message, section.hint, severity)


def fit_of(section: schema.Fit) -> Fit:
    """The statistics of the search."""
    nan = float("nan")
    return Fit(
        section.optimizer,
        section.loss,
        section.iterations,
        section.evaluations,
        section.converged,
        section.stop_reason,
        nan if section.cost is None else section.cost,
        nan if section.seconds is None else section.seconds,
        info=section.info or {},
    )


def stage_of(section: schema.Stage) -> Stage:
    """One attempt of the plan."""
    matrix, projection = section.matrix, section.projection_matrix
    return Stage(
        section.name,
        float("nan") if section.rms_point is None else section.rms_point,
        None if matrix is None else np.array(matrix),
        float("nan") if section.seconds is None else section.seconds,
        None if projection is UNSET else np.array(projection),
        info=section.info if isinstance(section.info, dict) else {},
    )
