"""What a part tells its robot about its messages, as on a PC: the hash that ROS 2 gives a type, and its fields.

Imported when a configuration comes, or a port without a declaration is used for the first time, and forgotten again.
"""

import struct
from hashlib import sha256

from .cdr import put_text
from .message import Kind, fields_of, type_name_of
from .running import once
from .xrce import RELIABLE

_IDS = {"B": 3, "H": 5, "I": 7, "Q": 9, "b": 2, "h": 4, "i": 6, "q": 8, "f": 10, "d": 11, bool: 15, str: 17, bytes: 147}
_FIELD = '{{"name": "{}", "type": {{"type_id": {}, "capacity": {}, "string_capacity": {}, "nested_type_name": "{}"}}}}'
_TYPE = '{{"type_name": "{}", "fields": [{}]}}'
_WHOLE = '{{"type_description": {}, "referenced_type_descriptions": [{}]}}'
_LISTS = {"": 144, "=": 48, "<=": 96}
_LEAST, _MOST = 540, 4096
_NOT_KNOWN = 255
_OF_REPLY = 0x80


def type_hash(message_class):
    """The first octets of the hash of a class; None: it has lists of lists, which are not compared."""
    types = [message_class]
    if not all([kind in _IDS for _, kind in fields_of(message_class)]):
        types = once("kind_words").with_inside(message_class)  # there are others inside
    for one in types:
        for _, kind in () if isinstance(one, Kind) else fields_of(one):
            element = getattr(kind, "element", None) if isinstance(kind, Kind) else None
            if element is bytes or hasattr(element, "element"):
                return None
    inner = [(_ros_name(_name_of(one)), _described(one)) for one in types[:-1]]
    inner.sort()
    return sha256(_WHOLE.format(_described(types[-1]), ", ".join([told for _, told in inner])).encode()).digest()[:8]


def _ros_name(name):
    words = [word for word in name.split("::") if word]
    if len(words) == 4 and words[2] == "dds_":
        last = words[3]
        return "{}/{}/{}".format(words[0], words[1], last[:-1] if last.endswith("_") else last)
    return "msbot_msgs/msg/" + name


def _name_of(one):
    return one.name if isinstance(one, Kind) else type_name_of(one)


def _described(one):
    if isinstance(one, Kind):  # an enum: a number for each name
        fields = [(name, (7, number, 0, "")) for name, number in zip(one.names, one.numbers)]
    else:
        fields = [(name, _typed(kind)) for name, kind in fields_of(one)]
    return _TYPE.format(_ros_name(_name_of(one)), ", ".join([_FIELD.format(name, *told) for name, told in fields]))


def _typed(kind):
    """Number of the type, elements of a list, octets of a text, and the type inside."""
    if isinstance(kind, Kind) and hasattr(kind, "element"):
        number, _, octets, nested = _typed(kind.element)
        return number + _LISTS[kind.sign], kind.count, octets, nested
    if isinstance(kind, Kind) and not hasattr(kind, "names"):
        return 21, 0, kind.count, ""
    return (_IDS[kind], 0, 0, "") if kind in _IDS else (1, 0, 0, _ros_name(_name_of(kind)))


def tell(part):
    """Tell of the declared messages at ports that the robot has bound, or bound elsewhere than before."""
    for port, told in list(part.told_types.items()):
        if told[:2] != _standing(part, port):
            del part.told_types[port]
    for kind, port, message_class, _ in part.declared:
        if kind == "publish" and port not in part.told_types:
            tell_port(part, port, message_class)
    for port, (message_class, _, _) in part._listeners.items():
        if port not in part.told_types:
            tell_port(part, port, message_class)
    for kind, port, request, reply in part.declared:
        if kind in ("call", "serve") and port not in part.told_types:
            tell_port(part, port, request, reply)
    for place, port in enumerate(part._places):
        bound = part._ports.get(port)
        if bound and bound[0][3] == 2 and port not in part.told_types:  # it serves, and the program has no function
            part.told_types[port] = (place, bound[0], ())
            part._membership._ask(struct.pack("<IB", part._membership._lease, place) + bytes(8), RELIABLE)


def tell_port(part, port, *classes):
    """Tell of the message at one port, or of request and reply."""
    place, binding = _standing(part, port)
    if binding is None:
        return
    part.told_types[port] = (place, binding, classes)
    if (len(classes) > 1) != (binding[3] > 1):
        return  # a message where there is a service, or the reverse
    membership = part._membership
    for one in classes:
        octets = type_hash(one)
        if octets and place & 0x7F < 120:
            membership._ask(struct.pack("<IB", membership._lease, place) + octets, RELIABLE)
        place |= _OF_REPLY


def differs(part, place, detail):
    """The library's type of a port differs: tell the fields, or tell people."""
    which, place = place & _OF_REPLY and 1, place & 0x7F
    port = part._places[place] if place < len(part._places) else None
    if port not in part.told_types or which >= len(part.told_types[port][2]):
        return
    message_class = part.told_types[port][2][which]
    if not detail:
        classes = []
        for _, _, others in part.told_types.values():
            for other in others:
                if type_hash(other):
                    once("kind_words").with_inside(other, classes)
        text = "".join([_line(other) for other in classes])[:_MOST]
        said = bytearray()
        put_text(said, text + "\n" * (_LEAST - len(text.encode())))
        part._membership._ask(bytes(said), RELIABLE)
        return
    binding = part.told_types[port][1]
    if binding[2].split(" -> ")[which] != type_name_of(message_class):
        return  # told in other words
    fields, where = fields_of(message_class), ""
    if detail <= len(fields):
        name, kind = fields[detail - 1]
        where = ": the first field that differs is number {}, here {} {}".format(
            detail, once("kind_words").word_of(kind), name
        )
    elif detail != _NOT_KNOWN:
        where = ": the first field that differs is number {}, which is missing here".format(detail)
    mine = "".join(["{:02x}".format(octet) for octet in type_hash(message_class) or b""])
    words = "{} of this program (RIHS01_{}...) is not that of the robot's library{}; `msbot why {}` shows both"
    part.report("port {!r}".format(port), words.format(type_name_of(message_class), mine, where, part.slot))


def _line(message_class):
    words = [_name_of(message_class)]
    for pair in once("kind_words").described(message_class):
        words += pair
    return " ".join(words) + "\n"


def _standing(part, port):
    bound = part._ports.get(port)
    return (part._places.index(port), bound[0]) if bound else (None, None)
