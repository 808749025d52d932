"""The standard messages: a table; a class is made when a program asks for it, then the table is forgotten."""

from .message import Message

_STANDARD = (
    "HelloWorld index:I message:s;Switch on:?;Number value:f;Count value:i;Level percent:f;Text text:s;Light lux:f;"
    "Colour red:B green:B blue:B;Temperature celsius:f;Pressure hectopascal:f;Gas ppm:f;Distance metres:f in_range:?;"
    "Angle degrees:f;Speed rpm:f;Vector x:f y:f z:f;Stick x:f y:f pressed:?;Key key:s pressed:?;"
    "Line position:f seen:?;Tone hertz:f seconds:f;Battery volts:f amperes:f percent:f;Weight grams:f;"
    "Place latitude:d longitude:d altitude:f satellites:B;Trigger index:I"
)


def standard(name):
    """The class of a standard message, or None."""
    for entry in _STANDARD.split(";"):
        if entry.startswith(name + " "):
            pairs = [pair.split(":") for pair in entry.split(" ")[1:]]
            fields = tuple([(field_name, {"s": str, "?": bool}.get(code, code)) for field_name, code in pairs])
            return type(name, (Message,), {"_fields": fields})
    return None
