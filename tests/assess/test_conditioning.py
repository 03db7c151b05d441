"""Condition numbers of the stages."""

import numpy as np
import pytest

from camcal import calibrate
from camcal.assess import conditioning
from camcal.geometry import dlt as resection
from camcal.solve import rows
from camcal.solve.problem import Problem
from tests import solved
from tests.start import scenes


def test_a_rig_far_from_the_origin():
    near = scenes.scene(scenes.rig(), [[0.3, -0.4, 0.2]], noise=0.1)
    found = {s.name: s.info["conditioning"] for s in calibrate(near.observations, model="pinhole").stages}
    assert set(found) == {"central", "dlt", "refine"}
    view = near.observations.views[0]
    for normalise, key in ((False, "before"), (True, "after")):
        a = resection.system(view.xyz[None], view.uv[None], None, normalise)[0][0]
        s = np.linalg.svd(a, compute_uv=False)
        assert found["dlt"][key] == pytest.approx(s[0] / s[10], rel=1e-9)
    for pair in found.values():
        assert 1 <= pair["after"] < pair["before"]


def test_boards_have_two_linear_systems():
    solution = calibrate(solved.solved(noise=0.1).observations, model="opencv5")
    stages = {s.name: s.info["conditioning"] for s in solution.stages}
    assert 1 <= stages["zhang"]["after"] < stages["zhang"]["before"]
    assert 1 <= stages["zhang"]["conic"]["after"] < stages["zhang"]["conic"]["before"]


def test_the_refinement_s_is_that_of_its_jacobian():
    solution = solved.solved(fix={"k3": None})
    found = conditioning.refinement(solution)
    problem = Problem(solution.camera.lens, solution.observations.views, solution.free)
    j = rows.jacobian(problem, problem.state(solution.camera.params, solution.poses))
    singular = np.linalg.svd(j / np.sqrt((j**2).sum(0)), compute_uv=False)
    # Lanczos is stopped at 1e-3 of the squares
    assert found["after"] == pytest.approx(singular[0] / singular[-1], rel=5e-3)
    plain = Problem(solution.camera.lens, solution.observations.views, solution.free, normalise=False)
    about_origin = rows.jacobian(plain, plain.state(solution.camera.params, solution.poses))
    singular = np.linalg.svd(about_origin, compute_uv=False)
    assert found["before"] == pytest.approx(singular[0] / singular[-1], rel=5e-3)
    assert found["before"] > found["after"]


def test_homography_equations_vanish_on_exact_points():
    scene = scenes.scene(scenes.board(), scenes.tilts(1))
    view = scene.observations.views[0]
    pose = scene.poses[0]
    h = scene.matrix @ np.c_[pose.rotation[:, :2], pose.translation]
    a = conditioning.homography_equations(view.xyz[:, :2], view.uv)
    # rows hold products of pixels, 1e3, and metres
    np.testing.assert_allclose(a @ h.ravel(), 0, atol=1e-9)
