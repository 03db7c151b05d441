"""The focal length of rendered scenes, whose truth is known: `camcal scene` on pictures of rooms and streets.

Scenes of boxes with windows, shelves and tiles, drawn at four times the resolution and averaged (640x480, blur .5 px,
noise of three grey levels). Hard ones have furniture turned about the vertical, branches and cables in all directions,
little convergence, or walls out of square by 0.86 degrees, standard deviation, of each direction (as the intervals
assume). The principal point is the picture's middle, and not given. Of each kind: how many are refused, the relative
error of the focal length, and how often the 95 % interval holds it.

Usage: python benchmarks/scene_rendered.py [--runs 40] [--only room,...] --kept FILE [--update docs/routes.md]
       --write FOLDER writes the pictures
"""

from __future__ import annotations

import argparse
import tempfile
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from tables import keep, kept, markdown, show

from camcal.errors import CamcalError
from camcal.geometry import rotations
from camcal.model import lenses
from camcal.report.scene import _segments
from camcal.routes import scene

SIZE = (640, 480)
FINE = 4  #: samples of a pixel in each direction
NEAR = 0.2  #: m; nothing nearer is drawn
MIDDLE = np.array([(SIZE[0] - 1) / 2, (SIZE[1] - 1) / 2])


@dataclass(frozen=True)
class Kind:
    """A kind of scene: furniture, turned pieces, clutter (pieces), how far out of square (rad), focal length, pitch."""

    furniture: int = 6
    turned: int = 0
    clutter: int = 0
    square: float = 0.0
    focal: float = 500.0
    pitch: float = 0.25
    street: bool = False


KINDS = {
    "room": Kind(),
    "street": Kind(street=True),
    "street, out of square": Kind(street=True, square=0.015),
    "room, out of square": Kind(square=0.015),
    "room, furniture turned": Kind(furniture=3, turned=5),
    "street, branches and cables": Kind(street=True, clutter=60),
    "room, long lens": Kind(focal=1000.0),
    "room, level camera": Kind(pitch=0.0),
}
HEADER = ("scene", "pictures", "refused", "median error", "within 5 %", "95 % intervals hold", "median sigma")


def rectangle(origin, a, b):
    """The corners (4, 3) of a rectangle."""
    return np.array([origin, origin + a, origin + a + b, origin + b])


def wall(rng, origin, a, b, columns, rows, grey):
    """A wall with windows, each with a frame: (corners, grey level), behind first."""
    made = [(rectangle(origin, a, b), grey)]
    for i in range(columns):
        for j in range(rows):
            if rng.random() < 0.3:
                continue
            low, high = rng.uniform(0.1, 0.4, 2), rng.uniform(0.55, 0.9, 2)
            corner = origin + a * (i + low[0]) / columns + b * (j + low[1]) / rows
            size = a * (high - low)[0] / columns, b * (high - low)[1] / rows
            made.append((rectangle(corner, *size), rng.uniform(20, 235)))
            made.append(
                (
                    rectangle(corner + 0.1 * (size[0] + size[1]), 0.8 * size[0], 0.8 * size[1]),
                    rng.uniform(20, 235),
                )
            )
    return made


def box(rng, corner, size, turn):
    """The faces of a box that stands on the floor, turned about the vertical (y)."""
    axes = np.diag(size) @ rotations.exp(np.array([0, turn, 0])).T
    faces = []
    for k in range(3):
        a, b, c = axes[k], axes[(k + 1) % 3], axes[(k + 2) % 3]
        for side in (np.zeros(3), c):
            faces += wall(rng, corner + side, a, b, 2, 2, rng.uniform(40, 220))
    return faces


def world(kind, rng):
    """Groups of (corners, grey level) in metres, the camera at the origin, y down; the groups far ones first."""
    if kind.street:
        length = 30.0
        groups = [
            wall(
                rng,
                np.array([-5.0, 1.6, 1.0]),
                np.array([0, 0, length]),
                np.array([0, -9.0, 0]),
                12,
                4,
                190.0,
            ),
            wall(
                rng, np.array([5.0, 1.6, 1.0]), np.array([0, 0, length]), np.array([0, -9.0, 0]), 12, 4, 90.0
            ),
            wall(
                rng, np.array([-5.0, 1.6, 12.0]), np.array([10.0, 0, 0]), np.array([0, -9.0, 0]), 6, 4, 140.0
            ),
        ]
        floor = wall(
            rng, np.array([-5.0, 1.6, 1.0]), np.array([10.0, 0, 0]), np.array([0, 0, length]), 4, 12, 120.0
        )
        deep = 4.0, 10.0
    else:
        groups = [
            wall(rng, np.array([-2.5, 1.4, 0.5]), np.array([0, 0, 5.5]), np.array([0, -2.7, 0]), 5, 3, 180.0),
            wall(rng, np.array([2.5, 1.4, 0.5]), np.array([0, 0, 5.5]), np.array([0, -2.7, 0]), 5, 3, 110.0),
            wall(rng, np.array([-2.5, 1.4, 6.0]), np.array([5.0, 0, 0]), np.array([0, -2.7, 0]), 5, 3, 150.0),
            wall(rng, np.array([-2.5, -1.3, 0.5]), np.array([5.0, 0, 0]), np.array([0, 0, 5.5]), 3, 3, 230.0),
        ]
        floor = wall(
            rng, np.array([-2.5, 1.4, 0.5]), np.array([5.0, 0, 0]), np.array([0, 0, 5.5]), 6, 6, 80.0
        )
        deep = 2.0, 4.5
    across = 4.0 if kind.street else 1.8
    pieces = []
    for turned in [False] * kind.furniture + [True] * kind.turned:
        size = rng.uniform(0.4, 1.1, 3)
        place = np.array(
            [rng.uniform(-across, across), (1.6 if kind.street else 1.4) - size[1], rng.uniform(*deep)]
        )
        pieces.append(box(rng, place, size, rng.uniform(0.2, 1.37) if turned else 0.0))
    far = sorted(pieces, key=lambda faces: -np.mean([f[0][:, 2].mean() for f in faces]))
    return [floor, *groups, *(sorted(p, key=lambda f: -f[0][:, 2].mean()) for p in far)]


