"""Lens models by name. To add one, write a file and lines in `LENSES` and `SUMMARIES`; the tests then include it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from camcal.registry import look_up, split_spec

if TYPE_CHECKING:
    from camcal.model.lenses.base import Lens

#: the model of an ordinary lens, which is tried first
ORDINARY = "opencv5"

LENSES = {
    "pinhole": "camcal.model.lenses.opencv:OpenCV",
    "opencv4": "camcal.model.lenses.opencv:OpenCV",
    "opencv5": "camcal.model.lenses.opencv:OpenCV",
    "opencv8": "camcal.model.lenses.opencv:OpenCV",
    "opencv12": "camcal.model.lenses.opencv:OpenCV",
    "opencv14": "camcal.model.lenses.opencv:OpenCV",
    "kb4": "camcal.model.lenses.kannala_brandt:KannalaBrandt",
    "kb": "camcal.model.lenses.kannala_brandt:KannalaBrandt",
    "brown": "camcal.model.lenses.brown:Brown",
    "ucm": "camcal.model.lenses.spheres:Spheres",
    "eucm": "camcal.model.lenses.spheres:Spheres",
    "ds": "camcal.model.lenses.spheres:Spheres",
    "mei": "camcal.model.lenses.mei:Mei",
    "fov": "camcal.model.lenses.fov:FieldOfView",
    "division": "camcal.model.lenses.division:Division",
    "scaramuzza": "camcal.model.lenses.division:Scaramuzza",
    "radial-profile": "camcal.model.lenses.radial_profile:RadialProfile",
    "rational-function": "camcal.model.lenses.rational_function:RationalFunction",
    "bicubic": "camcal.model.lenses.polynomial:Polynomial",
    "polynomial": "camcal.model.lenses.polynomial:Polynomial",
    "spline": "camcal.model.lenses.spline:Spline",
    "tilted": "camcal.model.lenses.opencv:OpenCV",
}

SUMMARIES = {
    "pinhole": "no distortion",
    "opencv4": "radial k1 k2, decentering p1 p2",
    "opencv5": "radial k1 k2 k3, decentering p1 p2: OpenCV's default",
    "opencv8": "rational radial of six coefficients, decentering",
    "opencv12": "opencv8 with thin prism s1 to s4",
    "opencv14": "opencv12 with a tilted sensor (Scheimpflug)",
    "kb4": "fisheye to 180 degrees and beyond: odd polynomial of the angle, OpenCV's fisheye",
    "kb": "kb:n, the same with n terms",
    "brown": "Brown-Conrady of any order: brown:radial=3,decentering=1,prism=0,centre=principal",
    "ucm": "unified model: one sphere, for 180 degrees and more",
    "eucm": "enhanced unified model: an ellipsoid",
    "ds": "double sphere",
    "mei": "unified model with distortion k1 k2 p1 p2, OpenCV's omnidir",
    "fov": "field of view (Devernay & Faugeras): one parameter",
    "division": "division:n (Fitzgibbon), n terms; division:n,direction=distort for the reciprocal series",
    "scaramuzza": "scaramuzza:n, depth as a polynomial of degree n in the image radius",
    "radial-profile": "radial-profile:n,centre=principal: any smooth increasing curve, a spline of n intervals",
    "rational-function": "rays as quotients of quadratic polynomials of the pixel (Claus & Fitzgibbon)",
    "bicubic": "two cubic polynomials from the image to the plane",
    "polynomial": "polynomial:n, the same of order n",
    "spline": "spline:CxR, generic central camera: rays as a B-spline surface over the image",
    "tilted": "another name for opencv14",
}


def make(spec: str, skew: bool = False) -> Lens:
    """Make the lens model of a spec such as `opencv5` or `brown:radial=2,decentering=1`.

    Raises
    ------
    UsageError
        If the name or an option is unknown.
    """
    name, plain, named = split_spec(spec)
    return look_up(LENSES, name, "model").parse(name, plain, named, skew)
