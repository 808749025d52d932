"""The student's `Part`, and its DDS-XRCE client.

Messages are in `msbot.part.messages`, what a part and its inventory say to each other in `msbot.part.join`.
"""

from __future__ import annotations

from msbot.part.boards.gpio import PinDirection, SimGpio, UsbGpio
from msbot.part.boards.numato import NumatoGpio
from msbot.part.client.client import Client, ClientMaker, ServiceNames
from msbot.part.client.client_settings import ClientSettings, ConnectionState
from msbot.part.client.discovery import FoundAgent, find_agents
from msbot.part.client.entities import Entity
from msbot.part.handler_guard import NotSafeYet
from msbot.part.join.joining import ExpectedRobot, JoinState
from msbot.part.messages.message import Message
from msbot.part.messages.standard import HelloWorld
from msbot.part.part import Part
from msbot.part.run import run

__all__ = [
    "Client",
    "ClientMaker",
    "ClientSettings",
    "ConnectionState",
    "Entity",
    "ExpectedRobot",
    "FoundAgent",
    "HelloWorld",
    "JoinState",
    "Message",
    "NotSafeYet",
    "NumatoGpio",
    "Part",
    "PinDirection",
    "ServiceNames",
    "SimGpio",
    "UsbGpio",
    "find_agents",
    "run",
]
