"""Rigs before several boards: which stand fast to each other, and cameras that never see the same one."""

from dataclasses import replace

import numpy as np
import pytest

import camcal
from camcal.assess.board_shape import separate
from camcal.assess.covariance import covariance
from camcal.assess.rig import board_sigmas, relative_sigmas
from camcal.data.observations import Observations
from camcal.errors import DataError, EstimationError
from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.model.pose import Pose
from camcal.model.rig import Rig
from camcal.report.board import on_known_board
from camcal.report.rig import document
from camcal.report.rig_loading import from_document
from camcal.report.yaml import read_document, save
from camcal.solve.several_boards import similarities
from tests.rigs import SIZE, board, pose

LENS = "brown:radial=1,decentering=0"
POINTS = board() - board().mean(0)
#: world_from_board: one ahead of camera a, one beside it, one behind
BOARDS = {
    "front": pose((0.1, 0.05, 0), (0, 0, 900)),
    "side": pose((0.05, 0.2, 0.02), (320, 0, 880)),
    "back": pose((0, np.pi + 0.1, 0.1), (20, 10, -900)),
}


def rig_of(turned=np.pi * 0.9):
    """Two cameras; b is turned against a about the vertical."""
    lens = lenses.make(LENS)
    values = {"fx": 600.0, "fy": 600.0, "cx": 319.5, "cy": 239.5, "k1": -0.1}
    one = Camera(lens, lens.from_values(values), SIZE)
    return Rig({"a": one, "b": one}, {"b": pose((0, turned, 0.05), (30, 5, 80))}, "a")


def seen(rig, names, instants=14, noise=0.2, seed=0, turn=0.3, moves=(), shapes=None):
    """What the rig sees of the boards as it is turned and moved among them; boards in `moves` do not stand still."""
    rng = np.random.default_rng(seed)
    columns = {"xyz": [], "uv": [], "view": [], "camera": [], "point": []}
    for view in range(instants):
        where = pose(rng.uniform(-turn, turn, 3), rng.uniform(-80, 80, 3))
        placed = {n: BOARDS[n] for n in names}
        placed |= {n: pose(rng.uniform(-0.3, 0.3, 3), rng.uniform(-60, 60, 3)) @ BOARDS[n] for n in moves}
        for index, (name, own) in enumerate(rig.cameras.items()):
            for number, place in enumerate(placed.values()):
                points = POINTS if shapes is None else shapes[number]
                xyz = (rig.cam_from_rig[name] @ where @ place).apply(points)
                uv = np.full((54, 2), np.nan) if xyz[:, 2].min() < 100 else own.project(xyz)
                with np.errstate(invalid="ignore"):
                    inside = np.flatnonzero(((uv > 0) & (uv < np.array(SIZE) - 1)).all(1))
                if len(inside) < 12:
                    continue
                columns["xyz"].append(POINTS[inside])
                columns["uv"].append((uv + rng.normal(0, noise, uv.shape))[inside])
                columns["view"].append(np.full(len(inside), view))
                columns["camera"].append(np.full(len(inside), index))
                columns["point"].append(inside + 54 * number)
    return Observations(
        **{k: np.concatenate(v) for k, v in columns.items()},
        view_ids=tuple(map(str, range(instants))),
        cameras=("a", "b"),
        image_sizes=(SIZE, SIZE),
        target={"boards": list(names), "first_ids": [54 * k for k in range(len(names))]},
    )


def calibrated(data, **options):
    return camcal.calibrate_rig(
        data, model=LENS, **{"robust": "none", "checks": False, "crosscheck": False, **options}
    )