def clipped(corners):
    """The part of a polygon (N, 3) beyond `NEAR`."""
    out = []
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        if a[2] >= NEAR:
            out.append(a)
        if (a[2] >= NEAR) != (b[2] >= NEAR):
            out.append(a + (NEAR - a[2]) / (b[2] - a[2]) * (b - a))
    return np.array(out)


def fill(canvas, uv, grey):
    """Fill a polygon given in px of the picture."""
    fine = ((uv + 0.5) * FINE - 0.5) * 256
    cv2.fillPoly(canvas, [np.clip(fine, -(2**28), 2**28).round().astype(np.int32)], float(grey), shift=8)


def branches(canvas, kind, rng):
    """Thin straight pieces in all directions of the picture."""
    for _ in range(kind.clutter):
        begin, turn = rng.uniform((0, 0), SIZE), rng.uniform(0, np.pi)
        way = np.array([np.cos(turn), np.sin(turn)])
        end, side = begin + rng.uniform(30, 200) * way, rng.uniform(0.5, 2.0) * np.array([-way[1], way[0]])
        fill(canvas, np.array([begin - side, end - side, end + side, begin + side]), rng.uniform(0, 255))


def picture(kind, seed):
    """A picture of a scene."""
    rng = np.random.default_rng(seed)
    yaw, pitch = rng.uniform(0.25, 0.75) * rng.choice([-1, 1]), rng.uniform(-1, 1) * kind.pitch
    if kind.pitch:
        pitch = np.sign(pitch) * max(abs(pitch), 0.4 * kind.pitch)
    turn = rotations.exp(np.array([0, 0, rng.normal(0, 0.03)]))
    turn = turn @ rotations.exp(np.array([pitch, 0, 0])) @ rotations.exp(np.array([0, yaw, 0]))
    bent = np.eye(3)
    for i, j in ((0, 1), (1, 2), (2, 0)):
        bent[j, i] += rng.normal(0, kind.square) if kind.square else 0.0
    canvas = np.full((SIZE[1] * FINE, SIZE[0] * FINE), 240.0, np.float32)
    for group in world(kind, rng):
        for corners, grey in group:
            part = clipped(corners @ bent.T @ turn.T)
            if len(part) >= 3:
                fill(canvas, kind.focal * part[:, :2] / part[:, 2:] + MIDDLE, grey)
    branches(canvas, kind, rng)
    grey = cv2.resize(canvas, SIZE, interpolation=cv2.INTER_AREA)
    grey = cv2.GaussianBlur(grey, (0, 0), 0.5) + rng.normal(0, 3, grey.shape)
    return np.clip(np.rint(grey), 0, 255).astype(np.uint8)


def measure(name, seed):
    """The relative error and sigma of the focal length; None where it is refused."""
    kind = KINDS[name]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "scene.png"
        cv2.imwrite(str(path), picture(kind, seed))
        try:
            found = scene.estimate(_segments(path, None), lenses.make("pinhole"), {}, 0, True)
        except CamcalError as error:
            return {"kind": name, "seed": seed, "refused": str(error)}
    f, sigma = found.camera.params[0], float(np.sqrt(found.covariance[0, 0]))
    return {"kind": name, "seed": seed, "error": float(f / kind.focal - 1), "sigma": sigma / kind.focal}


def row(name, runs):
    """One row of the table."""
    error, sigma = np.array([(r["error"], r["sigma"]) for r in runs if "error" in r]).reshape(-1, 2).T
    refused = len(runs) - len(error)
    if not len(error):
        return [name, len(runs), refused, "", "", "", ""]
    return [
        name,
        len(runs),
        refused,
        f"{100 * np.median(np.abs(error)):.2f} %",
        f"{np.mean(np.abs(error) <= 0.05):.0%}",
        f"{np.mean(np.abs(error) <= 1.96 * sigma):.0%}",
        f"{100 * np.median(sigma):.1f} %",
    ]


def table(runs):
    """The table of all runs."""
    by_kind = {}
    for r in runs:
        by_kind.setdefault(r["kind"], []).append(r)
    rows = [row(name, by_kind[name]) for name in KINDS if name in by_kind]
    return markdown(HEADER, [*rows, row("all", runs)])


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--runs", type=int, default=40)
    parser.add_argument("--begin", type=int, default=0)
    parser.add_argument("--only")
    parser.add_argument("--kept", type=Path)
    parser.add_argument("--write", type=Path)
    parser.add_argument("--update", type=Path)
    given = parser.parse_args()
    seeds = range(given.begin, given.begin + given.runs)
    chosen = [k for k in KINDS if not given.only or k in given.only.split(";")]
    if given.write:
        given.write.mkdir(parents=True, exist_ok=True)
        for name in chosen:
            for seed in seeds:
                cv2.imwrite(
                    str(given.write / f"{name.replace(', ', '-').replace(' ', '_')}-{seed}.png"),
                    picture(KINDS[name], seed),
                )
        return
    if not given.update:
        for seed in seeds:
            for name in chosen:
                made = measure(name, seed)
                print(made, flush=True)
                keep(given.kept, made)
    show(given.update, "scene-rendered", table(kept(given.kept)))


if __name__ == "__main__":
    main()
