"""Sessions of both ends, and their events."""

from msbot_xrce.sessions.agent import DataHandler
from msbot_xrce.sessions.events import (
    AgentEvent,
    ClientEvent,
    Connected,
    ConnectFailed,
    CreateRequested,
    DataReceived,
    DataWritten,
    DeleteRequested,
    InfoRequested,
    MessagesGivenUp,
    Pong,
    ReadRequested,
    SessionClosed,
    SessionDeleteRequested,
    SessionReset,
    SessionRestarted,
    StatusReceived,
    TimeSynchronised,
    WindowOpened,
)
from msbot_xrce.streams.settings import Memory

__all__ = [
    "AgentEvent",
    "ClientEvent",
    "ConnectFailed",
    "Connected",
    "CreateRequested",
    "DataHandler",
    "DataReceived",
    "DataWritten",
    "DeleteRequested",
    "InfoRequested",
    "Memory",
    "MessagesGivenUp",
    "Pong",
    "ReadRequested",
    "SessionClosed",
    "SessionDeleteRequested",
    "SessionReset",
    "SessionRestarted",
    "StatusReceived",
    "TimeSynchronised",
    "WindowOpened",
]
