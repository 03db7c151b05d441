"""`hand_eye`: a camera on a robot's hand, or beside it."""

from __future__ import annotations

from typing import Annotated, Literal

from camcal.schema.kinds import UNSET, Count, Figure, Section, Sigma, UnsetType, Vector, key

Three = tuple[Sigma, Sigma, Sigma]


class PlainPose(Section):
    """A pose."""

    rotation_vector: Annotated[Vector, key("rad")]
    translation: Annotated[Vector, key("in the unit of the target")]


class KnownPose(PlainPose):
    """A pose with its accuracy; `a_from_b` takes points of the frame b to the frame a."""

    sigma_rotation_deg: Annotated[
        Three,
        key("standard deviations of the rotation about the axes of the first frame of the name, degrees"),
    ]
    sigma_translation: Annotated[Three, key("standard deviations of the translation")]
    interval_rotation_deg: Annotated[Three, key("half widths of the 95 % intervals, by Student's t")]
    interval_translation: Annotated[Three, key("the same of the translation")]
    covariance: Annotated[
        list[list[Figure]], key("6x6: rotation (rad, about the axes of the first frame), translation")
    ]


class Estimated(Section):
    """An estimated value."""

    value: Annotated[Figure, key("the estimate")]
    sigma: Annotated[Sigma, key("one standard deviation; null if the value is too small to be measured")]


class CameraParameter(Section):
    """A parameter of a camera that was calibrated from the same pictures."""

    value: Annotated[float, key("estimated with the robot's poses")]
    sigma: Annotated[float, key("one standard deviation; 0 if it is held")]
    before: Annotated[float, key("estimated from the pictures alone, as in `camera`")]
    sigma_before: Annotated[float, key("its standard deviation")]


class Robot(Section):
    """The accuracy of the robot."""

    translation_rms: Annotated[
        Figure, key("rms residual of the robot's positions, in the unit of the target")
    ]
    rotation_rms_deg: Annotated[Figure, key("rms residual of its rotations, as an angle")]
    translation_sigma: Annotated[Estimated, key("standard deviation of a coordinate of its positions")]
    rotation_sigma_deg: Annotated[Estimated, key("standard deviation of its rotations about an axis")]


class Image(Section):
    """The residuals of the image points."""

    rms_point: Annotated[Figure, key("over the used points, px")]
    sigma: Annotated[
        Figure, key("standard deviation of an image coordinate, px (a factor where points have sigmas)")
    ]


class Method(Section):
    """A closed form."""

    name: Annotated[str, key("`tsai`, `park`, `horaud`, `andreff`, `daniilidis`, `shah`, `li`")]
    paper: Annotated[str, key("authors and year")]
    rotation_vector: Annotated[
        Vector | None,
        key("rotation vector of the hand-eye transformation, rad; null where the method failed"),
    ]
    translation: Annotated[Vector | None, key("its translation")]
    translation_rms: Annotated[Figure, key("residual of the robot's positions")]
    rotation_rms_deg: Annotated[Figure, key("residual of the robot's rotations")]


class Motions(Section):
    """The rotations of the camera between views."""

    turns_deg: Annotated[
        list[Figure],
        key("rms rotation about the main axis and the two perpendicular axes, over all pairs of views"),
    ]
    axes: Annotated[list[Vector], key("these axes in the camera's frame")]
    noise_deg: Annotated[list[Figure], key("the part of these rotations that is caused by image noise")]


class PoseOfView(Section, kw_only=True):
    """The robot at one view."""

    id: Annotated[str, key("of the view")]
    status: Annotated[Literal["used", "outlier"], key("`used` or `outlier`")]
    base_from_hand: Annotated[PlainPose | UnsetType, key("estimated pose, for a used view")] = UNSET
    translation_residual: Annotated[
        Vector | UnsetType, key("estimated minus measured, in the base's frame")
    ] = UNSET
    rotation_residual_deg: Annotated[Figure | UnsetType, key("angle between the two")] = UNSET


class NextPose(Section):
    """A suggested pose."""

    base_from_hand: Annotated[PlainPose, key("where to move the hand")]
    cam_from_board: Annotated[PlainPose, key("the view of the camera there")]
    sigma_rotation_deg: Annotated[
        Three, key("standard deviations of the transformation's rotation with this pose and those before it")
    ]
    sigma_translation: Annotated[Three, key("the same of its translation")]


class HandEye(Section, kw_only=True):
    """A hand-eye calibration."""

    setup: Annotated[
        Literal["in-hand", "to-hand"], key("`in-hand`: the camera moves; `to-hand`: the board does")
    ]
    hand_from_camera: Annotated[KnownPose | UnsetType, key("for a camera in the hand: its pose")] = UNSET
    base_from_board: Annotated[
        KnownPose | UnsetType, key("for a camera in the hand: the pose of the board")
    ] = UNSET
    base_from_camera: Annotated[KnownPose | UnsetType, key("for a camera beside the robot: its pose")] = UNSET
    hand_from_board: Annotated[
        KnownPose | UnsetType, key("for a fixed camera: the pose of the board in the hand")
    ] = UNSET
    robot: Annotated[Robot, key("the robot's accuracy")]
    image: Annotated[Image, key("the pictures' accuracy")]
    poses: Annotated[Count, key("number of used poses")]
    outliers: Annotated[Count, key("number of poses not used")]
    rotation: Annotated[str, key("the rotation convention of the poses, as for `--rotation`")]
    methods: Annotated[list[Method], key("the closed forms; the joint estimate begins at the best of them")]
    motions: Annotated[Motions, key("the rotations that determine the result")]
    scale: Annotated[
        Estimated, key("ratio of the robot's motion to the motion according to the board's lengths")
    ]
    camera: Annotated[
        dict[str, CameraParameter] | UnsetType,
        key(
            "for a camera calibrated from the same pictures: its parameters, estimated together with the poses"
        ),
    ] = UNSET
    time_offset: Annotated[
        Estimated | UnsetType, key("for poses with times: s, to be added to the camera's time")
    ] = UNSET
    views: Annotated[list[PoseOfView], key("the robot's pose at each view")]
    next: Annotated[
        list[NextPose],
        key("suggested poses that determine the transformation best, each given those before it"),
    ]
