"""Relative poses from the poses of single cameras: half turns, the spanning tree, rigs in parts."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from camcal.errors import EstimationError
from camcal.geometry import rotations
from camcal.model.pose import Pose, Poses
from camcal.solve.refine import residuals
from camcal.solve.rig_start import Pictures, corners_of, links, placed, spanning_tree
from camcal.solve.turns import symmetries
from tests.rigs import board, observed, truth

HALF_TURN = rotations.exp(np.array([0.0, 0.0, np.pi]))


def exact(names="abc", instants=6, seed=0, **more):
    rig = truth(names)
    data, poses = observed(rig, seed, instants, noise=0.0, **more)
    b = data.blocks
    each = [rig.cam_from_rig[data.cameras[c]] @ poses[v] for c, v in zip(b.camera, b.view, strict=True)]
    return rig, data, poses, Pictures(b.camera, b.view, Poses.stack(each), np.ones(len(b)))


def read_the_other_way_round(data, pictures, blocks):
    """The same pictures with the points of some blocks named from the board's other end."""
    middle = (data.xyz.min(0) + data.xyz.max(0)) / 2
    turn = Pose(HALF_TURN, middle - HALF_TURN @ middle)
    xyz, point, poses = data.xyz.copy(), data.point.copy(), list(pictures.poses)
    for block in blocks:
        rows = data.slices[block]
        point[rows] = 53 - point[rows]
        xyz[rows] = board()[point[rows]]
        poses[block] = poses[block] @ turn
    return replace(data, xyz=xyz, point=point), replace(pictures, poses=Poses.stack(poses))


def start(data, pictures):
    turns, corners = symmetries(data), corners_of(data.xyz)
    found = links(pictures, turns, corners, len(data.cameras))
    relative, _ = spanning_tree(found, data.cameras)
    return relative, *placed(pictures, relative, data, turns, corners)


@pytest.mark.parametrize("names", ["ab", "abc", "abcd"])
def test_exact_poses_give_the_rig_back(names):
    rig, data, poses, pictures = exact(names)
    relative, _, boards, turned = start(data, pictures)
    for pose, name in zip(relative, names, strict=True):
        np.testing.assert_allclose(pose.matrix, rig.cam_from_rig[name].matrix, rtol=0, atol=1e-9)
    np.testing.assert_allclose(boards.matrix, poses.matrix, rtol=0, atol=1e-8)
    assert turned == 0


@settings(max_examples=15, deadline=None)
@given(st.sets(st.integers(0, 17), max_size=8))
def test_boards_read_the_other_way_round_are_sorted_out(blocks):
    """Whichever pictures were read from the other end: afterwards one rig and one board explain all of them."""
    rig, data, _, pictures = exact("abc")
    data, pictures = read_the_other_way_round(data, pictures, sorted(blocks))
    relative, renamed, boards, _ = start(data, pictures)
    made = replace(rig, cam_from_rig=dict(zip("abc", relative, strict=True)))
    assert np.abs(residuals(made, boards, renamed)).max() < 1e-6
    ids = {tuple(x): i for i, x in enumerate(board().tolist())}
    assert [ids[tuple(x)] for x in renamed.xyz.tolist()] == renamed.point.tolist()


def test_symmetries_of_boards():
    _, data, _, _ = exact("ab", instants=2)
    assert len(symmetries(data)) == 2
    square, _ = observed(truth("ab"), instants=2, xyz=board(6, 6))
    assert len(symmetries(square)) == 4
    assert len(symmetries(replace(data, target={"kind": "charuco"}))) == 1
    bent = data.xyz.copy()
    bent[:, 2] = bent[:, 0] ** 2 / 1e3
    assert len(symmetries(replace(data, xyz=bent))) == 1


def test_a_static_board_is_not_turned():
    """Before cameras that never move against the board, turned and unturned are equally good: as it was read."""
    _, data, _, pictures = exact("ab", instants=1)
    _, _, _, turned = start(data, pictures)
    assert turned == 0


def test_a_camera_that_shares_no_instant_is_named():
    _, data, _, pictures = exact("abcd")
    apart = np.where(pictures.camera < 2, pictures.view * 2, pictures.view * 2 + 1)
    found = links(replace(pictures, view=apart), symmetries(data), corners_of(data.xyz), 4)
    with pytest.raises(EstimationError, match=r"2 groups.*a and b; c and d") as error:
        spanning_tree(found, data.cameras)
    assert "connect" in error.value.hint


def test_the_tree_takes_the_links_that_know_most():
    """b and c saw one instant together, each of them saw all instants with a."""
    _, data, _, pictures = exact("abc")
    found = links(pictures, symmetries(data), corners_of(data.xyz), 3)
    weak = {**found, (1, 2): replace(found[1, 2], information=1e-3)}
    assert sorted(spanning_tree(weak, data.cameras)[1]) == [(0, 1), (0, 2)]
    weak = {**found, (0, 2): replace(found[0, 2], information=1e-3)}
    assert sorted(spanning_tree(weak, data.cameras)[1]) == [(0, 1), (1, 2)]
