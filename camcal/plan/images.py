"""From pictures to a solution in one call."""

from __future__ import annotations

import os
from collections.abc import Iterable
from typing import Any

from camcal.detect.images import detect_images
from camcal.plan.calibrate import calibrate
from camcal.plan.options import OnEvent
from camcal.plan.solution import Solution
from camcal.settings.detection import DetectionOptions


def calibrate_images(
    paths: Iterable[str | os.PathLike] | str | os.PathLike,
    model: str = "auto",
    robust: str = "auto",
    on_event: OnEvent | None = None,
    **options: Any,
) -> Solution:
    """Calibrate a camera from pictures of a target, as `camcal checkerboard` does.

    Parameters
    ----------
    paths : path or iterable of paths
        Folders, files, quoted patterns, films.
    model, robust : str
        As of `camcal.calibrate`.
    on_event : callable, optional
        Called as the work goes on, with the events of both steps.
    **options
        Those of `detect_images` (`target`, `board`, `square`, `jobs`, `cache`, ...) and those of `camcal.calibrate`;
        `board_shape` is `auto` and `refine_points` None (where views held out gain from it) unless given.

    Returns
    -------
    Solution

    Raises
    ------
    UsageError
        For an unknown option.
    DataError
        If no picture shows the target.
    EstimationError
        If the pictures do not determine a camera.
    """
    listed = [paths] if isinstance(paths, (str, os.PathLike)) else list(paths)
    search = {name: options.pop(name) for name in DetectionOptions.options() if name in options}
    found = detect_images(listed, **search, on_event=on_event)
    options = {"board_shape": "auto", "refine_points": None, **options}
    return calibrate(found, model, robust, on_event, **options)
