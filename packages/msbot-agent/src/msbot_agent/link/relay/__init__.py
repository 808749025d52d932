"""A relay carries the parts of one link to a master elsewhere: `msbot relay can:can0 udp:MASTER:8888`."""

from msbot_agent.link.relay.relay import PartsRelay
from msbot_agent.link.relay.relay_messages import MARK, Bye, Hello, Message, Refused, Who, decode, encode
from msbot_agent.link.relay.relayed_link import RelayedLink, RelayGreeting

__all__ = [
    "MARK",
    "Bye",
    "Hello",
    "Message",
    "PartsRelay",
    "Refused",
    "RelayGreeting",
    "RelayedLink",
    "Who",
    "decode",
    "encode",
]
