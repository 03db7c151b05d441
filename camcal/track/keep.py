"""The contents of checkpoints: objects name the attributes that make up their state, stored as JSON.

Arrays are stored as the base64 text of their bytes, floats as the shortest text that reads back as the same
number, so that a restored run gives the same bits.
"""

from __future__ import annotations

import base64
import dataclasses
from collections.abc import Mapping
from typing import Any, ClassVar, Literal, TypeVar

import numpy as np

_ARRAY, _VALUE = "__array__", "__value__"
_VALUES: dict[str, tuple[type, tuple[str, ...]]] = {}

T = TypeVar("T", bound=type)


def stored(cls: T) -> T:
    """Class decorator that lets a checkpoint store values of a dataclass or a NamedTuple."""
    names = getattr(cls, "_fields", None) or tuple(f.name for f in dataclasses.fields(cls))
    _VALUES[cls.__name__] = cls, names
    return cls


class Kept:
    """An object that a checkpoint stores and restores.

    Attributes
    ----------
    kept : tuple of str
        The attributes that change while frames are processed; those of base classes are added.
    """

    kept: ClassVar[tuple[str, ...]] = ()

    def state(self) -> dict[str, Any]:
        """The values of all kept attributes by name; of a `Kept` attribute, its own state."""
        values = {name: getattr(self, name) for name in self._names()}
        return {name: v.state() if isinstance(v, Kept) else v for name, v in values.items()}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Restore a state returned by `state`."""
        if set(state) != set(self._names()):
            raise ValueError(f"{', '.join(sorted(set(state) ^ set(self._names())))} of {type(self).__name__}")
        for name in self._names():
            own = getattr(self, name)
            if isinstance(own, Kept):
                own.restore(state[name])
            elif not _alike(own, state[name]):
                raise ValueError(f"{name} of {type(self).__name__} is a {type(state[name]).__name__}")
            else:
                setattr(self, name, state[name])

    @classmethod
    def _names(cls) -> list[str]:
        return [name for base in reversed(cls.__mro__) for name in vars(base).get("kept", ())]


def _alike(own: Any, given: Any) -> bool:
    """Return whether a value may replace `own` in an object that has not seen a frame."""
    if own is None or given is None:
        return True
    for kind in ((bool, int, float, np.generic), str, (list, tuple), Mapping, np.ndarray):
        if isinstance(own, kind):
            return isinstance(given, kind)
    return isinstance(given, type(own))


def pack(value: Any) -> Any:
    """Convert a value into one that `json.dumps` accepts.

    Raises
    ------
    TypeError
        For a type that is neither plain, an array, nor `stored`.
    """
    if isinstance(value, np.ndarray):
        # the memory order is kept: BLAS adds in another order on the transposed layout
        order: Literal["F", "C"] = "F" if value.flags.f_contiguous and not value.flags.c_contiguous else "C"
        text = base64.b64encode(value.tobytes(order)).decode("ascii")
        return {_ARRAY: text, "dtype": value.dtype.str, "shape": list(value.shape), "order": order}
    cls, names = _VALUES.get(type(value).__name__, (None, ()))
    if cls is type(value):
        return {_VALUE: cls.__name__, **{name: pack(getattr(value, name)) for name in names}}
    if isinstance(value, Mapping):
        return {name: pack(part) for name, part in value.items()}
    if isinstance(value, list | tuple):
        return [pack(part) for part in value]
    if isinstance(value, np.generic):
        return value.item()
    if value is None or isinstance(value, str | int | float):
        return value
    raise TypeError(f"a checkpoint cannot hold a {type(value).__name__}")


def unpack(packed: dict[str, Any]) -> Any:
    """Rebuild one JSON object made by `pack`; the `object_hook` of `json.loads`."""
    if _ARRAY in packed:
        kind = np.dtype(packed["dtype"])
        if kind.kind not in "biuf":
            raise ValueError(f"an array of {kind}")
        data = np.frombuffer(base64.b64decode(packed[_ARRAY]), kind)
        return data.reshape(packed["shape"], order=packed["order"]).copy("K")
    if _VALUE in packed:
        cls, _ = _VALUES[packed.pop(_VALUE)]
        return cls(**packed)
    return packed
