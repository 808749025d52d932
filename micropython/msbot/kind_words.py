"""Kinds of fields as a library file writes them, and the types inside others; imported only when needed."""

from .message import Kind, Message, fields_of, type_name_of

WORDS = {
    "B": "uint8", "H": "uint16", "I": "uint32", "Q": "uint64", "b": "int8", "h": "int16", "i": "int32", "q": "int64",
    "f": "float32", "d": "float64", bool: "bool", str: "text", bytes: "uint8[]",
}  # fmt: skip


def word_of(kind):
    """`float32`, `text<=32`, `uint16[<=64]`, `Pose`."""
    if isinstance(kind, str) or not isinstance(kind, Kind):
        return WORDS[kind] if kind in WORDS else type_name_of(kind)
    if hasattr(kind, "names"):
        return kind.name
    if not hasattr(kind, "element"):
        return "text<={}".format(kind.count)
    return "{}[{}{}]".format(word_of(kind.element), "<=" if kind.sign == "<=" else "", kind.count or "")


def inside(kind):
    """The Message class or enum that a kind has inside, or None."""
    element = getattr(kind, "element", kind) if isinstance(kind, Kind) else kind
    if isinstance(element, Kind):
        return element if hasattr(element, "names") else None
    return element if isinstance(element, type) and issubclass(element, Message) else None


def name_of(one):
    """The name of a Message class or enum."""
    return one.name if isinstance(one, Kind) else type_name_of(one)


def described(one):
    """`(name, kind in words)` of each field, or of each name of an enum."""
    if isinstance(one, Kind):
        return [(name, str(number)) for name, number in zip(one.names, one.numbers)]
    return [(name, word_of(kind)) for name, kind in fields_of(one)]


def with_inside(message_class, found=None):
    """A class and all that is inside, the inner ones first."""
    found = [] if found is None else found
    names = [name_of(one) for one in found]
    if not isinstance(message_class, Kind):
        for _, kind in fields_of(message_class):
            if inside(kind):
                with_inside(inside(kind), found)
    if name_of(message_class) not in names:
        found.append(message_class)
    return found
