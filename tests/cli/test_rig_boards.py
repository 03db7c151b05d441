"""`camcal rig` and what follows it, with several boards."""

from pathlib import Path

import cv2
import numpy as np
import yaml

from camcal.model.pose import Pose
from tests.detect.scenes import camera, make, picture, pose
from tests.plan.test_rig_boards import LENS, rig_of, seen


def test_evaluate_next_and_page_take_several_boards(camcal):
    rows = ["camera,view,board,X,Y,Z,u,v"]
    data = seen(rig_of(), ("front", "back"), instants=10)
    names = data.target["boards"]
    for row in range(data.point_count):
        place = data.cameras[data.camera[row]], data.view_ids[data.view[row]], names[data.point[row] // 54]
        rows.append(",".join(map(str, (*place, *data.xyz[row], *data.uv[row]))))
    Path("t.csv").write_text("\n".join(rows) + "\n")
    code, out, err = camcal("rig", "t.csv", "--image-size", "640x480", "-m", LENS, "-o", "rig.yaml")
    assert code == 0, err
    assert "boards" in out and "back" in out
    code, out, err = camcal("evaluate", "rig.yaml", "t.csv")
    assert code == 0 and "held" in out, err
    code, out, err = camcal("next", "rig.yaml")
    assert code == 0 and "seen by a, b" in out.replace("\n", " "), err + out
    code, out, err = camcal("report", "rig.yaml", "-o", "rig.html")
    assert code == 0 and "board back" in Path("rig.html").read_text(), err
    code, _, err = camcal("track", "t.csv", "--rig", "rig.yaml", "-o", "places.csv")
    assert code != 70 and "board" in err, err  # no two cameras see one board


def test_pictures_of_boards_that_no_two_cameras_share(camcal):
    specs = ("charuco:6x5:40mm:30mm:4X4_100", "charuco:6x5:40mm:30mm:4X4_100:start=20")
    rng, seen_by = np.random.default_rng(3), camera((480, 360))
    other = pose((0, np.pi * 0.9, 0.05), (30, 5, 80))
    worlds = (pose((0.1, 0.05, 0), (-110, -90, 420)), pose((0, np.pi + 0.1, 0.1), (120, -90, -420)))
    for view in range(7):
        move = pose(rng.uniform(-0.3, 0.3, 3), rng.uniform(-25, 25, 3))
        for name, place in (("l", Pose.identity()), ("r", other)):
            Path(name).mkdir(exist_ok=True)
            for spec, world in zip(specs, worlds, strict=True):
                before = place @ move @ world
                if before.translation[2] > 100:
                    shown = picture(make(spec), seen_by, before, rng, blur=0.6, noise=1.0)
                    cv2.imwrite(f"{name}/v{view}.png", shown)
    words = ("l=l", "r=r", "--target", "+".join(specs), "-m", "opencv4", "--no-crosscheck", "-o", "rig.yaml")
    code, _, err = camcal("rig", *words)
    assert code == 0, err
    rig = yaml.safe_load(Path("rig.yaml").read_text())["rig"]
    found = rig["cam_from_rig"]["r"]
    off = np.subtract(found["translation"], other.translation)
    assert (np.abs(off) < 4 * np.array(found["sigma_translation"]) + 0.5).all(), off  # rendered to .01 px
    assert list(rig["boards"]) == ["2"]
