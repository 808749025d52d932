"""Every error MsBOT raises on purpose.

::

    MsbotError
    ├── ConfigError              a file, option or setting the user can mend
    ├── LinkError                the way to a peer
    │   ├── LinkDown             absent, closed, bus-off: nothing can be sent now
    │   └── LinkFull             the peer's queue is full: try again when there is room
    ├── LocalProtocolError       this side asked for something the protocol does not allow
    ├── RemoteProtocolError      the other side sent bytes that make no sense (counted and dropped by the caller)
    ├── RequestError             the agent refused a request; carries the status
    └── RegistryError            the database: locked, of a newer version, not writable
"""

from __future__ import annotations


class MsbotError(Exception):
    """Base of all errors that MsBOT raises on purpose; the text is meant for a person."""


class ConfigError(MsbotError):
    """A file, option or setting is wrong; the text says where, what, and what would be right."""


class LinkError(MsbotError):
    """Something about the way to a peer."""


class LinkDown(LinkError):
    """The link cannot carry anything now; the text says how to bring it up."""


class LinkFull(LinkError):
    """The queue towards that peer is full; wait for `on_room`."""


class LocalProtocolError(MsbotError):
    """This side asked for something the protocol does not allow in the present state."""


class RemoteProtocolError(MsbotError):
    """The peer sent bytes that break the protocol; the packet is dropped and counted."""


class RequestError(MsbotError):
    """The agent answered a request with an error status.

    Attributes:
        status: the status octet of DDS-XRCE (0x80 to 0x87), or None when no answer came in time.
    """

    def __init__(self, message: str, status: int | None = None) -> None:
        super().__init__(message)
        self.status = status


class RegistryError(MsbotError):
    """The database cannot be used; the text says why and what to do."""
