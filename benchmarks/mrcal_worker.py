"""Solve a calibration with mrcal, in an interpreter that has it: mrcal_worker.py IN.npz OUT.npz.

Debian's mrcal belongs to the system's Python, not to the environment in which camcal runs.
"""

import sys
import time

import mrcal
import numpy as np

problem = np.load(sys.argv[1])
seen, frames, intrinsics = (problem[k].copy() for k in ("seen", "frames", "intrinsics"))
count = len(seen)
indices = np.stack([np.arange(count), np.zeros(count), np.full(count, -1)], 1).astype(np.int32)
told = {
    "lensmodel": "LENSMODEL_OPENCV4",
    "imagersizes": problem["size"].astype(np.int32)[None],
    "calibration_object_spacing": 1.0,
    "do_optimize_intrinsics_core": True,
    "do_optimize_intrinsics_distortions": True,
    "do_optimize_extrinsics": False,
    "do_optimize_frames": True,
    "do_optimize_calobject_warp": False,
    "do_apply_outlier_rejection": False,
    "do_apply_regularization": False,
}
seconds = []
for _ in range(int(problem["runs"])):
    f, i = frames.copy(), intrinsics[None].copy()
    begin = time.process_time()
    mrcal.optimize(i, None, f, None, seen.copy(), indices, None, None, **told)
    seconds.append(time.process_time() - begin)
np.savez(sys.argv[2], frames=f, intrinsics=i[0], seconds=np.array(seconds))
