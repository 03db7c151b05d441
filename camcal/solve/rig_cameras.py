"""One camera of a rig as a calibration of its own."""

from __future__ import annotations

import numpy as np

from camcal.data.rig_table import of_camera
from camcal.model.pose import Poses
from camcal.solve.calibration import Calibration, RigCalibration
from camcal.solve.problem import Problem


def within(solution: RigCalibration, name: str) -> Calibration:
    """Return a camera of a rig with its own pictures, at the joint estimate.

    Its normal equations are those of its own pictures alone, each with a free pose. They exclude the information of the
    other cameras on its intrinsics, so that standard deviations from them are not too small. The board is the
    estimated one.
    """
    index = list(solution.rig.cameras).index(name)
    whole = solution.observations
    rows = whole.camera == index
    instants = np.unique(whole.view[rows & whole.used])
    rows &= np.isin(whole.view, instants)  # without pictures that have no used points
    data = of_camera(whole.where(rows | (whole.camera != index)), name)
    poses = Poses.of(solution.rig.cam_from_rig[name] @ solution.poses[instants])
    camera = solution.rig.cameras[name]
    ends = np.cumsum([0, *(c.lens.size for c in solution.cameras)])
    free = solution.free[ends[index] : ends[index + 1]]
    free = free[:, free.any(0)]
    kept = data.kept()
    weights = kept.precision_by_view
    problem = Problem(camera.lens, kept.views, free, weights)
    blocks = problem.linearise(problem.state(camera.params, poses))
    assert blocks is not None  # the points that the joint estimate rests on
    return Calibration(
        camera=camera,
        start=solution.start.cameras[name],
        poses=poses,
        observations=data,
        residuals=solution.residuals[rows],
        free=free,
        normal=blocks.normal(),
        fit=solution.fit,
    )
