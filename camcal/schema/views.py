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

    path: Annotated[str, key("as it was found")]
    sha256: Annotated[str, key("of its content")]
    taken: Annotated[
        str | UnsetType, key("the camera and focal length that a picture's EXIF block names")
    ] = UNSET


class Inputs(Section, kw_only=True):
    """The input that was read."""

    image_size: Annotated[Size | None, key("[width, height] or null")]
    image_sizes: Annotated[dict[str, Size | None] | UnsetType, key("of a rig: by camera")] = UNSET
    instants: Annotated[list[str] | UnsetType, key("of a rig: those that were used, in order")] = UNSET
    views: Annotated[Count, key("number of views, including unused ones")]
    points: Annotated[Count, key("number of points read")]
    files: Annotated[list[File], key("each with `path` and `sha256`")]


class TriedShape(Section):
    """The errors with one kind of board shape."""

    kind: Annotated[str, key("as in `target.shape`")]
    rms_point: Annotated[Figure, key("over the used points")]
    holdout_rms_point: Annotated[Figure, key("over views held out, 4 folds; null where none were")]
    p_value: Annotated[Figure, key("probability that a flat board would look like this")]
    offset_sigma: Annotated[
        Figure | UnsetType,
        key("of `free`: the deviation of its points' offsets that the best simpler board leaves"),
    ] = UNSET
    simpler_error_px: Annotated[
        Figure | UnsetType, key("expected error of the camera's projection with the simpler board, px")
    ] = UNSET
    error_px: Annotated[
        Figure | UnsetType, key("the same with this board; the part common to both is excluded")
    ] = UNSET


class BoardShape(Section):
    """The shape of one of several boards, as `target.shape` of a board alone has it, in the frame of that board."""

    aspect: Annotated[Figure, key("ratio of the print's scale in y to that in x")]
    angle: Annotated[Figure, key("angle at which its sides meet, degrees")]
    rms_offset: Annotated[Figure, key("root mean square distance of `points` from `ideal`")]
    max_offset: Annotated[Figure, key("largest distance of `points` from `ideal`")]
    words: Annotated[str, key("the same in a sentence")]
    points: Annotated[list[Vector], key("where the points are")]
    ideal: Annotated[list[Vector], key("where they should be")]
    numbers: Annotated[list[Count], key("the number of each among the points of all boards")]
    kind: Annotated[str | UnsetType, key("`bowl`, `print`, `free`")] = UNSET


class Shape(Section, rename={"from_": "from"}):
    """The shape of a board, where it was estimated or given; lengths in squares (or the unit of the points)."""

    kind: Annotated[
        str,
        key(
            "`flat`, `bowl`, `print`, `free`, of several boards also one each (`bowl+flat`); `known` where it was given"
        ),
    ]
    p_value: Annotated[Figure | UnsetType, key("probability that a flat board would look like this")] = UNSET
    aspect: Annotated[Figure | UnsetType, key("ratio of the print's scale in y to that in x")] = UNSET
    angle: Annotated[Figure | UnsetType, key("angle at which its sides meet, degrees")] = UNSET
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
    ideal: Annotated[list[Vector] | UnsetType, key("where they should be")] = UNSET
    boards: Annotated[
        dict[str, BoardShape] | UnsetType,
        key("of several boards: the shape of each, by its name; boards that are missing are as designed"),
    ] = UNSET
    turned: Annotated[
        list[str] | UnsetType,
        key(
            "views that counted the points from the other end of a board that looks the same after half a turn; "
            "they were renumbered"
        ),
    ] = UNSET
    tried: Annotated[list[TriedShape] | UnsetType, key("with `--board-shape auto`, each kind")] = UNSET
    from_: Annotated[str | UnsetType, key("the report that a `known` shape came from")] = UNSET


