"""A `dataclass` decorator like that of the standard library, four times as fast: a command defines some 150 of them.

The standard one compiles up to six functions for each class. Here a class has its own `__init__` alone; the other
methods are the same functions for all classes, which look the fields up. What reads fields (`replace`, `fields`,
`asdict`, `is_dataclass`) is the standard library's.
"""

from __future__ import annotations

import dataclasses
from dataclasses import MISSING, FrozenInstanceError
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # to type checkers it is the standard one
    from dataclasses import dataclass as dataclass
else:

    def dataclass(cls=None, /, *, frozen=False, eq=True, repr=True, kw_only=False):
        """Decorate a class; the options are those of `dataclasses.dataclass`."""

        def decorated(cls: type) -> type:
            own = cls.__dict__
            shown, compared = "__repr__" in own, "__eq__" in own
            # Python itself writes None where a class defines `__eq__` alone
            hashed = "__hash__" in own and not (own["__hash__"] is None and compared)
            bases = [vars(b) for b in cls.__mro__[1:]]
            inherited = [b["__dataclass_params__"] for b in bases if "__dataclass_params__" in b]
            were = [params.frozen for params in inherited]
            for params in inherited:
                params.frozen = (
                    False  # they refuse by methods that are inherited, and no `__init__` is made here
                )
            cls = dataclasses.dataclass(cls, init=False, repr=False, eq=False, kw_only=kw_only)
            for params, was in zip(inherited, were, strict=True):
                params.frozen = was
            if "__init__" not in own:
                cls.__init__ = _made_init(cls)
            if repr and not shown:
                cls.__repr__ = _repr
            if eq and not compared:
                cls.__eq__ = _eq
            if eq and not hashed:
                cls.__hash__ = _hash if frozen else None
            if frozen:
                cls.__setattr__, cls.__delattr__ = _refuse_to_set, _refuse_to_delete
                cls.__dataclass_params__.frozen = (
                    True  # so that a frozen one of the standard library may derive
                )
            return cls

        return decorated if cls is None else decorated(cls)


def _made_init(cls: type) -> Any:
    """The `__init__` of a class, which bypasses a `__setattr__` that refuses assignments."""
    defaults: dict[str, Any] = {}
    first, named, lines = ["self"], list[str](), ["_record = self.__dict__"]
    for f in dataclasses.fields(cls):
        value = f.name
        if f.default_factory is not MISSING:
            defaults[f"_of_{f.name}"] = f.default_factory
            value = f"_of_{f.name}()"
            value = f"{value} if {f.name} is _missing else {f.name}" if f.init else value
        elif not f.init:
            continue  # a default is the class's own attribute
        if f.init:
            default = ""
            if f.default_factory is not MISSING:
                default = " = _missing"
            elif f.default is not MISSING:
                defaults[f"_of_{f.name}"] = f.default
                default = f" = _of_{f.name}"
            (named if f.kw_only else first).append(f.name + default)
        lines.append(f"_record[{f.name!r}] = {value}")
    if hasattr(cls, "__post_init__"):
        lines.append("self.__post_init__()")
    words = ", ".join([*first, *(["*", *named] if named else [])])
    source = f"def __init__({words}):\n " + "\n ".join(lines)
    scope: dict[str, Any] = {**defaults, "_missing": MISSING}
    exec(source, scope)  # of the names of fields alone, as the standard library does it
    made = scope["__init__"]
    made.__qualname__, made.__module__ = f"{cls.__qualname__}.__init__", cls.__module__
    made.__annotations__ = {f.name: f.type for f in dataclasses.fields(cls) if f.init} | {"return": None}
    return made


def _repr(self: Any) -> str:
    shown = (f"{f.name}={getattr(self, f.name)!r}" for f in dataclasses.fields(self) if f.repr)
    return f"{type(self).__qualname__}({', '.join(shown)})"


def _compared(self: Any) -> tuple[Any, ...]:
    return tuple(getattr(self, f.name) for f in dataclasses.fields(self) if f.compare)


def _eq(self: Any, other: object) -> bool:
    return _compared(self) == _compared(other) if type(other) is type(self) else NotImplemented


def _hash(self: Any) -> int:
    values = (
        getattr(self, f.name) for f in dataclasses.fields(self) if (f.compare if f.hash is None else f.hash)
    )
    return hash(tuple(values))


def _is_frozen(self: Any, name: str) -> bool:
    """Return whether an attribute is read-only; those that a plain subclass adds to a frozen class are not."""
    return "__dataclass_params__" in vars(type(self)) or name in type(self).__dataclass_fields__


def _refuse_to_set(self: Any, name: str, value: object) -> None:
    if _is_frozen(self, name):
        raise FrozenInstanceError(f"cannot assign to field {name!r}")
    object.__setattr__(self, name, value)


def _refuse_to_delete(self: Any, name: str) -> None:
    if _is_frozen(self, name):
        raise FrozenInstanceError(f"cannot delete field {name!r}")
    object.__delattr__(self, name)
