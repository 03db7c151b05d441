"""The options that `camcal batch` and `camcal watch` add to those of a calibration."""

from __future__ import annotations

from dataclasses import replace

from camcal.settings.kinds import POSITIVE, Switch, Text, Whole
from camcal.settings.option import Option
from camcal.settings.run import OUTPUT

_SWITCH = Switch()

#: of `camcal batch`
BATCH = (
    Option(
        "output",
        Text(),
        "Folder for the reports and the summary; also s3://..., gs://..., ssh://...",
        short="-o",
        required=True,
        metavar="OUT",
    ),
    Option("resume", _SWITCH, "Resume: finished jobs are kept, failed and changed ones are repeated.", False),
    Option(
        "scheduler",
        Text(),
        "A running Dask cluster, tcp://HOST:PORT, instead of local processes.",
        metavar="ADDRESS",
    ),
    Option("fail_on_outlier", _SWITCH, "Exit code 1 also if a camera is an outlier of its type.", False),
)
#: of a job: what its report holds
COMPACT = Option(
    "compact",
    _SWITCH,
    "Reports without views, points, maps and stages: the camera, its error figures and the verdict.",
    False,
)
FLEET_PRIOR = Option(
    "fleet_prior",
    _SWITCH,
    "Write OUT/fleet/NAME.yaml too: each camera with the others of its type as a prior.",
    False,
)
#: of `camcal watch`
WATCH = (
    replace(OUTPUT, required=True),
    Option(
        "target_px", POSITIVE, "End when the worst uncertainty over the picture is at most PX.", metavar="PX"
    ),
    Option("once", _SWITCH, "Calibrate from the existing pictures, then exit.", False),
    Option(
        "serve",
        Whole(0, 65535, metavar="PORT"),
        "Show a page that reloads itself at http://127.0.0.1:PORT; 0 chooses a free port.",
    ),
)
