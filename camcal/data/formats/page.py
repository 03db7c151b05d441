"""Generator of docs/formats.md: `python -m camcal.data.formats.page > docs/formats.md`."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from camcal.data.formats import SUFFIXES, SUMMARIES, files
from camcal.data.formats.base import CameraFile, Format, NamedCamera
from camcal.data.formats.files import EXACT
from camcal.data.formats.gaps import gap
from camcal.data.formats.source import Source
from camcal.data.formats.terms import room
from camcal.errors import CamcalError
from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.model.lenses.conversion import convert
from camcal.model.pose import Pose

INTRODUCTION = """\
# Camera files

This page is generated from the table of formats: `python -m camcal.data.formats.page > docs/formats.md`.

Every command that takes a camera takes any of these files; the format is recognised from the content. A model is
read from its name in the file; an unknown name is an error. `camcal convert SRC DST` writes them: the extension of DST
determines the format where it is unique, `--to FORMAT` otherwise. The main jobs write them too: `--save-camera FILE`
(or `--save-camera kalibr:FILE`, repeatable) together with the report, or `-o cam.yml` instead of it.

    camcal convert report.yaml cam.yml                       # OpenCV
    camcal convert camera_info.yaml cameras.txt --to colmap
    camcal convert camchain.yaml left.yml --camera cam0
    camcal convert camchain.yaml '{camera}.yaml' --to ros    # one file for each camera
    camcal compare camera_info.yaml report.yaml --max-px 0.5
    camcal undistort -c 'camchain.yaml#cam1' pictures/ -o out/

From Python: `camcal.load(path)` gives the calibration, camera or rig of any of these files, and
`camcal.save_camera(camera, path, to="kalibr")` writes one.

The output is read back before it is saved, and the largest difference over the image is printed. A term that a
format cannot represent (k3 in Kalibr, a skew in ROS) is an error that names it, and nothing is written.
`--to-model NAME` finds the closest camera of a model that the format has; the largest difference over the image is
printed, and nothing is written where it exceeds `--max-px` (0.5 px unless given). A model of another program
without a counterpart in camcal is an error that names it; it can be read with `--to-model`.

