"""The errors that programs catch (`msbot_xrce.errors` draws their tree)."""

from msbot_xrce.errors import (
    BusTaken,
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
