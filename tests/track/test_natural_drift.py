"""A rig followed through time by matches of natural scenes: derivatives, false alarms, knocks; the command line."""

import csv
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml

from camcal.geometry import rotations as so3
from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.model.pose import Pose
from camcal.track.rig_equations import inverse
from camcal.track.rig_matches import PairMatches, epipolar, instant_of_matches, rays_of
from tests.track.test_rig_drift import CAMERA, PLACES, calibrated_rigs

SIZE = (640, 480)


def scene(rng, names, count=100, moved=None, step=None, px=0.1):
    """Pixels of points that all of the cameras see: near ones and far ones."""
    xyz = np.c_[rng.uniform(-0.5, 0.5, 400), rng.uniform(-0.4, 0.4, 400), np.ones(400)]
    xyz *= rng.uniform(500, 5000, (400, 1))
    uv = {}
    for name in names:
        place = PLACES[name]
        if name == moved:
            place = Pose(so3.exp(step[:3]) @ place.rotation, place.translation + step[3:])
        uv[name] = CAMERA.project(place.apply(xyz))
    good = np.all([((p > 0) & (p < [639, 479])).all(1) for p in uv.values()], 0)
    rows = np.flatnonzero(good)[:count]
    return {name: p[rows] + rng.normal(0, px, (len(rows), 2)) for name, p in uv.items()}


def table(path, rng, names, count, at=None, moved="b", step=None):
    """Instants of a table view,camera,point,u,v; from `at` on a camera has moved."""
    rows = [["view", "camera", "point", "u", "v"]]
    for i in range(count):
        off = (moved, step) if at is not None and i >= at else (None, None)
        for name, uv in scene(rng, names, moved=off[0], step=off[1]).items():
            rows += [[i, name, j, *p] for j, p in enumerate(uv)]
    with Path(path).open("w", newline="") as file:
        csv.writer(file).writerows(rows)


@pytest.fixture(scope="module")
def rigs(tmp_path_factory):
    return calibrated_rigs(tmp_path_factory.mktemp("rigs"))


@pytest.fixture
def track(rigs, tmp_path, monkeypatch, capsys):
    """camcal track ... --rig --natural: exit code, stderr, rows, report."""
    from camcal.cli.boundary import run

    monkeypatch.chdir(tmp_path)

    def call(names, *words):
        given = ["--rig", str(rigs[names]), "--natural", "-o", "out.csv", "--report", "r.yaml", "--force"]
        code = run(["track", *words, *given])
        err = capsys.readouterr().err
        if not Path("out.csv").exists():
            return code, err, [], {}
        with Path("out.csv").open() as file:
            return code, err, list(csv.DictReader(file)), yaml.safe_load(Path("r.yaml").read_text())

    return call


# ------------------------------------------------------------------------------------------------ the equations
@pytest.mark.parametrize("spec", ["opencv5", "kb4"])
def test_derivatives(spec):
    """By differences, where e = 0: the derivative of the denominator is left out, which multiplies e."""
    lens = lenses.make(spec)
    params = lens.from_values({"fx": 600.0, "fy": 610.0, "cx": 322.0, "cy": 238.0, "k1": -0.05})
    rng = np.random.default_rng(0)
    xyz = np.c_[rng.uniform(-300, 300, 20), rng.uniform(-200, 200, 20), rng.uniform(700, 3000, 20)]
    places = [Pose.from_vector((0.1, 0.05, 0), (10, 3, 2)), PLACES["b"]]
    camera = Camera(lens, params, SIZE)
    uv = [camera.project(p.apply(xyz)) for p in places]
    size = lens.size

    def pair(own):
        return PairMatches(
            0, 1, (rays_of(own, uv[0], np.eye(size)), rays_of(camera, uv[1], 0 * np.eye(size)))
        )

    e, by_place, by_lens = epipolar(pair(camera), places)
    assert np.abs(e).max() < 1e-8
    for side in (0, 1):
        for k in range(6):
            step = np.zeros(6)
            step[k] = 1e-6 if k < 3 else 1e-4
            ends = []
            for sign in (1, -1):
                at, d = list(places), sign * step
                at[side] = Pose(so3.exp(d[:3]) @ at[side].rotation, at[side].translation + d[3:])
                ends.append(epipolar(pair(camera), at)[0])
            slope = (ends[0] - ends[1]) / (2 * step[k])
            np.testing.assert_allclose(slope, by_place[side][:, k], atol=1e-5 * np.abs(by_place[side]).max())
    for k in range(size):
        d = np.zeros(size)
        d[k] = 1e-4 if k < 4 else 1e-6
        ends = [epipolar(pair(Camera(lens, params + s * d, SIZE)), places)[0] for s in (1, -1)]
        np.testing.assert_allclose((ends[0] - ends[1]) / (2 * d[k]), by_lens[:, k], rtol=1e-4, atol=1e-4)


