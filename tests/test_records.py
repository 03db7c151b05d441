"""The decorator `dataclass` of camcal, beside that of the standard library."""

from __future__ import annotations

import copy
import dataclasses
import inspect
import pickle
from collections.abc import Callable
from dataclasses import FrozenInstanceError, asdict, field, fields, replace
from typing import Any

import pytest

from camcal.records import dataclass


def made_by(decorator: Callable[..., Any], **options: bool) -> type:
    """A class with every form of field."""

    class Point:
        x: float
        y: float = 2.0
        names: list[str] = field(default_factory=list)
        values: int = field(default=3, repr=False, compare=False)
        derived: float = field(default=0.0, init=False)

        def __post_init__(self) -> None:
            object.__setattr__(self, "derived", self.x + self.y)

    Point.__qualname__ = Point.__name__ = "Point"
    return decorator(**options)(Point)


OPTIONS = [
    {},
    {"frozen": True},
    {"frozen": True, "kw_only": True},
    {"eq": False, "repr": False, "frozen": True},
]


@pytest.mark.parametrize("options", OPTIONS, ids=str)
def test_is_what_the_standard_decorator_makes(options: dict[str, bool]) -> None:
    own, standard = made_by(dataclass, **options), made_by(dataclasses.dataclass, **options)
    assert list(inspect.signature(own).parameters) == list(inspect.signature(standard).parameters)
    kinds = [[p.kind for p in inspect.signature(c).parameters.values()] for c in (own, standard)]
    assert kinds[0] == kinds[1]
    assert [f.name for f in fields(own)] == [f.name for f in fields(standard)]
    a, b = own(x=1.0, names=["a"]), standard(x=1.0, names=["a"])
    assert asdict(a) == asdict(b) == {"x": 1.0, "y": 2.0, "names": ["a"], "values": 3, "derived": 3.0}
    assert asdict(replace(a, y=5.0)) == asdict(replace(b, y=5.0))
    assert own(x=1.0).names is not own(x=1.0).names
    if options.get("repr", True):
        assert repr(a) == repr(b) == "Point(x=1.0, y=2.0, names=['a'], derived=3.0)"
    assert (own(x=1.0) == own(x=1.0, values=4)) is (standard(x=1.0) == standard(x=1.0, values=4))
    assert own(x=1.0) != own(x=2.0) and own(x=1.0) != 1
    with pytest.raises(TypeError, match="missing 1 required"):
        own()
    if options.get("frozen"):
        with pytest.raises(FrozenInstanceError, match="cannot assign to field 'x'"):
            a.x = 2.0
        with pytest.raises(FrozenInstanceError, match="cannot delete field 'x'"):
            del a.x
    else:
        a.x = 2.0
        assert a.x == 2.0


def test_hashes_as_the_standard_decorator_does() -> None:
    @dataclass(frozen=True)
    class Frozen:
        x: int = 1

    @dataclass
    class Changing:
        x: int = 1

    assert len({Frozen(), Frozen(), Frozen(2)}) == 2
    with pytest.raises(TypeError, match="unhashable"):
        hash(Changing())


@dataclass(frozen=True)
class Base:
    """Of a package."""

    x: int

    def __repr__(self) -> str:
        return "a base"


@dataclass(frozen=True, kw_only=True)
class Derived(Base):
    """With a field more."""

    y: int = 2


@dataclasses.dataclass(frozen=True)
class Outside(Base):
    """As a program that extends camcal may write it."""

    y: int = 3


def test_derived_classes() -> None:
    assert (Derived(1, y=4).x, Derived(1).y) == (1, 2)
    assert "y=2" in repr(Derived(1)) and repr(Base(1)) == "a base"
    assert asdict(Outside(1)) == {"x": 1, "y": 3}
    for each in (Derived(1), Outside(1)):
        with pytest.raises(FrozenInstanceError, match="cannot assign"):
            each.x = 2  # type: ignore[misc]
        assert copy.deepcopy(each) == each == pickle.loads(pickle.dumps(each))


class Plain(Base):
    """Not decorated, with attributes of its own."""

    def __init__(self, x: int):
        super().__init__(x)
        self.name = "plain"


def test_a_plain_class_derives_as_from_the_standard_decorator() -> None:
    @dataclass(frozen=True)
    class Below(Plain):
        y: int = 2

    assert asdict(Below(1)) == {"x": 1, "y": 2}
    made = Plain(1)
    made.name = "other"
    del made.name
    for change in (
        lambda: setattr(made, "x", 2),
        lambda: delattr(made, "x"),
        lambda: setattr(Base(1), "name", 2),
    ):
        with pytest.raises(FrozenInstanceError):
            change()


def test_an_own_comparison_leaves_a_frozen_class_its_hash() -> None:
    def equal(self: object, other: object) -> bool:
        return type(self) is type(other)

    for decorator in (dataclass, dataclasses.dataclass):
        made = decorator(frozen=True)(type("Alike", (), {"__annotations__": {"x": int}, "__eq__": equal}))
        assert made(1) == made(2) and hash(made(1)) == hash(made(1))