def test_cameras_that_see_different_boards():
    rig = rig_of()
    data = seen(rig, ("front", "back"))
    assert not set(data.point[data.camera == 0] // 54) & set(data.point[data.camera == 1] // 54)
    solution = calibrated(data)
    accuracy = covariance(solution)
    z = rig.cam_from_rig["b"].step_to(solution.rig.cam_from_rig["b"]) / relative_sigmas(
        solution, accuracy, "b"
    )
    assert np.abs(z).max() < 4, z
    found = Pose.from_entry(solution.observations.target["board_poses"][1])
    true = BOARDS["front"].inverse() @ BOARDS["back"]
    z = true.step_to(found) / board_sigmas(solution, accuracy)[0]
    assert np.abs(z).max() < 4, z
    said = next(s for s in solution.stages if s.name == "spanning-tree").info["boards"]
    assert said == ["a sees board front while b sees board back at 13 instants"]  # b misses it once


def test_exact_data_give_the_exact_rig():
    rig = rig_of()
    solution = calibrated(seen(rig, ("front", "back"), noise=0.0))
    assert solution.rms_point < 1e-6
    assert np.abs(rig.cam_from_rig["b"].step_to(solution.rig.cam_from_rig["b"])).max() < 1e-4  # mm and rad


def test_the_report_reads_back(tmp_path):
    solution = calibrated(seen(rig_of(), ("front", "back"), instants=10))
    path = tmp_path / "rig.yaml"
    save(document(solution), path)
    again = from_document(read_document(path))
    one, other = covariance(solution), covariance(again)
    np.testing.assert_allclose(
        relative_sigmas(again, other, "b"), relative_sigmas(solution, one, "b"), rtol=1e-4
    )
    assert document(again)["rig"]["boards"].keys() == {"back"}


def test_boards_in_one_picture_stand_fast_where_the_pictures_say_so():
    rig = rig_of(0.1)  # both look ahead
    fast = calibrated(seen(rig, ("front", "side"), turn=0.15))
    assert fast.observations.target["board_groups"] == [0, 0]
    loose = calibrated(seen(rig, ("front", "side"), turn=0.15, moves=("side",)))
    assert loose.observations.target["board_groups"] == [0, 1] and loose.board is None
    assert {v.partition(" board ")[2] for v in loose.observations.view_ids} == {"front", "side"}
    for solution in (fast, loose):
        z = rig.cam_from_rig["b"].step_to(solution.rig.cam_from_rig["b"])
        assert np.abs(z / relative_sigmas(solution, covariance(solution), "b")).max() < 4
    forced = calibrated(seen(rig, ("front", "side"), turn=0.15, moves=("side",)), boards="fixed")
    assert forced.rms_point > 10 * loose.rms_point  # what moves does not fit as one


def test_fixed_boards_say_more_than_moving_ones():
    data = seen(rig_of(0.1), ("front", "side"), turn=0.15)
    fixed, moving = (calibrated(data, boards=b) for b in ("fixed", "moving"))
    sigma = [np.linalg.norm(relative_sigmas(s, covariance(s), "b")[3:]) for s in (fixed, moving)]
    assert sigma[0] < sigma[1]


def test_no_overlap_and_boards_that_move_are_not_connected():
    with pytest.raises(EstimationError, match="not connected"):
        calibrated(seen(rig_of(), ("front", "back")), boards="moving")
    with pytest.raises(EstimationError, match="not connected"):
        calibrated(seen(rig_of(), ("front", "back"), moves=("back",)))


def test_turns_about_one_axis_leave_them_unconnected():
    rig = rig_of()
    data = seen(rig, ("front", "back"), noise=0.01, turn=0.0)  # only moved, never turned
    with pytest.raises(EstimationError, match="not connected"):
        calibrated(data)


#: depths of the bowls, mm
BENT = {"front": 4.0, "side": -2.0}


def bowl(depth):
    """The board with z raised in the middle of its width."""
    x = POINTS[:, 0] / np.abs(POINTS[:, 0]).max()
    return np.c_[POINTS[:, :2], depth * (1 - x**2)]


@pytest.fixture(scope="module")
def bent():
    """What a rig of two sees of two boards that are bent differently, where they stand fast and where one moves."""
    return {
        moves: seen(
            rig_of(0.1), ("front", "side"), turn=0.15, moves=moves, shapes=[bowl(d) for d in BENT.values()]
        )
        for moves in ((), ("side",))
    }


@pytest.mark.parametrize("moves", [(), ("side",)])
@pytest.mark.parametrize("shape", ["bowl", "print", "free"])
def test_each_of_several_boards_has_a_shape_of_its_own(bent, moves, shape):
    flat, solution = (calibrated(bent[moves], board_shape=s) for s in ("flat", shape))
    assert solution.rms_point < 0.95 * flat.rms_point
    accuracy = covariance(solution)
    z = rig_of(0.1).cam_from_rig["b"].step_to(solution.rig.cam_from_rig["b"]) / relative_sigmas(
        solution, accuracy, "b"
    )
    assert np.abs(z).max() < 4, z
    board, target = solution.board, solution.observations.target
    for (name, own), depth in zip(separate(board, target).items(), BENT.values(), strict=True):
        true = bowl(depth) - POINTS
        rigid = np.linalg.qr(similarities(POINTS))[
            0
        ]  # neither place nor size of a board is part of its shape
        true = true - (rigid @ (rigid.T @ true.reshape(-1))).reshape(-1, 3)
        found = own.points - own.ideal
        np.testing.assert_allclose(rigid.T @ found.reshape(-1), 0, atol=1e-9, err_msg=name)
        if shape != "free":  # .2 px of noise are .3 mm of height
            seen_there = np.isin(np.arange(54), own.numbers % 54)
            np.testing.assert_allclose(found[:, 2], true[seen_there, 2], atol=0.5, err_msg=name)


def test_shapes_of_several_boards_read_back(bent, tmp_path):
    solution = calibrated(bent[()], board_shape="auto", checks=True)
    shape = solution.observations.target["shape"]
    kinds = [t["kind"] for t in shape["tried"]]
    assert shape["kind"] == "bowl" and kinds[:4] == ["flat", "bowl", "print", "free"]
    assert {"flat+bowl", "bowl+flat"} <= set(kinds)
    assert set(shape["boards"]) == {"front", "side"} and "board side: the board bends" in shape["words"]
    assert not [w for w in solution.warnings if w.code == "boards-as-designed"]
    path = tmp_path / "rig.yaml"
    save(document(solution), path)
    again = from_document(read_document(path))
    assert again.rms_point == pytest.approx(solution.rms_point, rel=1e-9)
    known = calibrated(on_known_board(bent[()], path), board_shape="flat")  # the same shapes, held
    assert known.rms_point == pytest.approx(solution.rms_point, rel=1e-3)
    with pytest.raises(DataError, match="shapes of the boards front, side; these data have back, front"):
        on_known_board(replace(bent[()], target={**bent[()].target, "boards": ["back", "front"]}), path)
    for sigmas in (relative_sigmas, lambda s, a, _: board_sigmas(s, a)):
        one, other = (sigmas(s, covariance(s), "b") for s in (solution, again))
        np.testing.assert_allclose(other, one, rtol=1e-4)


def test_a_flat_board_beside_one_that_is_bent(tmp_path):
    data = seen(rig_of(0.1), ("front", "side"), turn=0.15, shapes=[bowl(4.0), POINTS])
    solution = calibrated(data, board_shape="auto")
    shape = solution.observations.target["shape"]
    assert shape["kind"] == "bowl+flat" and set(shape["boards"]) == {"front"}
    assert shape["boards"]["front"]["kind"] == "bowl"
    save(document(solution), tmp_path / "rig.yaml")
    again = from_document(read_document(tmp_path / "rig.yaml"))
    assert again.rms_point == pytest.approx(solution.rms_point, rel=1e-9)
    one, other = (relative_sigmas(s, covariance(s), "b") for s in (solution, again))
    np.testing.assert_allclose(other, one, rtol=1e-4)


@pytest.mark.parametrize(("views", "said"), [(2, 1), (3, 0)])
def test_a_board_in_too_few_views_is_as_designed(bent, views, said):
    data = bent[("side",)]
    few = np.isin(data.view, np.unique(data.view[data.point >= 54])[:views]) & (data.camera == 0)
    solution = calibrated(data.where((data.point < 54) | few), checks=True, board_shape="bowl")
    notes = [w for w in solution.warnings if w.code == "boards-as-designed"]
    assert len(notes) == said and all("side" in w.message for w in notes)
    assert set(solution.observations.target["shape"]["boards"]) == ({"front"} if said else {"front", "side"})


def counted_from_either_end(data, seed=1):
    """Half of all views of a board count its 54 points from the other end."""
    rng, point = np.random.default_rng(seed), data.point.copy()
    views = np.unique(np.c_[data.camera, data.view, data.point // 54], axis=0)
    other = views[rng.random(len(views)) < 0.5]
    for camera, view, which in other:
        own = (data.camera == camera) & (data.view == view) & (data.point // 54 == which)
        point[own] = 108 * which + 53 - data.point[own]
    return replace(data, point=point, xyz=POINTS[point % 54])


@pytest.mark.parametrize(
    ("turned", "names", "moves", "boards"),
    [
        (np.pi * 0.9, ("front", "side", "back"), (), "auto"),  # no common view: G Z = X C
        (0.1, ("front", "side"), (), "auto"),
        (0.1, ("front", "side"), ("side",), "auto"),
        (0.1, ("front", "side"), ("front", "side"), "moving"),
    ],
)
def test_boards_that_look_the_same_after_half_a_turn(turned, names, moves, boards):
    data = seen(rig_of(turned), names, turn=0.3 if turned > 1 else 0.15, moves=moves)
    mixed = counted_from_either_end(data)
    one, found = (calibrated(d, boards=boards) for d in (data, mixed))
    assert found.rms_point == pytest.approx(one.rms_point, rel=1e-6)
    apart = one.rig.cam_from_rig["b"].step_to(found.rig.cam_from_rig["b"])
    assert np.abs(apart).max() < 1e-6
    spanning = [next(s for s in each.stages if s.name == "spanning-tree") for each in (one, found)]
    assert spanning[0].info["turned_pictures"] == 0 < spanning[1].info["turned_pictures"]
