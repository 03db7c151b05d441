"""A rig followed through time: knocks found, named and measured; no alarm without one."""

import csv
from pathlib import Path

import numpy as np
import pytest
import yaml

from camcal.geometry import rotations as so3
from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.model.pose import Pose, Poses

BOARD = np.c_[np.stack(np.meshgrid(np.arange(9.0), np.arange(6.0)), -1).reshape(-1, 2) * 30, np.zeros(54)]
CAMERA = Camera(lenses.make("pinhole"), np.array([600.0, 605, 322, 238]), (640, 480))
PLACES = {
    "a": Pose.identity(),
    "b": Pose.from_vector((0.0, -0.15, 0.01), (-120, 2, 8)),
    "c": Pose.from_vector((0.1, 0.1, 0.02), (60, -90, 20)),
}


def boards(rng, count):
    """rig_from_board (W,): in the middle of the picture, turned by up to 0.4 rad."""
    rotation = so3.exp(rng.uniform(-0.4, 0.4, (count, 3)))
    centre = np.c_[rng.uniform(-60, 60, count), rng.uniform(-40, 40, count), rng.uniform(550, 800, count)]
    return Poses(rotation, centre - rotation @ BOARD.mean(0))


def seen(rng, names, count, first=0, knock=None, px=0.2, moved="b", at=0):
    """Rows of a table; from the instant `at` on a camera has moved by `knock` (rotation vector, translation)."""
    rows = []
    for i, board in enumerate(boards(rng, count)):
        for name in names:
            place = PLACES[name]
            if knock is not None and name == moved and i >= at:
                step = knock(i - at) if callable(knock) else knock
                place = Pose(so3.exp(step[:3]) @ place.rotation, place.translation + step[3:])
            uv = CAMERA.project((place @ board).apply(BOARD)) + rng.normal(0, px, (54, 2))
            for j in np.flatnonzero(((uv > 0) & (uv < [639, 479])).all(1)):
                rows.append([name, first + i, *BOARD[j], *uv[j], j])
    return rows


def write(path, rows):
    with Path(path).open("w", newline="") as file:
        csv.writer(file).writerows([["camera", "view", "X", "Y", "Z", "u", "v", "id"], *rows])


def calibrated_rigs(folder):
    """Reports of a pair and of three cameras, each from 20 instants of a board."""
    from camcal.cli.boundary import run

    made = {}
    for names in ("ab", "abc"):
        write(folder / "t.csv", seen(np.random.default_rng(1), names, 20))
        path = folder / f"{names}.yaml"
        given = ["-m", "pinhole", "--image-size", "640x480", "--no-crosscheck", "-o", str(path)]
        assert run(["rig", str(folder / "t.csv"), *given, "-q"]) == 0
        made[names] = path
    return made


@pytest.fixture(scope="module")
def rigs(tmp_path_factory):
    return calibrated_rigs(tmp_path_factory.mktemp("rigs"))


@pytest.fixture
def track(rigs, tmp_path, monkeypatch, capsys):
    """Track rows with a rig: exit code, stderr, rows of the table, report."""
    from camcal.cli.boundary import run

    monkeypatch.chdir(tmp_path)

    def call(names, rows, *options):
        write("frames.csv", rows)
        given = ["--rig", str(rigs[names]), "-o", "out.csv", "--report", "r.yaml", "--force", *options]
        code = run(["track", "frames.csv", *given])
        with Path("out.csv").open() as file:
            table = list(csv.DictReader(file))
        return code, capsys.readouterr().err, table, yaml.safe_load(Path("r.yaml").read_text())

    return call


@pytest.mark.parametrize("names", ["ab", "abc"])
def test_a_rig_that_stays(track, names):
    code, err, table, report = track(names, seen(np.random.default_rng(2), names, 60), "--fail-on-change")
    assert code == 0 and "Changes: 0" in err, err
    assert report["track"]["statuses"] == {"used": 60} and report["verdict"] == "pass"
    assert len(table) == 60 * len(names) and {r["status"] for r in table} == {"used"}
    # instants by themselves: χ² with 6 degrees of freedom, the calibration's own error included
    chi2 = np.array([float(r["chi2"]) for r in table if r["camera"] == "b"])
    assert 4 < np.median(chi2) < 7


