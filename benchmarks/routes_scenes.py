"""Routes without known points: lines, one picture, tracks, a bar."""

from __future__ import annotations

import numpy as np
from routes_common import (
    MIDDLE,
    PINHOLE,
    SIZE,
    Array,
    Case,
    F,
    apply,
    bound,
    looking,
    pinhole,
    undetermined,
)

from camcal.geometry import rotations
from camcal.model import lenses
from camcal.model.pose import Pose
from camcal.routes import line_start, scene, selfcalib, wand
from camcal.routes.bundle import Tracks
from camcal.routes.line_geometry import Lines, tangents
from camcal.routes.wand_fit import Sightings


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
            raise undetermined("l1")
        return float(found.camera.params[4]), float(np.sqrt(found.covariance[4, 4]))

    return Case("lines", name, "division", k, bound(observe, np.r_[k, centre, normals.ravel()]), run)


def line_cases() -> list[Case]:
    rng = np.random.default_rng(5)
    turn = rng.uniform(0, np.pi, 40)
    return [
        line_case("40 lines of all directions", turn),
        line_case("5 lines of all directions", turn[:5]),
        line_case("40 lines, one direction: the centre is held along it", np.zeros(40)),
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

    def run(rng: np.random.Generator, noise: float) -> tuple[float, float, tuple[float, float]]:
        tracks = Tracks(view, point, exact + rng.normal(0, noise, exact.shape))
        found = selfcalib.estimate(tracks, count, 60, lenses.make("pinhole"), SIZE, fix)
        assert found.interval is not None
        return float(found.bundle.camera.params[0]), float(np.sqrt(found.covariance[0, 0])), found.interval

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


# ------------------------------------------------------------------------------------------------------------- wand
def wand_case(name: str, places: list[Array], reach: float, free: bool) -> Case:
    """The focal length of the first camera, or of known cameras the second one's distance along its axis."""
    rng, count, cameras = np.random.default_rng(10), 40, [looking(p, np.zeros(3)) for p in places]
    way = rng.normal(size=(count, 3))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    start, first = rng.uniform(-reach, reach, (count, 3)) - 0.3 * way, cameras[0]
    start, way = first.apply(start), way @ first.rotation.T
    rest = [p @ first.inverse() for p in cameras[1:]]
    across = tangents(way)
    focals = len(cameras) if free else 0
    motion = np.concatenate([np.r_[rotations.log(p.rotation), p.translation] for p in rest])

    def observe(theta: Array) -> Array:
        focal = np.r_[theta[:focals], np.full(len(cameras) - focals, F)]
        moves, bars = np.split(theta[focals:], [len(motion)])
        begin, turn = bars[: 3 * count].reshape(-1, 3), bars[3 * count :].reshape(-1, 2)
        d = way + np.einsum("nik,nk->ni", across, turn)
        xyz = np.stack([begin, begin + 0.6 * d / np.linalg.norm(d, axis=1, keepdims=True)])
        seen = [pinhole(xyz, focal[0])]
        seen += [pinhole(apply(m, xyz), f) for m, f in zip(moves.reshape(-1, 6), focal[1:], strict=True)]
        return np.stack(seen).ravel()

    truth = np.r_[np.full(focals, F), motion, start.ravel(), np.zeros(2 * count)]
    exact = observe(truth).reshape(len(cameras), 2, count, 2)
    camera, marker, instant = (i.ravel() for i in np.indices(exact.shape[:3]))
    order = np.argsort(instant, kind="stable")
    fix = {"cx": float(MIDDLE[0]), "cy": float(MIDDLE[1])}

    def run(rng: np.random.Generator, noise: float) -> tuple[float, float | None]:
        uv = (exact + rng.normal(0, noise, exact.shape)).reshape(-1, 2)
        seen = Sightings(camera[order], instant[order], marker[order], uv[order], np.array([0, 0.6]))
        names = [str(i) for i in range(len(cameras))]
        found = wand.estimate(seen, [PINHOLE] * len(cameras), [not free] * len(cameras), fix, names)
        sigma = np.sqrt(np.diagonal(found.covariance))
        if free:
            return float(found.wand.cameras[0].params[0]), float(sigma[0])
        return float(found.wand.poses[1].translation[2]), float(sigma[5])

    index, figure = (0, "f") if free else (5, "distance")
    return Case("wand", name, figure, float(truth[index]), bound(observe, truth, index), run)


def wand_cases() -> list[Case]:
    around = [np.array(p) for p in ((4.0, -2.4, 1.1), (-2.9, -3.4, 1.6), (0.4, 4.2, 1.3))]
    near = [np.array([4.0, 0.2 * i, 1.0]) for i in range(2)]
    return [
        wand_case("3 cameras around, known", around, 0.9, False),
        wand_case("3 cameras around, f unknown", around, 0.9, True),
        wand_case("2 cameras around, f unknown", around[:2], 0.9, True),
        wand_case("2 cameras side by side, 3 degrees, known", near, 0.9, False),
        wand_case("2 cameras side by side, 3 degrees, f unknown", near, 0.9, True),
        wand_case("3 cameras, the bar kept in one place, f unknown", around, 0.02, True),
    ]
