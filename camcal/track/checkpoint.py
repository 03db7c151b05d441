"""Checkpoints: all that is needed to go on after a kill as if nothing had happened, to the last bit.

A checkpoint is one JSON document. Arrays are stored as the base64 text of their bytes; floats as the
shortest text that reads back as the same number.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Literal

import numpy as np

from camcal.data.writing import atomic_write, sweep
from camcal.errors import DataError, UsageError
from camcal.track.base import State
from camcal.track.decompose import Cameras
from camcal.track.events import Alarm
from camcal.track.model import Model

SCHEMA = "camcal-track-state/1"
_ARRAY = "__array__"


def save(path: Path, content: Mapping[str, Any]) -> None:
    """Write a checkpoint; the file is the old one or the new one at every moment."""
    text = json.dumps({"schema": SCHEMA, **content}, default=_encode)
    atomic_write(path, text, force=True)


def load(path: Path) -> dict[str, Any]:
    """Read a checkpoint; what a run that was killed while it wrote one has left is removed.

    Raises
    ------
    DataError
        Where the file is not one.
    """
    sweep(path)
    try:
        content = json.loads(path.read_text(encoding="utf-8"), object_hook=_decode)
    except (ValueError, UnicodeDecodeError) as error:
        raise DataError(
            f"{path}: not a state of `camcal track` ({error}).", "Choose another --state."
        ) from None
    if not isinstance(content, dict) or content.get("schema") != SCHEMA:
        raise DataError(
            f"{path}: not a state of `camcal track`; {SCHEMA} is needed.", "Choose another --state."
        )
    return content


def require_same(path: Path, saved: Mapping[str, Any], now: Mapping[str, Any]) -> None:
    """Refuse to go on with other options than those that the checkpoint was made with."""
    saved, now = (json.loads(json.dumps(d, default=_encode)) for d in (saved, now))
    for name, value in now.items():
        if saved.get(name) != value:
            raise UsageError(
                f"{path}: the state was made with {name} = {saved.get(name)!r}, not {value!r}.",
                "Use the same options, or begin anew with another --state.",
            )


def _encode(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        # the memory order is kept: BLAS adds in another order on the transposed layout
        order: Literal["F", "C"] = "F" if value.flags.f_contiguous and not value.flags.c_contiguous else "C"
        text = base64.b64encode(value.tobytes(order)).decode("ascii")
        return {_ARRAY: text, "dtype": value.dtype.str, "shape": list(value.shape), "order": order}
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"a {type(value).__name__} has no place in a checkpoint")


def _decode(value: dict[str, Any]) -> Any:
    if _ARRAY not in value:
        return value
    data = np.frombuffer(base64.b64decode(value[_ARRAY]), np.dtype(value["dtype"]))
    return data.reshape(value["shape"], order=value["order"]).copy("K")


def round_trip(content: Mapping[str, Any]) -> dict[str, Any]:
    """What `load` gives after `save`, without a file."""
    return json.loads(json.dumps(content, default=_encode), object_hook=_decode)


def pack_alarm(alarm: Alarm) -> dict[str, Any]:
    """An alarm as a dict that a checkpoint takes."""
    return asdict(alarm)


def unpack_alarm(packed: Mapping[str, Any]) -> Alarm:
    """The alarm of `pack_alarm`."""

    def cameras(one: Mapping[str, Any]) -> Cameras:
        return Cameras(**{**one, "extra_names": tuple(one["extra_names"])})

    return Alarm(**{**packed, "before": cameras(packed["before"]), "after": cameras(packed["after"])})


def pack_states(states: Sequence[State], model: Model) -> list[dict[str, Any]]:
    """States as dicts that a checkpoint takes."""
    packed = []
    for state in states:
        one = {name: getattr(state, name) for name in State.__slots__}
        one["estimate"] = None if state.estimate is None else model.pack(state.estimate)
        one["alarm"] = None if state.alarm is None else pack_alarm(state.alarm)
        packed.append(one)
    return packed


def unpack_states(packed: Sequence[Mapping[str, Any]], model: Model) -> list[State]:
    """The states of `pack_states`."""
    states = []
    for one in packed:
        state = State(**one)
        state.estimate = None if one["estimate"] is None else model.unpack(one["estimate"])
        state.alarm = None if one["alarm"] is None else unpack_alarm(one["alarm"])
        states.append(state)
    return states
