"""Pictures without a board, and with another target than asked for: how many are taken for one.

    python benchmarks/false_alarms.py [--pictures 2000] [--others 500] [--first 0] [--jobs 2] [--update PAGE]

The pictures are made here: clutter, texture of many scales, tiled floors and walls in perspective, facades with
rows of windows, pages of text, stripes and meshes. Each is searched as `camcal checkerboard` does without options:
as it is, then with black and white exchanged; and once more at a contrast of 30 grey levels, each with a second look at
the picture with its contrast evened out. In the second part
each picture shows a target of the table that is not the one asked for. A false alarm is a picture in which a target
of any kind is recognised.

To reach: none. With none among N, the rate is below 3 / N with 95 % confidence.
"""

from __future__ import annotations

import argparse
import multiprocessing
import sys
from collections import Counter
from functools import partial
from pathlib import Path

import cv2
import numpy as np
from detect import clutter
from tables import markdown, update

from camcal.detect import targets
from camcal.detect.local_contrast import with_second_look
from camcal.detect.recognition.decide import answers
from camcal.detect.recognition.look import Sight, look
from camcal.detect.targets.base import Detection
from camcal.model.placement import Spread
from camcal.study.cameras import example_camera
from camcal.study.pictures import board_poses
from camcal.study.render import Look, render

SIZE = (640, 480)
WEAK = 30  #: grey levels from black to white of the weak pictures
ASKED = (
    "checkerboard:9x6", "checkerboard:7x5", "charuco:9x7:1:0.5:4X4_100", "aprilgrid:6x6:1:0.3", "circles:10x8",
    "asymmetric-circles:4x11", "squares:8x6:1:0.8", "aruco-grid:5x7:1:0.25:5X5_100",
)  # fmt: skip


def texture(rng: np.random.Generator) -> np.ndarray:
    """Noise whose power falls with the frequency, as grass, gravel and cloth have it."""
    frequency = np.hypot(np.fft.fftfreq(SIZE[1])[:, None], np.fft.rfftfreq(SIZE[0])[None])
    frequency[0, 0] = 1
    spectrum = rng.normal(size=(*frequency.shape, 2)) @ [1, 1j] * frequency ** -rng.uniform(0.6, 1.6)
    picture = np.fft.irfft2(spectrum, s=SIZE[::-1])
    return 120 + 45 * picture / picture.std()


