"""`fit`, `uncertainty`, `holdout`, `bias` and `coverage`: the accuracy."""

from __future__ import annotations

from typing import Annotated, Any

from camcal.schema.kinds import Count, Figure, Section, key


class Fit(Section):
    """The error figures, and how the refinement ended."""

    optimizer: Annotated[str, key("as for `--optimizer`")]
    loss: Annotated[str, key("`linear`, or the robust loss")]
    iterations: Annotated[Count, key("number of accepted steps")]
    evaluations: Annotated[Count, key("number of evaluations of the residuals")]
    converged: Annotated[bool, key("whether the refinement met its criterion")]
    stop_reason: Annotated[str, key("why the refinement ended")]
    cost: Annotated[Figure, key("half the weighted sum of squares")]
    seconds: Annotated[Figure, key("time of the refinement")]
    rms_point: Annotated[Figure, key("√(Σ‖r‖²/N), as in [conventions.md](conventions.md)")]
    rms_coord: Annotated[Figure, key("√(Σ‖r‖²/2N)")]
    sigma_hat: Annotated[Figure, key("√(Σ‖r‖²/(2N - p))")]
    sigma_0: Annotated[
        Figure,
        key(
            "√(Σ w‖r‖² / (2N - p)) with w = 1/sigma² of each point; equal to `sigma_hat` where no sigmas "
            "were given. With sigmas it is dimensionless: the factor by which they are too small"
        ),
    ]
    median: Annotated[Figure, key("median length of the residuals")]
    p95: Annotated[Figure, key("95th percentile of the lengths of the residuals")]
    max: Annotated[Figure, key("the longest residual")]
    points_used: Annotated[Count, key("points used by the solution")]
    points_rejected: Annotated[Count, key("rejected points of used views")]
    free_parameters: Annotated[
        Count, key("number of estimated parameters, including poses and the board's shape")
    ]
    condition: Annotated[
        Figure, key("condition number of the scaled normal matrix of the camera, poses eliminated")
    ]
    info: Annotated[dict[str, Any] | None, key("further information from the optimiser")]


class Place(Section):
    """The pixel of the largest uncertainty."""

    u: Annotated[Figure, key("px")]
    v: Annotated[Figure, key("px")]
    sigma_px: Annotated[Figure, key("standard deviation in the worst direction")]


class Point(Place):
    """The uncertainty at one pixel."""

    distance: Annotated[Figure, key("from the camera")]
    covariance: Annotated[list[list[Figure]], key("[[uu, uv], [uv, vv]], px²")]


class UncertaintyMap(Section):
    """The uncertainty over the image at one distance."""

    distance: Annotated[Figure, key("from the camera")]
    median: Annotated[Figure, key("over the image")]
    worst: Annotated[Place, key("the pixel `u`, `v` and its `sigma_px`")]
    centre: Annotated[Point, key("the centre of the image, with `distance` and the `covariance`, px²")]
    u: Annotated[list[Figure], key("columns of the grid, px")]
    v: Annotated[list[Figure], key("rows of the grid, px")]
    sigma_px: Annotated[list[list[Figure]], key("of the grid, a list per row")]


class Uncertainty(Section):
    """The effect of noise on projections."""

    method: Annotated[
        str, key("`mean-pcam`: the frame of reference is the mean over the boards, as in mrcal")
    ]
    board_distance: Annotated[Figure, key("median distance of the boards from the camera")]
    maps: Annotated[list[UncertaintyMap], key("one at the board distance and one at infinity")]


class DifferenceMap(Section):
    """The difference of the folds' cameras over the image."""

    u: Annotated[list[Figure], key("columns of the grid, px")]
    v: Annotated[list[Figure], key("rows of the grid, px")]
    found_px: Annotated[
        list[list[Figure]], key("root mean square over the folds; null where there are no points")
    ]
    predicted_px: Annotated[list[list[Figure]], key("what noise explains")]


