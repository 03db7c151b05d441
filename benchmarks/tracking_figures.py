"""The figures of docs/tracking.md.

    python benchmarks/tracking_figures.py [--folder docs/figures]

Needs matplotlib. Writes tracking-error.svg (error over time of each method and sequence), tracking-nees.svg
(consistency of the filters), tracking-paper.svg (the experiment of Barranco & Medel as a stream).
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from scipy.stats import chi2
from tracking_common import estimator, method_errors, nees, run

from camcal.data.points import read_points
from camcal.geometry import projective, rotations
from camcal.report.yaml import read_document
from camcal.track.frames import Frame
from camcal.track.simulate import SEQUENCES, Scene, simulate
from camcal.track.table import MATRIX, PARAMETERS, Table

Array = np.ndarray

SAMPLE = Path(__file__).resolve().parent.parent / "sample_data"
#: Okabe and Ito's colours; the lines that lie on each other are dashed in turn
LINES = {
    "cv2 without outliers": ("#D55E00", "-"), "batch": ("#999999", "-"), "rls": ("#E69F00", "-"),
    "window": ("#CC79A7", "-"), "kalman": ("#0072B2", "--"), "iekf": ("#000000", ":"),
    "smoother": ("#009E73", "-"),
}  # fmt: skip
TICKS = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0)


def errors(count: int = 200, runs: int = 4) -> Figure:
    """Error over time, root mean square over the runs."""
    figure = Figure(figsize=(8.5, 11), layout="constrained")
    axes = figure.subplots(len(SEQUENCES), 1, sharex=True, sharey=True)
    for axis, kind in zip(axes, SEQUENCES, strict=True):
        scene = Scene(outliers=0.05, knock=count // 2)
        streams = [list(simulate(kind, count, 100 + seed, scene)) for seed in range(runs)]
        for method, (colour, line) in LINES.items():
            values = np.array([method_errors(method, kind, pairs) for pairs in streams])
            shown = np.sqrt((values**2).mean(0))
            axis.semilogy(shown, color=colour, ls=line, lw=1.0, label=method)
        axis.set_ylim(0.01, 1)
        axis.set_yticks(TICKS, [f"{x:g}" for x in TICKS])
        axis.minorticks_off()
        axis.set_ylabel("error (px)")
        axis.set_title(kind, fontsize=9, loc="left")
        axis.grid(alpha=0.3)
    figure.legend(*axes[0].get_legend_handles_labels(), ncols=4, fontsize=8, loc="outside upper center")
    axes[-1].set_xlabel("frame")
    return figure


def consistency(count: int = 150, runs: int = 20) -> Figure:
    """NEES per parameter, mean over the runs, with its 95 % bounds."""
    figure = Figure(figsize=(8.5, 4.5), layout="constrained")
    kinds = [k for k in SEQUENCES if k != "knock"]
    axes = figure.subplots(2, 2, sharex=True, sharey=True).ravel()
    for axis, kind in zip(axes, kinds, strict=True):
        for method, line in (("kalman", "-"), ("iekf", "--")):
            values = []
            for seed in range(runs):
                pairs = list(simulate(kind, count, seed, Scene(outliers=0.05)))
                made = estimator(method, kind)
                values.append([nees(made, s, t) for s, (_, t) in zip(run(made, pairs), pairs, strict=True)])
            size = made.model.size  # type: ignore[attr-defined]
            axis.plot(np.mean(values, 0) / size, color=LINES[method][0], ls=line, lw=0.9, label=method)
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


def paper(count: int = 3000, noise: float = 0.3, runs: int = 20) -> Figure:
    """The entries of M beside those of its estimate, as the paper's figure 2, and the way there."""
    figure = Figure(figsize=(9, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    place, names = np.arange(12), [f"m{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3, 4)]
    frames, matrix = paper_stream(count, noise, 0)
    wanted = matrix / matrix[2, 3]
    size = np.linalg.norm(wanted)
    left.bar(place - 0.3, np.abs(wanted.ravel()), 0.3, color="black", label="M")
    passed = np.arange(1, count + 1)
    for shift, method, gain in ((0.0, "batch", None), (0.3, "rls", "mean")):
        colour = LINES[method][0]
        own = "batch: one frame" if method == "batch" else "rls, gain mean: all frames so far"
        found, stated = _paper_track(method, gain, frames)
        left.bar(place + shift, np.abs(found[-1].ravel()), 0.3, color=colour, label=own)
        squares = ((found - wanted) ** 2).sum((1, 2))
        right.loglog(
            passed, np.sqrt(squares) / size, color=colour, lw=0.5, alpha=0.5, label=f"{own}, one run"
        )
        for seed in range(1, runs):
            squares = squares + (
                (_paper_track(method, gain, paper_stream(count, noise, seed)[0])[0] - wanted) ** 2
            ).sum((1, 2))
        right.loglog(
            passed, np.sqrt(squares / runs) / size, color=colour, lw=1.5, label=f"{own}, {runs} runs"
        )
    expected = stated / size * np.sqrt(count / passed)
    right.loglog(passed, expected, color="black", ls=":", lw=1.2, label="rls: as its covariance says")
    left.set_yscale("log")
    left.set_xticks(place, names, rotation=60, fontsize=7)
    left.set_ylabel("|entry|, m34 = 1")
    left.set_title(f"last of {count} frames; m21, m31, m32 of M are 0", fontsize=8)
    right.set_xlabel("frames")
    right.set_ylabel("|estimate - M| / |M|")
    right.set_ylim(1e-5, 0.5)
    left.set_ylim(1e-8, 1e7)
    left.legend(fontsize=7, loc="upper left")
    right.legend(fontsize=7, loc="upper right")
    return figure


def _paper_track(method: str, gain: str | None, frames: list[Frame]) -> tuple[Array, float]:
    """The estimates of M (F, 3, 4), m34 = 1, and the standard deviation of the last one's length."""
    made = estimator(method, "static", gain=gain)
    states = [made.update(f) for f in frames]  # type: ignore[attr-defined]
    cameras = made.model.describe([s.estimate for s in states], [s.factor for s in states])  # type: ignore
    table = Table(made.model)  # type: ignore[attr-defined]
    stated = table.values(states[-1:])[0, len(MATRIX) + len(PARAMETERS) :][: len(MATRIX)]
    return cameras.matrix / cameras.matrix[:, 2:, 3:], float(np.linalg.norm(stated))


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--folder", type=Path, default=Path("docs/figures"))
    folder = parser.parse_args().folder
    folder.mkdir(parents=True, exist_ok=True)
    for name, make in {"error": errors, "nees": consistency, "paper": paper}.items():
        make().savefig(folder / f"tracking-{name}.svg")


if __name__ == "__main__":
    main()
