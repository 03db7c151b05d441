"""What every entry of CLOSED_FORMS promises, on the kind of scene it takes."""

import numpy as np
import pytest

from camcal.data.observations import Correspondences, View
from camcal.errors import CamcalError, DataError
from camcal.registry import look_up
from camcal.start import CLOSED_FORMS, shape
from camcal.start.base import ClosedForm
from tests.start import scenes

ONE = [[0.3, -0.4, 0.2]]
TURNS = {
    "central": ONE,
    "claus": scenes.tilts(8),
    "dlt": ONE,
    "dlt12": ONE,
    "dlt14": ONE,
    "dlt16": ONE,
    "fitzgibbon": scenes.tilts(8),
    "mdlt": ONE,
    "tsai": ONE,
    "zhang": scenes.tilts(8),
}
PLANES = {"claus", "fitzgibbon", "zhang"}  # those that take planes
NO_SKEW = {"mdlt"}  # those that assume none
#: those that assume square pixels and the image's centre
SQUARE = {"tsai"}
#: 'central' minimises another error in another frame: m34 = 1 hangs on the origin
#: and 'claus' holds what exact pinhole data leave undetermined by a weak prior, which magnifies rounding
MOVED = {"central": 0.02, "claus": 1e-5}
#: what the prior of 'claus' adds to rounding, in its units
PRIOR = {"claus": 1e4}
#: 'tsai' takes planes and points in space, but no plane parallel to the picture
WRONG = {"tsai": [[0, 0, 0.1]]}
#: those that the geometry of the points chooses; the rest are asked for by name
CHOSEN = {"central", "dlt", "zhang"}


def estimator(name):
    return look_up(CLOSED_FORMS, name, "closed form")


def example(name, turns=None, **more):
    points = scenes.board() if name in PLANES else scenes.rig()
    matrix = scenes.K_NO_SKEW if name in NO_SKEW else scenes.SQUARE if name in SQUARE else scenes.K
    return scenes.scene(points, turns or TURNS[name], matrix, **more)


@pytest.fixture(params=sorted(CLOSED_FORMS))
def name(request):
    return request.param


def test_every_entry_has_an_example(name):
    assert name in TURNS


def test_exact_data_give_the_camera(name):
    scene = example(name)
    found = estimator(name)(scene.observations, skew=True)
    assert isinstance(found, ClosedForm) and found.name == name
    # 12 digits of the data less 3 for the conditioning of the equations, on entries of 1000 px
    np.testing.assert_allclose(found.matrix, scene.matrix, rtol=0, atol=1e-6 * PRIOR.get(name, 1))
    angle, distance = scenes.pose_error(found.poses, scene.poses)
    assert max(angle, distance) < 1e-9 * PRIOR.get(name, 1)
    assert found.info["degenerate"] is False and found.info["mirrored"] is False
    assert isinstance(found.info["assumptions"], list)
    assert found.info["condition"] >= 1


def test_the_projection_matrix_is_the_camera_s(name):
    scene = example(name, ONE)
    found = estimator(name)(scene.observations)
    m = found.projection_matrix
    assert m.shape == (3, 4) and m[2, 3] == pytest.approx(1)
    pose = found.poses[0]
    composed = found.matrix @ np.c_[pose.rotation, pose.translation]
    np.testing.assert_allclose(m, composed / composed[2, 3], rtol=1e-9, atol=1e-9)


def test_a_moved_world_moves_the_poses_only(name):
    scene = example(name, noise=0.2)
    turn = scenes.rotations.exp(np.array([1.0, 2.0, -0.5]))
    moved = Correspondences.from_views(
        [(v.xyz @ turn.T + [10.0, -20.0, 5.0], v.uv) for v in scene.observations.views],
        image_size=scenes.SIZE,
    )
    first = estimator(name)(scene.observations)
    second = estimator(name)(moved)
    tolerance = MOVED.get(name, 1e-8)
    np.testing.assert_allclose(second.matrix, first.matrix, rtol=tolerance, atol=1e-6)
    for old, new in zip(first.poses, second.poses, strict=True):
        np.testing.assert_allclose(new.rotation @ turn, old.rotation, atol=tolerance)


def test_points_of_little_weight_do_not_count(name):
    scene = example(name)
    views = []
    for v in scene.observations.views:
        uv, sigma = v.uv.copy(), np.ones(len(v))
        uv[3] += 20
        sigma[3] = 1e7
        views.append(View(v.id, v.xyz, uv, sigma))
    found = estimator(name)(Correspondences.from_views(tuple(views), image_size=scenes.SIZE))
    # the spoilt point keeps 1e-14 of the weight
    assert abs(found.matrix[0, 0] - scene.matrix[0, 0]) < 1.0
    assert scenes.pose_error(found.poses, scene.poses)[0] < 2e-3


@pytest.mark.parametrize("count", [1, 3])
def test_too_few_points(name, count):
    scene = example(name)
    few = Correspondences.from_views(tuple(v.take(slice(count)) for v in scene.observations.views))
    with pytest.raises(DataError, match=rf"{count} points"):
        estimator(name)(few)


def test_points_on_a_line(name):
    t = np.arange(20.0)
    line = np.stack([t, 2 * t, 0 * t], 1)
    with pytest.raises(DataError, match="line"):
        estimator(name)(Correspondences.from_views([(line, 50 + line[:, :2])]))


def test_no_view(name):
    with pytest.raises(DataError, match="no view"):
        estimator(name)(Correspondences.from_views(()))


def test_the_input_is_not_changed(name):
    scene = example(name)
    before = [(v.xyz.copy(), v.uv.copy()) for v in scene.observations.views]
    estimator(name)(scene.observations)
    for (xyz, uv), v in zip(before, scene.observations.views, strict=True):
        np.testing.assert_array_equal(xyz, v.xyz)
        np.testing.assert_array_equal(uv, v.uv)


def test_errors_carry_a_hint(name):
    if name == "fitzgibbon":
        pytest.skip("takes planes and points in space; its errors are those of the closed forms it calls")
    wrong = scenes.scene(scenes.rig() if name in PLANES else scenes.board(), WRONG.get(name, scenes.tilts(3)))
    said = "takes one view|accepts views of planes|lie on a plane|cannot separate|takes planes"
    with pytest.raises(CamcalError, match=said) as caught:
        estimator(name)(wrong.observations)
    assert caught.value.hint


def test_choose_names_entries_of_the_table(name):
    names, why = shape.choose(example(name).observations)
    assert (name in names) == (name in CHOSEN) and why
    assert set(names) <= set(CLOSED_FORMS)
