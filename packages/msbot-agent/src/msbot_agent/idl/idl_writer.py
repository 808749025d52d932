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
    written = [*shown.values(), *definitions.enums, *(one.name for one in definitions.constants.values())]
    declared = {_folded(name[:depth]) for name in written for depth in range(1, len(name) + 1)}
    parts = [f"// Written by msbot idl from {source}\n"]
    for one in definitions.constants.values():
        parts.append(_in_modules(one.name[:-1], _constant(one)))
    for name in definitions.order:
        struct = definitions.structs.get(name)
        if struct is None:
            parts.append(_in_modules(name[:-1], _enum(definitions.enums[name])))
        else:
            full = shown[name]
            parts.append(_in_modules(full[:-1], _struct(struct, full, _Names(shown, declared))))
    return "\n".join(parts)


def _in_modules(modules: Name, lines: list[str]) -> str:
    head = "".join(f"module {name} {{ " for name in modules)
    tail = "}; " * len(modules)
    body = "\n".join(lines)
    return f"{head.rstrip()}\n{body}\n{tail.rstrip()}\n" if modules else f"{body}\n"


def _constant(one: Constant) -> list[str]:
    value = f'"{one.value}"' if isinstance(one.value, str) else str(one.value)
    value = value.upper() if isinstance(one.value, bool) else value
    return [f"const {_type(one.type, None)} {one.name[-1]} = {value};"]


def _enum(one: Enum) -> list[str]:
    members = ",\n".join(f"  @value({number}) {name}" for name, number in one.members)
    return [f"enum {one.name[-1]} {{", members, "};"]


class _Names:
    """How a struct names other types: from the outermost module on, as `fastddsgen` 2 reads no `::` in front."""

    def __init__(self, shown: dict[Name, Name], declared: set[Name]) -> None:
        """`shown` are the names of structs as they are written, `declared` all that the file declares, folded."""
        self._shown = shown
        self._declared = declared
        self._scope: Name = ()
        self._members: set[str] = set()

    def enter(self, struct: Name, members: set[str]) -> None:
        """The next names stand in that struct."""
        self._scope = _folded(struct[:-1])
        self._members = members

    def of(self, name: Name) -> str:
        """The name of a type; with `::` in front where an inner scope means something else by the first word."""
        full = self._shown.get(name, name)
        first = _folded(full[:1])
        inner = (self._scope[:depth] + first for depth in range(1, len(self._scope) + 1))
        is_hidden = first[0] in self._members or any(one in self._declared for one in inner)
        return ("::" if is_hidden else "") + "::".join(full)


def _folded(name: Name) -> Name:
    """As IDL compares names: without regard to capitals (IDL 4.2 §7.2.3)."""
    return tuple(word.lower() for word in name)


def _struct(one: Struct, full: Name, names: _Names) -> list[str]:
    lines = [f"struct {full[-1]} {{"]
    names.enter(full, {member.name.lower() for member in one.members})
    for member in one.members:
        kind, lengths = member.type, ""
        while isinstance(kind, Array):
            lengths += f"[{kind.length}]"
            kind = kind.element
        lines.append(f"  {_type(kind, names)} {member.name}{lengths};")
    return [*lines, "};"]


def _type(kind: Type, names: _Names | None) -> str:
    match kind:
        case Basic(word):
            return _WORDS[word]
        case StringType(None):
            return "string"
        case StringType(bound):
            return f"string<{bound}>"
        case Sequence(element, None):
            return f"sequence<{_type(element, names)} >"
        case Sequence(element, bound):
            return f"sequence<{_type(element, names)}, {bound}>"
        case Reference(name):
            assert names is not None, "a constant is of no type of its own"
            return names.of(name)
        case Array():
            raise ConfigError("a sequence of arrays cannot be written as IDL: put the array into a struct")
