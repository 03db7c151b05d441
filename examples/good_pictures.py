"""Render good and bad pictures of a board, and draw them side by side: the figure of the tutorial "Good pictures".

    python examples/good_pictures.py FOLDER [FIGURE.jpg]

FOLDER gets one picture for each panel. The drawing needs matplotlib.
"""

from __future__ import annotations

import sys
from pathlib import Path

import cv2
import numpy as np

from camcal.detect.targets import make
from camcal.model.camera import Camera
from camcal.model.lenses import make as make_lens
from camcal.model.pose import Pose
from camcal.study.render import Look, render

SIZE = (640, 480)
PARAMETERS = [560.0, 560.0, 320.0, 240.0, -0.2, 0.05, 0.0, 0.0, 0.0]
CENTRE = np.array([100.0, 62.5, 0.0])  #: of 9 x 6 corners, mm
GOOD = {
    "tilted to one side": ((0, 35, 0), (0, 0, 330), {}),
    "tilted up": ((-35, 0, 0), (0, 0, 330), {}),
    "in a corner of the picture": ((20, -25, 0), (-78, 68, 410), {}),
    "camera rolled by 90 degrees": ((15, 20, 90), (0, 0, 390), {}),
}
BAD = {
    "parallel to the picture": ((0, 0, 0), (0, 0, 330), {}),
    "too far away": ((20, 20, 0), (30, 0, 1300), {}),
    "moved during the exposure": ((20, -25, 0), (0, 0, 330), {"moved": 17}),
    "overexposed": ((-20, 20, 0), (0, 0, 330), {"white": 420.0, "black": 90.0, "blur": 1.5}),
}


def pose(degrees: tuple[float, float, float], place: tuple[float, float, float]) -> Pose:
    """cam_from_board with the board's centre at `place`, mm."""
    rotation = np.eye(3)
    for axis, angle in zip(np.eye(3), np.radians(degrees), strict=True):
        rotation = cv2.Rodrigues(axis * angle)[0] @ rotation
    return Pose(rotation, np.array(place) - rotation @ CENTRE)


def picture(
    degrees: tuple[float, float, float], place: tuple[float, float, float], changes: dict
) -> np.ndarray:
    """A picture of the board, with noise."""
    changes, pattern = dict(changes), make("checkerboard:9x6:25mm").pattern()
    moved = changes.pop("moved", 0)
    look = Look(**{"noise": 2.0, "vignetting": 0.25, "gradient": 0.2, **changes})
    camera = Camera(make_lens("opencv5"), np.array(PARAMETERS), SIZE)
    made = render(pattern, camera, pose(degrees, place), look, np.random.default_rng(0))
    if moved:  # in the direction of the rows
        made = cv2.blur(made, (moved, 1))
    return made


def main() -> None:
    """Write the pictures, and the figure where one is asked for."""
    folder = Path(sys.argv[1])
    folder.mkdir(exist_ok=True)
    made = {title: picture(*how) for title, how in (GOOD | BAD).items()}
    for title, image in made.items():
        cv2.imwrite(str(folder / f"{title.replace(' ', '-')}.png"), image)
    if len(sys.argv) < 3:
        return
    import matplotlib

    matplotlib.use("agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(2, 4, figsize=(11, 4.7), layout="constrained")
    for axis, (title, image) in zip(axes.flat, made.items(), strict=True):
        good = title in GOOD
        axis.imshow(image, cmap="gray", vmin=0, vmax=255)
        axis.set_title(
            f"{'good' if good else 'bad'}: {title}", fontsize=9, color="#1a7f37" if good else "#b42318"
        )
        axis.set_axis_off()
    figure.savefig(sys.argv[2], dpi=100, pil_kwargs={"quality": 80})


if __name__ == "__main__":
    main()
