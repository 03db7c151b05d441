"""Refinement: all poses and the intrinsics together, by nonlinear least squares."""

#: what `--robust` takes, and what each does; the losses are those of `camcal.solve.losses`
ROBUST_SUMMARIES = {
    "none": "least squares with all points",
    "auto": "test for outliers first; if there are any, reject them and fit the rest by least squares",
    "huber": "least squares for small residuals, absolute values for large ones",
    "soft-l1": "as huber, with a smooth transition",
    "cauchy": "weights 1 / (1 + u²): the weight of far points tends to zero",
    "tukey": "biweight: points beyond a bound have no weight",
    "geman-mcclure": "weights 1 / (1 + u²)²: between cauchy and tukey",
}

#: what `--board-shape` takes: flat as designed, a shape of `camcal.solve.board`, or auto
BOARD_SHAPE_SUMMARIES = {
    "flat": "flat and as designed",
    "bowl": "bent: heights quadratic in the place on the board",
    "print": "bent as bowl, and stretched and sheared by the printer",
    "free": "every point estimated separately",
    "auto": "the one with the best hold-out error",
}
