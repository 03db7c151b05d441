"""The figures of docs/tracking.md.

    python benchmarks/tracking_figures.py [--folder docs/figures]

Needs matplotlib. Writes tracking-error.svg (error over time of each method and sequence), tracking-nees.svg
(honesty of the filters), tracking-paper.svg (the experiment of Barranco & Medel as a stream).
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from scipy.stats import chi2
from tracking import Pair, cv2_matrix, error, estimator, nees, run

from camcal.geometry import projective, rotations
from camcal.io.points import read_points
from camcal.report.yaml import read_document
from camcal.tracking.base import Frame
from camcal.tracking.simulate import SEQUENCES, Scene, simulate
from camcal.tracking.table import MATRIX, PARAMETERS, Table

Array = np.ndarray

SAMPLE = Path(__file__).resolve().parent.parent / "sample_data"
#: Okabe and Ito
COLOURS = {
    "batch": "#999999", "cv2": "#D55E00", "rls": "#E69F00", "kalman": "#0072B2", "iekf": "#56B4E9",
    "window": "#CC79A7", "smoother": "#009E73",
}  # fmt: skip


def errors(count: int = 200, runs: int = 4) -> Figure:
    """Error over time, root mean square over the runs."""
    figure = Figure(figsize=(8.5, 9.5), layout="constrained")
    axes = figure.subplots(len(SEQUENCES), 1, sharex=True, sharey=True)
    for axis, kind in zip(axes, SEQUENCES, strict=True):
        scene = Scene(outliers=0.05, knock=count // 2)
        streams = [list(simulate(kind, count, seed, scene)) for seed in range(runs)]
        for method, colour in COLOURS.items():
            values = np.array(
                [_errors(method, kind, pairs) for pairs in streams[: 1 if method == "cv2" else runs]]
            )
            label = "cv2 without outliers" if method == "cv2" else method
            axis.semilogy(np.sqrt((values**2).mean(0)), color=colour, lw=0.9, label=label)
        axis.set_ylabel(f"{kind}\nerror (px)")
        axis.grid(alpha=0.3)
    axes[0].legend(ncols=7, fontsize=7, loc="upper right")
    axes[-1].set_xlabel("frame")
    return figure


def _errors(method: str, kind: str, pairs: list[Pair]) -> list[float]:
    if method == "cv2":
        guess = pairs[0][1].k
        return [error(cv2_matrix(f, t.good, guess), t) for f, t in pairs]
    made = estimator(method, kind)
    states = run(made, pairs)
    matrices = made.model.describe([s.estimate for s in states], [s.factor for s in states]).matrix  # type: ignore
    return [error(m, t) for m, (_, t) in zip(matrices, pairs, strict=True)]


def honesty(count: int = 150, runs: int = 20) -> Figure:
    """NEES per parameter, mean over the runs, with its 95 % bounds."""
    figure = Figure(figsize=(8.5, 4.5), layout="constrained")
    kinds = [k for k in SEQUENCES if k != "knock"]
    axes = figure.subplots(2, 2, sharex=True, sharey=True).ravel()
    for axis, kind in zip(axes, kinds, strict=True):
        for method in ("kalman", "iekf"):
            values = []
            for seed in range(runs):
                pairs = list(simulate(kind, count, seed, Scene(outliers=0.05)))
                made = estimator(method, kind)
                values.append([nees(made, s, t) for s, (_, t) in zip(run(made, pairs), pairs, strict=True)])
            size = made.model.size  # type: ignore[attr-defined]
            axis.plot(np.mean(values, 0) / size, color=COLOURS[method], lw=0.9, label=method)
        low, high = chi2.ppf([0.025, 0.975], runs * size) / runs / size
        axis.axhspan(low, high, color="black", alpha=0.08)
        axis.set_title(kind, fontsize=9)
        axis.set_ylim(0, 2)
    axes[0].legend(fontsize=7)
    figure.supxlabel("frame", fontsize=9)
    figure.supylabel("NEES per parameter", fontsize=9)
    return figure


def paper_stream(count: int, noise: float, seed: int) -> tuple[list[Frame], Array]:
    """The paper's seven points, seen again and again with noise, and the matrix that they show."""
    view = read_points(str(SAMPLE / "barranco_medel.csv")).views[0]
    truth = read_document(SAMPLE / "barranco_medel.truth.yaml")
    pose = truth["views"][0]["cam_from_board"]
    rotation = rotations.exp(np.array(pose["rotation_vector"], float))
    matrix = projective.compose(np.array(truth["camera"]["matrix"]), rotation, np.array(pose["translation"]))
    rng = np.random.default_rng(seed)
    clean = projective.project(matrix, view.xyz)
    return [Frame(i, view.xyz, clean + rng.normal(0, noise, clean.shape)) for i in range(count)], matrix


def paper(count: int = 3000, noise: float = 0.3) -> Figure:
    """The entries of M beside those of its estimate, as the paper's figure 2, and the way there."""
    frames, matrix = paper_stream(count, noise, 0)
    wanted = matrix / matrix[2, 3]
    figure = Figure(figsize=(9, 3.8), layout="constrained")
    left, right = figure.subplots(1, 2)
    place, names = np.arange(12), [f"m{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3, 4)]
    left.bar(place - 0.3, np.abs(wanted.ravel()), 0.3, color="black", label="M")
    for shift, method, gain in ((0.0, "batch", None), (0.3, "rls", "mean")):
        made = estimator(method, "static", gain=gain)
        states = [made.update(f) for f in frames]  # type: ignore[attr-defined]
        cameras = made.model.describe([s.estimate for s in states], [s.factor for s in states])  # type: ignore
        found = cameras.matrix / cameras.matrix[:, 2:, 3:]
        label = "estimate, one frame" if method == "batch" else f"estimate, {count} frames"
        left.bar(place + shift, np.abs(found[-1].ravel()), 0.3, color=COLOURS[method], label=label)
        distance = np.linalg.norm(found - wanted, axis=(1, 2)) / np.linalg.norm(wanted)
        right.loglog(np.arange(1, count + 1), distance, color=COLOURS[method], lw=0.8, label=f"{method}")
    table = Table(made.model)  # type: ignore[attr-defined]
    stated = table.values(states[-1:])[0, len(MATRIX) + len(PARAMETERS) :][: len(MATRIX)]
    expected = np.linalg.norm(stated) / np.linalg.norm(wanted) * np.sqrt(count / np.arange(1, count + 1))
    right.loglog(np.arange(1, count + 1), expected, color="black", ls=":", lw=1, label="stated sigma of rls")
    left.set_yscale("log")
    left.set_xticks(place, names, rotation=60, fontsize=7)
    left.set_ylabel("|entry|, m34 = 1")
    left.legend(fontsize=7)
    right.set_xlabel("frames")
    right.set_ylabel("|estimate - M| / |M|")
    right.legend(fontsize=7)
    return figure


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--folder", type=Path, default=Path("docs/figures"))
    folder = parser.parse_args().folder
    folder.mkdir(parents=True, exist_ok=True)
    for name, make in {"error": errors, "nees": honesty, "paper": paper}.items():
        make().savefig(folder / f"tracking-{name}.svg")


if __name__ == "__main__":
    main()
