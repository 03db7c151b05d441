"""--reproducible: the same bytes on one thread or two and in any order of the files; nothing else changes."""

import csv
import os
import subprocess
import sys
from pathlib import Path

import click
import numpy as np
import yaml

from camcal.cli.job import in_order
from camcal.detect.workers import Workers
from camcal.plan.images import calibrate_images
from camcal.report.reproducible import without_times

SAMPLES = Path(__file__).resolve().parents[2] / "sample_data"


def run(folder, threads, *args):
    folder.mkdir()
    subprocess.run(
        [sys.executable, "-m", "camcal", "-q", *args, "--reproducible", "-o", "r.yaml"],
        cwd=folder,
        env={**os.environ, "OPENBLAS_NUM_THREADS": threads, "PYTHONHASHSEED": threads},
        stdout=subprocess.DEVNULL,
        check=True,
    )
    return (folder / "r.yaml").read_bytes()


def test_tables_in_any_order(camcal):
    assert camcal("simulate", "points", "--views", "6", "-o", "p.csv")[0] == 0
    with Path("p.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    names = []
    for view in dict.fromkeys(r["view"] for r in rows):
        names.append(f"{len(names):02d}.csv")
        with Path(names[-1]).open("w", newline="") as stream:
            writer = csv.DictWriter(stream, rows[0])
            writer.writeheader()
            writer.writerows(r for r in rows if r["view"] == view)
    size = ("--image-size", "1280x960")
    paths = [str(Path(n).absolute()) for n in names]
    first = run(Path("a"), "1", "estimate", *paths, *size)
    assert first == run(Path("b"), "2", "estimate", *reversed(paths), *size)
    report = yaml.safe_load(first)
    assert report["fit"]["seconds"] is None and report["fit"]["rms_point"] > 0
    assert [f["path"] for f in report["inputs"]["files"]] == paths
    assert report["command"][2 : 2 + len(paths)] == paths


def test_options_keep_their_seconds():
    assert without_times({"seconds": 1, "options": {"seconds": {"value": 2}}, "a": [{"seconds": 3}]}) == {
        "seconds": None,
        "options": {"seconds": {"value": 2}},
        "a": [{"seconds": None}],
    }


def test_pictures_of_a_rig_in_any_order():
    """Those of each camera by their names; the first camera stays the reference."""
    ctx = click.Context(click.Command("rig"))
    given = ("right=c.jpg", "left=b10.jpg", "right=a.jpg", "left=b9.jpg")
    wanted = ("right=a.jpg", "right=c.jpg", "left=b9.jpg", "left=b10.jpg")
    ctx.ensure_object(dict)["args"] = ["rig", *given, "-o", "r.yaml"]
    assert in_order(given, {"reproducible": True}, ctx) == wanted
    assert ctx.obj["args"] == ["rig", *wanted, "-o", "r.yaml"]
    assert in_order(given, {}, ctx) == given


def test_the_same_bits_from_one_process_and_two(monkeypatch):
    """Pictures that other processes search give the points, and so the camera, to the last bit."""
    monkeypatch.setattr(Workers, "_worth_others", lambda self, left: self._open and self.jobs > 1)
    pooled = []
    in_pool = Workers._in_pool
    monkeypatch.setattr(Workers, "_in_pool", lambda *args: pooled.append(args[1].__name__) or in_pool(*args))
    found = [calibrate_images(SAMPLES / "board", board="9x6", jobs=jobs, cache=False) for jobs in (1, 2)]
    assert {"examine", "_refined"} <= set(pooled)
    one, two = found
    for name in ("uv", "sigma", "xyz", "used"):
        np.testing.assert_array_equal(getattr(one.observations, name), getattr(two.observations, name))
    np.testing.assert_array_equal(one.camera.params, two.camera.params)
    np.testing.assert_array_equal(one.poses.rotations, two.poses.rotations)
    assert repr(one.holdout) == repr(two.holdout)  # with the NaN of its map
    assert one.warnings == two.warnings
