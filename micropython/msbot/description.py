"""What a part says of itself: a library file, the same as on a PC; imported by parts that describe themselves."""

from .errors import ConfigError
from .message import fields_of, type_name_of

_MOST, _LEAST = 4096, 540  # octets; shorter ones are filled up, because claims are shorter
_KINDS = {bool: "bool", int: "int", float: "float", str: "text"}
_WORDS = {
    "B": "uint8", "H": "uint16", "I": "uint32", "Q": "uint64", "b": "int8", "h": "int16", "i": "int32", "q": "int64",
    "f": "float32", "d": "float64", bool: "bool", str: "text",
}  # fmt: skip


def describe(part):
    """The text, from what the program has declared."""
    out = ["number = " + _value(part.part_number), "name = " + _value(part.called)]
    ways = [kind for kind, _, _, _ in part.declared if kind != "setting"]
    if len(set(ways)) == 1 and ways[0] in ("publish", "subscribe"):
        out.append("category = " + _value("sensor" if ways[0] == "publish" else "actuator"))
    classes = []
    for way in ("publish", "subscribe"):
        for kind, port, message_class, safe in part.declared:
            if kind == way:
                out += ["", "[[port]]", "name = " + _value(port), "direction = " + _value(way)]
                out.append("type = " + _value(type_name_of(message_class)))
                if safe is not None:
                    out.append("safe = " + _table([(name, _field(safe, name, of)) for name, of in _fields(safe)]))
                if message_class not in classes:
                    classes.append(message_class)
    for way in ("call", "serve"):
        for kind, port, request, reply in part.declared:
            if kind == way:
                out += ["", "[[port]]", "name = " + _value(port), "direction = " + _value(way)]
                out += ["request = " + _value(type_name_of(request)), "reply = " + _value(type_name_of(reply))]
                classes += [one for one in (request, reply) if one not in classes]
    for kind, name, of, setting in part.declared:
        if kind == "setting":
            default, least, most, unit = setting
            out += ["", "[[parameter]]", "name = " + _value(name), "type = " + _value(_KINDS[of])]
            out.append("default = " + _value(default))
            out += [key + " = " + _value(end) for key, end in (("min", least), ("max", most)) if end is not None]
            if unit:
                out.append("unit = " + _value(unit))
    for message_class in classes:
        out += ["", "[[type]]", "name = " + _value(type_name_of(message_class))]
        out.append(
            "fields = " + _table([(name, _word(message_class, name, of)) for name, of in fields_of(message_class)])
        )
        units = getattr(message_class, "units", None)
        if isinstance(units, dict) and units:
            names = [name for name, _ in fields_of(message_class) if name in units]
            out.append("units = " + _table([(name, units[name]) for name in names]))
    text = "\n".join(out) + "\n"
    size = len(text.encode())
    if size > _MOST:
        words = "what the part says of itself has {} bytes, and may have {}: give it fewer ports and settings"
        raise ConfigError(words.format(size, _MOST))
    return text + "\n" * (_LEAST - size)


def _fields(message):
    return fields_of(type(message))


def _field(message, name, kind):
    value = getattr(message, name)
    return float(value) if kind in ("f", "d") else value


def _word(message_class, name, kind):
    if kind not in _WORDS:
        words = "{}.{} cannot be described: use numbers, bool and str"
        raise ConfigError(words.format(message_class.__name__, name))
    return _WORDS[kind]


def _table(pairs):
    return "{" + ", ".join([name + " = " + _value(value) for name, value in pairs]) + "}"


def _value(value):
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'
    return repr(value)
