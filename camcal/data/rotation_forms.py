"""Representations of a rotation by robots: a rotation vector, a quaternion, or three angles about axes in some order.

A sequence such as `zyx` is R = Rz(first) Ry(second) Rx(third): turns about axes that move along. `fixed-xyz` is
R = Rz(third) Ry(second) Rx(first): turns about axes that stay, with the numbers in the same order as the axes.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import permutations

import numpy as np

from camcal.geometry import rotations as so3
from camcal.records import dataclass

Array = np.ndarray


@dataclass(frozen=True)
class Form:
    """One representation of a rotation.

    Attributes
    ----------
    name : str
    kind : {"vector", "quaternion", "angles"}
    order : str
        Of angles the axes as they are applied from the left to the right of the product; of a quaternion the
        meaning of the four numbers in turn, such as `wxyz`.
    degrees : bool
    fixed : bool
        Angles about axes that stay: the product is in reverse order.
    """

    name: str
    kind: str
    order: str = ""
    degrees: bool = False
    fixed: bool = False

    @property
    def count(self) -> int:
        """The number of values."""
        return 4 if self.kind == "quaternion" else 3

    def rotations(self, numbers: Array) -> Array:
        """Rotation matrices (N, 3, 3) of numbers (N, 3 or 4)."""
        values = np.asarray(numbers, float)
        if self.kind == "quaternion":
            return so3.from_quaternion(values[:, [self.order.index(name) for name in "wxyz"]])
        values = np.radians(values) if self.degrees else values
        if self.kind == "vector":
            return so3.exp(values)
        turns = [
            so3.exp(np.outer(v, np.eye(3)["xyz".index(axis)]))
            for v, axis in zip(values.T, self.order, strict=True)
        ]
        first, second, third = turns[::-1] if self.fixed else turns
        return first @ second @ third


def _angles(order: str) -> list[Form]:
    return [
        Form(
            ("fixed-" if fixed else "") + order + ("-deg" if degrees else "-rad"),
            "angles",
            order,
            degrees,
            fixed,
        )
        for fixed in ((False, True) if order == "xyz" else (False,))
        for degrees in (True, False)
    ]


#: every form by name, the likelier ones first
FORMS: dict[str, Form] = {
    f.name: f
    for f in (
        Form("vector", "vector"),
        Form("vector-deg", "vector", degrees=True),
        Form("quaternion-wxyz", "quaternion", "wxyz"),
        Form("quaternion-xyzw", "quaternion", "xyzw"),
        *(
            Form(f"quaternion-{order}", "quaternion", order)
            for order in map("".join, permutations("wxyz"))
            if order not in ("wxyz", "xyzw")
        ),
        *_angles("zyx"),
        *_angles("xyz"),
        *_angles("zyz"),
    )
}


def candidates(count: int, first: str | None = None) -> Sequence[Form]:
    """The representations with `count` numbers, the one named `first` before the others."""
    found = [f for f in FORMS.values() if f.count == count]
    return sorted(found, key=lambda f: f.name != first)


#: what the makers of robots write -> the form
VENDORS = {
    "abb": "quaternion-wxyz",
    "fanuc": "fixed-xyz-deg",
    "kawasaki": "zyz-deg",
    "kuka": "zyx-deg",
    "staubli": "xyz-deg",
    "ur": "vector",
    "yaskawa": "fixed-xyz-deg",
}


def form_of(name: str) -> Form:
    """The representation of that name, or that of a manufacturer."""
    return FORMS[VENDORS.get(name, name)]
