"""`camcal estimate --distortion`: the distortion is given, the rest calibrated, and compared with the joint
solution.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from camcal.data.observations import Correspondences


def held_options(
    path: Path, data: Correspondences, options: dict[str, Any]
) -> tuple[dict[str, Any], dict[str, Any]]:
    """The options of a calibration with held distortion, and the report's `distortion_first`.

    A pinhole camera is calibrated on undistorted points; at its focal length the known lens has other
    coefficients, and these are held. The joint solution of the same model and points is reported for comparison.
    """
    from camcal.errors import UsageError
    from camcal.plan.calibrate import calibrate
    from camcal.report.loading import load_camera
    from camcal.routes.distortion_first import at_focal_length, held_parameters, without_distortion

    known = load_camera(path, data.image_size)
    if known.image_size is None:
        raise UsageError(f"'{path}' has no image size.", "Give --image-size WxH.")
    plain = {"robust": options["robust"], "seed": options["seed"], "checks": False, "crosscheck": False}
    flat = calibrate(without_distortion(known, data), model="pinhole", fix={"aspect": None}, **plain)
    lens = at_focal_length(known, float(flat.camera.params[0]))
    joint = calibrate(data, model=lens.lens.name, fix={"aspect": None}, **plain)
    section = {
        "from": str(path),
        "undistorted": {"rms_point": flat.rms_point, "parameters": flat.camera.values},
        "joint": {"rms_point": joint.rms_point, "parameters": joint.camera.values},
    }
    fix = {**held_parameters(lens), **options["fix"]}
    return {**options, "model": lens.lens.name, "fix": fix}, section
