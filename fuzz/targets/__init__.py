"""All that can be fuzzed, by name."""

from __future__ import annotations

from fuzz.case import Target
from fuzz.targets.agent import AgentTarget
from fuzz.targets.can import CanTarget
from fuzz.targets.client import ClientTarget
from fuzz.targets.codec import CodecTarget
from fuzz.targets.compact import CompactTarget
from fuzz.targets.message import MessageTarget
from fuzz.targets.mqtt import MqttTarget
from fuzz.targets.page import PageTarget
from fuzz.targets.parsers import ParserTarget
from fuzz.targets.part import PartTarget
from fuzz.targets.requests import RequestTarget
from fuzz.targets.serial import SerialTarget
from fuzz.targets.simbus import SimBusTarget
from fuzz.targets.socketcan import SocketCanTarget
from fuzz.targets.sockets import SocketTarget
from fuzz.targets.toml import TomlTarget

TARGETS: dict[str, Target] = {
    target.name: target
    for target in (
        AgentTarget(),
        ClientTarget(),
        PartTarget(),
        CanTarget(),
        CodecTarget(),
        CompactTarget(),
        SocketCanTarget(),
        SimBusTarget(),
        SerialTarget(),
        MqttTarget(),
        RequestTarget(),
        MessageTarget(),
        TomlTarget(),
        ParserTarget(),
        PageTarget(),
        SocketTarget(),
    )
}
