"""Do the 95 % intervals of relative poses and distances hold the truth?

    python benchmarks/rig_coverage.py [--runs 500] [--rigs 2,4,12,few,boards,ring,late,late-3,in-step] [--others 50]

Simulated rigs, noise of .2 px, of `RIGS`:

    2, 4, 12   cameras on an arc, all of which see a board at 12 instants
    few        four cameras; a board is seen by two neighbours at a time, four instants a pair
    boards     two cameras that look in opposite directions at two boards that stand fast, 15 instants
    ring       four cameras that look in four directions at four boards around them; the rig turns
    late       as 2, with a board that a hand moves on, and a camera that is one frame late
    late-3     the same with three cameras, of which the last is two frames late

Printed are, over all runs and cameras: the share of the intervals (1.96 sigma) of each component of the relative poses
and of each distance that hold the truth, the mean error in standard errors of that mean (bias, the largest of all
components; of 6 a camera the largest is 2.6, of 66 3.4 in one study of twenty), and the root mean square error of the
distance between the first two cameras. The search begins at the truth, which takes less time and ends at the same
figures; with --whole each run is a `calibrate_rig`, as those of `late` always are: they are judged after `--lag`, and
printed is in how many runs the lag was named, and nothing else. In step is the same board without a lag: how often one
is named then.

With --others N the same distances of the first N runs by cv2.stereoCalibrate, cv2.calibrateMultiview (5.0), mrcal
(`--mrcal PYTHON`) and aniposelib (`--anipose PYTHON`), where they are installed.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import replace
from itertools import combinations, pairwise
from pathlib import Path

import cv2
import numpy as np
from rig import NOISE, SIZE, simulated

import camcal
from camcal.assess.covariance import covariance
from camcal.assess.rig import baseline_sigma, relative_sigmas
from camcal.data.boards import labels
from camcal.data.observations import Observations
from camcal.errors import CamcalError
from camcal.geometry import rotations
from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.model.pose import Pose, Poses
from camcal.model.rig import Rig
from camcal.solve.calibration import RigCalibration
from camcal.solve.refine import How, board_kind, refine
from camcal.system.processes import one_opencv_thread

#: two-sided 95 % of a Gaussian
WIDTH = 1.96
#: that of mrcal and, with k3 held, of cv2; aniposelib has f and k1
MODEL = "opencv4"
HERE = Path(__file__).parent
#: mm; cv2.calibrateMultiview refuses points in mm as lying on a line
UNIT = 1000.0
#: frames by which cameras lag in the rigs of that name
LAGS = {"late": {"c1": 1}, "late-3": {"c2": 2}, "in-step": {}}


#: data, true rig, and true poses rig_from_board (of the first board) of the instants
Made = tuple[Observations, Rig, Poses]


# --------------------------------------------------------------------------------------------------------- the rigs
def board() -> np.ndarray:
    """54 points of 30 mm squares about their middle."""
    x, y = np.meshgrid(np.arange(9) - 4.0, np.arange(6) - 2.5)
    return np.c_[x.ravel(), y.ravel(), np.zeros(x.size)] * 30.0


def camera() -> Camera:
    """90 x 53 degrees less a barrel distortion."""
    lens = lenses.make("brown:radial=1,decentering=0")
    return Camera(lens, lens.from_values({"fx": 600, "fy": 600, "cx": 319.5, "cy": 239.5, "k1": -0.1}), SIZE)


def few(seed: int) -> Made:
    """Four cameras of which two neighbours see each instant."""
    data, rig, boards = simulated(4, 12, seed=seed)
    pairs = list(pairwise(range(4)))
    seen = np.array([[c in pairs[v % 3] for v in range(12)] for c in range(4)])
    rows = np.flatnonzero(seen[data.camera, data.view])
    keep = np.zeros(len(data.view), bool)
    keep[rows] = True
    return data.where(keep), rig, boards


def among_boards(rig: Rig, boards: list[Pose], instants: int, turn: float, seed: int) -> Made:
    """A rig that is turned and moved among boards that stand fast: what its cameras see of them."""
    rng, points, own = np.random.default_rng(seed), board(), len(board())
    columns: dict[str, list] = {"xyz": [], "uv": [], "view": [], "camera": [], "point": []}
    moves = [
        Pose.from_vector(np.r_[rng.uniform(-0.3, 0.3, 2), rng.uniform(-0.3, 0.3)], rng.uniform(-80, 80, 3))
        @ Pose.from_vector(np.array([0.0, turn * v, 0.0]), np.zeros(3))
        for v in range(instants)
    ]
    for index, (name, own_camera) in enumerate(rig.cameras.items()):
        for view, move in enumerate(moves):
            for number, place in enumerate(boards):
                xyz = (rig.cam_from_rig[name] @ move @ place).apply(points)
                uv = np.full((own, 2), np.nan) if xyz[:, 2].min() < 100 else own_camera.project(xyz)
                with np.errstate(invalid="ignore"):
                    seen = np.flatnonzero(((uv > 0) & (uv < np.array(SIZE) - 1)).all(1))
                if len(seen) >= 12:
                    columns["xyz"].append(points[seen])
                    columns["uv"].append((uv + rng.normal(0, NOISE, uv.shape))[seen])
                    columns["view"].append(np.full(len(seen), view))
                    columns["camera"].append(np.full(len(seen), index))
                    columns["point"].append(seen + own * number)
    data = Observations(
        **{k: np.concatenate(v) for k, v in columns.items()},
        view_ids=tuple(map(str, range(instants))),
        cameras=tuple(rig.cameras),
        image_sizes=(SIZE,) * len(rig.cameras),
        target={
            "places": boards,
            "boards": [f"b{k}" for k in range(len(boards))],
            "first_ids": [own * k for k in range(len(boards))],
        },
    )
    return data, rig, Poses.stack([m @ boards[0] for m in moves])


def _around(count: int) -> tuple[Rig, list[Pose]]:
    """Cameras that look in so many directions, and a board before each of them."""
    angles = [2 * np.pi * k / count for k in range(count)]
    names = [f"c{k}" for k in range(count)]
    ahead = {
        n: Pose.from_vector(np.array([0.0, -a, 0.0]), np.array([0.0, 0.0, -50.0]))
        for n, a in zip(names, angles, strict=True)
    }
    rng = np.random.default_rng(1)
    places = [
        ahead[n].inverse() @ Pose.from_vector(rng.uniform(-0.2, 0.2, 3), np.array([0.0, 0.0, 900.0]))
        for n in names
    ]
    return Rig.in_frame_of(names[0], dict.fromkeys(names, camera()), ahead), places


def boards(seed: int) -> Made:
    """Two cameras, two boards, no overlap."""
    rig, places = _around(2)
    inside = rig.cam_from_rig["c0"]
    base = Pose.from_vector(np.zeros(3), np.array([0.0, 0.0, -50.0]))  # rig's frame is that of c0
    return among_boards(rig, [inside @ base @ p for p in places], 15, 0.0, seed)


def ring(seed: int) -> Made:
    """Four cameras, four boards; the rig turns about the vertical, so that every camera sees several boards."""
    rig, places = _around(4)
    base = Pose.from_vector(np.zeros(3), np.array([0.0, 0.0, -50.0]))
    return among_boards(rig, [base @ p for p in places], 16, 0.4, seed)


def late(cameras: int, lags: dict[str, int], seed: int) -> Made:
    """Cameras before a board that moves by 20 to 60 mm and some degrees from frame to frame; those of `lags` late."""
    rig = simulated(cameras, 1)[1]
    rng, points, most = np.random.default_rng(seed), board(), max(lags.values(), default=1)
    steps = np.cumsum(rng.uniform(-1, 1, (24, 6)) * [0.12, 0.12, 0.12, 40, 30, 40], 0)
    steps -= steps.mean(0)
    steps[:, :3] += rng.uniform(-0.1, 0.1, 3)
    poses = [Pose.from_vector(s[:3], s[3:] + [0, 0, 950]) for s in steps]
    columns: dict[str, list] = {"xyz": [], "uv": [], "view": [], "camera": []}
    for index, name in enumerate(rig.cameras):
        for view in range(most, len(poses)):
            place = poses[view - lags.get(name, 0)]
            uv = rig.cameras[name].project((rig.cam_from_rig[name] @ place).apply(points))
            inside = np.flatnonzero(((uv > 0) & (uv < np.array(SIZE) - 1)).all(1))
            if len(inside) >= 12:
                columns["xyz"].append(points[inside])
                columns["uv"].append((uv + rng.normal(0, NOISE, uv.shape))[inside])
                columns["view"].append(np.full(len(inside), view))
                columns["camera"].append(np.full(len(inside), index))
    data = Observations(
        **{k: np.concatenate(v) for k, v in columns.items()},
        view_ids=tuple(map(str, range(len(poses)))),
        cameras=tuple(rig.cameras),
        image_sizes=(SIZE,) * cameras,
    )
    return data, rig, Poses.stack(poses)


#: name -> what a seed gives
RIGS: dict[str, Callable[[int], Made]] = {
    "2": lambda seed: simulated(2, 12, seed=seed),
    "4": lambda seed: simulated(4, 12, seed=seed),
    "12": lambda seed: simulated(12, 12, seed=seed),
    "few": few,
    "boards": boards,
    "ring": ring,
    "late": lambda seed: late(2, LAGS["late"], seed),
    "late-3": lambda seed: late(3, LAGS["late-3"], seed),
    "in-step": lambda seed: late(3, {}, seed),
}


# ------------------------------------------------------------------------------------------------------- the figures
def errors(solution: RigCalibration, truth: Rig) -> tuple[list[float], list[float]]:
    """Errors in units of their sigma: of the components of the relative poses, and of the distances."""
    accuracy, poses, distances = covariance(solution), [], []
    for name in list(truth.cameras)[1:]:
        ours, true = solution.rig.cam_from_rig[name], truth.cam_from_rig[name]
        off = np.r_[rotations.log(ours.rotation @ true.rotation.T), ours.translation - true.translation]
        poses += (off / relative_sigmas(solution, accuracy, name)).tolist()
    for a, b in combinations(truth.cameras, 2):
        off = solution.rig.baseline(a, b) - truth.baseline(a, b)
        distances.append(float(off / baseline_sigma(solution, accuracy, a, b)))
    return poses, distances


def lags_named(data: Observations) -> dict[str, int]:
    """The lags that a calibration as if the cameras were in step names."""
    try:
        solution = camcal.calibrate_rig(data, model=MODEL, robust="none", checks=False)
    except CamcalError as error:
        said = error.message.partition("not in step: ")[2]
        return {name: int(count) for name, count in re.findall(r"(c\d) by (\d) frames? late", said)}
    return next((s.info.get("lags", {}) for s in solution.stages if s.name == "spanning-tree"), {})


def at_truth(data: Observations, rig: Rig, poses: Poses) -> RigCalibration:
    """The joint estimate from the truth; several boards where they stand."""
    first, lens = placed_truth(data), lenses.make(MODEL)
    cameras = {
        n: Camera(lens, lens.from_values({"k1": 0.0} | _core(c)), SIZE) for n, c in rig.cameras.items()
    }
    start = Rig(cameras, rig.cam_from_rig, rig.reference)
    seen = np.unique(first.view)
    return refine(start, Poses.of(poses[seen]), first.of_views(seen), How(board=board_kind(first)))


def _core(own: Camera) -> dict[str, float]:
    return {p: own.values[p] for p in ("fx", "fy", "cx", "cy", "k1")}


def placed_truth(data: Observations) -> Observations:
    """Several boards in the frame of the first one, where they are."""
    which = labels(data)
    if which is None:
        return data
    target, xyz = dict(data.target or {}), data.xyz.copy()
    first = target["places"][0].inverse()
    poses = [first @ p for p in target.pop("places")]
    for k, pose in enumerate(poses):
        xyz[which == k] = pose.apply(xyz[which == k])
    target |= {"board_groups": [0] * len(poses), "board_poses": [p.entry() for p in poses]}
    return replace(data, xyz=xyz, target=target)


def study(name: str, runs: int, others: dict[str, str | None], first: int, whole: bool) -> None:
    """Print the row of one rig, and those of other programs on its first runs."""
    poses, distances, ours, failed, named = [], [], [], 0, 0
    theirs: dict[str, list[float]] = {who: [] for who in others}
    for seed in range(runs):
        data, rig, poses_true = RIGS[name](seed)
        options = {}
        if name in LAGS:
            named += lags_named(data) == LAGS[name]
            options = {"lag": LAGS[name]}
        try:
            solution = (
                camcal.calibrate_rig(data, model=MODEL, robust="none", checks=False, **options)
                if whole or name in LAGS
                else at_truth(data, rig, poses_true)
            )
        except CamcalError as error:
            failed += 1
            print(f"{name} {seed}: {error.message}", file=sys.stderr)
            continue
        z, d = errors(solution, rig)
        poses.append(z)
        distances.append(d)
        ours.append(solution.rig.baseline("c0", "c1"))
        if seed < first and name in ("2", "4", "12", "few"):
            for who, where in others.items():
                theirs[who].append(OTHERS[who](data, solution, where))
    true = rig.baseline("c0", "c1")
    z, d = np.array(poses), np.array(distances)
    bias = np.abs(z.mean(0) / (z.std(0, ddof=1) / np.sqrt(len(z)))).max()
    print(
        f"| {name} | {len(z)} | {100 * (np.abs(z) <= WIDTH).mean():.1f} % | {100 * (np.abs(d) <= WIDTH).mean():.1f} % "
        f"| {bias:.1f} of {z.shape[1]} | {rms(ours, true):.4f} of {true:.1f} |"
        + (f" failed {failed}" if failed else "")
        + (f" lags named rightly in {named}" if name in LAGS else ""),
        flush=True,
    )
    for who, found in theirs.items():
        good = np.isfinite(found)
        if good.any():
            same = [o for o, g in zip(ours, good, strict=False) if g]
            print(
                f"    {who}: {rms(np.array(found)[good], true):.4f}, camcal on the same {good.sum()}: "
                f"{rms(same, true):.4f}",
                flush=True,
            )


def rms(values: list[float] | np.ndarray, true: float) -> float:
    """The root mean square error."""
    return float(np.sqrt(np.mean(np.square(np.asarray(values) - true))))


# ------------------------------------------------------------------------------------------------- the other programs
def as_arrays(data: Observations) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """uv (C, V, N, 2) with -1 where a camera saw nothing, which were seen (C, V), and the board (N, 3)."""
    points = np.unique(data.xyz, axis=0)
    points = points[np.lexsort((points[:, 0], points[:, 1]))]
    count = len(points)
    uv = np.full((len(data.cameras), len(data), count, 2), -1.0)
    for block, rows in enumerate(data.slices):
        uv[data.blocks.camera[block], data.blocks.view[block]] = data.uv[rows]
    return uv, (uv >= 0).all((2, 3)), points


def by_stereo(data: Observations, solution: RigCalibration, _: str | None) -> float:
    """cv2.stereoCalibrate of the first two cameras, from their intrinsics alone."""
    uv, seen, points = as_arrays(data)
    both = np.flatnonzero(seen[:2].all(0))
    flags = int(cv2.CALIB_FIX_K3)
    given = [points.astype(np.float32)] * len(both)
    views = [[np.ascontiguousarray(uv[c, v], np.float32) for v in both] for c in (0, 1)]
    with one_opencv_thread():
        alone = [cv2.calibrateCamera(given, views[c], SIZE, None, None, flags=flags)[1:3] for c in (0, 1)]
        found = cv2.stereoCalibrate(
            given, *views, *alone[0], *alone[1], SIZE, flags=flags | cv2.CALIB_USE_INTRINSIC_GUESS,
            criteria=(3, 200, 1e-12),
        )  # fmt: skip
    return float(np.linalg.norm(found[6]))


def by_multiview(data: Observations, solution: RigCalibration, _: str | None) -> float:
    """cv2.calibrateMultiview of all cameras, which begins by itself."""
    uv, seen, points = as_arrays(data)
    count = len(uv)
    flags = int(cv2.CALIB_FIX_K3)
    try:
        with one_opencv_thread():
            _, _, _, _, shifts = cv2.calibrateMultiview(
                [(points / UNIT).astype(np.float32)] * uv.shape[1],
                [[np.ascontiguousarray(v, np.float32) for v in own] for own in uv],
                [SIZE] * count,
                seen.astype(np.uint8),
                np.full(count, cv2.CALIB_MODEL_PINHOLE, np.uint8),
                None, None, None, None,
                flagsForIntrinsics=np.full((count, 1), flags, np.int32),
            )  # fmt: skip
    except cv2.error:
        return float("nan")
    return UNIT * float(np.linalg.norm(shifts[1]))


def by_worker(worker: str) -> Callable[[Observations, RigCalibration, str | None], float]:
    """A program in an interpreter of its own: WORKER IN.npz OUT.npz."""

    def run(data: Observations, solution: RigCalibration, python: str | None) -> float:
        uv, seen, points = as_arrays(data)
        with tempfile.TemporaryDirectory() as folder:
            given, found = (Path(folder) / n for n in ("in.npz", "out.npz"))
            np.savez(
                given,
                uv=uv, seen=seen, points=points, size=SIZE,
                intrinsics=[
                    [c.values[p] for p in ("fx", "fy", "cx", "cy")] + [c.values["k1"], 0, 0, 0]
                    for c in solution.start.cameras.values()
                ],
                rig=[np.r_[p.rotation_vector, p.translation] for p in solution.start.cam_from_rig.values()],
                boards=[np.r_[p.rotation_vector, p.translation] for p in solution.poses],
            )  # fmt: skip
            made = subprocess.run(
                [str(python), str(HERE / worker), given, found], capture_output=True, check=False
            )
            if made.returncode:
                print(made.stderr.decode()[-300:], file=sys.stderr)
                return float("nan")
            return float(np.load(found)["distance"])

    return run


OTHERS: dict[str, Callable[[Observations, RigCalibration, str | None], float]] = {
    "cv2.stereoCalibrate": by_stereo,
    "cv2.calibrateMultiview": by_multiview,
    "mrcal": by_worker("mrcal_rig_worker.py"),
    "aniposelib": by_worker("anipose_rig_worker.py"),
}


def main() -> None:
    """Print a row for each rig."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=500)
    parser.add_argument("--rigs", default=",".join(RIGS))
    parser.add_argument("--others", type=int, default=0)
    parser.add_argument("--whole", action="store_true")
    parser.add_argument("--mrcal")
    parser.add_argument("--anipose")
    asked = parser.parse_args()
    others: dict[str, str | None] = {"cv2.stereoCalibrate": None} if asked.others else {}
    if asked.others and hasattr(cv2, "calibrateMultiview"):
        others["cv2.calibrateMultiview"] = None
    others |= {n: p for n, p in (("mrcal", asked.mrcal), ("aniposelib", asked.anipose)) if p and asked.others}
    print("| rig | runs | poses in 95 % | distances in 95 % | bias, se | distance c0-c1, rms error, mm |")
    print("|---|---|---|---|---|---|")
    for name in asked.rigs.split(","):
        study(name, asked.runs, others, asked.others, asked.whole)


if __name__ == "__main__":
    main()
