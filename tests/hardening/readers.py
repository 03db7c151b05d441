"""Every reader of files, generated from the tables of the project: one that is added to a table is covered.

What has no table of its own (one kind of file, one reader) is listed here.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from camcal.data.formats import FORMATS
from tests.data.corner_samples import samples


@dataclass(frozen=True)
class Subject:
    """A reader: the endings of its files, inputs that it reads (of tests/hardening/inputs.py), the call itself."""

    name: str
    endings: tuple[str, ...]
    seeds: tuple[str, ...]
    read: Callable[[Path], Any]


def _format(name: str) -> Callable[[Path], Any]:
    from camcal.data.formats import files

    def read(path: Path) -> Any:
        files.read(path)
        return files.read(path, name)

    return read


def _points(path: Path) -> Any:
    from camcal.data.points import read_points

    return read_points(path, board=(3, 2))


def _pair(path: Path) -> Any:
    from camcal.data.points import read_points

    return read_points(points3d=path.with_name("p3.csv"), points2d=path)


def _report(path: Path) -> Any:
    from camcal.report.loading import load

    return load(path)


def _report_of_a_rig(path: Path) -> Any:
    from camcal.report.rig_loading import load_rig

    return load_rig(path)


def _anything(path: Path) -> Any:
    from camcal.report.opening import load

    return load(path)


def _side(path: Path) -> Any:
    from camcal.report import comparison

    return comparison.load_rig_side(path) or comparison.load_side(path)


def _board(path: Path) -> Any:
    """The shape of a board that another report found, put under points."""
    from camcal.data.points import read_points
    from camcal.report.board import on_known_board

    return on_known_board(read_points(path.with_name("p.csv")), str(path))


def _rig(path: Path) -> Any:
    from camcal.data.rig_table import read_rig

    return read_rig(path)


def _lines(path: Path) -> Any:
    from camcal.routes.read_lines import read_lines

    return read_lines([path])


def _labelled(*columns: str) -> Callable[[Path], Any]:
    def read(path: Path) -> Any:
        from camcal.data.labelled import read_labelled

        return read_labelled(path, columns)

    return read


def _placed(path: Path) -> Any:
    from camcal.report.placed import load_placed

    return load_placed(path)


def _frames(path: Path) -> Any:
    from camcal.track.stream import FrameReader

    with path.open("rb") as stream:
        return list(FrameReader(stream, str(path)))


def _checkpoint(path: Path) -> Any:
    """The whole of what `camcal track --state` does with a state, whose checksum is right."""
    from camcal.track import checkpoint

    head, _, body = path.read_bytes().partition(b"\n")
    text = body.decode("utf-8", "replace").removesuffix("\n")
    try:
        found = json.loads(head)
        found["sha256"] = checkpoint._digest(text)
        path.write_text(json.dumps(found) + "\n" + text + "\n")
    except (ValueError, TypeError):
        pass
    return _follow(path)


def _follow(state: Path) -> Any:
    from camcal.registry import look_up
    from camcal.settings.tracking import TrackOptions
    from camcal.track import ESTIMATORS
    from camcal.track.follow import Follower
    from camcal.track.output import Output
    from camcal.track.stream import FrameReader
    from camcal.track.table import Table

    estimator = look_up(ESTIMATORS, "kalman", "method")(TrackOptions())
    output = Output(Table(estimator.model, False), "csv", state.with_name("t.csv"), growing=True)
    follower = Follower(estimator, output, state_file=state, every=5)
    try:
        follower.resume()
        with state.with_name("f.csv").open("rb") as stream:
            return follower.run(FrameReader(stream, "f.csv"))
    finally:
        output.discard()


def make_state(folder: Path) -> None:
    """A state and the table that belongs to it."""
    _follow(folder / "state")


def _robot(path: Path) -> Any:
    from camcal.data.robot_poses import read_robot_poses

    return read_robot_poses(path)


def _config(path: Path) -> Any:
    from camcal.settings.config import load_config, values_for

    return values_for("estimate", load_config(path))


def _jobs(path: Path) -> Any:
    from camcal.batch.jobs import read_jobs

    return read_jobs(str(path))


def _april(path: Path) -> Any:
    from camcal.detect.targets.aprilgrid import read_kalibr

    return read_kalibr(path)


def _picture(path: Path) -> Any:
    from camcal.detect.sources import read_gray

    return read_gray(path)


def _cache(path: Path) -> Any:
    from camcal.detect.cache import load

    return load(path)


PICTURES = (".png", ".jpg", ".tif", ".bmp", ".pgm", ".webp", ".jp2", ".exr", ".hdr", ".ras", ".gif", ".avif")


#: a file of each reader of points of other programs, which inputs.py makes
POINT_SEEDS = {
    "vnl": "points.vnl",
    "orpc": "corners.orpc",
    "tartan": "corners.mat",
    "tartan-dataset": "corners.bin",
    "calibio": "calibio.json",
    "photonvision": "photonvision.json",
    "opencv": "sample.yml",
    "gcp": "gcp_list.txt",
    "photomodeler": "photomodeler.txt",
}


def subjects() -> list[Subject]:
    """All readers."""
    made = [Subject(f"format {n}", (), (f"format-{n}",), _format(n)) for n in FORMATS]
    for name, (file, _, _) in samples().items():
        made.append(Subject(f"points {name}", (Path(file).suffix,), (f"of-{name}/{file}",), _points))
    made += [
        Subject("points table", (".csv", ".txt"), ("p.csv",), _points),
        Subject("points archive", (".npz",), ("points.npz",), _points),
        Subject("points pair", (".csv",), ("p2.csv",), _pair),
        Subject("report", (".yaml",), ("r.yaml",), _report),
        Subject("report of a rig", (".yaml",), ("rig.yaml",), _report_of_a_rig),
        Subject("anything with a camera", (".yaml",), ("r.yaml", "rig.yaml", "h.yaml"), _anything),
        Subject("a camera to compare", (".yaml",), ("r.yaml", "rig.yaml"), _side),
        Subject("board of a report", (".yaml",), ("r.yaml",), _board),
        Subject("rig table", (".csv",), ("rig.csv",), _rig),
        Subject("lines", (".csv",), ("lines.csv", "room.csv"), _lines),
        Subject("tracks", (".csv",), ("tracks.csv",), _labelled("view", "point")),
        Subject("points of cameras", (".csv",), ("points2d.csv",), _labelled("camera", "point")),
        Subject("placed cameras", (".csv", ".yaml"), ("dlt.csv", "rig.yaml"), _placed),
        Subject("poses of a robot", (".csv",), ("poses.csv",), _robot),
        Subject("frames", (".csv",), ("f.csv",), _frames),
        Subject("checkpoint", ("",), ("state",), _checkpoint),
        Subject("configuration", (".yaml",), ("camcal.yml",), _config),
        Subject("jobs", (".yaml",), ("jobs.yaml",), _jobs),
        Subject("Kalibr's target", (".yaml",), ("april.yaml",), _april),
        Subject("cache entry", (".npz",), ("points.npz",), _cache),
    ]
    made += [Subject(f"picture {e}", (e,), (f"picture{e}",), _picture) for e in PICTURES]
    return made
