"""Annotations of message classes, which MicroPython throws away: `lux: float32` becomes `lux = field(float32)`."""


def with_fields(source):
    """The program with `name: type` in its message classes written as `name = field(type)`; no line moves."""
    lines = source.split("\n")
    messages = ["Message"]
    inside = body = None  # indentation of the message class we are in, and of its fields
    for place, line in enumerate(lines):
        text = line.strip()
        indent = len(line) - len(line.lstrip())
        if not text or text.startswith("#"):
            continue
        if inside is not None and indent <= inside:
            inside = None
        if text.startswith(("from typing import ", "from enum import ")):
            names = [one for one in ("Annotated", "IntEnum") if one in text]
            lines[place] = line[:indent] + ("from msbot import " + ", ".join(names) if names else "pass")
        elif text.startswith("class ") and "(" in text:
            name, _, bases = text[6:].partition("(")
            if any(base.strip().split(".")[-1] in messages for base in bases.partition(")")[0].split(",")):
                messages.append(name.strip())
                inside, body = indent, None
        elif inside is not None:
            body = body or indent
            name, colon, rest = text.partition("#")[0].partition(":")
            if colon and indent == body and _is_name(name) and "ClassVar" not in rest:
                kind, equals, default = rest.partition("=")
                inner = kind.strip().replace("list[", "__import__('msbot').List[") + (
                    ", " + default.strip() if equals else ""
                )
                lines[place] = "{}{} = __import__('msbot').field({})".format(line[:indent], name.strip(), inner)
    return "\n".join(lines)


def _is_name(text):
    return bool(text) and all(c.isalpha() or c.isdigit() or c == "_" for c in text)
