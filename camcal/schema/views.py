"""`inputs`, `target`, `views` and `data`."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal

from camcal.schema.kinds import (
    UNSET,
    Count,
    Figure,
    Length,
    Positive,
    Section,
    Sigma,
    Size,
    UnsetType,
    Vector,
    key,
)


class File(Section):
    """One file that was read."""

    path: Annotated[str, key("the path under which it was found")]
    sha256: Annotated[str, key("SHA-256 of its content")]
    taken: Annotated[
        str | UnsetType, key("the camera and focal length that a picture's EXIF block names")
    ] = UNSET


class Inputs(Section, kw_only=True):
    """The input that was read."""

    image_size: Annotated[Size | None, key("[width, height] or null")]
    image_sizes: Annotated[dict[str, Size | None] | UnsetType, key("for a rig: by camera")] = UNSET
    instants: Annotated[list[str] | UnsetType, key("for a rig: the used ones, in order")] = UNSET
    views: Annotated[Count, key("number of views, including unused ones")]
    points: Annotated[Count, key("number of points read")]
    files: Annotated[list[File], key("each with `path` and `sha256`")]


class TriedShape(Section):
    """The errors with one kind of board shape."""

    kind: Annotated[str, key("as in `target.shape`")]
    rms_point: Annotated[Figure, key("over the used points")]
    holdout_rms_point: Annotated[Figure, key("over held-out views, 4 folds; null without a hold-out")]
    p_value: Annotated[Figure, key("probability that a flat board would look like this")]
    offset_sigma: Annotated[
        Figure | UnsetType,
        key("for `free`: the deviation of its points' offsets that the best simpler board does not explain"),
    ] = UNSET
    simpler_error_px: Annotated[
        Figure | UnsetType, key("expected error of the camera's projection with the simpler board, px")
    ] = UNSET
    error_px: Annotated[
        Figure | UnsetType, key("the same with this board; the part common to both is excluded")
    ] = UNSET


class BoardShape(Section):
    """The shape of one of several boards, as `target.shape` of a board alone has it, in the frame of that board."""

    aspect: Annotated[Figure, key("ratio of the print's scale in y to its scale in x")]
    angle: Annotated[Figure, key("angle between its sides, degrees")]
    rms_offset: Annotated[Figure, key("root mean square distance of `points` from `ideal`")]
    max_offset: Annotated[Figure, key("largest distance of `points` from `ideal`")]
    words: Annotated[str, key("the same in a sentence")]
    points: Annotated[list[Vector], key("the points' positions")]
    ideal: Annotated[list[Vector], key("their designed positions")]
    numbers: Annotated[list[Count], key("the index of each among the points of all boards")]
    kind: Annotated[str | UnsetType, key("`bowl`, `print`, `free`")] = UNSET


class Shape(Section, rename={"from_": "from"}):
    """The shape of a board, where it was estimated or given; lengths in squares (or the unit of the points)."""

    kind: Annotated[
        str,
        key(
            "`flat`, `bowl`, `print`, `free`, for several boards also one kind each (`bowl+flat`); "
            "`known` if it was given"
        ),
    ]
    p_value: Annotated[Figure | UnsetType, key("probability that a flat board would look like this")] = UNSET
    aspect: Annotated[Figure | UnsetType, key("ratio of the print's scale in y to its scale in x")] = UNSET
    angle: Annotated[Figure | UnsetType, key("angle between its sides, degrees")] = UNSET
    rms_offset: Annotated[Figure | UnsetType, key("root mean square distance of `points` from `ideal`")] = (
        UNSET
    )
    max_offset: Annotated[Figure | UnsetType, key("largest distance of `points` from `ideal`")] = UNSET
    words: Annotated[str | UnsetType, key("the same in a sentence")] = UNSET
    points: Annotated[
        list[Vector] | UnsetType,
        key(
            "where the board's points are: [[X, Y, Z], ...] in the order of the board's corners, in the frame and "
            "at the scale in which they are nearest to `ideal`"
        ),
    ] = UNSET
    ideal: Annotated[list[Vector] | UnsetType, key("their designed positions")] = UNSET
    boards: Annotated[
        dict[str, BoardShape] | UnsetType,
        key("for several boards: the shape of each, by name; missing boards are as designed"),
    ] = UNSET
    turned: Annotated[
        list[str] | UnsetType,
        key(
            "views in which the points of a board that looks the same after a half turn were numbered "
            "from the other end; they were renumbered"
        ),
    ] = UNSET
    tried: Annotated[
        list[TriedShape] | UnsetType, key("with `--board-shape auto`: each kind that was tried")
    ] = UNSET
    from_: Annotated[str | UnsetType, key("the report that a `known` shape came from")] = UNSET


class Target(Section):
    """The calibration object; a target may have more keys of its own."""

    open: ClassVar[bool] = True

    kind: Annotated[
        str | UnsetType, key("`checkerboard`, `charuco`, ..., as `camcal list targets` names them")
    ] = UNSET
    columns: Annotated[Positive | UnsetType, key("inner corners (squares, tags, discs) in a row")] = UNSET
    rows: Annotated[Positive | UnsetType, key("inner corners (squares, tags, discs) in a column")] = UNSET
    square: Annotated[Length | UnsetType, key("side of a square, or the distance between neighbours")] = UNSET
    unit: Annotated[str | UnsetType, key("unit of `square`; `square` if no length is known")] = UNSET
    negative: Annotated[
        bool | UnsetType, key("whether black and white are exchanged, in print or in the pictures")
    ] = UNSET
    detected: Annotated[bool | UnsetType, key("whether the size was found in the pictures")] = UNSET
    boards: Annotated[
        list[str] | UnsetType,
        key("specs of the boards if pictures show several; the other keys belong to the first"),
    ] = UNSET
    first_ids: Annotated[
        list[Count] | UnsetType, key("for several boards: the smallest point number of each")
    ] = UNSET
    board_groups: Annotated[
        list[Count] | UnsetType,
        key("for a rig: which of several boards are fixed to each other, by the number of their group"),
    ] = UNSET
    board_poses: Annotated[
        list[dict[str, Vector]] | UnsetType,
        key(
            "the pose of each in the frame of the first of its group; the points of `data` are in that frame"
        ),
    ] = UNSET
    printed: Annotated[
        bool | UnsetType, key("for a table whose points are marked as those of a printed target")
    ] = UNSET
    shape: Annotated[Shape | UnsetType, key("if the board's shape was estimated or given")] = UNSET


class PoseSigma(Section):
    """Standard deviations of a pose; `.inf` where not determined."""

    rotation: Annotated[
        tuple[Sigma, Sigma, Sigma], key("of the rotation about the camera's x, y and z axes, rad")
    ]
    centroid: Annotated[
        tuple[Sigma, Sigma, Sigma],
        key(
            "of the position of the centroid of the view's points, in the unit of the target "
            "(`translation` refers to the origin of the frame, which may be far away)"
        ),
    ]


class BoardPose(Section):
    """The pose of the target: x_cam = R x_board + t."""

    rotation_vector: Annotated[Vector, key("rad")]
    translation: Annotated[Vector, key("in the unit of the target")]
    sigma: Annotated[PoseSigma | UnsetType, key("`rotation` and `centroid`")] = UNSET


class RejectedPoint(Section):
    """A point that the solution does not use."""

    row: Annotated[Count, key("row in the view")]
    id: Annotated[int | None, key("number of the target's point")]
    u: Annotated[Figure, key("px")]
    v: Annotated[Figure, key("px")]
    residual: Annotated[tuple[Figure, Figure], key("[du, dv], px")]


class View(Section, kw_only=True):
    """One view."""

    id: Annotated[str, key("the file's name, or the value of the `view` column")]
    camera: Annotated[str | UnsetType, key("for a rig: the camera's name")] = UNSET
    instant: Annotated[
        str | UnsetType, key("for a rig: pictures of the same instant show the same board")
    ] = UNSET
    status: Annotated[
        Literal["used", "rejected", "not_found", "unreadable"],
        key("`used`, `rejected`, `not_found` (no target in the picture), `unreadable`"),
    ]
    reason: Annotated[str | None, key("why it was not used")]
    points: Annotated[Count, key("number of points")]
    rejected_points: Annotated[Count, key("for a rejected view, all of its points")]
    rms_point: Annotated[
        Figure,
        key(
            "over the used points of the view; for a rejected view over all its points, at the pose with "
            "which most of them agree"
        ),
    ]
    cam_from_board: Annotated[
        BoardPose | None, key("`rotation_vector`, `translation`, `sigma`; null for a view that was not used")
    ]
    rig_from_board: Annotated[
        BoardPose | UnsetType,
        key("for a rig: the pose of the board in the frame of the rig, the same for all views of an instant"),
    ] = UNSET
    rejected: Annotated[
        list[RejectedPoint] | UnsetType,
        key("the rejected points of a used view: `row`, `id`, `u`, `v`, `residual`"),
    ] = UNSET
    quality: Annotated[
        dict[str, Any] | UnsetType,
        key(
            "figures on the picture, if there was one: `blur_px` (sigma of the edges), `blur_ratio` and "
            "`blur_direction_deg` (how much more a picture is blurred by motion, and in which direction), "
            "`contrast` and `noise` (grey levels of 255), `saturated` and `black` (shares of the pixels around "
            "the board), `square_px`, `coverage` (share of the picture), `warnings` in words, `flow` "
            "(for frames of a film: how the target moves, eight numbers in px per frame, see "
            "`camcal/geometry/plane_flow.py`)"
        ),
    ] = UNSET


class Data(Section):
    """The observations, exact to the last bit."""

    encoding: Annotated[Literal["zlib+base64"], key("`zlib+base64`")]
    dtype: Annotated[Literal["float64"], key("`float64`")]
    byteorder: Annotated[Literal["little"], key("`little`")]
    columns: Annotated[
        list[str],
        key(
            "`view` (index into `views`), `id` (number of the target's point, -1 for none), `X`, `Y`, `Z`, `u`, "
            "`v`, `sigma` (NaN for none), `used` (0 or 1), and `weight` where a robust loss weighted the points",
            max_length=100,
        ),
    ]
    rows: Annotated[Count, key("number of points")]
    text: Annotated[str, key("the columns concatenated")]
