"""mrcal's projection uncertainty, in an interpreter that has mrcal: mrcal_uncertainty_worker.py IN.npz OUT.npz.

Debian's mrcal belongs to the system's Python, not to the environment in which camcal runs. IN holds the board's
observations (views, rows, columns, 3), where to begin, and rays of the camera at finite and infinite distance.
"""

import sys

import mrcal
import numpy as np

problem = np.load(sys.argv[1])
seen, frames, intrinsics = (problem[k].copy() for k in ("seen", "frames", "intrinsics"))
count = len(seen)
told = {
    "intrinsics": intrinsics[None],
    "extrinsics_rt_fromref": np.zeros((0, 6)),
    "frames_rt_toref": frames,
    "points": None,
    "observations_board": seen,
    "indices_frame_camintrinsics_camextrinsics": np.stack(
        [np.arange(count), np.zeros(count), np.full(count, -1)], 1
    ).astype(np.int32),
    "observations_point": None,
    "indices_point_camintrinsics_camextrinsics": None,
    "lensmodel": str(problem["model"]),
    "imagersizes": problem["size"].astype(np.int32)[None],
    "calobject_warp": np.zeros(2),
    "calibration_object_spacing": float(problem["spacing"]),
    "do_optimize_intrinsics_core": True,
    "do_optimize_intrinsics_distortions": True,
    "do_optimize_extrinsics": True,
    "do_optimize_frames": True,
    "do_optimize_calobject_warp": bool(problem["warp"]),
    "do_apply_outlier_rejection": False,
    "do_apply_regularization": False,
    "verbose": False,
}
for _ in range(3):  # begun again where it stopped, it goes on a little
    mrcal.optimize(**told)
camera = mrcal.cameramodel(optimization_inputs=told, icam_intrinsics=0)
found = {}
for scale, sigma in (("own", None), ("unit", 1.0)):
    values = []
    for pixel, distance in zip(problem["pixels"], problem["distances"], strict=True):
        ray = mrcal.unproject(pixel, *camera.intrinsics(), normalize=True)
        far = bool(np.isinf(distance))
        values.append(
            mrcal.projection_uncertainty(
                ray if far else ray * distance,
                camera,
                atinfinity=far,
                what="worstdirection-stdev",
                observed_pixel_uncertainty=sigma,
            )
        )
    found[scale] = np.array(values, float)
np.savez(sys.argv[2], intrinsics=told["intrinsics"][0], warp=told["calobject_warp"], **found)
