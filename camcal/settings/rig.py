"""The options of a rig calibration."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from camcal.errors import UsageError
from camcal.records import dataclass
from camcal.settings.calibration import CalibrationOptions
from camcal.settings.kinds import Assignments, Kind, Name, Text, Words, refuse
from camcal.settings.option import setting
from camcal.settings.sizes import ImageSize

#: the name of a camera before `=`: no blank, no colon of a spec, nothing of a path
CAMERA = re.compile(r"([A-Za-z0-9_][\w.-]*)=(.+)", re.DOTALL)


def split_camera(text: str) -> tuple[str, str] | None:
    """The name and the rest of `NAME=REST`; None for a text of another form."""
    found = CAMERA.fullmatch(text.strip())
    return (found[1], found[2]) if found else None


class ByCamera(Kind):
    """A value for all cameras, or `NAME=VALUE` for one; repeated options are merged, the common value under ""."""

    def __init__(self, kind: Kind):
        self.kind, self.metavar = kind, f"[NAME=]{kind.metavar}"

    def convert(self, value: Any) -> dict[str, Any]:
        """Return a dict camera -> value; the value under "" is for all other cameras."""
        if isinstance(value, Mapping):
            return {str(n): self.kind.convert(v) for n, v in value.items()}
        if isinstance(value, list) or (
            isinstance(value, tuple) and value and isinstance(value[0], str | Mapping)
        ):
            merged: dict[str, Any] = {}
            for part in value:
                merged |= self.convert(part)
            return merged
        pair = split_camera(value) if isinstance(value, str) else None
        return (
            {}
            if value == ()
            else {pair[0]: self.kind.convert(pair[1])}
            if pair
            else {"": self.kind.convert(value)}
        )

    def words(self) -> list[str]:
        """Return the shell completions of the kind of the values."""
        return self.kind.words()


class Named(Kind):
    """`NAME=FILE,...`, or a mapping; repeated options are merged."""

    metavar = "NAME=CAMERA,..."

    def convert(self, value: Any) -> dict[str, Any]:
        """Return a dict name -> value."""
        if isinstance(value, Mapping):
            return {str(n): v for n, v in value.items()}
        if isinstance(value, (list, tuple)):
            return {n: v for part in value for n, v in self.convert(part).items()}
        found = {}
        for part in str(value).split(","):
            pair = split_camera(part)
            if pair is None:
                raise refuse(part, "NAME=CAMERA", "Try: left=left.yaml,right=right.yaml")
            found[pair[0]] = pair[1]
        return found


class Frames(Named):
    """`NAME=K,...` with whole numbers, or a mapping."""

    metavar = "NAME=K,..."

    def convert(self, value: Any) -> dict[str, Any]:
        """Return a dict name -> number of frames."""
        try:
            return {name: int(str(frames)) for name, frames in super().convert(value).items()}
        except (ValueError, UsageError) as error:
            raise refuse(value, "NAME=K, a whole number of frames", "Try: right=1") from error


class Names(Kind):
    """Names, separated by commas."""

    metavar = "NAME,..."

    def convert(self, value: Any) -> tuple[str, ...]:
        """Return a tuple."""
        parts = value if isinstance(value, (list, tuple)) else [value]
        names = tuple(p.strip() for part in parts if isinstance(part, str) for p in part.split(","))
        if not all(names) or not all(isinstance(part, str) for part in parts):
            raise refuse(value, "a list of names", "Try: left,right")
        return names


#: options of one camera's start: a rig begins with `cameras`, and each camera else as the points decide
NOT_OF_RIGS = ("start", "start_camera")


@dataclass(frozen=True)
class RigOptions(CalibrationOptions):
    """The options of a rig calibration, under the names that the command line and `calibrate_rig` use."""

    model: Any = setting(  # a mapping camera -> model; "" of all others
        ByCamera(Name("model", "camcal.model.lenses:LENSES", also=("auto", "select"), metavar="NAME[:ARGS]")),
        "Camera model, of all cameras or of the one named; `camcal list models` names them. auto chooses for "
        "each camera separately; a camera of --cameras keeps its own.",
        {},
        short="-m",
        repeated=True,
        metavar="[NAME=]MODEL",
    )
    fix: Mapping[str, float | None] = setting(
        Assignments("[NAME.]PARAMETER[=VALUE],...", "left.fx,p1=0", qualified=True),
        "Fix parameters of all cameras, or of one (left.fx), at VALUE or at their initial value; "
        "`aspect` means fy = fx.",
        {},
        repeated=True,
    )
    cameras: Mapping[str, Any] = setting(
        Named(),
        "Start with these intrinsics; camera files of any format.",
        {},
        repeated=True,
    )
    hold: tuple[str, ...] = setting(Names(), "Hold the intrinsics of these cameras.", ())
    reference: str | None = setting(
        Text(), "The camera whose frame is that of the rig; the first by default.", metavar="NAME"
    )
    boards: str = setting(
        Words(("auto", "fixed", "moving")),
        "Several boards: whether they are fixed to each other; auto = decided from the pictures.",
        "auto",
    )
    lag: Mapping[str, int] = setting(
        Frames(),
        "Correct cameras that are K frames late: the picture with number n belongs to the instant n - K.",
        {},
        repeated=True,
    )


#: image sizes of a table, by camera
IMAGE_SIZES = ByCamera(ImageSize())


def check_names(given: Mapping[str, Any] | tuple[str, ...], known: tuple[str, ...], option: str) -> None:
    """Raise a UsageError if an option names a camera that the rig does not have."""
    for name in given:
        if name and name not in known:
            raise UsageError(f"{option} names '{name}'; the rig has {', '.join(known)}.", "Check the names.")