@pytest.mark.parametrize("names", ["ab", "abc"])
@pytest.mark.parametrize("moved", ["a", "b"])
def test_a_knock_is_found_named_and_measured(track, names, moved):
    """0.3 degrees about y and 2 mm along x, from instant 25 on."""
    knock = np.array([0, np.radians(0.3), 0, 2.0, 0, 0])
    rows = seen(np.random.default_rng(3), names, 50, knock=knock, moved=moved, at=25)
    code, err, table, report = track(names, rows, "--fail-on-change")
    assert code == 1 and report["verdict"] == "fail"
    (change,) = report["track"]["changes"]
    assert change["since"] in ("24", "25", "26") and 25 < int(change["frame"]) < 32
    if names == "abc":
        assert change["camera"] == moved and f"camera {moved} moved at" in err
        off = np.r_[np.radians(change["rotation_deg"]), change["translation"]] - knock
        sigma = np.r_[np.radians(change["sigma_rotation_deg"]), change["sigma_translation"]]
        assert (np.abs(off) < 4 * sigma).all()
    else:
        assert change["camera"] is None and "a and b moved relative to each other" in err
    assert [r["status"] for r in table if r["camera"] == "b"].count("settling") == 8
    assert [r["view"] for r in table if r["changed"] == "1"] == [change["frame"]] * len(names)
    # the rig goes on from the new place
    place = PLACES["b"]
    step = Pose.from_vector(knock[:3], knock[3:])
    after = (Pose(step.rotation @ place.rotation, place.translation + step.translation)
             if moved == "b" else place @ step.inverse())  # fmt: skip
    got = Pose.from_vector(*(np.array(v) for v in report["rig"]["cam_from_rig"]["b"].values()))
    assert so3.angle_between(got.rotation, after.rotation) < np.radians(0.1)
    assert np.linalg.norm(got.translation - after.translation) < 1.0


def test_two_cameras_of_three_do_not_tell_which_of_them_moved(track):
    knock = np.array([0, np.radians(0.3), 0, 2.0, 0, 0])
    _, err, _, report = track("abc", seen(np.random.default_rng(3), "ab", 16, knock=knock, at=8))
    assert "a and b moved relative to each other" in err, err
    assert report["track"]["changes"][0]["camera"] is None


def test_a_slow_drift_is_found(track):
    """Three thousandths of a degree more at each instant."""
    rows = seen(
        np.random.default_rng(4), "abc", 120, knock=lambda i: np.array([0, np.radians(0.003) * i, 0, 0, 0, 0])
    )
    _, err, _, report = track("abc", rows)
    assert report["track"]["changes"][0]["camera"] == "b", err


def test_a_single_wrong_board_is_an_outlier(track):
    rows = seen(np.random.default_rng(5), "abc", 30)
    rows += seen(
        np.random.default_rng(6), "abc", 1, first=30, knock=np.array([0, 0.02, 0, 5, 0, 0]), moved="c"
    )
    rows += seen(np.random.default_rng(7), "abc", 10, first=31)
    code, err, table, _ = track("abc", rows, "--fail-on-change")
    assert code == 0 and "Changes: 0" in err, err
    assert {r["view"] for r in table if r["status"] == "rejected"} == {"30"}


def test_instants_of_one_camera_are_left_out(track):
    rows = seen(np.random.default_rng(8), "ab", 10) + seen(np.random.default_rng(9), "a", 3, first=10)
    _, err, _, report = track("ab", rows)
    assert "3 instants were seen by one camera only" in err and report["track"]["statuses"]["alone"] == 3


@pytest.mark.parametrize(
    "rig, rows, options, code, said",
    [
        ("ab", [], ["--method", "rls"], 2, "--method has no effect with --rig"),
        ("ab", [["z", 0, 0, 0, 0, 1, 1, 0], ["a", 0, 0, 0, 0, 1, 1, 0]], [], 3, "the rig has no camera 'z'"),
    ],
)
def test_refusals(rigs, tmp_path, monkeypatch, capsys, rig, rows, options, code, said):
    from camcal.cli.boundary import run

    monkeypatch.chdir(tmp_path)
    write("f.csv", rows or seen(np.random.default_rng(8), "ab", 3))
    assert run(["track", "f.csv", "--rig", str(rigs[rig]), *options]) == code
    assert said in capsys.readouterr().err


def test_a_report_of_a_single_camera_is_refused(tmp_path, monkeypatch, capsys):
    from camcal import save_camera
    from camcal.cli.boundary import run

    monkeypatch.chdir(tmp_path)
    save_camera(CAMERA, "c.yaml")
    write("f.csv", seen(np.random.default_rng(8), "ab", 3))
    assert run(["track", "f.csv", "--rig", "c.yaml"]) == 3
    assert "not a report of a rig" in capsys.readouterr().err


def test_pictures_that_are_apart(rigs, tmp_path, monkeypatch, capsys):
    from camcal.cli.boundary import run

    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(8)
    write("f.csv", seen(rng, "a", 3) + seen(rng, "b", 3, first=5))
    assert run(["track", "f.csv", "--rig", str(rigs["ab"])]) == 3
    assert "no board was seen by two cameras at the same instant" in capsys.readouterr().err
