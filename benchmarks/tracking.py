"""Accuracy, consistency, alarms and speed of `camcal track`, compared with estimates from single frames and with cv2.

    python benchmarks/tracking.py [--only accuracy,speed,...] [--runs 20] [--long 1000000]
                                  [--write docs/tracking-results.md]

Sequences are simulated (camcal.track.simulate): 50 points in a cube of side 2 at distance 5, a focal
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
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from scipy.stats import chi2, ncx2
from tables import update
from tracking_common import Pair, estimator, method_errors, nees, run, state_errors, table
from tracking_speed import drift, speed, through_a_pipe

from camcal.track import ESTIMATORS, SEQUENCES
from camcal.track.detection import ChangeTest, mean_time_to_alarm, normal_deviate
from camcal.track.simulate import Scene, simulate

Array = np.ndarray
#: an estimator, its states, and the stream they come from
Tracked = tuple[object, list, list[Pair]]

#: the frames before the end that stand for a settled estimate, and those after the start and the knock
LATE, EARLY = 50, 10
FALSE_ALARM = 1e-6


# ------------------------------------------------------------------------------------------ accuracy
def accuracy(runs: int, count: int) -> Iterator[list[str]]:
    """A row for each sequence and method."""
    for kind in SEQUENCES:
        scene = Scene(outliers=0.05, knock=count // 2)
        streams = [list(simulate(kind, count, seed, scene)) for seed in range(runs)]
        for method in (*ESTIMATORS, "cv2", "cv2 without outliers"):
            if method.startswith("cv2"):
                errors = [method_errors(method, kind, pairs) for pairs in streams[: max(runs // 4, 1)]]
                consistency = [""] * 4
            else:
                tracked = [_tracked(method, kind, pairs) for pairs in streams]
                errors = [state_errors(*one) for one in tracked]
                consistency = _consistency(tracked, count // 2 if kind == "knock" else None)
            yield [kind, method, *_over_time(np.array(errors), count // 2), *consistency]


def _tracked(method: str, kind: str, pairs: list[Pair]) -> Tracked:
    made = estimator(method, kind)
    return made, run(made, pairs), pairs


def _over_time(errors: Array, half: int) -> list[str]:
    """Root mean squares over stretches of frames, and the worst frame of all."""
    parts = (slice(0, EARLY), slice(half - LATE, half), slice(half, half + EARLY), slice(-LATE, None))
    means = [float(np.sqrt(np.mean(errors[:, part] ** 2))) for part in parts]
    return [*(_short(x) for x in means), _short(float(errors.max()))]


def _short(x: float) -> str:
    return f"{x:.3f}" if x < 10 else f"{x:,.0f}"


def _consistency(tracked: list[Tracked], knock: int | None) -> list[str]:
    normal, alarms, delays = [], 0, []
    for made, states, pairs in tracked:
        normal.append([nees(made, s, t) for s, (_, t) in zip(states, pairs, strict=True)])
        changed = [s.frame for s in states if s.changed]
        if knock is not None:
            delays += [f - knock for f in changed if f >= knock][:1]
            changed = [f for f in changed if f < knock]
        alarms += len(changed)
    size, n = made.model.size, len(tracked)  # type: ignore[attr-defined]
    low, high = chi2.ppf([0.025, 0.975], n * size) / n
    mean = np.mean(normal, 0)
    inside = np.mean((mean >= low) & (mean <= high))
    seen = f"{len(delays)} of {n}, delay {max(delays, default=0)}" if knock is not None else ""
    return [f"{np.mean(mean) / size:.2f}", f"{100 * inside:.0f} %", str(alarms), seen]


# ------------------------------------------------------------------------------------------ alarms
def false_alarms(runs: int) -> Iterator[list[str]]:
    """False alarms of a standing camera, at a rate that can be counted."""
    count = 400
    for rate in (0.02, 0.005):
        for method in ("rls", "kalman", "iekf"):
            found = frames = 0
            for seed in range(2 * runs):
                pairs = list(simulate("static", count, 1000 + seed, Scene(outliers=0.05)))
                found += sum(s.changed for s in run(estimator(method, "static", false_alarm=rate), pairs))
                frames += count
            yield [method, f"{rate:g}", f"{frames:,}", str(found), f"{found / frames:.4f}"]


def delays(runs: int) -> Iterator[list[str]]:
    """Frames from a knock to its alarm at the default rate, beside what theory expects."""
    for angle in (0.3, 0.1, 0.03, 0.015, 0.01, 0.005):
        found, expected = [], []
        for seed in range(runs):
            pairs = list(simulate("knock", 300, seed, Scene(outliers=0.05, knock=100, angle=angle)))
            made = estimator("kalman", "knock", false_alarm=FALSE_ALARM)
            states = run(made, pairs)
            expected.append(_expected_delay(states[99], made, pairs))
            after = [s.frame - 100 for s in states if s.changed and s.frame >= 100]
            found.append(after[0] if after else np.inf)
        pixels = 900 * np.deg2rad(angle)
        shown = [f"{np.mean(expected):.1f}"]
        shown += [f"{x:g}" if np.isfinite(x) else "not seen" for x in (np.median(found), max(found))]
        yield [f"{angle:g} deg", f"{pixels:.2f}", f"{np.isfinite(found).sum()} of {runs}", *shown]


def _expected_delay(before: object, made: object, pairs: list[Pair]) -> float:
    """The mean delay of the two tests for a filter that does not follow the change.

    The knock's noncentrality is that of the frame's own equations at the estimate before it; of the
    single-frame test's and the sum's mean times to an alarm the shorter one counts.
    """
    model, state = made.model, before  # type: ignore[attr-defined]
    frame, truth = pairs[100]
    good = truth.good
    design, _ = model.linearise(state.estimate, frame)  # type: ignore[attr-defined]
    j = (design[:-1][:, :, good] / 0.3).reshape(model.size, -1)
    step = model.from_matrix(truth.matrix) - model.from_matrix(pairs[99][1].matrix)
    information = j @ j.T
    spread = state.factor.T @ information @ state.factor  # type: ignore[attr-defined]
    reduced = 1 + np.trace(spread) / model.size
    noncentrality = float(step @ information @ step) / reduced
    nis = ncx2.rvs(model.size, noncentrality, size=1000, random_state=0)
    scores = np.array([normal_deviate(x, model.size, np.inf) for x in nis])
    test = ChangeTest(FALSE_ALARM)
    at_once = float(np.mean(scores > test.limit))
    single = 1 / at_once if at_once else np.inf
    return min(single, mean_time_to_alarm(test.threshold, float(scores.mean()))) - 1


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


# ------------------------------------------------------------------------------------------ the page
def tables(options: argparse.Namespace) -> dict[str, Callable[[], Iterator[str]]]:
    """What fills the places of docs/tracking-results.md, by name."""
    runs, count, long = options.runs, options.frames, options.long
    half = count // 2
    stretches = [(0, EARLY), (half - LATE, half), (half, half + EARLY), (count - LATE, count)]
    spans = [f"{a} to {b - 1}" for a, b in stretches]
    consistency = ["worst", "NEES", "in bounds", "alarms", "knock seen"]
    stream = ["method", "frames", "MB at 1/100", "MB at 1/10", "MB at the end", "frames/s", "error (px)"]
    apart = ["method", "frames", "change", "apart, sigmas", "apart, factor", "error (px)", "NEES"]
    seen = ["knock", "px", "seen", "expected delay", "median delay", "longest"]
    rates = ["method", "rate stated", "frames", "alarms", "rate found"]
    cases = (("rls", None), ("rls", "mean"), ("kalman", None))
    return {
        "accuracy": lambda: table(["sequence", "method", *spans, *consistency], accuracy(runs, count)),
        "false-alarms": lambda: table(rates, false_alarms(runs)),
        "delays": lambda: table(seen, delays(runs)),
        "noise": lambda: table(["noise (px)", "rls, gain mean", "kalman", "iekf"], strong_noise(runs)),
        "speed": lambda: table(["method", "frames/s", "to reach"], speed()),
        "drift": lambda: table(apart, (drift(m, gain, long) for m, gain in cases)),
        "pipe": lambda: table(stream, (through_a_pipe(m, long) for m in ("rls", "kalman"))),
    }


def main() -> None:
    """Print the tables, and put them into the page where asked."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--frames", type=int, default=200)
    parser.add_argument("--long", type=int, default=1_000_000)
    parser.add_argument("--only", help="Names of tables, with commas.")
    parser.add_argument("--write", type=Path, metavar="PAGE")
    options = parser.parse_args()
    made = tables(options)
    for name in options.only.split(",") if options.only else made:
        lines = []
        for line in made[name]():
            print(line, flush=True)
            lines.append(line)
        print()
        if options.write is not None:
            update(options.write, name, "\n".join(lines))


if __name__ == "__main__":
    main()
