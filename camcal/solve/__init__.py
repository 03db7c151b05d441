"""Refinement: all poses and the intrinsics together, by nonlinear least squares."""

#: what `--robust` takes, and what each does; the losses are those of `camcal.solve.losses`
ROBUST_SUMMARIES = {
    "none": "least squares with all points",
    "auto": "test for outliers first; if there are any, reject them and fit the rest by least squares",
    "huber": "least squares for small residuals, absolute values for large ones",
    "soft-l1": "like huber, with a smooth transition",
    "cauchy": "weights 1 / (1 + u²): the weight of far points tends to zero",
    "tukey": "biweight: points beyond a bound have zero weight",
    "geman-mcclure": "weights 1 / (1 + u²)²: between cauchy and tukey",
}

#: what `--board-shape` takes: flat as designed, a shape of `camcal.solve.board`, or auto
BOARD_SHAPE_SUMMARIES = {
    "flat": "flat, as designed",
    "bowl": "bent: height quadratic in the position on the board",
    "print": "bent like bowl, and stretched and sheared by the printer",
    "free": "every point estimated separately",
    "auto": "the kind with the smallest hold-out error",
}
