"""Dataclasses whose methods are compiled at first use.

Python's own decorator writes the source of six methods for each class and compiles it, whenever a program starts: for
the six hundred classes of a robot that was a seventh of its start, and most of these methods are never called. What
such a class is stays Python's business (`fields`, `replace`, `asdict` and `match` work); only the methods come later,
and then they are the same.
"""

from __future__ import annotations

import dataclasses
import importlib
import sys
from collections.abc import Callable, Mapping, Sequence
from reprlib import recursive_repr
from typing import TYPE_CHECKING, Any
from weakref import WeakSet

if TYPE_CHECKING:
    from inspect import Signature

__all__ = ["dataclass", "lazy_face"]


class _Made:
    def __repr__(self) -> str:
        return "<factory>"


_MADE = _Made()
"""The default of an argument whose value a factory makes."""
_FROZEN: WeakSet[type] = WeakSet()


class _LateSignature:
    """What `inspect.signature` and `help` show of a class: its fields, not those of a method that is yet to come."""

    def __get__(self, one: object, cls: type) -> Signature:
        maker = next(each for each in cls.__mro__ if "__init__" in each.__dict__)
        if one is not None or not getattr(maker.__dict__["__init__"], _IS_MADE_HERE, False):
            raise AttributeError("__signature__")  # then `inspect` looks at the method
        return _signature(maker)


_IS_MADE_HERE = "_msbot_made_here"
_LATE_SIGNATURE = _LateSignature()


def _signature(cls: type) -> Signature:
    import inspect  # nobody else here needs it

    kinds = (inspect.Parameter.POSITIONAL_OR_KEYWORD, inspect.Parameter.KEYWORD_ONLY)
    arguments = []
    for each in sorted((one for one in _fields(cls) if one.init), key=lambda one: bool(one.kw_only)):
        default = each.default
        if default is dataclasses.MISSING:
            default = inspect.Parameter.empty if each.default_factory is dataclasses.MISSING else _MADE
        kind = kinds[bool(each.kw_only)]
        arguments.append(inspect.Parameter(each.name, kind, default=default, annotation=each.type))
    return inspect.Signature(arguments, return_annotation=None)


def _decorated(cls: type, *, frozen: bool, slots: bool, eq: bool) -> type:
    own = cls.__dict__
    compiled = [name for name in ("__init__", "__eq__") if name not in own]
    explicit_hash = "__hash__" in own and not (own["__hash__"] is None and "__eq__" in own)
    if not eq:
        compiled = [name for name in compiled if name != "__eq__"]
    elif not explicit_hash and frozen:
        compiled.append("__hash__")
    _refuse_mixture(cls, frozen=frozen)
    if not own.get("__doc__"):
        cls.__doc__ = cls.__name__  # Python would make one of the signature, which takes longer than all the rest
    made: type = dataclasses.dataclass(init=False, repr=False, eq=False, slots=slots)(cls)
    if "__repr__" not in own:
        made.__repr__ = _shown  # type: ignore[assignment]
    if eq and not frozen and not explicit_hash:
        made.__hash__ = None  # type: ignore[assignment]
    if frozen:
        _FROZEN.add(made)
        _freeze(made)
    for name in compiled:
        setattr(made, name, _late(made, name, compiled))
    made.__signature__ = _LATE_SIGNATURE  # type: ignore[attr-defined]
    return made


def _refuse_mixture(cls: type, *, frozen: bool) -> None:
    for base in cls.__mro__[1:]:
        if dataclasses.is_dataclass(base) and (base in _FROZEN) is not frozen:
            kinds = ("frozen", "not frozen") if frozen else ("not frozen", "frozen")
            raise TypeError(f"{cls.__qualname__} is {kinds[0]} and its base {base.__qualname__} is {kinds[1]}")


def _late(cls: type, name: str, all_names: Sequence[str]) -> Callable[..., object]:
    """The method until it is called: it compiles what the class needs, which takes its place."""

    def method(self: object, /, *args: object, **named: object) -> object:
        for one, function in _compiled(cls, all_names).items():
            setattr(cls, one, function)
        return getattr(cls, name)(self, *args, **named)

    method.__name__, method.__qualname__ = name, f"{cls.__qualname__}.{name}"
    setattr(method, _IS_MADE_HERE, True)
    return method


def _compiled(cls: type, names: Sequence[str]) -> Mapping[str, Callable[..., object]]:
    sources = {"__init__": _init_source, "__eq__": _eq_source, "__hash__": _hash_source}
    space: dict[str, Any] = {"_MADE": _MADE, "_set": object.__setattr__}
    exec("\n".join(sources[name](cls, space) for name in names), space)  # noqa: S102 - the names of fields only
    for name in names:
        space[name].__qualname__, space[name].__module__ = f"{cls.__qualname__}.{name}", cls.__module__
        setattr(space[name], _IS_MADE_HERE, True)
    return {name: space[name] for name in names}


