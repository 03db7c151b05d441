"""The terms of a camera under names that do not depend on the model: what a format must represent.

A camera has one or more descriptions (`mei` with ξ = 0 is also a polynomial), each of a kind:

| kind | terms |
|---|---|
| polynomial | k1 k2 ... radial, d1 d2 d3 its denominator, p1 p2 ... decentering, s1 to s4 prism, tauX tauY, xc yc |
| fisheye | k1 k2 ... of θ |
| unified | xi, k1 k2 p1 p2 |
| eucm, ds, fov, division, ... | the parameters of that lens |
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import field
from typing import Any

import numpy as np

from camcal.errors import UsageError
from camcal.model.camera import Camera
from camcal.model.lenses import make
from camcal.model.lenses.base import Lens
from camcal.records import dataclass

#: how messages call the kinds
KINDS = {
    "polynomial": "a polynomial lens (OpenCV, Brown)",
    "fisheye": "a fisheye lens (Kannala-Brandt, kb)",
    "unified": "an omnidirectional lens (mei, with xi)",
    "eucm": "the enhanced unified model (eucm)",
    "ds": "the double sphere model (ds)",
    "fov": "the field-of-view model (fov)",
    "division": "the division model",
}
#: how the lens itself calls the terms of the denominator
SHOWN = {"d1": "k4", "d2": "k5", "d3": "k6"}
_OPENCV = ("k1", "k2", "p1", "p2", "k3", "d1", "d2", "d3", "s1", "s2", "s3", "s4", "tauX", "tauY")


@dataclass(frozen=True)
class Terms:
    """One description of a camera: the matrix, in px with (0, 0) as the centre of the top-left pixel, and terms."""

    kind: str
    fx: float
    fy: float
    cx: float
    cy: float
    skew: float = 0.0
    values: Mapping[str, float] = field(default_factory=dict)

    def get(self, *names: str) -> list[float]:
        """The values of terms, 0 for absent ones."""
        return [float(self.values.get(n, 0.0)) for n in names]

    @property
    def needed(self) -> list[str]:
        """The names of the non-zero terms."""
        return [n for n, v in self.values.items() if v != NEUTRAL.get((self.kind, n), 0.0)]

    @property
    def matrix(self) -> np.ndarray:
        """The camera matrix (3, 3)."""
        return np.array([[self.fx, self.skew, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])


NAMED = 6  #: models that a message names
#: terms whose absence is another value than 0
NEUTRAL = {("eucm", "beta"): 1.0}


def canonical(lens: Lens) -> tuple[str, tuple[str, ...]]:
    """The kind of a lens and the names of its distortion parameters as terms, in the lens's order."""
    own = tuple(p.name for p in lens.parameters if p.group == "distortion")
    family = lens.name.partition(":")[0]
    if family == "pinhole" or family.startswith("opencv"):
        return "polynomial", _OPENCV[: len(own)]
    if family == "brown":
        return "polynomial", tuple({"s1": "s1", "s2": "s3"}.get(n, n) for n in own)
    if family in ("kb4", "kb"):
        return "fisheye", own
    if family == "mei":
        return "unified", own
    if family == "division" and "direction" in lens.name:
        return "reciprocal division", own
    return family, own


def descriptions(camera: Camera) -> list[Terms]:
    """All descriptions of a camera, its own first."""
    kind, names = canonical(camera.lens)
    values = camera.values
    matrix = (values["fx"], values["fy"], values["cx"], values["cy"], values.get("skew", 0.0))
    own = [values[p.name] for p in camera.lens.parameters if p.group == "distortion"]
    terms = dict(zip(names, own, strict=True))
    found = [Terms(kind, *matrix, terms)]
    if kind == "ucm":
        found = _of_ucm(matrix, terms["alpha"])
    if kind == "unified" and terms["xi"] == 0:
        found.append(Terms("polynomial", *matrix, {k: v for k, v in terms.items() if k != "xi"}))
    if (kind == "eucm" and terms["alpha"] == 0) or (kind not in ("fisheye", "eucm") and not any(own)):
        found.append(Terms("polynomial", *matrix, {}))  # a pinhole camera, whatever the model
    return found


def _of_ucm(matrix: tuple[float, float, float, float, float], alpha: float) -> list[Terms]:
    """The unified model as itself, as eucm with β = 1 and as Mei's with ξ = α / (1 - α)."""
    found = [Terms("ucm", *matrix, {"alpha": alpha}), Terms("eucm", *matrix, {"alpha": alpha, "beta": 1.0})]
    if alpha < 1:
        fx, fy, cx, cy, skew = matrix
        rest = 1 - alpha
        found.append(Terms("unified", fx / rest, fy / rest, cx, cy, skew / rest, {"xi": alpha / rest}))
    return found


@dataclass(frozen=True)
class Room:
    """What a format can represent in one of its models: `spec` followed by `+skew` or `+square`."""

    spec: str
    kind: str
    names: frozenset[str]
    skew: bool
    square: bool

    def lacks(self, terms: Terms) -> list[str]:
        """The names of the terms of a camera of the same kind that this model cannot represent."""
        found = [SHOWN.get(n, n) for n in terms.needed if n not in self.names]
        if any(n.startswith("d") and len(n) == 2 for n in terms.needed if n not in self.names):
            found.append("(rational)")
        if terms.skew and not self.skew:
            found.append("skew")
        if self.square and terms.fx != terms.fy:
            found.append("fx different from fy")
        return found


