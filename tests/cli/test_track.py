"""`camcal track` as a user sees it: rows, reports, plots, exit codes, pipes, and what survives a kill."""

import csv
import io
import json
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
import yaml

from camcal.track.simulate import Scene, simulate

ROWS = "frame,X,Y,Z,u,v\n"


def rows_of(frame):
    return "".join(
        f"{frame.number},{x!r},{y!r},{z!r},{u!r},{v!r}\n"
        for (x, y, z), (u, v) in zip(frame.xyz.tolist(), frame.uv.tolist(), strict=True)
    )


def text_of(kind, count, seed=0, **scene):
    return [rows_of(f) for f, _ in simulate(kind, count, seed, Scene(**scene))]


def read(path):
    return list(csv.DictReader(Path(path).read_text().splitlines()))


@pytest.fixture
def knock(tmp_path):
    path = tmp_path / "knock.csv"
    path.write_text(ROWS + "".join(text_of("knock", 60, knock=40, angle=0.4, points=30)))
    return path


WANTED = [*(f"m{i}{j}" for i in "123" for j in "1234"), "fx", "fy", "skew", "cx", "cy"]
WANTED += ["rx", "ry", "rz", "tx", "ty", "tz", "innovation", "nis", "gain", "changed"]


@pytest.mark.parametrize("method", ["batch", "rls", "kalman", "iekf", "window", "smoother"])
def test_a_row_a_frame(camcal, knock, method):
    code, out, err = camcal("track", knock, "--method", method, "-o", "t.csv")
    assert (code, out) == (0, "")
    table = read("t.csv")
    assert [int(r["frame"]) for r in table] == list(range(60))
    assert list(table[0])[1:28] == WANTED
    assert [r["frame"] for r in table if r["changed"] == "1"] == ["40"]
    assert "camera moved at frame 40" in err and "0.4" in err
    last = {k: float(v) for k, v in table[-1].items() if k != "status"}
    assert last["m34"] == 1.0 and last["sigma_m34"] == 0.0
    assert abs(last["fx"] - 900) < 5 * last["sigma_fx"] and last["sigma_fx"] > 0
    matrix = np.array([[last[f"m{i}{j}"] for j in range(1, 5)] for i in range(1, 4)])
    k = np.array([[last["fx"], last["skew"], last["cx"]], [0, last["fy"], last["cy"]], [0, 0, 1]])
    from camcal.geometry import rotations

    pose = np.c_[
        rotations.exp(np.array([last[n] for n in ("rx", "ry", "rz")])), [last[n] for n in ("tx", "ty", "tz")]
    ]
    np.testing.assert_allclose((k @ pose) / (k @ pose)[2, 3], matrix, rtol=1e-8, atol=1e-8)  # 12 digits


def test_table_on_stdout_and_jsonl(camcal, knock):
    code, out, _ = camcal("track", knock)
    table = list(csv.DictReader(io.StringIO(out)))
    assert code == 0 and len(table) == 60
    code, out, _ = camcal("track", knock, "--format", "jsonl", "--covariance")
    lines = [json.loads(line) for line in out.splitlines()]
    assert len(lines) == 60 and lines[0]["nis"] is None
    assert lines[30]["fx"] == pytest.approx(float(table[30]["fx"]), rel=1e-11)
    assert lines[30]["cov_fx_fx"] == pytest.approx(lines[30]["sigma_fx"] ** 2)


def test_fail_on_change(camcal, knock):
    assert camcal("track", knock, "-o", "a.csv", "--fail-on-change", "--report", "r.yaml")[0] == 1
    report = yaml.safe_load(Path("r.yaml").read_text())
    assert report["verdict"] == "fail" and report["track"]["change_count"] == 1
    (change,) = report["track"]["changes"]
    assert change["frame"] == 40 and change["kind"] == "rotation"
    assert abs(change["rotation_deg"][1] - 0.4) < 4 * change["sigma_rotation_deg"][1]
    calm = "".join(text_of("static", 30))
    Path("calm.csv").write_text(ROWS + calm)
    assert camcal("track", "calm.csv", "-o", "b.csv", "--fail-on-change")[0] == 0


