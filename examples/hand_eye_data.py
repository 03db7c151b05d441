"""Data of a camera in a robot's hand: a table of a board in 15 views, and the robot's poses.

python examples/hand_eye_data.py FOLDER
"""

import sys
from pathlib import Path

import numpy as np

import camcal
from camcal.model import lenses

LENS = lenses.make("pinhole")
CAMERA = camcal.Camera(LENS, LENS.pinhole(600, 600, 319.5, 239.5), (640, 480))
HAND_FROM_CAMERA = camcal.Pose.from_vector(np.array([0.1, -0.05, 1.57]), np.array([50.0, -30.0, 40.0]))
BASE_FROM_BOARD = camcal.Pose.from_vector(np.array([3.0, 0.1, 0.05]), np.array([550.0, 40.0, 10.0]))

if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(6)
    board = np.stack([*(g.ravel() * 25.0 for g in np.meshgrid(np.arange(9), np.arange(6))), np.zeros(54)], 1)
    points, poses = ["view,X,Y,Z,u,v"], ["view,x,y,z,rx,ry,rz"]
    for view in range(15):
        turn = rng.uniform(-0.5, 0.5, 3) + [0, 0, rng.uniform(-1, 1)]
        pose = camcal.Pose.from_vector(turn, np.zeros(3))
        place = np.array([rng.uniform(-30, 30), rng.uniform(-20, 20), rng.uniform(350, 480)])
        cam_from_board = camcal.Pose(pose.rotation, place - pose.apply(board.mean(0)))
        uv = CAMERA.project(cam_from_board.apply(board)) + rng.normal(0, 0.2, (54, 2))
        points += [
            f"v{view:02d},{x:g},{y:g},0,{u:.4f},{v:.4f}" for (x, y, _), (u, v) in zip(board, uv, strict=True)
        ]
        hand = BASE_FROM_BOARD @ cam_from_board.inverse() @ HAND_FROM_CAMERA.inverse()
        noise = camcal.Pose.from_vector(rng.normal(0, np.radians(0.1), 3), rng.normal(0, 1.0, 3))
        x, y, z = hand.translation + noise.translation
        rx, ry, rz = camcal.Pose(hand.rotation @ noise.rotation, hand.translation).rotation_vector
        poses.append(f"v{view:02d},{x:.4f},{y:.4f},{z:.4f},{rx:.6f},{ry:.6f},{rz:.6f}")
    (folder / "points.csv").write_text("\n".join(points) + "\n", encoding="utf-8")
    (folder / "poses.csv").write_text("\n".join(poses) + "\n", encoding="utf-8")
