"""MsBOT: plug-and-play robots for the classroom. The names a student needs; everything else is in the rooms below.

::

    from msbot import HelloWorld, Part

    part = Part("ABCD")

    @part.every(1.0)
    def greet() -> None:
        part.publish("out", HelloWorld(index=1, message="hello"))

    part.run()

`import msbot` itself is quick: what a name needs is imported when the name is used first.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

from msbot.errors import (
    ConfigError,
    LinkDown,
    LinkError,
    LinkFull,
    LocalProtocolError,
    MsbotError,
    RegistryError,
    RemoteProtocolError,
    RequestError,
)

if TYPE_CHECKING:
    from msbot.part import (
        AtMost,
        ExpectedRobot,
        HelloWorld,
        JoinState,
        Message,
        NumatoGpio,
        Octets,
        Part,
        PinDirection,
        SimGpio,
        UsbGpio,
        float32,
        float64,
        int8,
        int16,
        int32,
        int64,
        run,
        uint8,
        uint16,
        uint32,
        uint64,
    )

__all__ = [
    "AtMost",
    "ConfigError",
    "ExpectedRobot",
    "HelloWorld",
    "JoinState",
    "LinkDown",
    "LinkError",
    "LinkFull",
    "LocalProtocolError",
    "Message",
    "MsbotError",
    "NumatoGpio",
    "Octets",
    "Part",
    "PinDirection",
    "RegistryError",
    "RemoteProtocolError",
    "RequestError",
    "SimGpio",
    "UsbGpio",
    "float32",
    "float64",
    "int8",
    "int16",
    "int32",
    "int64",
    "run",
    "uint8",
    "uint16",
    "uint32",
    "uint64",
]


def __getattr__(name: str) -> object:
    if name not in __all__:
        raise AttributeError(f"module 'msbot' has no attribute {name!r}")
    value: object = getattr(importlib.import_module("msbot.part"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return __all__
