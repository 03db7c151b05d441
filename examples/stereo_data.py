"""Data of a stereo camera: a table of a board seen by both cameras, and two pictures of a textured scene.

python examples/stereo_data.py FOLDER
"""

import sys
from pathlib import Path

import cv2
import numpy as np

import camcal
from camcal.model import lenses

SIZE = (640, 480)
LENS = lenses.make("opencv5")
LEFT = camcal.Camera(LENS, LENS.from_values({"fx": 530, "fy": 530, "cx": 322, "cy": 238, "k1": -0.2}), SIZE)
RIGHT = camcal.Camera(LENS, LENS.from_values({"fx": 540, "fy": 540, "cx": 315, "cy": 244, "k1": -0.21}), SIZE)
RIGHT_FROM_LEFT = camcal.Pose.from_vector(np.array([0.01, 0.03, -0.01]), np.array([-100.0, 1.0, 2.0]))
CAMERAS = {"left": (LEFT, camcal.Pose.identity()), "right": (RIGHT, RIGHT_FROM_LEFT)}


def table(views: int = 15, noise: float = 0.1) -> str:
    """A board of 9x6 corners, 30 mm apart, in some poses: camera,view,id,X,Y,Z,u,v."""
    rng = np.random.default_rng(1)
    board = np.stack([*(g.ravel() * 30.0 for g in np.meshgrid(np.arange(9), np.arange(6))), np.zeros(54)], 1)
    rows = ["camera,view,id,X,Y,Z,u,v"]
    while views:
        turn = camcal.Pose.from_vector(rng.uniform(-0.5, 0.5, 3), np.zeros(3))
        place = np.array([rng.uniform(-80, 180), rng.uniform(-80, 80), rng.uniform(500, 800)])
        xyz = turn.apply(board - board.mean(0)) + place
        uv = {name: camera.project(pose.apply(xyz)) for name, (camera, pose) in CAMERAS.items()}
        if all((p > 5).all() and (p < np.array(SIZE) - 5).all() for p in uv.values()):
            views -= 1
            for name, pixels in uv.items():
                pixels = pixels + rng.normal(0, noise, pixels.shape)
                rows += [
                    f"{name},{views},{i},{x:g},{y:g},0,{u:.4f},{v:.4f}"
                    for i, ((x, y, _), (u, v)) in enumerate(zip(board, pixels, strict=True))
                ]
    return "\n".join(rows) + "\n"


def picture(camera: camcal.Camera, pose: camcal.Pose) -> np.ndarray:
    """A tilted wall with a random texture, two metres away."""
    texture = np.random.default_rng(3).uniform(0, 255, (1500, 2000)).astype(np.float32)
    texture = cv2.GaussianBlur(texture, (0, 0), 5)
    texture = (texture - texture.min()) / (texture.max() - texture.min()) * 255
    u, v = np.meshgrid(np.arange(SIZE[0], dtype=float), np.arange(SIZE[1], dtype=float))
    rays = camera.unproject(np.stack([u, v], -1)) @ pose.rotation
    normal = np.array([0.3, 0.1, -1.0])
    depth = (-2000 - pose.centre @ normal) / (rays @ normal)
    xyz = pose.centre + rays * depth[..., None]
    x, y = xyz[..., 0] / 2.2 + 1000, xyz[..., 1] / 2.2 + 750
    return cv2.remap(texture, x.astype(np.float32), y.astype(np.float32), cv2.INTER_CUBIC).astype(np.uint8)


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "boards.csv").write_text(table(), encoding="utf-8")
    for name, (camera, pose) in CAMERAS.items():
        cv2.imwrite(str(folder / f"{name}.png"), picture(camera, pose))
    corners = np.array([[-200.0, -100, 1500], [300, 120, 1800], [100, 50, 1200]])
    rows = ["camera,point,u,v"]
    for name, (camera, pose) in CAMERAS.items():
        pixels = camera.project(pose.apply(corners)).tolist()
        rows += [f"{name},{'abc'[i]},{u:.3f},{v:.3f}" for i, (u, v) in enumerate(pixels)]
    (folder / "points.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
