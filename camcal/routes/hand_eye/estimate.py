"""The hand-eye transformation with confidence intervals, from views and robot poses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy import stats

from camcal.errors import EstimationError
from camcal.model.pose import Array, Pose, Poses
from camcal.records import dataclass
from camcal.routes.hand_eye import closed_forms, equation, variance
from camcal.routes.hand_eye.agreement import ROUNDING, agreeing
from camcal.routes.hand_eye.closed_forms import Method
from camcal.routes.hand_eye.joint import Joint, Measured, Noise, Robot, Unknowns, solve
from camcal.routes.hand_eye.motions import Motions, measure, require_enough, require_two_axes
from camcal.routes.hand_eye.pictures import Alone, Pictures, alone
from camcal.routes.hand_eye.variance import NUMBERS
from camcal.routes.hand_eye.views import views_of
from camcal.solve.problem import Problem

#: The variances and the minimum are found in turn until no standard deviation changes by more than this fraction.
SETTLED = 1e-3
MOST_ROUNDS = 30  #: a limit of work
#: A pose is an outlier below this probability, over all V poses: one false alarm in a thousand calibrations.
OUTLIER = 1e-3
#: Outliers are searched among at least this many poses: among fewer, a wrong one raises the noise estimate so much
#: that it passes.
LEAST_TO_TEST = 7
LEVEL = 0.95  #: probability of the intervals `interval_*`


@dataclass(frozen=True)
class Estimate:
    """X and Z with their uncertainties.

    Attributes
    ----------
    setup : {"in-hand", "to-hand"}
    x, z : Pose
        See `camcal.routes.hand_eye`.
    shared : (S, S) array
        Covariance of X and Z (rotation (rad, on the left) and translation of each), of the offset if it is
        estimated, and of the camera's errors `camera`.
    freedom : (12,) array
        Degrees of freedom of the variance of each of X and Z.
    noise : Noise
        Standard deviations of an image coordinate, of the robot's rotations about an axis and of a coordinate of its
        translations.
    relative : (3,) array
        Relative standard deviation of each of these.
    poses : Poses
        cam_from_board of the views used (V,).
    residuals : (V, 6) array
        Implied minus measured poses of the robot: rotation, rad, in the base's frame, and translation.
    misfit : (V,) array
    image_rms : float
        rms_point, px.
    methods : list of Method
    motions : Motions
    used : (V,) int array
        Indices of the views used; the others are outliers.
    camera : (K,) array
        Estimated errors of the given camera, in the unknowns of `Pictures.camera_root`.
    offset : float or None
        Clock offset, s, to be added to the camera's time.
    """

    setup: str
    x: Pose
    z: Pose
    shared: Array
    freedom: Array
    noise: Noise
    relative: Array
    poses: Poses
    residuals: Array
    misfit: Array
    image_rms: float
    methods: list[Method]
    motions: Motions
    used: Array
    measured: Poses
    pictures: Pictures
    camera: Array
    offset: float | None = None

    @property
    def covariance(self) -> Array:
        """The covariance (12, 12) of X and Z."""
        return self.shared[:12, :12]

    @property
    def offset_sigma(self) -> float | None:
        """The standard deviation of the offset, s."""
        return None if self.offset is None else float(np.sqrt(self.shared[12, 12]))

    @property
    def sigma(self) -> Array:
        """Standard deviations (12,): rotation of X in rad, its translation, the same of Z."""
        return np.sqrt(np.diagonal(self.covariance))

    @property
    def half_width(self) -> Array:
        """Half widths (12,) of the intervals at 95 %, by Student's t."""
        return np.asarray(stats.t.ppf(0.5 + LEVEL / 2, self.freedom)) * self.sigma

    @property
    def translation_rms(self) -> float:
        """The rms length of the robot's translation residuals."""
        return float(np.sqrt(np.square(self.residuals[:, 3:]).sum(1).mean()))

    @property
    def rotation_rms(self) -> float:
        """The rms angle of the robot's rotation residuals, rad."""
        return float(np.sqrt(np.square(self.residuals[:, :3]).sum(1).mean()))


@dataclass(frozen=True)
class Start:
    """The start of the joint estimate, and quantities computed before it."""

    problem: Problem
    image: Unknowns
    noise: Noise
    methods: list[Method]
    motions: Motions


