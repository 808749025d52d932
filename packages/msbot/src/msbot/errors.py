"""The errors that programs catch (`msbot_xrce.errors` draws their tree)."""

from msbot_xrce.errors import (
    BusTaken,
    CallError,
    ConfigError,
    DatabaseBusy,
    LinkDown,
    LinkError,
    LinkFull,
    LocalProtocolError,
    MsbotError,
    NotThere,
    RegistryError,
    RemoteProtocolError,
    RequestError,
    RequestTimeout,
)

__all__ = [
    "BusTaken",
    "CallError",
    "ConfigError",
    "DatabaseBusy",
    "LinkDown",
    "LinkError",
    "LinkFull",
    "LocalProtocolError",
    "MsbotError",
    "NotThere",
    "RegistryError",
    "RemoteProtocolError",
    "RequestError",
    "RequestTimeout",
]
