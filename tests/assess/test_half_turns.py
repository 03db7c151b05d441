"""The turn of each view of a board that looks the same after half a turn: the board's own shape decides."""

from dataclasses import replace

import numpy as np
import pytest

from camcal.assess import half_turns
from camcal.data.observations import Correspondences, View
from camcal.model.camera import Camera
from camcal.model.lenses import make
from camcal.model.placement import simulate_poses
from camcal.plan.calibrate import calibrate

COLUMNS, ROWS, SQUARE, NOISE = 8, 6, 0.03, 0.1
VIEWS = 12
SIZE = (1280, 960)


def seen(seed: int, offset: float) -> Correspondences:
    """Views of a board whose corners are off by so much in x and y (standard deviation, metres)."""
    rng = np.random.default_rng(seed)
    x, y = np.meshgrid(np.arange(COLUMNS), np.arange(ROWS))
    board = np.c_[x.ravel(), y.ravel(), 0 * x.ravel()] * SQUARE
    printed = board + np.c_[rng.normal(0, offset, (len(board), 2)), 0 * board[:, 0]]
    lens = make("opencv4")
    values = {"fx": 1000.0, "fy": 1000.0, "cx": 645.0, "cy": 470.0, "k1": -0.1}
    camera = Camera(lens, lens.from_values(values), SIZE)
    views = []
    for i, pose in enumerate(simulate_poses(board, camera, rng, VIEWS)):
        uv = camera.project(pose.apply(printed)) + rng.normal(0, NOISE, (len(board), 2))
        views.append(View(f"v{i}", board, uv, None, np.arange(len(board))))
    return Correspondences.from_views(tuple(views), SIZE)


def counted_from_the_other_end(data: Correspondences, some: set[str]) -> Correspondences:
    last = data.views[0].xyz[::-1], np.arange(len(data.views[0]))[::-1]
    return data.map_views(lambda v: replace(v, xyz=last[0], point_ids=last[1]) if v.id in some else v)


def calibrated(data: Correspondences):
    return calibrate(data, "opencv4", robust="auto", board_shape="auto", crosscheck=False, checks=False)


@pytest.mark.parametrize("some", [{"v3"}, {"v0", "v4", "v5", "v9"}, {f"v{i}" for i in range(0, VIEWS, 2)}])
def test_the_camera_does_not_depend_on_which_end_a_view_counts_from(some):
    data = seen(1, 1e-4)
    plain, turned = calibrated(data), calibrated(counted_from_the_other_end(data, some))
    assert plain.board is not None and plain.board.kind == "free"
    assert "turned" not in plain.observations.target["shape"]
    rest = {v.id for v in data.views} - some
    assert set(turned.observations.target["shape"]["turned"]) in (some, rest)
    # the same sums in another order
    assert np.allclose(plain.camera.params, turned.camera.params, rtol=1e-6, atol=1e-6)
    assert turned.rms_point == pytest.approx(plain.rms_point, rel=1e-6)
    assert [s.name for s in turned.stages].count("turned-views") == 1


@pytest.mark.parametrize("seed", range(4))
def test_a_flat_board_decides_nothing(seed, monkeypatch):
    """Signs chosen to explain noise best explain much of it: the choices count, before anything is fitted."""
    flat = calibrate(seen(seed, 0.0), "opencv4", checks=False, crosscheck=False)
    monkeypatch.setattr(half_turns, "refit", None)
    assert half_turns.decided(flat, flat_how()) is None


def flat_how():
    from camcal.solve.refine import How

    return How()


def test_offsets_of_a_fifth_of_the_noise_decide():
    """The limit lies between none and a fifth of the noise (0.02 mm where a pixel is some .2 mm)."""
    some = {"v1", "v2", "v7"}
    flat = calibrate(
        counted_from_the_other_end(seen(2, 4e-5), some), "opencv4", checks=False, crosscheck=False
    )
    found = half_turns.decided(flat, flat_how())
    assert found is not None and set(found.views) == some
    again = replace(flat, poses=found.fit.poses, observations=found.fit.observations)
    off = (
        again.camera.project(again.poses[1].apply(again.observations.views[1].xyz))
        - again.observations.views[1].uv
    )
    assert np.allclose(off, flat.residuals[flat.observations.slices[1]], atol=1e-9)


def test_only_boards_that_look_the_same_are_turned():
    data = seen(0, 1e-4)
    assert half_turns.half_turn(data) is not None
    colours = replace(data, target={"kind": "checkerboard", "columns": 9, "rows": 6})
    assert half_turns.half_turn(colours) is None  # one black corner
    assert (
        half_turns.half_turn(replace(data, target={"kind": "checkerboard", "columns": 8, "rows": 6}))
        is not None
    )
    assert half_turns.half_turn(replace(data, target={"kind": "charuco"})) is None
    uneven = data.map_views(lambda v: replace(v, xyz=v.xyz + 0.3 * SQUARE * (v.xyz == v.xyz.max(0))))
    assert half_turns.half_turn(uneven) is None


def test_a_known_shape_is_not_mixed_with_itself_upside_down():
    """With the shape of an earlier report each view is counted from the end that fits, all of them where need be."""
    data = seen(1, 1e-4)
    shape = calibrated(data).observations.target["shape"]
    points = np.array(shape["points"])

    def with_shape(some):
        turned = counted_from_the_other_end(data, some)
        rows = turned.map_views(lambda v: replace(v, xyz=points[v.point_ids]))
        known = {"kind": "known", "points": shape["points"], "ideal": shape["ideal"], "from": "a.yaml"}
        return calibrate(
            replace(rows, target={"printed": True, "shape": known}),
            "opencv4",
            robust="auto",
            checks=False,
            crosscheck=False,
        )

    plain = with_shape(set())
    assert "turned" not in plain.observations.target["shape"]
    for some in ({"v3", "v8"}, {v.id for v in data.views}):
        found = with_shape(some)
        assert set(found.observations.target["shape"]["turned"]) == some
        assert np.allclose(found.camera.params, plain.camera.params, rtol=1e-6, atol=1e-6)
