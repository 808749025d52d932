"""The errors that several rooms raise; all derive from `MsbotError`.

A room that needs an error of its own derives it from one of these.

::

    MsbotError
    ├── ConfigError              a file, option or setting the user can mend; also a ValueError
    │   └── NotThere             there is no slot, part, frame or type of that name
    ├── LinkError                the path to a peer; also a ConnectionError
    │   ├── LinkDown             absent, closed, bus-off: nothing can be sent now
    │   │   └── BusTaken         another master is on the bus
    │   └── LinkFull             the peer's queue is full: try again when there is room
    ├── LocalProtocolError       this side asked for something the protocol does not allow; also a RuntimeError
    ├── RemoteProtocolError      the other side sent bytes that make no sense; also a ValueError
    ├── RequestError             the agent refused a request; carries the status
    │   ├── RequestTimeout       the agent did not answer in time; also a TimeoutError
    │   └── CallError            a call to another part has no reply: late, lost or refused
    └── RegistryError            the database: of a newer version, not writable
        └── DatabaseBusy         another program was writing to it: nothing has changed
"""

from __future__ import annotations


class MsbotError(Exception):
    """Base of all errors that MsBOT raises on purpose; the text is meant for a person."""


class ConfigError(MsbotError, ValueError):
    """A file, option or setting is wrong; the text says where, what, and what would be right."""


class NotThere(ConfigError):
    """There is no slot, part, frame or type of that name."""


class LinkError(MsbotError, ConnectionError):
    """The path to a peer has failed."""


class LinkDown(LinkError):
    """The link cannot carry anything now; the text says how to bring it up."""


class BusTaken(LinkDown):
    """Another master is on the bus: this one must not run there, and ends even if it has other links."""


class LinkFull(LinkError):
    """The queue to that peer is full; wait for `on_room`."""


class LocalProtocolError(MsbotError, RuntimeError):
    """This side asked for something the protocol does not allow in the present state."""


class RemoteProtocolError(MsbotError, ValueError):
    """The peer sent bytes that break the protocol; the packet is dropped and counted."""


class RequestError(MsbotError):
    """The agent answered a request with an error status.

    Attributes:
        status: the status octet of DDS-XRCE (0x80 to 0x87), or None when no answer came in time.
    """

    def __init__(self, message: str, status: int | None = None) -> None:
        super().__init__(message)
        self.status = status


class RequestTimeout(RequestError, TimeoutError):
    """The agent did not answer a request in time; the status is None."""


class CallError(RequestError):
    """A call to another part has no reply; the text says why. A function that serves raises it to refuse a request."""


class RegistryError(MsbotError):
    """The database cannot be used; the text says why and what to do."""


class DatabaseBusy(RegistryError):
    """Another program was writing to the database: nothing has changed, and the same may succeed a moment later."""
