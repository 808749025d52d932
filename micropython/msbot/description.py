"""What a part says of itself: a library file, the same as on a PC; imported by parts that describe themselves."""

from .errors import ConfigError
from .kind_words import name_of, with_inside, word_of
from .leaves import leaves_of
from .message import Kind, fields_of, type_name_of
from .running import forget

forget("kind_words")
forget("leaves")

_MOST, _LEAST = 4096, 540  # octets; shorter ones are filled up, because claims are shorter
_KINDS = {bool: "bool", int: "int", float: "float", str: "text"}


def describe(part):
    """The text, from what the program has declared."""
    out = ["number = " + _value(part.part_number), "name = " + _value(part.called)]
    ways = [kind for kind, _, _, _ in part.declared if kind != "setting"]
    if len(set(ways)) == 1 and ways[0] in ("publish", "subscribe"):
        out.append("category = " + _value("sensor" if ways[0] == "publish" else "actuator"))
    classes = []
    for way in ("publish", "subscribe"):
        for kind, port, message_class, also in part.declared:
            if kind == way:
                out += ["", "[[port]]", "name = " + _value(port), "direction = " + _value(way)]
                out.append("type = " + _value(type_name_of(message_class)))
                safe, ranges = also if isinstance(also, tuple) else (also, None)
                if safe is not None:
                    out.append("safe = " + _table([(way, value) for way, _, value in leaves_of(safe)]))
                if ranges:
                    out.append("ranges = " + _ends(ranges))
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
    told = []
    for message_class in classes:
        with_inside(message_class, told)
    for message_class in told:
        out += ["", "[[type]]", "name = " + _value(name_of(message_class))]
        if isinstance(message_class, Kind):
            out.append(_enum(message_class))
            continue
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


def _enum(kind):
    if kind.numbers != list(range(len(kind.numbers))):
        words = "{} cannot be described: number its names from 0, one after the other"
        raise ConfigError(words.format(kind.name))
    return "enum = [{}]".format(", ".join([_value(name) for name in kind.names]))


def _word(message_class, name, kind):
    word = word_of(kind)
    if word.endswith("[]") or "][" in word:
        words = (
            "{}.{} is {}, which a part cannot describe: say how many there can be, Annotated[..., AtMost(64)]; "
            "there are no lists of lists"
        )
        raise ConfigError(words.format(message_class.__name__, name, word))
    return word


def _ends(ranges):
    pairs = ["{} = [{}, {}]".format(name, _value(least), _value(most)) for name, (least, most) in ranges.items()]
    return "{" + ", ".join(pairs) + "}"


def _table(pairs):
    return "{" + ", ".join([name + " = " + _value(value) for name, value in pairs]) + "}"


def _value(value):
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'
    return repr(value)
