"""cv2's own camera from the data of a solution, for comparing whole cameras."""

from __future__ import annotations

from camcal.errors import DataError
from camcal.model.camera import Camera
from camcal.peers import CALIBRATORS
from camcal.peers.base import NotComparableError
from camcal.peers.calibrate_camera import task_of
from camcal.registry import load
from camcal.solve.calibration import Calibration
from camcal.system.processes import one_opencv_thread


def camera_by_cv2(solution: Calibration) -> tuple[Camera, str]:
    """Calibrate the solution's points with cv2 from scratch; return the camera and the name of the function.

    cv2 knows neither weights nor robust losses: it gets the points used by the solution, all alike.

    Raises
    ------
    DataError
        If cv2 cannot estimate the same parameters, or refuses the data.
    """
    form = solution.camera.lens.opencv(solution.camera.params)
    if form is None or form.function not in CALIBRATORS:
        raise DataError(
            f"cv2 has no counterpart of the model '{solution.camera.lens.name}'.",
            "Calibrate with a model of OpenCV's to compare with cv2: --model opencv5",
        )
    try:
        with one_opencv_thread():
            result = load(CALIBRATORS[form.function])(task_of(solution), None)
    except NotComparableError as error:
        raise DataError(f"cv2 cannot make this camera: {error}.", "Compare two reports instead.") from error
    return result.camera, f"cv2.{form.function}"
