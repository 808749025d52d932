"""Message classes by the name of their type: those of the library, of MsBOT itself, and of ROS 2."""

from __future__ import annotations

from collections.abc import Callable

from msbot.config import Library
from msbot.part import HelloWorld, Message
from msbot.part.join.pnp_messages import ProfileMessage
from msbot.sim.model_part import message_class

_ROS_MARK = "::msg::dds_::"


class MessageClasses:
    """Finds the class of a message type.

    Args:
        library: the part types in force; asked each time, because an adopted part brings types of its own.
    """

    def __init__(self, library: Callable[[], Library | None]) -> None:
        self._library = library
        self._own: dict[str, type[Message]] = {cls.type_name: cls for cls in (ProfileMessage, HelloWorld)}

    def __call__(self, type_name: str) -> type[Message] | None:
        """The class, or None: nobody here knows the type."""
        library = self._library()
        message = None if library is None else library.messages.get(type_name)
        if message is not None:
            return message_class(message)
        if type_name not in self._own and _ROS_MARK in type_name:
            from msbot import ros2  # of use only to robots that speak to ROS 2

            ours = (cls for cls in vars(ros2).values() if isinstance(cls, type) and issubclass(cls, Message))
            self._own |= {cls.type_name: cls for cls in ours}
        return self._own.get(type_name)
