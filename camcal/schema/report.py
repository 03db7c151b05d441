"""The report of a calibration: its top level, `stages`, `crosscheck`, `warnings`."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from camcal.schema.camera import Camera, Rig
from camcal.schema.figures import Bias, Coverage, Fit, Holdout, Uncertainty
from camcal.schema.hand_eye import HandEye
from camcal.schema.kinds import (
    UNSET,
    Figure,
    Finite,
    Matrix,
    Projection,
    Section,
    UnsetType,
    key,
)
from camcal.schema.version import SCHEMA
from camcal.schema.views import Data, Inputs, Target, View


class Tool(Section):
    """Versions of what made the report."""

    camcal: Annotated[str, key("version of camcal")]
    opencv: Annotated[str, key("version of OpenCV")]
    numpy: Annotated[str, key("version of numpy")]
    python: Annotated[str, key("version of Python")]


class Stage(Section):
    """One estimate on the way to the result."""

    name: Annotated[str, key("`dlt`, `central`, `zhang`, ..., `refine`")]
    rms_point: Annotated[Figure, key("over the used points")]
    seconds: Annotated[Figure, key("duration")]
    matrix: Annotated[Matrix | None, key("3x3")]
    parameters: Annotated[
        dict[str, Finite] | UnsetType, key("by name, if the stage has a camera with a lens")
    ] = UNSET
    projection_matrix: Annotated[
        Projection | UnsetType, key("only with one view, scaled as at the top level")
    ] = UNSET
    info: Annotated[
        dict[str, Any] | UnsetType,
        key("further information: why it was chosen, what it assumed, condition numbers"),
    ] = UNSET


class Crosscheck(Section):
    """The comparison of one stage with OpenCV."""

    stage: Annotated[str, key("one of the `stages`")]
    against: Annotated[str, key("the function of cv2")]
    status: Annotated[
        Literal["pass", "fail", "not_applicable"],
        key("`pass`, `fail`, or `not_applicable` where cv2 has no counterpart"),
    ]
    why: Annotated[str | None, key("the reason, and where cv2 started")]
    opencv: Annotated[
        dict[str, Any] | None,
        key(
            "cv2's `rms_point`, `matrix`, `distortion`; the rms is recomputed in float64 from the parameters and "
            "poses that cv2 returned"
        ),
    ]
    difference: Annotated[
        dict[str, Any] | None,
        key(
            "camcal's value minus cv2's: `rms_point`, and `parameters` by name; `projection_max_px` and "
            "`projection_rms_px`, the difference of projection over the image after the best-fitting rotation; "
            "`pixels_outside`, the number of compared pixels that a camera does not see; `sigmas`, the "
            "joint difference of all free parameters in standard deviations; of rotations `matrix_max` "
            "and `angle_max` "
            "(rad)"
        ),
    ]


class Warning_(Section, kw_only=True):
    """A condition that reduces the value of the result."""

    code: Annotated[str, key("for programs")]
    severity: Annotated[
        Literal["wrong", "doubtful", "note"] | UnsetType,
        key(
            "`wrong`: do not use the camera; `doubtful`: less accurate than it appears; `note`: worth knowing"
        ),
    ] = UNSET
    message: Annotated[str, key("in words")]
    hint: Annotated[str, key("one thing to try")]


class Head(Section, kw_only=True):
    """The keys that every document of camcal begins with."""

    schema: Annotated[Literal["camcal-report/1"], key(f"`{SCHEMA}`")] = "camcal-report/1"
    tool: Annotated[Tool, key("versions: `camcal`, `opencv`, `numpy`, `python`")]
    command: Annotated[list[str], key("the command-line arguments after `camcal`, as typed")]
    date: Annotated[
        str | UnsetType | None, key("creation time, UTC (ISO 8601); null with `--reproducible`")
    ] = UNSET


class Report(Head, kw_only=True):
    """A calibration."""

    inputs: Annotated[Inputs, key("`image_size`, `views`, `points`, `files`: what was read")]
    options: Annotated[
        dict[str, Any],
        key(
            "every option: `{value, from}`, from `flag`, `env`, `file`, `keyword` (of a call in Python) or `default`"
        ),
    ]
    target: Annotated[Target | None, key("the calibration object; null for plain points")]
    stages: Annotated[list[Stage], key("every estimate on the way")]
    camera: Annotated[Camera | UnsetType, key("the result")] = UNSET
    cameras: Annotated[dict[str, Camera] | UnsetType, key("for a rig, instead of `camera`: by name")] = UNSET
    rig: Annotated[Rig | UnsetType, key("for a rig: the relative poses of its cameras")] = UNSET
    hand_eye: Annotated[
        HandEye | UnsetType,
        key("for `camcal hand-eye`: the pose of the camera on the robot's hand, or beside the robot"),
    ] = UNSET
    selection: Annotated[
        dict[str, Any] | UnsetType,
        key("only with `--model auto`: how the model was chosen, as `camcal select` says"),
    ] = UNSET
    projection_matrix: Annotated[
        Projection | UnsetType,
        key(
            "only with one view: K [R | t], scaled to m34 = 1 where that is possible; without the distortion"
        ),
    ] = UNSET
    views: Annotated[list[View], key("every view in the order of the input")]
    fit: Annotated[Fit, key("the error figures and how the refinement ended")]
    uncertainty: Annotated[
        Uncertainty | None,
        key("the effect of noise on projections; null if no camera parameter was estimated"),
    ] = None
    holdout: Annotated[
        Holdout | None,
        key(
            "figures on views that were not used; null if it was not requested (`--holdout`) and the problem is large"
        ),
    ] = None
    bias: Annotated[
        Bias | None,
        key(
            "whether the residuals look like noise, and the influence of each view on the camera; null "
            "for more than 10,000 points and without checks"
        ),
    ] = None
    coverage: Annotated[
        Coverage | None,
        key(
            "how much of the picture, of the directions and of the distances the views cover; null without views"
        ),
    ] = None
    crosscheck: Annotated[list[Crosscheck], key("every stage compared with OpenCV")]
    warnings: Annotated[
        list[Warning_],
        key("conditions that reduce the value of the result: `code`, `severity`, `message`, `hint`"),
    ]
    verdict: Annotated[Literal["pass", "fail"], key("`pass` or `fail`; `fail` is exit code 1")]
    grade: Annotated[
        Literal["good", "doubtful", "wrong"] | UnsetType,
        key("the worst severity among the warnings; `good` if there are at most notes"),
    ] = UNSET
    failures: Annotated[list[str], key("the failed gates, a sentence each")]
    data: Annotated[Data, key("the observations")]
