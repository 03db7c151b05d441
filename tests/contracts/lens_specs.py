"""The lens models that the contract tests run on: the table's, those with options in several variants."""

from camcal.model import lenses

#: name -> specs that stand for it; a name that is not here stands for itself
VARIANTS = {
    "kb": ("kb:0", "kb:2", "kb:4", "kb:6"),
    "brown": (
        "brown:radial=3,decentering=1",
        "brown:radial=2,decentering=0",
        "brown:radial=0,decentering=0",
        "brown:radial=4,decentering=3,prism=1",
        "brown:radial=3,decentering=2,prism=1,centre=free",
        "brown:radial=2,decentering=0,centre=free",
    ),
    "division": (
        "division:1",
        "division:3",
        "division:0",
        "division:1,direction=distort",
        "division:3,direction=distort",
    ),
    "scaramuzza": ("scaramuzza", "scaramuzza:6"),
    "radial-profile": ("radial-profile", "radial-profile:4", "radial-profile:6,centre=free"),
    "polynomial": ("polynomial:2", "polynomial:3", "polynomial:5"),
    "spline": ("spline:5x4", "spline:4x4,smooth=0.1"),  # few control points, which keeps the tests fast
}
SPECS = tuple(spec for name in lenses.LENSES for spec in VARIANTS.get(name, (name,)))
