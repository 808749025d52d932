"""What a topic may be that a device names: a broker ends the connection of a client that asks for any other one."""

from __future__ import annotations

from msbot_xrce.errors import ConfigError

LONGEST_TOPIC = 1000
"""Octets; MQTT has room for 65,535, and no device needs so many."""
MOST_LEVELS = 100
"""Brokers take 200 and more."""


def checked_topic(topic: object, what: str) -> str:
    """A topic for one device's messages, without wildcards.

    Args:
        topic: as it stands in what somebody has published.
        what: where it stands there.

    Raises:
        ConfigError: it is no topic; the text says why.
    """
    if not isinstance(topic, str) or not topic:
        raise ConfigError(f"{what} is no topic")
    if len(topic.encode(errors="replace")) > LONGEST_TOPIC or topic.count("/") >= MOST_LEVELS:
        raise ConfigError(f"{what} is a topic of more than {LONGEST_TOPIC} bytes or {MOST_LEVELS} levels")
    if "+" in topic or "#" in topic or topic.startswith("$share/"):
        raise ConfigError(f"{what} stands for more than one topic")
    if not all(map(_may_be_in_topic, topic)):
        raise ConfigError(f"{what} has a character that no topic has")
    return topic


def _may_be_in_topic(character: str) -> bool:
    """MQTT 3.1.1 §1.5.3: no NUL and no half of a pair; brokers refuse control characters and non-characters as well."""
    code = ord(character)
    is_control = code < 0x20 or 0x7F <= code < 0xA0
    is_no_character = 0xD800 <= code < 0xE000 or 0xFDD0 <= code < 0xFDF0 or code & 0xFFFE == 0xFFFE
    return not is_control and not is_no_character
