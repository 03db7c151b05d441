"""The options for tracking a camera that changes with time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import Any

from camcal.records import dataclass
from camcal.settings.calibration import MODEL, CalibrationOptions
from camcal.settings.kinds import POSITIVE, Assignments, FilePath, Name, Real, Switch, Whole, Words
from camcal.settings.option import Option, Settings, setting
from camcal.settings.run import CONFIG, FILE, FORCE, OUT, OUTPUT

_setting = partial(setting, in_checkpoints=True)

#: a frame; of a camera at 30 frames a second one false alarm in nine hours
FALSE_ALARM = 1e-6


class CameraFile(FilePath):
    """The file that holds a camera; in Python the camera itself."""

    def convert(self, value: Any) -> Any:
        """Return the path, or the camera unchanged."""
        return value if hasattr(value, "lens") else super().convert(value)


@dataclass(frozen=True)
class TrackOptions(Settings):
    """How to track; each estimator uses the options that concern it and rejects those that contradict it."""

    gain: str | None = _setting(
        Name("gain", "camcal.track:GAINS"),
        "kalman, forgetting, fixed, mean or adaptive. [default: the method's own]",
    )
    forgetting: float = _setting(
        Real(0, 1, above=True),
        "Factor per frame by which old frames lose weight.",
        0.98,
        metavar="FACTOR",
    )
    alpha: float = _setting(Real(0, 1, above=True), "The fixed gain.", 0.1, metavar="FRACTION")
    motion: str = _setting(
        Name("motion", "camcal.track:MOTION_SUMMARIES"),
        "How the camera may move: fixed, thermal, zoom, pan, free.",
        "thermal",
    )
    drift: Mapping[str, float] = _setting(
        Assignments("GROUP=VALUE,...", "focal=1e-5,rotation=0.01", values=True),
        "Values that replace the motion's: focal, principal (px), rotation (deg), translation, ...",
        {},
    )
    velocity: bool = _setting(Switch(), "Constant velocity instead of a random walk.", False)
    sigma: float | None = _setting(
        POSITIVE,
        "Noise of the image points; a factor if they have sigmas. [default: estimated]",
        metavar="PX",
    )
    learn_noise: bool = _setting(Switch(), "Estimate a factor of the noise if points have sigmas.", False)
    gate: float = _setting(
        Real(0, 0.5, above=True),
        "Probability of rejecting a good point as an outlier.",
        1e-4,
        metavar="PROBABILITY",
    )
    false_alarm: float = _setting(
        Real(0, 0.1, above=True), "False alarms per frame of the change test.", FALSE_ALARM, metavar="RATE"
    )
    min_points: int | None = _setting(
        Whole(1, metavar="N"),
        "Least number of points; frames with fewer are only predicted. [default: what the method needs]",
    )
    rate: float = _setting(
        POSITIVE,
        "Frames per second that the drift refers to, if frames have times.",
        30.0,
        metavar="HZ",
    )
    model: str = _setting(
        MODEL,
        "Lens model of iekf, window and smoother; `camcal list models` names them.",
        "pinhole",
        short="-m",
    )
    skew: bool = _setting(Switch(), CalibrationOptions.options()["skew"].help, False)
    camera: Any = _setting(CameraFile(), "Calibration to start from, with its lens.")
    fix: Mapping[str, float | None] = _setting(
        Assignments(), CalibrationOptions.options()["fix"].help, {}, repeated=True
    )
    iterations: int = _setting(
        Whole(1, 100, metavar="N"), "Maximum number of relinearisations of a frame.", 4
    )
    window: int = _setting(Whole(2, 1000, metavar="FRAMES"), "Length of the sliding window.", 10)


METHOD = Option(
    "method",
    Name("method", "camcal.track:ESTIMATORS"),
    "Estimator; `camcal list estimators` names them. [default: iekf with --camera, else kalman]",
    in_checkpoints=True,
)

#: frames between checkpoints, where all of them can be read again and where they cannot
FROM_FILE, FROM_PIPE = 1000, 1

#: what concerns the run and not the estimator
RUN = (
    Option(
        "reorder",
        Whole(0, metavar="FRAMES"),
        "Delay by this many frames, to sort late ones.",
        0,
        in_checkpoints=True,
    ),
    Option(
        "rig",
        FILE,
        "Report of `camcal rig`: FRAMES are what its cameras see of a board, as for `camcal rig`; an alarm is raised "
        "if one was knocked.",
    ),
    Option(
        "natural",
        Switch(),
        "With --rig: FRAMES are pictures or films of arbitrary scenes, NAME=PICTURES, or a table "
        "view,camera,point,u,v of "
        "points that cameras share; no board is needed.",
        False,
    ),
    Option("fail_on_change", Switch(), "Exit code 1 if the camera has changed.", False),
    Option("state", OUT, "Checkpoint: written during the run; a run with an existing one continues from it."),
    Option(
        "state_every",
        Whole(1, metavar="FRAMES"),
        f"Frames between two checkpoints. [default: {FROM_PIPE} from a pipe, else {FROM_FILE}]",
    ),
    replace(OUTPUT, help="Write the table to FILE. [default: stdout]"),
    Option(
        "format",
        Words(("csv", "jsonl")),
        "Format of the table. [default: jsonl if FILE ends in .jsonl, else csv]",
        in_checkpoints=True,
    ),
    Option("covariance", Switch(), "Add the covariance of K, R, t to each row.", False, in_checkpoints=True),
    Option("report", OUT, "Write a summary (YAML) to FILE."),
    Option("plots", OUT, "Draw the table into FOLDER (needs matplotlib).", metavar="FOLDER"),
    Option(
        "reference",
        FILE,
        "Report whose projection_matrix the plots compare with. [default: the last estimate]",
    ),
    FORCE,
    CONFIG,
)
