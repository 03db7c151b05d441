"""Accuracy, honesty, alarms and speed of `camcal track`, beside each frame alone and beside cv2 on each.

    python benchmarks/tracking.py [--runs 8] [--frames 200] [--long 100000] [--write PAGE]

Sequences are simulated (camcal.tracking.simulate): 50 points in a cube of side 2 at distance 5, a focal
length of 900 px, 0.3 px of noise, 5 % outliers; the camera stands, warms up, is knocked by 0.3 degrees
half-way, turns, or zooms. "cv2" is cv2.calibrateCamera on each frame with the first frame's true K as its
guess and no distortion; "cv2 without outliers" the same with the outliers taken out by an oracle, for cv2
itself rejects none.

Times are processor seconds of one thread, so that other work on the machine hardly counts.

To reach: 2,000 frames a second of 50 points in rls and kalman, 500 in iekf; memory that does not grow; NEES
of the filters inside its 95 % bounds in about 95 % of the frames.
"""

from __future__ import annotations

import argparse
import platform
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np
from scipy.stats import chi2

from camcal.geometry import projective
from camcal.registry import look_up
from camcal.tracking import ESTIMATORS
from camcal.tracking.base import Frame, TrackOptions
from camcal.tracking.detection import cusum_threshold, mean_time_to_alarm
from camcal.tracking.physical_model import Physical
from camcal.tracking.simulate import SEQUENCES, Scene, Truth, simulate

Array = np.ndarray
Pair = tuple[Frame, Truth]

#: frames at the start that the mean error leaves out: every estimator begins with one frame
SETTLE = 20
KNOWS_MOTION = ("kalman", "iekf", "window", "smoother")
GRID = np.stack(np.meshgrid(*[[-1.0, 0, 1]] * 3), -1).reshape(-1, 3)


# ------------------------------------------------------------------------------------------ estimators
def estimator(method: str, kind: str, **options: object) -> object:
    motion = {"motion": SEQUENCES[kind]} if method in KNOWS_MOTION else {}
    return look_up(ESTIMATORS, method, "method")(TrackOptions(**{**motion, **options}))  # type: ignore[arg-type]


def run(made: object, pairs: list[Pair]) -> list:
    states = [made.update(frame) for frame, _ in pairs]  # type: ignore[attr-defined]
    last = list(made.finish())  # type: ignore[attr-defined]
    return last if made.offline else states  # type: ignore[attr-defined]


def error(matrix: Array, truth: Truth) -> float:
    """Root mean square distance, over 27 points of the cube, between true and estimated projections, px."""
    r = projective.project(matrix, GRID) - projective.project(truth.matrix, GRID)
    return float(np.sqrt((r**2).sum(1).mean()))


def nees(made: object, state: object, truth: Truth) -> float:
    model = made.model  # type: ignore[attr-defined]
    if hasattr(model, "lens"):
        k = truth.k
        wanted = Physical(
            model.lens.pinhole(k[0, 0], k[1, 1], k[0, 2], k[1, 2]), truth.rotation, truth.translation
        )
    else:
        wanted = model.from_matrix(truth.matrix)
    deviates = np.linalg.solve(state.factor, model.local(state.estimate, wanted))  # type: ignore[attr-defined]
    return float(deviates @ deviates)


def cv2_matrix(frame: Frame, keep: Array, guess: Array) -> Array:
    """K [R | t] by cv2.calibrateCamera on one frame."""
    flags = cv2.CALIB_USE_INTRINSIC_GUESS | cv2.CALIB_ZERO_TANGENT_DIST
    flags |= cv2.CALIB_FIX_K1 | cv2.CALIB_FIX_K2 | cv2.CALIB_FIX_K3
    xyz, uv = frame.xyz[keep].astype(np.float32), frame.uv[keep].astype(np.float32)
    _, k, _, rvecs, tvecs = cv2.calibrateCamera([xyz], [uv], (640, 480), guess.copy(), None, flags=flags)
    return projective.compose(k, cv2.Rodrigues(rvecs[0])[0], tvecs[0])


