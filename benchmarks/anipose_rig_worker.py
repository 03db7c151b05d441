"""Calibrate a rig with aniposelib, in an interpreter that has it: anipose_rig_worker.py IN.npz OUT.npz."""

import sys

import numpy as np
from aniposelib.boards import Checkerboard
from aniposelib.cameras import CameraGroup

problem = np.load(sys.argv[1])
uv, seen, points = problem["uv"], problem["seen"], problem["points"]
columns, rows = (len(np.unique(points[:, k])) for k in (0, 1))
board = Checkerboard(columns, rows, square_length=float(np.diff(np.unique(points[:, 0]))[0]))
order = np.lexsort((points[:, 0], points[:, 1]))
names = [f"c{k}" for k in range(len(uv))]
group = CameraGroup.from_names(names)
found = []
for index, camera in enumerate(group.cameras):
    camera.set_size(tuple(int(n) for n in problem["size"]))
    corners = [uv[index, v][order].reshape(-1, 1, 2).astype(np.float32) for v in np.flatnonzero(seen[index])]
    found.append(
        [
            {"framenum": (0, int(v)), "corners": c, "ids": np.arange(len(c))[:, None]}
            for v, c in zip(np.flatnonzero(seen[index]), corners, strict=True)
        ]
    )
group.calibrate_rows(found, board, init_intrinsics=True, init_extrinsics=True, verbose=False)
places = [(np.array(c.get_rotation()), np.array(c.get_translation())) for c in group.cameras[:2]]


def centre(turn, shift):
    import cv2

    return -cv2.Rodrigues(turn)[0].T @ shift


np.savez(sys.argv[2], distance=np.linalg.norm(centre(*places[0]) - centre(*places[1])))