def test_a_pair_shows_five_numbers_and_the_scatter_of_what_it_shows():
    """χ² of the deviation of an instant over its covariance: 5 on the average."""
    found, names, nothing = [], "ab", np.zeros((2, 6, 0))
    for seed in range(100):
        uv = scene(np.random.default_rng(seed), names, 60)
        rays = tuple(rays_of(CAMERA, uv[n], np.zeros((4, 0))) for n in names)
        made = instant_of_matches("0", [PairMatches(0, 1, rays)], [PLACES[n] for n in names], nothing)
        own = made.instant.normal[6:, 6:]
        inverted, rank = inverse(own)
        assert rank == 5
        step = inverted @ made.instant.right[6:]
        along = PLACES["b"].translation / np.linalg.norm(PLACES["b"].translation)
        assert abs(step[3:] @ along) < 1e-6 * np.linalg.norm(step[3:])
        found.append(step @ own @ step)
    assert np.mean(found) == pytest.approx(5, abs=4 * np.sqrt(2 * 5 / len(found)))


def test_inverse():
    """Of a singular matrix with units: A G A = A, and solutions are orthogonal to the null space."""
    rng = np.random.default_rng(0)
    units = np.array([1e3, 1e3, 1e3, 1e-2, 1e-2, 1e-2])
    null = np.r_[np.zeros(3), 0.6, 0.0, 0.8]
    rows = rng.normal(size=(40, 6)) * units
    rows -= np.outer(rows @ null, null)
    matrix = rows.T @ rows
    found, rank = inverse(matrix)
    assert rank == 5 and np.abs(found @ null).max() < 1e-9 * np.abs(found).max()
    np.testing.assert_allclose(matrix @ found @ matrix, matrix, rtol=1e-6, atol=1e-9 * np.abs(matrix).max())
    np.testing.assert_allclose(inverse(np.diag(units))[0], np.diag(1 / units))


# ------------------------------------------------------------------------------------------------------ tables
@pytest.mark.parametrize("names", ["ab", "abc"])
def test_a_rig_that_stays(track, names):
    table("t.csv", np.random.default_rng(2), names, 24)
    code, err, rows, report = track(names, "t.csv", "--fail-on-change")
    assert code == 0 and "Changes: 0" in err and "matches" in err, err
    assert report["track"]["statuses"] == {"used": 24} and len(rows) == 24 * len(names)
    # χ² has 5 and 6 degrees of freedom, medians 4.4 and 5.3; the calibration's error is in it, and common to all
    assert 1 < np.median([float(r["chi2"]) for r in rows if r["camera"] == "b"]) < 10
    # neighbours scatter as their noise says: their figures are known to 20 % from 23 differences
    assert 1 <= report["track"]["variance_factor"] < 1.6


@pytest.mark.parametrize("names", ["ab", "abc"])
def test_a_knock_is_found_named_and_measured(track, names):
    """0.2 degrees about x, which moves points across their epipolar lines by 2 px."""
    step = np.array([np.radians(0.2), 0, 0, 0, 0, 0])
    table("t.csv", np.random.default_rng(3), names, 16, at=8, step=step)
    code, err, _, report = track(names, "t.csv", "--fail-on-change")
    assert code == 1 and report["verdict"] == "fail"
    (change,) = report["track"]["changes"]
    assert change["since"] in ("7", "8", "9") and 8 < int(change["frame"]) < 12
    named = "camera b moved at" if names == "abc" else "a and b moved relative to each other"
    assert named in err, err
    sigma = 4 * max(change["sigma_rotation_deg"])
    assert np.linalg.norm(change["rotation_deg"]) == pytest.approx(0.2, abs=sigma)
    assert 1 < change["shift_px"] < 3
    got = Pose.from_vector(*(np.array(v) for v in report["rig"]["cam_from_rig"]["b"].values()))
    after = so3.exp(step[:3]) @ PLACES["b"].rotation
    assert so3.angle_between(got.rotation, after) < np.radians(sigma)


