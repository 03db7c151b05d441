"""Pictures mirrored as a whole: seen by the lens alone, so only where the lens has a handedness."""

from dataclasses import replace

import numpy as np
import pytest

from camcal.assess.checks.facts import Facts
from camcal.assess.checks.mirror import gains_of_mirroring, mirrored_pictures
from camcal.assess.checks.views import mirrored as mirrored_views
from camcal.plan.calibrate import calibrate
from tests.solved import SIZE, TRUTH, camera_of, grid, observe, rig, tilted_poses

OFF_CENTRE = TRUTH | {"cx": 340.0}
CENTRED = TRUTH | {"cx": (SIZE[0] - 1) / 2, "p1": 0.0, "p2": 0.0}


def found(views=10, mirrored=(), truth=OFF_CENTRE, xyz=None, seed=2, noise=0.1):
    rng = np.random.default_rng(seed)
    xyz = grid() if xyz is None else xyz
    data = observe(camera_of("opencv5", truth), tilted_poses(xyz, views, rng), xyz, noise, rng)
    flipped = [
        replace(v, uv=np.c_[SIZE[0] - 1 - v.uv[:, 0], v.uv[:, 1]].reshape(6, 9, 2)[:, ::-1].reshape(-1, 2))
        if i in mirrored
        else v
        for i, v in enumerate(data.views)
    ]
    return Facts(calibrate(data.with_views(tuple(flipped)), robust="none", checks=False))


@pytest.mark.parametrize("mirrored", [(3,), (0, 7)])
def test_those_views_are_named_and_no_others(mirrored):
    (warning,) = mirrored_pictures(found(mirrored=mirrored))
    assert warning.message.endswith(": " + ", ".join(f"view{i}" for i in mirrored) + ".")


@pytest.mark.parametrize("seed", range(4))
def test_good_views_are_left_alone(seed):
    assert not list(mirrored_pictures(found(seed=seed)))


def test_a_symmetric_lens_cannot_tell_and_is_not_harmed():
    facts = found(mirrored=(3,), truth=CENTRED)
    assert not list(mirrored_pictures(facts))
    assert abs(facts.camera.values["fx"] - CENTRED["fx"]) < 1.5  # 0.4 px is its sigma


def test_with_most_views_mirrored_the_others_are_named():
    (warning,) = mirrored_pictures(found(mirrored=range(7)))
    assert warning.message.endswith(": view7, view8, view9.")


def test_points_in_space_and_pictures_of_no_known_size_are_not_looked_at():
    assert not list(mirrored_pictures(found(xyz=rig(count=54))))
    facts = found(mirrored=(3,))
    facts.image_size = None
    assert not list(mirrored_pictures(facts))


def test_the_mirrored_start_is_the_pose_of_the_mirrored_view():
    # a view that is its own mirror image gains nothing and loses nothing
    facts = found(mirrored=(), truth=CENTRED, noise=0.0)
    gains, counts = gains_of_mirroring(facts, np.arange(10))
    assert (counts == 54).all()
    assert (
        np.sqrt(
            np.exp(-gains)
            * [np.square(r).sum() for r in facts.solution.observations.split(facts.solution.residuals)]
        ).max()
        < 1e-3
    )


def upwards(printed: dict | None, up: bool):
    """Whether views of a target, all with v counted upwards or none, are said to be seen from behind."""
    rng = np.random.default_rng(0)
    data = observe(camera_of(), tilted_poses(grid(), 8, rng), grid(), 0.1, rng)
    if up:
        data = data.map_views(lambda v: replace(v, uv=np.c_[v.uv[:, 0], SIZE[1] - 1 - v.uv[:, 1]]))
    facts = Facts(calibrate(replace(data, target=printed), robust="none", checks=False))
    return [(w.code, w.severity) for w in mirrored_views(facts)]


def test_v_counted_upwards_in_all_views_of_a_printed_target():
    """A target whose printed side is known cannot be seen from behind; of any other plane nothing tells."""
    assert upwards({"printed": True}, True) == [("mirrored-picture", "doubtful")]
    assert upwards({"kind": "checkerboard"}, True) == [("mirrored-picture", "wrong")]
    assert upwards({"printed": True}, False) == [] == upwards({"kind": "checkerboard"}, False)
    assert upwards(None, True) == [] == upwards(None, False)
