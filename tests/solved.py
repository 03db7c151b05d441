"""Small solved calibrations for the tests of what comes after the refinement."""

import numpy as np

from camcal.assess import figures
from camcal.data.observations import Correspondences, View
from camcal.geometry import rotations
from camcal.model.camera import Camera
from camcal.model.lenses import make
from camcal.model.pose import Poses
from camcal.plan.solution import of_fit
from camcal.solve.refine import How, refine

SIZE = (640, 480)
TRUTH = {
    "fx": 533.0,
    "fy": 534.0,
    "cx": 322.0,
    "cy": 238.0,
    "k1": -0.25,
    "k2": 0.08,
    "p1": 4e-4,
    "p2": -3e-4,
    "k3": 0.01,
}


def grid(columns=9, rows=6, square=1.0):
    x, y = np.meshgrid(np.arange(columns), np.arange(rows))
    return np.c_[x.ravel(), y.ravel(), np.zeros(columns * rows)] * square


def rig(seed=0, count=60):
    """Points of a 3D object around the origin."""
    return np.random.default_rng(seed).uniform(-3, 3, (count, 3))


def tilted_poses(xyz, count, rng, tilt=0.5, distance=(11.0, 16.0), shift=2.0):
    """Poses that look at the middle of the points, turned about all axes."""
    found = []
    centre = xyz.mean(0)
    for _ in range(count):
        vector = np.r_[rng.uniform(-tilt, tilt, 2), rng.uniform(-0.3, 0.3)]
        rotation = rotations.exp(vector)
        where = np.r_[rng.uniform(-shift, shift, 2), rng.uniform(*distance)]
        found.append((rotation, where - rotation @ centre))
    return Poses(np.array([r for r, _ in found]), np.array([t for _, t in found]))


def observe(camera, poses, xyz, noise, rng, sigma=None):
    """Correspondences of what the camera sees, with Gaussian noise in px."""
    views = []
    for i, pose in enumerate(poses):
        uv = camera.project(pose.apply(xyz))
        assert np.isfinite(uv).all()
        scale = noise if sigma is None else sigma
        uv = uv + rng.normal(size=uv.shape) * np.reshape(scale, (-1, 1))
        views.append(View(f"view{i}", xyz, uv, sigma, np.arange(len(xyz))))
    return Correspondences.from_views(tuple(views), camera.image_size)


def camera_of(model="opencv5", values=TRUTH, skew=False, size=SIZE):
    lens = make(model, skew)
    return Camera(lens, lens.from_values(values), size)


def solved(
    model="opencv5",
    views=8,
    noise=0.2,
    seed=1,
    fix=None,
    skew=False,
    xyz=None,
    sigma=None,
    truth=None,
    **pose,
):
    """A calibration of simulated views, refined from near the truth."""
    rng = np.random.default_rng(seed)
    xyz = grid() if xyz is None else xyz
    camera = camera_of(model, truth or TRUTH, skew)
    poses = tilted_poses(xyz, views, rng, **pose)
    data = observe(camera, poses, xyz, noise, rng, sigma)
    start = camera.params.copy()
    start[:4] *= 1.01
    return of_fit(refine(Camera(camera.lens, start, SIZE), poses, data, How(fix or {})))


def dense_covariance(solution):
    """sigma_0² (JᵀJ)⁻¹ of free parameters and poses, as one matrix."""
    n = solution.normal
    f, v = len(n.intrinsics), len(n.poses)
    whole = np.zeros((f + 6 * v, f + 6 * v))
    whole[:f, :f] = n.intrinsics
    for i in range(v):
        rows = slice(f + 6 * i, f + 6 * i + 6)
        whole[:f, rows], whole[rows, :f], whole[rows, rows] = n.coupling[i], n.coupling[i].T, n.poses[i]
    d = np.sqrt(np.diag(whole))
    return figures.sigma_0(solution) ** 2 * np.linalg.inv(whole / np.outer(d, d)) / np.outer(d, d)