# ------------------------------------------------------------------------------------------ accuracy
def accuracy(runs: int, count: int) -> Iterator[list[str]]:
    """A row for each sequence and method."""
    for kind in SEQUENCES:
        scene = Scene(outliers=0.05, knock=count // 2)
        streams = [list(simulate(kind, count, seed, scene)) for seed in range(runs)]
        for method in ESTIMATORS:
            yield [kind, method, *_judge(kind, method, streams, count // 2)]
        for name, oracle in (("cv2", False), ("cv2 without outliers", True)):
            yield [kind, name, *_judge_cv2(streams[: max(runs // 4, 1)], oracle)]


def _judge(kind: str, method: str, streams: list[list[Pair]], knock: int) -> list[str]:
    errors, normal, alarms, delays = [], [], 0, []
    for pairs in streams:
        made = estimator(method, kind)
        states = run(made, pairs)
        model = made.model  # type: ignore[attr-defined]
        matrices = model.describe([s.estimate for s in states], [s.factor for s in states]).matrix
        errors.append([error(m, t) for m, (_, t) in zip(matrices, pairs, strict=True)])
        normal.append([nees(made, s, t) for s, (_, t) in zip(states, pairs, strict=True)])
        changed = [s.frame for s in states if s.changed]
        if kind == "knock":
            delays += [f - knock for f in changed if f >= knock][:1]
            changed = [f for f in changed if f < knock]
        alarms += len(changed)
    mean, worst, last = np.sqrt(np.mean(np.square(errors), 0)), np.max(errors), np.array(errors)[:, -1]
    size, n = model.size, len(streams)
    bounds = chi2.ppf([0.025, 0.975], n * size) / n
    inside = np.mean((np.mean(normal, 0) >= bounds[0]) & (np.mean(normal, 0) <= bounds[1]))
    seen = f"{len(delays)} of {n}, after {max(delays, default=0)} frames" if kind == "knock" else ""
    return [
        f"{np.sqrt(np.mean(mean[SETTLE:] ** 2)):.3f}", f"{worst:.2f}", f"{np.sqrt(np.mean(last**2)):.3f}",
        f"{np.mean(normal) / size:.2f}", f"{100 * inside:.0f} %", str(alarms), seen,
    ]  # fmt: skip


def _judge_cv2(streams: list[list[Pair]], oracle: bool) -> list[str]:
    errors = []
    for pairs in streams:
        guess = pairs[0][1].k
        for frame, truth in pairs[SETTLE:]:
            keep = truth.good if oracle else np.ones(len(frame), bool)
            errors.append(error(cv2_matrix(frame, keep, guess), truth))
    return [f"{np.sqrt(np.mean(np.square(errors))):.3f}", f"{max(errors):.2f}", "", "", "", "", ""]


# ------------------------------------------------------------------------------------------ alarms
def alarms(runs: int) -> Iterator[list[str]]:
    """False alarms at a rate that can be counted, and delays at the default rate."""
    rate, count = 0.005, 400
    for method in ("rls", "kalman", "iekf"):
        found = frames = 0
        for seed in range(2 * runs):
            pairs = list(simulate("static", count, 1000 + seed, Scene(outliers=0.05)))
            found += sum(s.changed for s in run(estimator(method, "static", false_alarm=rate), pairs))
            frames += count
        yield [
            method,
            "false alarms",
            f"{rate:g} a frame",
            f"{found} in {frames} frames: {found / frames:.4f}",
        ]
    for angle in (0.3, 0.1, 0.03, 0.01, 0.005):
        delays = []
        for seed in range(runs):
            pairs = list(simulate("knock", 300, seed, Scene(outliers=0.05, knock=100, angle=angle)))
            states = run(estimator("kalman", "knock"), pairs)
            after = [s.frame - 100 for s in states if s.changed and s.frame >= 100]
            delays.append(after[0] if after else np.inf)
        pixels = 900 * np.deg2rad(angle)
        said = f"{np.isfinite(delays).sum()} of {runs} seen, delay {np.median(delays):g} (median), "
        said += f"{max(delays):g} (longest)"
        yield ["kalman", f"knock of {angle:g} deg = {pixels:.2f} px", "1e-06 a frame", said]


# ------------------------------------------------------------------------------------------ strong noise
def strong_noise(runs: int) -> Iterator[list[str]]:
    """NEES after 150 frames of 30 points, all seen, as the noise grows: M is linear in what a frame says."""
    for noise in (0.3, 1.0, 2.0, 4.0):
        row = [f"{noise:g}"]
        for method in ("rls", "kalman", "iekf"):
            values = []
            for seed in range(runs):
                pairs = list(simulate("static", 150, seed, Scene(points=30, noise=noise, image_size=None)))
                made = estimator(method, "static", **({"gain": "mean"} if method == "rls" else {}))
                values.append(nees(made, run(made, pairs)[-1], pairs[-1][1]))
            row.append(f"{np.mean(values) / made.model.size:.2f}")  # type: ignore[attr-defined]
        yield row


# ------------------------------------------------------------------------------------------ speed
def seconds_per_frame(update: Callable[[Frame], object], frames: list[Frame]) -> float:
    """The median over five stretches, processor time."""
    update(frames[0])
    parts = np.array_split(np.arange(1, len(frames)), 5)
    times = []
    for part in parts:
        start = time.process_time()
        for index in part:
            update(frames[index])
        times.append((time.process_time() - start) / len(part))
    return float(np.median(times))


def speed() -> Iterator[list[str]]:
    pairs = list(simulate("static", 2500, 0, Scene()))
    frames = [f for f, _ in pairs]
    wanted = {"rls": "2000", "kalman": "2000", "iekf": "500"}
    for method in ESTIMATORS:
        some = frames[:300] if method == "window" else frames
        taken = seconds_per_frame(estimator(method, "static").update, some)  # type: ignore[attr-defined]
        yield [method, f"{1 / taken:,.0f}", wanted.get(method, "")]
    every = np.ones(50, bool)
    taken = seconds_per_frame(lambda f: cv2_matrix(f, every, pairs[0][1].k), frames[:300])
    yield [f"cv2.calibrateCamera {cv2.__version__}", f"{1 / taken:,.0f}", ""]
    for method in ("rls", "kalman", "iekf"):
        yield [f"camcal track --method {method}, file to file", f"{_whole(method, frames):,.0f}", ""]


def _whole(method: str, frames: list[Frame]) -> float:
    """Frames a processor second of the command, start-up included, on 20,000 frames."""
    with tempfile.TemporaryDirectory() as folder:
        source, out = Path(folder) / "s.csv", Path(folder) / "t.csv"
        with source.open("w") as stream:
            stream.write("frame,X,Y,Z,u,v\n")
            for number in range(20_000):
                f = frames[number % len(frames)]
                rows = np.c_[f.xyz, f.uv].tolist()
                stream.writelines(f"{number},{','.join(f'{x:.6f}' for x in row)}\n" for row in rows)
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        command = [sys.executable, "-m", "camcal", "track", source, "-o", out, "--method", method, "-q"]
        subprocess.run(list(map(str, command)), check=True)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return 20_000 / (after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime)


def long_run(method: str, count: int) -> list[str]:
    """Memory and the covariance over many frames: both have to stay where they are."""
    pairs = list(simulate("static", 50, 0, Scene()))
    rng = np.random.default_rng(0)
    clean = projective.project(pairs[0][1].matrix, pairs[0][0].xyz)
    made = estimator(method, "static", **({"motion": "thermal"} if method in KNOWS_MOTION else {}))
    size = early = late = memory = 0.0
    for number in range(count):
        uv = clean + rng.normal(0, 0.3, clean.shape)
        state = made.update(Frame(number, pairs[0][0].xyz, uv))  # type: ignore[attr-defined]
        size = float(np.linalg.norm(state.factor))
        if number == count // 10:
            early, memory = size, _memory()
    late = size
    off = error(made.model.describe([state.estimate], [state.factor]).matrix[0], pairs[0][1])  # type: ignore
    return [
        method, f"{count:,}", f"{memory:.1f}", f"{_memory():.1f}", f"{late / early - 1:+.1e}", f"{off:.3f}",
    ]  # fmt: skip


def _memory() -> float:
    """Resident memory of this process, MB."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize() / 1e6


# ------------------------------------------------------------------------------------------ the page
def table(header: list[str], rows: Iterator[list[str]]) -> Iterator[str]:
    yield "| " + " | ".join(header) + " |"
    yield "|" + "---|" * len(header)
    for row in rows:
        yield "| " + " | ".join(row) + " |"


def page(options: argparse.Namespace) -> Iterator[str]:
    versions = f"numpy {np.__version__}, OpenCV {cv2.__version__}, Python {platform.python_version()}"
    yield "# Tracking, measured\n"
    yield "This page is written by `python benchmarks/tracking.py --write docs/tracking-results.md`; what the"
    yield "words mean stands in [tracking.md](tracking.md) and in the benchmark itself.\n"
    yield f"{versions}, one thread.\n"
    yield "## Error, honesty and alarms\n"
    yield f"{options.runs} runs of {options.frames} frames. Error: root mean square distance between true and"
    yield f"estimated projections over the scene, px, after the first {SETTLE} frames; the worst frame of"
    yield "all; the last frame. NEES: squared error over what the covariance says, per parameter (1 is"
    yield "honest); in how many frames the mean of the runs lies in its 95 % bounds. rls and batch know of"
    yield "no motion: alarms in a sequence that moves are their right answer. Of `knock`, those before it.\n"
    header = ["sequence", "method", "error", "worst", "last", "NEES", "in bounds", "alarms", "knock seen"]
    yield from table(header, accuracy(options.runs, options.frames))
    yield "\n## Alarms\n"
    threshold = cusum_threshold(5e-7)
    times = [mean_time_to_alarm(threshold, shift) for shift in (0.0, 1.0, 2.0)]
    yield f"The threshold of the cumulative sum for half of a rate of 1e-6 is {threshold:.3f}. In theory its"
    yield f"mean time to an alarm is then {times[0]:.3g} frames while nothing moves, {times[1]:.1f} where the"
    yield f"scores shift by 1, {times[2]:.1f} where they shift by 2.\n"
    yield from table(["method", "what", "rate", "found"], alarms(options.runs))
    yield "\n## Strong noise\n"
    yield "NEES per parameter of a standing camera after 150 frames of 30 points, by the noise of a point.\n"
    yield from table(["noise (px)", "rls, gain mean", "kalman", "iekf"], strong_noise(options.runs))
    yield "\n## Speed\n"
    yield "Frames of 50 points a second of processor time.\n"
    yield from table(["method", "frames/s", "to reach"], speed())
    yield "\n## Long runs\n"
    yield "Resident memory (MB) at a tenth of the run and at its end; the relative change of the size of the"
    yield "covariance factor between the two; the error of the last frame (px).\n"
    header = ["method", "frames", "MB at 1/10", "MB at the end", "change of the factor", "error"]
    yield from table(header, (long_run(m, options.long) for m in ("rls", "kalman")))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])  # type: ignore[union-attr]
    parser.add_argument("--runs", type=int, default=8)
    parser.add_argument("--frames", type=int, default=200)
    parser.add_argument("--long", type=int, default=100_000)
    parser.add_argument("--write", type=Path)
    options = parser.parse_args()
    lines = []
    for line in page(options):
        print(line, flush=True)
        lines.append(line)
    if options.write is not None:
        options.write.write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