def in_perspective(flat: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A flat picture seen at a slant."""
    height, width = flat.shape
    rim = np.array([[0, 0], [width, 0], [width, height], [0, height]], np.float32)
    seen = (rim * np.divide(SIZE, (width, height)) + rng.normal(0, 0.18, (4, 2)) * SIZE).astype(np.float32)
    return cv2.warpPerspective(
        flat, cv2.getPerspectiveTransform(rim, seen), SIZE, borderMode=cv2.BORDER_REFLECT
    )


def tiles(rng: np.random.Generator) -> np.ndarray:
    """A floor of tiles with joints, each tile of its own grey, or two greys in turn for every third floor."""
    cell, joint = int(rng.integers(30, 80)), int(rng.integers(1, 6))
    flat = np.full((900, 1200), rng.uniform(60, 200))
    two, chequered = rng.uniform(60, 220, 2), rng.random() < 0.3
    for j, y in enumerate(range(0, 900, cell)):
        for x in range(0, 1200, cell):
            grey = two[rng.integers(2)] if chequered else rng.normal(150, 25)
            shift = (j % 2) * cell // 2 if rng.random() < 0.02 else 0
            flat[y + joint : y + cell, x + joint + shift : x + cell + shift] = grey
    return in_perspective(flat, rng)


def facade(rng: np.random.Generator) -> np.ndarray:
    """Rows of windows in a wall, each with panes and a reflection."""
    flat = np.full((900, 1200), rng.uniform(130, 220))
    w, h = rng.integers(40, 110, 2)
    gap = int(rng.integers(15, 80))
    for y in range(gap, 900 - h, h + gap):
        for x in range(gap, 1200 - w, w + gap):
            flat[y : y + h, x : x + w] = rng.normal(60, 20)
            flat[y : y + h, x + w // 2 : x + w // 2 + 3] = 200
            cv2.line(
                flat,
                (x, int(y + rng.uniform(0, h))),
                (x + int(w), int(y + rng.uniform(0, h))),
                rng.uniform(40, 160),
                4,
            )
    return in_perspective(flat, rng)


def text(rng: np.random.Generator) -> np.ndarray:
    """A page of letters and a table."""
    flat = np.full((900, 1200), 235, np.uint8)
    scale = float(rng.uniform(0.5, 1.4))
    for y in range(40, 880, int(36 * scale)):
        line = "".join(chr(int(c)) for c in rng.integers(33, 126, 90))
        cv2.putText(flat, line, (30, y), cv2.FONT_HERSHEY_SIMPLEX, scale, 30, 2)
    if rng.random() < 0.5:
        step = int(rng.integers(30, 90))
        flat[::step, :], flat[:, ::step] = 20, 20
    return in_perspective(flat, rng)


def mesh(rng: np.random.Generator) -> np.ndarray:
    """Stripes, a woven mesh, or discs in no order."""
    y, x = np.mgrid[0:900, 0:1200]
    period = rng.uniform(14, 70)
    kind = rng.integers(3)
    if kind == 0:
        flat = 128 + 90 * np.sign(np.sin(2 * np.pi * x / period))
    elif kind == 1:
        flat = 128 + 60 * np.sin(2 * np.pi * x / period) + 60 * np.sin(2 * np.pi * y / period)
    else:
        flat = np.full((900, 1200), 210.0)
        for _ in range(150):
            cv2.circle(
                flat, tuple(int(v) for v in rng.uniform((0, 0), (1200, 900))), int(rng.uniform(6, 30)), 40, -1
            )
    return in_perspective(flat, rng)


def behind(rng: np.random.Generator) -> np.ndarray:
    return clutter(rng, *SIZE).astype(float)


SCENES = {
    "clutter": behind,
    "texture": texture,
    "tiles": tiles,
    "facades": facade,
    "text": text,
    "mesh": mesh,
}


def photographed(flat: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """8 bits, with the blur and the noise of a camera."""
    picture = cv2.GaussianBlur(flat.astype(np.float32), (0, 0), float(rng.uniform(0.4, 1.5)))
    return np.clip(picture + rng.normal(0, 2, picture.shape), 0, 255).astype(np.uint8)


def sight(gray: np.ndarray) -> Sight:
    return look(gray, 1.0)[0]


def without(seed: int) -> tuple[str, str]:
    """What a picture without a board shows, and the target that it is taken for, or nothing."""
    cv2.setNumThreads(1)
    rng = np.random.default_rng(seed)
    name = list(SCENES)[seed % len(SCENES)]
    gray = photographed(SCENES[name](rng), rng)
    weak = np.rint(100 + gray * (WEAK / 255) + rng.normal(0, 0.5, gray.shape)).astype(np.uint8)
    for how, shown in (("", gray), (" exchanged", ~gray), (" weak", weak)):
        seen = answers([with_second_look(shown, partial(sight, shown), lambda s: s.undecided)])
        if seen:
            return name, seen[0].target.spec + how
    return name, ""


def another(seed: int) -> tuple[str, str]:
    """Whether points of the target that was asked for are found in a picture of another one."""
    cv2.setNumThreads(1)
    rng = np.random.default_rng(seed)
    asked, shown = rng.choice(len(ASKED), 2, replace=False)
    target, other = targets.make(ASKED[asked]), targets.make(ASKED[shown])
    camera = example_camera("opencv5", SIZE, {})
    pose = board_poses(other, camera, rng, 1, Spread(tilt=(0.0, 50.0), fill=(0.5, 0.95), roll=180.0))[0]
    gray = render(other.pattern(), camera, pose, Look(blur=0.7, noise=2.0), rng)
    found = targets.find(target, gray, 1.0)
    return f"{other.kind} for {target.kind}", target.spec if isinstance(found, Detection) else ""


def counted(work, first: int, count: int, jobs: int) -> tuple[Counter, Counter]:
    """How many pictures of each kind, and how many of them are taken for a target, which are printed as they come."""
    total, wrong = Counter(), Counter()
    with multiprocessing.get_context("spawn").Pool(jobs) as pool:
        seeds = range(first, first + count)
        for seed, (name, said) in zip(seeds, pool.imap(work, seeds, chunksize=10), strict=True):
            total[name] += 1
            if said:
                wrong[name] += 1
                print(f"seed {seed}: {name} taken for {said}", flush=True)
            if total.total() % 100 == 0:
                print(f"{total.total()} of {count}", file=sys.stderr, flush=True)
    return total, wrong


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--pictures", type=int, default=2000)
    parser.add_argument("--others", type=int, default=500)
    parser.add_argument("--first", type=int, default=0, help="seed to begin with")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--update", type=Path)
    options = parser.parse_args()
    rows = []
    total, wrong = counted(without, options.first, options.pictures, options.jobs)
    rows += [(name, n, wrong[name]) for name, n in sorted(total.items())]
    rows.append(("all without a board", sum(total.values()), sum(wrong.values())))
    others, taken = counted(another, options.first, options.others, options.jobs)
    rows.append(("another target than asked for", sum(others.values()), sum(taken.values())))
    table = markdown(("pictures", "number", "taken for a target"), rows)
    print(table)
    for name, n in taken.items():
        print(f"{n} x {name}")
    if options.update:
        update(options.update, "boards-that-are-none", table)


if __name__ == "__main__":
    main()
