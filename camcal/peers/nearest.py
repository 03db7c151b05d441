"""Comparison of a model without a counterpart in cv2 with the best camera that cv2 fits to the same points.

Two models are no two ways to one optimum: nothing passes or fails here. The entry says which of cv2's models
came nearest, its rms, and how far the two cameras project apart.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from camcal.assess.difference import difference, image_grid
from camcal.assess.figures import ranked
from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.peers import CALIBRATORS
from camcal.peers.base import Entry, LeftOutError, NotComparableError, Result, bounds, entry
from camcal.peers.calibrate_camera import task_of
from camcal.registry import load
from camcal.solve.calibration import Calibration
from camcal.solve.refine import residuals

#: what cv2 is asked for: its default, the rational model, and the one for wide lenses; where all of them give
#: up, the one that takes seconds
MODELS, LAST = ("opencv5", "opencv8", "kb4"), ("mei",)


def nearest(solution: Calibration, stage: str, full: bool = True) -> Entry:
    """The entry for a solution whose model cv2 does not have; with `full`, cv2's own models are calibrated."""
    why = f"cv2 has no counterpart of the model '{solution.camera.lens.name}'"
    if not full:
        return entry(
            stage,
            "cv2.calibrateCamera",
            "not_applicable",
            f"{why}; --crosscheck full determines which is nearest",
        )
    found: dict[str, Result] = {}
    for models in (MODELS, LAST):
        found = found or {m: made for m in models if (made := _by_cv2(solution, m)) is not None}
    if not found:
        return entry(
            stage, "cv2.calibrateCamera", "not_applicable", f"{why}, and cannot calibrate these data"
        )
    model = min(found, key=lambda name: ranked(found[name].rms_point))
    result = found[model]
    apart = difference(solution.camera, result.camera, image_grid(*bounds(solution)))
    why += (
        f"; the nearest of cv2's is '{model}', which reaches rms {result.rms_point:.6g} px and projects up to "
        f"{apart.max_px:.3g} px elsewhere; it is another model, so the difference is not an error of either"
    )
    opencv = {
        "model": model,
        "rms_point": result.rms_point,
        "matrix": result.camera.matrix.tolist(),
        "distortion": result.distortion.tolist(),
    }
    differs = {
        "rms_point": solution.rms_point - result.rms_point,
        "projection_max_px": apart.max_px,
        "projection_rms_px": apart.rms_px,
        "pixels_outside": apart.outside,
    }
    return entry(stage, f"nearest in cv2: {model}", "not_applicable", why, opencv, differs)


def _by_cv2(solution: Calibration, model: str) -> Result | None:
    """cv2's camera of one of its models from the solution's points; None if cv2 fails."""
    lens = lenses.make(model)
    camera = Camera(lens, lens.from_matrix(solution.camera.matrix), solution.camera.image_size)
    asked = replace(solution, camera=camera, start=camera, free=np.eye(lens.size))
    form = lens.opencv(camera.params)
    assert form is not None
    try:
        result: Result = load(CALIBRATORS[form.function])(task_of(asked), None)
    except (NotComparableError, LeftOutError):
        return None
    return result if np.isfinite(result.rms_point) and _holds_points(solution, result) else None


def _holds_points(solution: Calibration, result: Result) -> bool:
    """Return whether every used point lies in the domain of cv2's camera, which has no fold checks."""
    off = residuals(result.camera, result.poses, solution.observations)
    return bool(np.isfinite(off[solution.used]).all())