class Difference(Section):
    """The difference between the folds' cameras and that of all views, at infinity, where there are points."""

    median_px: Annotated[Figure, key("median over the image")]
    max_px: Annotated[Figure, key("maximum over the image")]
    predicted_px: Annotated[Figure, key("median of the difference that noise explains")]
    ratio: Annotated[
        Figure,
        key(
            "root mean square of the differences in units of what noise explains: 1 where the model is valid"
        ),
    ]
    map: Annotated[DifferenceMap, key("the same on a grid: `u`, `v`, `found_px`, `predicted_px`")]


class Holdout(Section):
    """Figures on held-out views."""

    views: Annotated[Count, key("number of views that were held out in turn")]
    folds: Annotated[Count, key("number of rounds")]
    points: Annotated[Count, key("their used points")]
    rms_point: Annotated[
        Figure, key("over these points, by the cameras that did not see them, poses refitted")
    ]
    p95: Annotated[Figure, key("95th percentile of the same")]
    difference: Annotated[Difference | None, key("between the folds' cameras and that of all views")]


class ResidualTest(Section):
    """One test of the residuals."""

    name: Annotated[str, key("for programs")]
    question: Annotated[str, key("the question that the test answers")]
    statistic: Annotated[Figure, key("the test statistic")]
    p_value: Annotated[Figure, key("probability under noise alone")]
    p_corrected: Annotated[Figure, key("the same, corrected for all tests together (Holm)")]
    effect: Annotated[Figure, key("the size of the effect")]
    unit: Annotated[str, key("of `effect`")]


class BiasRatio(Section):
    """The fraction of the mean square residual that is not noise."""

    ratio: Annotated[Figure, key("the share that is not noise")]
    detector_sigma: Annotated[
        Figure,
        key("noise of a coordinate from pieces of the target with separate poses, px (or in given sigmas)"),
    ]
    p_value: Annotated[Figure, key("probability under noise alone")]
    pieces: Annotated[Count, key("number of pieces")]


class SigmaRatios(Section):
    """Sigmas by resampling views, in units of the reported ones."""

    replicates: Annotated[Count, key("of the bootstrap")]
    jackknife: Annotated[dict[str, Figure], key("by leaving out views, for each parameter")]
    bootstrap: Annotated[dict[str, Figure], key("by drawing views with replacement, for each parameter")]


class Influence(Section):
    """The influence of one view on the camera."""

    view: Annotated[str, key("id of the view")]
    cook: Annotated[
        Figure, key("Cook's distance; 1: leaving the view out moves the camera by one standard deviation")
    ]
    p_value: Annotated[Figure, key("probability that noise alone makes it disagree as much with the others")]
    information: Annotated[Figure, key("its share of the information; the shares add up to 1")]


class Bias(Section):
    """Whether the residuals look like noise, and the influence of each view on the camera."""

    tests: Annotated[list[ResidualTest], key("tests of the residuals; [trust.md](trust.md) describes them")]
    ratio: Annotated[BiasRatio | None, key("the bias ratio")]
    sigma_ratios: Annotated[SigmaRatios | None, key("`replicates`, `jackknife`, `bootstrap`")]
    influence: Annotated[list[Influence] | None, key("per `view`: `cook`, `p_value`, `information`")]


class Spread(Section):
    """The range of a quantity over the views."""

    least: Annotated[Figure, key("the least")]
    median: Annotated[Figure, key("the median")]
    most: Annotated[Figure, key("the most")]


class Coverage(Section):
    """The coverage of the views."""

    image: Annotated[
        Figure,
        key("share of the picture inside the convex hull of the used points; null if its size is not known"),
    ]
    tilt_degrees: Annotated[
        Spread | None, key("angle between a board's normal and the optical axis; null for points in space")
    ]
    normals_spread_degrees: Annotated[Figure, key("rms angle of the boards' normals from their common axis")]
    distance: Annotated[Spread, key("distance of a view's points from the camera")]
    different_views: Annotated[Count, key("views, those that repeat another within 1 px counted once")]