def test_the_report_is_a_camera(camcal, knock):
    assert camcal("track", knock, "-o", "a.csv", "--report", "r.yaml", "--method", "iekf")[0] == 0
    from camcal.report.loading import load_camera

    camera = load_camera("r.yaml")
    assert camera.lens.name == "pinhole" and abs(camera.params[0] - 900) < 10
    # and the next run may start from it
    code, _, err = camcal("track", knock, "-o", "b.csv", "--camera", "r.yaml", "--fix", "intrinsics")
    assert code == 0, err
    assert read("b.csv")[5]["fx"] == read("b.csv")[50]["fx"]


def test_plots(camcal, knock):
    pytest.importorskip("matplotlib")
    assert camcal("track", knock, "-o", "a.csv", "--report", "r.yaml")[0] == 0
    code, _, err = camcal("track", knock, "-o", "a.csv", "--force", "--plots", "p", "--reference", "r.yaml")
    assert code == 0, err
    assert sorted(p.name for p in Path("p").iterdir()) == [
        "gain.svg",
        "innovation.svg",
        "matrix.svg",
        "parameters.svg",
    ]
    assert camcal("track", knock, "--plots", "q")[0] == 2


def test_nothing_is_overwritten_or_left_half_written(camcal, knock):
    assert camcal("track", knock, "-o", "a.csv")[0] == 0
    code, _, err = camcal("track", knock, "-o", "a.csv")
    assert code == 2 and "exists" in err
    Path("bad.csv").write_text(knock.read_text() + "60,1,2,3,4\n")
    code, _, err = camcal("track", "bad.csv", "-o", "b.csv")
    assert code == 3 and "5 fields" in err
    assert sorted(p.name for p in Path().iterdir()) == ["a.csv", "bad.csv"]


@pytest.mark.parametrize(
    ("args", "said"),
    [
        (["--method", "kalmann"], "Did you mean 'kalman'?"),
        (["--method", "rls", "--motion", "pan"], "--motion has no effect with the method 'rls'"),
        (["--method", "kalman", "--window", "5"], "It is for window"),
        (["--method", "kalman", "--fix", "fx"], "--fix has no effect"),
        (["--method", "iekf", "--fix", "fx"], "its value is not given"),
        (["--drift", "focal"], "'focal' has no value; a number is needed."),
        (["--drift", "fokal=1"], "Did you mean 'focal'?"),
        (["--motion", "thermel"], "Did you mean 'thermal'?"),
        (["--gain", "fixed", "--velocity"], "cannot follow a velocity"),
        (["--method", "iekf", "--gain", "mean"], "does not work with the gain"),
        (["--forgetting", "1.5"], "--forgetting"),
        (["--alpha", "0.3"], "Add --gain fixed"),
        (["--method", "rls", "--gain", "mean", "--forgetting", "0.9"], "--forgetting has no effect"),
        (["other.csv"], "a table must be the only input"),
    ],
)
def test_contradictions_are_usage_errors(camcal, knock, args, said):
    code, _, err = camcal("track", knock, *args)
    assert code == 2 and said in err


def test_a_plane_says_what_to_do(camcal):
    Path("flat.csv").write_text(ROWS + "".join(text_of("static", 12, thickness=0)))
    code, _, err = camcal("track", "flat.csv", "-o", "t.csv")
    assert code == 4 and "plane" in err and "--fix intrinsics" in err
    assert not Path("t.csv").exists()


def test_late_frames_are_counted_or_put_in_place(camcal):
    frames = text_of("static", 30)
    frames[10], frames[12] = frames[12], frames[10]
    Path("late.csv").write_text(ROWS + "".join(frames))
    code, out, err = camcal("track", "late.csv")
    assert code == 0 and "2 frames came late" in err
    assert len(out.splitlines()) == 29
    code, out, err = camcal("track", "late.csv", "--reorder", "3")
    numbers = [int(line.split(",")[0]) for line in out.splitlines()[1:]]
    assert code == 0 and "late" not in err and numbers == list(range(30))


