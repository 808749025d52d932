"""Generated Python as a module, and random messages of its classes."""

from __future__ import annotations

import sys
import types
from enum import IntEnum
from typing import Annotated, Any, get_args, get_origin, get_type_hints

from hypothesis import strategies as st

from msbot import AtMost, Exactly, Message, Octets
from msbot.part.messages.wire_types import Number

_NUMBERS = {
    "float32": st.floats(width=32, allow_nan=False),
    "float64": st.floats(allow_nan=False),
    **{f"uint{bits}": st.integers(0, 2**bits - 1) for bits in (8, 16, 32, 64)},
    **{f"int{bits}": st.integers(-(2 ** (bits - 1)), 2 ** (bits - 1) - 1) for bits in (8, 16, 32, 64)},
}
_TEXT = st.text(st.characters(codec="ascii", exclude_characters="\0"), max_size=12)


def module_from(text: str, name: str) -> types.ModuleType:
    """The module that the text is; annotations are resolved in it."""
    module = types.ModuleType(name)
    sys.modules[name] = module  # annotations are looked up there
    exec(compile(text, f"{name}.py", "exec"), module.__dict__)
    return module


def messages(cls: type[Message], most: int = 4) -> st.SearchStrategy[Message]:
    """Messages of a class with any content; lists without a bound have at most `most` elements."""
    hints = get_type_hints(cls, include_extras=True)
    fields = {name: _values(hint, most) for name, hint in hints.items() if name in cls._fields}
    return st.builds(cls, **fields)


def _values(hint: Any, most: int) -> st.SearchStrategy[Any]:
    marks: tuple[Any, ...] = ()
    if get_origin(hint) is Annotated:
        hint, *rest = get_args(hint)
        marks = tuple(rest)
    mark = marks[0] if marks else None
    if isinstance(mark, Number):
        return _NUMBERS[mark.word]
    if hint is bool:
        return st.booleans()
    if hint is str:
        return _TEXT
    if hint is bytes:
        if isinstance(mark, Octets):
            return st.binary(min_size=mark.length, max_size=mark.length)
        return st.binary(max_size=most)
    if isinstance(hint, type) and issubclass(hint, IntEnum):
        return st.sampled_from(list(hint))
    if get_origin(hint) is list:
        element = _values(get_args(hint)[0], most)
        if isinstance(mark, Exactly):
            return st.lists(element, min_size=mark.length, max_size=mark.length)
        return st.lists(element, max_size=min(most, mark.length) if isinstance(mark, AtMost) else most)
    return messages(hint, most)
