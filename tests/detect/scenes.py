"""Cameras, poses and pictures that the tests of the targets share."""

import numpy as np

from camcal.detect import targets
from camcal.detect.targets.base import Detection
from camcal.geometry import rotations
from camcal.model.placement import Spread
from camcal.model.pose import Pose
from camcal.study.cameras import example_camera
from camcal.study.pictures import board_poses
from camcal.study.render import Look, render

#: one of each kind, and the layouts that differ in more than size
SPECS = (
    "checkerboard:9x6:25mm",
    "charuco:9x7:40mm:20mm:4X4_100",
    "charuco:5x8:30mm:22mm:APRILTAG_36h11:legacy",
    "aprilgrid:6x6:22mm:0.3",
    "aprilgrid:4x5:30mm:0.25:family=t25h9:border=1:start=3",
    "circles:10x8:2.5mm:1.5mm",
    "asymmetric-circles:4x11:20mm",
    "asymmetric-circles:5x6:20mm",
    "squares:8x6:12mm:0.8",
    "aruco-grid:5x7:40mm:0.25:4X4_50",
    "aruco-grid:6x4:30mm:0.4:APRILTAG_36h11:start=7",
)


def camera(size=(640, 480), model="opencv5", **values):
    return example_camera(model, size, values)


def straight_camera(size=(160, 120), focal=200.0):
    return example_camera(
        "pinhole", size, {"fx": focal, "fy": focal, "cx": (size[0] - 1) / 2, "cy": (size[1] - 1) / 2}
    )


def pose(vector, translation):
    return Pose(rotations.exp(np.array(vector, float)), np.array(translation, float))


def random_view(target, rng, size=(640, 480), tilt=(0.0, 50.0), fill=(0.6, 0.95), roll=180.0):
    """A camera and a pose from which it sees the whole target."""
    seen_by = camera(size)
    poses = board_poses(target, seen_by, rng, 1, Spread(tilt=tilt, fill=fill, roll=roll))
    return seen_by, poses[0]


def picture(target, seen_by, cam_from_board, rng, **look):
    return render(target.pattern(), seen_by, cam_from_board, Look(**look), rng)


def expected(target, seen_by, cam_from_board, ids):
    """Where the points' pictures are; that of a disc is not where its centre is seen."""
    uv = seen_by.project(cam_from_board.apply(target.points[ids]))
    if target.point_kind == "circle":
        uv = uv + target.apparent_shift(seen_by, cam_from_board, ids)
    return uv


def errors(target, found, seen_by, cam_from_board):
    """Distance (N,) of the found points from the truth, px, in whichever possible numbering is nearest.

    A board that looks the same after half a turn may be numbered from either end.
    """
    assert isinstance(found, Detection), found
    last = len(target.points) - 1
    return min(
        (
            np.linalg.norm(found.uv - expected(target, seen_by, cam_from_board, ids), axis=1)
            for ids in (found.point_ids, last - found.point_ids)
        ),
        key=np.median,
    )


def make(spec):
    return targets.make(spec)
