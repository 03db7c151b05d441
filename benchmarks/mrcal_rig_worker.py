"""Calibrate a rig with mrcal, in an interpreter that has it: mrcal_rig_worker.py IN.npz OUT.npz."""

import sys

import mrcal
import numpy as np

problem = np.load(sys.argv[1])
uv, seen, points = problem["uv"], problem["seen"], problem["points"]
cameras, views = seen.shape
intrinsics = problem["intrinsics"].astype(float)
rig, boards = problem["rig"].astype(float), problem["boards"].astype(float)
columns = len(np.unique(points[:, 0]))
order = np.lexsort((points[:, 0], points[:, 1]))
spacing = float(np.diff(np.unique(points[:, 0]))[0])
corner = points.min(0)
for board in boards:  # mrcal's board begins at its first corner
    turn = mrcal.R_from_r(board[:3])
    board[3:] += turn @ corner
there = [(v, c) for v in range(views) for c in range(cameras) if seen[c, v]]
grid = np.array([np.c_[uv[c, v][order], np.ones(len(order))].reshape(-1, columns, 3) for v, c in there])
index = np.array([[v, c, c - 1] for v, c in there], np.int32)
extrinsics = rig[1:].copy()
mrcal.optimize(
    intrinsics,
    extrinsics,
    boards,
    None,
    grid,
    index,
    None,
    None,
    lensmodel="LENSMODEL_OPENCV4",
    imagersizes=np.tile(problem["size"].astype(np.int32), (cameras, 1)),
    calibration_object_spacing=spacing,
    do_optimize_intrinsics_core=True,
    do_optimize_intrinsics_distortions=True,
    do_optimize_extrinsics=True,
    do_optimize_frames=True,
    do_optimize_calobject_warp=False,
    do_apply_outlier_rejection=False,
    do_apply_regularization=False,
)
np.savez(sys.argv[2], distance=np.linalg.norm(extrinsics[0, 3:]))
