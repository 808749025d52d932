"""Definitions as OMG IDL 4.2: for other DDS tools, such as `fastddsgen` and `idlc`."""

from __future__ import annotations

from msbot_agent.idl.model import (
    Array,
    Basic,
    Constant,
    Definitions,
    Enum,
    Name,
    Reference,
    Sequence,
    StringType,
    Struct,
    Type,
)
from msbot_xrce.errors import ConfigError

_WORDS = {
    "bool": "boolean", "uint8": "octet", "int8": "int8", "uint16": "unsigned short", "int16": "short",
    "uint32": "unsigned long", "int32": "long", "uint64": "unsigned long long", "int64": "long long",
    "float32": "float", "float64": "double",
}  # fmt: skip


def to_idl(definitions: Definitions, source: str) -> str:
    """The definitions as an IDL file; ROS types are in their module `dds_`, as ROS 2 has them in DDS.

    Args:
        definitions: what to write.
        source: where they come from, for the first line.
    """
    shown = {name: tuple(struct.type_name.split("::")) for name, struct in definitions.structs.items()}
    parts = [f"// Written by msbot idl from {source}\n"]
    for one in definitions.constants.values():
        parts.append(_in_modules(one.name[:-1], _constant(one)))
    for name in definitions.order:
        struct = definitions.structs.get(name)
        if struct is None:
            parts.append(_in_modules(name[:-1], _enum(definitions.enums[name])))
        else:
            full = shown[name]
            parts.append(_in_modules(full[:-1], _struct(struct, full[-1], shown)))
    return "\n".join(parts)


def _in_modules(modules: Name, lines: list[str]) -> str:
    head = "".join(f"module {name} {{ " for name in modules)
    tail = "}; " * len(modules)
    body = "\n".join(lines)
    return f"{head.rstrip()}\n{body}\n{tail.rstrip()}\n" if modules else f"{body}\n"


def _constant(one: Constant) -> list[str]:
    value = f'"{one.value}"' if isinstance(one.value, str) else str(one.value)
    value = value.upper() if isinstance(one.value, bool) else value
    return [f"const {_type(one.type, {})} {one.name[-1]} = {value};"]


def _enum(one: Enum) -> list[str]:
    members = ",\n".join(f"  @value({number}) {name}" for name, number in one.members)
    return [f"enum {one.name[-1]} {{", members, "};"]


def _struct(one: Struct, name: str, shown: dict[Name, Name]) -> list[str]:
    lines = [f"struct {name} {{"]
    for member in one.members:
        kind, lengths = member.type, ""
        while isinstance(kind, Array):
            lengths += f"[{kind.length}]"
            kind = kind.element
        lines.append(f"  {_type(kind, shown)} {member.name}{lengths};")
    return [*lines, "};"]


def _type(kind: Type, shown: dict[Name, Name]) -> str:
    match kind:
        case Basic(word):
            return _WORDS[word]
        case StringType(None):
            return "string"
        case StringType(bound):
            return f"string<{bound}>"
        case Sequence(element, None):
            return f"sequence<{_type(element, shown)} >"
        case Sequence(element, bound):
            return f"sequence<{_type(element, shown)}, {bound}>"
        case Reference(name):
            return "::" + "::".join(shown.get(name, name))
        case Array():
            raise ConfigError("a sequence of arrays cannot be written as IDL: put the array into a struct")
