"""A known camera on data that are not what they are taken for, and on few points."""

from dataclasses import replace

import numpy as np
import pytest

from camcal.assess.known import FAR, SUSPICIONS, WORSE, Promise, check_known, median_of
from camcal.data.observations import Correspondences, View
from camcal.errors import DataError
from camcal.model.camera import Camera
from camcal.model.lenses import make
from camcal.plan.calibrate import calibrate
from camcal.plan.known_camera import evaluate, fully_known
from camcal.plan.options import Options
from camcal.plan.run import usable
from camcal.start.mirrored import mirrored_error, which

SIZE = (640, 480)
LENS = make("opencv5")
CAMERA = Camera(
    LENS, LENS.from_values({"fx": 600.0, "fy": 600.0, "cx": 333.0, "cy": 250.0, "k1": -0.1}), SIZE
)


def views_of(rng, count=3, points=30, noise=0.2):
    xyz = rng.uniform(-1, 1, (points, 3))
    found = []
    for i in range(count):
        turn = np.linalg.qr(np.eye(3) + 0.3 * rng.normal(size=(3, 3)))[0]
        turn *= np.sign(np.diag(turn))
        if np.linalg.det(turn) < 0:
            turn[:, 2] *= -1
        uv = CAMERA.project(xyz @ turn.T + [0.1 * i, 0.05, 6.0])
        found.append(View(f"v{i}", xyz, uv + noise * rng.normal(size=uv.shape)))
    return found


WRONG = {
    "upwards": lambda v: replace(v, uv=np.c_[v.uv[:, 0], 479 - v.uv[:, 1]]),
    "u and v are exchanged": lambda v: replace(v, uv=v.uv[:, ::-1].copy()),
    "mirrored": lambda v: replace(v, uv=np.c_[639 - v.uv[:, 0], v.uv[:, 1]]),
    "left-handed": lambda v: replace(v, xyz=v.xyz * [1.0, 1.0, -1.0]),
    "another size, 2 times": lambda v: replace(v, uv=2 * v.uv + 0.5),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_was_exchanged_is_named(name):
    views = [WRONG[name](v) for v in views_of(np.random.default_rng(3))]
    found = evaluate(CAMERA, Correspondences.from_views(views), "auto", promise=Promise(0.25))
    assert found.grade == "wrong" and found.verdict == "fail"
    assert name in found.warnings[0].message and found.warnings[0].code == "data-exchanged"


def test_its_own_data_are_not_suspected():
    found = evaluate(
        CAMERA, Correspondences.from_views(views_of(np.random.default_rng(4))), "auto", promise=Promise(0.25)
    )
    assert found.warnings == () and found.verdict == "pass"


@pytest.mark.parametrize(
    ("times", "grade"), [(0.95 * WORSE, "good"), (1.05 * WORSE, "doubtful"), (1.05 * FAR, "wrong")]
)
def test_residuals_are_judged_by_the_report(times, grade):
    """Noise that many times what the report promises; above a pixel, so that the factor alone decides."""
    views = views_of(np.random.default_rng(5), noise=1.5)
    plain = evaluate(CAMERA, Correspondences.from_views(views))
    found = evaluate(CAMERA, Correspondences.from_views(views), promise=Promise(median_of(plain) / times))
    assert found.grade == grade


def test_without_a_promise_only_large_residuals_count():
    data = Correspondences.from_views(views_of(np.random.default_rng(5), noise=1.5))
    assert evaluate(CAMERA, data).grade == "good"
    assert check_known(evaluate(CAMERA, data), data) == ()


@pytest.mark.parametrize("count", [4, 5])
def test_four_points_in_space_are_enough(count):
    views = views_of(np.random.default_rng(6), 1, count, noise=0.0)
    data = Correspondences.from_views(views)
    found = evaluate(CAMERA, usable(data, known=True))
    assert found.rms_point < 1e-6  # exact data: rounding of coordinates, through the undistortion
    fix = dict(zip(LENS.names, CAMERA.params.tolist(), strict=True))
    made = calibrate(data, "opencv5", fix=fix, crosscheck=False)
    assert np.allclose(made.camera.params, CAMERA.params)
    assert np.abs(made.poses[0].rotation - found.poses[0].rotation).max() < 1e-9


def test_three_points_are_not():
    data = Correspondences.from_views(views_of(np.random.default_rng(6), 1, 3))
    with pytest.raises(DataError, match="at least 4"):
        usable(data, known=True)
    with pytest.raises(DataError, match="6 are needed"):
        usable(Correspondences.from_views(views_of(np.random.default_rng(6), 1, 5)))


def test_a_camera_is_known_where_every_parameter_has_a_value():
    fix = dict(zip(LENS.names, CAMERA.params.tolist(), strict=True))
    assert fully_known(Options("opencv5", fix=fix), SIZE) is not None
    for less in ({**fix, "k1": None}, {n: v for n, v in fix.items() if n != "cx"}):
        assert fully_known(Options("opencv5", fix=less), SIZE) is None
    assert fully_known(Options("auto", fix=fix), SIZE) is None


@pytest.mark.parametrize(
    ("down", "wanted"),
    [
        ([0, 0, 1.0], "upwards"),
        ([0, 1.0, 0], "upwards"),
        ([0, 0, -1.0], "left-handed"),
        ([1.0, 0, 0], "exchanged"),
    ],
)
def test_which_reflection(down, wanted):
    """`down` is the direction of the world in which v grows; u runs along another axis."""
    v = np.array(down)
    u = np.array([0, 0, 1.0]) if wanted == "exchanged" else np.array([1.0, 0, 0])
    reflected = np.stack([u, v, -np.cross(u, v)])
    assert np.linalg.det(reflected) == pytest.approx(-1)
    assert which(reflected)[0] == wanted
    error = mirrored_error(-reflected)
    assert all(w in error.message + error.hint for w in ("upwards", "exchanged", "left-handed"))


def test_a_slanted_camera_says_nothing():
    # v grows along no axis: 45 degrees between two, and a little less to each
    v = np.array([0.65, 0.55, 0.53]) / np.linalg.norm([0.65, 0.55, 0.53])
    u = np.cross(v, [0, 0, 1.0])
    u /= np.linalg.norm(u)
    assert which(np.stack([u, v, -np.cross(u, v)])) == ("", "")
    assert len(SUSPICIONS) > 4
