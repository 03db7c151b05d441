"""The instant to take next does what is promised of it."""

from dataclasses import replace

import numpy as np
import pytest

from camcal import calibrate_rig
from camcal.assess.covariance import covariance
from camcal.assess.next_instant import suggest
from camcal.assess.rig import baseline_sigma
from camcal.errors import DataError
from camcal.plan.known_rig import evaluate_rig
from tests.rigs import LENS, board, observed, truth


def with_instant(data, rig, pose, noise=0.2, seed=9):
    """The observations with one instant more."""
    rng, xyz, more = np.random.default_rng(seed), board(), []
    for index, name in enumerate(rig.cameras):
        uv = rig.cameras[name].project((rig.cam_from_rig[name] @ pose).apply(xyz))
        more.append((index, uv + rng.normal(0, noise, uv.shape)))
    count, size = len(more), len(xyz)
    camera = np.r_[data.camera, np.repeat([i for i, _ in more], size)]
    view = np.r_[data.view, np.full(count * size, len(data))]
    order = np.lexsort((view, camera))
    return replace(
        data,
        xyz=np.r_[data.xyz, np.tile(xyz, (count, 1))][order],
        uv=np.r_[data.uv, np.concatenate([uv for _, uv in more])][order],
        view=view[order],
        camera=camera[order],
        point=np.r_[data.point, np.tile(np.arange(size), count)][order],
        view_ids=(*data.view_ids, str(len(data))),
        used=np.zeros(0, bool),
        reason=np.zeros(0, np.uint8),
    )


def relative(solution):
    return baseline_sigma(solution, covariance(solution), "a", "b") / solution.rig.baseline("a", "b")


def test_the_distance_is_known_as_well_as_promised():
    """To a tenth: the noise of the estimate is estimated anew, and the rig moves a little."""
    rig = truth("ab")
    data, _ = observed(rig, instants=6)
    before = calibrate_rig(data, model=LENS, checks=False)
    now, (best,) = suggest(before)
    assert now["a", "b"] == pytest.approx(relative(before), rel=1e-6)
    assert best.worst < now["a", "b"] and best.cameras == ("a", "b")
    after = calibrate_rig(with_instant(data, rig, best.pose), model=LENS, checks=False)
    scale = covariance(before).sigma_0 / covariance(after).sigma_0
    assert scale * relative(after) == pytest.approx(best.worst, rel=0.1)


def test_it_is_better_than_a_picture_that_was_taken():
    rig = truth("ab")
    data, _ = observed(rig, instants=7)
    fewer = data.of_views(range(6))
    now, (best,) = suggest(calibrate_rig(fewer, model=LENS, checks=False))
    taken = calibrate_rig(data, model=LENS, checks=False)
    assert best.worst < relative(taken) * 1.02 < now["a", "b"] * 1.05


def test_several_are_each_as_if_those_before_were_taken():
    _, found = suggest(calibrate_rig(observed(truth("abc"))[0], model=LENS, checks=False), count=3)
    worst = [s.worst for s in found]
    assert worst == sorted(worst, reverse=True) and len(set(worst)) == 3


def test_a_rig_of_which_nothing_was_estimated():
    rig = truth("ab")
    with pytest.raises(DataError, match="no parameter of this rig"):
        suggest(evaluate_rig(rig, observed(rig, instants=4)[0]))
