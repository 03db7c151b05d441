"""The joint estimate: derivatives, variances, coverage, outliers, offsets."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import minimize

from camcal.data.robot_poses import Stream
from camcal.geometry import rotations as so3
from camcal.model.pose import Pose, Poses
from camcal.routes.hand_eye import equation, variance
from camcal.routes.hand_eye.estimate import estimate, implied
from camcal.routes.hand_eye.joint import Joint, Measured, Noise, Unknowns
from camcal.routes.hand_eye.next_pose import suggest
from camcal.routes.hand_eye.offset import robot_at, search
from tests.routes.hand_eye.hands import TRUTH, cameras, hand, noisy, off, pictures_of

SETUPS = ["in-hand", "to-hand"]


NOISE = Noise(0.2, 0.002, 1.0)


def linear_of(h):
    problem = h.pictures.problem()
    measured = Measured(h.robot, np.zeros((len(h.robot), 6)))
    joint = Joint(h.setup, problem, lambda offset: measured, NOISE)
    at = Unknowns(problem.state(h.pictures.camera.params, h.pictures.poses), h.x, h.z)
    return joint, at


@pytest.mark.parametrize("setup", SETUPS)
def test_derivatives_are_those_of_the_residuals(setup):
    joint, at = linear_of(hand(setup, 1, 4, deg=5.0))  # residual rotations far from 0
    linear, h = joint.linear(at), 1e-6
    for column in range(12):
        step = np.zeros(12)
        step[column] = h
        there = joint.linear(joint.retract(at, (step, np.zeros((4, 6))))).residual
        back = joint.linear(joint.retract(at, (-step, np.zeros((4, 6))))).residual
        np.testing.assert_allclose((there - back) / (2 * h), linear.by_shared[:, :, column], atol=1e-4)
    for column in range(6):
        own = np.zeros((4, 6))
        own[:, column] = h
        there = joint.linear(joint.retract(at, (np.zeros(12), own))).residual
        back = joint.linear(joint.retract(at, (np.zeros(12), -own))).residual
        np.testing.assert_allclose((there - back) / (2 * h), linear.by_pose[:, :, column], atol=1e-4)


def test_variances_maximise_the_restricted_likelihood():
    """Against a search that knows nothing of scores, with the likelihood written with whole matrices."""
    h = hand("in-hand", 2, 8)
    joint, at = linear_of(h)
    linear = joint.linear(at)
    freedom = h.pictures.freedom
    found = variance.estimate(linear, NOISE, freedom)
    model = variance._Model.of(linear, freedom)
    v, f = model.a.shape[0], model.a.shape[2]
    a, y = model.a.reshape(6 * v, f), model.y.ravel()

    def negative(logs):
        s = np.exp(logs)
        cov = np.zeros((6 * v, 6 * v))
        for i in range(v):
            own = s[0] * model.k[i] + np.diag(np.repeat(s[1:], 3))
            cov[6 * i : 6 * i + 6, 6 * i : 6 * i + 6] = own
        w = np.linalg.inv(cov)
        normal = a.T @ w @ a
        p = w - w @ a @ np.linalg.solve(normal, a.T @ w)
        return 0.5 * (
            np.linalg.slogdet(cov)[1]
            + np.linalg.slogdet(normal)[1]
            + y @ p @ y
            + freedom * logs[0]
            + model.left / s[0]
        )

    best = minimize(
        negative,
        np.log([0.05, 1e-5, 2.0]),
        method="Nelder-Mead",
        options={"xatol": 1e-6, "fatol": 1e-10, "maxiter": 4000},
    )
    np.testing.assert_allclose(np.exp(best.x / 2), found.noise, rtol=1e-3)  # the flat top of the likelihood


@pytest.mark.parametrize("setup", SETUPS)
def test_exact_data_give_the_truth(setup):
    h = hand(setup, 5, 8, mm=0.0, deg=0.0, px=0.0)
    found = estimate(setup, h.pictures, h.robot)
    assert np.abs(off(found.x, h.x)).max() < 1e-6 and np.abs(off(found.z, h.z)).max() < 1e-6
    assert np.abs(off(implied(found)[0], h.robot[0])).max() < 1e-6


@pytest.mark.parametrize("setup", SETUPS)
def test_intervals_hold_the_truth(setup):
    """30 robots of 10 poses, 6 figures each: between 89 and 99 % inside, four standard deviations of 180 draws."""
    inside, sizes = [], []
    for seed in range(30):
        h = hand(setup, 100 + seed, 10, mm=2.0, deg=0.2)
        found = estimate(setup, h.pictures, h.robot)
        inside.append(np.abs(off(found.x, h.x)) <= found.half_width[:6])
        sizes.append(found.noise)
    assert 0.89 <= np.mean(inside) <= 0.99
    np.testing.assert_allclose(np.mean(sizes, 0), [0.2, np.radians(0.2), 2.0], rtol=0.1)


@pytest.mark.parametrize("setup", SETUPS)
def test_frames_of_the_robot_are_a_convention(setup):
    """Another frame of the base or of the hand moves X and Z along, and nothing else."""
    h = hand(setup, 6, 8)
    base, tool = Pose.from_vector((0.3, -0.4, 2), (100, 50, -20)), Pose.from_vector((1, 0.2, -0.3), (0, 0, 0))
    a, b = estimate(setup, h.pictures, h.robot), estimate(setup, h.pictures, base @ h.robot @ tool)
    x = tool.inverse() @ a.x if setup == "in-hand" else base @ a.x
    assert np.abs(off(b.x, x) / b.sigma[:6]).max() < 0.01
    np.testing.assert_allclose(b.noise, a.noise, rtol=0.01)


def test_the_cameras_uncertainty_widens_the_intervals():
    h = hand("in-hand", 7)
    plain = estimate("in-hand", h.pictures, h.robot)
    gain = np.zeros((15, 6, 1))
    gain[:, 5] = 1.0  # all boards 1 mm farther away for each unit of one parameter
    unsure = replace(h.pictures, gain=gain, camera_covariance=np.array([[25.0]]))
    wide = estimate("in-hand", unsure, h.robot)
    # the camera sits 5 mm nearer or farther along its own axis, which is the hand's z but for 6 degrees
    assert wide.sigma[5] ** 2 - plain.sigma[5] ** 2 == pytest.approx(25.0, rel=0.1)
    assert np.abs(off(wide.x, plain.x)).max() < 0.01


@pytest.mark.parametrize("count", [1, 3])
def test_poses_of_other_pictures_are_left_out(count):
    h = hand("in-hand", 8, 20)
    wrong = Poses(h.robot.rotation.copy(), h.robot.translation.copy())
    wrong.translation[:count] += [30.0, -20.0, 10.0]
    found = estimate("in-hand", h.pictures, wrong)
    assert list(found.used) == list(range(count, 20))
    assert len(estimate("in-hand", h.pictures, wrong, robust=False).used) == 20


def test_good_poses_are_kept():
    lost = sum(15 - len(estimate("to-hand", *hand("to-hand", seed)[3:]).used) for seed in range(10))
    assert lost == 0  # one in a thousand calibrations


def test_offset_of_the_clocks():
    """A hand that moves while pictures are taken, its clock 0.137 s behind."""
    rng = np.random.default_rng(9)
    knots = cameras(rng, 12, 0.4, 0.6)
    times = np.arange(12.0) * 1.5
    stream = Stream(times, Poses(*equation_of("in-hand", knots)))
    seen = times[:-1] + 0.7
    robot, _ = stream.at(seen)
    x, z = TRUTH["in-hand"]
    c = x.inverse() @ robot.inverse() @ z  # C = X⁻¹ B⁻¹ Z
    pictures = pictures_of(c, rng, 0.2)
    fine = np.arange(0, 16.4, 0.05)
    measured = Stream(fine, noisy(stream.at(fine)[0], rng, 0.3, 0.03))
    clock = seen - 0.137
    begin = search("in-hand", measured, clock, c, 0.5)
    assert begin == pytest.approx(0.137, abs=0.05)
    found = estimate("in-hand", pictures, robot_at(measured, clock), False, begin)
    assert abs(found.offset - 0.137) < 3 * found.offset_sigma < 0.01
    assert (np.abs(off(found.x, x)) < 3.5 * found.sigma[:6]).all()


def equation_of(setup, poses):
    robot = equation.robot_pose(setup, *TRUTH[setup], poses)
    return robot.rotation, robot.translation


@pytest.mark.parametrize("setup", SETUPS)
def test_suggested_poses_bring_what_they_promise(setup):
    h = hand(setup, 10, 6)
    found = estimate(setup, h.pictures, h.robot)
    made = suggest(found, 3)
    volumes = [np.log(s.sigma).sum() for s in made]
    assert volumes == sorted(volumes, reverse=True) and volumes[0] < np.log(found.sigma[:6]).sum()
    # taken, with the same noise, they bring X as near as was said: within a third, as the noise is estimated from few
    poses = Poses.stack([*h.pictures.poses, *(s.cam_from_board for s in made)])
    more = estimate(setup, *hand(setup, 10, poses=poses)[3:])
    ratio = more.sigma[:6] / made[-1].sigma * (found.noise.translation / more.noise.translation)
    assert ((ratio > 0.6) & (ratio < 1.6)).all()


def test_residual_rotations_are_those_of_the_base():
    h = hand("in-hand", 11, 8)
    found = estimate("in-hand", h.pictures, h.robot)
    turn = so3.exp(found.residuals[:, :3])
    np.testing.assert_allclose(turn @ h.robot.rotation, implied(found).rotation, atol=1e-9)


@pytest.mark.parametrize("setup", ["in-hand", "to-hand"])
def test_a_camera_calibrated_from_the_same_pictures_is_estimated_along(setup):
    """An exact robot makes the camera better: the truth is within the smaller intervals."""
    from camcal import Correspondences, calibrate
    from camcal.plan.hand_eye import _pictures, camera_along

    h = hand(setup, 11, 12, mm=0.02, deg=0.002)
    data = Correspondences.from_views([(v.xyz, v.uv) for v in h.pictures.views], image_size=(640, 480))
    solution = calibrate(data, model="opencv4", robust="none", checks=False)
    found = estimate(setup, _pictures(solution)[0], h.robot)
    value, sigma, before, sigma_before = camera_along(found, solution)["fx"]
    assert before == solution.camera.values["fx"]
    assert sigma < 0.6 * sigma_before and abs(value - 600) < 4 * sigma
    assert (np.abs(off(found.x, h.x)) < 4 * found.sigma[:6]).all()


def test_a_camera_that_is_estimated_along_is_that_of_one_likelihood():
    """The same minimum as that of the whole problem with one parameter of the camera, pictures and robot."""
    from scipy.optimize import least_squares

    from camcal import Correspondences, calibrate
    from camcal.model.pose import Pose
    from camcal.plan.hand_eye import _pictures, camera_along
    from camcal.routes.hand_eye import equation

    h = hand("in-hand", 12, 6, mm=0.2, deg=0.02)
    data = Correspondences.from_views([(v.xyz, v.uv) for v in h.pictures.views], image_size=(640, 480))
    fixed = {"cx": 319.5, "cy": 239.5}
    solution = calibrate(data, model="pinhole", fix=fixed, robust="none", checks=False)
    found = estimate("in-hand", _pictures(solution)[0], h.robot, robust=False)
    xyz, uv = h.pictures.views[0].xyz, np.array([v.uv for v in h.pictures.views])

    def residuals(p):
        poses = [Pose.from_vector(q[:3], q[3:]) for q in p[:-2].reshape(-1, 6)]
        x, z, c = poses[0], poses[1], Poses.stack(poses[2:])
        seen = np.array([pose.apply(xyz) for pose in c])
        predicted = p[-2:] * seen[..., :2] / seen[..., 2:] + [319.5, 239.5]
        robot = equation.residuals("in-hand", x, z, c, h.robot) / found.noise.robot
        return np.r_[(predicted - uv).ravel() / found.noise.image, robot.ravel()]

    begin = np.concatenate(
        [np.r_[p.rotation_vector, p.translation] for p in (found.x, found.z, *found.poses)]
    )
    camera = camera_along(found, solution)
    begin = np.r_[begin, [camera[n][0] for n in ("fx", "fy")]]
    made = least_squares(residuals, begin, x_scale="jac")
    step = made.x - begin
    assert np.abs(step[3:6] / found.sigma[3:6]).max() < 0.1  # the camera's part is to first order
    assert np.abs(step[-2:] / [camera[n][1] for n in ("fx", "fy")]).max() < 0.1
    spread = np.linalg.inv(made.jac.T @ made.jac)[-2:, -2:]
    np.testing.assert_allclose(np.sqrt(np.diagonal(spread)), [camera[n][1] for n in ("fx", "fy")], rtol=0.1)


@pytest.mark.parametrize(("score", "part"), [(0.0, 1.0), (-0.4, 0.6), (-5.0, variance.LEAST_PART**2)])
def test_a_variance_at_its_bound_may_lie_below_it(score, part):
    m = np.array([[4.0, 1.0], [1.0, 1.0]])
    here = SimpleNamespace(information=np.eye(3), score=np.array([0.0, 0.0, score]))
    by_log = np.stack([0 * m, 0 * m, m])
    np.testing.assert_allclose(variance._unbounded(m, here, by_log), part * m, rtol=1e-12)
