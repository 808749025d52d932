"""Definitions as C99 for the Micro XRCE-DDS client: a struct for each message, and its functions on Micro-CDR's API.

Texts and sequences without a bound in the definition get one here, since a microcontroller has no heap: they become
arrays inside the struct.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from math import isfinite, isnan

from msbot_agent.idl.model import (
    Array,
    Basic,
    Definitions,
    Enum,
    Name,
    Reference,
    Sequence,
    StringType,
    Struct,
    Type,
    Value,
)
from msbot_xrce.errors import ConfigError

TEXT_BOUND = 255
"""Largest number of characters in a text without a bound."""
SEQUENCE_BOUND = 64
"""Largest number of elements in a sequence without a bound."""

_C = {
    "bool": "bool", "uint8": "uint8_t", "int8": "int8_t", "uint16": "uint16_t", "int16": "int16_t",
    "uint32": "uint32_t", "int32": "int32_t", "uint64": "uint64_t", "int64": "int64_t", "float32": "float",
    "float64": "double",
}  # fmt: skip
_CODES = {
    "bool": "?", "uint8": "B", "int8": "b", "uint16": "H", "int16": "h", "uint32": "I", "int32": "i", "uint64": "Q",
    "int64": "q", "float32": "f", "float64": "d",
}  # fmt: skip
"""Of fields, as firmware/c/msbot_ranges.h takes them."""
_KEYWORDS = frozenset((
    "auto", "break", "case", "char", "const", "continue", "default", "do", "double", "else", "enum", "extern", "float",
    "for", "goto", "if", "inline", "int", "long", "register", "restrict", "return", "short", "signed", "sizeof",
    "static", "struct", "switch", "typedef", "union", "unsigned", "void", "volatile", "while", "bool", "true", "false",
))  # fmt: skip


def to_c(
    definitions: Definitions,
    source: str,
    stem: str,
    *,
    text_bound: int = TEXT_BOUND,
    sequence_bound: int = SEQUENCE_BOUND,
) -> tuple[str, str]:
    """The definitions as a header and its source file.

    Args:
        definitions: what to write.
        source: where they come from, for the first line.
        stem: name of the files without `.h` and `.c`.
        text_bound: largest number of characters in a text without a bound.
        sequence_bound: largest number of elements in a sequence without a bound.
    """
    return _Writer(definitions, source, stem, text_bound, sequence_bound).write()


class _Writer:
    def __init__(self, definitions: Definitions, source: str, stem: str, text_bound: int, sequence_bound: int) -> None:
        self._all = definitions
        self._source = source.replace("*/", "")
        self._stem = stem
        self._text_bound = text_bound
        self._sequence_bound = sequence_bound
        self._names: Mapping[Name, str] = {name: _c_name(name) for name in definitions.order}
        if len(set(self._names.values())) < len(self._names):
            raise ConfigError("two types would get the same name in C: rename one of them")

    def write(self) -> tuple[str, str]:
        guard = re.sub(r"\W", "_", f"{self._stem}_H_").upper()
        head = [
            f"/* Written by msbot idl from {self._source}. */",
            f"#ifndef {guard}",
            f"#define {guard}",
            "",
            *(["#include <math.h>"] if self._has_no_number() else []),
            "#include <stdbool.h>",
            "#include <stdint.h>",
            "",
            "#include <ucdr/microcdr.h>",
            "",
            "#ifdef __cplusplus",
            'extern "C" {',
            "#endif",
            "",
        ]
        for one in self._all.constants.values():
            head.append(f"#define {_c_name(one.name)} {_literal(one.value)}")
        body = [f'#include "{self._stem}.h"', ""]
        for name in self._all.order:
            if name in self._all.enums:
                head += self._enum(self._all.enums[name])
            else:
                struct = self._all.structs[name]
                head += self._struct(struct)
                body += self._functions(struct)
        head += ["#ifdef __cplusplus", "}", "#endif", "", f"#endif /* {guard} */", ""]
        return "\n".join(head), "\n".join(body)

    def _has_no_number(self) -> bool:
        constants = [
            *self._all.constants.values(),
            *(one for all_ in self._all.structs.values() for one in all_.constants),
        ]
        return any(isinstance(one.value, float) and not isfinite(one.value) for one in constants)

    def _enum(self, one: Enum) -> list[str]:
        name = self._names[one.name]
        members = [f"    {name}_{member} = {number}," for member, number in one.members]
        return [f"typedef enum {name} {{", *members, f"}} {name};", ""]

    def _struct(self, one: Struct) -> list[str]:
        name = self._names[one.name]
        constants = [f"#define {name}_{constant.name[-1]} {_literal(constant.value)}" for constant in one.constants]
        members = [f"    {self._declare(member.type, _c_field(member.name))}" for member in one.members]
        return [
            *constants,
            f'#define {name}_TYPE_NAME "{one.type_name}"',
            *self._fields_line(one),
            f"typedef struct {name} {{",
            *members,
            f"}} {name};",
            "",
            f"bool {name}_serialize(ucdrBuffer* buffer, const {name}* message);",
            f"bool {name}_deserialize(ucdrBuffer* buffer, {name}* message);",
            "",
        ]

    def _fields_line(self, one: Struct) -> list[str]:
        """The fields for `msbot_ranges_watch`, unless a list of structures or texts is among them."""
        found = [self._fields(member.type, member.name) for member in one.members]
        if not found or "" in found:
            return []
        return [f'#define {self._names[one.name]}_FIELDS "{" ".join(found)}"']

    def _fields(self, kind: Type, way: str) -> str:
        """`tip.x:f tip.y:f`; empty: it cannot be said."""
        match kind:
            case StringType():
                return f"{way}:s"
            case Array(element, length) if code := self._code(element):
                return f"{way}:{code}={length}"
            case Sequence(element, bound) if code := self._code(element):
                return f"{way}:{code}<{bound or ''}"
            case Reference(of) if of in self._all.structs:
                inside = [self._fields(one.type, f"{way}.{one.name}") for one in self._all.structs[of].members]
                return "" if "" in inside else " ".join(inside)
        code = self._code(kind)
        return f"{way}:{code}" if code else ""

    def _code(self, kind: Type) -> str:
        if isinstance(kind, Reference) and kind.name in self._all.enums:
            return "I"
        return _CODES[kind.word] if isinstance(kind, Basic) else ""

    def _declare(self, kind: Type, name: str) -> str:
        match kind:
            case Basic(word):
                return f"{_C[word]} {name};"
            case Reference(of):
                return f"{self._names[of]} {name};"
            case StringType(bound):
                return f"char {name}[{(bound or self._text_bound) + 1}];"
            case Array(element, length):
                return self._declare(element, f"{name}[{length}]")
            case Sequence(element, bound):
                inside = self._declare(element, f"data[{bound or self._sequence_bound}]")
                return f"struct {{ uint32_t size; {inside} }} {name};"

    def _functions(self, one: Struct) -> list[str]:
        name = self._names[one.name]
        writing = [
            line for member in one.members for line in self._write(member.type, f"message->{_c_field(member.name)}")
        ]
        reading = [
            line for member in one.members for line in self._read(member.type, f"message->{_c_field(member.name)}")
        ]
        return [
            f"bool {name}_serialize(ucdrBuffer* buffer, const {name}* message)",
            "{",
            "    bool ok = true;",
            *("    " + line for line in writing),
            "    return ok && !buffer->error;",
            "}",
            "",
            f"bool {name}_deserialize(ucdrBuffer* buffer, {name}* message)",
            "{",
            "    bool ok = true;",
            *("    " + line for line in reading),
            "    return ok && !buffer->error;",
            "}",
            "",
        ]

    def _write(self, kind: Type, what: str, depth: int = 0) -> list[str]:
        match kind:
            case Basic(word):
                return [f"ok = ok && ucdr_serialize_{_C[word]}(buffer, {what});"]
            case Reference(of) if of in self._all.enums:
                return [f"ok = ok && ucdr_serialize_uint32_t(buffer, (uint32_t){what});"]
            case Reference(of):
                return [f"ok = ok && {self._names[of]}_serialize(buffer, &{what});"]
            case StringType():
                return [f"ok = ok && ucdr_serialize_string(buffer, {what});"]
            case Array(Basic(word), length):
                return [f"ok = ok && ucdr_serialize_array_{_C[word]}(buffer, {what}, {length});"]
            case Array(element, length):
                return self._loop(depth, str(length), self._write(element, f"{what}[i{depth}]", depth + 1))
            case Sequence(Basic(word), bound):
                return [
                    f"ok = ok && {what}.size <= {bound or self._sequence_bound};",
                    f"ok = ok && ucdr_serialize_sequence_{_C[word]}(buffer, {what}.data, {what}.size);",
                ]
            case Sequence(element, bound):
                inside = self._write(element, f"{what}.data[i{depth}]", depth + 1)
                return [
                    f"ok = ok && {what}.size <= {bound or self._sequence_bound};",
                    f"ok = ok && ucdr_serialize_uint32_t(buffer, {what}.size);",
                    *self._loop(depth, f"{what}.size", inside),
                ]

    def _read(self, kind: Type, what: str, depth: int = 0) -> list[str]:
        match kind:
            case Basic(word):
                return [f"ok = ok && ucdr_deserialize_{_C[word]}(buffer, &{what});"]
            case Reference(of) if of in self._all.enums:
                return self._read_enum(self._all.enums[of], what)
            case Reference(of):
                return [f"ok = ok && {self._names[of]}_deserialize(buffer, &{what});"]
            case StringType(bound):
                return [f"ok = ok && ucdr_deserialize_string(buffer, {what}, {(bound or self._text_bound) + 1});"]
            case Array(Basic(word), length):
                return [f"ok = ok && ucdr_deserialize_array_{_C[word]}(buffer, {what}, {length});"]
            case Array(element, length):
                return self._loop(depth, str(length), self._read(element, f"{what}[i{depth}]", depth + 1))
            case Sequence(Basic(word), bound):
                most = bound or self._sequence_bound
                return [f"ok = ok && ucdr_deserialize_sequence_{_C[word]}(buffer, {what}.data, {most}, &{what}.size);"]
            case Sequence(element, bound):
                inside = self._read(element, f"{what}.data[i{depth}]", depth + 1)
                return [
                    f"ok = ok && ucdr_deserialize_uint32_t(buffer, &{what}.size);",
                    f"ok = ok && {what}.size <= {bound or self._sequence_bound};",
                    *self._loop(depth, f"{what}.size", inside),
                ]

    def _read_enum(self, one: Enum, what: str) -> list[str]:
        name = self._names[one.name]
        known = " || ".join(f"number == {name}_{member}" for member, _ in one.members)
        return [
            "if (ok) {",
            "    uint32_t number = 0;",
            "    ok = ucdr_deserialize_uint32_t(buffer, &number);",
            f"    ok = ok && ({known});",
            f"    if (ok) {what} = ({name})number;",
            "}",
        ]

    def _loop(self, depth: int, count: str, inside: list[str]) -> list[str]:
        head = f"for (uint32_t i{depth} = 0; ok && i{depth} < {count}; ++i{depth}) {{"
        return [head, *("    " + line for line in inside), "}"]


def _literal(value: Value) -> str:
    """A value as C writes it."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float) and not isfinite(value):
        return "NAN" if isnan(value) else "INFINITY" if value > 0 else "(-INFINITY)"
    if isinstance(value, str):
        octets = value.encode()
        return (
            '"'
            + "".join(chr(one) if 32 <= one < 127 and one not in b'"\\?' else f"\\{one:03o}" for one in octets)
            + '"'
        )
    return str(value)


def _c_name(name: Name) -> str:
    return "_".join(name)


def _c_field(name: str) -> str:
    return f"{name}_" if name in _KEYWORDS else name
