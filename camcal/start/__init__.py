"""Closed-form estimates, the initial values of a calibration; each is a stage with its own figures.

To add one, write a file with `estimate(correspondences, skew=False, normalise=True) -> ClosedForm` and add
one line here.
"""

CLOSED_FORMS = {
    "central": "camcal.start.central:estimate",
    "claus": "camcal.start.claus:estimate",
    "dlt": "camcal.start.dlt:estimate",
    "dlt12": "camcal.start.dlt_distorted:estimate12",
    "dlt14": "camcal.start.dlt_distorted:estimate14",
    "dlt16": "camcal.start.dlt_distorted:estimate16",
    "fitzgibbon": "camcal.start.fitzgibbon:estimate",
    "mdlt": "camcal.start.mdlt:estimate",
    "tsai": "camcal.start.tsai:estimate",
    "zhang": "camcal.start.zhang:estimate",
}

#: those that estimate many cameras at once in less time: `estimate_all(sets, skew=False, normalise=True)`, with an
#: error in place of what cannot be estimated
TOGETHER = {"zhang": "camcal.start.zhang:estimate_all"}

SUMMARIES = {
    "central": "one view of a 3D rig: Barranco & Medel's estimate of the projection matrix, m34 = 1",
    "claus": "planes: rays as a rational function of the pixel, from lifted homographies",
    "dlt": "one view of a 3D rig: the homogeneous direct linear transformation, normalised",
    "dlt12": "one view of a 3D rig: the DLT with one radial term, 12 coefficients",
    "dlt14": "one view of a 3D rig: the DLT with three radial terms, 14 coefficients",
    "dlt16": "one view of a 3D rig: the DLT with radial and decentering terms, 16 coefficients",
    "fitzgibbon": "planes or points in space: homography and division model in one eigenvalue problem",
    "mdlt": "one view of a 3D rig: the DLT of Hatze, whose pixel axes are orthogonal",
    "tsai": "planes or points in space: radial alignment, then focal length, distortion and depth",
    "zhang": "views of a plane: homographies and the image of the absolute conic",
}
