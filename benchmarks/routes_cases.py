"""Made scenes for each route, their truth, and the Cramér-Rao bound of the figure that is looked at.

A case is fixed but for the noise: `observe(theta)` gives all image coordinates (or first-order distances from lines)
of parameters theta, of which the first is the figure looked at; what else is unknown (poses, points, lines) stands
behind it. The bound is the root of the first entry of (JᵀJ)⁺ times the noise, J by central differences.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from camcal.assess.covariance import covariance
from camcal.data.observations import Observations, View
from camcal.geometry import rotations
from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.model.pose import Pose
from camcal.plan.calibrate import calibrate
from camcal.registry import load
from camcal.routes import line_start, pose, scene, selfcalib, triangulate
from camcal.routes.bundle import Tracks
from camcal.routes.lines import Lines
from camcal.routes.placed import PlacedCamera
from camcal.start import CLOSED_FORMS

Array = np.ndarray
SIZE = (1280, 960)
MIDDLE = np.array([639.5, 479.5])
F = 1000.0
PINHOLE = Camera(lenses.make("pinhole"), np.array([F, F, *MIDDLE]), SIZE)


@dataclass(frozen=True)
class Case:
    """A scene of a route.

    Attributes
    ----------
    route, scene, figure : str
    truth : float
    bound : float
        The Cramér-Rao bound for noise of 1 px.
    run : (random generator, noise in px) -> (estimate, its sigma or None)
        Raises a CamcalError where the route refuses.
    freedom : float
        Degrees of freedom of the noise that the sigmas are scaled by, where few.
    """

    route: str
    scene: str
    figure: str
    truth: float
    bound: float
    run: Callable[[np.random.Generator, float], tuple[float, float | None]]
    freedom: float = np.inf


def bound(observe: Callable[[Array], Array], theta: Array) -> float:
    """The standard deviation of theta[0] for noise of 1 in every coordinate; inf where it is undetermined."""
    step = 1e-6 * np.maximum(np.abs(theta), 1.0)
    columns = [
        (observe(theta + s * e) - observe(theta - s * e)) / (2 * s)
        for s, e in zip(step, np.eye(len(theta)), strict=True)
    ]
    j = np.stack(columns, 1)
    scale = np.maximum(np.linalg.norm(j, axis=0), 1e-300)
    _, s, vt = np.linalg.svd(j / scale, full_matrices=False)
    known = s > 1e-8 * s[0]  # differences are good to about 1e-9; frame and scale of a world stand below it
    if np.abs(vt[~known, 0]).max(initial=0) > 1e-6:
        return float("inf")
    return float(np.sqrt(np.square(vt[known, 0] / s[known]).sum()) / scale[0])


def pinhole(cam: Array, f: float = F, centre: Array = MIDDLE, k: float = 0.0) -> Array:
    """Images of points in the camera's frame; k is the division model's coefficient, in focal lengths."""
    r2 = (cam[..., :2] ** 2).sum(-1, keepdims=True)
    # R = r (1 + k R²) / z, solved for the image radius
    z = cam[..., 2:]
    return centre + f * cam[..., :2] * 2 / (z + np.sqrt(z * z - 4 * k * r2))


def looking(position: Array, target: Array, roll: float = 0.0) -> Pose:
    """A camera at a position that looks at a target."""
    z = (target - position) / np.linalg.norm(target - position)
    x = np.cross(z, [0, 0, 1.0])
    x /= np.linalg.norm(x)
    rotation = rotations.exp(np.array([0, 0, roll])) @ np.array([x, np.cross(z, x), z])
    return Pose(rotation, -rotation @ position)


def board(columns: int = 9, rows: int = 6, square: float = 0.03) -> Array:
    """A plane of points about the origin."""
    x, y = np.meshgrid(np.arange(columns) - (columns - 1) / 2, np.arange(rows) - (rows - 1) / 2)
    return np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], 1) * square


def apply(motion: Array, xyz: Array) -> Array:
    """Points after a motion (rotation vector, translation)."""
    return xyz @ rotations.exp(motion[:3]).T + motion[3:]


# ------------------------------------------------------------------------------------------------ pose, triangulate
def pose_case(name: str, xyz: Array, rotation: Array, distance: float) -> Case:
    truth = np.r_[distance, rotation, 0.02, -0.01]

    def observe(theta: Array) -> Array:
        return pinhole(apply(np.r_[theta[1:], theta[0]], xyz)).ravel()

    exact = observe(truth).reshape(-1, 2)

    def run(rng: np.random.Generator, noise: float) -> tuple[float, float | None]:
        view = View("v", xyz, exact + rng.normal(0, noise, exact.shape), None)
        best = pose.find(PINHOLE, view, "none").solutions[0]
        sigma = None if best.covariance is None else float(np.sqrt(best.covariance[5, 5]))
        return float(best.pose.translation[2]), sigma

    return Case("pose", name, "distance", distance, bound(observe, truth), run, 2 * len(xyz) - 6)


def poses() -> list[Case]:
    cloud = np.random.default_rng(1).uniform(-0.1, 0.1, (12, 3))
    square = board(2, 2, 0.1)
    return [
        pose_case("12 points in space", cloud, np.array([0.3, -0.4, 0.2]), 0.8),
        pose_case("board of 54, 30 degrees of tilt", board(), np.array([0.52, 0, 0]), 0.6),
        pose_case("board of 54, seen squarely", board(), np.array([0.0, 0, 0.1]), 0.6),
        pose_case("4 corners, 30 degrees of tilt", square, np.array([0.52, 0, 0]), 0.6),
        pose_case("4 corners, 5 degrees: two poses fit", square, np.array([0.09, 0, 0]), 0.6),
        pose_case(
            "4 points in space, 0.2 % of the distance", 0.01 * cloud[:4], np.array([0.3, -0.4, 0.2]), 0.8
        ),
    ]


def triangulation(name: str, degrees: float, count: int = 2) -> Case:
    a = np.radians(degrees) * (np.arange(count) / (count - 1) - 0.5)
    cameras = [
        PlacedCamera(str(i), PINHOLE, looking(5 * np.array([np.sin(x), -np.cos(x), 0.05]), np.zeros(3)))
        for i, x in enumerate(a)
    ]
    world = np.random.default_rng(2).uniform(-1, 1, (40, 3))
    world[0] = [0.1, 0.2, 0.1]

    def observe(theta: Array) -> Array:
        point = np.array([world[0, 0], theta[0], world[0, 2]]) + [theta[1], 0, theta[2]]
        return np.concatenate([c.project(point[None])[0] for c in cameras])

    truth = np.array([world[0, 1], 0, 0])
    exact = np.stack([c.project(world) for c in cameras])
    camera, point = np.repeat(np.arange(count), 40), np.tile(np.arange(40), count)

    def run(rng: np.random.Generator, noise: float) -> tuple[float, float | None]:
        uv = (exact + rng.normal(0, noise, exact.shape)).reshape(-1, 2)
        images, _ = triangulate.sorted_images(camera, point, uv)
        found = triangulate.triangulate(cameras, images, 40)
        if found.reason[0]:
            raise _undetermined(found.reason[0])
        return float(found.xyz[0, 1]), float(np.sqrt(found.covariance[0, 1, 1]))

    return Case("triangulate", name, "depth", float(world[0, 1]), bound(observe, truth), run)


def _undetermined(why: str) -> Exception:
    from camcal.errors import EstimationError

    return EstimationError(why, "")


def triangulations() -> list[Case]:
    return [
        triangulation("3 cameras over 60 degrees", 60, 3),
        triangulation("2 cameras, rays at 30 degrees", 30),
        triangulation("2 cameras, 3 degrees", 3),
        triangulation("2 cameras, 0.3 degrees: nearly parallel rays", 0.3),
    ]


# ------------------------------------------------------------------------------------------------ closed forms
def closed_form(
    form: str,
    model: str,
    name: str,
    xyz: Array,
    motions: Array,
    k: float,
    centre_known: bool,
    refined: bool,
) -> Case:
    """The focal length of a closed form; with `refined`, of the refinement that begins there (for `model`)."""

    def observe(theta: Array) -> Array:
        own = theta[1:2] if k else np.zeros(1)
        rest = theta[1 + bool(k) :]
        centre = MIDDLE if centre_known else rest[:2]
        moves = rest[0 if centre_known else 2 :].reshape(-1, 6)
        return np.concatenate(
            [pinhole(apply(m, xyz), theta[0], centre, float(own[0])).ravel() for m in moves]
        )

    parts = [[F], [k] if k else [], [] if centre_known else MIDDLE, motions.ravel()]
    truth = np.concatenate([np.asarray(p, float) for p in parts])
    exact = observe(truth).reshape(len(motions), -1, 2)
    fixed = {"aspect": None} | ({"cx": None, "cy": None} if centre_known else {})

    def run(rng: np.random.Generator, noise: float) -> tuple[float, float | None]:
        data = Observations.from_views([(xyz, uv + rng.normal(0, noise, uv.shape)) for uv in exact], SIZE)
        if not refined:
            return float(load(CLOSED_FORMS[form])(data).matrix[0, 0]), None
        found = calibrate(data, model=model, start=form, robust="none", fix=fixed, checks=False)
        return float(found.camera.params[0]), covariance(found).sigmas["fx"]

    what = f"{form}, then refined" if refined else form
    return Case(what, name, "f", F, bound(observe, truth), run)


def tilted(count: int, degrees: float, distance: float = 0.55, seed: int = 3) -> Array:
    """Motions of boards tilted about evenly spread axes."""
    rng = np.random.default_rng(seed)
    a = np.arange(count) * 2.4 + 0.3
    axis = np.stack([np.cos(a), np.sin(a), np.zeros(count)], 1) * np.radians(degrees)
    return np.c_[axis, rng.uniform(-0.03, 0.03, (count, 2)), distance + rng.uniform(-0.03, 0.03, count)]


def closed_forms(name: str) -> list[Case]:
    rig = np.random.default_rng(7).uniform(-0.15, 0.15, (40, 3))
    flat = rig * [1, 1, 0.05]
    one = np.array([[0.4, -0.3, 0.1, 0.01, 0.02, 0.7]])
    table = {
        "dlt": [("pinhole", "40 points in space", rig, one, 0.0, False)]
        + [("pinhole", "depth 5 % of the width: nearly a plane", flat, one, 0.0, False)],
        "tsai": [
            ("division:1", f"one board, {d} degrees of tilt", board(), tilted(1, d), -0.1, True)
            for d in (45, 20, 10, 5)
        ],
        "fitzgibbon": [
            (
                "division:1",
                f"8 boards, 25 degrees, division -{k}",
                board(12, 9),
                tilted(8, 25, 0.3),
                -k,
                False,
            )
            for k in (0.1, 0.4)
        ]
        + [("division:1", "8 boards, 2 degrees", board(12, 9), tilted(8, 2, 0.3), -0.1, False)],
        "zhang": [
            ("pinhole", f"8 boards, {d} degrees", board(), tilted(8, d), 0.0, False) for d in (30, 10, 2)
        ],
    }
    table |= {"mdlt": table["dlt"], "central": table["dlt"]}
    return [
        closed_form(name, model, *rest, refined) for model, *rest in table[name] for refined in (False, True)
    ]


# ------------------------------------------------------------------------------------------------ lines, scene
def line_case(name: str, angles: Array, k: float = -0.2, points: int = 30) -> Case:
    """Lines through a division lens about a free centre."""
    rng = np.random.default_rng(4)
    f, centre, parts = float(max(SIZE)), MIDDLE + [9.0, -6.0], []
    while len(parts) < len(angles):
        along = np.array([np.cos(angles[len(parts)]), np.sin(angles[len(parts)])])
        ideal = (
            rng.uniform(-0.35, 0.35) * np.array([-along[1], along[0]])
            + np.linspace(-1, 1, 800)[:, None] * along
        )
        uv = pinhole(np.c_[ideal, np.ones(800)], f, centre, k)
        inside = np.flatnonzero(((uv > 5) & (uv < np.array(SIZE) - 6)).all(1))
        if len(inside) >= points:
            parts.append(uv[inside[np.linspace(0, len(inside) - 1, points).round().astype(int)]])
    exact, line = np.concatenate(parts), np.repeat(np.arange(len(parts)), points)

    def planes(k: float, centre: Array) -> tuple[Array, Array]:
        q = (exact - centre) / f
        h = np.c_[q, 1 + k * (q**2).sum(1)]
        return q, h

    _, h = planes(k, centre)
    normals = np.stack([np.linalg.svd(h[line == i])[2][2] for i in range(len(parts))])

    def observe(theta: Array) -> Array:
        q, h = planes(theta[0], theta[1:3])
        n = theta[3:].reshape(-1, 3)[line]
        slope = n[:, :2] + 2 * theta[0] * q * n[:, 2:]
        return (n * h).sum(1) / np.linalg.norm(slope, axis=1) * f

    def run(rng: np.random.Generator, noise: float) -> tuple[float, float | None]:
        uv = exact + rng.normal(0, noise, exact.shape)
        lines = Lines(uv, line, tuple(map(str, range(len(parts)))), SIZE)
        found = line_start.estimate(lines, lenses.make("division:1"), {}, False)
        if "l1" in found.undetermined:
            raise _undetermined("l1")
        return float(found.camera.params[4]), float(np.sqrt(found.covariance[4, 4]))

    return Case("lines", name, "division", k, bound(observe, np.r_[k, centre, normals.ravel()]), run)


def line_cases() -> list[Case]:
    rng = np.random.default_rng(5)
    turn = rng.uniform(0, np.pi, 40)
    return [
        line_case("40 lines of all directions", turn),
        line_case("5 lines of all directions", turn[:5]),
        line_case("40 lines, one direction: the centre is undetermined along it", np.zeros(40)),
        line_case("40 lines, no distortion", turn, 0.0),
    ]


def scene_case(name: str, turn: Array, families: tuple[int, ...], centre_known: bool) -> Case:
    rng = np.random.default_rng(6)
    rotation, parts, axes, planes = rotations.exp(turn), [], [], []
    for axis in families:
        found = 0
        while found < 25:
            ends = (
                rng.uniform(-3, 3, 3) + np.outer([0, 1], np.eye(3)[axis]) * rng.uniform(0.6, 1.5)
            ) @ rotation.T
            ends = ends + [0, 0, 6]
            uv = pinhole(ends)
            inside = (uv > 4).all() and (uv < np.array(SIZE) - 5).all()
            if ends[:, 2].min() < 1 or not inside or np.hypot(*(uv[1] - uv[0])) < 60:
                continue
            parts.append(uv[0] + np.linspace(0, 1, 5)[:, None] * (uv[1] - uv[0]))
            axes.append(axis)
            planes.append(np.cross(ends[0], ends[1]))
            found += 1
    exact, line = np.concatenate(parts), np.repeat(np.arange(len(parts)), 5)
    across = np.array([[1, 2], [2, 0], [0, 1]])[axes]
    n = np.stack(planes) @ rotation
    angle = np.arctan2(n[np.arange(len(n)), across[:, 1]], n[np.arange(len(n)), across[:, 0]])

    def observe(theta: Array) -> Array:
        f, own = theta[0], theta[4:] if centre_known else theta[6:]
        centre = MIDDLE if centre_known else theta[4:6]
        normal = np.zeros((len(own), 3))
        normal[np.arange(len(own)), across[:, 0]] = np.cos(own)
        normal[np.arange(len(own)), across[:, 1]] = np.sin(own)
        normal = normal @ rotations.exp(theta[1:4]).T
        m = normal[line]
        d = np.c_[(exact - centre) / f, np.ones(len(exact))]
        return (m * d).sum(1) / np.linalg.norm(m[:, :2], axis=1) * f

    truth = np.r_[F, turn, [] if centre_known else MIDDLE, angle]
    fix = {"cx": float(MIDDLE[0]), "cy": float(MIDDLE[1])} if centre_known else {}

    def run(rng: np.random.Generator, noise: float) -> tuple[float, float | None]:
        uv = exact + rng.normal(0, noise, exact.shape)
        lines = Lines(uv, line, tuple(map(str, range(len(parts)))), SIZE)
        found = scene.estimate(lines, lenses.make("pinhole"), fix, int(rng.integers(1 << 30)))
        return float(found.camera.params[0]), float(np.sqrt(found.covariance[0, 0]))

    return Case("scene", name, "f", F, bound(observe, truth), run)


def scene_cases() -> list[Case]:
    corner = rotations.log(rotations.exp(np.array([0, 0.75, 0])) @ rotations.exp(np.array([0.5, 0, 0.15])))
    level = [
        scene_case(
            f"level, walls at {d} degrees, centre given", np.array([0, np.radians(d), 0]), (0, 1, 2), True
        )
        for d in (40, 15, 5, 1)
    ]
    return [
        scene_case("three directions", corner, (0, 1, 2), False),
        scene_case("two directions, centre given", corner, (0, 2), True),
        *level,
    ]


# ------------------------------------------------------------------------------------------------ self-calibration
def selfcalib_case(name: str, motion: list[Pose], centre_known: bool = False) -> Case:
    world = np.random.default_rng(8).uniform(-1, 1, (60, 3))
    moves = np.concatenate([np.r_[rotations.log(p.rotation), p.translation] for p in motion])
    count = len(motion)
    head = 1 if centre_known else 3

    def observe(theta: Array) -> Array:
        centre = MIDDLE if centre_known else theta[1:3]
        xyz = theta[head + 6 * count :].reshape(-1, 3)
        return np.concatenate(
            [
                pinhole(apply(m, xyz), theta[0], centre).ravel()
                for m in theta[head : head + 6 * count].reshape(-1, 6)
            ]
        )

    truth = np.r_[F, [] if centre_known else MIDDLE, moves, world.ravel()]
    exact = observe(truth).reshape(-1, 2)
    view, point = np.repeat(np.arange(count), 60), np.tile(np.arange(60), count)
    fix = {"cx": float(MIDDLE[0]), "cy": float(MIDDLE[1])} if centre_known else {}

    def run(rng: np.random.Generator, noise: float) -> tuple[float, float | None]:
        tracks = Tracks(view, point, exact + rng.normal(0, noise, exact.shape))
        found = selfcalib.estimate(tracks, count, 60, lenses.make("pinhole"), SIZE, fix)
        return float(found.bundle.camera.params[0]), float(np.sqrt(found.covariance[0, 0]))

    return Case("selfcalib", name, "f", F, bound(observe, truth), run)


def selfcalib_cases() -> list[Case]:
    rng = np.random.default_rng(9)
    turn = np.linspace(0, 2.0, 6)
    around = 4 * np.stack([np.cos(turn), np.sin(turn), np.zeros(6)], 1) + rng.uniform(-0.6, 0.6, (6, 3))
    targets, rolls = rng.uniform(-0.4, 0.4, (6, 3)), rng.uniform(-1.5, 1.5, 6)
    general = [looking(*each) for each in zip(around, targets, rolls, strict=True)]
    fixating = [looking(p, np.zeros(3)) for p in around[:2]]
    straight = [
        looking(np.array([0.5 * i - 1.25, -4, 0]), np.array([0.5 * i - 1.25, 0, 0])) for i in range(6)
    ]
    still = [
        looking(np.array([0, -4.0, 0]), np.array([0.2 * i - 0.5, 0, 0.1 * i]), 0.2 * i) for i in range(6)
    ]
    return [
        selfcalib_case("6 views around, rolled", general),
        selfcalib_case("3 views", general[:3]),
        selfcalib_case("2 views", general[:2], True),
        selfcalib_case("2 views whose axes meet", fixating, True),
        selfcalib_case("6 views, translation alone", straight, True),
        selfcalib_case("6 views, rotation alone", still, True),
    ]


CASES: dict[str, Callable[[], list[Case]]] = {
    "pose": poses,
    "triangulate": triangulations,
    "zhang": lambda: closed_forms("zhang"),
    "dlt": lambda: closed_forms("dlt"),
    "mdlt": lambda: closed_forms("mdlt"),
    "central": lambda: closed_forms("central"),
    "tsai": lambda: closed_forms("tsai"),
    "fitzgibbon": lambda: closed_forms("fitzgibbon"),
    "lines": line_cases,
    "scene": scene_cases,
    "selfcalib": selfcalib_cases,
}
