"""Whether a free board improves the camera: the offsets' size, and the choice, on boards that are known."""

from dataclasses import replace

import numpy as np
import pytest

from camcal.assess.difference import difference
from camcal.assess.shape_benefit import change
from camcal.plan.calibrate import calibrate
from tests.solved import camera_of, grid, observe, tilted_poses

BOARD = grid()
TRUTH = camera_of("opencv5")


def boards(offset, views, seed, noise=0.05):
    rng = np.random.default_rng(seed)
    true = BOARD + rng.normal(0, offset, BOARD.shape)
    data = observe(TRUTH, tilted_poses(BOARD, views, rng), true, noise, rng)
    return data.with_views(tuple(replace(v, xyz=BOARD) for v in data.views))


def both(data, simple="flat"):
    return [calibrate(data, board_shape=kind, checks=False) for kind in (simple, "free")]


@pytest.mark.parametrize("simple", ["flat", "bowl", "print"])
@pytest.mark.parametrize("offset", [0.002, 0.01])
def test_the_offsets_are_as_large_as_they_are(offset, simple):
    # 155 offsets are known to 1 / sqrt(2 x 155) = 6 %, three times that
    found = change(*both(boards(offset, 12, 1), simple))
    assert found.tau == pytest.approx(offset, rel=0.18)


@pytest.mark.parametrize("seed", range(3))
def test_a_flat_board_has_none_and_stays_flat(seed):
    found = change(*both(boards(0.0, 8, seed)))
    assert found.tau < 5e-4
    assert not found.better


@pytest.mark.parametrize("seed", range(3))
def test_large_offsets_are_worth_it(seed):
    flat, free = both(boards(0.01, 8, seed))
    assert change(flat, free).better
    errors = [difference(TRUTH, s.camera).rms_px for s in (flat, free)]
    assert errors[1] < errors[0]


def test_the_predicted_move_is_the_real_one():
    # the middle lies on the way between two linear predictions; the real way is bent by less than a fifth
    flat, free = both(boards(0.005, 12, 4))
    found = change(flat, free)
    apart = difference(flat.camera, free.camera).rms_px
    assert found.simple_px + found.shaped_px == pytest.approx(apart, rel=0.2)


def test_auto_leaves_a_shape_that_costs_more_than_it_brings():
    # offsets of .001 in five views: significant and better on held-out views, but the camera gets worse
    data = boards(0.001, 5, 6)
    auto = calibrate(data, board_shape="auto", checks=False)
    said = auto.observations.target["shape"]
    free = next(t for t in said["tried"] if t["kind"] == "free")
    assert said["kind"] == "flat"
    assert free["p_value"] < 1e-3
    assert free["simpler_error_px"] < free["error_px"]
    assert free["offset_sigma"] == pytest.approx(0.001, rel=0.5)
