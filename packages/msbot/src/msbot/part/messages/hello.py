"""The message of the sample robot's ring."""

from __future__ import annotations

from msbot.part.messages.message import Message
from msbot.part.messages.wire_types import uint32


class HelloWorld(Message):
    """Text with a count, as AA, BB and CC exchange it (thesis 3.12.3; the type of eProsima's examples)."""

    index: uint32
    message: str
