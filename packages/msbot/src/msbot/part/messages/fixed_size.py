"""Messages of a fixed size, packed and unpacked in one go: much cheaper for a `Twist` than its six numbers one by one.

A message whose fields are all numbers and booleans, also inside nested messages, has the same octets at the same places
every time, so one `struct.Struct` with the padding of CDR in it does all the work. Anything out of the ordinary is left
to the slower way, field by field, which has the error messages for it.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
from operator import attrgetter
from typing import TypeAlias

from msbot_xrce.common.lazy_dataclass import dataclass

Leaf: TypeAlias = tuple[str, str]
"""Path of a number inside a message (`linear.x`), and its code in a `struct` format."""
Branch: TypeAlias = "tuple[type, tuple[tuple[str, int | Branch], ...]]"
"""A message class, and for each field the index of its value, or a nested message."""


@dataclass(frozen=True, slots=True)
class FixedSize:
    """How every message of one class looks on the wire."""

    leaves: tuple[Leaf, ...]
    """The numbers in the order of the wire."""
    tree: Branch
    layout: struct.Struct
    get: Callable[[object], tuple[object, ...]]
    """The values of a message in the order of the wire."""
    booleans: tuple[int, ...]
    """Offsets of octets that may only be 0 or 1."""

    def encode(self, message: object) -> bytes | None:
        """The message as CDR; None when a value does not fit."""
        try:
            return self.layout.pack(*self.get(message))
        except (struct.error, OverflowError):
            return None

    def decode(self, data: bytes) -> object | None:
        """The message at the beginning of the octets; None when they cannot be one."""
        if len(data) < self.layout.size:
            return None
        for offset in self.booleans:
            if data[offset] > 1:
                return None
        return _grow(self.tree, self.layout.unpack_from(data))


def fixed_size(cls: type, fields: Mapping[str, str | FixedSize | None]) -> FixedSize | None:
    """How the messages of a class look on the wire; None when their size is not fixed.

    Args:
        cls: the class.
        fields: for each field its code in a `struct` format, or a nested message, or None for anything else.
    """
    leaves: list[Leaf] = []
    branch: list[tuple[str, int | Branch]] = []
    for name, inside in fields.items():
        if inside is None:
            return None
        if isinstance(inside, str):
            branch.append((name, len(leaves)))
            leaves.append((name, inside))
        else:
            branch.append((name, _moved(inside.tree, len(leaves))))
            leaves += [(f"{name}.{path}", code) for path, code in inside.leaves]
    if not leaves:
        return None
    layout, booleans = _layout(leaves)
    return FixedSize(tuple(leaves), (cls, tuple(branch)), layout, _getter(leaves), booleans)


def _layout(leaves: list[Leaf]) -> tuple[struct.Struct, tuple[int, ...]]:
    form, offset, booleans = "<", 0, []
    for _, code in leaves:
        size = struct.calcsize(f"<{code}")
        padding = -offset % size
        form += "x" * padding + code
        offset += padding
        if code == "?":
            booleans.append(offset)
        offset += size
    return struct.Struct(form), tuple(booleans)


def _getter(leaves: list[Leaf]) -> Callable[[object], tuple[object, ...]]:
    get = attrgetter(*(path for path, _ in leaves))
    return get if len(leaves) > 1 else lambda message: (get(message),)


def _moved(tree: Branch, by: int) -> Branch:
    cls, fields = tree
    return cls, tuple((name, at + by if isinstance(at, int) else _moved(at, by)) for name, at in fields)


def _grow(tree: Branch, values: tuple[object, ...]) -> object:
    cls, fields = tree
    message: object = object.__new__(cls)
    inside = message.__dict__  # values from the wire always fit: no need to check each one when it is set
    for name, at in fields:
        inside[name] = values[at] if type(at) is int else _grow(at, values)  # type: ignore[arg-type]
    return message