def _init_source(cls: type, space: dict[str, Any]) -> str:
    is_frozen = cls in _FROZEN
    plain: list[str] = []
    named: list[str] = []
    body: list[str] = []
    for each in _fields(cls):
        name, value = each.name, each.name
        has_default, has_factory = (one is not dataclasses.MISSING for one in (each.default, each.default_factory))
        space[f"_default_{name}"] = each.default_factory if has_factory else each.default
        if each.init:
            default = "=_MADE" if has_factory else f"=_default_{name}" if has_default else ""
            (named if each.kw_only else plain).append(name + default)
            if has_factory:
                value = f"_default_{name}() if {name} is _MADE else {name}"
        elif has_factory:
            value = f"_default_{name}()"
        elif has_default and "__slots__" in cls.__dict__:
            value = f"_default_{name}"
        else:
            continue
        body.append(f" _set(self, {name!r}, {value})" if is_frozen else f" self.{name} = {value}")
    if hasattr(cls, "__post_init__"):
        body.append(" self.__post_init__()")
    arguments = ", ".join(["self", *plain, *(["*", *named] if named else [])])
    return "\n".join([f"def __init__({arguments}):", *(body or [" pass"])])


def _eq_source(cls: type, space: dict[str, Any]) -> str:  # noqa: ARG001 - as the others
    compared = [each.name for each in _fields(cls) if each.compare]
    return (
        "def __eq__(self, other):\n"
        " if other.__class__ is self.__class__:\n"
        f"  return {_values('self', compared)} == {_values('other', compared)}\n"
        " return NotImplemented"
    )


def _hash_source(cls: type, space: dict[str, Any]) -> str:  # noqa: ARG001 - as the others
    hashed = [each.name for each in _fields(cls) if (each.compare if each.hash is None else each.hash)]
    return f"def __hash__(self):\n return hash({_values('self', hashed)})"


def _fields(one: Any) -> tuple[dataclasses.Field[Any], ...]:  # noqa: ANN401 - a class or an object of it
    return dataclasses.fields(one)


def _values(of: str, names: Sequence[str]) -> str:
    return f"({''.join(f'{of}.{name}, ' for name in names)})"


@recursive_repr()
def _shown(self: object) -> str:
    values = (f"{each.name}={getattr(self, each.name)!r}" for each in _fields(self) if each.repr)
    return f"{self.__class__.__qualname__}({', '.join(values)})"


def _freeze(cls: Any) -> None:  # noqa: ANN401 - `super` takes no `type`
    names = frozenset(each.name for each in _fields(cls))

    def set_attribute(self: object, name: str, value: object) -> None:
        if type(self) is cls or name in names:
            raise dataclasses.FrozenInstanceError(f"cannot assign to field {name!r}")
        super(cls, self).__setattr__(name, value)

    def delete_attribute(self: object, name: str) -> None:
        if type(self) is cls or name in names:
            raise dataclasses.FrozenInstanceError(f"cannot delete field {name!r}")
        super(cls, self).__delattr__(name)

    methods: dict[str, Callable[..., object]] = {"__setattr__": set_attribute, "__delattr__": delete_attribute}
    if "__slots__" in cls.__dict__ and "__getstate__" not in cls.__dict__:
        methods |= {"__getstate__": _values_of, "__setstate__": _with_values}
    for name, method in methods.items():
        setattr(cls, name, method)


def _values_of(self: object) -> list[object]:
    """What `copy` and `pickle` keep."""
    return [getattr(self, each.name) for each in _fields(self)]


def _with_values(self: object, values: Sequence[object]) -> None:
    for each, value in zip(_fields(self), values, strict=True):
        object.__setattr__(self, each.name, value)


if TYPE_CHECKING:
    from dataclasses import dataclass
else:

    def dataclass(
        cls: type | None = None, /, *, frozen: bool = False, slots: bool = False, eq: bool = True
    ) -> type | Callable[[type], type]:
        """As `dataclasses.dataclass`, with those of its options that are used here; no `InitVar`.

        Raises:
            TypeError: a frozen class is built on one that is not, or the other way round; or as Python's own.
        """
        if cls is not None:
            return _decorated(cls, frozen=frozen, slots=slots, eq=eq)
        return lambda found: _decorated(found, frozen=frozen, slots=slots, eq=eq)


# Packages whose names are imported on first use, so that using one of them does not load them all.


def lazy_face(package: str, names: Mapping[str, tuple[str, ...]]) -> Callable[[str], object]:
    """Make the `__getattr__` of a package (PEP 562).

    Args:
        package: the package's name.
        names: module of the package -> the names that come from there.
    """
    where = {name: module for module, found in names.items() for name in found}

    def find(name: str) -> object:
        if name not in where:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        value = getattr(importlib.import_module(where[name]), name)
        setattr(sys.modules[package], name, value)  # asked once
        return value

    return find