def room(text: str) -> Room:
    """The `Room` of one entry of `Format.models`."""
    spec, *more = text.split("+")
    kind, names = canonical(make(spec))
    return Room(spec, kind, frozenset(names), "skew" in more, "square" in more)


def choose(camera: Any, models: Sequence[str], title: str) -> tuple[str, Terms]:
    """The first of a format's models that represents a camera exactly.

    Returns
    -------
    spec : str
        The entry of `models`.
    terms : Terms
        The camera in the terms of that model.

    Raises
    ------
    UsageError
        Naming the terms, or the model, that the format has no room for.
    """
    described = descriptions(camera)
    closest: list[str] | None = None
    for text in models:
        place = room(text)
        for terms in described:
            if terms.kind != place.kind:
                continue
            lacks = place.lacks(terms)
            if not lacks:
                return text, terms
            if closest is None or len(lacks) < len(closest):
                closest = lacks
    raise _no_room(camera.lens, closest, models, title)


def _no_room(lens: Lens, lacks: list[str] | None, models: Sequence[str], title: str) -> UsageError:
    specs = list(dict.fromkeys(m.partition("+")[0] for m in models))
    if lacks is None:
        kind = canonical(lens)[0]
        what = KINDS.get(kind, f"the model '{lens.name}'")
        message = f"{title} cannot hold {what}: the camera is {lens.name}."
    else:
        message = f"{title} cannot hold {', '.join(lacks)} of this camera ({lens.name})."
    shown = specs if len(specs) <= NAMED else [*specs[:NAMED], "..."]
    return UsageError(message, f"Refit it, with the error printed: --to-model NAME ({', '.join(shown)}).")


def camera_of(
    spec: str, matrix: Iterable[float], size: tuple[int, int] | None, values: Mapping[str, float]
) -> Camera:
    """A camera of a lens from fx, fy, cx, cy, skew and the values of its terms.

    Terms are named as in this module; the skew is a parameter only where it is not 0.
    """
    fx, fy, cx, cy, skew = (float(v) for v in matrix)
    lens = make(spec, skew=skew != 0)
    own = {p.name for p in lens.parameters if p.group == "distortion"}
    _, names = canonical(lens)
    by_term = dict(zip(names, (p.name for p in lens.parameters if p.group == "distortion"), strict=True))
    given = {by_term[n]: float(v) for n, v in values.items()}
    params = lens.from_values(
        {"fx": fx, "fy": fy, "cx": cx, "cy": cy, "skew": skew} | dict.fromkeys(own, 0.0) | given
    )
    return Camera(lens, params, size)


def polynomial(
    matrix: Iterable[float],
    size: tuple[int, int] | None,
    k: Sequence[float] = (),
    p: Sequence[float] = (),
    *,
    denominator: Sequence[float] = (),
    prism: Sequence[float] = (),
    tilt: Sequence[float] = (),
    centre: Sequence[float] = (),
) -> Camera:
    """A camera with Brown's terms in OpenCV's order, of the smallest lens model that contains them.

    Parameters
    ----------
    matrix : fx, fy, cx, cy, skew
    k : radial terms k1, k2, ...
    p : p1, p2 (p1 acts on y: OpenCV's order), p3, ...
    denominator, prism, tilt : terms of opencv8, opencv12 and opencv14
    centre : (xc, yc), the distortion centre less the principal point, in focal lengths
    """
    values = {f"k{i + 1}": v for i, v in enumerate(k)} | {f"p{i + 1}": v for i, v in enumerate(p)}
    values |= dict(zip(("d1", "d2", "d3"), denominator, strict=False))
    values |= dict(zip(("s1", "s2", "s3", "s4"), prism, strict=False))
    values |= dict(zip(("tauX", "tauY"), tilt, strict=False)) | dict(zip(("xc", "yc"), centre, strict=False))
    needed = {n: float(v) for n, v in values.items() if v != 0}
    return camera_of(_smallest(needed, len(k), len(p)), matrix, size, needed)


def _smallest(needed: Mapping[str, float], radial: int, decentering: int) -> str:
    """The spec of the smallest model: OpenCV's if they contain all terms, otherwise Brown's."""
    if not radial and not decentering and not needed:
        return "pinhole"
    order = ("opencv4", "opencv5", "opencv8", "opencv12", "opencv14")
    for spec in order if radial != 3 else order[1:]:
        if set(needed) <= set(canonical(make(spec))[1]):
            return spec
    most = max((int(n[1:]) for n in needed if n[0] == "k"), default=0)
    last = max((int(n[1:]) for n in needed if n[0] == "p"), default=0)
    spec = f"brown:radial={most},decentering={max(last - 1, 0)}"
    spec += ",prism=1" * any(n in needed for n in ("s1", "s3"))
    return spec + ",centre=free" * ("xc" in needed or "yc" in needed)


def fisheye(matrix: Iterable[float], size: tuple[int, int] | None, k: Sequence[float] | np.ndarray) -> Camera:
    """A Kannala-Brandt camera: `kb4` for four terms, otherwise `kb:n`."""
    spec = "kb4" if len(k) == 4 else f"kb:{len(k)}"
    return camera_of(spec, matrix, size, {f"k{i + 1}": v for i, v in enumerate(k)})


def unified(
    matrix: Iterable[float], size: tuple[int, int] | None, xi: float, bend: Sequence[float] | np.ndarray = ()
) -> Camera:
    """A camera of Mei's model: xi, then k1, k2, p1, p2."""
    return camera_of(
        "mei", matrix, size, {"xi": xi} | dict(zip(("k1", "k2", "p1", "p2"), bend, strict=False))
    )
