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
import sys
from typing import TYPE_CHECKING

from msbot_xrce.errors import (
    CallError,
    ConfigError,
    LinkDown,
    LinkError,
    LinkFull,
    LocalProtocolError,
    MsbotError,
    RegistryError,
    RemoteProtocolError,
    RequestError,
    RequestTimeout,
)

if TYPE_CHECKING:
    from msbot.part import (
        ExpectedRobot,
        HelloWorld,
        JoinState,
        Message,
        NotSafeYet,
        NumatoGpio,
        Part,
        PinDirection,
        SimGpio,
        UsbGpio,
        find_agents,
        run,
    )
    from msbot.part.messages.standard import (
        Angle,
        Battery,
        Colour,
        Count,
        Distance,
        Gas,
        Key,
        Level,
        Light,
        Line,
        Number,
        Picture,
        PixelFormat,
        Place,
        Pose,
        Pressure,
        Scan,
        Speed,
        Stick,
        Strip,
        Switch,
        Temperature,
        Text,
        Tone,
        Trigger,
        Vector,
        Weight,
    )
    from msbot.part.messages.wire_types import (
        AtMost,
        Exactly,
        Octets,
        float32,
        float64,
        int8,
        int16,
        int32,
        int64,
        uint8,
        uint16,
        uint32,
        uint64,
    )

__all__ = [
    "Angle",
    "AtMost",
    "Battery",
    "CallError",
    "Colour",
    "ConfigError",
    "Count",
    "Distance",
    "Exactly",
    "ExpectedRobot",
    "Gas",
    "HelloWorld",
    "JoinState",
    "Key",
    "Level",
    "Light",
    "Line",
    "LinkDown",
    "LinkError",
    "LinkFull",
    "LocalProtocolError",
    "Message",
    "MsbotError",
    "NotSafeYet",
    "NumatoGpio",
    "Number",
    "Octets",
    "Part",
    "Picture",
    "PinDirection",
    "PixelFormat",
    "Place",
    "Pose",
    "Pressure",
    "RegistryError",
    "RemoteProtocolError",
    "RequestError",
    "RequestTimeout",
    "Scan",
    "SimGpio",
    "Speed",
    "Stick",
    "Strip",
    "Switch",
    "Temperature",
    "Text",
    "Tone",
    "Trigger",
    "UsbGpio",
    "Vector",
    "Weight",
    "find_agents",
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

_STANDARD = "msbot.part.messages.standard"
_TYPES = "msbot.part.messages.wire_types"
_ELSEWHERE = dict.fromkeys(
    (
        "Angle",
        "Battery",
        "Colour",
        "Count",
        "Distance",
        "Gas",
        "Key",
        "Level",
        "Light",
        "Line",
        "Number",
        "Picture",
        "PixelFormat",
        "Place",
        "Pose",
        "Pressure",
        "Scan",
        "Speed",
        "Stick",
        "Strip",
        "Switch",
        "Temperature",
        "Text",
        "Tone",
        "Trigger",
        "Vector",
        "Weight",
    ),
    _STANDARD,
) | dict.fromkeys(
    (
        "float32",
        "float64",
        "int8",
        "int16",
        "int32",
        "int64",
        "uint8",
        "uint16",
        "uint32",
        "uint64",
        "AtMost",
        "Exactly",
        "Octets",
    ),
    _TYPES,
)
"""Names that are not in `msbot.part`, and where they are."""


def __getattr__(name: str) -> object:
    if name not in __all__:
        # With name and place, Python adds which name may be meant.
        raise AttributeError(f"module 'msbot' has no attribute {name!r}", name=name, obj=sys.modules[__name__])
    value: object = getattr(importlib.import_module(_ELSEWHERE.get(name, "msbot.part")), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return __all__
