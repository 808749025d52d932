"""The standard messages: a table; a class is made when a program asks for it, then the table is forgotten."""

import sys

from .message import Message
from .running import _PACKAGE as PACKAGE
from .running import load

_STANDARD = (
    "HelloWorld index:I message:s;Switch on:?;Number value:f;Count value:i;Level percent:f;Text text:s;Light lux:f;"
    "Colour red:B green:B blue:B;Temperature celsius:f;Pressure hectopascal:f;Gas ppm:f;Distance metres:f in_range:?;"
    "Angle degrees:f;Speed rpm:f;Vector x:f y:f z:f;Stick x:f y:f pressed:?;Key key:s pressed:?;"
    "Line position:f seen:?;Tone hertz:f seconds:f;Battery volts:f amperes:f percent:f;Weight grams:f;"
    "Place latitude:d longitude:d altitude:f satellites:B;Trigger index:I;"
    "Pose x:f y:f degrees:f;Scan angle_min:f angle_step:f reach:f metres:f<360;Strip colours:Colour<64;"
    "Picture width:H height:H format:PixelFormat pixels:y<3072"
)


def standard(name):
    """The class of a standard message, or None."""
    for entry in _STANDARD.split(";"):
        if entry.startswith(name + " "):
            pairs = [pair.split(":") for pair in entry.split(" ")[1:]]
            return type(name, (Message,), {"_fields": tuple([(field_name, _kind(code)) for field_name, code in pairs])})
    if name == "PixelFormat":
        return type(name, (load("lists").IntEnum,), {"MONO8": 0, "RGB8": 1})
    return None


def _kind(code):
    """`f`, `s` (a text), `PixelFormat`, `f<360` (a list of at most 360), `y<3072` (bytes)."""
    base, bound, most = code.partition("<")
    lists = None if len(code) == 1 else load("lists")
    if len(base) > 1:
        base = getattr(sys.modules[PACKAGE], base)
    if bound:
        return lists.ListKind("B" if base == "y" else base, "<=", int(most), octets=base == "y")
    return lists.EnumKind(base) if lists else {"s": str, "?": bool}.get(base, base)
