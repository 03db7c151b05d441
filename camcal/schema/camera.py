"""`camera`, `cameras` and `rig`."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from camcal.schema.kinds import (
    UNSET,
    Figure,
    Finite,
    Matrix,
    Section,
    Sigma,
    Size,
    UnsetType,
    Vector,
    key,
)


class Parameter(Section):
    """One parameter of a lens model; `value` is all that a camera without a calibration needs."""

    value: Annotated[Finite, key("the result")]
    sigma: Annotated[
        Sigma,
        key("one standard deviation; null for a fixed parameter, `.inf` if the data do not determine it"),
    ] = None
    start: Annotated[Finite | UnsetType, key("value at the start of the refinement")] = UNSET
    fixed: Annotated[bool, key("whether it was fixed")] = False


class Correlation(Section):
    """A strong correlation of two parameters."""

    pair: Annotated[tuple[str, str], key("the names of the parameters")]
    value: Annotated[Figure, key("the correlation")]


class Camera(Section, kw_only=True):
    """A camera: lens model, image size and parameters."""

    model: Annotated[str, key("as for `--model`", min_length=1)]
    image_size: Annotated[Size | None, key("[width, height] or null")]
    pixel_center: Annotated[
        Literal["integer"], key("`integer`: (0, 0) is the centre of the top-left pixel")
    ] = "integer"
    matrix: Annotated[Matrix, key("[[fx, skew, cx], [0, fy, cy], [0, 0, 1]]")]
    parameters: Annotated[
        dict[str, Parameter], key("by name: `value`, `sigma`, `start`, `fixed`", min_length=1)
    ]
    free_directions: Annotated[
        list[list[Finite]] | UnsetType,
        key(
            "only where parameters are tied (`--fix aspect`): d parameters / d free parameters, a row per "
            "parameter"
        ),
    ] = UNSET
    correlations: Annotated[
        list[Correlation] | UnsetType, key("pairs whose correlation exceeds 0.95: `pair`, `value`")
    ] = UNSET


class RigPose(Section, kw_only=True):
    """The pose of one camera of a rig."""

    rotation_vector: Annotated[Vector, key("rad")]
    translation: Annotated[Vector, key("in the unit of the target")]
    sigma_rotation_deg: Annotated[Any, key("standard deviations of the rotation, degrees")] = UNSET
    sigma_translation: Annotated[Any, key("standard deviations of the translation")] = UNSET


class Baseline(Section):
    """The distance between two cameras of a rig."""

    value: Annotated[Finite, key("in the unit of the target")]
    sigma: Annotated[Sigma, key("one standard deviation")] = None


class RigBoard(RigPose, kw_only=True):
    """The pose of one of several boards: x_reference = R x_board + t."""

    reference: Annotated[str, key("the board whose frame is the common frame of the boards")]


class Rig(Section, kw_only=True):
    """The poses of several cameras relative to one of them."""

    reference: Annotated[str, key("the camera whose frame is the rig's frame")]
    cam_from_rig: Annotated[dict[str, RigPose], key("by name: x_cam = R x_rig + t")]
    rig_from_world: Annotated[
        RigPose | UnsetType, key("if the file states it: the pose of the rig in the world frame")
    ] = UNSET
    baselines: Annotated[dict[str, Baseline] | UnsetType, key("distances, by `left-right`")] = UNSET
    boards: Annotated[
        dict[str, RigBoard] | UnsetType,
        key("relative poses of several boards, by name, except those that define a frame"),
    ] = UNSET
