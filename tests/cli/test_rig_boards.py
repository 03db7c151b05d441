"""`camcal rig` and what follows it, with several boards."""

from pathlib import Path

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
