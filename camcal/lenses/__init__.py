"""Lens models by name. Adding one = a file, a line in `LENSES` and one in `SUMMARIES`; the tests follow."""

from __future__ import annotations

from typing import TYPE_CHECKING

from camcal.registry import look_up, split_spec

if TYPE_CHECKING:
    from camcal.lenses.base import Lens

LENSES = {
    "pinhole": "camcal.lenses.opencv:OpenCV",
    "opencv4": "camcal.lenses.opencv:OpenCV",
    "opencv5": "camcal.lenses.opencv:OpenCV",
    "opencv8": "camcal.lenses.opencv:OpenCV",
    "opencv12": "camcal.lenses.opencv:OpenCV",
    "opencv14": "camcal.lenses.opencv:OpenCV",
    "kb4": "camcal.lenses.kannala_brandt:KannalaBrandt",
    "kb": "camcal.lenses.kannala_brandt:KannalaBrandt",
    "brown": "camcal.lenses.brown:Brown",
    "ucm": "camcal.lenses.unified:Unified",
    "eucm": "camcal.lenses.unified:Unified",
    "ds": "camcal.lenses.double_sphere:DoubleSphere",
    "mei": "camcal.lenses.mei:Mei",
    "fov": "camcal.lenses.fov:FieldOfView",
    "division": "camcal.lenses.division:Division",
    "scaramuzza": "camcal.lenses.division:Scaramuzza",
    "radial-profile": "camcal.lenses.radial_profile:RadialProfile",
    "rational-function": "camcal.lenses.rational_function:RationalFunction",
    "bicubic": "camcal.lenses.polynomial:Polynomial",
    "polynomial": "camcal.lenses.polynomial:Polynomial",
    "spline": "camcal.lenses.spline:Spline",
    "tilted": "camcal.lenses.opencv:OpenCV",
}

SUMMARIES = {
    "pinhole": "no distortion",
    "opencv4": "radial k1 k2, decentering p1 p2",
    "opencv5": "radial k1 k2 k3, decentering p1 p2: OpenCV's default",
    "opencv8": "rational radial of six coefficients, decentering",
    "opencv12": "opencv8 with thin prism s1 to s4",
    "opencv14": "opencv12 with a tilted sensor (Scheimpflug)",
    "kb4": "fisheye up to and beyond 180 degrees: odd polynomial of the angle, OpenCV's fisheye",
    "kb": "kb:n, the same with n terms",
    "brown": "Brown-Conrady of any order: brown:radial=3,decentering=1,prism=0,centre=principal",
    "ucm": "unified model: one sphere, 180 degrees and more",
    "eucm": "enhanced unified model: an ellipsoid",
    "ds": "double sphere",
    "mei": "unified model with distortion k1 k2 p1 p2, OpenCV's omnidir",
    "fov": "field of view (Devernay & Faugeras): one parameter",
    "division": "division:n (Fitzgibbon), n terms; division:n,direction=distort for the reciprocal series",
    "scaramuzza": "scaramuzza:n, depth as a polynomial of degree n in the image radius",
    "radial-profile": "radial-profile:n,centre=principal: any smooth growing curve, a spline of n intervals",
    "rational-function": "rays as quotients of quadratic polynomials of the pixel (Claus & Fitzgibbon)",
    "bicubic": "two cubic polynomials from the image to the plane",
    "polynomial": "polynomial:n, the same of order n",
    "spline": "spline:CxR, generic central camera: a B-spline surface of rays over the image",
    "tilted": "another name of opencv14",
}


def make(spec: str, skew: bool = False) -> Lens:
    """Make the lens model of a spec such as `opencv5` or `brown:radial=2,decentering=1`.

    Raises
    ------
    UsageError
        Where the name or an option is unknown.
    """
    name, plain, named = split_spec(spec)
    return look_up(LENSES, name, "model").parse(name, plain, named, skew)