# ---------------------------------------------------------------------------------------------- processes
def start(*args, **kwargs):
    env = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), "OPENBLAS_NUM_THREADS": "1"}
    command = [sys.executable, "-m", "camcal", "track", *map(str, args)]
    return subprocess.Popen(command, env=env, stderr=subprocess.PIPE, **kwargs)


def test_a_pipe_is_answered_line_by_line():
    process = start("-", stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    process.stdin.write(ROWS.encode())
    for number, rows in enumerate(text_of("static", 5)):
        process.stdin.write((rows + "\n").encode())
        process.stdin.flush()
        if not number:
            assert process.stdout.readline().startswith(b"frame,m11")
        assert process.stdout.readline().startswith(f"{number},".encode())  # before the next frame is sent
    process.stdin.close()
    assert process.stdout.read() == b"" and process.wait() == 0
    process.stdout.close()
    process.stderr.close()


def test_killed_and_started_again(tmp_path):
    """Killed twice at moments of no choosing: the table is that of an uninterrupted run, byte for byte."""
    frames = text_of("knock", 240, knock=120, angle=0.2, points=30, outliers=0.05)
    source, whole, table, state = (tmp_path / n for n in ("s.csv", "whole.csv", "t.csv", "state"))
    source.write_text(ROWS + "".join(frames))
    done = start(source, "-o", whole, "--method", "iekf")
    assert done.communicate() and done.returncode == 0
    args = (source, "-o", table, "--method", "iekf", "--state", state, "--state-every", "7")
    for _ in range(2):
        process = start(*args)
        size = table.stat().st_size if table.exists() else 0
        deadline = time.monotonic() + 60
        while process.poll() is None and time.monotonic() < deadline:
            if state.exists() and table.exists() and table.stat().st_size > size + 20_000:
                break
            time.sleep(0.001)
        process.send_signal(signal.SIGKILL)
        process.communicate()
    (tmp_path / ".state.0123456789abcdef.camcal.part").write_text("killed while it wrote")
    last = start(*args)
    said = last.communicate()[1].decode()
    assert last.returncode == 0, said
    assert table.read_bytes() == whole.read_bytes()
    assert not [p.name for p in tmp_path.iterdir() if p.name.endswith(".part")]
    assert "240 frames" in said and "Changes: 1" in said


def test_the_rest_of_a_stream_is_enough(tmp_path):
    """A pipe that broke off: the second run gets only what the first has not seen."""
    frames = text_of("static", 40, points=30)
    whole, table, state = (tmp_path / n for n in ("whole.csv", "t.csv", "state"))

    def run(rows, *args):
        process = start("-", "--method", "window", *args, stdin=subprocess.PIPE)
        return process.communicate((ROWS + "".join(rows)).encode()), process.returncode

    assert run(frames, "-o", whole)[1] == 0
    for part in (frames[:13], frames[13:]):
        (_, said), code = run(part, "-o", table, "--state", state)
        assert code == 0, said
    assert table.read_bytes() == whole.read_bytes()


def test_killed_before_the_first_frame_and_started_again(tmp_path):
    frames = text_of("static", 12, points=30)
    source, whole, table, state = (tmp_path / n for n in ("s.csv", "whole.csv", "t.csv", "state"))
    source.write_text(ROWS + "".join(frames))
    assert start(source, "-o", whole).wait(60) == 0
    process = start("-", "-o", table, "--state", state, stdin=subprocess.PIPE)
    process.stdin.write(ROWS.encode())
    process.stdin.flush()
    wait_for(table.exists)
    process.kill()
    process.communicate()
    done = start("-", "-o", table, "--state", state, stdin=subprocess.PIPE)
    _, said = done.communicate(source.read_bytes())
    assert done.returncode == 0, said
    assert table.read_bytes() == whole.read_bytes()


def test_two_runs_do_not_write_one_table(tmp_path):
    frames = text_of("static", 12, points=30)
    table, state = tmp_path / "t.csv", tmp_path / "state"
    writer = start("-", "-o", table, "--state", state, stdin=subprocess.PIPE)
    writer.stdin.write((ROWS + "".join(frames[:6])).encode())
    writer.stdin.flush()
    wait_for(lambda: table.exists() and table.stat().st_size > 2000)
    rows = (ROWS + "".join(frames)).encode()
    for more in (("--state", state), ("--force",)):
        second = start("-", "-o", table, *more, stdin=subprocess.PIPE)
        _, said = second.communicate(rows)
        assert second.returncode == 2 and b"is being written by another run" in said
    _, said = writer.communicate("".join(frames[6:]).encode())
    assert writer.returncode == 0, said
    assert [int(r["frame"]) for r in read(table)] == list(range(12))


def test_a_table_that_appears_meanwhile_is_kept(tmp_path):
    frames = text_of("static", 6, points=30)
    table = tmp_path / "t.csv"
    source = tmp_path / "fifo.csv"
    os.mkfifo(source)
    process = start(source, "-o", table)
    with source.open("w") as stream:
        stream.write(ROWS + "".join(frames))
        stream.flush()
        table.write_text("made by another program")
    _, said = process.communicate()
    assert process.returncode == 2 and b"exists already" in said
    assert table.read_text() == "made by another program"
    assert not [p.name for p in tmp_path.iterdir() if p.name.endswith(".part")]


def wait_for(ready):
    deadline = time.monotonic() + 60
    while not ready():
        assert time.monotonic() < deadline
        time.sleep(0.005)


def test_a_state_goes_with_its_options(camcal, knock):
    assert camcal("track", knock, "-o", "t.csv", "--state", "s")[0] == 0
    code, _, err = camcal("track", knock, "-o", "t.csv", "--state", "s", "--method", "rls")
    assert code == 2 and "the state was made with method = 'kalman'" in err
    Path("t.csv").unlink()
    code, _, err = camcal("track", knock, "-o", "t.csv", "--state", "s")
    assert code == 2 and "the state belongs to a table" in err
    Path("s").write_text("{}")
    code, _, err = camcal("track", knock, "-o", "t.csv", "--state", "s")
    assert code == 3 and "not a state" in err


def test_pictures_of_a_fixed_board(camcal):
    """A board in front of a known camera that is turned by 0.5 degrees (4.4 px) after five pictures."""
    import cv2

    from camcal.detect import targets
    from camcal.geometry import rotations
    from camcal.model import lenses
    from camcal.model.camera import Camera
    from camcal.model.pose import Pose
    from camcal.study.render import Look, render

    lens = lenses.make("pinhole")
    camera = Camera(lens, lens.pinhole(500.0, 500.0, 319.5, 239.5), (640, 480))
    board = targets.make("checkerboard:8x5:25mm")
    rng = np.random.default_rng(0)
    Path("pictures").mkdir()
    for number in range(8):
        turn = rotations.exp(np.array([0.0, np.deg2rad(0.5 * (number >= 5)), 0.0]))
        at = Pose(rotations.exp(np.array([0.4, -0.3, 0.1])), np.array([-90.0, -60.0, 400.0]))
        pose = Pose(turn @ at.rotation, turn @ at.translation)
        picture = render(board.pattern(), camera, pose, Look(noise=4.0), rng)
        if number == 2:
            picture[:] = 128
        cv2.imwrite(f"pictures/{number:02d}.png", picture)
    Path("camera.yml").write_text(
        "camera_matrix: [[500, 0, 319.5], [0, 500, 239.5], [0, 0, 1]]\ndistortion_coefficients: []\n"
    )
    known = ("--camera", "camera.yml", "--fix", "intrinsics", "--board", "8x5", "--square", "25mm", "-j", "1")
    code, _, err = camcal("track", "pictures", *known, "-o", "t.csv", "--motion", "fixed")
    assert code == 0, err
    table = read("t.csv")
    assert [r["status"] for r in table].count("predicted") == 1 and table[2]["points"] == "0"
    assert [r["frame"] for r in table if r["changed"] == "1"] == ["5"]
    assert "0.5 deg about y" in err
    code, _, err = camcal("track", "pictures", "--board", "8x5", "-j", "1", "-o", "u.csv")
    assert code == 4 and "plane" in err and "--fix intrinsics" in err


def test_a_simulated_stream_is_tracked_to_its_truth(camcal):
    args = ("simulate", "frames", "--kind", "knock", "--frames", "40", "--at", "25", "--outliers", "0.05")
    code, _, err = camcal(*args, "-o", "s.csv")
    assert code == 0, err
    assert camcal(*args, "-o", "s.csv")[0] == 2  # exists
    code, _, err = camcal("track", "s.csv", "--motion", "fixed", "-o", "t.csv")
    assert code == 0 and "camera moved at frame 25: 0.3 deg about y" in err
    truth, found = read("s.truth.csv"), read("t.csv")
    assert [r["frame"] for r in truth] == [r["frame"] for r in found] == [str(i) for i in range(40)]
    for row, true in ((found[24], truth[24]), (found[39], truth[39])):
        for name in ("m11", "m24", "fx", "cy", "ry", "tz"):
            assert abs(float(row[name]) - float(true[name])) < 4.5 * float(row[f"sigma_{name}"])
    report = yaml.safe_load(Path("s.truth.yaml").read_text())
    last = [float(truth[-1][f"m{i}{j}"]) for i in "123" for j in "1234"]
    np.testing.assert_allclose(np.ravel(report["projection_matrix"]), last, rtol=1e-9)
    code, _, err = camcal("evaluate", "s.truth.yaml", "s.csv")  # the truth is a camera like any other
    assert code == 0, err


def test_devices_pipes_and_links_are_not_replaced(camcal, knock):
    os.mkfifo("pipe")
    got = []
    reader = threading.Thread(target=lambda: got.append(Path("pipe").read_text()))
    reader.start()
    code, _, err = camcal("track", knock, "-o", "pipe")
    reader.join(30)
    assert code == 0, err
    assert Path("pipe").is_fifo() and len(got[0].splitlines()) == 61
    Path("far").mkdir()
    Path("link.csv").symlink_to(Path("far") / "table.csv")
    assert camcal("track", knock, "-o", "link.csv")[0] == 0
    assert Path("link.csv").is_symlink() and Path("far/table.csv").read_text() == got[0]


def test_a_track_is_no_calibration(camcal, knock):
    assert camcal("track", knock, "-o", "a.csv", "--report", "r.yaml")[0] == 0
    for name in ("report", "doctor", "uncertainty"):
        code, _, err = camcal(name, "r.yaml", *(["-o", "r.html"] if name == "report" else []))
        assert code == 3 and "report of `camcal track`" in err


def test_gains_and_motions_are_listed(camcal):
    from camcal.track import GAIN_SUMMARIES, GAINS

    assert set(GAINS) == set(GAIN_SUMMARIES)
    code, out, _ = camcal("list", "gains", "--format", "json")
    assert code == 0 and {e["name"]: e["summary"] for e in json.loads(out)} == GAIN_SUMMARIES
    code, out, _ = camcal("list", "motions")
    assert code == 0 and "warms up" in out


def test_every_key_of_the_report_is_documented(camcal, knock):
    assert camcal("track", knock, "-o", "a.csv", "--report", "r.yaml")[0] == 0
    track = yaml.safe_load(Path("r.yaml").read_text())["track"]
    page = (Path(__file__).resolve().parents[2] / "docs" / "tracking.md").read_text()
    told = {word.strip() for part in page.split("`")[1::2] for word in part.split(",")}
    assert {*track, *(k for k in track["changes"][0] if not k.startswith("sigma_"))} <= told
