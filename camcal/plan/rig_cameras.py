"""The cameras of a rig, each calibrated separately, as the start of the joint estimate."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import numpy as np

from camcal.assess.figures import sigma_0
from camcal.data.formats import files
from camcal.data.observations import Observations
from camcal.data.rig_table import RigViews
from camcal.errors import CamcalError, UsageError
from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.model.pose import Pose, Poses
from camcal.plan.known_camera import evaluate
from camcal.plan.lens import solved_with_found
from camcal.plan.options import Options
from camcal.plan.run import solved, usable
from camcal.plan.solution import Solution, of_fit
from camcal.records import dataclass
from camcal.settings.rig import RigOptions, check_names
from camcal.solve import starts
from camcal.solve.calibration import Calibration, RigCalibration
from camcal.solve.rig_cameras import within
from camcal.solve.rig_start import Pictures

Array = np.ndarray


@dataclass(frozen=True)
class Alone:
    """A camera calibrated separately.

    Attributes
    ----------
    name : str
    fit : Calibration
    fix : mapping
        What of it stays in the joint estimate: parameter -> None, or a value.
    selection : mapping or None
        How its model was found.
    second_pass : mapping or None
        What the second pass over its pictures did.
    """

    name: str
    fit: Calibration
    fix: Mapping[str, float | None]
    selection: Mapping[str, Any] | None = None
    second_pass: Mapping[str, Any] | None = None


def alone(name: str, data: Observations, asked: RigOptions, refine_points: bool | None) -> Alone:
    """Calibrate one camera of a rig; one with given intrinsics only gets the poses of its views.

    Raises
    ------
    CamcalError
        As of one camera; the message names it.
    """
    with naming(name):
        known = known_camera(name, asked)
        model = asked.model.get(name, asked.model.get(""))
        options = _options(name, asked, model or (known.lens.name if known else "auto"), refine_points)
        if known is not None:
            return _known(name, usable(data), known, options, model is not None, name in asked.hold)
        if options.model in ("auto", "select"):
            progress, selection = solved_with_found(usable(data), options)
        else:
            progress, selection = solved(data, options), None
        return Alone(name, progress.fit, progress.how.fix, selection, progress.notes.get("second_pass"))


def _options(name: str, asked: RigOptions, model: str, refine_points: bool | None) -> Options:
    """The options of one of the cameras: its own model and held parameters; the board as designed."""
    fix = fixed_of(name, model, asked)
    return Options.of_rig(asked, board_shape="flat", model=model, fix=fix, refine_points=refine_points)


def fixed_of(name: str, model: str, asked: RigOptions) -> dict[str, float | None]:
    """The parameters of a camera held by `--fix`: its own, and those of all cameras that its model has.

    Raises
    ------
    UsageError
        If the model does not have a parameter that is named for this camera.
    """
    lens = None if model in ("auto", "select") else lenses.make(model, asked.skew)
    found = {}
    for key, value in asked.fix.items():
        camera, dot, parameter = key.rpartition(".")
        if not dot and (lens is None or starts.has(lens, parameter)):
            found[parameter] = value
        if camera == name:
            found[parameter] = value
    return found


def known_camera(name: str, asked: RigOptions) -> Camera | None:
    """The given intrinsics of a camera: a Camera, or a file of one, or of a rig with that name."""
    given = asked.cameras.get(name)
    if given is None:
        if name in asked.hold:
            raise UsageError(
                f"'{name}' is held, but no intrinsics are given for it.", f"Try: --cameras {name}=FILE"
            )
        return None
    if isinstance(given, Camera):
        return given
    path = os.fspath(given)
    found = files.read(path)
    if len(found.cameras) > 1 and name in found.names:
        found = files.select(found, name, path)
    return files.single(found, path)


def _known(
    name: str, data: Observations, camera: Camera, options: Options, other_model: bool, held: bool
) -> Alone:
    """The poses with respect to given intrinsics, which are converted to the requested model."""
    if other_model and not held and lenses.make(options.model, options.skew).name != camera.lens.name:
        camera = starts.regressed(lenses.make(options.model, options.skew), camera, data, options.fix)
    fit = evaluate(camera, data, options.robust, options.seed)
    fix = dict.fromkeys(camera.lens.names) if held else options.how(camera.lens).fix
    return Alone(name, fit, fix)


def pictures_of(fits: Mapping[str, Calibration], views: RigViews, data: Observations) -> Pictures:
    """The pose of the board in each picture of a rig's observations, from its camera alone."""
    found: dict[tuple[str, str], tuple[Pose, float]] = {}
    for name, fit in fits.items():
        variances = board_variance(fit)
        for i, view in enumerate(fit.observations.view_ids):
            key = name, views.instants[name][view]
            if key not in found or variances[i] < found[key][1]:  # of two boards that are fixed to each other
                found[key] = fit.poses[i], float(variances[i])
    blocks = data.blocks
    keys = [(data.cameras[c], data.view_ids[v]) for c, v in zip(blocks.camera, blocks.view, strict=True)]
    poses = Poses.stack([found[k][0] for k in keys])
    return Pictures(blocks.camera, blocks.view, poses, np.array([found[k][1] for k in keys]))


def board_variance(fit: Calibration) -> Array:
    """The variance (V,) of the position of a view's points, from the pose's covariance with the camera held.

    A board of radius r that is turned by small random angles of covariance C moves its points by 2/3 r² tr(C).
    """
    scale = sigma_0(fit)
    blocks = fit.normal.poses
    lengths = np.sqrt(np.maximum(np.einsum("vii->vi", blocks), np.finfo(float).tiny))
    inverse = np.linalg.pinv(blocks / (lengths[:, :, None] * lengths[:, None]), hermitian=True)
    diagonal = np.einsum("vii->vi", inverse) / lengths**2
    spread = np.array([np.square(v.xyz - v.xyz.mean(0)).sum(1).mean() for v in fit.observations.views])
    found = diagonal[:, 3:].sum(1) + 2 / 3 * spread * diagonal[:, :3].sum(1)
    noise = scale**2 if np.isfinite(scale) and scale > 0 else 1.0
    return np.asarray(found * noise)


def check_options(asked: RigOptions, names: tuple[str, ...]) -> None:
    """Raise a UsageError if an option names a camera that the rig does not have."""
    qualified = {key.rpartition(".")[0]: value for key, value in asked.fix.items()}
    check_names(asked.model, names, "--model")
    check_names(qualified, names, "--fix")
    check_names(asked.cameras, names, "--cameras")
    check_names(asked.hold, names, "--hold")
    check_names(asked.lag, names, "--lag")
    check_names((asked.reference or "",), names, "--reference")


def solution_within(solution: RigCalibration, name: str) -> Solution:
    """One camera of a rig with its own pictures as a solution, at the joint estimate."""
    return of_fit(within(solution, name))


@contextmanager
def naming(name: str) -> Iterator[None]:
    """Name the camera in the message of an error."""
    try:
        yield
    except CamcalError as error:
        raise type(error)(f"camera '{name}': {error.message}", error.hint) from error
