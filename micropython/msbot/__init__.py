"""MsBOT on MicroPython: the same names as on a PC, imported on first use (docs/howto/micropython.md)."""

import builtins

from .errors import CallError as CallError
from .errors import ConfigError as ConfigError
from .errors import LocalProtocolError as LocalProtocolError
from .errors import MsbotError as MsbotError
from .errors import RemoteProtocolError as RemoteProtocolError
from .errors import listen as listen

__version__ = "0.1.0"

_PLACES = (
    "part Part;membership ExpectedRobot JoinState;gpio PinDirection SimGpio;generic GenericBoard run_board;running run "
    "start use_host;lists IntEnum Annotated List AtMost Exactly Octets;message Message field uint8 uint16 uint32 "
    "uint64 int8 int16 int32 int64 float32 float64"
)

_print = print


def _print_as_on_a_pc(*values, **options):
    options.pop("flush", None)  # MicroPython's own does not know it, and always flushes
    _print(*values, **options)


builtins.print = _print_as_on_a_pc


def __getattr__(name):
    for place in _PLACES.split(";"):
        if name in place.split(" ")[1:]:
            value = getattr(_module(place.split(" ")[0]), name)
            break
    else:
        value = None if name[:1] == "_" else _module("running").once("standards").standard(name)
        if value is None:
            raise AttributeError("module 'msbot' has no attribute {!r}".format(name))
    globals()[name] = value
    return value


def _module(name):
    return __import__("{}.{}".format(__name__, name), None, None, ("",))
