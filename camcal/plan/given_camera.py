"""A start from a known camera: of a report, or of a camera file of any program."""

from __future__ import annotations

import os
import time

from camcal.assess import figures
from camcal.errors import UsageError
from camcal.model.camera import Camera
from camcal.plan.progress import Attempt, Begin, Change, Progress
from camcal.solve import starts
from camcal.solve.calibration import Stage
from camcal.solve.refine import residuals
from camcal.start.known_pose import start_poses

NAME = "given"


def _applies(progress: Progress) -> bool:
    return progress.options.start_camera is not None and progress.best is None and not progress.made("radial")


def _make(progress: Progress) -> Change:
    """The nearest camera of the current lens, and the poses of the views with respect to the given one."""
    begin = time.perf_counter()
    known, kept = camera_of(progress), progress.data.kept()
    poses = start_poses(known, kept.views)
    same = known.lens == progress.lens and not progress.options.fix
    camera = (
        Camera(known.lens, known.params, kept.image_size)
        if same
        else starts.regressed(progress.lens, known, kept, progress.options.fix)
    )
    rms = figures.rms_point(residuals(camera, poses, kept))
    seconds = time.perf_counter() - begin
    stage = Stage(NAME, rms, camera.matrix, seconds, camera=camera, poses=poses, info={"why": "as requested"})
    return Change(start=Begin(NAME, camera, poses, rms), stage=stage)


def camera_of(progress: Progress) -> Camera:
    """The camera of `start_camera`, read if it is a file.

    Raises
    ------
    DataError
        If the file holds no camera, or several.
    UsageError
        If the camera is for pictures of another size, or a closed form is named besides.
    """
    if progress.options.start is not None:
        raise UsageError("a closed form and a start camera were given; one is needed.", "Omit one of them.")
    given = progress.options.start_camera
    theirs = progress.data.image_size
    if isinstance(given, Camera):
        known = given
    else:
        from camcal.data.formats import files

        known = files.single(files.read(given, image_size=theirs), os.fspath(given))
    ours = known.image_size
    if ours is not None and theirs is not None and tuple(ours) != tuple(theirs):
        raise UsageError(
            f"the start camera is for pictures of {ours[0]}x{ours[1]} px, but these have {theirs[0]}x{theirs[1]} px.",
            "Give a camera for the same image size, or omit --start-camera.",
        )
    return known


GIVEN = Attempt(NAME, _applies, _make)