class Target(Section):
    """The calibration object; a target may have more keys of its own."""

    open: ClassVar[bool] = True

    kind: Annotated[
        str | UnsetType, key("`checkerboard`, `charuco`, ..., as `camcal list targets` names them")
    ] = UNSET
    columns: Annotated[Positive | UnsetType, key("inner corners (squares, tags, discs) in a row")] = UNSET
    rows: Annotated[Positive | UnsetType, key("inner corners (squares, tags, discs) in a column")] = UNSET
    square: Annotated[Length | UnsetType, key("side of a square, or the distance of neighbours")] = UNSET
    unit: Annotated[str | UnsetType, key("of `square`; `square` where no length is known")] = UNSET
    negative: Annotated[
        bool | UnsetType, key("whether black and white are exchanged, in print or in the pictures")
    ] = UNSET
    detected: Annotated[bool | UnsetType, key("whether the size was found in the pictures")] = UNSET
    boards: Annotated[
        list[str] | UnsetType,
        key("specs of the boards where pictures show several; the other keys are of the first"),
    ] = UNSET
    first_ids: Annotated[
        list[Count] | UnsetType, key("of several boards: the smallest number of a point of each")
    ] = UNSET
    board_groups: Annotated[
        list[Count] | UnsetType,
        key("of a rig: which of several boards are fixed to each other, by the number of their group"),
    ] = UNSET
    board_poses: Annotated[
        list[dict[str, Vector]] | UnsetType,
        key(
            "the pose of each in the frame of the first of its group; the points of `data` are in that frame"
        ),
    ] = UNSET
    printed: Annotated[
        bool | UnsetType, key("of a table that says that its points are those of a printed target")
    ] = UNSET
    shape: Annotated[Shape | UnsetType, key("where the board's shape was estimated or given")] = UNSET


class PoseSigma(Section):
    """Standard deviations of a pose; `.inf` where not determined."""

    rotation: Annotated[tuple[Sigma, Sigma, Sigma], key("of the rotation about the camera's x, y and z, rad")]
    centroid: Annotated[
        tuple[Sigma, Sigma, Sigma],
        key(
            "of the position of the centroid of the view's points, in the unit of the target; a translation is that "
            "of a frame's origin, which may be far away"
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
    camera: Annotated[str | UnsetType, key("of a rig: the camera's name")] = UNSET
    instant: Annotated[str | UnsetType, key("of a rig: pictures of the same instant show the same board")] = (
        UNSET
    )
    status: Annotated[
        Literal["used", "rejected", "not_found", "unreadable"],
        key("`used`, `rejected`, `not_found` (no target in the picture), `unreadable`"),
    ]
    reason: Annotated[str | None, key("why it was not used")]
    points: Annotated[Count, key("number of points")]
    rejected_points: Annotated[Count, key("of a view that was rejected all its points")]
    rms_point: Annotated[
        Figure,
        key(
            "over the used points of the view; of a rejected view over all its points, at the pose with which most "
            "of them agree"
        ),
    ]
    cam_from_board: Annotated[
        BoardPose | None, key("`rotation_vector`, `translation`, `sigma`; null of a view that was not used")
    ]
    rig_from_board: Annotated[
        BoardPose | UnsetType,
        key("of a rig: the board in the frame of the rig, the same for all of an instant"),
    ] = UNSET
    rejected: Annotated[
        list[RejectedPoint] | UnsetType,
        key("the rejected points of a used view: `row`, `id`, `u`, `v`, `residual`"),
    ] = UNSET
    quality: Annotated[
        dict[str, Any] | UnsetType,
        key(
            "figures on the picture, where there was one: `blur_px` (sigma of the edges), `blur_ratio` and "
            "`blur_direction_deg` (how much more, and along which direction, a moved picture is blurred), "
            "`contrast` and `noise` (grey levels of 255), `saturated` and `black` (shares of the pixels around "
            "the board), `square_px`, `coverage` (share of the picture), `warnings` in words, `flow` (of frames of a "
            "film: how the target moves, eight numbers in px a frame, `camcal/geometry/plane_flow.py`)"
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