@pytest.mark.parametrize(
    "words, code, said",
    [
        (("z.csv",), 3, "no camera 'z'"),
        (("few.csv",), 3, "share 20 points"),
        (("twice.csv",), 3, "lists a point twice"),
        (("few.csv", "--square", "30mm"), 2, "--square has no effect with --natural"),
        (("a=here",), 2, "a rig has two or more cameras"),
        (("a=here", "z=there"), 3, "no camera 'z'"),
    ],
)
def test_refusals(track, words, code, said):
    head = "view,camera,point,u,v\n"
    Path("few.csv").write_text(head + "".join(f"0,{c},{i},{9 * i},{7 * i}\n" for c in "ab" for i in range(9)))
    Path("z.csv").write_text(head + "".join(f"0,{c},{i},{9 * i},{7 * i}\n" for c in "az" for i in range(30)))
    Path("twice.csv").write_text(head + "0,a,1,5,5\n0,a,1,6,6\n0,b,1,5,5\n")
    got, err, _, _ = track("ab", *words)
    assert got == code and said in err, err


def test_natural_needs_the_rig(capsys):
    from camcal.cli.boundary import run

    assert run(["track", "t.csv", "--natural"]) == 2
    assert "--natural needs the rig" in capsys.readouterr().err


# ---------------------------------------------------------------------------------------------------- pictures
def pictures(instant, place):
    """Blurred noise on two walls, at 900 and 2000 mm, as a camera at cam_from_rig sees it."""
    rng = np.random.default_rng(instant)
    u, v = np.meshgrid(np.arange(SIZE[0], dtype=float), np.arange(SIZE[1], dtype=float))
    rays = CAMERA.unproject(np.stack([u, v], -1)) @ place.rotation
    shown = np.zeros(SIZE[::-1], np.uint8)
    for depth, scale in ((2000.0, 3.0), (900.0, 1.5)):
        texture = rng.uniform(0, 255, (1000, 1200)).astype(np.float32)
        texture = cv2.normalize(cv2.GaussianBlur(texture, (0, 0), 2.5), None, 0, 255, cv2.NORM_MINMAX)
        xyz = place.centre + rays * ((depth - place.centre[2]) / rays[..., 2])[..., None]
        at = [(xyz[..., k] / scale + size / 2).astype(np.float32) for k, size in ((0, 1200), (1, 1000))]
        wall = cv2.remap(texture, *at, cv2.INTER_CUBIC).clip(0, 255).astype(np.uint8)
        near = xyz[..., 0] < 0  # the nearer wall covers one half
        shown = np.where(near, wall, shown) if depth < 1000 else wall
    return shown


@pytest.mark.parametrize("film", [False, True])
def test_pictures_and_films(track, film):
    """Four instants; camera b is knocked by 0.2 degrees before the third."""
    knocked = Pose(so3.exp([np.radians(0.2), 0, 0]) @ PLACES["b"].rotation, PLACES["b"].translation)
    for name in "ab":
        Path(name).mkdir()
        if film:
            kind = cv2.VideoWriter_fourcc(*"FFV1")
            writer = cv2.VideoWriter(f"{name}/film.avi", kind, 10, SIZE)
        for i in range(4):
            shown = pictures(i, PLACES["a"] if name == "a" else knocked if i >= 2 else PLACES["b"])
            if film:
                writer.write(cv2.cvtColor(shown, cv2.COLOR_GRAY2BGR))
            else:
                cv2.imwrite(f"{name}/{name}{i}.png", shown)
        if film:
            writer.release()
    words = [f"{n}={n}/film.avi" if film else f"{n}={n}" for n in "ab"]
    code, err, rows, report = track("ab", *words, "--fail-on-change")
    assert code == 1 and len(rows) == 8, err
    (change,) = report["track"]["changes"]
    assert (change["since"], change["frame"]) == ("2", "3")
    assert np.linalg.norm(change["rotation_deg"]) == pytest.approx(0.2, abs=0.05)
    if film:  # every second frame: one before, one after
        assert track("ab", *words, "--every", "2")[3]["track"]["frames"] == 2
