"""Routes from known points: poses, triangulation, closed forms."""

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
    board,
    bound,
    looking,
    pinhole,
    undetermined,
)

from camcal.assess.covariance import covariance
from camcal.data.observations import Observations, View
from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.registry import load
from camcal.routes import pose, triangulate
from camcal.routes.placed import PlacedCamera
from camcal.solve.parameters import apply_fixed
from camcal.solve.refine import How, refine
from camcal.solve.starts import regressed
from camcal.start import CLOSED_FORMS


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
            raise undetermined(found.reason[0])
        return float(found.xyz[0, 1]), float(np.sqrt(found.covariance[0, 1, 1]))

    return Case("triangulate", name, "depth", float(world[0, 1]), bound(observe, truth), run)


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
        begin, lens = load(CLOSED_FORMS[form])(data), lenses.make(model)
        near = begin.camera or Camera(PINHOLE.lens, PINHOLE.lens.from_matrix(begin.matrix), SIZE)
        params = lens.from_matrix(begin.matrix) if model == "pinhole" else regressed(lens, near, data).params
        held = {**fixed, **({"cx": MIDDLE[0], "cy": MIDDLE[1]} if centre_known else {})}
        found = refine(Camera(lens, apply_fixed(lens, params, held), SIZE), begin.poses, data, How(fix=fixed))
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
    bent = [
        ("division:1", f"{kind}, division -0.1", xyz, one, -0.1, False)
        for kind, xyz in (("40 points in space", rig), ("depth 5 % of the width", flat))
    ]
    table |= {"dlt12": bent, "dlt16": bent}
    table["claus"] = [
        ("division:1", f"{n} boards, 25 degrees, division -{k}", board(12, 9), tilted(n, 25, 0.3), -k, n < 3)
        for n, k in ((8, 0.1), (8, 0.4), (2, 0.4))
    ]
    return [
        closed_form(name, model, *rest, refined) for model, *rest in table[name] for refined in (False, True)
    ]
