"""Definitions as Python: `Message` classes for PCs, browsers and microcontrollers alike."""

from __future__ import annotations

import keyword
from collections.abc import Mapping
from math import isfinite

from msbot_agent.idl.model import (
    Array,
    Basic,
    Constant,
    Definitions,
    Enum,
    Member,
    Name,
    Reference,
    Sequence,
    StringType,
    Struct,
    Type,
    Value,
)
from msbot_xrce.errors import ConfigError

RESERVED = frozenset({"encode", "decode", "type_name"})
"""Names that belong to `Message`."""
LONGEST_LINE = 116


def to_python(definitions: Definitions, source: str) -> str:
    """The definitions as a Python module.

    Args:
        definitions: what to write.
        source: where they come from, for the first line.
    """
    names = python_names(definitions)
    used: set[str] = set()
    blocks = [_constant(one) for one in definitions.constants.values()]
    body = ["\n".join(blocks)] if blocks else []
    for name in definitions.order:
        if name in definitions.enums:
            body.append(_enum(definitions.enums[name], names))
        else:
            body.append(_struct(definitions.structs[name], names, used))
    head = [
        f'"""Messages from {_plain(source)}, written by `msbot idl`."""',
        "",
        "from __future__ import annotations",
        "",
    ]
    if definitions.enums:
        head.append("from enum import IntEnum")
    typing = [word for word in ("Annotated", "ClassVar") if word in used]
    if typing:
        head.append(f"from typing import {', '.join(typing)}")
    if definitions.enums or typing:
        head.append("")
    imports = sorted(
        (used - {"Annotated", "ClassVar"}) | ({"Message"} if definitions.structs else set()), key=_import_order
    )
    if imports:
        line = f"from msbot import {', '.join(imports)}"
        if len(line) > LONGEST_LINE:
            line = "from msbot import (\n" + "".join(f"    {word},\n" for word in imports) + ")"
        head.append(line)
    return "\n".join(head) + "\n\n\n" + "\n\n\n".join(body) + "\n"


def python_names(definitions: Definitions) -> Mapping[Name, str]:
    """The class of each struct and enum: its last name, preceded by its modules where two have the same name."""
    last: dict[str, list[Name]] = {}
    for name in definitions.order:
        last.setdefault(name[-1], []).append(name)
    names = {}
    for short, owners in last.items():
        for name in owners:
            names[name] = _safe(short) if len(owners) == 1 else _safe("_".join(name))
    if len(set(names.values())) < len(names):
        raise ConfigError("two types would get the same name in Python: rename one of them")
    return names


def _import_order(word: str) -> tuple[bool, str, int]:
    letters = word.rstrip("0123456789")
    return word[0].islower(), letters, int(word[len(letters) :] or 0)  # int8 before int16


def _safe(name: str) -> str:
    return f"{name}_" if keyword.iskeyword(name) or name in RESERVED or name.startswith("_") else name


def _field_name(name: str) -> str:
    name = name.lstrip("_") or "field"
    return _safe(name)


def _constant(one: Constant) -> str:
    comment = f"  # {_plain(one.comment)}" if one.comment else ""
    return f"{_safe(one.name[-1])} = {_literal(one.type, one.value)}{comment}"


def _enum(one: Enum, names: Mapping[Name, str]) -> str:
    lines = [f"class {names[one.name]}(IntEnum):", _docstring(one.comment or f"`{'::'.join(one.name)}`")]
    return "\n".join([*lines, *(f"    {_safe(name)} = {number}" for name, number in one.members)])


def _struct(one: Struct, names: Mapping[Name, str], used: set[str]) -> str:
    name = names[one.name]
    lines = [f"class {name}(Message):", _docstring(one.comment or f"`{'::'.join(one.name)}`"), ""]
    if one.type_name != name:
        lines += [f'    type_name = "{one.type_name}"', ""]
    for constant in one.constants:
        used.add("ClassVar")
        kind = type(constant.value).__name__
        lines.append(f"    {_safe(constant.name[-1])}: ClassVar[{kind}] = {_literal(constant.type, constant.value)}")
    if one.constants:
        lines.append("")
    lines += [_member(member, names, used) for member in one.members]
    return "\n".join(lines)


def _member(member: Member, names: Mapping[Name, str], used: set[str]) -> str:
    default = "" if member.default is None else f" = {_literal(member.type, member.default)}"
    if isinstance(member.default, list) and default.endswith("]"):
        default += "  # noqa: RUF012 - copied for each message" if not member.comment else ""
    comment = f"  # {_plain(member.comment)}" if member.comment else ""
    return f"    {_field_name(member.name)}: {_annotation(member.type, names, used)}{default}{comment}"


def _literal(kind: Type, value: Value | list[Value]) -> str:
    """A value as Python writes it."""
    match kind, value:
        case ((Sequence(Basic("uint8")) | Array(Basic("uint8"))), list()):
            return repr(bytes(octet for octet in value if isinstance(octet, int)))
        case ((Sequence(element) | Array(element)), list()):
            return f"[{', '.join(_literal(element, one) for one in value)}]"
        case _, float() if not isfinite(value):
            return f'float("{value}")'
        case _:
            return repr(value)


def _annotation(kind: Type, names: Mapping[Name, str], used: set[str]) -> str:
    match kind:
        case Basic("bool"):
            return "bool"
        case Basic(word):
            used.add(word)
            return word
        case StringType(None):
            return "str"
        case StringType(bound):
            used.update(("Annotated", "AtMost"))
            return f"Annotated[str, AtMost({bound})]"
        case Sequence(Basic("uint8"), None):
            return "bytes"
        case Sequence(Basic("uint8"), bound):
            used.update(("Annotated", "AtMost"))
            return f"Annotated[bytes, AtMost({bound})]"
        case Sequence(element, None):
            return f"list[{_annotation(element, names, used)}]"
        case Sequence(element, bound):
            used.update(("Annotated", "AtMost"))
            return f"Annotated[list[{_annotation(element, names, used)}], AtMost({bound})]"
        case Array(Basic("uint8"), length):
            used.update(("Annotated", "Octets"))
            return f"Annotated[bytes, Octets({length})]"
        case Array(element, length):
            used.update(("Annotated", "Exactly"))
            return f"Annotated[list[{_annotation(element, names, used)}], Exactly({length})]"
        case Reference(name):
            return names[name]


def _docstring(text: str) -> str:
    words = _plain(text)
    return f'    """{words[:1].upper()}{words[1:]}{"" if words.endswith((".", "!", "?")) else "."}"""'


def _plain(text: str) -> str:
    return " ".join(text.replace("\\", "/").replace('"', "'").split())[:100]
