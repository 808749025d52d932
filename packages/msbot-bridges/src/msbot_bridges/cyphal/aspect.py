"""What one data type of Cyphal means in a robot: a message that it reports, or that drives it. Needs no library."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import field
from typing import Any, Final

from msbot.part import Message
from msbot_xrce.lazy import dataclass

READINESS: Final = "reg.udral.service.common.Readiness.0.1"
FEEDBACK: Final = "reg.udral.service.actuator.common.Feedback.0.1"
STANDBY, ENGAGED = 2, 3
"""Values of `Readiness`."""
Builtin = Mapping[str, Any]
"""The fields of an object of the library, as its `update_from_builtin` takes them."""


@dataclass(frozen=True, slots=True)
class Aspect:
    """One message in a type; a type with several makes a port for each."""

    message: type[Message]
    read: Callable[[Any], Message | None] | None
    """The message of an object of the library, or None for what no message has room for; None: nothing is reported by
    this type."""
    write: Callable[[Message], Builtin] | None = None
    """The fields of an object for a message; None: nothing is driven by this type. Of a vector the one place."""
    suffix: str = ""
    """Of the port's name, where a type has several."""
    safe: Message | None = None
    """The value when nobody is in command."""
    near: Callable[[Message, Message], bool] = field(default=lambda report, safe: report == safe)
    """Whether a report is a safe value, as nearly as devices are there."""
