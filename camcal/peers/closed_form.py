"""Zhang's closed form against cv2.calibrateCamera without distortion.

cv2 has no closed form that is the same: initCameraMatrix2D puts the principal point at the image's centre,
and what calibrateCamera does inside is not handed out. Like with like is the pinhole camera of maximum
likelihood: from the stage's camera and poses camcal refines K (without skew and distortion), cv2 calibrates
with all distortion held at 0, and both must end at the same camera. The entry shows besides how far the
closed form itself is from there.
"""

from __future__ import annotations

from camcal.assess.difference import difference, image_grid
from camcal.errors import CamcalError
from camcal.model.camera import Camera
from camcal.model.lenses import make
from camcal.peers import refinement
from camcal.peers.base import Entry, bounds, entry
from camcal.solve.calibration import Calibration, Stage
from camcal.solve.refine import How, refine

AGAINST = "cv2.calibrateCamera"
#: A pinhole that leaves so many times the error of the result does not describe the lens, and what is lowest then
#: depends on the start; where it does, the two agree to rounding.
OTHER_MINIMA = 5.0


def against_cv2(stage: Stage, solution: Calibration) -> Entry | None:
    """Compare the stage that holds K and all poses; None if it does not."""
    if stage.matrix is None or stage.poses is None or len(stage.poses) != len(solution.poses):
        return None
    data = refinement.unweighted(solution)
    lens = make("pinhole")
    start = Camera(lens, lens.from_matrix(stage.matrix), solution.camera.image_size)
    try:
        pinhole = refine(start, stage.poses, data, How(_held(solution)))
    except CamcalError as error:
        return entry(stage.name, AGAINST, "not_applicable", f"without distortion there is no camera: {error}")
    made = refinement.compare(
        pinhole, AGAINST, "pinhole, refined from this stage, compared with cv2 with all distortion held at 0"
    )
    made["stage"] = stage.name
    if made["status"] == "fail" and pinhole.rms_point > OTHER_MINIMA * solution.rms_point:
        made["status"] = "not_applicable"
        made["why"] = (
            f"the lens is not a pinhole, and without distortion there are several minima; {made['why']}"
        )
    if made["difference"] is not None:
        apart = difference(start, pinhole.camera, image_grid(*bounds(solution)))
        made["difference"] |= {
            "closed_form_rms_point": stage.rms_point - pinhole.rms_point,
            "closed_form_projection_max_px": apart.max_px,
        }
    return made


def _held(solution: Calibration) -> dict[str, float | None]:
    """The held parameters of the solution's matrix."""
    names = ("fx", "fy", "cx", "cy")
    return {n: None for n, row in zip(names, solution.free[:4], strict=True) if not row.any()}