def estimate(
    setup: str,
    pictures: Pictures,
    robot: Poses | Robot,
    robust: bool = True,
    offset: float | None = None,
) -> Estimate:
    """The joint maximum-likelihood estimate, with the variances by restricted maximum likelihood.

    Parameters
    ----------
    setup : {"in-hand", "to-hand"}
    pictures : Pictures
    robot : Poses, or function of an offset
        base_from_hand of each view; a function if the poses are a stream.
    robust : bool
        Exclude poses that do not agree with the others.
    offset : float, optional
        Initial clock offset of a stream, s.

    Raises
    ------
    DataError
        If there are fewer than three views.
    EstimationError
        If all motions rotate about one axis.
    """
    require_enough(len(pictures))
    everyone = np.arange(len(pictures))
    if not robust or len(everyone) < LEAST_TO_TEST:
        return _estimate(setup, pictures, robot if callable(robot) else _taken(robot, everyone), offset)
    whole = _taken(robot, everyone)
    seen = alone(pictures)
    used = np.flatnonzero(agreeing(views_of(setup, whole(offset or 0.0).poses, seen.poses), setup))
    for _ in range(len(everyone)):
        found = _estimate(setup, pictures.take(used), _taken(robot, used), offset)
        after = _tested(found, pictures, seen, whole, used)
        if np.array_equal(after, used):
            break
        used = after
    return replace(found, used=used)


def _tested(found: Estimate, pictures: Pictures, seen: Alone, robot: Robot, used: Array) -> Array:
    """Remove the worst pose if it is an outlier; otherwise restore all removed ones that fit after all."""
    count, shared = len(seen.poses), 12 + (found.offset is not None)
    chance = variance.outlying(found.misfit, shared)
    if chance.min() * count < OUTLIER and len(used) >= LEAST_TO_TEST:
        return np.delete(used, int(chance.argmin()))
    aside = np.setdiff1d(np.arange(count), used)
    if not len(aside):
        return used
    timed, shifts = found.offset is not None, pictures.shifts
    joint = Joint(found.setup, seen.problem, robot, found.noise, timed, shifts)
    linear = joint.linear(Unknowns(seen.state, found.x, found.z, found.offset or 0.0, found.camera))
    misfit = variance.misfit_of_new(linear, found.noise, found.shared)[aside]
    fits = aside[
        stats.f.sf(misfit / NUMBERS, NUMBERS, max(NUMBERS * len(used) - shared, 1)) * count >= OUTLIER
    ]
    return np.sort(np.concatenate([used, fits]))


def _taken(robot: Poses | Robot, rows: Array) -> Robot:
    if isinstance(robot, Poses):
        fixed = Measured(robot[rows], np.zeros((len(rows), 6)))
        return lambda offset: fixed

    def taken(offset: float) -> Measured:
        all_of = robot(offset)
        return Measured(all_of.poses[rows], all_of.velocity[rows])

    return taken


def _estimate(setup: str, pictures: Pictures, robot: Robot, offset: float | None) -> Estimate:
    begin = start(setup, pictures, robot, offset)
    at, noise = begin.image, begin.noise
    for _ in range(MOST_ROUNDS):
        joint = Joint(setup, begin.problem, robot, noise, offset is not None, pictures.shifts)
        at = solve(joint, at)
        linear = joint.linear(at)
        if not np.isfinite(linear.image).all():
            raise EstimationError(
                "the joint estimate left the domain of the lens.", "Check the poses and their unit."
            )
        found = variance.estimate(linear, noise, pictures.freedom)
        settled = np.abs(np.log(np.divide(found.noise, noise))).max() < SETTLED
        noise = found.noise
        if settled:
            break
    points = sum(map(len, pictures.views))
    weight = 1.0 if pictures.weights is None else np.concatenate(pictures.weights).mean()
    return Estimate(
        setup,
        at.x,
        at.z,
        found.covariance,
        found.freedom[:12],
        noise,
        found.relative,
        joint.poses(at),
        linear.residual,
        found.misfit,
        float(np.sqrt(linear.image[:, 6, 6].sum() / points / weight)),
        begin.methods,
        begin.motions,
        np.arange(len(pictures)),
        robot(at.offset).poses,
        pictures,
        at.camera,
        at.offset if offset is not None else None,
    )


def start(setup: str, pictures: Pictures, robot: Robot, offset: float | None) -> Start:
    """Poses of the views from the pictures alone, the best closed form, and approximate noise levels."""
    seen = alone(pictures)
    views = views_of(setup, robot(offset or 0.0).poses, seen.poses)
    motions = measure(seen.poses, seen.rotation_covariance)
    require_two_axes(motions, setup)
    methods = closed_forms.solve_all(views, setup)
    best = closed_forms.best(methods)
    assert best.x is not None and best.z is not None
    # one coordinate of the rms length; rounding error if the data are exact
    rough = np.maximum(
        [best.rotation_rms, best.translation_rms], [ROUNDING, ROUNDING * closed_forms.length_unit(views)]
    )
    noise = Noise(seen.sigma, *(rough / np.sqrt(3)).tolist())
    return Start(
        seen.problem,
        Unknowns(seen.state, best.x, best.z, offset or 0.0, np.zeros(pictures.camera_root.shape[1])),
        noise,
        methods,
        motions,
    )


def implied(found: Estimate) -> Poses:
    """The robot's poses implied by the estimate, base_from_hand (V,)."""
    return equation.robot_pose(found.setup, found.x, found.z, found.poses)