If a file has no image size, give `--image-size`, in every command that has the option; files
whose lengths are relative to the image (RealityCapture, Blender's own presets) cannot be read without it, those of
LensFun are assumed to have 6000 px.

Nothing in a file is executed: MATLAB scripts are read line by line, mrcal's literals as data, YAML by the safe loader
without nested aliases, XML without internal entities.
"""


#: lenses whose refit is measured, by their first example camera, and the models that formats have
SOURCES = (
    "opencv5",
    "opencv8",
    "opencv12",
    "brown:radial=4,decentering=3,prism=1",
    "kb4",
    "mei",
    "ds",
    "division:3",
)
TARGETS = (
    "brown:radial=1,decentering=0",
    "opencv4",
    "opencv5",
    "opencv8",
    "kb4",
    "eucm",
    "ds",
    "mei",
    "division:1",
)
#: px; what is stated as a round trip's error is no less: the rounding of 1e3 px
LEAST = 1e-13
MARK = "<!-- refits -->"
#: what the benchmarks of these names printed; an installed package has no docs, and no page to make
FIGURES = Path(__file__).resolve().parents[3] / "docs" / "figures"

OWNERS = """\
## Tests with the original programs

Files that camcal writes are read by the original program, and cameras that it writes or defines are read by camcal;
both project the same points within 1e-6 px. Installed programs are run by `pytest -m slow` of
`tests/data/formats/test_owners.py` and `tests/data/test_remap_owners.py`; `CAMCAL_OWNERS` and `CAMCAL_CV2` are Python
interpreters with the others. Last run with all of them on 2026-11-29:

| program | version | what was tested |
|---|---|---|
| OpenCV | 4.10.0, 4.12.0, 4.14.0, 5.0.0, 5.1.0 | YAML, XML, JSON of pinhole, opencv4 to 14, fisheye; stereo pairs |
| pycolmap | 4.2.1 | cameras.txt and .bin of nine models; rigs.txt; the two models that are refitted |
| mrcal | 2.2 (Debian) | five lens models with a pose; CAHVOR, stereographic, latlon, lonlat, splined (refitted) |
| aniposelib | 0.8.0 | a rig of two cameras |
| GNU Octave | 7.3.0 | Calib_Results.m run as a script, .mat read; .mat of versions 6 and 7 written by it |
| scipy.io | 1.17.1 | .mat |
| OpenUSD (usd-core) | 26.11 | a camera with OpenCV's lens |
| ffmpeg | 5.1 | `undistort --maps m.pgm`: remap gives the same pixels |
| OpenEXR | 3.5.3 | `undistort --maps m.exr` |
| GStreamer | 1.22 | `undistort --maps cam.gst`: cameraundistort |

ROS, Kalibr, Metashape and the others do not install from pip or apt here: their files are checked against the
documented formulas (`tests/data/formats`). mrcal 2.5.2 comes for Python 3.12 and later, and was not run: its
new name of the pose (`rt_cam_ref`) is taken from its source.
"""

FUZZED = """\
## Damaged files

Copies of a file of each format with bytes, numbers and parts changed, removed, repeated or inserted; each is read with
automatic recognition, and as a file of its format. *refused*: an error of one line that names the file; *read*: a
camera whose numbers are finite and within their bounds. Nothing in a file is executed. Measured with seeds by
`python -m benchmarks.damaged_files > docs/figures/damaged-files.txt`; the tests take 300 files of each class,
`pytest -m slow` 10,000.

"""


CONVERSIONS = """\
## Errors of conversions

Each format with a camera of each lens model: *exact* (it reads back within the error above), or the largest
difference over the picture, px, to the closest camera that the format can represent, by the best of its models with
`--to-model`; without that option such a camera is an error that names the term or the model. *-*: no model of the
format reaches the whole picture. Formats with one focal length are refitted with fx = fy. Measured by
`python -m benchmarks.conversions > docs/figures/conversions.txt`.

"""
REFITS = """\
## Errors of refits

The largest difference over the picture, px, between a camera and the closest one of another model, as `--to-model`
finds and prints it: the first example camera of each lens model (`opencv5` a webcam of 640x480, `kb4` a lens of 150
degrees). *-*: the model does not reach the whole picture.

"""


def page(refits: str) -> str:
    """The text of the page; `refits` is the result of `refit_table`, which takes a minute to measure."""
    forms = list(files.formats())
    parts = [INTRODUCTION, _overview(forms), CONVERSIONS + _figure("conversions")]
    parts.append(REFITS + f"{MARK}\n{refits}{MARK}\n")
    parts += [OWNERS, FUZZED + _figure("damaged-files")]
    parts += [_section(form) for form in forms]
    return "\n".join(parts)


def _figure(name: str) -> str:
    """A table measured by benchmarks/NAME.py, with dashes in place of the underscores of NAME."""
    return (FIGURES / f"{name}.txt").read_text(encoding="utf-8")


def _overview(forms: list[Format]) -> str:
    lines = [
        "## All formats\n",
        "*error*: the largest difference over the image, px, between a camera and what reads back after it was",
        "written, over all lens models that the format holds, rounded up to a power of ten. *cameras*: whether a",
        "file holds several, and their poses. An ending in bold",
        "says the format of what is written.\n",
        "| `--to` | what | endings | writes | cameras | first pixel | error, px |",
        "|---|---|---|---|---|---|---|",
    ]
    for form in forms:
        endings = " ".join(f"**`{e}`**" if SUFFIXES.get(e) == form.name else f"`{e}`" for e in form.endings)
        cameras = ("many" if form.several else "one") + (", poses" if form.poses else "")
        writes = "yes" if form.write is not None or form.name == "camcal" else "no"
        error = "0" if form.name == "camcal" else f"{_error(form):.0e}"
        cells = [f"`{form.name}`", SUMMARIES[form.name], endings, writes, cameras, form.centre, error]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def _error(form: Format) -> float:
    """The largest error of a round trip over the example cameras of the format's models, px."""
    worst = 0.0
    for text in form.models:
        place = room(text)
        lens = lenses.make(place.spec, place.skew)
        for params, size in lens.examples():
            values = np.array(params, float)
            if place.square:
                values[1] = values[0]
            worst = max(worst, _round_trip(form, Camera(lens, values, size)))
    # rounding differs between machines: only the order of magnitude is shown
    return 10.0 ** np.ceil(np.log10(max(worst, LEAST)))


def _round_trip(form: Format, camera: Camera) -> float:
    pose = Pose(np.eye(3), np.array([0.0, 0.0, 10.0]))  # the DLT is nothing without one
    cameras = CameraFile((NamedCamera("camera", camera, pose),))
    try:
        written = files.rendered(form, cameras, Path(f"camera{form.endings[0]}"))
    except CamcalError:
        return 0.0
    data = written.content.encode() if isinstance(written.content, str) else written.content
    source = Source(Path(f"camera{form.endings[0]}"), data)
    return gap(cameras, files.parsed(form, source)).max_px


def _section(form: Format) -> str:
    summary = SUMMARIES[form.name]
    lines = [
        f"## {form.name}\n",
        f"{summary[0].upper()}{summary[1:]}. Source: {form.source}.\n",
    ]
    if form.models:
        shown = [_model(text) for text in form.models]
        lines.append(f"- Lens models: {', '.join(shown)}.")
    lines.append(f"- Order: {form.order}.")
    lines += [f"- {trap}" for trap in form.traps]
    if not form.size:
        lines.append("- Give `--image-size` when reading it: the file does not say it.")
    return "\n".join(lines) + "\n"


def _model(text: str) -> str:
    spec, *more = text.split("+")
    words = {"skew": "with skew", "square": "fx = fy"}
    return f"`{spec}`" + (f" ({', '.join(words[m] for m in more)})" if more else "")


def refit_table() -> str:
    """The largest error of the closest camera of each model, px, over the picture of the example cameras."""
    lines = ["| camera | " + " | ".join(f"`{t}`" for t in TARGETS) + " |", "|---" * (len(TARGETS) + 1) + "|"]
    for spec in SOURCES:
        lens = lenses.make(spec)
        params, size = lens.examples()[0]
        camera = Camera(lens, np.array(params, float), size)
        cells = [_refit(camera, target) for target in TARGETS]
        lines.append(f"| `{spec}`, {size[0]}x{size[1]} | " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def _refit(camera: Camera, target: str) -> str:
    worst = convert(camera, lenses.make(target)).max_px
    if worst < EXACT:
        return "exact"
    return f"{worst:.2g}" if np.isfinite(worst) else "-"


if __name__ == "__main__":
    print(page(refit_table()), end="")
