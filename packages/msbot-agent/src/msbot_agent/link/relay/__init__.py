"""A relay carries the parts of one link to a master elsewhere: `msbot relay can:can0 udp:MASTER:8888`."""

from msbot_agent.link.relay.relay import PartsRelay
from msbot_agent.link.relay.relay_messages import (
    BOOT_SIZE,
    MARK,
    Bye,
    Down,
    Heard,
    Hello,
    Message,
    Refused,
    RelayBeat,
    RelayKind,
    Room,
    Up,
    Welcome,
    Who,
    decode,
    encode,
)
from msbot_agent.link.relay.relayed_link import RelayedLink, RelayGreeting

__all__ = [
    "BOOT_SIZE",
    "MARK",
    "Bye",
    "Down",
    "Heard",
    "Hello",
    "Message",
    "PartsRelay",
    "Refused",
    "RelayBeat",
    "RelayGreeting",
    "RelayKind",
    "RelayedLink",
    "Room",
    "Up",
    "Welcome",
    "Who",
    "decode",
    "encode",
]
